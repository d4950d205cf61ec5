//! The transpose of adding a layer to a film: the light of the film's pixels on the coefficients that they read.

use super::{BinGrid, REACH, Taps};
use crate::buffer::zeros;
use crate::parts::for_each_part;
use std::convert::Infallible;

/// Rows that a thread computes at a time.
const ROWS: usize = 32;

/// The sums over the pixels of `film` (row-major, of the film of `grid`) times their weights of each coefficient on `grid`, by [`Layer::add`](super::Layer::add) with `taps`, row by
/// row. Sums in f64, the same for any number of `threads`.
pub(crate) fn coefficients_of_film(grid: &BinGrid, taps: Taps, film: &[f32], threads: usize) -> Vec<f32> {
    let (bin, weights) = (grid.bin_px, taps.of_bin(grid.bin_px));
    let width = grid.size().width;
    // First of the four coefficients of a pixel.
    let first = |pixel: usize| grid.index((pixel / bin) as i64) - REACH + usize::from(pixel % bin >= bin / 2);
    let weight = |tap: usize, pixel: usize| f64::from(weights[tap][pixel % bin]);
    // Along the rows, then down.
    let mut across = zeros(grid.film.height * width);
    in_rows(threads, across.chunks_mut(ROWS * width), |part, rows| {
        let film = film[part * ROWS * grid.film.width..].chunks_exact(grid.film.width);
        let mut sums = vec![0.0; width];
        for (to, film) in rows.chunks_exact_mut(width).zip(film) {
            sums.fill(0.0);
            for (x, v) in film.iter().enumerate() {
                for (tap, sum) in sums[first(x)..][..4].iter_mut().enumerate() {
                    *sum += weight(tap, x) * f64::from(*v);
                }
            }
            to.iter_mut().zip(&sums).for_each(|(to, v)| *to = *v as f32);
        }
    });
    let mut out = zeros(grid.size().pixels());
    in_rows(threads, out.chunks_mut(width), |row, to| {
        // Pixels that read this row: those of two bins before it and two behind.
        let bin_row = row as i64 - grid.margin as i64;
        let edge = |bins: i64| ((bin_row + bins).max(0) as usize * bin).min(grid.film.height);
        let mut sums = vec![0.0; width];
        for y in edge(-2)..edge(3) {
            let Some(tap) = row.checked_sub(first(y)).filter(|tap| *tap < 4) else { continue };
            for (sum, v) in sums.iter_mut().zip(&across[y * width..]) {
                *sum += weight(tap, y) * f64::from(*v);
            }
        }
        to.iter_mut().zip(&sums).for_each(|(to, v)| *to = *v as f32);
    });
    out
}

/// Passes each of `parts` and its number to `each`, on `threads` threads.
fn in_rows<'a>(
    threads: usize,
    parts: impl Iterator<Item = &'a mut [f32]> + Send,
    each: impl Fn(usize, &mut [f32]) + Sync,
) {
    let done: Result<(), Infallible> = for_each_part(
        threads,
        parts.enumerate(),
        || (),
        |(), (part, rows)| {
            each(part, rows);
            Ok(())
        },
    );
    let Ok(()) = done;
}
