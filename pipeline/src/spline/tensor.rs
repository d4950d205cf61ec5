//! C² bicubic spline on a uniform grid with not-a-knot ends.
//!
//! ```text
//! f(v, u) = Σ_j Σ_i c_ji β³(v − j) β³(u − i),   j = −1 … rows,  i = −1 … columns
//! f = the samples at the nodes (0 … rows − 1, 0 … columns − 1)
//! ```
//! the tensor product of the interpolant of a line. On a line, with M_i = c_{i−1} − 2c_i + c_{i+1} (the second derivative at
//! node i), f_i = c_i + M_i/6. Not-a-knot: the third derivative M_{i+1} − M_i is continuous at node 1, so M_0 − 2M_1 + M_2 = 0
//! and
//! ```text
//! M_1 = f_0 − 2f_1 + f_2,   c_1 = f_1 − M_1/6;   the same at the other end
//! ```
//! The coefficients between them solve c_{i−1} + 4c_i + c_{i+1} = 6f_i (C. de Boor, "A Practical Guide to Splines", chapter
//! IV), and the same equation gives those at and beyond the ends. Exact for polynomials of degree 3 in each variable.

use super::weights;

/// Least number of nodes of a line.
pub(crate) const MIN_NODES: usize = 4;

/// Coefficients of an interpolant: those of nodes −1 to `rows` and −1 to `columns`, row by row.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct TensorSpline {
    /// Nodes across.
    pub(crate) columns: usize,
    pub(crate) coefficients: Vec<f64>,
}

impl TensorSpline {
    /// The interpolant of `samples` of `columns` nodes a row.
    ///
    /// # Panics
    /// Fewer than [`MIN_NODES`] rows or columns.
    pub(crate) fn new(samples: &[f64], columns: usize) -> Self {
        let rows = samples.len() / columns;
        let across = transposed(&coefficients_down(&transposed(samples, columns), rows), rows);
        Self { columns, coefficients: coefficients_down(&across, columns + 2) }
    }

    /// Value and slopes (down, across) at (v, u), in nodes from the first: beyond the ends those of the end.
    pub(crate) fn at(&self, v: f64, u: f64) -> [f64; 3] {
        let width = self.columns + 2;
        let rows = self.coefficients.len() / width - 2;
        let ((y, fy), (x, fx)) = (cell_of(v, rows - 1), cell_of(u, self.columns - 1));
        let sum = |wy: [f64; 4], wx: [f64; 4]| -> f64 {
            (0..16).map(|k| wy[k / 4] * wx[k % 4] * self.coefficients[(y + k / 4) * width + x + k % 4]).sum()
        };
        let (wy, wx) = (weights(fy), weights(fx));
        [sum(wy, wx), sum(slope_weights(fy), wx), sum(wy, slope_weights(fx))]
    }
}

/// Coefficients of each column of a grid `width` wide: two rows more than it has.
fn coefficients_down(samples: &[f64], width: usize) -> Vec<f64> {
    let n = samples.len() / width;
    assert!(n >= MIN_NODES, "{n} nodes");
    let pivots: Vec<f64> = (2..n - 2)
        .scan(0.0, |pivot: &mut f64, _| {
            *pivot = 1.0 / (4.0 - *pivot);
            Some(*pivot)
        })
        .collect();
    let mut all = vec![0.0; (n + 2) * width];
    // The samples of node row i, and the place of its coefficient in column x.
    let (f, at) = (|i: usize| &samples[i * width..][..width], |i: usize, x: usize| (i + 1) * width + x);
    for (end, i, inner) in [(0, 1, 2), (n - 1, n - 2, n - 3)] {
        for (x, ((end, here), inner)) in f(end).iter().zip(f(i)).zip(f(inner)).enumerate() {
            all[at(i, x)] = here - (end - 2.0 * here + inner) / 6.0;
        }
    }
    for (i, pivot) in (2..n - 2).zip(&pivots) {
        for (x, here) in f(i).iter().enumerate() {
            all[at(i, x)] = (6.0 * here - all[at(i - 1, x)]) * pivot;
        }
    }
    for (i, pivot) in (2..n - 2).zip(&pivots).rev() {
        for x in 0..width {
            all[at(i, x)] -= pivot * all[at(i + 1, x)];
        }
    }
    for x in 0..width {
        let (second, last) = (f(1)[x], f(n - 2)[x]);
        all[at(0, x)] = 6.0 * second - 4.0 * all[at(1, x)] - all[at(2, x)];
        all[at(n - 1, x)] = 6.0 * last - 4.0 * all[at(n - 2, x)] - all[at(n - 3, x)];
        all[x] = 6.0 * f(0)[x] - 4.0 * all[at(0, x)] - all[at(1, x)];
        all[at(n, x)] = 6.0 * f(n - 1)[x] - 4.0 * all[at(n - 1, x)] - all[at(n - 2, x)];
    }
    all
}

/// Exchanges the rows and columns of a grid `width` wide.
pub(crate) fn transposed<T: Copy + Default>(grid: &[T], width: usize) -> Vec<T> {
    // Rows of `grid` at a time, so that its cache lines are used whole.
    const ROWS: usize = 16;
    let rows = grid.len() / width;
    let mut out = vec![T::default(); grid.len()];
    for (first, part) in (0..rows).step_by(ROWS).zip(grid.chunks(ROWS * width)) {
        for (x, line) in out.chunks_exact_mut(rows).enumerate() {
            for (to, from) in line[first..].iter_mut().zip(part[x..].iter().step_by(width)) {
                *to = *from;
            }
        }
    }
    out
}

/// Derivatives of the four weights of β³ at fraction `f` ([`crate::spline::weights`]), per node distance.
pub(crate) fn slope_weights(f: f64) -> [f64; 4] {
    let g = 1.0 - f;
    let inner = |t: f64| t * (1.5 * t - 2.0);
    [-0.5 * g * g, inner(f), -inner(g), 0.5 * f * f]
}

/// The place `u`, in nodes from the first, or the nearer end of a line of `cells` cells.
#[inline(always)]
pub(crate) fn clamped(u: f64, cells: usize) -> f64 {
    let last = cells as f64;
    let u = if u > 0.0 { u } else { 0.0 };
    if u < last { u } else { last }
}

/// Cell and fraction of the place `u` on a line of `cells` cells; beyond its ends those of the end.
#[inline(always)]
pub(crate) fn cell_of(u: f64, cells: usize) -> (usize, f64) {
    let u = clamped(u, cells);
    let cell = (u as usize).min(cells - 1);
    (cell, u - cell as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spline_is_exact_for_cubics() {
        for (rows, columns) in [(4, 4), (5, 4), (6, 7), (17, 9), (4, 33)] {
            let f = |v: f64, u: f64| {
                let (v, u) = (v / rows as f64, u / columns as f64);
                (1.0 + v - 2.0 * v * v + 3.0 * v * v * v) * (0.5 - u + u * u - 2.0 * u * u * u)
            };
            let samples: Vec<f64> =
                (0..rows * columns).map(|i| f((i / columns) as f64, (i % columns) as f64)).collect();
            let spline = TensorSpline::new(&samples, columns);
            for k in 0..400 {
                let v = (f64::from(k) * 0.618_033_988_7).fract() * (rows - 1) as f64;
                let u = (f64::from(k) * 0.414_213_562_4).fract() * (columns - 1) as f64;
                let [value, down, across] = spline.at(v, u);
                assert!((value - f(v, u)).abs() < 1e-12, "{rows} x {columns} at {v}, {u}");
                let h = 1e-5;
                assert!((down - (f(v + h, u) - f(v - h, u)) / (2.0 * h)).abs() < 1e-8);
                assert!((across - (f(v, u + h) - f(v, u - h)) / (2.0 * h)).abs() < 1e-8);
            }
        }
    }

    #[test]
    fn spline_passes_through_its_samples_and_has_no_knot_beside_an_end() {
        let (rows, columns) = (9, 12);
        let samples: Vec<f64> = (0..rows * columns).map(|i| (i * i % 23) as f64).collect();
        let spline = TensorSpline::new(&samples, columns);
        for (i, sample) in samples.iter().enumerate() {
            let value = spline.at((i / columns) as f64, (i % columns) as f64)[0];
            assert!((value - sample).abs() < 1e-12, "{i}");
        }
        // The third derivative changes by the fourth difference of the coefficients: not at the second node and the last but one.
        for line in spline.coefficients.chunks_exact(columns + 2) {
            for five in [&line[..5], &line[columns - 3..]] {
                let fourth = five[0] - 4.0 * five[1] + 6.0 * five[2] - 4.0 * five[3] + five[4];
                assert!(fourth.abs() < 1e-11, "{fourth:e}");
            }
        }
    }
}
