//! Spectral upsampling: reflectances for linear sRGB colours.
//!
//!   ρ(λ) = R·ρ_R(λ) + G·ρ_G(λ) + B·ρ_B(λ),   ρ_R + ρ_G + ρ_B = 1,   ρ_R, ρ_G, ρ_B ≥ 0
//! Every colour of the sRGB cube is then a mixture of three reflectances, so 0 ≤ ρ ≤ 1, greys are grey at every wavelength, and
//! mixing or blurring colours is mixing or blurring spectra (Mallett, Yuksel, "Spectral Primary Decomposition for Rendering with
//! sRGB Reflectance", EGSR 2019, sections 3-4). The three are the smoothest (minimum Σ (Δρ)²/Δλ) that in the given bands under
//! the given illuminant map to pure red, green and blue by [`colour::srgb_weights`], the weights of the preview, so that the preview of
//! a chart reproduces the colours. They solve a quadratic programme with bounds by operator splitting (Stellato et al., "OSQP", Math. Prog.
//! Comp. 12, 2020, algorithm 1), to 1e-6 of white. All corners of the cube are met for D65, A and E with bands every 20 nm or closer
//! over 400 to 700 nm. Bands that cannot represent a corner are an error that contains the deviation, unless it is admitted: then the colours are the
//! nearest (least squares over linear red, green and blue) with the same bounds, and greys are still exact.
//! Not modelled: gamuts beyond sRGB, in which the three cannot stay non-negative; fluorescence.

use crate::colour::{self, Illuminant};
use crate::wavelengths;

/// Maximum number of bands: the time grows with its cube.
pub const MAX_BANDS: usize = 512;
/// Error of a channel relative to white that is no error: below 1/255 of the encoded value in the linear part of sRGB (slope 12.92).
pub const EXACT: f64 = 1e-4;
const ITERATIONS: usize = 20_000;
/// Step sizes (ρ of OSQP): for bounds, and for the colours, which are equalities.
const RHO: f64 = 1.0;
const RHO_COLOUR: f64 = 1000.0;
const CONVERGED: f64 = 1e-7;

/// Bands that cannot represent the colours.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReflectanceError {
    /// Number of bands out of range.
    #[error("{found} bands; expected 1 to {MAX_BANDS} for spectra of colours")]
    Bands {
        /// Number of bands.
        found: usize,
    },
    /// Colours out of reach.
    #[error(
        "the bands at {} nm cannot represent all sRGB colours under {light} (error of {corner}: {off:.3} of white, admitted {admitted}); use more \
         bands, e.g. 400:700:10",
        wavelengths::format(bands_nm)
    )]
    Unreachable {
        /// All bands.
        bands_nm: Vec<f64>,
        /// Name of the illuminant.
        light: &'static str,
        /// The primary of largest error.
        corner: &'static str,
        /// Its error.
        off: f64,
        /// The error that is admitted.
        admitted: f64,
    },
}

/// The three reflectances.
#[derive(Clone, Debug, PartialEq)]
pub struct Primaries {
    /// ρ_R, ρ_G, ρ_B of each band.
    pub rho: Vec<[f64; 3]>,
    /// The corner of the sRGB cube, red, green or blue, that they miss most.
    pub corner: &'static str,
    /// By how much, of white, in the channel that is worst; at most [`EXACT`] where the bands represent all colours.
    pub error: f64,
}

/// The reflectances at `bands_nm` under `light`, whose colours are in error by at most `max_error` of white (linear).
///
/// # Errors
/// [`ReflectanceError`] if the bands cannot represent all colours within `max_error`.
pub fn primaries(bands_nm: &[f64], light: Illuminant, max_error: f64) -> Result<Primaries, ReflectanceError> {
    primaries_under(bands_nm, &|nm| light.relative_power(nm) / 100.0, light.name(), max_error)
}

/// As [`primaries`], under a light of relative `power` (about 1, as a function of nm) that messages call `light`.
///
/// # Errors
/// [`ReflectanceError`] likewise.
pub fn primaries_under(
    bands_nm: &[f64],
    power: &dyn Fn(f64) -> f64,
    light: &'static str,
    max_error: f64,
) -> Result<Primaries, ReflectanceError> {
    let n = bands_nm.len();
    if n == 0 || n > MAX_BANDS {
        return Err(ReflectanceError::Bands { found: n });
    }
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&a, &b| bands_nm[a].total_cmp(&bands_nm[b]));
    let weights = colour::srgb_weights(bands_nm, power);
    let band_colours: Vec<[f64; 3]> =
        order.iter().map(|&b| weights[b].map(|w| w * power(bands_nm[b]))).collect();
    let sorted: Vec<f64> = order.iter().map(|&b| bands_nm[b]).collect();
    let solved = |colours| {
        let rho = solve(&sorted, &band_colours, colours);
        let (corner, error) = worst_corner(&rho, &band_colours);
        Primaries { rho, corner, error }
    };
    let mut found = solved(Colours::Exact);
    if found.error > EXACT || found.error.is_nan() {
        found = solved(Colours::Nearest);
    }
    // Of the nearest solution, too: exact bands may be within the tolerance by it alone.
    if found.error.is_nan() || found.error > max_error.max(EXACT) {
        return Err(ReflectanceError::Unreachable {
            bands_nm: bands_nm.to_vec(),
            light,
            corner: found.corner,
            off: found.error,
            admitted: max_error,
        });
    }
    let mut rho = vec![[0.0; 3]; n];
    std::iter::zip(order, found.rho).for_each(|(b, of_band)| rho[b] = of_band);
    Ok(Primaries { rho, ..found })
}

/// The corner of the cube that reflectances miss most, and by how much; a NaN is the worst.
fn worst_corner(rho: &[[f64; 3]], band_colours: &[[f64; 3]]) -> (&'static str, f64) {
    let mut worst = ("red", 0.0f64);
    for (k, corner) in ["red", "green", "blue"].into_iter().enumerate() {
        for c in 0..3 {
            let seen: f64 = std::iter::zip(rho, band_colours).map(|(rho, w)| rho[k] * w[c]).sum();
            let off = (seen - f64::from(u8::from(c == k))).abs();
            if off > worst.1 || off.is_nan() {
                worst = (corner, off);
            }
        }
    }
    worst
}

/// How the colours of the corners enter the programme.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Colours {
    /// As equalities.
    Exact,
    /// As a penalty on their squared errors.
    Nearest,
}

/// Solves the programme in x = (ρ_R, ρ_G), ρ_B = 1 − ρ_R − ρ_G: minimum xᵀPx subject to the colours of ρ_R and ρ_G and the bounds of all three;
/// without the multipliers of the colours, their squared errors are a penalty.
fn solve(nm: &[f64], band_colours: &[[f64; 3]], colours: Colours) -> Vec<[f64; 3]> {
    let n = nm.len();
    // Rows of the colour conditions, normalised to length 1, so that one step size fits all.
    let length: [f64; 3] =
        std::array::from_fn(|c| band_colours.iter().map(|w| w[c] * w[c]).sum::<f64>().sqrt());
    let row = |c: usize, i: usize| if length[c] > 0.0 { band_colours[i][c] / length[c] } else { 0.0 };
    let target = |part: usize, c: usize| if part == c && length[c] > 0.0 { 1.0 / length[c] } else { 0.0 };
    let mut k = vec![0.0; 4 * n * n];
    let mut add = |i: usize, j: usize, v: f64| k[i * 2 * n + j] += v;
    let mean = if n > 1 { (nm[n - 1] - nm[0]) / (n - 1) as f64 } else { 1.0 };
    for i in 1..n {
        let w = mean / (nm[i] - nm[i - 1]).max(1e-9);
        for (a, b, sign) in [(i, i, 1.0), (i - 1, i - 1, 1.0), (i, i - 1, -1.0), (i - 1, i, -1.0)] {
            for (p, q, times) in [(0, 0, 2.0), (n, n, 2.0), (0, n, 1.0), (n, 0, 1.0)] {
                add(p + a, q + b, times * sign * w);
            }
        }
    }
    for i in 0..n {
        for (p, q, times) in [(0, 0, 2.0), (n, n, 2.0), (0, n, 1.0), (n, 0, 1.0)] {
            add(p + i, q + i, times * RHO);
        }
        for j in 0..n {
            let colours: f64 = (0..3).map(|c| row(c, i) * row(c, j)).sum();
            [0, n].into_iter().for_each(|p| add(p + i, p + j, RHO_COLOUR * colours));
        }
    }
    let k = inverse(k, 2 * n);
    let mut x = vec![1.0 / 3.0; 2 * n];
    // Copies of ρ_R, ρ_G and ρ_R + ρ_G within the bounds, and the multipliers of their equality.
    let mut bounded = vec![1.0 / 3.0; 3 * n];
    bounded[2 * n..].fill(2.0 / 3.0);
    let (mut multiplier, mut colour_multiplier) = (vec![0.0; 3 * n], [[0.0; 3]; 2]);
    for _ in 0..ITERATIONS {
        let mut right = vec![0.0; 2 * n];
        for (part, i) in [0, 1].into_iter().flat_map(|p| (0..n).map(move |i| (p, i))) {
            let colours =
                (0..3).map(|c| row(c, i) * (RHO_COLOUR * target(part, c) - colour_multiplier[part][c]));
            let single = RHO * bounded[part * n + i] - multiplier[part * n + i];
            right[part * n + i] =
                colours.sum::<f64>() + single + RHO * bounded[2 * n + i] - multiplier[2 * n + i];
        }
        for (x, line) in x.iter_mut().zip(k.chunks_exact(2 * n)) {
            *x = line.iter().zip(&right).map(|(a, b)| a * b).sum();
        }
        let mut worst = 0f64;
        for i in 0..3 * n {
            let (value, low, high) = match i {
                i if i < 2 * n => (x[i], 0.0, f64::INFINITY),
                i => (x[i - 2 * n] + x[i - n], f64::NEG_INFINITY, 1.0),
            };
            let next = (value + multiplier[i] / RHO).clamp(low, high);
            multiplier[i] += RHO * (value - next);
            worst = worst.max((value - next).abs()).max(RHO * (next - bounded[i]).abs());
            bounded[i] = next;
        }
        let equalities = [0, 1].into_iter().filter(|_| colours == Colours::Exact);
        for (part, c) in equalities.flat_map(|p| (0..3).map(move |c| (p, c))) {
            let seen: f64 = (0..n).map(|i| row(c, i) * x[part * n + i]).sum();
            colour_multiplier[part][c] += RHO_COLOUR * (seen - target(part, c));
            worst = worst.max((seen - target(part, c)).abs());
        }
        if worst < CONVERGED {
            break;
        }
    }
    // Removes the remaining violation of the bounds.
    (0..n)
        .map(|i| {
            let rho = [x[i], x[n + i], 1.0 - x[i] - x[n + i]].map(|v| v.max(0.0));
            let sum: f64 = rho.iter().sum();
            rho.map(|v| v / sum)
        })
        .collect()
}

/// The inverse of a symmetric, positive definite matrix of `n` rows, by elimination without pivots.
fn inverse(mut a: Vec<f64>, n: usize) -> Vec<f64> {
    let mut out = vec![0.0; n * n];
    (0..n).for_each(|i| out[i * n + i] = 1.0);
    for i in 0..n {
        let pivot = a[i * n + i];
        for m in [&mut a, &mut out] {
            m[i * n..][..n].iter_mut().for_each(|v| *v /= pivot);
        }
        for j in (0..n).filter(|&j| j != i) {
            let factor = a[j * n + i];
            for m in [&mut a, &mut out] {
                let [from, to] =
                    m.get_disjoint_mut([i * n..(i + 1) * n, j * n..(j + 1) * n]).expect("two rows");
                to.iter_mut().zip(from).for_each(|(to, from)| *to -= factor * *from);
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bands(first: usize, last: usize, step: usize) -> Vec<f64> {
        (first..=last).step_by(step).map(|nm| nm as f64).collect()
    }

    #[test]
    fn primaries_are_smooth_reflectances_that_sum_to_one() {
        for light in Illuminant::ALL {
            for nm in [bands(400, 700, 10), bands(400, 700, 20), bands(420, 680, 10), bands(380, 780, 5)] {
                let rho = primaries(&nm, light, EXACT).unwrap().rho;
                for r in &rho {
                    assert!(r.iter().all(|v| (0.0..=1.0).contains(v)), "{r:?}");
                    assert!((r.iter().sum::<f64>() - 1.0).abs() < 1e-12);
                }
                // Smooth: two bands of 10 nm differ by less than a third.
                let step = nm[1] - nm[0];
                let largest = rho.windows(2).flat_map(|w| (0..3).map(|c| (w[0][c] - w[1][c]).abs()));
                let largest = largest.fold(0.0, f64::max);
                assert!(largest < 0.036 * step, "{light:?}: {largest} in {step} nm");
            }
        }
    }

    #[test]
    fn bands_may_be_in_any_order_and_spacing() {
        let nm = [
            700.0, 400.0, 415.0, 440.0, 450.0, 470.0, 480.0, 500.0, 512.0, 530.0, 550.0, 560.0, 580.0, 600.0,
        ]
        .into_iter()
        .chain([620.0, 640.0, 660.0])
        .collect::<Vec<_>>();
        let rho = primaries(&nm, Illuminant::D65, EXACT).unwrap().rho;
        assert!(rho[0][0] > 0.9 && rho[1][2] > 0.9 && rho[9][1] > 0.9, "{rho:?}");
    }

    #[test]
    fn insufficient_bands_are_an_error_with_the_corner() {
        for nm in [vec![450.0, 550.0, 650.0], bands(400, 700, 50), vec![550.0], vec![900.0, 910.0]] {
            let error = primaries(&nm, Illuminant::D65, EXACT).unwrap_err().to_string();
            assert!(error.contains("cannot represent") && error.contains("of white"), "{error}");
        }
        assert!(primaries(&[], Illuminant::E, 0.5).unwrap_err().to_string().contains("0 bands"));
    }

    #[test]
    fn three_bands_have_the_nearest_colours_and_exact_greys() {
        let nm = [450.0, 550.0, 610.0];
        let found = primaries(&nm, Illuminant::D65, 0.25).unwrap();
        assert!((0.01..0.25).contains(&found.error), "{} of {}", found.error, found.corner);
        for rho in &found.rho {
            assert!(
                rho.iter().all(|v| (0.0..=1.0).contains(v)) && (rho.iter().sum::<f64>() - 1.0).abs() < 1e-12
            );
        }
        // No other reflectance of red on a grid of 1/50 within the bounds is nearer.
        let weights = colour::srgb_weights(&nm, |nm| Illuminant::D65.relative_power(nm) / 100.0);
        let powers = nm.map(|nm| Illuminant::D65.relative_power(nm) / 100.0);
        let squares = |rho: [f64; 3]| {
            let seen = |c: usize| (0..3).map(|b| rho[b] * weights[b][c] * powers[b]).sum::<f64>();
            [seen(0) - 1.0, seen(1), seen(2)].map(|v| v * v).iter().sum::<f64>()
        };
        let step = |i: usize| i as f64 / 50.0;
        let grid = (0..51usize.pow(3)).map(|i| [step(i % 51), step(i / 51 % 51), step(i / 2601)]);
        let least = grid.map(squares).fold(f64::INFINITY, f64::min);
        let red = [0, 1, 2].map(|b| found.rho[b][0]);
        assert!(squares(red) < least + 0.02, "{} and {least} for {red:?}", squares(red));
    }
}
