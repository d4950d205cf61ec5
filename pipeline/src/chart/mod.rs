//! Charts that need no store: drawn on the fly, any rectangle of any band, at any size.
//!
//! A chart is flat, lit by one illuminant from all sides to 1000 lx, and reflects as a matt surface does:
//!   L(λ) = ρ(λ)·E(λ)/π   [W m⁻² sr⁻¹ nm⁻¹],   K_m ∫ E·ȳ dλ = 1000 lx,   K_m = 683 lm/W,
//! ρ its reflectance. Every pixel is the exact mean over its square (`coverage.rs`), a sum of shares of a few inks
//! (`picture.rs`), the same bits whatever rectangle is asked for.
//! The chart is larger than its film by `overscan_px` on every side, so that a lens that draws the field inwards, and
//! the PSF's tail, find chart beyond the film's border. Places are given in FILM pixels: row and column from the
//! film's first pixel, centres at integers; chart pixel = film pixel + overscan.
//! Left out: gloss, texture, uneven light: what varies on the film is the lens's doing. `noise` alone is added where it is
//! asked for (`noise.rs`).

mod composite;
mod coverage;
pub mod glyphs;
mod inks;
mod noise;
mod picture;
mod sheet;
mod spec;
mod targets;

pub use sheet::EdgeSite;
pub use spec::{Blob, ChartError, ChartSpec, KINDS, Kind, Sites};

use crate::flow::{ChartSource, SourceSinkError};
use crate::geometry::{Rect, Size};
use inks::Inks;
use picture::Picture;
use sheet::Sheet;

/// Unit of the values.
pub const UNITS: &str = "W m-2 sr-1 nm-1";

/// A chart drawn on the fly from its [`ChartSpec`].
pub struct Generator {
    spec: ChartSpec,
    overscan_px: usize,
    chart: Size,
    picture: Picture,
    /// Radiance of every ink, per band.
    radiance: Vec<Vec<f32>>,
    points: Vec<(f64, f64)>,
    edges: Vec<EdgeSite>,
    patches: Vec<Rect>,
}

impl Generator {
    /// Lays the chart out; draws nothing yet.
    ///
    /// # Errors
    /// If the specification asks for what cannot be drawn.
    pub fn new(spec: ChartSpec) -> Result<Self, ChartError> {
        spec.check()?;
        let overscan_px = spec.overscan();
        let inks = Inks::new(spec.illuminant, spec.wavelengths_nm.clone());
        let mut sheet = Sheet::new(spec.film, overscan_px, inks);
        match &spec.kind {
            Kind::Uniform { value } => sheet.uniform(*value),
            Kind::Points { count, blob, width_px } => sheet.points(*count, *blob, *width_px)?,
            Kind::SlantedEdge { angle_deg, contrast, sites, patch_px } => {
                sheet.slanted_edges(*angle_deg, *contrast, sites, *patch_px)?;
            }
            Kind::Esfr { angle_deg, contrast, grid } => sheet.esfr(*angle_deg, *contrast, *grid)?,
            Kind::DotGrid { count, width_px } => sheet.dot_grid(*count, *width_px)?,
            Kind::Siemens { spokes, grid } => sheet.siemens(*spokes, *grid),
            Kind::Checker => sheet.checker(),
            Kind::Composite => composite::draw(&mut sheet, spec.pitch_um),
        }
        Ok(Self {
            overscan_px,
            chart: sheet.chart(),
            radiance: sheet.inks.into_bands(),
            picture: sheet.picture,
            points: sheet.points,
            edges: sheet.edges,
            patches: sheet.patches,
            spec,
        })
    }

    /// What it was made from, with the defaults filled in.
    pub const fn spec(&self) -> &ChartSpec {
        &self.spec
    }

    /// Size of the film that the chart is for.
    pub const fn film_size(&self) -> Size {
        self.spec.film
    }

    /// Chart pixels beyond the film on every side.
    pub const fn overscan_px(&self) -> usize {
        self.overscan_px
    }

    /// Pixel pitch of chart and film in µm.
    pub const fn pitch_um(&self) -> f64 {
        self.spec.pitch_um
    }

    /// Wavelength of every band in nm.
    pub fn wavelengths_nm(&self) -> &[f64] {
        &self.spec.wavelengths_nm
    }

    /// Unit of the values.
    pub const fn units(&self) -> &'static str {
        UNITS
    }

    /// Centres (row, column) of all isolated blobs and dots, film pixels: whole numbers, so that each is symmetric in pixels.
    pub fn points_px(&self) -> &[(f64, f64)] {
        &self.points
    }

    /// The slanted edges of a `slanted-edge` or `iso12233-esfr` chart.
    pub fn edges(&self) -> &[EdgeSite] {
        &self.edges
    }

    /// The 24 ColorChecker patches, or the grey steps of an `iso12233-esfr` chart from dark to light, in film pixels, row by row;
    /// empty where a chart has none.
    pub fn patches_px(&self) -> &[Rect] {
        &self.patches
    }
}

impl std::str::FromStr for Generator {
    type Err = ChartError;

    /// Reads `KIND?key=value&key=value`, with or without `gen:` before it.
    fn from_str(spec: &str) -> Result<Self, ChartError> {
        Self::new(spec.parse()?)
    }
}

impl ChartSource for Generator {
    fn size(&self) -> Size {
        self.chart
    }

    fn read(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        let inks = self.radiance.get(band).ok_or_else(|| {
            format!("the generated chart has no band {band}: it has {}, counted from 0", self.radiance.len())
        })?;
        if !self.chart.rect().contains(rect) {
            return Err(
                format!("{rect} of band {band} leaves the generated chart, which is {}", self.chart).into()
            );
        }
        if out.len() != rect.size().pixels() {
            return Err(format!("{rect} of band {band} does not fit a buffer of {} pixels", out.len()).into());
        }
        self.picture.paint(inks, rect, out);
        if self.spec.noise > 0.0 {
            noise::add(self.spec.noise, band, rect, out);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
