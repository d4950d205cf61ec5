//! Tails of a band whose rays land beyond its PSF windows, or near their border: there the light is geometric, no power law.
//!
//! The power laws begin where no rays land, at R = 1.3 times the largest distance of an edge ray, with c_00 = C alone: beyond R harmonics of the azimuth have little light. The middle
//! part ([`crate::lens::middle`]) is
//!
//! ```text
//! (1 − τ) (p − T)                   p: the Huygens sum of the PSF, up to R or to the largest number of samples
//! e (C/r³ − T) + s I_rays           beyond
//! ```
//! C/r³ is the mean light that the edge of the pupil diffracts, I_rays the density of rays on the film. e = 1 and s ≤ 1 the factor with which the light of all is 1; where s = 1 is too
//! little, e is above 1, up to 1.5. What then is missing, below 1e-3, is in the core. Rays are poor near their caustics, whose light waves have farther inside.
//! The samples of the Huygens sum are up to 1.8 times as far apart as those of the PSFs: what they alias then, the light at frequencies near the limit of diffraction, comes to lie at
//! frequencies that the sums over samples of the middle part hardly have. Where samples of the middle part are wide, the sum is that of light of twice the wavelength
//! with the same paths, which takes a quarter of the points: what rays do is the same, and its C, with which T is subtracted, twice as large.
//! Images are widened by weights of ¼, ½, ¼ along both axes, so that the spline between samples and the bins have no ringing at the border of the blur.
//!
//! A ray has the light of its cell of the pupil, which lands on a parallelogram: by derivatives of the landing place by the pupil coordinates.

use rayon::prelude::*;

use super::tails::{COARSER, NoTail, blur_um, power_laws};
use super::{PsfGrid, PsfScratch};
use crate::design::prescription::error::DesignError;
use crate::design::pupil::bundle::Bundle;
use crate::design::pupil::edge::Edge;
use crate::design::pupil::pupils::Pupils;
use crate::design::rays::ray::{ImageRay, Tracer};
use crate::lens::middle::{Middle, WHOLE, core_share};
use crate::lens::tail::{BandTail, Coefficients, ORDERS, TERMS, light, radial};

/// Samples a side of the middle part.
const SAMPLES: usize = 129;
/// R over the largest distance of an edge ray.
const RADIUS: f64 = 1.3;
/// Half windows that R may be.
const LARGEST: f64 = 8.0;
/// Samples of the PSFs up to which the Huygens sum reaches to either side, at most.
const MAX_HALF: usize = 900;
/// Samples of the Huygens sum along a sample of the middle part, at least: with 3.3 half planes through a caustic had errors of 7e-3 of white.
const LEAST_PLACES: f64 = 6.0;
/// Wavelength of the light of the Huygens sum over that of the band, and the sample of the middle part over the Nyquist pitch from which on it is not 1: what the
/// longer waves blur more is then well below such a sample.
const LONGER: f64 = 2.0;
const LONGER_STEP: f64 = 9.0;
/// Rays of a height, along and around the pupil.
const RAYS: (usize, usize) = (24, 40);
/// Factor of the edge's light at most.
const MAX_EDGE: f64 = 1.5;
/// Places on the parallelogram of a ray along each side, at most.
const MAX_PLACES: f64 = 48.0;

/// The tails at `heights` (those that `pupils` were made with, which have `edges`) of PSFs in windows of `window` samples of `pitch_um`: power laws, and a middle part where rays land
/// beyond the windows.
///
/// # Errors
/// A ray that does not reach the image.
pub(in crate::design) fn band_tail(
    tracer: &Tracer<'_>,
    pupils: &Pupils<'_>,
    places: (&[f64], &[Edge]),
    window: (usize, f64),
) -> Result<Result<BandTail, NoTail>, DesignError> {
    match power_laws(pupils, places, window) {
        Ok(tail) => Ok(Ok(tail)),
        Err(_) => tail_with_middle(tracer, pupils, places, window, MAX_HALF),
    }
}

/// The tails, with a middle part, at `heights` (those that `pupils` were made with, which have `edges`) of PSFs in windows of `window` samples of `pitch_um`, by Huygens sums of up
/// to `max_half` samples to either side, or those of the window.
///
/// # Errors
/// A ray that does not reach the image.
fn tail_with_middle(
    tracer: &Tracer<'_>,
    pupils: &Pupils<'_>,
    (heights, edges): (&[f64], &[Edge]),
    (window, pitch_um): (usize, f64),
    max_half: usize,
) -> Result<Result<BandTail, NoTail>, DesignError> {
    let half_um = 0.5 * window as f64 * pitch_um;
    let radius_um = RADIUS * blur_um(edges);
    let none = NoTail { blur_um: blur_um(edges), half_um };
    if radius_um > LARGEST * half_um {
        return Ok(Err(none));
    }
    let half = ((radius_um / pitch_um).ceil() as usize).min(max_half).max(window / 2);
    let step_um = 2.0 * radius_um / SAMPLES as f64;
    let nyquist_um = heights.iter().map(|h| pupils.at(*h).nyquist_um()).fold(f64::INFINITY, f64::min);
    let longer = if step_um >= LONGER_STEP * nyquist_um { LONGER } else { 1.0 };
    let coarser = (step_um / (LEAST_PLACES * pitch_um)).clamp(1.0, longer * COARSER);
    let half = (half as f64 / coarser).ceil() as usize;
    let grid = PsfGrid::for_comparison(half, coarser * pitch_um, longer);
    let at_height = |(h, edge): (&f64, &Edge)| {
        let mut psf = Vec::new();
        grid.psf_into(pupils.at(*h), 0.0, &mut PsfScratch::default(), &mut psf);
        let mut c: Coefficients = [[0.0; TERMS]; ORDERS];
        c[0][0] = 1e-3 * edge.tail_um;
        let part = Part {
            c,
            window_mm: 1e-3 * half_um,
            half_mm: 0.5e-3 * grid.size() as f64 * pitch_um,
            radius_mm: 1e-3 * radius_um,
            longer,
        };
        let bundle = match part.half_mm < part.radius_mm {
            true => Some(Bundle::trace(tracer, tracer.field_of_height(*h)?, RAYS.0, RAYS.1)?),
            false => None,
        };
        Ok((c, part.image(&psf, &grid, bundle.as_ref())))
    };
    let found: Vec<(Coefficients, Vec<f32>)> =
        heights.par_iter().zip(edges).map(at_height).collect::<Result<_, DesignError>>()?;
    let (coefficients, images): (Vec<_>, Vec<_>) = found.into_iter().unzip();
    let middle = Middle { size: SAMPLES, pitch_mm: 1e-3 * step_um, samples: images.concat().into() };
    let (inner_mm, height_mm) = (1e-3 * radius_um, heights.to_vec());
    Ok(Ok(BandTail { inner_mm, height_mm, coefficients, middle: Some(middle) }))
}

/// What the middle part of a height follows from.
struct Part {
    /// Of T.
    c: Coefficients,
    /// Half a side of the window, and of the Huygens sum.
    window_mm: f64,
    half_mm: f64,
    /// R.
    radius_mm: f64,
    /// Wavelength of the light of the Huygens sum over that of the band, and so its C over that of T.
    longer: f64,
}

impl Part {
    /// The middle part of `psf`, shares of all light on the samples of `grid`, with the rays of `bundle` beyond it, if they are needed.
    fn image(&self, psf: &[f32], grid: &PsfGrid, bundle: Option<&Bundle>) -> Vec<f32> {
        let step = 2.0 * self.radius_mm / SAMPLES as f64;
        let mut image = vec![0.0; SAMPLES * SAMPLES];
        // All that is left for the light beyond.
        let of_tail = light(&self.c, self.radius_mm);
        let beyond = 1.0 - self.add_psf(psf, grid, step, &mut image) - self.longer * of_tail;
        // Longer waves leave that much less within R.
        let scale = (1.0 - of_tail) / (1.0 - self.longer * of_tail);
        let Some(bundle) = bundle else { return widened(&image, scale) };
        let (mut rays, mut all) = (vec![0.0; SAMPLES * SAMPLES], 0.0);
        for (weight, ray) in &bundle.rays {
            all += 2.0 * weight * ray.flux / ray.n;
            self.land(ray, &bundle.chief, *weight, step, &mut rays);
        }
        let place = |i: usize| (i as f64 - (SAMPLES / 2) as f64) * step;
        let edge = |at: usize| {
            let (x, y) = (place(at % SAMPLES), place(at / SAMPLES));
            let r = (x * x + y * y).sqrt();
            match x.abs().max(y.abs()) >= self.half_mm {
                true => self.c[0][0] * (1.0 / (r * r * r) - radial(r, self.radius_mm, 0, 0)) * step * step,
                false => 0.0,
            }
        };
        let edge: Vec<f64> = (0..rays.len()).map(edge).collect();
        let of_edge = self.longer * edge.iter().sum::<f64>();
        let of_rays = rays.iter().sum::<f64>() / all;
        // Shares of parts without light are 0.
        let share = |light: f64, of: f64| if of > 0.0 { (light / of).max(0.0) } else { 0.0 };
        let s = share(beyond - of_edge, of_rays).min(1.0);
        let e = share(beyond - s * of_rays, of_edge).min(MAX_EDGE);
        for (to, (edge, rays)) in image.iter_mut().zip(edge.iter().zip(&rays)) {
            *to += e * edge + s / all * rays;
        }
        widened(&image, scale)
    }

    /// Adds (1 − τ) (p − T) of the samples up to R; Σ (p − T). Both are symmetric about the meridian: samples of the lower half are added with those of the upper, to both.
    fn add_psf(&self, psf: &[f32], grid: &PsfGrid, step: f64, image: &mut [f64]) -> f64 {
        let (n, pitch) = (grid.size(), 1e-3 * grid.pitch_um());
        let centre = n / 2;
        let place = |i: usize| (i as f64 - centre as f64) * pitch;
        // T below R, a parabola of r: from the values at 0 and at R.
        let [axis, rim] = [0.0, self.radius_mm].map(|r| self.c[0][0] * radial(r, self.radius_mm, 0, 0));
        let radius_squared = self.radius_mm.powi(2);
        let area = self.longer * pitch * pitch;
        let (axis, slope) = (axis * area, (axis - rim) * area / radius_squared);
        let tail = |r_squared: f64| match r_squared < radius_squared {
            true => axis - slope * r_squared,
            false => self.c[0][0] * area / (r_squared * r_squared.sqrt()),
        };
        // The core has all light up to there.
        let of_core = (WHOLE * self.window_mm).powi(2);
        let mut half = vec![0.0; SAMPLES * SAMPLES];
        let mut sum = 0.0;
        for row in centre..n {
            // Half of the light of the two rows, of which the middle one is its own mirror image.
            let share_of_row = if row == centre { 0.25 } else { 0.5 };
            let (above, below) = (&psf[row * n..][..n], &psf[(n - 1 - row) * n..][..n]);
            let y = place(row);
            for (column, (a, b)) in above.iter().zip(below).enumerate() {
                let x = place(column);
                let r_squared = x * x + y * y;
                let rest = share_of_row * (f64::from(*a) + f64::from(*b) - 2.0 * tail(r_squared));
                sum += 2.0 * rest;
                if r_squared <= of_core || r_squared >= radius_squared {
                    continue;
                }
                let share = 1.0 - core_share(r_squared.sqrt(), self.window_mm);
                if share > 0.0 {
                    add(x / step, y / step, share * rest, &mut half);
                }
            }
        }
        for (row, to) in image.chunks_exact_mut(SAMPLES).enumerate() {
            let rows = [row, SAMPLES - 1 - row].map(|row| &half[row * SAMPLES..][..SAMPLES]);
            for (to, (a, b)) in to.iter_mut().zip(rows[0].iter().zip(rows[1])) {
                *to += a + b;
            }
        }
        sum
    }

    /// Adds the light of `ray`, and of its mirror image in the lower half of the pupil, to the squares of `step` mm beyond the Huygens sum that its cell of the pupil, of the area `weight`,
    /// lands on.
    fn land(&self, ray: &ImageRay, chief: &ImageRay, weight: f64, step: f64, sums: &mut [f64]) {
        let side = weight.abs().sqrt();
        let (x, y) = (ray.x.v - chief.x.v, ray.y.v);
        let [by_p, by_q] = [0, 1].map(|k| (side * ray.x.d[k], side * ray.y.d[k]));
        let places = |(dx, dy): (f64, f64)| {
            (2.0 * dx.abs().max(dy.abs()) / step).ceil().clamp(1.0, MAX_PLACES) as usize
        };
        let (along, across) = (places(by_p), places(by_q));
        let light = weight * ray.flux / ray.n / (along * across) as f64;
        let share = |i: usize, n: usize| (i as f64 + 0.5) / n as f64 - 0.5;
        for i in 0..along {
            for j in 0..across {
                let (s, t) = (share(i, along), share(j, across));
                let (x, y) = (x + s * by_p.0 + t * by_q.0, y + s * by_p.1 + t * by_q.1);
                if x.abs().max(y.abs()) >= self.half_mm {
                    add(x / step, y / step, light, sums);
                    add(x / step, -y / step, light, sums);
                }
            }
        }
    }
}

/// `image` times `scale` with weights of ¼, ½, ¼ along both axes.
fn widened(image: &[f64], scale: f64) -> Vec<f32> {
    let at = |row: usize, column: usize| match row < SAMPLES && column < SAMPLES {
        true => image[row * SAMPLES + column],
        false => 0.0,
    };
    // Beyond 0 is the largest number.
    let around = |i: usize| [(i.wrapping_sub(1), 0.25), (i, 0.5), (i + 1, 0.25)];
    let value = |i: usize| -> f64 {
        let (rows, columns) = (around(i / SAMPLES), around(i % SAMPLES));
        rows.iter()
            .flat_map(|(row, v)| columns.iter().map(move |(column, u)| v * u * at(*row, *column)))
            .sum()
    };
    (0..image.len()).map(|i| (scale * value(i)) as f32).collect()
}

/// Adds `light` to the four samples about (x, y), in samples from the centre; none beyond the border.
fn add(x: f64, y: f64, light: f64, sums: &mut [f64]) {
    let half = (SAMPLES / 2) as f64;
    let (x, y) = (x + half, y + half);
    let last = (SAMPLES - 1) as f64;
    if !((0.0..last).contains(&x) && (0.0..last).contains(&y)) {
        return;
    }
    let (column, row) = (x as usize, y as usize);
    let (s, t) = (x - column as f64, y - row as f64);
    let at = row * SAMPLES + column;
    for (to, share) in [
        (at, (1.0 - s) * (1.0 - t)),
        (at + 1, s * (1.0 - t)),
        (at + SAMPLES, (1.0 - s) * t),
        (at + SAMPLES + 1, s * t),
    ] {
        sums[to] += light * share;
    }
}

#[cfg(test)]
mod tests;
