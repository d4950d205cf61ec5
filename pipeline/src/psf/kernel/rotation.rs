//! Rotation of a PSF about the chief ray by its cubic B-spline, in f64: the reference for the SIMD path.

use crate::real;
use crate::spline;

/// Zeros around the coefficients of a PSF: the reach of a spline evaluated beside them.
pub(super) const MARGIN: usize = 4;

/// Samples of a PSF (sum 1) below this are set to 0: the spline's ringing beyond the PSF decays into denormals, which made
/// kernels ten times slower.
pub(in crate::psf) const NEGLIGIBLE_SAMPLE: f32 = 1e-20;

/// Spline coefficients of an n × n PSF, (n + 2·[`MARGIN`])² values with margins of zeros; `lines` and `grid` are overwritten.
pub(super) fn padded_coefficients(
    psf: &[f32],
    n: usize,
    lines: &mut Vec<f64>,
    grid: &mut Vec<f64>,
) -> Vec<f32> {
    let width = n + 2 * MARGIN;
    let mut out = vec![0.0; width * width];
    spline::coefficients_2d(psf, n, lines, grid);
    for (to, from) in out[MARGIN * width..].chunks_exact_mut(width).zip(grid.chunks_exact(n)) {
        for (to, from) in to[MARGIN..MARGIN + n].iter_mut().zip(from) {
            let from = *from as f32;
            *to = if from.abs() < NEGLIGIBLE_SAMPLE { 0.0 } else { from };
        }
    }
    out
}

/// The PSF rotated by `azimuth_rad`: its spline (`coefficients` with margins) at positions rotated by −`azimuth_rad` about the
/// centre, n × n values.
pub(super) fn rotate(coefficients: &[f32], n: usize, azimuth_rad: f64, out: &mut Vec<f64>) {
    let (sin, cos) = real::sin_cos(azimuth_rad);
    let c = (n as f64 - 1.0) / 2.0;
    let width = n + 2 * MARGIN;
    out.clear();
    for row in 0..n {
        let y = row as f64 - c;
        for col in 0..n {
            let x = col as f64 - c;
            let (u, v) = (c + x * cos + y * sin, c - x * sin + y * cos);
            let (iu, iv) = (u.floor(), v.floor());
            let (wu, wv) = (spline::weights(u - iu), spline::weights(v - iv));
            // Positions farther out are clamped to the margin, where all coefficients are 0.
            let first = |i: f64| (i.clamp(-3.0, n as f64 + 1.0) + (MARGIN - 1) as f64) as usize;
            let from = &coefficients[first(iv) * width + first(iu)..];
            let mut sum = 0.0;
            for (line, wy) in from.chunks(width).zip(&wv) {
                for (c, wx) in line.iter().zip(&wu) {
                    sum += wy * wx * f64::from(*c);
                }
            }
            out.push(sum);
        }
    }
}

/// Estimated relative L1 error of one rotation: the PSF rotated by 45° and back, compared with the original, over √2 because
/// two rotations contribute.
pub(super) fn rotation_error(coefficients: &[f32], n: usize) -> f64 {
    let (mut there, mut back, mut original) = (Vec::new(), Vec::new(), Vec::new());
    rotate(coefficients, n, std::f64::consts::FRAC_PI_4, &mut there);
    let there: Vec<f32> = there.iter().map(|&v| v as f32).collect();
    let rotated = padded_coefficients(&there, n, &mut Vec::new(), &mut Vec::new());
    rotate(&rotated, n, -std::f64::consts::FRAC_PI_4, &mut back);
    rotate(coefficients, n, 0.0, &mut original);
    let l1: f64 = original.iter().zip(&back).map(|(a, b)| (a - b).abs()).sum();
    l1 / original.iter().sum::<f64>() / std::f64::consts::SQRT_2
}
