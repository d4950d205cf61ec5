//! The signal of a sensor from a film that does not fit in memory: one pass over the film, row block by row block, all bands of a block before
//! the next block.
//!
//! The film is cut into blocks of rows and blocks of columns. A worker takes a block of columns, reads a few of its bands, adds
//! the film rows of each sensor row with the weights of that axis, then the columns, and accumulates the bands, ascending, in f64 (`row_sums`). Sums of film
//! rows that a block leaves unfinished are carried to the next block, so every film row is read once; columns that two of these blocks need are read by
//! both, and decoded once where the source keeps decoded chunks.
//!
//! Same bits: a pixel's sum runs over film rows, then film columns, then bands, each ascending, for any blocks and threads.

use super::Sensor;
use super::field_sums::{Columns, RowNodes};
use super::lanes::Set;
use super::pixels::Taps;
use super::row_sums::{add_to_planes, add_weighed, factor_tile, multiply, tile};
use crate::flow::{ChartSource, SourceSinkError};
use crate::geometry::Rect;
use std::ops::Range;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
pub use weights::BandWeights;

mod weights;

/// A pass over the film and its outputs.
#[derive(Clone, Copy)]
pub struct Pass<'a> {
    /// The film.
    pub film: &'a dyn ChartSource,
    /// Its bands.
    pub bands: usize,
    /// The sensor: its mosaic.
    pub sensor: &'a Sensor,
    /// Film rows of each row of `window`.
    pub rows: &'a Taps,
    /// Film columns of each column of `window`.
    pub columns: &'a Taps,
    /// Pixels to compute, in sensor coordinates.
    pub window: Rect,
    /// One plane of output for each.
    pub planes: &'a [BandWeights],
    /// Of each further plane of output the factors of the terms of the first one, by channel and band.
    pub corrections: &'a [Vec<Vec<f64>>],
    /// Rows of a row block and columns of a column block, film pixels.
    pub block: (usize, usize),
    /// Bands of a block that are read before they are added.
    pub bands_at_once: usize,
    /// Worker threads.
    pub threads: usize,
    /// Ends the pass after the current block.
    pub cancel: &'a AtomicBool,
}

/// Columns that one worker computes at a time.
struct ColumnBlock {
    /// Columns of the window.
    columns: Range<usize>,
    /// Film columns in their sums.
    film: Range<usize>,
    /// By plane: the nodes of its weights around them, where these differ over the sensor.
    nodes: Vec<Option<Columns>>,
    /// Sums over film rows of unfinished sensor rows: band, sensor row, film column.
    carry: Vec<f64>,
}

/// Buffers of a worker.
#[derive(Default)]
struct Scratch {
    /// The block by band.
    film: Vec<f32>,
    sum: Vec<f64>,
    /// Means over the pixels of a row by band.
    means: Vec<f64>,
    /// Planes of the finished rows, and those of corrections.
    total: Vec<f64>,
    corrected: Vec<f32>,
    /// Weights by plane: by row of the mosaic, band and column of a tile.
    weights: Vec<Vec<f64>>,
    /// Factors of corrections by row of the mosaic, correction and band: tiles of the columns.
    factors: Vec<f32>,
    /// Terms of a row in the first plane by band.
    products: Vec<f32>,
    /// Weights of a row by plane, where they differ over the sensor.
    fields: Vec<RowNodes>,
}

/// Rows that a pass delivers: the first (of the window), and for each plane their pixels.
pub type Deliver<'a> = dyn FnMut(usize, &[Vec<f32>]) -> Result<(), SourceSinkError> + 'a;

impl Pass<'_> {
    /// Computes the rows `wanted` of the window and delivers them in order, a few at a time. Returns whether it was not cancelled.
    ///
    /// # Errors
    /// The film cannot be read; an error of `deliver`.
    pub fn run(&self, wanted: Range<usize>, deliver: &mut Deliver<'_>) -> Result<bool, SourceSinkError> {
        let film_rows = self.rows.span(wanted.clone());
        let mut column_blocks: Vec<Mutex<ColumnBlock>> = self.column_blocks();
        let planes = self.planes.len() + self.corrections.len();
        let mut out = vec![Vec::new(); planes];
        let mut first = film_rows.start;
        let mut done = wanted.start;
        let mut open = wanted.start..wanted.start;
        while first < film_rows.end {
            if self.cancel.load(Ordering::Relaxed) {
                return Ok(false);
            }
            let end = ((first / self.block.0 + 1) * self.block.0).min(film_rows.end);
            // Sensor rows that end in this block, and those that begin in it or before and do not end.
            let finished = (done..wanted.end)
                .take_while(|&i| self.rows.range(i).end <= end)
                .last()
                .map_or(done, |i| i + 1);
            let after = (finished..wanted.end).take_while(|&i| self.rows.range(i).start < end).last();
            let now_open = finished..after.map_or(finished, |i| i + 1);
            let block = Block {
                film: first..end,
                begun: open.clone(),
                finished: done..finished,
                open: now_open.clone(),
            };
            self.block_of(&mut column_blocks, &block, &mut out)?;
            if finished > done {
                deliver(done, &out)?;
            }
            (first, done, open) = (end, finished, now_open);
        }
        Ok(true)
    }

    fn column_blocks(&self) -> Vec<Mutex<ColumnBlock>> {
        let mut column_blocks = Vec::new();
        let mut x = 0;
        while x < self.window.width {
            // The columns that begin in one column block of the film.
            let of = |x: usize| self.columns.range(x).start / self.block.1;
            let own = of(x);
            let end = (x..self.window.width).take_while(|&x| of(x) == own).last().map_or(x, |x| x) + 1;
            let columns = x..end;
            column_blocks.push(Mutex::new(ColumnBlock {
                film: self.columns.span(columns.clone()),
                nodes: self.planes.iter().map(|plane| self.nodes(plane, &columns)).collect(),
                columns,
                carry: Vec::new(),
            }));
            x = end;
        }
        column_blocks
    }

    /// Writes the finished rows of a block to the planes `out`.
    fn block_of(
        &self,
        column_blocks: &mut [Mutex<ColumnBlock>],
        block: &Block,
        out: &mut [Vec<f32>],
    ) -> Result<(), SourceSinkError> {
        let width = self.window.width;
        let planes = self.planes.len();
        out.iter_mut().for_each(|plane| plane.resize(block.finished.len() * width, 0.0));
        let out = Mutex::new(out);
        let (next, failed) = (AtomicUsize::new(0), Mutex::new(None));
        let column_blocks = &*column_blocks;
        let work = || {
            let mut scratch = Scratch::default();
            while let Some(column_block) = column_blocks.get(next.fetch_add(1, Ordering::Relaxed)) {
                let mut column_block = column_block.lock().expect("no panic while held");
                match self.column_block(&mut column_block, block, &mut scratch) {
                    Ok(()) => {
                        let mut out = out.lock().expect("no panic while held");
                        let (own, n) = (&column_block.columns, column_block.columns.len());
                        let rows = block.finished.len();
                        for (plane, to) in out.iter_mut().enumerate() {
                            for row in 0..rows {
                                let to = &mut to[row * width + own.start..][..n];
                                if let Some(plane) = plane.checked_sub(planes) {
                                    to.copy_from_slice(&scratch.corrected[(plane * rows + row) * n..][..n]);
                                    continue;
                                }
                                let from = &scratch.total[(plane * rows + row) * n..][..n];
                                std::iter::zip(to, from).for_each(|(to, v)| *to = *v as f32);
                            }
                        }
                    }
                    Err(e) => {
                        next.store(column_blocks.len(), Ordering::Relaxed);
                        failed.lock().expect("no panic while held").get_or_insert(e);
                    }
                }
            }
        };
        std::thread::scope(|s| (0..self.threads.min(column_blocks.len())).for_each(|_| drop(s.spawn(work))));
        match failed.into_inner().expect("no panic while held") {
            Some(e) => Err(e),
            None => Ok(()),
        }
    }

    /// All bands of a column block of a row block: `scratch` holds the planes of the finished rows.
    fn column_block(
        &self,
        column_block: &mut ColumnBlock,
        block: &Block,
        scratch: &mut Scratch,
    ) -> Result<(), SourceSinkError> {
        let (n, across, rows) = (column_block.columns.len(), column_block.film.len(), block.finished.len());
        let together = self.bands_at_once.clamp(1, self.bands.max(1));
        let area = block.film.len() * across;
        scratch.film.resize(together * area, 0.0);
        scratch.total.clear();
        scratch.total.resize(self.planes.len() * rows * n, 0.0);
        scratch.corrected.clear();
        scratch.corrected.resize(self.corrections.len() * rows * n, 0.0);
        let mut carry = vec![0.0; self.bands * block.open.len() * across];
        for first in (0..self.bands).step_by(together) {
            let bands = first..(first + together).min(self.bands);
            self.read(bands.clone(), column_block, block, &mut scratch.film)?;
            self.weigh_columns(&bands, column_block, &mut scratch.weights);
            self.factors(bands.clone(), column_block, &mut scratch.factors);
            self.add_bands(bands, column_block, block, scratch, &mut carry);
        }
        column_block.carry = carry;
        Ok(())
    }

    /// The film pixels of a column block of a row block, band after band.
    fn read(
        &self,
        bands: Range<usize>,
        column_block: &ColumnBlock,
        block: &Block,
        film: &mut [f32],
    ) -> Result<(), SourceSinkError> {
        let (down, across) = (&block.film, &column_block.film);
        let rect = Rect::new(down.start as i64, across.start as i64, down.len(), across.len());
        for (band, film) in bands.zip(film.chunks_mut(rect.size().pixels())) {
            if band + 1 < self.bands {
                self.film.prefetch(band + 1, rect);
            }
            self.film.read(band, rect, film)?;
        }
        Ok(())
    }

    /// Adds bands that were read to the rows of a block.
    fn add_bands(
        &self,
        bands: Range<usize>,
        column_block: &ColumnBlock,
        block: &Block,
        scratch: &mut Scratch,
        carry: &mut [f64],
    ) {
        let Scratch { film, sum, means, total, corrected, weights, factors, products, fields } = scratch;
        let (n, across) = (column_block.columns.len(), column_block.film.len());
        let (begun, open) = (block.begun.len(), block.open.len());
        let area = block.film.len() * across;
        let copies = self.rows.is_copy() && self.columns.is_copy();
        sum.resize(across, 0.0);
        means.resize(bands.len() * n, 0.0);
        for row in block.finished.start..block.open.end {
            let finished = row < block.finished.end;
            if finished {
                self.weigh_row(&bands, row, column_block, fields);
            }
            let nodes = &column_block.nodes;
            let mut add = RowAdder { weights, nodes, fields, factors, products, total, corrected };
            let own = (row - block.finished.start, block.finished.len());
            if copies {
                let first = (self.rows.range(row).start - block.film.start) * across;
                let of = |k: usize| &film[k * area + first..][..across];
                let lines: Vec<&[f32]> = (0..bands.len()).map(of).collect();
                self.add_row(row, &lines, own, &mut add);
                continue;
            }
            for (k, band) in bands.clone().enumerate() {
                match row.checked_sub(block.begun.start).filter(|k| *k < begun) {
                    Some(k) => {
                        sum.copy_from_slice(&column_block.carry[(band * begun + k) * across..][..across])
                    }
                    None => sum.fill(0.0),
                }
                self.add_rows(row, block, &film[k * area..][..area], sum);
                if finished {
                    self.add_columns(column_block, sum, &mut means[k * n..][..n]);
                } else {
                    let place = band * open + row - block.open.start;
                    carry[place * across..][..across].copy_from_slice(sum);
                }
            }
            if finished {
                let lines: Vec<&[f64]> = means.chunks(n).collect();
                self.add_row(row, &lines, own, &mut add);
            }
        }
    }

    /// Adds the film rows of the block in the sum of sensor row `row` of the window.
    fn add_rows(&self, row: usize, block: &Block, film: &[f32], sum: &mut [f64]) {
        let (first, weights) = self.rows.of(row);
        for (k, weight) in weights.iter().enumerate() {
            let y = first + k;
            if block.film.contains(&y) {
                let line = &film[(y - block.film.start) * sum.len()..][..sum.len()];
                Set::detect().run(
                    #[inline(always)]
                    || std::iter::zip(&mut *sum, line).for_each(|(s, v)| *s += weight * f64::from(*v)),
                );
            }
        }
    }

    /// Adds bands of a sensor row to the totals of all planes, which have `rows` rows of which it is the `own`.
    fn add_row<V: Copy + Into<f64>>(
        &self,
        row: usize,
        lines: &[&[V]],
        (own, rows): (usize, usize),
        add: &mut RowAdder<'_>,
    ) {
        let (pattern, n, bands) = (&self.sensor.pattern, lines[0].len(), lines.len());
        let phase = (self.window.y as usize + row) % pattern.rows;
        let tile = tile(pattern.columns);
        if !self.corrections.is_empty() {
            add.products.resize(bands * n, 0.0);
        }
        for plane in 0..self.planes.len() {
            let to = &mut add.total[(plane * rows + own) * n..][..n];
            // The corrections are those of the first plane.
            let products = if plane == 0 { &mut add.products[..] } else { &mut [] };
            if let Some(columns) = &add.nodes[plane] {
                let row = &add.fields[plane];
                Set::detect().run(
                    #[inline(always)]
                    || columns.add(row, lines, to, products),
                );
                continue;
            }
            let weights = self.row_weights(&add.weights[plane], phase, bands);
            Set::detect().run(
                #[inline(always)]
                || add_weighed((weights, tile), lines, to),
            );
            for ((weights, line), out) in weights.chunks(tile).zip(lines).zip(products.chunks_mut(n)) {
                Set::detect().run(
                    #[inline(always)]
                    || multiply(weights, line, out),
                );
            }
        }
        if self.corrections.is_empty() {
            return;
        }
        let products: Vec<&[f32]> = add.products.chunks(n).collect();
        let tile = factor_tile(pattern.columns);
        let of_row = self.corrections.len() * bands * tile;
        let factors = &add.factors[phase * of_row..][..of_row];
        let planes = add.corrected.chunks_mut(rows * n).map(|plane| &mut plane[own * n..][..n]);
        let mut planes: Vec<&mut [f32]> = planes.collect();
        Set::detect().run(
            #[inline(always)]
            || add_to_planes((factors, tile), &products, &mut planes),
        );
    }

    /// Means over the pixels of a row from its sums over film rows.
    fn add_columns(&self, column_block: &ColumnBlock, sum: &[f64], means: &mut [f64]) {
        for (i, mean) in means.iter_mut().enumerate() {
            let (at, taps) = self.columns.of(column_block.columns.start + i);
            let part = &sum[at - column_block.film.start..][..taps.len()];
            *mean = std::iter::zip(taps, part).fold(0.0, |s, (w, v)| s + w * v);
        }
    }
}

/// Weights and totals of a row.
struct RowAdder<'a> {
    weights: &'a [Vec<f64>],
    nodes: &'a [Option<Columns>],
    fields: &'a [RowNodes],
    factors: &'a [f32],
    products: &'a mut Vec<f32>,
    total: &'a mut [f64],
    corrected: &'a mut [f32],
}

/// A block of film rows and what it does to rows of the window.
struct Block {
    film: Range<usize>,
    /// Rows whose sums are carried to the next block.
    begun: Range<usize>,
    /// Rows that end here.
    finished: Range<usize>,
    /// Rows that have begun when the block ends.
    open: Range<usize>,
}

#[cfg(test)]
pub(crate) mod tests;
