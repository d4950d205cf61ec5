//! What is decided once a band, and measured: the noise, λ or the number of iterations, the halo, and the figures of the report.
//!
//! Parts of the film, *samples*, are restored as tiles are: at its centre, near its lower right corner, and half-way to the upper left one. λ, μ or the number of iterations: [`strength`].

mod strength;

use super::optics::Optics;
use super::planes::Pixels;
use super::recorded::Recorded;
use super::tile::{Solver, Strength, Tile};
use crate::args::{RestoreArgs, RestoreMethod};
use crate::failure::usage;
use anyhow::Result;
use pipeline::geometry::{Rect, Size};
use pipeline::restore::local::LocalSpectrum;
use pipeline::restore::noise::unit_noise;
use pipeline::restore::response::Response;
use pipeline::restore::{Operator, Restored};

/// Side of a sample, px.
const SAMPLE_PX: usize = 96;
/// Error of a pixel of a restored picture, of the peak; of the figures, of theirs.
const TOLERANCE: f64 = 1e-5;
const FIGURE_TOLERANCE: f64 = 1e-3;
/// Tolerance of the two restorations whose difference is a figure of total variation, over that of tiles.
const OF_DIFFERENCES: f64 = 2000.0;
/// The least noise, of the peak: rounding of films to f32 by engines, 2e-6.
const LEAST_NOISE: f64 = 2e-6;
const NOISE_SEED: u64 = 1;

/// Figures of a place.
#[derive(Clone, Debug)]
pub struct Figures {
    /// `center` or `corner`.
    pub name: &'static str,
    /// RMS of what restoration makes of the noise over that of the film, each of the signal of a uniform chart on the axis.
    pub noise_gain: f64,
    /// Of the film.
    pub film: Response,
    /// Of the restored picture.
    pub restored: Response,
}

/// Settings of a band.
#[derive(Clone, Debug)]
pub struct Settings {
    /// How its tiles are restored.
    pub solver: Solver,
    /// Whether the noise was estimated.
    pub is_estimated: bool,
    /// Mean square residual of the samples, of the square of the noise.
    pub residual: f64,
    /// Measured figures.
    pub figures: Vec<Figures>,
}

/// A part of the film that is restored to find the settings.
struct Sample {
    name: &'static str,
    core: Rect,
    tile: Tile,
    spectrum: LocalSpectrum,
    film: Pixels,
    /// Film pixels that show the core.
    measured: Rect,
}

impl Settings {
    /// Those of plane `plane` of `film`.
    ///
    /// # Errors
    /// The film cannot be read; the lens cannot be traced; usage: an empty film.
    pub fn of_plane(args: &RestoreArgs, film: &Recorded, optics: &Optics, plane: usize) -> Result<Self> {
        let (peak, estimated) = film.survey(plane)?;
        if peak <= 0.0 {
            return Err(usage(format!(
                "{}: band {plane} has no positive value: nothing to restore; leave it out with --bands",
                args.film.display()
            )));
        }
        let noise = args.noise.unwrap_or(estimated).max(LEAST_NOISE * peak);
        let size = film.grid().size;
        // A first map for the window, of a small part in the middle.
        let middle = sample_core(size, (0.5, 0.5));
        let probe = optics.map(plane, middle, middle)?;
        let (window_px, gain) = (probe.window_px(), probe.gain());
        let tolerance = TOLERANCE * peak / gain;
        let mut samples = Vec::new();
        for (name, at) in [("center", (0.5, 0.5)), ("corner", (1.0, 1.0)), ("half-way", (0.25, 0.25))] {
            let place = (name, sample_core(size, at));
            samples.extend(Sample::new(film, optics, (plane, noise), place, window_px)?);
        }
        let solver = Solver {
            plane,
            strength: Strength::Lambda(0.0),
            halo_px: window_px,
            window_px,
            tolerance,
            noise,
        };
        let is_estimated = args.noise.is_none() && film.raw().is_none();
        let mut settings = Self { solver, is_estimated, residual: 0.0, figures: Vec::new() };
        match args.method {
            RestoreMethod::Tikhonov => {
                settings.find_lambda(film, &samples)?;
            }
            RestoreMethod::TotalVariation => {
                let lambda = settings.find_lambda(film, &samples)?;
                settings.find_mu(lambda * peak / gain, &samples)?;
            }
            RestoreMethod::RichardsonLucy => settings.find_iterations(args.iterations, &samples)?,
        }
        for sample in samples.iter().filter(|sample| sample.name != "half-way") {
            settings.figures.push(settings.figures_of(sample, peak)?);
        }
        Ok(settings)
    }

    /// Noise gain, resolution and overshoot at a sample.
    fn figures_of(&self, sample: &Sample, peak: f64) -> Result<Figures> {
        let size = sample.tile.film.size();
        let noise: Vec<f64> = unit_noise(size.pixels(), NOISE_SEED);
        let restored_noise = self.difference(sample, &noise, self.solver.noise)?;
        let mean = restored_noise.iter().sum::<f64>() / restored_noise.len() as f64;
        let square = restored_noise.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
        let noise_gain =
            (square / restored_noise.len() as f64).sqrt() / self.solver.noise * sample.tile.map.gain();
        // A point of the picture in the middle of the core.
        let (y, x) =
            (sample.core.y + sample.core.height as i64 / 2, sample.core.x + sample.core.width as i64 / 2);
        let chart = sample.tile.chart;
        let mut point = vec![0.0f32; chart.size().pixels()];
        point[(y - chart.y) as usize * chart.width + (x - chart.x) as usize] = 1.0;
        let mut film = vec![0.0f32; size.pixels()];
        sample.tile.map.apply(&point, &mut film).map_err(anyhow::Error::from_boxed)?;
        let film: Vec<f64> = film.iter().map(|v| f64::from(*v)).collect();
        let amplitude = peak / sample.tile.map.gain();
        let image = self.difference(sample, &film, amplitude)?;
        let core = sample.core.size();
        Ok(Figures {
            name: sample.name,
            noise_gain,
            film: Response::new(&film, size, size.rect()),
            restored: Response::new(&image, core, core.rect()),
        })
    }

    /// What `amplitude` times `pattern`, added to the film of a sample, adds to its restored core.
    fn difference(&self, sample: &Sample, pattern: &[f64], amplitude: f64) -> Result<Vec<f64>> {
        let is_linear = matches!(self.solver.strength, Strength::Lambda(_));
        let base = |k: usize| if is_linear { 0.0 } else { f64::from(sample.film.values[k]) };
        let film = |amplitude: f64| -> Pixels {
            let values = pattern.iter().enumerate().map(|(k, v)| (base(k) + amplitude * v) as f32).collect();
            Pixels { values, weights: sample.film.weights.clone() }
        };
        let restore = |film: &Pixels| -> Result<Vec<f64>> {
            // Of two restorations that are not linear the difference is far more exact than each.
            let tolerance =
                if is_linear { FIGURE_TOLERANCE * amplitude } else { OF_DIFFERENCES * self.solver.tolerance };
            let restored =
                sample.tile.restored(Some(&sample.spectrum), film, self.solver.strength, tolerance)?;
            Ok(sample.tile.values(&restored.chart, sample.core))
        };
        let mut with = restore(&film(amplitude))?;
        if !is_linear {
            let without = restore(&film(0.0))?;
            with.iter_mut().zip(without).for_each(|(with, without)| *with -= without);
        }
        Ok(with)
    }
}

impl Sample {
    fn new(
        film: &Recorded,
        optics: &Optics,
        (plane, noise): (usize, f64),
        (name, core): (&'static str, Rect),
        window_px: usize,
    ) -> Result<Option<Self>> {
        let Some(tile) = Tile::new(optics, plane, core, (window_px, window_px))? else { return Ok(None) };
        let pixels = film.read(plane, tile.film, noise)?;
        let (spectrum, measured) = (tile.spectrum()?, tile.film_rect(optics, plane, core)?);
        Ok(Some(Self { name, core, spectrum, film: pixels, measured, tile }))
    }

    fn restored(&self, strength: Strength, tolerance: f64) -> Result<Restored> {
        self.tile.restored(Some(&self.spectrum), &self.film, strength, tolerance)
    }

    /// Sum of the weighted squares of the residual over the film pixels of the core, and the number of those that are measured.
    fn square_residual(&self, chart: &[f64]) -> Result<(f64, usize)> {
        let start = Vec::new();
        let residual = self.tile.part(&self.film, &start).square_residual(chart, self.measured);
        residual.map_err(anyhow::Error::from_boxed)
    }
}

/// The core of a sample at shares (down, across) of what is left of a picture of `size`.
fn sample_core(size: Size, (down, across): (f64, f64)) -> Rect {
    let (height, width) = (SAMPLE_PX.min(size.height), SAMPLE_PX.min(size.width));
    let at = |free: usize, share: f64| (free as f64 * share).round() as i64;
    Rect::new(at(size.height - height, down), at(size.width - width, across), height, width)
}
