//! Centring of windows: centroid, whole samples, fractions of a sample.
//!
//! ```text
//! centroid   Σ v·(x, y) / Σ v, samples from the middle one
//! fraction   out[i] = Σ_m D(i − m + δ) in[m],   D(d) = sin(π d) / (n sin(π d/n)),   n odd
//! ```
//! D is the phase ramp exp(2πi k δ/n) of the discrete Fourier transform over k = −(n−1)/2 … (n−1)/2 in closed form: exact for
//! samples of a function without frequencies beyond Nyquist. It has the period n, so whole samples are moved first, with
//! zeros entering.

use std::f64::consts::PI;

/// Largest share of the light that may leave a window when it is moved.
const MAX_LOSS: f64 = 1e-2;

/// Centroid of a window of n × n samples from its middle: column, row.
pub(super) fn centroid(samples: &[f64], n: usize) -> [f64; 2] {
    let half = (n / 2) as f64;
    let (mut sum, mut x, mut y) = (0.0, 0.0, 0.0);
    for (row, values) in samples.chunks_exact(n).enumerate() {
        for (column, v) in values.iter().enumerate() {
            sum += v;
            x += v * (column as f64 - half);
            y += v * (row as f64 - half);
        }
    }
    [x / sum, y / sum]
}

/// The largest sample of a window from its middle: column, row.
pub(super) fn peak(samples: &[f64], n: usize) -> [isize; 2] {
    let largest =
        samples.iter().enumerate().fold(0, |best, (i, v)| if *v > samples[best] { i } else { best });
    let half = (n / 2) as isize;
    [(largest % n) as isize - half, (largest / n) as isize - half]
}

/// The window with the sample (column, row) from its middle in the middle; zeros enter.
///
/// # Errors
/// More than [`MAX_LOSS`] of the light leaves the window.
pub(super) fn whole(samples: &[f64], n: usize, [dx, dy]: [isize; 2]) -> Result<Vec<f64>, String> {
    let inside = |at: usize, d: isize| at.checked_add_signed(d).filter(|at| *at < n);
    let mut moved = vec![0.0; n * n];
    for row in 0..n {
        let Some(from) = inside(row, dy) else { continue };
        for column in 0..n {
            if let Some(c) = inside(column, dx) {
                moved[row * n + column] = samples[from * n + c];
            }
        }
    }
    let sum = |of: &[f64]| of.iter().sum::<f64>();
    let lost = 1.0 - sum(&moved) / sum(samples);
    match lost <= MAX_LOSS {
        true => Ok(moved),
        false => Err(format!(
            "loses {:.1} % of its light when it is moved by ({dx}, {dy}) samples, expected at most {} %; use a larger window",
            100.0 * lost,
            100.0 * MAX_LOSS
        )),
    }
}

/// The window with the point (column, row), a fraction of a sample from its middle, in the middle.
pub(super) fn fraction(samples: &[f64], n: usize, [dx, dy]: [f64; 2]) -> Vec<f64> {
    let (along_x, along_y) = (weights(n, dx), weights(n, dy));
    let mut wide = vec![0.0; n * n];
    for (from, to) in samples.chunks_exact(n).zip(wide.chunks_exact_mut(n)) {
        for (i, to) in to.iter_mut().enumerate() {
            *to = from.iter().enumerate().map(|(m, v)| along_x[i + n - 1 - m] * v).sum();
        }
    }
    let mut out = vec![0.0; n * n];
    for (i, to) in out.chunks_exact_mut(n).enumerate() {
        for (m, from) in wide.chunks_exact(n).enumerate() {
            let weight = along_y[i + n - 1 - m];
            to.iter_mut().zip(from).for_each(|(to, v)| *to += weight * v);
        }
    }
    out
}

/// D(d + δ) for d = −(n − 1) … n − 1.
fn weights(n: usize, delta: f64) -> Vec<f64> {
    let size = n as f64;
    let at = |d: f64| {
        let sine = (PI * d / size).sin();
        if sine.abs() < 1e-12 { 1.0 } else { (PI * d).sin() / (size * sine) }
    };
    (0..2 * n - 1).map(|i| at(i as f64 - (size - 1.0) + delta)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A Gaussian of σ samples about (x, y) from the middle.
    fn gaussian(n: usize, sigma: f64, [x, y]: [f64; 2]) -> Vec<f64> {
        let half = (n / 2) as f64;
        (0..n * n)
            .map(|i| {
                let (u, v) = ((i % n) as f64 - half - x, (i / n) as f64 - half - y);
                (-(u * u + v * v) / (2.0 * sigma * sigma)).exp()
            })
            .collect()
    }

    fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
        a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn shifted_gaussian_is_moved_to_the_analytic_one() {
        let (n, sigma) = (41, 2.5);
        let at = [2.3, -1.7];
        let window = gaussian(n, sigma, at);
        let [x, y] = centroid(&window, n);
        assert!((x - at[0]).abs() < 1e-10 && (y - at[1]).abs() < 1e-10, "{x} {y}");
        let by = [x.round() as isize, y.round() as isize];
        let moved = whole(&window, n, by).unwrap();
        let out = fraction(&moved, n, [x - by[0] as f64, y - by[1] as f64]);
        let error = largest_difference(&out, &gaussian(n, sigma, [0.0; 2]));
        assert!(error < 1e-6, "{error}");
        let [x, y] = centroid(&out, n);
        assert!(x.abs() < 1e-6 && y.abs() < 1e-6, "{x} {y}");
    }

    #[test]
    fn whole_samples_move_without_change() {
        let window = gaussian(21, 1.0, [3.0, -2.0]);
        assert_eq!(peak(&window, 21), [3, -2]);
        assert!(
            largest_difference(&whole(&window, 21, [3, -2]).unwrap(), &gaussian(21, 1.0, [0.0; 2])) < 1e-12
        );
        assert!(largest_difference(&fraction(&window, 21, [0.0; 2]), &window) < 1e-13);
        // Half of the light.
        let mut edge = vec![0.0; 9];
        (edge[0], edge[8]) = (1.0, 1.0);
        assert!(whole(&edge, 3, [1, 1]).unwrap_err().contains("loses 50.0 % of its light"));
    }
}
