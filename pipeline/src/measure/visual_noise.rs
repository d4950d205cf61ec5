//! Visual noise of a uniform patch: what an observer sees of its noise (after ISO 15739, annex B; D. Wueller, U. Artmann and J. Kleinmann, "Investigation of two methods to
//! quantify noise in digital images based on the perception of the human eye", Proc. SPIE 6494 (2007); read in these secondary sources).
//!
//! Pixels in linear sRGB become XYZ and opponent colours, each of which is weighed in spatial frequency by the contrast sensitivity of the eye, and back:
//! ```text
//! A = Y,  C₁ = X − Y,  C₂ = 0.4 (Y − Z)                                         (XYZ over those of the white)
//! S_A(f)  = f^0.8 e^(−0.2 f), 1 at and below its maximum of 4 cycles per degree, which it is divided by
//! S_C1(f) = 109.1413 e^(−0.00038 f^3.4244) + 93.5971 e^(−0.00367 f^2.1677)      (over 202.7384)
//! S_C2(f) = 7.0328 e^(−0.000004 f^4.2582) + 40.6910 e^(−0.10391 f^1.6487)       (over 47.7238)
//! ```
//! (G. M. Johnson and M. D. Fairchild, "A top down description of S-CIELAB and CIEDE2000", Color Research and Application 28 (2003)), f in cycles per degree at the viewing condition. Standard deviations of CIE 1976 L*, u*, v* of the result give
//! ```text
//! VN = σ_L* + 0.852 σ_u* + 0.323 σ_v*
//! ```
//! The patch is periodic in the transform; a plane is not removed, so patches should be uniform. The standard's luminance filter of low frequencies differs between its editions: here it passes them.

use crate::colour::{Illuminant, linear_srgb_to_xyz};
use crate::real;
use rustfft::FftPlanner;
use rustfft::num_complex::Complex;

/// Weights of L*, u*, v*.
const WEIGHTS: [f64; 3] = [1.0, 0.852, 0.323];
/// Frequency of the greatest sensitivity to luminance, cycles per degree.
const PEAK_CPD: f64 = 4.0;

/// Visual noise and its parts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VisualNoise {
    /// VN.
    pub value: f64,
    /// σ of L*, u*, v*.
    pub luv: [f64; 3],
}

/// Visual noise of `pixels` in linear sRGB, white being 1, rows of `width`, seen with `pixels_per_degree`. `None` of fewer than 16 × 16 pixels, or dark ones.
pub fn visual_noise(pixels: &[[f64; 3]], width: usize, pixels_per_degree: f64) -> Option<VisualNoise> {
    let height = pixels.len().checked_div(width)?;
    if width < 16 || height < 16 {
        return None;
    }
    let white = Illuminant::D65.white().map(|v| v / Illuminant::D65.white()[1]);
    let opponents = |rgb: &[f64; 3]| {
        let xyz = linear_srgb_to_xyz(*rgb);
        let y = Illuminant::D65.white()[1];
        let [x, y, z] = [0, 1, 2].map(|i| xyz[i] / y / white[i]);
        [y, x - y, 0.4 * (y - z)]
    };
    let all: Vec<[f64; 3]> = pixels.iter().map(opponents).collect();
    let filtered = [0, 1, 2].map(|c| {
        let plane: Vec<f64> = all.iter().map(|v| v[c]).collect();
        weighed(&plane, width, |f| sensitivity(c, f * pixels_per_degree))
    });
    let luv: Vec<[f64; 3]> = (0..pixels.len())
        .map(|i| {
            let y = filtered[0][i];
            let (x, z) = (y + filtered[1][i], y - filtered[2][i] / 0.4);
            luv([x * white[0], y, z * white[2]], white)
        })
        .collect();
    let n = luv.len() as f64;
    let sigma = |c: usize| {
        let mean = luv.iter().map(|v| v[c]).sum::<f64>() / n;
        (luv.iter().map(|v| (v[c] - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt()
    };
    let luv = [0, 1, 2].map(sigma);
    let value: f64 = std::iter::zip(WEIGHTS, luv).map(|(w, s)| w * s).sum();
    value.is_finite().then_some(VisualNoise { value, luv })
}

/// Sensitivity to the opponent colour `c` at `f` cycles per degree.
fn sensitivity(c: usize, f: f64) -> f64 {
    let sum = |terms: [[f64; 3]; 2]| {
        let of = |[a, b, p]: [f64; 3]| a * real::exp(-b * real::pow(f, p));
        terms.map(of).iter().sum::<f64>() / terms.map(|t| t[0]).iter().sum::<f64>()
    };
    match c {
        0 if f <= PEAK_CPD => 1.0,
        0 => real::pow(f / PEAK_CPD, 0.8) * real::exp(-0.2 * (f - PEAK_CPD)),
        1 => sum([[109.1413, 0.00038, 3.4244], [93.5971, 0.00367, 2.1677]]),
        _ => sum([[7.0328, 0.000004, 4.2582], [40.6910, 0.10391, 1.6487]]),
    }
}

/// CIE 1976 L*, u*, v* of a colour under `white` (Y = 1).
fn luv([x, y, z]: [f64; 3], white: [f64; 3]) -> [f64; 3] {
    let uv = |[x, y, z]: [f64; 3]| {
        let sum = x + 15.0 * y + 3.0 * z;
        if sum > 0.0 { (4.0 * x / sum, 9.0 * y / sum) } else { (0.0, 0.0) }
    };
    let lightness =
        if y > (6.0f64 / 29.0).powi(3) { 116.0 * real::cbrt(y) - 16.0 } else { (29.0f64 / 3.0).powi(3) * y };
    let ((u, v), (un, vn)) = (uv([x, y, z]), uv(white));
    [lightness, 13.0 * lightness * (u - un), 13.0 * lightness * (v - vn)]
}

/// A plane whose waves are multiplied by `weight` of their frequency in cycles per pixel.
fn weighed(plane: &[f64], width: usize, weight: impl Fn(f64) -> f64) -> Vec<f64> {
    let height = plane.len() / width;
    let mut planner = FftPlanner::new();
    let mut values: Vec<Complex<f64>> = plane.iter().map(|v| Complex::new(*v, 0.0)).collect();
    let mut both_ways = |values: Vec<Complex<f64>>, forward: bool| {
        let mut plan = |n| if forward { planner.plan_fft_forward(n) } else { planner.plan_fft_inverse(n) };
        let (rows, columns) = (plan(width), plan(height));
        let mut values = values;
        rows.process(&mut values);
        let mut turned: Vec<Complex<f64>> =
            (0..width * height).map(|i| values[i % height * width + i / height]).collect();
        columns.process(&mut turned);
        (0..width * height).map(|i| turned[i % width * height + i / width]).collect::<Vec<_>>()
    };
    values = both_ways(values, true);
    let along = |i: usize, n: usize| if 2 * i <= n { i as f64 } else { i as f64 - n as f64 } / n as f64;
    for (i, v) in values.iter_mut().enumerate() {
        *v *= weight(real::hypot(along(i / width, height), along(i % width, width)));
    }
    both_ways(values, false).iter().map(|v| v.re / (width * height) as f64).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wave of one frequency in grey: σ of L* is that of the wave, times the sensitivity.
    #[test]
    fn a_grey_wave_has_the_noise_of_its_sensitivity() {
        let (width, height, ppd) = (64, 48, 40.0);
        for cycles in [2.0f64, 8.0, 16.0, 24.0] {
            let (mean, amplitude) = (0.3, 1e-4);
            let wave = |i: usize| {
                let phase = std::f64::consts::TAU * cycles * (i % width) as f64 / width as f64;
                [mean + amplitude * phase.cos(); 3]
            };
            let pixels: Vec<[f64; 3]> = (0..width * height).map(wave).collect();
            let noise = visual_noise(&pixels, width, ppd).unwrap();
            let f = cycles / width as f64 * ppd;
            let s = if f <= 4.0 { 1.0 } else { (f / 4.0).powf(0.8) * (-0.2 * (f - 4.0)).exp() };
            let expected = 116.0 / 3.0 * mean.powf(-2.0 / 3.0) * amplitude * s / 2f64.sqrt();
            assert!(
                (noise.luv[0] / expected - 1.0).abs() < 2e-3,
                "{cycles}: {} for {expected}",
                noise.luv[0]
            );
            assert!(noise.luv[1].max(noise.luv[2]) < 1e-2 * noise.luv[0], "grey has no colour: {noise:?}");
            assert!((noise.value - noise.luv[0] - 0.852 * noise.luv[1] - 0.323 * noise.luv[2]).abs() < 1e-15);
        }
    }

    #[test]
    fn small_and_black_patches_have_no_figure_and_uniform_ones_no_noise() {
        assert_eq!(visual_noise(&[[0.5; 3]; 100], 10, 40.0), None);
        assert!(visual_noise(&[[0.5; 3]; 400], 20, 40.0).unwrap().value < 1e-9);
        assert_eq!(visual_noise(&[[0.0; 3]; 400], 20, 40.0).unwrap().value, 0.0);
    }
}
