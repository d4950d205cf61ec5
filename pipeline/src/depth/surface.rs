//! Interpolation of a chart within one surface.
//!
//! A sheet shows several surfaces beside each other, and nothing where its coverage is 0. At the edge of a surface some of the chart pixels around a
//! point are of the surface, the others are not:
//!
//! ```text
//! mean    = Σ b·v/Σ b              over those of the 2 × 2 pixels that are of the surface, b: weights of bilinear interpolation
//! value   = Σ w·v + (1 − Σ w)·mean over those of the 4 × 4 pixels that are of the surface, w: weights of bicubic interpolation
//! ```
//! so a pixel that is not of the surface counts as that mean; with all pixels of the surface the value is that of bicubic interpolation, same bits. Pixels
//! are of one surface if their slabs are not apart ([`super::slabs::Slabs::apart`]).

use crate::resample::{Interp, bicubic, bilinear, cubic};

/// Slab number of pixels that a sheet does not cover, of `count` slabs.
pub(super) fn uncovered(count: usize) -> u16 {
    count as u16
}

/// Slab number of pixels beyond the chart, whose value is that of its surround for all surfaces, of `count` slabs.
pub(super) fn beyond_chart(count: usize) -> u16 {
    count as u16 + 1
}

/// The chart pixels of one surface.
pub(super) struct Surface<'a> {
    /// Values, rows `stride` apart.
    pub(super) chart: &'a [f32],
    /// Slab numbers of the pixels.
    pub(super) slab: &'a [u16],
    /// Whether pixels of each slab number are of the surface.
    pub(super) is_of: &'a [bool],
    /// Pixels of a row.
    pub(super) stride: usize,
}

impl Surface<'_> {
    /// The value at fractions `fy`, `fx` from pixel `at` towards the next row and column, one of which four pixels is of the surface.
    pub(super) fn value(&self, interp: Interp, at: usize, fy: f32, fx: f32) -> f32 {
        let first = at - self.stride - 1;
        match interp {
            Interp::Bicubic if self.has_all::<4>(first) => bicubic(&self.chart[first..], self.stride, fy, fx),
            Interp::Bicubic => self.bicubic_at_edge(first, fy, fx, self.mean(at, fy, fx)),
            Interp::Bilinear if self.has_all::<2>(at) => bilinear(&self.chart[at..], self.stride, fy, fx),
            Interp::Bilinear => self.mean(at, fy, fx),
        }
    }

    fn has(&self, i: usize) -> bool {
        self.is_of[usize::from(self.slab[i])]
    }

    /// Whether all `N` × `N` pixels that start at `first` are of the surface.
    fn has_all<const N: usize>(&self, first: usize) -> bool {
        (0..N).all(|y| (0..N).all(|x| self.has(first + y * self.stride + x)))
    }

    fn mean(&self, at: usize, fy: f32, fx: f32) -> f32 {
        let (mut weight, mut sum) = (0.0, 0.0);
        for (y, wy) in [1.0 - fy, fy].into_iter().enumerate() {
            for (x, wx) in [1.0 - fx, fx].into_iter().enumerate() {
                let i = at + y * self.stride + x;
                if self.has(i) {
                    weight += wy * wx;
                    sum += wy * wx * self.chart[i];
                }
            }
        }
        sum / weight
    }

    fn bicubic_at_edge(&self, first: usize, fy: f32, fx: f32, mean: f32) -> f32 {
        let (wy, wx) = (cubic(fy), cubic(fx));
        let mut value = mean;
        for (y, wy) in wy.into_iter().enumerate() {
            for (x, wx) in wx.into_iter().enumerate() {
                let i = first + y * self.stride + x;
                if self.has(i) {
                    value += wy * wx * (self.chart[i] - mean);
                }
            }
        }
        value
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 6 × 7 pixels of a ramp 3 + row + 2·column, of two slabs: the right part, from column 4 on, is 1.
    fn pixels() -> (Vec<f32>, Vec<u16>) {
        let at = |i: usize| (i / 7, i % 7);
        let value = |i| 3.0 + at(i).0 as f32 + 2.0 * at(i).1 as f32;
        ((0..42).map(value).collect(), (0..42).map(|i| u16::from(at(i).1 >= 4)).collect())
    }

    #[test]
    fn inside_a_surface_the_value_is_that_of_the_chart() {
        let (chart, mut slab) = pixels();
        slab[0] = beyond_chart(2);
        let surface = Surface { chart: &chart, slab: &slab, is_of: &[true, false, false, true], stride: 7 };
        for (fy, fx) in [(0.0, 0.0), (0.25, 0.75), (0.5, 0.5)] {
            let expected = bicubic(&chart, 7, fy, fx);
            assert_eq!(surface.value(Interp::Bicubic, 8, fy, fx).to_bits(), expected.to_bits());
            let expected = bilinear(&chart[8..], 7, fy, fx);
            assert_eq!(surface.value(Interp::Bilinear, 8, fy, fx).to_bits(), expected.to_bits());
        }
    }

    #[test]
    fn values_of_other_surfaces_do_not_count() {
        let (mut chart, mut slab) = pixels();
        slab[23] = uncovered(2);
        let is_of = [true, false, false, true];
        let values = |chart: &[f32]| {
            let surface = Surface { chart, slab: &slab, is_of: &is_of, stride: 7 };
            let at = |interp, i| surface.value(interp, i, 0.25, 0.5);
            [(Interp::Bicubic, 16), (Interp::Bicubic, 17), (Interp::Bilinear, 16), (Interp::Bilinear, 17)]
                .map(|(interp, i)| at(interp, i))
        };
        let expected = values(&chart);
        // Means of the 2 × 2: pixels (2, 2), (2, 3), (3, 3) and (2, 3), (3, 3).
        let [a, b, c] = [16, 17, 24].map(|i| chart[i]);
        let means = [(0.375 * a + 0.375 * b + 0.125 * c) / 0.875, 0.75 * b + 0.25 * c];
        assert!(
            (expected[2] - means[0]).abs() < 1e-6 && (expected[3] - means[1]).abs() < 1e-6,
            "{expected:?}"
        );
        (0..42).filter(|&i| slab[i] != 0).for_each(|i| chart[i] = f32::NAN);
        assert_eq!(values(&chart).map(f32::to_bits), expected.map(f32::to_bits));
        // A uniform surface stays uniform up to its edge.
        (0..42).filter(|&i| slab[i] == 0).for_each(|i| chart[i] = 0.75);
        assert!(values(&chart).iter().all(|v| (v - 0.75).abs() < 1e-6));
    }
}
