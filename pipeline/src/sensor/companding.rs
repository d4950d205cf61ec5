//! Companding: a piecewise linear curve from the linear numbers of a pixel to the coded ones of its raw, so that a range of 16 to 24 bits takes fewer.
//!
//! Of the linear number x (DN, black included; not rounded) and the knee points (x_k, y_k), both ascending from (0, 0):
//!
//! ```text
//! raw     = ⌊c(x) + ½⌋,   c(x) = Σ_k s_k · min(max(x − x_k, 0), x_(k+1) − x_k),   s_k = (y_(k+1) − y_k)/(x_(k+1) − x_k) ≤ 1
//! linear  = c⁻¹(raw)                                                               exact at whole numbers but for rounding to f32
//! ```
//!
//! So one coded number is 1/s_k linear ones, and what rounding adds to the variance is (1/s_k)²/12 DN². Knee points are chosen where shot noise exceeds that of rounding: 1/s_k about the noise of the segment's first number or less.
//! Numbers above the last knee point have its number. Digital companders that round linear numbers to whole ones first, and then these, differ by up to half a linear number on average.

/// Knee points of a curve.
#[derive(Clone, Debug, PartialEq)]
pub struct Companding {
    /// Linear numbers, ascending from 0.
    pub linear_dn: Vec<f64>,
    /// Coded numbers, ascending from 0.
    pub coded_dn: Vec<f64>,
}

impl Companding {
    /// The greatest linear number.
    pub fn max_linear_dn(&self) -> f64 {
        self.linear_dn.last().copied().unwrap_or_default()
    }

    /// The value of the curve at a linear number.
    #[inline(always)]
    pub fn coded(&self, linear_dn: f64) -> f64 {
        let mut coded = 0.0;
        for (x, y) in std::iter::zip(self.linear_dn.windows(2), self.coded_dn.windows(2)) {
            let (width, above) = (x[1] - x[0], linear_dn - x[0]);
            let above = if above > 0.0 { above } else { 0.0 };
            coded += (y[1] - y[0]) / width * if above < width { above } else { width };
        }
        coded
    }

    /// The linear number of a coded one.
    pub fn linear(&self, coded_dn: f64) -> f64 {
        let k = self.segment(&self.coded_dn, coded_dn);
        let (x, y) = (&self.linear_dn[k..k + 2], &self.coded_dn[k..k + 2]);
        let inside = coded_dn.clamp(y[0], y[1]) - y[0];
        x[0] + inside * (x[1] - x[0]) / (y[1] - y[0])
    }

    /// Linear numbers of a coded one at a linear number.
    pub fn step_dn(&self, linear_dn: f64) -> f64 {
        let k = self.segment(&self.linear_dn, linear_dn);
        (self.linear_dn[k + 1] - self.linear_dn[k]) / (self.coded_dn[k + 1] - self.coded_dn[k])
    }

    /// Number of the segment in which a number lies, the first or last beyond the ends.
    fn segment(&self, ends: &[f64], number: f64) -> usize {
        ends.partition_point(|end| *end <= number).clamp(1, ends.len() - 1) - 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve() -> Companding {
        Companding {
            linear_dn: vec![0.0, 1024.0, 9216.0, 1_048_575.0],
            coded_dn: vec![0.0, 1024.0, 2048.0, 4095.0],
        }
    }

    #[test]
    fn coded_numbers_give_their_linear_ones_back() {
        let curve = curve();
        let mut last = -1.0;
        for code in 0..4096 {
            let linear = curve.linear(f64::from(code));
            assert!(linear > last && (curve.coded(linear) - f64::from(code)).abs() < 1e-9, "{code}");
            last = linear;
        }
        assert_eq!(
            [0.0, 1023.0, 1025.0, 2048.0, 4095.0].map(|code| curve.linear(code)),
            [0.0, 1023.0, 1032.0, 9216.0, 1_048_575.0]
        );
        assert_eq!((curve.coded(-3.0), curve.coded(1e9)), (0.0, 4095.0));
        assert_eq!([5.0, 2000.0, 1e7].map(|x| curve.step_dn(x)), [1.0, 8.0, 1_039_359.0 / 2047.0]);
    }
}
