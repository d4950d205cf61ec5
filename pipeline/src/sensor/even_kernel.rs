//! Kernels that are the same for ±d down and for ±d right, as those of charge that diffuses: pixels with the same weight are added first.
//!
//! ```text
//! Σ_i Σ_j k(i, j) (P(−i, −j) + P(i, −j) + P(−i, j) + P(i, j)),  0 ≤ i, j ≤ r        at i = 0 and j = 0 without those that are the same
//! ```
//! Its own weight is minus the sum of the others: what a pixel gets from its neighbours less what they get from it. Of 7 × 7 pixels a third of the products of the plain sum.

/// Largest radius of a kernel.
pub(super) const LARGEST: usize = 3;
/// Largest difference of weights that count as the same: rounding.
const SAME: f64 = 1e-12;

/// An even kernel without sum.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct EvenKernel {
    radius: usize,
    /// k(i, j), row by row.
    quadrant: Vec<f32>,
}

impl EvenKernel {
    /// That of the weights `kernel` of (2r + 1)² pixels, row by row, 0 for the pixel itself; none if it is not even.
    pub(super) fn of(kernel: &[f64], radius: usize) -> Option<Self> {
        let side = 2 * radius + 1;
        let at = |i: usize, j: usize| kernel[i * side + j];
        let is_even = (0..side * side).all(|k| {
            let (i, j) = (k / side, k % side);
            (at(i, j) - at(side - 1 - i, j)).abs() <= SAME && (at(i, j) - at(i, side - 1 - j)).abs() <= SAME
        });
        let mut quadrant: Vec<f32> = (radius..side)
            .flat_map(|i| (radius..side).map(move |j| (i, j)))
            .map(|(i, j)| at(i, j) as f32)
            .collect();
        quadrant[0] = -kernel.iter().sum::<f64>() as f32;
        is_even.then_some(Self { radius, quadrant })
    }

    /// Adds the weighed pixels to `to`: `lines` are the rows i above and below, from the column r before the first of `to` on. `folded` is scratch.
    #[inline(always)]
    pub(super) fn add<'a>(
        &self,
        lines: impl Fn(usize) -> [&'a [f32]; 2],
        folded: &mut Vec<f32>,
        to: &mut [f32],
    ) {
        let n = to.len() + 2 * self.radius;
        for (i, weights) in self.quadrant.chunks(self.radius + 1).enumerate() {
            let [above, below] = lines(i);
            let mut from = &above[..n];
            if i > 0 {
                folded.clear();
                folded.extend(from.iter().zip(&below[..n]).map(|(a, b)| a + b));
                from = folded;
            }
            match self.radius {
                1 => weigh::<1>(weights, from, to),
                2 => weigh::<2>(weights, from, to),
                _ => weigh::<LARGEST>(weights, from, to),
            }
        }
    }
}

/// Adds to each of `to` the 2 R + 1 numbers of `from` from the same place on, weighed by their distance from the middle.
#[inline(always)]
fn weigh<const R: usize>(weights: &[f32], from: &[f32], to: &mut [f32]) {
    for (to, from) in std::iter::zip(to, from.windows(2 * R + 1)) {
        *to += (1..=R).fold(weights[0] * from[R], |sum, j| sum + weights[j] * (from[R - j] + from[R + j]));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_those_of_all_weights() {
        for radius in [1, 2, 3] {
            let (side, width) = (2 * radius + 1, 23);
            let at = |k: usize| {
                let d = |i: usize| i.abs_diff(radius) as f64;
                let (i, j) = (d(k / side), d(k % side));
                if i + j == 0.0 { 0.0 } else { 0.01 / (1.0 + i * i + 2.0 * j * j) }
            };
            let mut kernel: Vec<f64> = (0..side * side).map(at).collect();
            let even = EvenKernel::of(&kernel, radius).unwrap();
            let pixels: Vec<f32> = (0..side * width).map(|k| ((k * 37) % 101) as f32).collect();
            let line = |i: usize| &pixels[i * width..][..width];
            let mut found = vec![1.0; width - 2 * radius];
            even.add(|i| [line(radius - i), line(radius + i)], &mut Vec::new(), &mut found);
            for (x, found) in found.iter().enumerate() {
                let own = f64::from(line(radius)[x + radius]);
                let term = |k: usize| kernel[k] * (f64::from(line(k / side)[x + k % side]) - own);
                let expected = 1.0 + (0..side * side).map(term).sum::<f64>();
                assert!((f64::from(*found) - expected).abs() < 1e-4, "{radius} {x}: {found} {expected}");
            }
            kernel[1] += 1e-9;
            assert_eq!(EvenKernel::of(&kernel, radius), None);
        }
    }
}
