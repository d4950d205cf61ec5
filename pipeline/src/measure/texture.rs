//! Texture MTF by cross-correlation with the chart (after ISO 19567-2; L. Kirk, P. Herzer, U. Artmann, D. Kunz, "Description of texture loss using the
//! dead leaves target: current issues and a new intrinsic approach", Proc. SPIE 9023 (2014)).
//!
//! Tiles of n × n pixels of the picture y and of the chart x at the same place are freed of their means, weighed by a Hann window and transformed; over all tiles and all
//! frequencies of a ring
//! ```text
//! MTF(f) = Σ Re(Y·X*·e^{2πi f·s}) / Σ |X|² / gain,     gain = Σ ȳ / Σ x̄
//! ```
//! s is the displacement (px) of y against x in the tile, less than a pixel, that the phases at low frequencies give; for whole pixels x is cut elsewhere, where the correlation is largest. Noise of the camera has no part
//! in the mean of Y·X*, unlike in |Y|; detail that processing invents has none either. Values must be linear in light and proportional to it; light that is veiled over the chart lowers the curve.

use crate::real;
use rustfft::num_complex::Complex;
use rustfft::{Fft, FftPlanner};
use std::f64::consts::TAU;
use std::sync::Arc;

/// Pixels along the side of a tile.
pub const TILE_PX: usize = 128;
/// Rings per cycle per pixel.
const RINGS: usize = TILE_PX;
/// Frequencies whose phases give a tile's displacement, cycles per pixel.
const PHASES_CY_PX: f64 = 0.12;

/// Least coefficient of correlation of a tile of the picture and of the chart.
const MIN_CORRELATION: f64 = 0.6;

/// A tile that was not added.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TileError {
    /// The picture is displaced by whole pixels (rows, columns): give the chart from as many pixels before.
    Displaced((i64, i64)),
    /// The picture does not show the chart: their correlation is below 0.6 at any displacement.
    Differs,
}

/// Sums over tiles.
pub struct Texture {
    forward: Arc<dyn Fft<f64>>,
    inverse: Arc<dyn Fft<f64>>,
    window: Vec<f64>,
    /// By ring: Re(Y·X*), |X|², |Y|², f·|X|².
    rings: Vec<[f64; 4]>,
    means: (f64, f64),
    tiles: usize,
}

/// Texture MTF.
#[derive(Clone, Debug, PartialEq)]
pub struct TextureMtf {
    /// Mean frequency of the chart's power in each ring, cycles per pixel.
    pub frequency_cy_px: Vec<f64>,
    /// MTF by cross-correlation.
    pub modulation: Vec<f64>,
    /// √(Σ|Y|²/Σ|X|²)/gain: with noise and invented detail.
    pub by_power: Vec<f64>,
}

impl Default for Texture {
    fn default() -> Self {
        let mut planner = FftPlanner::new();
        let hann = |i: usize| 0.5 - 0.5 * real::cos(TAU * (i as f64 + 0.5) / TILE_PX as f64);
        Self {
            forward: planner.plan_fft_forward(TILE_PX),
            inverse: planner.plan_fft_inverse(TILE_PX),
            window: (0..TILE_PX).map(hann).collect(),
            rings: vec![[0.0; 4]; RINGS / 2 + 1],
            means: (0.0, 0.0),
            tiles: 0,
        }
    }
}

impl Texture {
    /// Adds a tile of the chart and of the picture, [`TILE_PX`]² values each.
    ///
    /// # Errors
    /// [`TileError`]: the picture is not of this part of the chart.
    pub fn add(&mut self, chart: &[f32], picture: &[f32]) -> Result<(), TileError> {
        let ((x, x_mean), (y, y_mean)) = (self.spectrum(chart), self.spectrum(picture));
        let cross: Vec<Complex<f64>> = std::iter::zip(&y, &x).map(|(y, x)| y * x.conj()).collect();
        let (whole, peak) = self.whole_shift(&cross);
        let power = |of: &[Complex<f64>]| of.iter().map(Complex::norm_sqr).sum::<f64>();
        let coefficient = peak / (power(&x) * power(&y)).sqrt();
        if coefficient.is_nan() || coefficient < MIN_CORRELATION {
            return Err(TileError::Differs);
        }
        if whole != (0, 0) {
            return Err(TileError::Displaced(whole));
        }
        let shift = fraction_shift(&cross);
        for (k, cross) in cross.iter().enumerate() {
            let (fy, fx) = frequency(k);
            let f = real::hypot(fy, fx);
            let ring = (f * RINGS as f64).round() as usize;
            if let Some(sums) = self.rings.get_mut(ring).filter(|_| ring > 0) {
                let (sin, cos) = real::sin_cos(TAU * (fy * shift.0 + fx * shift.1));
                let aligned = (cross * Complex::new(cos, sin)).re;
                let own = [aligned, x[k].norm_sqr(), y[k].norm_sqr(), f * x[k].norm_sqr()];
                std::iter::zip(sums, own).for_each(|(s, v)| *s += v);
            }
        }
        self.means = (self.means.0 + x_mean, self.means.1 + y_mean);
        self.tiles += 1;
        Ok(())
    }

    /// Tiles that were added.
    pub fn tiles(&self) -> usize {
        self.tiles
    }

    /// The MTF up to `max_cy_px`; `None` without tiles, or where chart or picture are black.
    pub fn mtf(&self, max_cy_px: f64) -> Option<TextureMtf> {
        let gain = self.means.1 / self.means.0;
        let rings = || self.rings.iter().enumerate().skip(1).filter(|(_, s)| s[1] > 0.0);
        let shown = || rings().take_while(|(k, _)| *k as f64 / RINGS as f64 <= max_cy_px + 1e-9);
        (self.tiles > 0 && gain.is_finite() && gain > 0.0).then(|| TextureMtf {
            frequency_cy_px: shown().map(|(_, s)| s[3] / s[1]).collect(),
            modulation: shown().map(|(_, s)| s[0] / s[1] / gain).collect(),
            by_power: shown().map(|(_, s)| (s[2] / s[1]).sqrt() / gain).collect(),
        })
    }

    /// Transform of a tile, and its mean.
    fn spectrum(&self, tile: &[f32]) -> (Vec<Complex<f64>>, f64) {
        assert_eq!(tile.len(), TILE_PX * TILE_PX, "a tile");
        let mean = tile.iter().map(|v| f64::from(*v)).sum::<f64>() / tile.len() as f64;
        let weighed = |(i, v): (usize, &f32)| {
            let weight = self.window[i / TILE_PX] * self.window[i % TILE_PX];
            Complex::new(weight * (f64::from(*v) - mean), 0.0)
        };
        let mut values: Vec<_> = tile.iter().enumerate().map(weighed).collect();
        transform(&mut values, &*self.forward);
        (values, mean)
    }

    /// Place of the maximum of the correlation, and its value, unnormalised as the sum of the products of the spectra.
    fn whole_shift(&self, cross: &[Complex<f64>]) -> ((i64, i64), f64) {
        let mut correlation = cross.to_vec();
        transform(&mut correlation, &*self.inverse);
        let k = (0..correlation.len())
            .max_by(|a, b| correlation[*a].re.total_cmp(&correlation[*b].re))
            .unwrap_or_default();
        let n = TILE_PX as i64;
        let signed = |i: usize| (i as i64 + n / 2) % n - n / 2;
        ((signed(k / TILE_PX), signed(k % TILE_PX)), correlation[k].re)
    }
}

/// Frequency (along rows downwards, along columns) of an element of a transform, cycles per pixel.
fn frequency(k: usize) -> (f64, f64) {
    let of = |i: usize| if i <= TILE_PX / 2 { i as f64 } else { i as f64 - TILE_PX as f64 } / TILE_PX as f64;
    (of(k / TILE_PX), of(k % TILE_PX))
}

/// Rows, then columns.
fn transform(values: &mut [Complex<f64>], fft: &dyn Fft<f64>) {
    for _ in 0..2 {
        fft.process(values);
        for i in 0..TILE_PX {
            for j in 0..i {
                values.swap(i * TILE_PX + j, j * TILE_PX + i);
            }
        }
    }
}

/// The displacement whose phases −2π f·s are those of `cross` at low frequencies, weighed by its magnitude.
fn fraction_shift(cross: &[Complex<f64>]) -> (f64, f64) {
    let (mut yy, mut yx, mut xx, mut y, mut x) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for (k, v) in cross.iter().enumerate() {
        let (fy, fx) = frequency(k);
        if fy.abs().max(fx.abs()) > PHASES_CY_PX {
            continue;
        }
        let (weight, phase) = (v.norm(), real::atan2(v.im, v.re) / -TAU);
        yy += weight * fy * fy;
        yx += weight * fy * fx;
        xx += weight * fx * fx;
        y += weight * fy * phase;
        x += weight * fx * phase;
    }
    let determinant = yy * xx - yx * yx;
    match determinant > 0.0 {
        true => ((y * xx - x * yx) / determinant, (x * yy - y * yx) / determinant),
        false => (0.0, 0.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::random::uniform_of;
    use std::f64::consts::PI;

    /// A periodic texture of power ~ f⁻² by random phases, through a Gaussian of `sigma` and a displacement: sums of waves, so both are exact.
    fn texture(sigma: f64, shift: (f64, f64), side: usize) -> Vec<f32> {
        let waves: Vec<[f64; 4]> = (0..1000u32)
            .map(|k| {
                let u = |i: u32| uniform_of([k, i, 0, 0], 7);
                // Frequencies whose density falls as 1/f.
                let f = 0.01 * (50.0f64).powf(u(0));
                let azimuth = TAU * u(1);
                [f * azimuth.sin(), f * azimuth.cos(), TAU * u(2), 0.002 / f.sqrt()]
            })
            .collect();
        (0..side * side)
            .map(|i| {
                let (y, x) = ((i / side) as f64 - shift.0, (i % side) as f64 - shift.1);
                let wave = |[fy, fx, phase, a]: &[f64; 4]| {
                    let blur = (-2.0 * (PI * sigma).powi(2) * (fy * fy + fx * fx)).exp();
                    a * blur * (TAU * (fy * y + fx * x) + phase).cos()
                };
                (0.5 + waves.iter().map(wave).sum::<f64>()) as f32
            })
            .collect()
    }

    #[test]
    fn gaussian_is_measured_within_5e_3_of_a_displaced_noisy_picture() {
        let side = 3 * TILE_PX / 2;
        let (chart, blurred) = (texture(0.0, (0.0, 0.0), side), texture(0.8, (0.3, -0.4), side));
        let mut measured = Texture::default();
        for (k, corner) in [(0, 0), (0, 64), (64, 0), (64, 64)].into_iter().enumerate() {
            let tile = |from: &[f32], noise: f64| -> Vec<f32> {
                (0..TILE_PX * TILE_PX)
                    .map(|i| {
                        let at = (corner.0 + i / TILE_PX) * side + corner.1 + i % TILE_PX;
                        let u = uniform_of([i as u32, k as u32, 1, 0], 3) - 0.5;
                        2.0 * (from[at] + (noise * u) as f32)
                    })
                    .collect()
            };
            measured.add(&tile(&chart, 0.0), &tile(&blurred, 3e-4)).unwrap();
        }
        let mtf = measured.mtf(0.5).unwrap();
        // A window spreads each of the few waves over two rings: means of five.
        let error = |(f, m): (&f64, &f64)| m - (-2.0 * (PI * 0.8 * f).powi(2)).exp();
        let errors: Vec<f64> =
            std::iter::zip(&mtf.frequency_cy_px, &mtf.modulation).map(error).skip(3).collect();
        for (k, five) in errors.windows(5).enumerate() {
            let mean = five.iter().sum::<f64>() / 5.0;
            assert!(mean.abs() < 5e-3, "from ring {k}: {mean}");
        }
        assert!(mtf.by_power.last() > mtf.modulation.last(), "noise has power");
    }

    #[test]
    fn another_place_of_the_chart_is_an_error_and_no_tiles_are_no_curve() {
        let chart = texture(0.0, (0.0, 0.0), TILE_PX);
        let moved = texture(0.5, (-3.1, 20.2), TILE_PX);
        assert_eq!(Texture::default().add(&chart, &moved), Err(TileError::Displaced((-3, 20))));
        let noise: Vec<f32> = (0..chart.len() as u32).map(|k| uniform_of([k, 5, 0, 0], 1) as f32).collect();
        assert_eq!(Texture::default().add(&chart, &noise), Err(TileError::Differs));
        assert_eq!(Texture::default().mtf(0.5), None);
    }
}
