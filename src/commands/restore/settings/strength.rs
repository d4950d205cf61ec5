//! λ, μ or the number of iterations by the discrepancy principle: the residual of the samples is that of the noise.
//!
//! λ is that of [`pipeline::restore::discrepancy`]: predicted from up to [`PATCHES`]² patches of the film, corrected by the residuals of the samples.

use super::super::recorded::Recorded;
use super::super::tile::Strength;
use super::{Sample, Settings};
use anyhow::{Error, Result};
use pipeline::geometry::{Rect, Size};
use pipeline::restore::discrepancy::{self, CLOSE, PartPower};
use pipeline::restore::local::LocalSpectrum;
use pipeline::restore::richardson_lucy::Iteration;
use pipeline::restore::total_variation;

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
/// Share of the response to a film pixel that lies beyond the halo.
const BEYOND_HALO: f64 = 1e-3;
/// The largest halo, px.
const MAX_HALO_PX: usize = 160;

impl Settings {
    /// λ by the discrepancy principle, and the halo.
    pub(super) fn find_lambda(&mut self, film: &Recorded, samples: &[Sample]) -> Result<f64> {
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
    pub(super) fn find_mu(&mut self, first: f64, samples: &[Sample]) -> Result<()> {
        let starts: Vec<Vec<f64>> = samples.iter().map(|s| s.tile.start(&s.film)).collect();
        let parts: Vec<_> =
            samples.iter().zip(&starts).map(|(s, start)| s.tile.part(&s.film, start)).collect();
        let mut mu = first;
        let begin = |part| total_variation::Iteration::new(part, mu).map_err(Error::from_boxed);
        let mut iterations = parts.iter().map(begin).collect::<Result<Vec<_>>>()?;
        let mut close = 0;
        for done in 1..=MAX_MU_STEPS {
            let steps = iterations.iter_mut().zip(&parts).zip(samples).map(|((iteration, part), sample)| {
                iteration.step(part, &sample.spectrum).map_err(Error::from_boxed)?;
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
    pub(super) fn find_iterations(&mut self, given: Option<u32>, samples: &[Sample]) -> Result<()> {
        let starts: Vec<Vec<f64>> = samples.iter().map(|s| s.tile.start(&s.film)).collect();
        let parts: Vec<_> =
            samples.iter().zip(&starts).map(|(s, start)| s.tile.part(&s.film, start)).collect();
        let begin = |part| Iteration::new(part).map_err(Error::from_boxed);
        let mut iterations = parts.iter().map(begin).collect::<Result<Vec<_>>>()?;
        let most = given.map_or(MAX_ITERATIONS, |count| count as usize);
        for done in 1..=most {
            for (iteration, part) in iterations.iter_mut().zip(&parts) {
                iteration.step(part).map_err(Error::from_boxed)?;
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
