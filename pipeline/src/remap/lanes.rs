//! Remap stage with SIMD: expansion of anchors to pixel coordinates ([`super::anchors`]), and interpolation.
//!
//! Neighbouring film pixels read neighbouring chart pixels: where the cells of a register's pixels span no more than two loads and
//! two rows, a tap is two loads and a permutation; elsewhere taps are gathered pixel by pixel. In both cases the sum of a pixel has the
//! same order, so its bits do not depend on its neighbours. All code is inlined into the dispatch function of the instruction set; no
//! closures, which would be compiled without these instructions.
#![allow(clippy::needless_range_loop, reason = "lanes of several arrays at once")]

use super::anchors::{Anchors, Group, Special};
use super::extent::GROUP;
use super::knots::Knots;
use super::map::{ANCHOR_SPACING_PX, ExactBlock, Map};
use crate::geometry::Rect;
use crate::resample::Interp;
use crate::simd::lanes::{Lanes, MAX_LANES, SimdOp};

/// Computes the anchors of a film rectangle.
pub(super) struct FillAnchors<'a> {
    pub(super) map: Map<'a>,
    pub(super) knots: &'a Knots,
    pub(super) rect: Rect,
    pub(super) to: &'a mut Anchors,
}

impl<V: Lanes> SimdOp<V> for FillAnchors<'_> {
    #[inline(always)]
    fn run(self) {
        self.to.fill(&self.map, self.knots, self.rect);
    }
}

/// Anchors of a film rectangle, by blocks of [`ANCHOR_SPACING_PX`] columns, and the expansion to the pixels of their blocks.
pub(super) trait Expand {
    /// Values of [`GROUP`] anchors.
    type Group;
    /// Values that are the same along a film row.
    type Line<V: Lanes>: Copy;

    /// First film column of the first block, and blocks per row.
    fn blocks(&self) -> (i64, usize);
    /// The groups of a row of the rectangle.
    fn groups(&self, row: usize) -> &[Self::Group];
    /// The values of a row of the rectangle.
    fn line<V: Lanes>(&self, row: usize) -> Self::Line<V>;
    /// The pixels of block `i` of a group (its index in the row, and itself) from its `first` on.
    fn pixels<V: Lanes>(
        &self,
        line: &Self::Line<V>,
        group: (usize, &Self::Group),
        i: usize,
        first: usize,
    ) -> Pixels<V>;
}

/// Anchors of a lens with rotational symmetry on a film rectangle.
pub(super) struct RadialAnchors<'a> {
    pub(super) map: Map<'a>,
    pub(super) knots: &'a Knots,
    pub(super) anchors: &'a Anchors,
    /// First film row of the rectangle.
    pub(super) y: i64,
}

/// Interpolates the chart at the pixels of a film rectangle.
pub(super) struct Resample<'a, E> {
    pub(super) anchors: E,
    pub(super) chart: Chart<'a>,
    pub(super) interp: Interp,
    pub(super) rect: Rect,
    /// The output from the first pixel of `rect` on.
    pub(super) out: &'a mut [f32],
    /// Pixels from row to row of `out`.
    pub(super) stride: usize,
}

/// Pixels of a rectangle of the chart.
#[derive(Clone, Copy)]
pub(super) struct Chart<'a> {
    pub(super) source: &'a [f32],
    pub(super) width: usize,
    /// Cell (row, column) whose first tap is the first pixel.
    pub(super) first: (i32, i32),
}

impl<V: Lanes, E: Expand> SimdOp<V> for Resample<'_, E> {
    #[inline(always)]
    fn run(self) {
        match self.interp {
            Interp::Bicubic => self.rows::<V, CatmullRom, 4>(),
            Interp::Bilinear => self.rows::<V, Linear, 2>(),
        }
    }
}

/// Coordinates of a register of pixels: cells, fractions, gain.
#[derive(Clone, Copy)]
pub(super) struct Pixels<V: Lanes> {
    pub(super) rows: V::I32,
    pub(super) cols: V::I32,
    pub(super) row_fraction: V,
    pub(super) col_fraction: V,
    pub(super) gain: V,
}

/// Registers of a group of anchors: their coordinates are computed before any is interpolated, so that neither waits for the other's latency.
const STRIP: usize = GROUP * ANCHOR_SPACING_PX / 8;

impl<E: Expand> Resample<'_, E> {
    #[inline(always)]
    fn rows<V: Lanes, K: Interpolation<N>, const N: usize>(mut self) {
        let out = std::mem::take(&mut self.out);
        let (x0, count) = self.anchors.blocks();
        let width = self.rect.width;
        let per_block = ANCHOR_SPACING_PX / V::LANES;
        let zero = V::to_i32(V::splat(0.0));
        let none = Pixels {
            rows: zero,
            cols: zero,
            row_fraction: V::splat(0.0),
            col_fraction: V::splat(0.0),
            gain: V::splat(0.0),
        };
        let mut strip = [none; STRIP];
        for (row, to) in out.chunks_mut(self.stride).take(self.rect.height).enumerate() {
            let to = &mut to[..width];
            let line = self.anchors.line::<V>(row);
            let mut x = x0 - self.rect.x;
            for (g, group) in self.anchors.groups(row).iter().enumerate() {
                let blocks = GROUP.min(count - g * GROUP);
                for i in 0..blocks {
                    for k in 0..per_block {
                        strip[i * per_block + k] =
                            self.anchors.pixels::<V>(&line, (g, group), i, k * V::LANES);
                    }
                }
                for pixels in &strip[..blocks * per_block] {
                    let value = self.chart.value::<V, K, N>(pixels) * pixels.gain;
                    if x >= 0 && x as usize + V::LANES <= width {
                        value.store(&mut to[x as usize..]);
                    } else {
                        let mut all = [0.0; MAX_LANES];
                        value.store(&mut all);
                        let (from, end) =
                            ((-x).clamp(0, V::LANES as i64), (width as i64 - x).clamp(0, V::LANES as i64));
                        if from < end {
                            to[(x + from) as usize..(x + end) as usize]
                                .copy_from_slice(&all[from as usize..end as usize]);
                        }
                    }
                    x += V::LANES as i64;
                }
            }
        }
    }
}

impl Expand for RadialAnchors<'_> {
    type Group = Group;
    /// Film row from the axis over the scale, and [`Map::integer_columns`].
    type Line<V: Lanes> = (V, V);

    #[inline(always)]
    fn blocks(&self) -> (i64, usize) {
        (self.anchors.x, self.anchors.count)
    }

    #[inline(always)]
    fn groups(&self, row: usize) -> &[Group] {
        self.anchors.row(row)
    }

    #[inline(always)]
    fn line<V: Lanes>(&self, row: usize) -> (V, V) {
        let dy = ((self.y + row as i64) as f64 - self.map.axis_px.0) * self.map.per_scale.0;
        (V::splat(dy as f32), V::splat(self.map.integer_columns() as f32))
    }

    #[inline(always)]
    fn pixels<V: Lanes>(
        &self,
        line: &(V, V),
        (_, group): (usize, &Group),
        i: usize,
        first: usize,
    ) -> Pixels<V> {
        match self.anchors.special(group, i) {
            None => self.expand::<V, false>((group, i), first, line, (0, 0)),
            Some(Special::SlopeChanges(from, to)) => {
                self.expand::<V, true>((group, i), first, line, (*from, *to))
            }
            Some(Special::Exact(exact)) => Pixels::load(exact, first),
        }
    }
}

impl RadialAnchors<'_> {
    /// The pixels of block `i` of a group from its `first` on, expanded from the anchor; `SLOPE_CHANGES` if the range `slope_changes` of
    /// [`Anchors::slope_changes`] applies.
    #[inline(always)]
    fn expand<V: Lanes, const SLOPE_CHANGES: bool>(
        &self,
        (group, i): (&Group, usize),
        first: usize,
        &(dy, integer_columns): &(V, V),
        slope_changes: (usize, usize),
    ) -> Pixels<V> {
        let a = self.anchors;
        let anchor = &group.values;
        let [c1, c2, c3, c4] = &anchor.delta;
        let (c1, c2, c3, c4) = (V::splat(c1[i]), V::splat(c2[i]), V::splat(c3[i]), V::splat(c4[i]));
        let (outer, inner) = (V::splat(anchor.outer[i]), V::splat(anchor.inner[i]));
        let [gain_slope, h_outer, gain_outer, h_inner, gain_inner] = *self.knots.slope_changes(group.step[i]);
        let zero = V::splat(0.0);
        let t = V::iota() + V::splat(first as f32 - (ANCHOR_SPACING_PX / 2) as f32);
        let delta = t * t.mul_add(t.mul_add(t.mul_add(c4, c3), c2), c1);
        let (beyond, within) = ((delta - outer).max(zero), (inner - delta).max(zero));
        let slope = V::splat(anchor.slope[i]);
        let mut h = delta.mul_add(slope, beyond.mul_add(V::splat(h_outer), within * V::splat(h_inner)));
        let mut gain = within.mul_add(V::splat(gain_inner), V::splat(anchor.gain[i]));
        gain = beyond.mul_add(V::splat(gain_outer), delta.mul_add(V::splat(gain_slope), gain));
        if SLOPE_CHANGES {
            for change in &a.slope_changes[slope_changes.0..slope_changes.1] {
                let past = ((delta - V::splat(change.at)) * V::splat(change.side)).max(zero);
                h = past.mul_add(V::splat(change.h), h);
                gain = past.mul_add(V::splat(change.gain), gain);
            }
        }
        let inverse_r = V::splat(anchor.inverse_r[i]);
        let e = delta * inverse_r;
        let m = h * inverse_r * ((V::splat(1.0) - e) * e.mul_add(e, V::splat(1.0)));
        let row = dy.mul_add(m, V::splat(anchor.row_fraction[i]));
        let dx = t.mul_add(V::splat(self.map.per_scale.1 as f32), V::splat(anchor.dx[i]));
        let col =
            dx.mul_add(m, t.mul_add(V::splat(anchor.extra_columns[i]), V::splat(anchor.col_fraction[i])));
        let (row_cell, col_cell) = (row.floor(), col.floor());
        Pixels {
            rows: V::add_i32(row_cell.to_i32(), group.row[i]),
            cols: V::add_i32(t.mul_add(integer_columns, col_cell).to_i32(), group.col[i]),
            row_fraction: row - row_cell,
            col_fraction: col - col_cell,
            gain,
        }
    }
}

impl<V: Lanes> Pixels<V> {
    /// Pixels of an exactly mapped block from its `first` on.
    #[inline(always)]
    pub(super) fn load(exact: &ExactBlock, first: usize) -> Self {
        Self {
            rows: V::load_i32(&exact.row[first..]),
            cols: V::load_i32(&exact.col[first..]),
            row_fraction: V::load(&exact.row_fraction[first..]),
            col_fraction: V::load(&exact.col_fraction[first..]),
            gain: V::load(&exact.gain[first..]),
        }
    }
}

impl Chart<'_> {
    /// Interpolated values.
    #[inline(always)]
    fn value<V: Lanes, K: Interpolation<N>, const N: usize>(&self, p: &Pixels<V>) -> V {
        let (wy, wx) = (K::weights(p.row_fraction), K::weights(p.col_fraction));
        let (mut rows, mut cols) = ([0; MAX_LANES], [0; MAX_LANES]);
        V::store_i32(p.rows, &mut rows);
        V::store_i32(p.cols, &mut cols);
        let last = V::LANES - 1;
        let (y, x) = (rows[0].min(rows[last]), cols[0].min(cols[last]));
        let (index, row) = (V::add_i32(p.cols, -x), V::add_i32(p.rows, -y));
        if !(V::all_within(index, (2 * V::LANES - N) as i32) && V::all_within(row, 1)) {
            return self.gather(&rows, &cols, &wy, &wx);
        }
        let first = (y - self.first.0) as usize * self.width + (x - self.first.1) as usize;
        let mut sum = self.row(first, index, &wx) * wy[0];
        if V::all_within(row, 0) {
            for j in 1..N {
                sum = self.row(first + j * self.width, index, &wx).mul_add(wy[j], sum);
            }
            return sum;
        }
        // Some pixels begin one row lower.
        let upper = V::equals(row, 0);
        let line = self.row(first + self.width, index, &wx);
        sum = V::select(upper, line.mul_add(wy[1], sum), line * wy[0]);
        for j in 2..N {
            let line = self.row(first + j * self.width, index, &wx);
            sum = line.mul_add(V::select(upper, wy[j], wy[j - 1]), sum);
        }
        let line = self.row(first + N * self.width, index, &wx);
        V::select(upper, sum, line.mul_add(wy[N - 1], sum))
    }

    /// Σ weight · tap over one row of taps from `first` on.
    #[inline(always)]
    fn row<V: Lanes, const N: usize>(&self, first: usize, index: V::I32, wx: &[V; N]) -> V {
        let from = &self.source[first..][..2 * V::LANES];
        let (low, high) = (V::load(from), V::load(&from[V::LANES..]));
        let mut sum = V::permute(low, high, index) * wx[0];
        for k in 1..N {
            sum = V::permute(low, high, V::add_i32(index, k as i32)).mul_add(wx[k], sum);
        }
        sum
    }

    /// Interpolated values, taps gathered pixel by pixel.
    #[inline(always)]
    fn gather<V: Lanes, const N: usize>(
        &self,
        rows: &[i32; MAX_LANES],
        cols: &[i32; MAX_LANES],
        wy: &[V; N],
        wx: &[V; N],
    ) -> V {
        let mut first = [0; MAX_LANES];
        for (first, (y, x)) in first.iter_mut().zip(rows.iter().zip(cols)).take(V::LANES) {
            *first = (y - self.first.0) as usize * self.width + (x - self.first.1) as usize;
        }
        let mut sum = self.gather_row(&first, 0, wx) * wy[0];
        for j in 1..N {
            sum = self.gather_row(&first, j, wx).mul_add(wy[j], sum);
        }
        sum
    }

    /// Σ weight · tap over the `j`-th row of taps of every pixel.
    #[inline(always)]
    fn gather_row<V: Lanes, const N: usize>(&self, first: &[usize; MAX_LANES], j: usize, wx: &[V; N]) -> V {
        let mut sum = V::splat(0.0);
        for k in 0..N {
            let mut tap = [0.0; MAX_LANES];
            for (tap, first) in tap.iter_mut().zip(&first[..V::LANES]) {
                *tap = self.source[first + j * self.width + k];
            }
            let tap = V::load(&tap);
            sum = if k == 0 { tap * wx[0] } else { tap.mul_add(wx[k], sum) };
        }
        sum
    }
}

/// Interpolation over N × N taps.
trait Interpolation<const N: usize> {
    /// Weights of the taps at fraction `f`.
    fn weights<V: Lanes>(f: V) -> [V; N];
}

struct CatmullRom;
struct Linear;

impl Interpolation<4> for CatmullRom {
    #[inline(always)]
    fn weights<V: Lanes>(f: V) -> [V; 4] {
        let (half, one, two) = (V::splat(0.5), V::splat(1.0), V::splat(2.0));
        let g = f * half;
        [
            ((two - f) * f - one) * g,
            ((V::splat(3.0) * f - V::splat(5.0)) * f * f + two) * half,
            ((V::splat(4.0) - V::splat(3.0) * f) * f + one) * g,
            (f - one) * f * g,
        ]
    }
}

impl Interpolation<2> for Linear {
    #[inline(always)]
    fn weights<V: Lanes>(f: V) -> [V; 2] {
        [V::splat(1.0) - f, f]
    }
}
