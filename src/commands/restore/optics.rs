//! The lens of a film at any part of it: the map of places, and the linear map of a small chart to a small film.
//!
//! Charts are on the *picture's grid*: the film's pixels, as places of the ideal image plane. x_mm = (x − axis_x) · pitch, y likewise.

use super::recorded::Recorded;
use crate::args::RestoreArgs;
use crate::failure::usage;
use crate::job::arrays::{ArrayFilm, ArrayLens};
use crate::progress::interrupt;
use anyhow::{Context, Result};
use pipeline::geometry::{Rect, Size};
use pipeline::restore::Operator;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// The lens of a film.
pub struct Optics {
    lens: ArrayLens,
    film: Size,
    pitch_um: f64,
    /// (row, column).
    axis_px: (f64, f64),
    wavelengths_nm: Vec<f64>,
    digest: Option<String>,
}

/// The map from the charts of a part of the picture to a part of the film, of one band, without tails of PSFs.
pub struct Map {
    film: Arc<ArrayFilm>,
    band: usize,
    cancel: &'static AtomicBool,
}

impl Optics {
    /// The lens of `film`.
    ///
    /// # Errors
    /// It cannot be opened; it is not the film's.
    pub fn open(film: &Recorded, args: &RestoreArgs) -> Result<Self> {
        let spec = film.spec();
        let open = |flags: &[String]| {
            ArrayLens::open(flags, Some(spec.wavelengths_nm.clone())).with_context(|| {
                format!("opening the lens of film {}; --lens names another path", args.film.display())
            })
        };
        let mut lens = open(film.flags())?;
        let (film_px, axis) = (spec.film, spec.axis_px);
        let far = |axis: f64, n: usize| (axis + 0.5).abs().max((n as f64 - 0.5 - axis).abs());
        let reach_mm = far(axis.0, film_px.height).hypot(far(axis.1, film_px.width)) * spec.pitch_um * 1e-3;
        if lens.is_symmetric_design() {
            // Tiles anywhere have the lens of the complete film.
            let mut flags = film.flags().to_vec();
            flags.push(format!("--reach-mm={reach_mm}"));
            lens = open(&flags)?;
        }
        // One map of places for all tiles.
        for nm in &spec.wavelengths_nm {
            lens.chart_of_film(&[[reach_mm, 0.0]], *nm)?;
        }
        Ok(Self {
            lens,
            film: film_px,
            pitch_um: spec.pitch_um,
            axis_px: axis,
            wavelengths_nm: spec.wavelengths_nm.clone(),
            digest: film.lens_digest().map(str::to_owned),
        })
    }

    /// Size of the film.
    pub fn film(&self) -> Size {
        self.film
    }

    /// Places (row, column) of the picture that the film shows at places (row, column).
    ///
    /// # Errors
    /// Beyond the field of the lens.
    pub fn picture_of_film(&self, band: usize, places: &[(f64, f64)]) -> Result<Vec<(f64, f64)>> {
        let mm: Vec<[f64; 2]> = places.iter().map(|place| self.mm(*place)).collect();
        let found = self.lens.chart_of_film(&mm, self.wavelengths_nm[band])?;
        let px = |[x, y]: [f64; 2]| {
            let per_mm = 1e3 / self.pitch_um;
            (y * per_mm + self.axis_px.0, x * per_mm + self.axis_px.1)
        };
        Ok(found.into_iter().map(px).collect())
    }

    /// Relative illumination at places (row, column) of the film.
    ///
    /// # Errors
    /// As [`Optics::picture_of_film`].
    pub fn illumination(&self, band: usize, places: &[(f64, f64)]) -> Result<Vec<f64>> {
        let mm: Vec<[f64; 2]> = places.iter().map(|place| self.mm(*place)).collect();
        self.lens.relative_illumination(&mm, self.wavelengths_nm[band])
    }

    fn mm(&self, (row, column): (f64, f64)) -> [f64; 2] {
        let pitch_mm = self.pitch_um * 1e-3;
        [(column - self.axis_px.1) * pitch_mm, (row - self.axis_px.0) * pitch_mm]
    }

    /// The map from charts of `chart`, a rectangle of the picture's grid, to films of `film`, one of the film.
    ///
    /// # Errors
    /// The lens cannot be traced; it is not the film's.
    pub fn map(&self, band: usize, chart: Rect, film: Rect) -> Result<Map> {
        let middle = |first: i64, n: usize, axis: f64| {
            (first as f64 + (n as f64 - 1.0) / 2.0 - axis) * self.pitch_um * 1e-3
        };
        let flags = [
            format!("--film-pitch-um={}", self.pitch_um),
            format!("--film-size={}x{}", film.width, film.height),
            format!("--axis={},{}", self.axis_px.1 - film.x as f64, self.axis_px.0 - film.y as f64),
            format!(
                "--center={},{}",
                middle(chart.x, chart.width, self.axis_px.1),
                middle(chart.y, chart.height, self.axis_px.0)
            ),
        ];
        let film = self.lens.film(chart.size(), &flags)?;
        let found = film.lens_digest()?;
        if self.digest.as_deref().is_some_and(|digest| digest != found) {
            return Err(usage(format!(
                "the lens is not the one that made the film: digest {found}, the film records {}; open it as it was, or give the lens by --lens",
                self.digest.as_deref().unwrap_or_default()
            )));
        }
        Ok(Map { film, band, cancel: interrupt::cancel_flag() })
    }
}

impl Map {
    /// Side of its PSF windows, film pixels.
    pub fn window_px(&self) -> usize {
        self.film.window_px(self.band)
    }

    /// Film value per chart value on the axis.
    pub fn gain(&self) -> f64 {
        self.film.gain(self.band)
    }
}

impl Operator for Map {
    type Error = anyhow::Error;

    fn chart(&self) -> Size {
        let [_, height, width] = self.film.chart_shape();
        Size::new(height, width)
    }

    fn film(&self) -> Size {
        let [_, height, width] = self.film.shape();
        Size::new(height, width)
    }

    fn apply(&self, chart: &[f32], film: &mut [f32]) -> Result<()> {
        self.film.compute_in_windows(self.band, chart, film, self.cancel)
    }

    fn transpose(&self, film: &[f32], chart: &mut [f32]) -> Result<()> {
        self.film.adjoint_in_windows(self.band, film, chart, self.cancel)
    }
}
