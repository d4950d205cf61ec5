//! Sums over bands of a row of pixels.
//!
//! A pixel of the first plane adds w·E of each band in f64; its corrections ([`super::crosstalk`]) add a·(w·E), the product rounded to f32 and summed in f32: 31 bands add up to within 2·10⁻⁶ of the correction. Up to [`TOGETHER`] bands are added
//! between a read and a write of a sum, which costs more than the additions; the order is that of the bands, so that bits do not depend on how many are. Weights that repeat with the mosaic are a *tile* of some
//! columns, which stays in the processor's first cache.

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
pub(super) fn add_weighed<V: Copy + Into<f64>>(
    (weights, tile): (&[f64], usize),
    lines: &[&[V]],
    to: &mut [f64],
) {
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
fn add<V: Copy + Into<f64>, const N: usize>(lines: [(&[f64], &[V]); N], to: &mut [f64]) {
    let tile = lines[0].0.len();
    for (part, to) in to.chunks_mut(tile).enumerate() {
        let mut lines = lines;
        for (weights, line) in &mut lines {
            (*weights, *line) = (&weights[..to.len()], &line[part * tile..][..to.len()]);
        }
        let (vectors, rest) = to.as_chunks_mut::<VECTOR>();
        for (k, to) in vectors.iter_mut().enumerate() {
            let mut sum = *to;
            for (weights, line) in &lines {
                let (weights, line): (&[f64; VECTOR], &[V; VECTOR]) =
                    (&weights.as_chunks().0[k], &line.as_chunks().0[k]);
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

/// Columns of a tile of factors over a mosaic of a period of so many columns.
pub(super) fn factor_tile(columns: usize) -> usize {
    columns * (VECTOR >> columns.trailing_zeros().min(VECTOR.trailing_zeros()))
}

/// Adds to each of the planes `to` the numbers of `lines` of their length, each weighed by its own factor of that plane, line after line: tiles of so many columns, plane by plane and line by line.
#[inline(always)]
pub(super) fn add_to_planes((factors, tile): (&[f32], usize), lines: &[&[f32]], to: &mut [&mut [f32]]) {
    let of_plane = lines.len() * tile;
    let (some, rest) = to.as_chunks_mut::<TOGETHER>();
    let (of_some, of_rest) = factors.split_at(TOGETHER * some.len() * of_plane);
    for (k, to) in some.iter_mut().enumerate() {
        add_to_some((&of_some[TOGETHER * k * of_plane..], tile), lines, to);
    }
    for (k, to) in rest.iter_mut().enumerate() {
        add_to_some((&of_rest[k * of_plane..], tile), lines, std::array::from_mut(to));
    }
}

/// Adds to `M` planes: a number of a line is read once for all of them.
#[inline(always)]
fn add_to_some<const M: usize>((factors, tile): (&[f32], usize), lines: &[&[f32]], to: &mut [&mut [f32]; M]) {
    let (n, of_plane) = (to[0].len(), lines.len() * tile);
    let whole = n - n % VECTOR;
    let mut at = 0;
    for begin in (0..whole).step_by(VECTOR) {
        let mut sums = [[0.0; VECTOR]; M];
        sums.iter_mut().zip(&*to).for_each(|(sum, to)| sum.copy_from_slice(&to[begin..][..VECTOR]));
        for (k, line) in lines.iter().enumerate() {
            let line = &line[begin..][..VECTOR];
            for (m, sum) in sums.iter_mut().enumerate() {
                let factors = &factors[m * of_plane + k * tile + at..][..VECTOR];
                for i in 0..VECTOR {
                    sum[i] += factors[i] * line[i];
                }
            }
        }
        sums.iter().zip(&mut *to).for_each(|(sum, to)| to[begin..][..VECTOR].copy_from_slice(sum));
        at = if at + VECTOR == tile { 0 } else { at + VECTOR };
    }
    for (m, to) in to.iter_mut().enumerate() {
        for (k, line) in lines.iter().enumerate() {
            for i in whole..n {
                to[i] += factors[m * of_plane + k * tile + at + i - whole] * line[i];
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

    const PLANES: usize = 6;

    /// One band after the other in the order of bands has the bits of several together, by any instructions.
    #[test]
    fn several_bands_together_have_the_bits_of_one_after_the_other() {
        let number = |k: usize| ((k * 2_654_435_761) % 1009) as f64 / 1009.0 + 1e-3;
        let (n, tile) = (211, tile(3));
        for bands in 1..=9 {
            let lines: Vec<Vec<f32>> =
                (0..bands).map(|b| (0..n).map(|i| number(b * n + i) as f32).collect()).collect();
            let weights: Vec<f64> = (0..bands * tile).map(|k| number(k / tile * 5 + k % 3 + 7)).collect();
            let factor = |plane: usize, b: usize, i: usize| number(plane * 41 + b * 3 + i % 3) as f32 - 0.5;
            let of_planes = (0..PLANES).flat_map(|plane| (0..bands).map(move |b| (plane, b)));
            let factors: Vec<f32> = of_planes
                .flat_map(|(plane, b)| (0..factor_tile(3)).map(move |i| factor(plane, b, i)))
                .collect();
            let start: Vec<f64> = (0..n).map(number).collect();
            let mut expected = (start.clone(), [0.25f32; PLANES].map(|v| vec![v; n]));
            for (b, line) in lines.iter().enumerate() {
                for (i, v) in line.iter().enumerate() {
                    let product = weights[b * tile + i % tile] * f64::from(*v);
                    expected.0[i] += product;
                    for (plane, to) in expected.1.iter_mut().enumerate() {
                        to[i] += factor(plane, b, i) * product as f32;
                    }
                }
            }
            for set in Set::available() {
                let lines: Vec<&[f32]> = lines.iter().map(Vec::as_slice).collect();
                let (mut to, mut corrected) = (start.clone(), [0.25f32; PLANES].map(|v| vec![v; n]));
                let mut products = vec![0.0; bands * n];
                set.run(
                    #[inline(always)]
                    || {
                        add_weighed((&weights, tile), &lines, &mut to);
                        for (k, out) in products.chunks_mut(n).enumerate() {
                            multiply(&weights[k * tile..][..tile], lines[k], out);
                        }
                        let products: Vec<&[f32]> = products.chunks(n).collect();
                        let mut planes = corrected.each_mut().map(Vec::as_mut_slice);
                        add_to_planes((&factors, factor_tile(3)), &products, &mut planes);
                    },
                );
                assert!((to, corrected) == expected, "{bands} bands, {set:?}");
            }
        }
    }
}
