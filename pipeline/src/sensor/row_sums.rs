//! Sums over bands of a row of pixels.
//!
//! A pixel of the first plane adds w·E of each band in f64; its corrections ([`super::crosstalk`]) add a·(w·E), the product rounded to f32 and summed in f32: 31 bands add up to within 2·10⁻⁶ of the correction. Up to [`TOGETHER`] bands are added
//! between a read and a write of a sum, which costs more than the additions; the order is that of the bands, so that bits do not depend on how many are. Weights that repeat with the mosaic are a *tile* of some
//! columns, which stays in the processor's first cache.

use std::ops::{AddAssign, Mul};

/// Bands that are added between a read and a write of a sum.
pub(super) const TOGETHER: usize = 4;
/// Numbers that are added at once.
const VECTOR: usize = 16;
/// Periods of a mosaic in a tile: whole vectors of them whatever the period.
const PERIODS: usize = 32;

/// Columns of a tile over a mosaic of a period of so many columns.
pub(super) fn tile(columns: usize) -> usize {
    PERIODS * columns
}

/// Adds to `to` the numbers of `lines` of its length, each weighed by its own of `weights`, line after line: tiles of so many columns, one for each line.
#[inline(always)]
pub(super) fn add_weighed<W, V>((weights, tile): (&[W], usize), lines: &[&[V]], to: &mut [W])
where
    W: Copy + AddAssign + Mul<Output = W>,
    V: Copy + Into<W>,
{
    for (weights, lines) in weights.chunks(TOGETHER * tile).zip(lines.chunks(TOGETHER)) {
        let of = |k: usize| (&weights[k * tile..][..tile], lines[k]);
        match lines.len() {
            1 => add([of(0)], to),
            2 => add([of(0), of(1)], to),
            3 => add([of(0), of(1), of(2)], to),
            _ => add([of(0), of(1), of(2), of(3)], to),
        }
    }
}

#[inline(always)]
fn add<W, V, const N: usize>(lines: [(&[W], &[V]); N], to: &mut [W])
where
    W: Copy + AddAssign + Mul<Output = W>,
    V: Copy + Into<W>,
{
    let tile = lines[0].0.len();
    for (part, to) in to.chunks_mut(tile).enumerate() {
        let lines = lines.map(|(weights, line)| (&weights[..to.len()], &line[part * tile..][..to.len()]));
        let (vectors, rest) = to.as_chunks_mut::<VECTOR>();
        let of = lines.map(|(weights, line)| (weights.as_chunks().0, line.as_chunks().0));
        for (k, to) in vectors.iter_mut().enumerate() {
            let mut sum = *to;
            for (weights, line) in &of {
                let (weights, line): (&[W; VECTOR], &[V; VECTOR]) = (&weights[k], &line[k]);
                for i in 0..VECTOR {
                    sum[i] += weights[i] * line[i].into();
                }
            }
            *to = sum;
        }
        let first = VECTOR * vectors.len();
        for (i, to) in rest.iter_mut().enumerate() {
            for (weights, line) in &lines {
                *to += weights[first + i] * line[first + i].into();
            }
        }
    }
}

/// Products of numbers and the weights of a tile in f32.
#[inline(always)]
pub(super) fn multiply<V: Copy + Into<f64>>(tile: &[f64], line: &[V], out: &mut [f32]) {
    for (out, line) in out.chunks_mut(tile.len()).zip(line.chunks(tile.len())) {
        for (out, (w, v)) in out.iter_mut().zip(tile.iter().zip(line)) {
            *out = (w * (*v).into()) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::lanes::Set;
    use super::*;

    /// One band after the other in the order of bands has the bits of several together, by any instructions.
    #[test]
    fn several_bands_together_have_the_bits_of_one_after_the_other() {
        let number = |k: usize| ((k * 2_654_435_761) % 1009) as f64 / 1009.0 + 1e-3;
        let (n, tile) = (211, tile(3));
        for bands in 1..=9 {
            let lines: Vec<Vec<f32>> =
                (0..bands).map(|b| (0..n).map(|i| number(b * n + i) as f32).collect()).collect();
            let weights: Vec<f64> = (0..bands * tile).map(|k| number(k / tile * 5 + k % 3 + 7)).collect();
            let factors: Vec<f32> =
                (0..bands * tile).map(|k| number(k / tile * 3 + k % 3) as f32 - 0.5).collect();
            let start: Vec<f64> = (0..n).map(number).collect();
            let mut expected = (start.clone(), vec![0.25f32; n]);
            for (b, line) in lines.iter().enumerate() {
                for (i, v) in line.iter().enumerate() {
                    let product = weights[b * tile + i % tile] * f64::from(*v);
                    expected.0[i] += product;
                    expected.1[i] += factors[b * tile + i % tile] * product as f32;
                }
            }
            for set in Set::available() {
                let lines: Vec<&[f32]> = lines.iter().map(Vec::as_slice).collect();
                let (mut to, mut corrected) = (start.clone(), vec![0.25f32; n]);
                let mut products = vec![0.0; bands * n];
                set.run(
                    #[inline(always)]
                    || {
                        add_weighed((&weights, tile), &lines, &mut to);
                        for (k, out) in products.chunks_mut(n).enumerate() {
                            multiply(&weights[k * tile..][..tile], lines[k], out);
                        }
                        let products: Vec<&[f32]> = products.chunks(n).collect();
                        add_weighed((&factors, tile), &products, &mut corrected);
                    },
                );
                assert!((to, corrected) == expected, "{bands} bands, {set:?}");
            }
        }
    }
}
