//! Statistics of dead leaves against their closed forms, and coverage against sampling.

use super::*;
use crate::geometry::Size;

const SIDE: usize = 400;

fn leaves(seed: u64, r_min_px: f64, r_max_px: f64) -> DeadLeaves {
    DeadLeaves::new(Size::new(SIDE, SIDE).rect(), seed, r_min_px, r_max_px, 4.0)
}

fn pixels(leaves: &DeadLeaves) -> Vec<f64> {
    let mut out = vec![0.0; SIDE * SIDE];
    leaves.paint(1.0, Size::new(SIDE, SIDE).rect(), &mut out);
    out.into_iter().map(f64::from).collect()
}

/// γ(d) of the header but for a factor, by 2000 midpoints in ln r.
fn overlap(d: f64, r_min: f64, r_max: f64) -> f64 {
    let n = 2000;
    let step = (r_max / r_min).ln() / f64::from(n);
    (0..n)
        .map(|i| {
            let r = r_min * (step * (f64::from(i) + 0.5)).exp();
            let h = (d / (2.0 * r)).min(1.0);
            // p(r) dr ∝ r⁻² d(ln r)
            2.0 * (h.acos() - h * (1.0 - h * h).sqrt())
        })
        .sum()
}

#[test]
fn mean_variance_and_covariance_have_their_closed_forms() {
    let (r_min, r_max) = (3.0, 24.0);
    let sigma2 = (0.8f64 * 3.0 / 5.0).powi(2) / 12.0;
    let lags = [0usize, 4, 8, 16, 32, 64];
    let (mut mean, mut sums) = (0.0, [0.0; 6]);
    let seeds = 12;
    for seed in 0..seeds {
        let pixels = pixels(&leaves(seed, r_min, r_max));
        mean += pixels.iter().sum::<f64>() / pixels.len() as f64 / seeds as f64;
        for (sum, lag) in sums.iter_mut().zip(lags) {
            let pairs = pixels.chunks(SIDE).flat_map(|row| row.iter().zip(&row[lag..]));
            let total: f64 = pairs.map(|(a, b)| (a - MEAN) * (b - MEAN)).sum();
            *sum += total / (SIDE * (SIDE - lag)) as f64 / seeds as f64;
        }
    }
    // About 2500 independent areas of 28 px in 12 pictures.
    assert!((mean - MEAN).abs() < 4.0 * (sigma2 / 2500.0).sqrt(), "mean {mean}");
    let full = overlap(0.0, r_min, r_max);
    for (found, lag) in sums.into_iter().zip(lags) {
        let common = overlap(lag as f64, r_min, r_max);
        let expected = common / (2.0 * full - common);
        // Pixel means lose a few per cent of the variance at lag 0.
        let tolerance = if lag == 0 { 0.1 } else { 0.05 };
        let found = found / sigma2;
        assert!((found - expected).abs() < tolerance, "lag {lag}: {found} {expected}");
    }
}

/// Direct sums at twelve frequencies of a ring, of six pictures.
#[test]
fn spectrum_falls_about_as_the_square_of_the_frequency() {
    let power = |cycles: usize| {
        let mut sum = 0.0;
        for seed in 0..6 {
            let pixels = pixels(&leaves(100 + seed, 1.5, 200.0));
            for k in 0..12 {
                // Along the ring of this frequency, on integer frequencies of the square.
                let angle = std::f64::consts::PI * f64::from(k) / 12.0;
                let (u, v) = ((cycles as f64 * angle.cos()).round(), (cycles as f64 * angle.sin()).round());
                let turn =
                    |n: f64, at: usize| (std::f64::consts::TAU * n * at as f64 / SIDE as f64).sin_cos();
                let columns: Vec<(f64, f64)> = (0..SIDE).map(|x| turn(u, x)).collect();
                let (mut re, mut im) = (0.0, 0.0);
                for (y, row) in pixels.chunks(SIDE).enumerate() {
                    // A window removes the jump from border to border.
                    let window = |at: usize| 1.0 - turn(1.0, at).1;
                    let (mut a, mut b) = (0.0, 0.0);
                    for (x, v) in row.iter().enumerate() {
                        let value = (v - MEAN) * (1.0 - columns_cos(x));
                        a += value * columns[x].1;
                        b += value * columns[x].0;
                    }
                    let (sin, cos) = turn(v, y);
                    re += window(y) * (a * cos - b * sin);
                    im += window(y) * (a * sin + b * cos);
                }
                sum += re * re + im * im;
            }
        }
        sum
    };
    let (low, high) = (6, 60);
    let slope = (power(high) / power(low)).log10() / (high as f64 / low as f64).log10();
    assert!((-2.3..-1.7).contains(&slope), "slope {slope}");
}

fn columns_cos(x: usize) -> f64 {
    (std::f64::consts::TAU * x as f64 / SIDE as f64).cos()
}

#[test]
fn pixels_are_the_mean_of_what_is_seen() {
    let model = leaves(3, 4.0, 30.0);
    let block = Rect::new(120, 150, 60, 60);
    let painted = model.block(block);
    let all = model.leaves(block);
    let (mut squares, mut worst) = (0.0, 0.0f64);
    for (i, painted) in painted.iter().enumerate() {
        let (y, x) = (block.y as f64 + (i / 60) as f64, block.x as f64 + (i % 60) as f64);
        let n = 24;
        let mut sum = 0.0;
        for k in 0..n * n {
            let at = |j: usize| (j as f64 + 0.5) / n as f64 - 0.5;
            let (v, u) = (y + at(k / n), x + at(k % n));
            let inside = |l: &&Leaf| (u - l.disc.centre[0]).hypot(v - l.disc.centre[1]) <= l.disc.radius;
            sum += all.iter().find(inside).map_or(MEAN, |l| l.reflectance);
        }
        let error = painted - sum / (n * n) as f64;
        squares += error * error;
        worst = worst.max(error.abs());
    }
    let rms = (squares / 3600.0).sqrt();
    // Borders that meet in a pixel are mixed as layers; the range of reflectance is 0.48.
    assert!(rms < 0.005 && worst < 0.08, "rms {rms}, worst {worst}");
}

#[test]
fn counts_have_mean_and_variance_of_a_poisson_distribution() {
    for expected in [0.7, 9.2, 55.0] {
        let n = 20_000;
        let counts: Vec<f64> = (0..n).map(|i| poisson(expected, uniform(i)) as f64).collect();
        let mean = counts.iter().sum::<f64>() / n as f64;
        let variance = counts.iter().map(|c| (c - mean) * (c - mean)).sum::<f64>() / n as f64;
        assert!((mean - expected).abs() < 4.0 * (expected / n as f64).sqrt(), "{expected}: {mean}");
        assert!((variance / expected - 1.0).abs() < 0.06, "{expected}: variance {variance}");
    }
}
