//! The light of PSFs beyond their windows: power laws of the distance, with harmonics of the azimuth.
//!
//! ```text
//! T(r, φ) = Σ_m Σ_j c_mj(h) B_mj(r) cos m φ      m = 0..4,  j = 0, 1,  q = 3 + 2 j        light per mm², of a field point of light 1
//! B_mj(r) = r^−q                                             r ≥ R
//!         = (r/R)^m R^−q [1 − (q + m)/2 · ((r/R)² − 1)]      r < R
//! ```
//! r in mm is the distance from the chief ray, φ the azimuth about it from the direction of the field point, h the REAL image height, R the
//! radius from which on the power laws hold: half a side of the PSF window. Inside R the laws are continued smoothly (two terms of their
//! expansion in r² about R: value and slope are continuous), so that T is the PSF beyond the window and a smooth function everywhere, which a
//! coarse grid can hold; the rest of the PSF, p − T inside the window, is nearly 0 at its border.
//!
//! c_00 is the constant C of the far tail in closed form ([`crate::design`], edge of the pupil), the others are fitted. Between the heights of the
//! table each coefficient is a cubic with the slopes of its neighbours (Catmull-Rom); beyond the last height its last value.
//! Units: c_m0 in mm, c_m1 in mm³.
//!
//! Where rays at the edge of the pupil land beyond the window, R is the distance from which on no rays land, larger than half the window, T has c_00 alone, and the
//! light between the window's core and R is a part of its own ([`super::middle`]).
//!
//! Left out: fringes (T is their mean), harmonics above the fourth, and what is not symmetric about the meridian; a centred lens has none.
//! Source: the power law of diffraction at an edge, Born & Wolf, 8.8 and 11.3; Clark, Howard & Freniere, Appl. Opt. 23, 353 (1984).

use super::LensError;
use super::middle::Middle;
use crate::bounds;
use std::f64::consts::PI;

/// Harmonics of the azimuth.
pub const ORDERS: usize = 5;
/// Power laws of each harmonic.
pub const TERMS: usize = 2;

/// c_mj of one field point, by m and j; c_m0 in mm, c_m1 in mm³.
pub type Coefficients = [[f64; TERMS]; ORDERS];

/// Tails of the PSFs of a band.
#[derive(Clone, Debug, PartialEq)]
pub struct BandTail {
    /// Radius from which on the power laws hold, mm: half a side of the PSF window, or that beyond which no rays land.
    pub inner_mm: f64,
    /// REAL image heights of the table, mm, ascending from 0.
    pub height_mm: Vec<f64>,
    /// Coefficients at the heights.
    pub coefficients: Vec<Coefficients>,
    /// The light between the core of the windows and the radius, where rays land beyond the window.
    pub middle: Option<Middle>,
}

/// Exponent q of term j.
fn power(j: usize) -> i32 {
    3 + 2 * j as i32
}

/// B_mj at the distance `r` for the inner radius `inner`, in any unit.
pub fn radial(r: f64, inner: f64, m: usize, j: usize) -> f64 {
    let q = power(j);
    if r >= inner {
        return r.powi(-q);
    }
    let share = r / inner;
    let slope = 0.5 * f64::from(q + m as i32);
    share.powi(m as i32) * inner.powi(-q) * (1.0 - slope * (share * share - 1.0))
}

/// cos m φ at (x, y) for all m, and the distance.
fn cosines(x: f64, y: f64) -> ([f64; ORDERS], f64) {
    let r = (x * x + y * y).sqrt();
    // Chebyshev, from cos φ.
    let cosine = if r > 0.0 { x / r } else { 1.0 };
    let (mut last, mut this) = (cosine, 1.0);
    let all = std::array::from_fn(|m| {
        let cosine_m = this;
        (last, this) = (this, if m == 0 { cosine } else { 2.0 * cosine * this - last });
        cosine_m
    });
    (all, r)
}

/// T at (x, y) from the chief ray, the field point on +x, for `inner` in the same unit.
pub fn value(c: &Coefficients, inner: f64, x: f64, y: f64) -> f64 {
    let (cosines, r) = cosines(x, y);
    let mut sum = 0.0;
    for (m, (terms, cosine)) in c.iter().zip(cosines).enumerate() {
        for (j, c) in terms.iter().enumerate() {
            sum += c * radial(r, inner, m, j) * cosine;
        }
    }
    sum
}

/// B_mj and cos m φ at the places of a row, for [`value`] of several field points: the same bits.
#[derive(Debug, Default)]
pub(crate) struct RowBasis {
    radial: [[Vec<f64>; TERMS]; ORDERS],
    cosine: [Vec<f64>; ORDERS],
}

impl RowBasis {
    /// Sets the places (x, `y`), `x` ascending or not.
    pub(crate) fn set(&mut self, inner: f64, x: impl Iterator<Item = f64>, y: f64) {
        self.radial.iter_mut().flatten().chain(&mut self.cosine).for_each(Vec::clear);
        for x in x {
            let (cosines, r) = cosines(x, y);
            for (m, cosine) in cosines.into_iter().enumerate() {
                self.cosine[m].push(cosine);
                self.radial[m].iter_mut().enumerate().for_each(|(j, to)| to.push(radial(r, inner, m, j)));
            }
        }
    }

    /// T of coefficients `c` at the places.
    pub(crate) fn values(&self, c: &Coefficients, out: &mut Vec<f64>) {
        out.clear();
        out.resize(self.cosine[0].len(), 0.0);
        for ((terms, radials), cosine) in c.iter().zip(&self.radial).zip(&self.cosine) {
            for (c, radial) in terms.iter().zip(radials) {
                for ((to, radial), cosine) in out.iter_mut().zip(radial).zip(cosine) {
                    *to += c * radial * cosine;
                }
            }
        }
    }
}

/// ∫ T over the plane, for `inner` in mm: only m = 0 has a share.
pub fn light(c: &Coefficients, inner: f64) -> f64 {
    let of = |j: usize| {
        let q = f64::from(power(j));
        2.0 * PI * inner.powi(2 - power(j)) * (0.5 + q / 8.0 + 1.0 / (q - 2.0))
    };
    (0..TERMS).map(|j| c[0][j] * of(j)).sum()
}

impl BandTail {
    /// The coefficients at the REAL height `h_mm`.
    pub fn at(&self, h_mm: f64) -> Coefficients {
        let (h, c) = (&self.height_mm, &self.coefficients);
        let last = h.len() - 1;
        if h_mm >= h[last] {
            return c[last];
        }
        let i = h.partition_point(|v| *v <= h_mm).clamp(1, last) - 1;
        let step = h[i + 1] - h[i];
        let t = (h_mm - h[i]) / step;
        std::array::from_fn(|m| {
            std::array::from_fn(|j| {
                let v = |k: usize| c[k][m][j];
                // A coefficient is an even or odd function of the height, as m is.
                let before = if i > 0 {
                    (v(i + 1) - v(i - 1)) / (h[i + 1] - h[i - 1])
                } else if m.is_multiple_of(2) {
                    0.0
                } else {
                    v(1) / h[1]
                };
                let after = match i + 2 {
                    k if k <= last => (v(k) - v(i)) / (h[k] - h[i]),
                    _ => (v(i + 1) - v(i)) / step,
                };
                let (a, b) = (v(i), v(i + 1));
                let (s0, s1) = (before * step, after * step);
                let (t2, t3) = (t * t, t * t * t);
                (2.0 * t3 - 3.0 * t2 + 1.0) * a
                    + (t3 - 2.0 * t2 + t) * s0
                    + (3.0 * t2 - 2.0 * t3) * b
                    + (t3 - t2) * s1
            })
        })
    }

    /// Light of the middle part per mm² at (x, y) mm from the chief ray of the REAL height `h_mm`, linear between heights; 0 without one.
    pub fn middle_density(&self, h_mm: f64, x: f64, y: f64) -> f64 {
        let (Some(middle), h) = (&self.middle, &self.height_mm) else { return 0.0 };
        let above = h.partition_point(|v| *v <= h_mm).clamp(1, h.len() - 1);
        let share = ((h_mm - h[above - 1]) / (h[above] - h[above - 1])).min(1.0);
        (1.0 - share) * middle.density(above - 1, x, y) + share * middle.density(above, x, y)
    }

    /// Checks lengths and bounds, for the band at `wavelength_nm`.
    ///
    /// # Errors
    /// [`LensError::Table`].
    pub fn check(&self, wavelength_nm: f64) -> Result<(), LensError> {
        let bad = |table, problem: String| Err(LensError::Table { wavelength_nm, table, problem });
        if let Err(e) = bounds::HEIGHT_MM.check(self.inner_mm) {
            return bad("tail/inner_radius", format!("is out of bounds: {e}"));
        }
        if self.inner_mm <= 0.0 {
            return bad("tail/inner_radius", format!("is {} mm, expected a positive number", self.inner_mm));
        }
        let heights = self.height_mm.len();
        if heights < 2 || self.coefficients.len() != heights {
            let found = self.coefficients.len();
            return bad("tail/height", format!("has {heights} heights and {found} rows of coefficients"));
        }
        if let Err(problem) = super::check::ascending_from_zero(&self.height_mm) {
            return bad("tail/height", problem);
        }
        if let Err((i, e)) = bounds::HEIGHT_MM.check_all(&self.height_mm) {
            return bad("tail/height", format!("is out of bounds at index {i}: {e}"));
        }
        for (k, c) in self.coefficients.iter().enumerate() {
            let outside = light(c, self.inner_mm);
            let is_finite = c.iter().flatten().all(|v| v.is_finite());
            // A share of the light, whatever the coefficients: a window has more than half of it.
            if !(is_finite && (0.0..0.5).contains(&outside)) {
                return bad(
                    "tail/coefficient",
                    format!("at height {k} have a share of {outside} of the light, expected 0 to 0.5"),
                );
            }
        }
        if let Some(problem) = self.middle.as_ref().and_then(|middle| middle.problem(heights)) {
            return bad("tail/middle", problem);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const C: Coefficients = [[2.0, 0.3], [0.1, -0.2], [0.7, 0.05], [0.02, 0.01], [0.1, 0.03]];

    #[test]
    fn tail_is_continuous_at_its_inner_radius_and_finite_on_the_axis() {
        let inner = 1.7;
        for k in 0..12 {
            let phi = 0.3 + f64::from(k) * 0.5;
            let at = |r: f64| value(&C, inner, r * phi.cos(), r * phi.sin());
            let (below, above) = (at(inner * (1.0 - 1e-7)), at(inner * (1.0 + 1e-7)));
            assert!((below / above - 1.0).abs() < 2e-6, "{below} {above}");
            let slope = |r: f64| (at(r + 1e-5) - at(r - 1e-5)) / 2e-5;
            let (below, above) = (slope(inner - 2e-5), slope(inner + 2e-5));
            assert!((below / above - 1.0).abs() < 1e-3, "{below} {above}");
            // Direct form of the equation beyond the radius.
            let r: f64 = 3.1;
            let expected: f64 = (0..ORDERS)
                .map(|m| (C[m][0] * r.powi(-3) + C[m][1] * r.powi(-5)) * (m as f64 * phi).cos())
                .sum();
            assert!((at(r) - expected).abs() < 1e-14);
        }
        assert!(value(&C, inner, 0.0, 0.0).is_finite());
    }

    #[test]
    fn rows_have_the_bits_of_single_values() {
        let (mut basis, mut row) = (RowBasis::default(), Vec::new());
        let x = || (-4..=4).map(|k| 0.4 * f64::from(k));
        for y in [-1.3, 0.0, 2.5] {
            basis.set(1.7, x(), y);
            for c in [C, C.map(|[a, b]| [b, -a])] {
                basis.values(&c, &mut row);
                let expected: Vec<f64> = x().map(|x| value(&c, 1.7, x, y)).collect();
                assert_eq!(row, expected, "{y}");
            }
        }
    }

    #[test]
    fn light_is_the_integral_over_the_plane() {
        let (inner, n, step) = (1.0, 1200, 0.05);
        let mut sum = 0.0;
        for y in -n..=n {
            for x in -n..=n {
                let (x, y) = (f64::from(x) * step, f64::from(y) * step);
                sum += value(&C, inner, x, y) * step * step;
            }
        }
        // Outside the square of half a side a: 4 √2 c_00/a, and that of c_40 (8 ∫ cos 4φ cos φ dφ over an eighth of a circle).
        let a = (f64::from(n) + 0.5) * step;
        sum += C[0][0] * 4.0 * 2f64.sqrt() / a + C[4][0] * 0.377_124 / a;
        assert!((sum / light(&C, inner) - 1.0).abs() < 1e-4, "{sum} {}", light(&C, inner));
    }

    #[test]
    fn coefficients_between_heights_are_those_of_a_smooth_field() {
        let height_mm: Vec<f64> = (0..=12).map(|k| 1.75 * f64::from(k)).collect();
        let field = |h: f64| -> Coefficients {
            let u = h / 21.0;
            let third = [2.0 + 0.3 * u * u, 0.4 * u, u * u, u.powi(3), u.powi(4)];
            third.map(|v| [1e-5 * v, 0.0])
        };
        let tail = BandTail {
            inner_mm: 0.04,
            coefficients: height_mm.iter().map(|h| field(*h)).collect(),
            height_mm,
            middle: None,
        };
        for h in [0.0, 0.4, 1.1, 5.3, 12.6, 19.9, 21.0] {
            let (found, expected) = (tail.at(h), field(h));
            let worst = found.iter().flatten().zip(expected.iter().flatten()).map(|(a, b)| (a - b).abs());
            assert!(worst.fold(0.0, f64::max) < 4e-8, "{h} mm: {found:?} {expected:?}");
        }
        assert_eq!(tail.at(30.0), tail.coefficients[12]);
        tail.check(550.0).unwrap();
    }
}
