//! The lens of a film at any part of it: the map of places, and the linear map of a small chart to a small film.
//!
//! Charts are on the *picture's grid*: the film's pixels, as places of the ideal image plane. x_mm = (x − axis_x) · pitch, y likewise.

use super::planes::{Grid, Plane};
use super::recorded::Recorded;
use crate::failure::usage;
use crate::job::arrays::{ArrayFilm, ArrayLens};
use crate::progress::interrupt;
use anyhow::{Context, Result};
use pipeline::flow::SourceSinkError;
use pipeline::geometry::{Rect, Size};
use pipeline::restore::Operator;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// The lens of a film.
pub struct Optics {
    lens: ArrayLens,
    grid: Grid,
    /// Planes, with the wavelength of the band whose places they have, nm.
    planes: Vec<(Plane, f64)>,
    digest: Option<String>,
}

/// The map from the charts of a part of the picture to a part of the film, of one plane, without tails of PSFs: the mean of its bands.
pub struct Map {
    film: Arc<ArrayFilm>,
    bands: Vec<(usize, f64)>,
    cancel: &'static AtomicBool,
}

impl Optics {
    /// The lens of `film`.
    ///
    /// # Errors
    /// It cannot be opened; it is not the film's.
    pub fn open(film: &Recorded) -> Result<Self> {
        let wavelengths_nm = film.film_wavelengths_nm();
        let open = |flags: &[String]| {
            ArrayLens::open(flags, Some(wavelengths_nm.to_vec())).with_context(|| {
                format!("opening the lens of film {}; --lens names another path", film.film_path().display())
            })
        };
        let mut lens = open(film.flags())?;
        let reach_mm = film.film_reach_mm();
        if lens.is_symmetric_design() {
            // Tiles anywhere have the lens of the complete film.
            let mut flags = film.flags().to_vec();
            flags.push(format!("--reach-mm={reach_mm}"));
            lens = open(&flags)?;
        }
        // One map of places for all tiles.
        let planes: Vec<(Plane, f64)> =
            film.planes().iter().map(|plane| (plane.clone(), nearest(plane, wavelengths_nm))).collect();
        for (_, nm) in &planes {
            lens.chart_of_film(&[[reach_mm, 0.0]], *nm)?;
        }
        let digest = film.comparable_digest().map(str::to_owned);
        Ok(Self { lens, grid: film.grid(), planes, digest })
    }

    /// Size of the film.
    pub fn film(&self) -> Size {
        self.grid.size
    }

    /// A plane.
    pub fn plane(&self, plane: usize) -> &Plane {
        &self.planes[plane].0
    }

    /// Places (row, column) of the picture that the film shows at places (row, column).
    ///
    /// # Errors
    /// Beyond the field of the lens.
    pub fn picture_of_film(&self, plane: usize, places: &[(f64, f64)]) -> Result<Vec<(f64, f64)>> {
        let mm: Vec<[f64; 2]> = places.iter().map(|place| self.mm(*place)).collect();
        let found = self.lens.chart_of_film(&mm, self.planes[plane].1)?;
        let px = |[x, y]: [f64; 2]| {
            let per_mm = 1e3 / self.grid.pitch_um;
            (y * per_mm + self.grid.axis_px.0, x * per_mm + self.grid.axis_px.1)
        };
        Ok(found.into_iter().map(px).collect())
    }

    /// Relative illumination at places (row, column) of the film.
    ///
    /// # Errors
    /// As [`Optics::picture_of_film`].
    pub fn illumination(&self, plane: usize, places: &[(f64, f64)]) -> Result<Vec<f64>> {
        let mm: Vec<[f64; 2]> = places.iter().map(|place| self.mm(*place)).collect();
        self.lens.relative_illumination(&mm, self.planes[plane].1)
    }

    fn mm(&self, (row, column): (f64, f64)) -> [f64; 2] {
        let pitch_mm = self.grid.pitch_um * 1e-3;
        [(column - self.grid.axis_px.1) * pitch_mm, (row - self.grid.axis_px.0) * pitch_mm]
    }

    /// The map from charts of `chart`, a rectangle of the picture's grid, to films of `film`, one of the film.
    ///
    /// # Errors
    /// The lens cannot be traced; it is not the film's.
    pub fn map(&self, plane: usize, chart: Rect, film: Rect) -> Result<Map> {
        let middle = |first: i64, n: usize, axis: f64| {
            (first as f64 + (n as f64 - 1.0) / 2.0 - axis) * self.grid.pitch_um * 1e-3
        };
        let flags = [
            format!("--film-pitch-um={}", self.grid.pitch_um),
            format!("--film-size={}x{}", film.width, film.height),
            format!("--axis={},{}", self.grid.axis_px.1 - film.x as f64, self.grid.axis_px.0 - film.y as f64),
            format!(
                "--center={},{}",
                middle(chart.x, chart.width, self.grid.axis_px.1),
                middle(chart.y, chart.height, self.grid.axis_px.0)
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
        Ok(Map { film, bands: self.planes[plane].0.bands.clone(), cancel: interrupt::cancel_flag() })
    }
}

/// The wavelength of the band nearest to a plane.
fn nearest(plane: &Plane, wavelengths_nm: &[f64]) -> f64 {
    let distance = |nm: &f64| (nm - plane.wavelength_nm).abs();
    *wavelengths_nm.iter().min_by(|a, b| distance(a).total_cmp(&distance(b))).expect("a film has bands")
}

impl Map {
    /// Side of its PSF windows, film pixels: the largest of its bands.
    pub fn window_px(&self) -> usize {
        self.bands.iter().map(|(band, _)| self.film.window_px(*band)).max().unwrap_or(1)
    }

    /// Film value per chart value on the axis.
    pub fn gain(&self) -> f64 {
        self.bands.iter().map(|(band, share)| share * self.film.gain(*band)).sum()
    }

    /// The mean over the bands of what `of` computes for each.
    fn mean(&self, out: &mut [f32], of: impl Fn(usize, &mut [f32]) -> Result<()>) -> Result<()> {
        if let [(band, 1.0)] = self.bands[..] {
            return of(band, out);
        }
        let mut part = vec![0.0; out.len()];
        out.fill(0.0);
        for (band, share) in &self.bands {
            of(*band, &mut part)?;
            out.iter_mut().zip(&part).for_each(|(sum, value)| *sum += *share as f32 * value);
        }
        Ok(())
    }
}

impl Operator for Map {
    fn chart(&self) -> Size {
        let [_, height, width] = self.film.chart_shape();
        Size::new(height, width)
    }

    fn film(&self) -> Size {
        let [_, height, width] = self.film.shape();
        Size::new(height, width)
    }

    fn apply(&self, chart: &[f32], film: &mut [f32]) -> Result<(), SourceSinkError> {
        Ok(self.mean(film, |band, film| self.film.compute_in_windows(band, chart, film, self.cancel))?)
    }

    fn transpose(&self, film: &[f32], chart: &mut [f32]) -> Result<(), SourceSinkError> {
        Ok(self.mean(chart, |band, chart| self.film.adjoint_in_windows(band, film, chart, self.cancel))?)
    }
}
