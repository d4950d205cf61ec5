//! Dense tables from a few field points, by cubic splines with the symmetry of a centred lens.
//!
//! ```text
//! image height: an ODD function of ideal height, RI: an EVEN one
//! ```
//! The points are mirrored about the axis and interpolated by a cubic spline whose third derivative is continuous at the second
//! and the last but one point ("not-a-knot": de Boor, A Practical Guide to Splines, chapter IV), evaluated at equal steps of ideal
//! height. Two points (three with the mirrored one) give a line or a parabola. The order of operations is that of SciPy's
//! CubicSpline with LAPACK's dgtsv, so tables made by either agree to the last bit.

/// Symmetry about the axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parity {
    /// v(−x) = −v(x), as for heights.
    Odd,
    /// v(−x) = v(x), as for relative illumination.
    Even,
}

/// A cubic spline through points mirrored about x = 0.
#[derive(Clone, Debug)]
pub struct Spline {
    x: Vec<f64>,
    y: Vec<f64>,
    slope: Vec<f64>,
}

impl Spline {
    /// The spline through `y` at `x`, which ascends from 0 and has at least 2 points.
    ///
    /// # Panics
    /// There are fewer points, or the lengths differ.
    pub fn mirrored(x: &[f64], y: &[f64], parity: Parity) -> Self {
        assert!(x.len() >= 2 && x.len() == y.len(), "lengths are checked by the caller");
        let sign = if parity == Parity::Odd { -1.0 } else { 1.0 };
        let xs: Vec<f64> = x[1..].iter().rev().map(|v| -v).chain(x.iter().copied()).collect();
        let ys: Vec<f64> = y[1..].iter().rev().map(|v| sign * v).chain(y.iter().copied()).collect();
        let slope = slopes(&xs, &ys);
        Self { x: xs, y: ys, slope }
    }

    /// The spline at `at`, extrapolated by its outermost polynomials.
    pub fn at(&self, at: f64) -> f64 {
        let i = self.x.partition_point(|&x| x <= at).clamp(1, self.x.len() - 1) - 1;
        let dx = self.x[i + 1] - self.x[i];
        let chord = (self.y[i + 1] - self.y[i]) / dx;
        let t = (self.slope[i] + self.slope[i + 1] - 2.0 * chord) / dx;
        let (c3, c2) = (t / dx, (chord - self.slope[i]) / dx - t);
        let s = at - self.x[i];
        let mut sum = self.y[i];
        let mut power = s;
        for c in [self.slope[i], c2, c3] {
            sum += c * power;
            power *= s;
        }
        sum
    }
}

/// Slopes of the not-a-knot spline at every point.
fn slopes(x: &[f64], y: &[f64]) -> Vec<f64> {
    let n = x.len();
    let dx: Vec<f64> = x.windows(2).map(|w| w[1] - w[0]).collect();
    let chord: Vec<f64> = y.windows(2).zip(&dx).map(|(w, d)| (w[1] - w[0]) / d).collect();
    if n == 3 {
        let bend = (chord[1] - chord[0]) / (x[2] - x[0]);
        return vec![chord[0] - bend * dx[0], chord[0] + bend * dx[0], chord[1] + bend * dx[1]];
    }
    let (mut below, mut diagonal, mut above, mut b) =
        (vec![0.0; n - 1], vec![0.0; n], vec![0.0; n - 1], vec![0.0; n]);
    for i in 1..n - 1 {
        diagonal[i] = 2.0 * (dx[i - 1] + dx[i]);
        above[i] = dx[i - 1];
        below[i - 1] = dx[i];
        b[i] = 3.0 * (dx[i] * chord[i - 1] + dx[i - 1] * chord[i]);
    }
    let d = x[2] - x[0];
    (diagonal[0], above[0]) = (dx[1], d);
    b[0] = ((dx[0] + 2.0 * d) * dx[1] * chord[0] + dx[0] * dx[0] * chord[1]) / d;
    let d = x[n - 1] - x[n - 3];
    (diagonal[n - 1], below[n - 2]) = (dx[n - 3], d);
    b[n - 1] = (dx[n - 2] * dx[n - 2] * chord[n - 3] + (2.0 * d + dx[n - 2]) * dx[n - 3] * chord[n - 2]) / d;
    solve(&mut below, &mut diagonal, &mut above, &mut b);
    b
}

/// Gaussian elimination of a tridiagonal system with row exchanges; `below` takes the second superdiagonal, as in dgtsv.
fn solve(below: &mut [f64], diagonal: &mut [f64], above: &mut [f64], b: &mut [f64]) {
    let n = diagonal.len();
    for i in 0..n - 1 {
        if diagonal[i].abs() >= below[i].abs() {
            let factor = below[i] / diagonal[i];
            diagonal[i + 1] -= factor * above[i];
            b[i + 1] -= factor * b[i];
            below[i] = 0.0;
        } else {
            let factor = diagonal[i] / below[i];
            diagonal[i] = below[i];
            let swapped = diagonal[i + 1];
            diagonal[i + 1] = above[i] - factor * swapped;
            if i + 2 < n {
                below[i] = above[i + 1];
                above[i + 1] *= -factor;
            }
            above[i] = swapped;
            let swapped = b[i];
            b[i] = b[i + 1];
            b[i + 1] = swapped - factor * b[i + 1];
        }
    }
    b[n - 1] /= diagonal[n - 1];
    b[n - 2] = (b[n - 2] - above[n - 2] * b[n - 1]) / diagonal[n - 2];
    for i in (0..n - 2).rev() {
        b[i] = (b[i] - above[i] * b[i + 1] - below[i] * b[i + 2]) / diagonal[i];
    }
}

/// `count` equidistant values from 0 to `last`.
pub fn equidistant(last: f64, count: usize) -> Vec<f64> {
    let step = last / (count - 1) as f64;
    (0..count).map(|i| if i + 1 == count { last } else { i as f64 * step }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cubic_and_parabola_are_reproduced() {
        let x: Vec<f64> = (0..6).map(|i| f64::from(i) * 0.7).collect();
        let odd: Vec<f64> = x.iter().map(|x| 2.0 * x - 0.1 * x.powi(3)).collect();
        let even: Vec<f64> = x.iter().map(|x| 1.0 - 0.05 * x * x).collect();
        let (odd, even) =
            (Spline::mirrored(&x, &odd, Parity::Odd), Spline::mirrored(&x, &even, Parity::Even));
        for i in 0..=100 {
            let at = f64::from(i) * 0.035;
            assert!((odd.at(at) - (2.0 * at - 0.1 * at.powi(3))).abs() < 1e-14);
            assert!((even.at(at) - (1.0 - 0.05 * at * at)).abs() < 1e-14);
        }
        assert!(odd.at(0.0).abs() < 1e-15 && (even.at(0.0) - 1.0).abs() < 1e-15);
    }

    #[test]
    fn two_points_give_a_line_or_a_parabola() {
        let odd = Spline::mirrored(&[0.0, 2.0], &[0.0, 3.0], Parity::Odd);
        let even = Spline::mirrored(&[0.0, 2.0], &[1.0, 0.6], Parity::Even);
        assert!((odd.at(1.0) - 1.5).abs() < 1e-15 && (even.at(1.0) - 0.9).abs() < 1e-15);
    }
}
