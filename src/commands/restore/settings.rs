//! What is decided once a band, and measured: the noise, λ or the number of iterations, the halo, and the figures of the report.
//!
//! Parts of the film, *samples*, are restored as tiles are: at its centre, near its lower right corner, and half-way to the upper left one. λ is that of
//! [`pipeline::restore::discrepancy`]: predicted from up to [`PATCHES`]² patches of the film, corrected by the residuals of the samples.

use super::optics::Optics;
use super::recorded::Recorded;
use super::tile::{Solver, Strength, Tile};
use crate::args::{RestoreArgs, RestoreMethod};
use crate::failure::usage;
use anyhow::Result;
use pipeline::geometry::{Rect, Size};
use pipeline::restore::discrepancy::{self, CLOSE, PartPower};
use pipeline::restore::local::LocalSpectrum;
use pipeline::restore::noise::{NoiseEstimate, unit_noise};
use pipeline::restore::response::Response;
use pipeline::restore::richardson_lucy::Iteration;
use pipeline::restore::{Operator, Restored};

/// Side of a sample, px.
const SAMPLE_PX: usize = 96;
/// Patches along each side of the film from which λ is predicted, and their side.
const PATCHES: usize = 4;
const PATCH_PX: usize = 256;
/// Pixels of a film of which its noise is estimated, about, and rows that are read together.
const NOISE_PIXELS: usize = 4_000_000;
const ROWS: usize = 256;
/// Corrections of λ by the residuals of the samples, at most.
const CORRECTIONS: usize = 3;
/// Iterations of Richardson-Lucy without `--iterations`, at most.
const MAX_ITERATIONS: usize = 200;
/// Error of a pixel of a restored picture, of the peak; of the figures, of theirs.
const TOLERANCE: f64 = 1e-5;
const FIGURE_TOLERANCE: f64 = 1e-3;
/// Share of the response to a film pixel that lies beyond the halo.
const BEYOND_HALO: f64 = 1e-3;
/// The largest halo, px.
const MAX_HALO_PX: usize = 160;
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
    /// RMS noise of a film pixel.
    pub noise: f64,
    /// Whether it was estimated.
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
    film: Vec<f32>,
    /// Film pixels that show the core.
    measured: Rect,
}

impl Settings {
    /// Those of band `band` of `film`.
    ///
    /// # Errors
    /// The film cannot be read; the lens cannot be traced; usage: an empty film.
    pub fn of_band(args: &RestoreArgs, film: &Recorded, optics: &Optics, band: usize) -> Result<Self> {
        let (peak, estimated) = survey(film, band)?;
        if peak <= 0.0 {
            return Err(usage(format!(
                "film {}: band {band} has no positive value: nothing to restore; leave it out with --bands",
                args.film.display()
            )));
        }
        let noise = args.noise.unwrap_or(estimated).max(LEAST_NOISE * peak);
        let size = film.spec().film;
        // A first map for the window, of a small part in the middle.
        let middle = sample_core(size, (0.5, 0.5));
        let probe = optics.map(band, middle, middle)?;
        let (window_px, gain) = (probe.window_px(), probe.gain());
        let tolerance = TOLERANCE * peak / gain;
        let mut samples = Vec::new();
        for (name, at) in [("center", (0.5, 0.5)), ("corner", (1.0, 1.0)), ("half-way", (0.25, 0.25))] {
            samples.extend(Sample::new(film, optics, band, (name, sample_core(size, at)), window_px)?);
        }
        let solver =
            Solver { band, strength: Strength::Lambda(0.0), halo_px: window_px, window_px, tolerance };
        let is_estimated = args.noise.is_none();
        let mut settings = Self { solver, noise, is_estimated, residual: 0.0, figures: Vec::new() };
        match args.method {
            RestoreMethod::Tikhonov => settings.find_lambda(film, &samples)?,
            RestoreMethod::RichardsonLucy => settings.find_iterations(args.iterations, &samples)?,
        }
        for sample in samples.iter().filter(|sample| sample.name != "half-way") {
            settings.figures.push(settings.figures_of(sample, peak)?);
        }
        Ok(settings)
    }

    /// λ by the discrepancy principle.
    fn find_lambda(&mut self, film: &Recorded, samples: &[Sample]) -> Result<()> {
        let aim = self.noise * self.noise;
        let spectrum = &samples[0].spectrum;
        let patches = patches(film, self.solver.band, spectrum)?;
        let of_sample = |sample: &Sample| {
            let Rect { y, x, height, width } = sample.measured;
            let row =
                |k: usize| &sample.film[(y as usize + k) * sample.tile.film.width + x as usize..][..width];
            let part: Vec<f32> = (0..height).flat_map(row).copied().collect();
            PartPower::new(&sample.spectrum, &part, Size::new(height, width))
        };
        let of_samples: Vec<PartPower> = samples.iter().map(of_sample).collect();
        let mut lambda = discrepancy::lambda(&patches, aim);
        let mean = |parts: &[PartPower], lambda: f64| {
            parts.iter().map(|part| part.residual(lambda)).sum::<f64>() / parts.len() as f64
        };
        for correction in 0..=CORRECTIONS {
            let (mut squares, mut pixels) = (0.0, 0.0);
            for sample in samples {
                let strength = Strength::Lambda(lambda);
                let restored = sample.restored(strength, 1e2 * self.solver.tolerance)?;
                squares += sample.square_residual(&restored.chart)?;
                pixels += sample.measured.size().pixels() as f64;
            }
            let measured = squares / pixels;
            // The patches, with the ratio of what was measured to what was predicted of the samples.
            let ratio = measured / mean(&of_samples, lambda);
            let predicted = ratio * mean(&patches, lambda);
            self.residual = predicted / aim;
            if (self.residual - 1.0).abs() < CLOSE || correction == CORRECTIONS {
                break;
            }
            let next = discrepancy::lambda(&patches, aim / ratio);
            if (next / lambda - 1.0).abs() < 1e-3 {
                break;
            }
            lambda = next;
        }
        self.solver.strength = Strength::Lambda(lambda);
        self.solver.halo_px = spectrum
            .reach_px(lambda, BEYOND_HALO)
            .clamp(self.solver.window_px, MAX_HALO_PX.max(self.solver.window_px));
        Ok(())
    }

    /// Iterations until the residual is that of the noise, or as many as are given.
    fn find_iterations(&mut self, given: Option<u32>, samples: &[Sample]) -> Result<()> {
        let starts: Vec<Vec<f64>> = samples.iter().map(|s| s.tile.start(&s.film)).collect();
        let parts: Vec<_> =
            samples.iter().zip(&starts).map(|(s, start)| s.tile.part(&s.film, start)).collect();
        let mut iterations = parts.iter().map(Iteration::new).collect::<Result<Vec<_>>>()?;
        let most = given.map_or(MAX_ITERATIONS, |count| count as usize);
        for done in 1..=most {
            for (iteration, part) in iterations.iter_mut().zip(&parts) {
                iteration.step(part)?;
            }
            if given.is_none() || done == most {
                let (mut squares, mut pixels) = (0.0, 0.0);
                for (iteration, sample) in iterations.iter().zip(samples) {
                    squares += sample.square_residual(iteration.chart())?;
                    pixels += sample.measured.size().pixels() as f64;
                }
                self.residual = squares / pixels / (self.noise * self.noise);
            }
            self.solver.strength = Strength::Iterations(done);
            if given.is_none() && self.residual <= 1.0 {
                break;
            }
        }
        Ok(())
    }

    /// Noise gain, resolution and overshoot at a sample.
    fn figures_of(&self, sample: &Sample, peak: f64) -> Result<Figures> {
        let size = sample.tile.film.size();
        let noise: Vec<f64> = unit_noise(size.pixels(), NOISE_SEED);
        let restored_noise = self.difference(sample, &noise, self.noise)?;
        let mean = restored_noise.iter().sum::<f64>() / restored_noise.len() as f64;
        let square = restored_noise.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
        let noise_gain = (square / restored_noise.len() as f64).sqrt() / self.noise * sample.tile.map.gain();
        // A point of the picture in the middle of the core.
        let (y, x) =
            (sample.core.y + sample.core.height as i64 / 2, sample.core.x + sample.core.width as i64 / 2);
        let chart = sample.tile.chart;
        let mut point = vec![0.0f32; chart.size().pixels()];
        point[(y - chart.y) as usize * chart.width + (x - chart.x) as usize] = 1.0;
        let mut film = vec![0.0f32; size.pixels()];
        sample.tile.map.apply(&point, &mut film)?;
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
        let base = |k: usize| if is_linear { 0.0 } else { f64::from(sample.film[k]) };
        let film = |amplitude: f64| -> Vec<f32> {
            pattern.iter().enumerate().map(|(k, v)| (base(k) + amplitude * v) as f32).collect()
        };
        let restore = |film: &[f32]| -> Result<Vec<f64>> {
            let tolerance = FIGURE_TOLERANCE * amplitude;
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
        band: usize,
        (name, core): (&'static str, Rect),
        window_px: usize,
    ) -> Result<Option<Self>> {
        let Some(tile) = Tile::new(optics, band, core, (window_px, window_px))? else { return Ok(None) };
        let pixels = film.read(band, tile.film)?;
        let (spectrum, measured) = (tile.spectrum()?, tile.film_rect(optics, band, core)?);
        Ok(Some(Self { name, core, spectrum, film: pixels, measured, tile }))
    }

    fn restored(&self, strength: Strength, tolerance: f64) -> Result<Restored> {
        self.tile.restored(Some(&self.spectrum), &self.film, strength, tolerance)
    }

    /// Sum of the squares of the residual over the film pixels of the core.
    fn square_residual(&self, chart: &[f64]) -> Result<f64> {
        let start = Vec::new();
        let mean = self.tile.part(&self.film, &start).mean_square_residual(chart, self.measured)?;
        Ok(mean * self.measured.size().pixels() as f64)
    }
}

/// The core of a sample at shares (down, across) of what is left of a picture of `size`.
fn sample_core(size: Size, (down, across): (f64, f64)) -> Rect {
    let (height, width) = (SAMPLE_PX.min(size.height), SAMPLE_PX.min(size.width));
    let at = |free: usize, share: f64| (free as f64 * share).round() as i64;
    Rect::new(at(size.height - height, down), at(size.width - width, across), height, width)
}

/// The largest value of a band, and its noise.
fn survey(film: &Recorded, band: usize) -> Result<(f64, f64)> {
    let size = film.spec().film;
    let mut estimate = NoiseEstimate::default();
    let mut peak = 0.0f64;
    for strip in size.rect().tiles(ROWS, size.width) {
        let pixels = film.read(band, strip)?;
        peak = pixels.iter().fold(peak, |m, v| m.max(f64::from(*v)));
        let count = (NOISE_PIXELS * strip.height).div_ceil(size.height);
        estimate.add(&pixels, strip.width, count);
    }
    Ok((peak, estimate.sigma()))
}

/// Powers of patches of the film, evenly spaced.
fn patches(film: &Recorded, band: usize, spectrum: &LocalSpectrum) -> Result<Vec<PartPower>> {
    let size = film.spec().film;
    let most = spectrum.side_px().min(PATCH_PX);
    let (height, width) = (most.min(size.height), most.min(size.width));
    let along = |n: usize, side: usize| {
        let count = (n / side).clamp(1, PATCHES);
        (0..count).map(move |k| match count {
            1 => (n - side) / 2,
            _ => k * (n - side) / (count - 1),
        })
    };
    let mut all = Vec::new();
    for y in along(size.height, height) {
        for x in along(size.width, width) {
            let pixels = film.read(band, Rect::new(y as i64, x as i64, height, width))?;
            all.push(PartPower::new(spectrum, &pixels, Size::new(height, width)));
        }
    }
    Ok(all)
}
