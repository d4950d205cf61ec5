//! Cubic B-spline interpolation on a unit grid: the interpolant by which PSFs are rotated and integrated. Of maps over the film: [`tensor`].
//!
//! f(t) = Σ_i c_i β³(t − i) with the c_i chosen so that f(i) = f_i; outside the grid f is 0. Its error falls as h⁴ with a
//! constant some 20 times below Catmull-Rom's (Thévenaz, Blu, Unser, "Interpolation revisited", IEEE TMI 19 (2000) 739).

pub(crate) mod tensor;

/// Of Lagrange's interpolation, which passes through the values of a grid: weights of the values at −1, 0, 1, 2 in the cubic polynomial through them at `f`, between 0 and 1 as a rule.
#[inline]
pub(crate) fn lagrange_weights(f: f64) -> [f64; 4] {
    let (before, after, far) = (f + 1.0, 1.0 - f, 2.0 - f);
    [-f * after * far / 6.0, before * after * far / 2.0, before * f * far / 2.0, -before * f * after / 6.0]
}

/// Of the nodes of `cells` cells, three or more, the first of the four around `u`, in cells from the first, and their [`lagrange_weights`].
pub(crate) fn lagrange_around(u: f64, cells: usize) -> (usize, [f64; 4]) {
    let cell = u.floor().clamp(1.0, (cells - 2) as f64);
    (cell as usize - 1, lagrange_weights(u - cell))
}

/// The four weights of β³ at fraction `f`: those of the coefficients i−1, i, i+1, i+2 for t = i + f.
#[inline]
pub(crate) fn weights(f: f64) -> [f64; 4] {
    let g = 1.0 - f;
    let inner = |t: f64| 2.0 / 3.0 - t * t * (1.0 - t / 2.0);
    [g * g * g / 6.0, inner(f), inner(g), f * f * f / 6.0]
}

/// ∫_{−∞}^{t} β³.
pub(crate) fn cumulative(t: f64) -> f64 {
    let outer = |t: f64| (t + 2.0).powi(4) / 24.0; // −2 ≤ t ≤ −1
    let inner = |t: f64| 0.5 + t * (2.0 / 3.0) - t.powi(3) / 3.0 - t.powi(4) / 8.0; // −1 ≤ t ≤ 0
    match t {
        t if t <= -2.0 => 0.0,
        t if t <= -1.0 => outer(t),
        t if t <= 0.0 => inner(t),
        t if t <= 1.0 => 1.0 - inner(-t),
        t if t <= 2.0 => 1.0 - outer(-t),
        _ => 1.0,
    }
}

/// Solves (c_{i−1} + 4c_i + c_{i+1})/6 = f_i with c = 0 outside, in place.
pub(crate) fn coefficients(line: &mut [f64]) {
    coefficients_of_columns(line, 1, &pivots(line.len()));
}

/// The pivots of the elimination for lines of `n` values.
fn pivots(n: usize) -> Vec<f64> {
    let next = |pivot: &mut f64, _| {
        *pivot = 1.0 / (4.0 - *pivot);
        Some(*pivot)
    };
    (0..n).scan(0.0, next).collect()
}

/// Solves the columns of a grid of `width` columns and a row for each pivot; rows are passed as vectors.
fn coefficients_of_columns(grid: &mut [f64], width: usize, pivots: &[f64]) {
    for (i, pivot) in pivots.iter().enumerate() {
        let (above, row) = grid.split_at_mut(i * width);
        let row = &mut row[..width];
        match above.len().checked_sub(width) {
            None => row.iter_mut().for_each(|v| *v = 6.0 * *v * pivot),
            Some(last) => {
                for (v, previous) in row.iter_mut().zip(&above[last..]) {
                    *v = (6.0 * *v - previous) * pivot;
                }
            }
        }
    }
    for (i, pivot) in pivots.iter().enumerate().rev().skip(1) {
        let (rows, below) = grid.split_at_mut((i + 1) * width);
        for (v, next) in rows[i * width..].iter_mut().zip(below) {
            *v -= pivot * *next;
        }
    }
}

/// Exchanges rows and columns of an n × n image.
fn transpose<T: Copy + Into<f64>>(image: &[T], n: usize, out: &mut Vec<f64>) {
    // Rows of `image` at a time, so that its cache lines are used whole.
    const ROWS: usize = 16;
    out.resize(n * n, 0.0);
    for first in (0..n).step_by(ROWS) {
        let rows = first..(first + ROWS).min(n);
        for (x, line) in out.chunks_exact_mut(n).enumerate() {
            for y in rows.clone() {
                line[y] = image[y * n + x].into();
            }
        }
    }
}

/// Coefficients of an n × n image, both directions, into `out`; `lines` is overwritten.
pub(crate) fn coefficients_2d(image: &[f32], n: usize, lines: &mut Vec<f64>, out: &mut Vec<f64>) {
    let pivots = pivots(n);
    // The lines along x as columns.
    transpose(image, n, lines);
    coefficients_of_columns(lines, n, &pivots);
    transpose(lines, n, out);
    coefficients_of_columns(out, n, &pivots);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interpolant_passes_through_its_points() {
        let f: Vec<f64> = (0..9).map(|i| f64::from(i * i % 7)).collect();
        let mut c = f.clone();
        coefficients(&mut c);
        let at = |i: usize| if (1..=9).contains(&i) { c[i - 1] } else { 0.0 };
        for i in 1..=9 {
            let value: f64 = weights(0.0).iter().enumerate().map(|(k, w)| w * at(i + k - 1)).sum();
            assert!((value - f[i - 1]).abs() < 1e-13);
        }
    }

    #[test]
    fn coefficients_of_an_image_interpolate_it() {
        let n = 19;
        let image: Vec<f32> = (0..n * n).map(|i| (i * i % 23) as f32).collect();
        let mut c = Vec::new();
        coefficients_2d(&image, n, &mut Vec::new(), &mut c);
        let at = |y: isize, x: isize| match (0..n as isize).contains(&y) && (0..n as isize).contains(&x) {
            true => c[y as usize * n + x as usize],
            false => 0.0,
        };
        let w = [1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0];
        for (y, x) in (0..n as isize).flat_map(|y| (0..n as isize).map(move |x| (y, x))) {
            let terms =
                (0..9).map(|k| w[k / 3] * w[k % 3] * at(y + k as isize / 3 - 1, x + k as isize % 3 - 1));
            let value = f64::from(image[y as usize * n + x as usize]);
            assert!((terms.sum::<f64>() - value).abs() < 1e-5, "{y}, {x}");
        }
    }

    #[test]
    fn cumulative_equals_the_sum_of_weights() {
        let mut sum = 0.0;
        for i in 0..4000 {
            let t = -2.0 + (f64::from(i) + 0.5) / 1000.0;
            let (cell, f) = (t.floor(), t - t.floor());
            // β³(t) is the weight of the coefficient at 0 seen from t: index 1 − cell among the four.
            sum += weights(f)[(1.0 - cell) as usize] / 1000.0;
            assert!((sum - cumulative(t + 0.0005)).abs() < 1e-6);
        }
    }
}
