//! The signal of a sensor from a film that does not fit in memory: one pass over the film, row block by row block, all bands of a block before
//! the next block.
//!
//! The film is cut into blocks of rows and blocks of columns. A worker takes a block of columns, reads its bands one after the other, adds
//! the film rows of each sensor row with the weights of that axis, then the columns, and accumulates the bands, ascending, in f64. Sums of film
//! rows that a block leaves unfinished are carried to the next block, so every film row is read once; columns that two of these blocks need are read by
//! both, and decoded once where the source keeps decoded chunks.
//!
//! Same bits: a pixel's sum runs over film rows, then film columns, then bands, each ascending, for any blocks and threads.

use super::Sensor;
use super::field_weights::{FieldWeights, interpolated};
use super::lanes::Set;
use super::pixels::Taps;
use crate::flow::{ChartSource, SourceSinkError};
use crate::geometry::Rect;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

/// Weights of the bands of a film for each filter, and what they have in addition where they differ over the sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct BandWeights(Vec<Vec<f64>>, Option<Arc<FieldWeights>>);

impl BandWeights {
    /// Electrons per second of a mean spectral irradiance (W m⁻² nm⁻¹), times `factors`, the irradiance of a film value of 1 in each band.
    pub fn electrons(sensor: &Sensor, bands_nm: &[f64], factors: &[f64]) -> Self {
        let of = |channel| sensor.electron_weights(channel, (bands_nm, factors), 0.0);
        Self((0..sensor.channels.len()).map(of).collect(), None)
    }

    /// With those of the directions of the light, made with the same factors.
    #[must_use]
    pub fn with_field(self, field: Option<Arc<FieldWeights>>) -> Self {
        Self(self.0, field)
    }

    /// Times `factors`, by channel and band.
    #[must_use]
    pub fn times(&self, factors: &[Vec<f64>]) -> Self {
        let of = |(weights, factors): (&Vec<f64>, &Vec<f64>)| {
            std::iter::zip(weights, factors).map(|(w, f)| w * f).collect()
        };
        let field = self.1.as_ref().map(|field| Arc::new(field.times(factors)));
        Self(std::iter::zip(&self.0, factors).map(of).collect(), field)
    }

    /// The same weights behind every filter.
    pub fn uniform(sensor: &Sensor, weights: &[f64]) -> Self {
        Self(vec![weights.to_vec(); sensor.channels.len()], None)
    }
}

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
    /// Rows of a row block and columns of a column block, film pixels.
    pub block: (usize, usize),
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
    /// Nodes of each plane's field around each column.
    nodes: Vec<Vec<(usize, [f64; 4])>>,
    /// Sums over film rows of unfinished sensor rows: band, sensor row, film column.
    carry: Vec<f64>,
}

/// Buffers of a worker.
#[derive(Default)]
struct Scratch {
    film: Vec<f32>,
    sum: Vec<f64>,
    total: Vec<f64>,
    /// Weights of a band by plane, row of the mosaic and column of the column block.
    weights: Vec<f64>,
    /// Where they differ over the sensor: what they have in addition at the nodes along a row, by column of the mosaic.
    lines: Vec<Vec<f64>>,
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
            let out = self.block_of(&mut column_blocks, &block)?;
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

    /// Nodes of the field of `plane` around `columns` of the window.
    fn nodes(&self, plane: &BandWeights, columns: &Range<usize>) -> Vec<(usize, [f64; 4])> {
        let first = self.window.x as usize;
        let of = |field: &Arc<FieldWeights>| field.column_taps(columns.clone().map(|x| first + x));
        plane.1.as_ref().map_or_else(Vec::new, of)
    }

    fn block_of(
        &self,
        column_blocks: &mut [Mutex<ColumnBlock>],
        block: &Block,
    ) -> Result<Vec<Vec<f32>>, SourceSinkError> {
        let width = self.window.width;
        let out: Vec<Vec<f32>> = vec![vec![0.0; block.finished.len() * width]; self.planes.len()];
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
                                let from = &scratch.total[(plane * rows + row) * n..][..n];
                                let to = &mut to[row * width + own.start..][..n];
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
            None => Ok(out.into_inner().expect("no panic while held")),
        }
    }

    /// All bands of a column block of a row block: `scratch.total` holds the planes of the finished rows.
    fn column_block(
        &self,
        column_block: &mut ColumnBlock,
        block: &Block,
        scratch: &mut Scratch,
    ) -> Result<(), SourceSinkError> {
        let (n, across) = (column_block.columns.len(), column_block.film.len());
        let Scratch { film, sum, total, weights, lines } = scratch;
        let copies = self.rows.is_copy() && self.columns.is_copy();
        film.resize(block.film.len() * across, 0.0);
        sum.resize(across, 0.0);
        total.clear();
        total.resize(self.planes.len() * block.finished.len() * n, 0.0);
        let rect =
            Rect::new(block.film.start as i64, column_block.film.start as i64, block.film.len(), across);
        let (begun, open) = (block.begun.len(), block.open.len());
        let mut carry = vec![0.0; self.bands * open * across];
        for band in 0..self.bands {
            if band + 1 < self.bands {
                self.film.prefetch(band + 1, rect);
            }
            self.film.read(band, rect, film)?;
            self.weigh_columns(band, column_block, weights);
            for row in block.finished.start..block.open.end {
                let own = (row - block.finished.start, block.finished.len());
                if copies {
                    self.weigh_row(band, row, column_block, weights, lines);
                    let line = &film[(self.rows.range(row).start - block.film.start) * across..][..across];
                    self.add_copy(row, line, weights, own, total);
                    continue;
                }
                match row.checked_sub(block.begun.start).filter(|k| *k < begun) {
                    Some(k) => {
                        sum.copy_from_slice(&column_block.carry[(band * begun + k) * across..][..across])
                    }
                    None => sum.fill(0.0),
                }
                self.add_rows(row, block, film, sum);
                if row >= block.finished.end {
                    let k = row - block.open.start;
                    carry[(band * open + k) * across..][..across].copy_from_slice(sum);
                    continue;
                }
                self.weigh_row(band, row, column_block, weights, lines);
                self.add_columns(row, column_block, sum, weights, own, total);
            }
        }
        column_block.carry = carry;
        Ok(())
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

    /// Weights of a band for the columns of a column block: plane by plane, row by row of the mosaic.
    fn weigh_columns(&self, band: usize, column_block: &ColumnBlock, weights: &mut Vec<f64>) {
        let pattern = &self.sensor.pattern;
        let first = self.window.x as usize;
        weights.clear();
        for plane in self.planes {
            for row in 0..pattern.rows {
                let of = |x: usize| plane.0[pattern.channel(row, first + x)][band];
                weights.extend(column_block.columns.clone().map(of));
            }
        }
    }

    /// Those of row `row` of the window, where they differ over the sensor.
    fn weigh_row(
        &self,
        band: usize,
        row: usize,
        column_block: &ColumnBlock,
        weights: &mut [f64],
        lines: &mut Vec<Vec<f64>>,
    ) {
        let (pattern, n) = (&self.sensor.pattern, column_block.columns.len());
        let row = self.window.y as usize + row;
        let phase = row % pattern.rows;
        let channels = &pattern.channels[phase * pattern.columns..][..pattern.columns];
        let first = self.window.x as usize + column_block.columns.start;
        for (p, (plane, nodes)) in self.planes.iter().zip(&column_block.nodes).enumerate() {
            let Some(field) = &plane.1 else { continue };
            lines.resize_with(pattern.columns, Vec::new);
            for (line, channel) in lines.iter_mut().zip(channels) {
                field.line((*channel, band), row, line);
            }
            let to = &mut weights[(p * pattern.rows + phase) * n..][..n];
            // Column by column of the mosaic.
            for (column, line) in lines.iter().enumerate() {
                let begin = (column + pattern.columns - first % pattern.columns) % pattern.columns;
                let uniform = plane.0[channels[column]][band];
                let own = to.iter_mut().zip(nodes).skip(begin).step_by(pattern.columns);
                own.for_each(|(to, taps)| *to = uniform + interpolated(line, taps));
            }
        }
    }

    /// Weights and totals of a sensor row in each plane.
    fn of_row<'t>(
        &self,
        row: usize,
        weights: &'t [f64],
        (own, rows): (usize, usize),
        total: &'t mut [f64],
    ) -> impl Iterator<Item = (&'t [f64], &'t mut [f64])> + use<'t> {
        let n = weights.len() / (self.planes.len() * self.sensor.pattern.rows);
        let (period, phase) =
            (self.sensor.pattern.rows, (self.window.y as usize + row) % self.sensor.pattern.rows);
        let by_plane = weights.chunks(period * n).map(move |w| &w[phase * n..][..n]);
        std::iter::zip(by_plane, total.chunks_mut(rows * n).map(move |t| &mut t[own * n..][..n]))
    }

    /// Adds a band of a sensor row that is a film row.
    fn add_copy(&self, row: usize, line: &[f32], weights: &[f64], own: (usize, usize), total: &mut [f64]) {
        for (weights, to) in self.of_row(row, weights, own, total) {
            Set::detect().run(
                #[inline(always)]
                || add_weighed(weights, line, to),
            );
        }
    }

    /// Adds a band of a sensor row, summed over film rows, to the totals of all planes.
    fn add_columns(
        &self,
        row: usize,
        column_block: &ColumnBlock,
        sum: &[f64],
        weights: &[f64],
        own: (usize, usize),
        total: &mut [f64],
    ) {
        for (weights, to) in self.of_row(row, weights, own, total) {
            for (i, (to, weight)) in std::iter::zip(to, weights).enumerate() {
                let (at, taps) = self.columns.of(column_block.columns.start + i);
                let part = &sum[at - column_block.film.start..][..taps.len()];
                *to += weight * std::iter::zip(taps, part).fold(0.0, |s, (w, v)| s + w * v);
            }
        }
    }
}

/// Adds the numbers of `line`, each weighed by its own of `weights`.
#[inline(always)]
fn add_weighed(weights: &[f64], line: &[f32], to: &mut [f64]) {
    for (to, (w, v)) in std::iter::zip(to, std::iter::zip(weights, line)) {
        *to += w * f64::from(*v);
    }
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
