//! The corrections of crosstalk, row by row of a pass over the film.
//!
//! A pass makes the signal without crosstalk and the planes P_m for the rows and columns that a kernel reaches beyond a window, as far as the sensor goes. A pixel's sum runs over planes, then rows, then columns of the kernel, in f32 (corrections are a part of the signal): the same
//! bits for any window, blocks and threads.

use super::crosstalk::{Corrections, MAX_RADIUS};
use super::lanes::Set;
use super::stream::{Deliver, Pass};
use crate::flow::SourceSinkError;
use crate::geometry::{Rect, Size};
use crate::parts::for_each_part;
use std::convert::Infallible;
use std::ops::Range;

/// Crosstalk over the pixels of a sensor of some size.
#[derive(Clone, Debug, PartialEq)]
pub struct SpreadRows {
    size: Size,
    of: Corrections,
}

/// What is kept of the planes of a pass, the corrections last: rows of the window that is read.
struct Kept {
    first: usize,
    planes: Vec<Vec<f32>>,
}

impl SpreadRows {
    /// The corrections `of` over a sensor of `size`.
    pub fn new(size: Size, of: Corrections) -> Self {
        Self { size, of }
    }

    /// Planes of corrections.
    pub fn corrections(&self) -> usize {
        self.of.terms.len()
    }

    /// The pixels that the signal of `window` depends on.
    pub fn reach(&self, window: Rect) -> Rect {
        window.grown(self.of.radius).intersect(self.size.rect())
    }

    /// Factors of the planes of the corrections, by channel and band.
    pub fn factors(&self) -> Vec<Vec<Vec<f64>>> {
        self.of.terms.iter().map(|term| term.factors.clone()).collect()
    }

    /// The signal of the row `row` of the sensor, columns `columns`, of the planes `kept` of the window `read`.
    fn row(&self, row: usize, columns: Range<usize>, read: Rect, kept: &Kept, out: &mut [f32]) {
        let (r, side, width) = (self.of.radius, 2 * self.of.radius + 1, read.width);
        let line = |plane: usize, y: usize| {
            let at = y - read.y as usize - kept.first;
            &kept.planes[plane][at * width..][..width]
        };
        let first = columns.start - read.x as usize;
        let first_term = kept.planes.len() - self.of.terms.len();
        let mut sum = vec![0.0f32; columns.len()];
        for (m, term) in self.of.terms.iter().enumerate() {
            let plane = first_term + m;
            // Gains from the pixels at −d.
            for dy in (0..side).filter(|dy| (row + r).checked_sub(*dy).is_some_and(|y| y < self.size.height))
            {
                let from = line(plane, row + r - dy);
                // In the order of columns: backwards.
                let kernel = term.kernel[dy * side..][..side].iter().rev().map(|k| *k as f32);
                let taps = Taps { kernel: kernel.collect(), width: self.size.width };
                taps.add(from, read.x as usize, columns.clone(), &mut sum);
            }
            // What goes to the pixels at d, if they are there.
            let own = &line(plane, row)[first..][..columns.len()];
            let (low, high) = inner_columns(self.size.width, r, &columns);
            for column in (columns.start..low).chain(high..columns.end) {
                let at = column - columns.start;
                sum[at] -= self.lost(&term.kernel, row, column) * own[at];
            }
            if low < high {
                let lost = self.lost(&term.kernel, row, low);
                let inner = low - columns.start..high - columns.start;
                let (to, own) = (&mut sum[inner.clone()], &own[inner]);
                Set::detect().run(
                    #[inline(always)]
                    || std::iter::zip(&mut *to, own).for_each(|(to, v)| *to -= lost * v),
                );
            }
        }
        let signal = &line(0, row)[first..][..columns.len()];
        std::iter::zip(out, std::iter::zip(signal, &sum)).for_each(|(out, (v, change))| *out = v + change);
    }

    /// Σ_d k(d) over the pixels at d from a pixel that are on the sensor.
    fn lost(&self, kernel: &[f64], row: usize, column: usize) -> f32 {
        let (r, side) = (self.of.radius, 2 * self.of.radius + 1);
        let is_there = |at: usize, k: usize, n: usize| (at + k).checked_sub(r).is_some_and(|to| to < n);
        let there = (0..side * side).filter(|k| {
            is_there(row, k / side, self.size.height) && is_there(column, k % side, self.size.width)
        });
        there.map(|k| kernel[k]).sum::<f64>() as f32
    }
}

/// The first of `columns` whose neighbours up to `r` away are all on a sensor of `width` columns, and the one after the last.
fn inner_columns(width: usize, r: usize, columns: &Range<usize>) -> (usize, usize) {
    let low = r.clamp(columns.start, columns.end);
    (low, width.saturating_sub(r).clamp(low, columns.end))
}

/// A row of a kernel, in the order of the columns that it weighs, over a sensor of some width.
struct Taps {
    kernel: Vec<f32>,
    width: usize,
}

impl Taps {
    /// Adds to the pixels `columns` of a row, of the pixels of a row of which `from` has those from `first` on.
    fn add(&self, from: &[f32], first: usize, columns: Range<usize>, to: &mut [f32]) {
        let r = self.kernel.len() / 2;
        let (low, high) = inner_columns(self.width, r, &columns);
        for column in (columns.start..low).chain(high..columns.end) {
            let at = |k: usize| (column + k).checked_sub(r).filter(|x| *x < self.width);
            let sum = (0..self.kernel.len()).filter_map(|k| Some(self.kernel[k] * from[at(k)? - first]));
            to[column - columns.start] += sum.sum::<f32>();
        }
        if low < high {
            let from = &from[low - r - first..][..high - low + 2 * r];
            let to = &mut to[low - columns.start..][..high - low];
            Set::detect().run(
                #[inline(always)]
                || match self.kernel.len() {
                    3 => weigh::<3>(&self.kernel, from, to),
                    5 => weigh::<5>(&self.kernel, from, to),
                    _ => weigh::<{ 2 * MAX_RADIUS + 1 }>(&self.kernel, from, to),
                },
            );
        }
    }
}

/// Adds to each of `to` the `N` numbers of `from` from the same place on, weighed by `kernel`.
#[inline(always)]
fn weigh<const N: usize>(kernel: &[f32], from: &[f32], to: &mut [f32]) {
    let kernel: [f32; N] = kernel.try_into().expect("a kernel of N columns");
    for (to, from) in std::iter::zip(to, from.windows(N)) {
        *to += std::iter::zip(&kernel, from).fold(0.0, |sum, (k, v)| sum + k * v);
    }
}

/// Runs `pass`, whose window is [`SpreadRows::reach`] of `window` and whose corrections are [`SpreadRows::factors`], and delivers the rows `wanted` of `window` with crosstalk: the first plane corrected, the others as they are.
/// Returns whether it was not cancelled.
///
/// # Errors
/// As [`Pass::run`].
pub fn run(
    pass: &Pass<'_>,
    spread: &SpreadRows,
    window: Rect,
    wanted: Range<usize>,
    deliver: &mut Deliver<'_>,
) -> Result<bool, SourceSinkError> {
    let read = pass.window;
    let columns = window.x as usize..window.right() as usize;
    let first_row = window.y as usize;
    let delivered = pass.planes.len();
    // Rows of the sensor, then of the window that is read.
    let (begin, end) = (first_row + wanted.start, first_row + wanted.end);
    let last_needed = |row: usize| (row + spread.of.radius + 1).min(read.bottom() as usize);
    let from = begin.saturating_sub(spread.of.radius).max(read.y as usize) - read.y as usize;
    let to = last_needed(end - 1) - read.y as usize;
    let mut kept = Kept { first: from, planes: vec![Vec::new(); delivered + pass.corrections.len()] };
    let mut done = begin;
    let mut out = vec![Vec::new(); delivered];
    let mut passed = |first: usize, planes: &[Vec<f32>]| {
        std::iter::zip(&mut kept.planes, planes).for_each(|(kept, new)| kept.extend_from_slice(new));
        let have = read.y as usize + first + planes[0].len() / read.width;
        let ready =
            (done..end).take_while(|row| last_needed(*row) <= have).last().map_or(done, |row| row + 1);
        if ready == done {
            return Ok(());
        }
        out.iter_mut().for_each(|plane: &mut Vec<f32>| plane.resize((ready - done) * columns.len(), 0.0));
        let made: Result<(), Infallible> = for_each_part(
            pass.threads,
            out[0].chunks_mut(columns.len()).enumerate(),
            || (),
            |(), (k, line)| {
                spread.row(done + k, columns.clone(), read, &kept, line);
                Ok(())
            },
        );
        let Ok(()) = made;
        let at = (done - read.y as usize - kept.first) * read.width + columns.start - read.x as usize;
        for (out, from) in std::iter::zip(&mut out, &kept.planes).skip(1) {
            let lines = from[at..].chunks(read.width);
            std::iter::zip(out.chunks_mut(columns.len()), lines)
                .for_each(|(out, line)| out.copy_from_slice(&line[..columns.len()]));
        }
        deliver(done - first_row, &out)?;
        done = ready;
        // Rows that no later row needs.
        let needless = done.saturating_sub(spread.of.radius + read.y as usize).max(kept.first) - kept.first;
        kept.planes.iter_mut().for_each(|plane| drop(plane.drain(..needless * read.width)));
        kept.first += needless;
        Ok(())
    };
    pass.run(from..to, &mut passed)
}
