//! What is decided once a band, and measured: the noise, λ or the number of iterations, the halo, and the figures of the report.
//!
//! Parts of the film, *samples*, are restored as tiles are: at its centre, near its lower right corner, and half-way to the upper left one. λ is that of
//! [`pipeline::restore::discrepancy`]: predicted from up to [`PATCHES`]² patches of the film, corrected by the residuals of the samples.

use super::optics::Optics;
use super::planes::Pixels;
use super::recorded::Recorded;
use super::tile::{Solver, Strength, Tile};
use crate::args::{RestoreArgs, RestoreMethod};
use crate::failure::usage;
use anyhow::Result;
use pipeline::geometry::{Rect, Size};
use pipeline::restore::discrepancy::{self, CLOSE, PartPower};
use pipeline::restore::local::LocalSpectrum;
use pipeline::restore::noise::unit_noise;
use pipeline::restore::response::Response;
use pipeline::restore::richardson_lucy::Iteration;
use pipeline::restore::total_variation;
use pipeline::restore::{Operator, Restored};

/// Side of a sample, px.
const SAMPLE_PX: usize = 96;
/// Patches along each side of the film from which λ is predicted, and their side.
const PATCHES: usize = 4;
const PATCH_PX: usize = 256;
/// Corrections of λ by the residuals of the samples, at most.
const CORRECTIONS: usize = 3;
/// Further values of λ that are tried on the samples of a raw, at most.
const TRIALS: usize = 8;
/// Steps that find μ, at most; steps between two changes of μ, and their power of the residual; how close the residual comes, for how many steps.
const MAX_MU_STEPS: usize = 150;
const MU_STEPS: usize = 3;
const MU_POWER: f64 = 1.5;
const MU_CLOSE: f64 = 0.03;
const MU_STILL: usize = 8;
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

    /// λ by the discrepancy principle, and the halo.
    fn find_lambda(&mut self, film: &Recorded, samples: &[Sample]) -> Result<f64> {
        let spectrum = &samples[0].spectrum;
        let patches = patches(film, (self.solver.plane, self.solver.noise), spectrum)?;
        let first = discrepancy::lambda(&patches, self.solver.noise * self.solver.noise);
        let lambda = match film.raw() {
            None => self.lambda_of_patches(first, &patches, samples)?,
            Some(_) => self.lambda_of_samples(first, samples)?,
        };
        self.solver.strength = Strength::Lambda(lambda);
        self.solver.halo_px = spectrum
            .reach_px(lambda, BEYOND_HALO)
            .clamp(self.solver.window_px, MAX_HALO_PX.max(self.solver.window_px));
        Ok(lambda)
    }

    /// Mean square residual of the samples restored with `lambda`, of the square of the noise.
    fn residual_of_samples(&self, lambda: f64, samples: &[Sample]) -> Result<f64> {
        let of = |sample: &Sample| {
            let restored = sample.restored(Strength::Lambda(lambda), 1e2 * self.solver.tolerance)?;
            sample.square_residual(&restored.chart)
        };
        self.mean_square(samples.iter().map(of))
    }

    /// Mean of the squares of residuals, of the square of the noise, of (sum, number) of each sample.
    fn mean_square(&self, of_samples: impl Iterator<Item = Result<(f64, usize)>>) -> Result<f64> {
        let (mut squares, mut pixels) = (0.0, 0.0);
        for of_sample in of_samples {
            let (sum, measured) = of_sample?;
            squares += sum;
            pixels += measured as f64;
        }
        Ok(squares / pixels / (self.solver.noise * self.solver.noise))
    }

    /// λ of the patches, with the ratio of what is measured of the samples to what is predicted of them.
    fn lambda_of_patches(&mut self, first: f64, patches: &[PartPower], samples: &[Sample]) -> Result<f64> {
        let aim = self.solver.noise * self.solver.noise;
        let of_sample = |sample: &Sample| {
            let Rect { y, x, height, width } = sample.measured;
            let row = |k: usize| {
                &sample.film.values[(y as usize + k) * sample.tile.film.width + x as usize..][..width]
            };
            let part: Vec<f32> = (0..height).flat_map(row).copied().collect();
            PartPower::new(&sample.spectrum, &part, Size::new(height, width))
        };
        let of_samples: Vec<PartPower> = samples.iter().map(of_sample).collect();
        let mean = |parts: &[PartPower], lambda: f64| {
            parts.iter().map(|part| part.residual(lambda)).sum::<f64>() / parts.len() as f64
        };
        let mut lambda = first;
        for correction in 0..=CORRECTIONS {
            let measured = aim * self.residual_of_samples(lambda, samples)?;
            let ratio = measured / mean(&of_samples, lambda);
            let predicted = ratio * mean(patches, lambda);
            self.residual = predicted / aim;
            if (self.residual - 1.0).abs() < CLOSE || correction == CORRECTIONS {
                break;
            }
            let next = discrepancy::lambda(patches, aim / ratio);
            if (next / lambda - 1.0).abs() < 1e-3 {
                break;
            }
            lambda = next;
        }
        Ok(lambda)
    }

    /// λ of the samples alone: the pixels of a raw have weights, which a spectrum does not contain.
    fn lambda_of_samples(&mut self, first: f64, samples: &[Sample]) -> Result<f64> {
        let (mut lambda, mut measured) = (first, Vec::new());
        for trial in 0..=TRIALS {
            self.residual = self.residual_of_samples(lambda, samples)?;
            measured.push((lambda, self.residual));
            if (self.residual - 1.0).abs() < CLOSE || trial == TRIALS {
                break;
            }
            lambda = discrepancy::next(&measured);
        }
        Ok(lambda)
    }

    /// μ by the discrepancy principle, from `first`: changed every few steps until the residual of the samples is that of the noise.
    fn find_mu(&mut self, first: f64, samples: &[Sample]) -> Result<()> {
        let starts: Vec<Vec<f64>> = samples.iter().map(|s| s.tile.start(&s.film)).collect();
        let parts: Vec<_> =
            samples.iter().zip(&starts).map(|(s, start)| s.tile.part(&s.film, start)).collect();
        let mut mu = first;
        let mut iterations =
            parts.iter().map(|part| total_variation::Iteration::new(part, mu)).collect::<Result<Vec<_>>>()?;
        let mut close = 0;
        for done in 1..=MAX_MU_STEPS {
            let steps = iterations.iter_mut().zip(&parts).zip(samples).map(|((iteration, part), sample)| {
                iteration.step(part, &sample.spectrum)?;
                Ok(iteration.square_residual(part, sample.measured))
            });
            self.residual = self.mean_square(steps)?;
            close = if (self.residual - 1.0).abs() < MU_CLOSE { close + 1 } else { 0 };
            if close == MU_STILL {
                break;
            }
            if done % MU_STEPS == 0 && (self.residual - 1.0).abs() > 0.5 * MU_CLOSE {
                mu *= self.residual.powf(-MU_POWER).clamp(0.5, 2.0);
                iterations.iter_mut().for_each(|iteration| iteration.set_mu(mu));
            }
        }
        self.solver.strength = Strength::Mu(mu);
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
                let of =
                    |(iteration, sample): (&Iteration, &Sample)| sample.square_residual(iteration.chart());
                self.residual = self.mean_square(iterations.iter().zip(samples).map(of))?;
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
        let base = |k: usize| if is_linear { 0.0 } else { f64::from(sample.film.values[k]) };
        let film = |amplitude: f64| -> Pixels {
            let values = pattern.iter().enumerate().map(|(k, v)| (base(k) + amplitude * v) as f32).collect();
            Pixels { values, weights: sample.film.weights.clone() }
        };
        let restore = |film: &Pixels| -> Result<Vec<f64>> {
            // Of two restorations that are not linear the difference is far more exact than each.
            let tolerance =
                if is_linear { FIGURE_TOLERANCE * amplitude } else { 100.0 * self.solver.tolerance };
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
        self.tile.part(&self.film, &start).square_residual(chart, self.measured)
    }
}

/// The core of a sample at shares (down, across) of what is left of a picture of `size`.
fn sample_core(size: Size, (down, across): (f64, f64)) -> Rect {
    let (height, width) = (SAMPLE_PX.min(size.height), SAMPLE_PX.min(size.width));
    let at = |free: usize, share: f64| (free as f64 * share).round() as i64;
    Rect::new(at(size.height - height, down), at(size.width - width, across), height, width)
}

/// Powers of patches of the film, evenly spaced.
fn patches(
    film: &Recorded,
    (plane, noise): (usize, f64),
    spectrum: &LocalSpectrum,
) -> Result<Vec<PartPower>> {
    let size = film.grid().size;
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
            let pixels = film.read(plane, Rect::new(y as i64, x as i64, height, width), noise)?;
            all.push(PartPower::new(spectrum, &pixels.values, Size::new(height, width)));
        }
    }
    Ok(all)
}
