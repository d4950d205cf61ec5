//! What two kernels differ by, in a film: of any texture, and of edges.
//!
//! ```text
//! d = a − b           film-pixel kernels, each of sum 1
//! L1  = Σ |d|                                  the film of a chart of values from 0 to 1 differs by at most L1/2
//! ESF = max over half planes of |Σ d|          what a film of a black and white edge differs by, of white
//! ```
//! Half planes are bounded by rows, columns and both diagonals of pixels. Fringes of a defocused PSF have a large L1 and hardly any ESF; a shift by δ
//! pixels has the largest ESF that an L1 allows, L1/2. An edge is what a film shows best: nodes are chosen so that both are within their
//! tolerances, that of the ESF being [`ESF_SHARE`] of that of L1. Depth nodes have a tolerance of their own, for rows and columns ([`super::depth`]).

/// Largest ESF that nodes are chosen for, over the largest L1.
pub const ESF_SHARE: f64 = 0.2;

/// The difference of two kernels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Difference {
    pub(crate) l1: f64,
    pub(crate) esf: f64,
}

impl Difference {
    /// That of two square kernels of one size.
    pub(crate) fn of(a: &[f32], b: &[f32]) -> Self {
        let n = a.len().isqrt();
        // Sums of rows, of columns and of the diagonals of either direction.
        let mut sums = [vec![0.0; n], vec![0.0; n], vec![0.0; 2 * n], vec![0.0; 2 * n]];
        let [rows, columns, falling, rising] = &mut sums;
        let mut l1 = 0.0;
        for (y, (a, b)) in a.chunks_exact(n).zip(b.chunks_exact(n)).enumerate() {
            for (x, (a, b)) in a.iter().zip(b).enumerate() {
                let d = f64::from(a - b);
                l1 += d.abs();
                rows[y] += d;
                columns[x] += d;
                falling[n + x - y] += d;
                rising[x + y] += d;
            }
        }
        Self { l1, esf: sums.iter().map(|sums| largest_sum(sums)).fold(0.0, f64::max) }
    }

    /// Both as one error, in units of L1: the ESF over its share, times `l1_over_esf` where the L1 may be that many times its tolerance.
    pub(crate) fn error(self, l1_over_esf: f64) -> f64 {
        self.l1.max(l1_over_esf * self.esf / ESF_SHARE)
    }

    /// `combine` of either number and that of `other`.
    pub(crate) fn with(self, other: Self, combine: impl Fn(f64, f64) -> f64) -> Self {
        Self { l1: combine(self.l1, other.l1), esf: combine(self.esf, other.esf) }
    }
}

/// Largest absolute value of the running sums.
pub(super) fn largest_sum(values: &[f64]) -> f64 {
    let running = values.iter().scan(0.0, |sum, v| {
        *sum += v;
        Some(f64::abs(*sum))
    });
    running.fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A Gaussian of σ = 2 px about a place.
    fn gauss(x0: f64, y0: f64) -> Vec<f32> {
        let n = 41;
        let at = |i: usize| (i % n) as f64 - 20.0 - x0;
        let value =
            |i: usize| crate::real::exp(-(at(i).powi(2) + ((i / n) as f64 - 20.0 - y0).powi(2)) / 8.0);
        let values: Vec<f64> = (0..n * n).map(value).collect();
        let sum: f64 = values.iter().sum();
        values.iter().map(|v| (v / sum) as f32).collect()
    }

    #[test]
    fn a_shift_moves_edges_by_half_of_its_l1_in_any_direction() {
        let (centred, small) = (gauss(0.0, 0.0), 0.05);
        // Half planes end between pixels: δ times the line spread there, at most its peak 1/(σ √2π).
        let peak = small / (2.0 * (2.0 * std::f64::consts::PI).sqrt());
        for azimuth in [0.0, 90.0, 45.0, 135.0, 20.0_f64] {
            let a = azimuth.to_radians();
            let found = Difference::of(&gauss(small * a.cos(), small * a.sin()), &centred);
            assert!((found.l1 / (2.0 * peak) - 1.0).abs() < 0.03, "{azimuth}: {found:?}");
            let least = if azimuth % 45.0 == 0.0 { 0.96 } else { 0.9 };
            assert!(found.esf > least * peak && found.esf < 1.01 * peak, "{azimuth}: {found:?}");
        }
    }

    #[test]
    fn fringes_have_a_small_esf() {
        let plain = gauss(0.0, 0.0);
        let fringed: Vec<f32> = plain
            .iter()
            .enumerate()
            .map(|(i, v)| v * if (i + i / 41) % 2 == 0 { 1.2 } else { 0.8 })
            .collect();
        let found = Difference::of(&fringed, &plain);
        assert!((found.l1 - 0.2).abs() < 0.01 && found.esf < 0.06, "{found:?}");
        assert_eq!(found.error(1.0), found.l1.max(5.0 * found.esf));
        assert_eq!(found.error(2.0), found.l1.max(10.0 * found.esf));
    }
}
