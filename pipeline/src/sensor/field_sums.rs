//! Sums over bands of a row of pixels where the weights of bands differ over the sensor ([`super::field_weights`]).
//!
//! ```text
//! sum += (w + ((a₀n₀ + a₁n₁) + (a₂n₂ + a₃n₃))) E      of each band, in f64
//! ```
//! w: for perpendicular light; n: what is added at the four nodes around the pixel, along its row; a: weights of its column, alike for all bands. The columns between the same nodes are a *cell*. Vectors of columns
//! begin at multiples of their length; one that two cells share is computed for both. The weights of pixels are not kept: with 31 bands a row of them would leave the processor's first caches.

use super::field_weights::FieldWeights;
use super::row_sums::TOGETHER;
use std::ops::Range;

/// Columns that are computed at once.
const VECTOR: usize = 8;
type Vector = [f64; VECTOR];

/// Columns of a part of a sensor: the nodes around them and their weights.
pub(super) struct Columns {
    /// The first of four nodes, and the columns between them.
    cells: Vec<(usize, Range<usize>)>,
    /// Of the four nodes, vector by vector; 0 after the last column.
    weights: Vec<[Vector; 4]>,
}

impl Columns {
    /// Columns with the first of their four nodes, and the weights of these.
    pub(super) fn new(taps: impl ExactSizeIterator<Item = (usize, [f64; 4])>) -> Self {
        let mut weights = vec![[[0.0; VECTOR]; 4]; taps.len().div_ceil(VECTOR)];
        let mut cells: Vec<(usize, Range<usize>)> = Vec::new();
        for (i, (first, of_nodes)) in taps.enumerate() {
            match cells.last_mut() {
                Some((node, columns)) if *node == first => columns.end = i + 1,
                _ => cells.push((first, i..i + 1)),
            }
            let vector = &mut weights[i / VECTOR];
            vector.iter_mut().zip(of_nodes).for_each(|(vector, weight)| vector[i % VECTOR] = weight);
        }
        Self { cells, weights }
    }

    /// The nodes around them.
    fn nodes(&self) -> Range<usize> {
        let (first, last) = (self.cells.first(), self.cells.last());
        first.map_or(0, |cell| cell.0)..last.map_or(0, |cell| cell.0 + 4)
    }

    /// Adds the bands of `row` to `sums`, `lines` of its length, and leaves the terms of each band in `terms`, one after the other, unless it is empty.
    #[inline(always)]
    pub(super) fn add<V: Copy + Into<f64>>(
        &self,
        row: &RowNodes,
        lines: &[&[V]],
        sums: &mut [f64],
        terms: &mut [f32],
    ) {
        for first in (0..lines.len()).step_by(TOGETHER) {
            match lines.len() - first {
                1 => self.add_some::<V, 1>(row, (first, lines), sums, terms),
                2 => self.add_some::<V, 2>(row, (first, lines), sums, terms),
                3 => self.add_some::<V, 3>(row, (first, lines), sums, terms),
                _ => self.add_some::<V, TOGETHER>(row, (first, lines), sums, terms),
            }
        }
    }

    /// Adds `N` bands from `first` on.
    #[inline(always)]
    fn add_some<V: Copy + Into<f64>, const N: usize>(
        &self,
        row: &RowNodes,
        (first, lines): (usize, &[&[V]]),
        sums: &mut [f64],
        terms: &mut [f32],
    ) {
        for (node, columns) in &self.cells {
            let vectors = columns.start / VECTOR..columns.end.div_ceil(VECTOR);
            // Vectors of the same columns of the mosaic have the same weights.
            for phase in vectors.start..vectors.end.min(vectors.start + row.period) {
                let mut weights = [row.at(first, phase, *node); N];
                for (k, weights) in weights.iter_mut().enumerate().skip(1) {
                    *weights = row.at(first + k, phase, *node);
                }
                for vector in (phase..vectors.end).step_by(row.period) {
                    let begin = vector * VECTOR;
                    let lanes = columns.start.max(begin) - begin..columns.end.min(begin + VECTOR) - begin;
                    self.add_vector((vector, lanes), &weights, (first, lines), sums, terms);
                }
            }
        }
    }

    /// Adds the bands from `first` on, of `weights` for perpendicular light and at the nodes, to the columns `lanes` of a vector.
    #[inline(always)]
    fn add_vector<V: Copy + Into<f64>, const N: usize>(
        &self,
        (vector, lanes): (usize, Range<usize>),
        weights: &[(&Vector, &[Vector; 4]); N],
        (first, lines): (usize, &[&[V]]),
        sums: &mut [f64],
        terms: &mut [f32],
    ) {
        let (n, begin, of_columns) = (sums.len(), vector * VECTOR, &self.weights[vector]);
        if lanes.len() < VECTOR {
            let count = VECTOR.min(n - begin);
            let is_own: [bool; VECTOR] = std::array::from_fn(|i| lanes.contains(&i));
            let mut sum = [0.0; VECTOR];
            sum[..count].copy_from_slice(&sums[begin..][..count]);
            for (k, (uniform, nodes)) in weights.iter().enumerate() {
                let line = &lines[first + k][begin..][..count];
                let mut e = [0.0; VECTOR];
                e.iter_mut().zip(line).for_each(|(e, v)| *e = (*v).into());
                let of_band = weighed(uniform, of_columns, nodes, &e);
                for i in 0..VECTOR {
                    sum[i] += if is_own[i] { of_band[i] } else { 0.0 };
                }
                if !terms.is_empty() {
                    let terms = &mut terms[(first + k) * n + begin..][..count];
                    let own = std::iter::zip(&is_own, of_band);
                    terms.iter_mut().zip(own).for_each(|(t, (own, v))| *t = if *own { v as f32 } else { *t });
                }
            }
            sums[begin..][..count].copy_from_slice(&sum[..count]);
            return;
        }
        let mut sum = [0.0; VECTOR];
        sum.copy_from_slice(&sums[begin..][..VECTOR]);
        for (k, (uniform, nodes)) in weights.iter().enumerate() {
            let line = &lines[first + k][begin..][..VECTOR];
            let e = std::array::from_fn(|i| line[i].into());
            let of_band = weighed(uniform, of_columns, nodes, &e);
            sum.iter_mut().zip(of_band).for_each(|(sum, v)| *sum += v);
            if !terms.is_empty() {
                let terms = &mut terms[(first + k) * n + begin..][..VECTOR];
                terms.iter_mut().zip(of_band).for_each(|(term, v)| *term = v as f32);
            }
        }
        sums[begin..][..VECTOR].copy_from_slice(&sum);
    }
}

/// Terms of the sums.
#[inline(always)]
fn weighed(w: &Vector, [a, b, c, d]: &[Vector; 4], [e, f, g, h]: &[Vector; 4], values: &Vector) -> Vector {
    std::array::from_fn(|i| (w[i] + ((a[i] * e[i] + b[i] * f[i]) + (c[i] * g[i] + d[i] * h[i]))) * values[i])
}

/// What bands weigh along a row: at the nodes around some columns, and for perpendicular light.
#[derive(Default)]
pub(super) struct RowNodes {
    /// The nodes.
    nodes: Range<usize>,
    /// Vectors after which the columns of the mosaic begin again.
    period: usize,
    /// By band and vector.
    uniform: Vec<Vector>,
    /// By band, vector and node.
    values: Vec<Vector>,
    line: Vec<f64>,
}

impl RowNodes {
    /// Sets them to those of row `row` of the sensor for `bands`, of which `field` has what is added to `uniform`, by channel and band; `channels`: those of the mosaic along the row from the first of `columns` on.
    pub(super) fn set(
        &mut self,
        (field, uniform): (&FieldWeights, &[Vec<f64>]),
        bands: Range<usize>,
        (row, columns): (usize, &Columns),
        channels: &[usize],
    ) {
        self.nodes = columns.nodes();
        let shared = channels.len().trailing_zeros().min(VECTOR.trailing_zeros());
        self.period = channels.len() >> shared;
        let (vectors, count) = (self.period, self.nodes.len());
        self.uniform.resize(bands.len() * vectors, [0.0; VECTOR]);
        self.values.resize(bands.len() * vectors * count, [0.0; VECTOR]);
        for (k, band) in bands.enumerate() {
            for (column, channel) in channels.iter().enumerate() {
                field.line((*channel, band), row, self.nodes.clone(), &mut self.line);
                for lane in (column..vectors * VECTOR).step_by(channels.len()) {
                    let (vector, lane) = (k * vectors + lane / VECTOR, lane % VECTOR);
                    self.uniform[vector][lane] = uniform[*channel][band];
                    let values = &mut self.values[vector * count..][..count];
                    values.iter_mut().zip(&self.line).for_each(|(to, v)| to[lane] = *v);
                }
            }
        }
    }

    /// Of the band of number `k` for the vector of number `vector`: for perpendicular light, and at four nodes from `node` on.
    #[inline(always)]
    fn at(&self, k: usize, vector: usize, node: usize) -> (&Vector, &[Vector; 4]) {
        let place = k * self.period + vector % self.period;
        let values = &self.values[place * self.nodes.len() + node - self.nodes.start..];
        (&self.uniform[place], values.first_chunk().expect("four nodes around a column"))
    }
}

#[cfg(test)]
mod tests;
