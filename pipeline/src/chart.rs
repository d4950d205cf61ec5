//! Generated charts: drawn on request, any rectangle of any band, at any size, without a store.
//!
//! A chart is a flat Lambertian surface of reflectance ρ under one illuminant of uniform illuminance 1000 lx:
//!   L(λ) = ρ(λ)·E(λ)/π   [W m⁻² sr⁻¹ nm⁻¹],   K_m ∫ E·ȳ dλ = 1000 lx,   K_m = 683 lm/W
//! Every pixel is the exact mean over its square (`coverage.rs`), a weighted sum of a few inks (`picture.rs`); its bits do not depend on
//! the requested rectangle.
//! The chart extends `overscan_px` beyond its film on every side: barrel distortion and the PSF's tail bring chart from beyond the
//! film's border onto the film. Positions are given in FILM pixels: row and column from the film's first pixel, centres at integers;
//! chart pixel = film pixel + overscan.
//! Not modelled: gloss, texture, uneven illumination, so that all variation on the film is due to the lens. Noise is optional (`noise.rs`).

mod composite;
mod coverage;
mod dead_leaves;
mod depth_scene;
mod drawing;
mod error;
mod fiducials;
pub mod glyphs;
mod inks;
mod noise;
mod oecf;
mod parse;
mod picture;
mod shares;
mod sine_star;
mod spec;
mod targets;

pub use depth_scene::ScenePart;
pub use drawing::EdgeSite;
pub use error::ChartError;
pub use inks::UNITS;
pub use sine_star::{StarProfile, StarSite};
pub use spec::{ChartSpec, KINDS, Kind};
pub use targets::{EdgePlaces, PointShape};

use crate::colour::checker_reflectance;
use crate::flow::{ChartSource, SourceSinkError};
use crate::geometry::{Rect, Size};
use dead_leaves::DeadLeaves;
use depth_scene::DepthScene;
use drawing::{Drawing, PatchColour};
use inks::Inks;
use picture::Picture;

/// Bands from which on it pays to keep the shares of pixels: computing them for storage takes as long as drawing three bands.
const MIN_CACHED_BANDS: usize = 4;

/// Bytes of shares of the composite chart, which has most edges, per pixel of height and width.
const CACHE_BYTES_PER_PX_OF_SIDE: usize = 1024;

/// A chart drawn on request from its [`ChartSpec`].
pub struct Generator {
    spec: ChartSpec,
    overscan_px: usize,
    chart: Size,
    picture: Picture,
    /// Near objects of a depth scene, whose wall and floor are the picture.
    scene: Option<DepthScene>,
    /// Leaves and the ink of reflectance 1, over the picture.
    leaves: Option<(DeadLeaves, usize)>,
    /// Radiance of every ink, per band.
    radiance: Vec<Vec<f32>>,
    points: Vec<(f64, f64)>,
    edges: Vec<EdgeSite>,
    patches: Vec<Rect>,
    stars: Vec<StarSite>,
    colours: Vec<PatchColour>,
    fiducials: Option<[(f64, f64); 4]>,
}

impl Generator {
    /// Computes the layout; draws nothing yet.
    ///
    /// # Errors
    /// [`ChartError`] if the specification is out of range or its details are too close to each other.
    pub fn new(spec: ChartSpec) -> Result<Self, ChartError> {
        spec.check()?;
        let overscan_px = spec.overscan();
        let inks = Inks::new(spec.illuminant, spec.wavelengths_nm.clone());
        let mut drawing = Drawing::new(spec.film, overscan_px, inks);
        if spec.fiducials_px > 0.0 {
            drawing.corner_px = fiducials::covered_px(spec.fiducials_px);
        }
        let (mut scene, mut leaves) = (None, None);
        match &spec.kind {
            Kind::Uniform { value } => drawing.uniform(*value),
            Kind::Points { count, shape, width_px } => drawing.points(*count, *shape, *width_px)?,
            Kind::SlantedEdge { angle_deg, contrast, places, patch_px } => {
                drawing.slanted_edges(*angle_deg, *contrast, places, *patch_px)?;
            }
            Kind::Esfr { angle_deg, contrast, grid } => drawing.esfr(*angle_deg, *contrast, *grid)?,
            Kind::DotGrid { count, width_px } => drawing.dot_grid(*count, *width_px)?,
            Kind::BlackSpots { along, diameter } => drawing.black_spots(*along, *diameter)?,
            Kind::Lamp { radius_px, column, row } => drawing.lamp(*radius_px, *column, *row),
            Kind::Siemens { spokes, grid, profile } => drawing.siemens(*spokes, *grid, *profile),
            Kind::DeadLeaves { seed, r_min_px, r_max_px, contrast } => {
                let area = drawing.leaf_frame();
                let white = drawing.inks.grey(1.0);
                leaves = Some((DeadLeaves::new(area, *seed, *r_min_px, *r_max_px, *contrast), white));
            }
            Kind::Oecf { patches, density } => drawing.oecf(*patches, *density)?,
            Kind::Checker => drawing.checker(),
            Kind::Composite => composite::draw(&mut drawing, spec.pitch_um),
            Kind::DepthScene { near_m, far_m, part } => {
                scene = Some(DepthScene::draw(&mut drawing, *near_m, *far_m, *part));
            }
        }
        let uniform = match spec.kind {
            Kind::Uniform { value } => Some(value),
            _ => None,
        };
        let fiducials = match spec.fiducials_px {
            0.0 => None,
            side_px => Some(drawing.fiducials(side_px, uniform)?),
        };
        Ok(Self {
            overscan_px,
            chart: drawing.chart(),
            radiance: drawing.inks.into_bands(),
            picture: drawing.picture,
            scene,
            leaves,
            points: drawing.points,
            edges: drawing.edges,
            patches: drawing.patches,
            stars: drawing.stars,
            colours: drawing.colours,
            fiducials,
            spec,
        })
    }

    /// Bytes with which the shares of all pixels at edges are kept from band to band, approximately; edges grow as the sides of the
    /// chart. 0 for charts of few bands, for which they do not pay.
    pub fn useful_cache_bytes(&self) -> usize {
        if self.radiance.len() < MIN_CACHED_BANDS {
            return 0;
        }
        (self.chart.height + self.chart.width).saturating_mul(CACHE_BYTES_PER_PX_OF_SIDE)
    }

    /// Sets the bytes of shares of pixels that are kept from band to band; at first there is no cache.
    pub fn set_cache_bytes(&mut self, bytes: usize) {
        self.picture.set_cache_bytes(bytes.min(self.useful_cache_bytes()));
    }

    /// Its specification.
    pub const fn spec(&self) -> &ChartSpec {
        &self.spec
    }

    /// Size of the film.
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
        match self.spec.kind {
            Kind::DepthScene { part, .. } => part.units(),
            _ => UNITS,
        }
    }

    /// Centres (row, column) of all isolated points and dots, film pixels: integers, so that each is symmetric in pixels.
    pub fn points_px(&self) -> &[(f64, f64)] {
        &self.points
    }

    /// The slanted edges of a `slanted-edge` or `iso12233-esfr` chart.
    pub fn edges(&self) -> &[EdgeSite] {
        &self.edges
    }

    /// The 24 ColorChecker patches row by row, the grey steps of an `iso12233-esfr` or `oecf` chart from dark to light, or the left and right part
    /// of the frame of `dead-leaves`, in film pixels; empty for other charts.
    pub fn patches_px(&self) -> &[Rect] {
        &self.patches
    }

    /// The stars of a `siemens` chart.
    pub fn stars(&self) -> &[StarSite] {
        &self.stars
    }

    /// The part of the film that the texture of a `dead-leaves` chart fills, film pixels.
    pub fn texture_px(&self) -> Option<Rect> {
        let m = self.overscan_px as i64;
        self.leaves.as_ref().map(|(leaves, _)| Rect {
            y: leaves.area.y - m,
            x: leaves.area.x - m,
            ..leaves.area
        })
    }

    /// Reflectance of each of [`Generator::patches_px`] at a wavelength, relative to a perfect reflecting diffuser.
    pub fn patch_reflectance(&self, wavelength_nm: f64) -> Vec<f64> {
        let reflectance = |colour: &PatchColour| match *colour {
            PatchColour::Grey(reflectance) => reflectance,
            PatchColour::Checker(patch) => checker_reflectance(patch, wavelength_nm),
        };
        self.colours.iter().map(reflectance).collect()
    }

    /// Centres (row, column) in film pixels of the corner marks at the top left, top right, bottom right and bottom left, if it has any.
    pub const fn fiducials(&self) -> Option<[(f64, f64); 4]> {
        self.fiducials
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
                format!("{rect} of band {band} is not inside the generated chart of {}", self.chart).into()
            );
        }
        if out.len() != rect.size().pixels() {
            return Err(format!("{rect} of band {band} does not fit a buffer of {} pixels", out.len()).into());
        }
        match &self.scene {
            Some(scene) => scene.paint(&self.picture, inks, rect, out),
            None => self.picture.paint(inks, rect, out),
        }
        if let Some((leaves, white)) = &self.leaves {
            leaves.paint(inks[*white], rect, out);
        }
        let is_radiance = !matches!(self.spec.kind, Kind::DepthScene { part, .. } if !part.is_radiance());
        if self.spec.noise > 0.0 && is_radiance {
            noise::add(self.spec.noise, band, rect, out);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
