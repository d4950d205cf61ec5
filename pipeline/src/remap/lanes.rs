//! Stages 1-2 in lanes: a block's anchor to its pixels' coordinates ([`super::anchors`]), and their taps.
//!
//! Neighbours on the film read neighbours on the chart: where the cells of a register's pixels span no more than two loads
//! and two rows, a tap is two loads and a permutation; elsewhere it is gathered pixel by pixel. Either way a pixel's sums
//! run in the same order, so its bits do not depend on its neighbours. All of it is inlined into the gate of the
//! instructions: no closures here, which would be compiled without them.
#![allow(clippy::needless_range_loop, reason = "lanes of several arrays at once")]

use super::anchors::{Anchors, Exact, GROUP, Group, Knots, SIDE, Special, VALUES};
use super::map::Map;
use crate::geometry::Rect;
use crate::resample::Interp;
use crate::simd::lanes::{Lanes, WIDEST, Work};

/// Makes the anchors of a strip.
pub(super) struct Anchoring<'a> {
    pub(super) map: Map<'a>,
    pub(super) knots: &'a Knots,
    pub(super) strip: Rect,
    pub(super) to: &'a mut Anchors,
}

impl<V: Lanes> Work<V> for Anchoring<'_> {
    #[inline(always)]
    fn run(self) {
        self.to.fill(&self.map, self.knots, self.strip);
    }
}

/// Resamples a strip.
pub(super) struct Resample<'a> {
    pub(super) map: Map<'a>,
    pub(super) knots: &'a Knots,
    pub(super) anchors: &'a Anchors,
    pub(super) chart: Chart<'a>,
    pub(super) interp: Interp,
    pub(super) strip: Rect,
    /// The strip's first pixel, and on.
    pub(super) out: &'a mut [f32],
    /// From line to line of `out`.
    pub(super) stride: usize,
}

/// A rectangle of the chart.
#[derive(Clone, Copy)]
pub(super) struct Chart<'a> {
    pub(super) source: &'a [f32],
    pub(super) width: usize,
    /// The cell (row, column) whose first tap is the first pixel.
    pub(super) first: (i32, i32),
}

impl<V: Lanes> Work<V> for Resample<'_> {
    #[inline(always)]
    fn run(self) {
        match self.interp {
            Interp::Bicubic => self.lines::<V, Cubic, 4>(),
            Interp::Bilinear => self.lines::<V, Linear, 2>(),
        }
    }
}

/// Pixels of a register: cells relative to `origin`, fractions, R.
struct Pixels<V: Lanes> {
    origin: (i32, i32),
    rows: V::Ints,
    cols: V::Ints,
    row_fraction: V,
    col_fraction: V,
    gain: V,
}

impl Resample<'_> {
    #[inline(always)]
    fn lines<V: Lanes, K: Kernel<N>, const N: usize>(mut self) {
        let out = std::mem::take(&mut self.out);
        let a = self.anchors;
        let width = self.strip.width;
        let steps = a.count * SIDE / V::LANES;
        for (line, to) in out.chunks_mut(self.stride).take(self.strip.height).enumerate() {
            let to = &mut to[..width];
            let dy = ((self.strip.y + line as i64) as f64 - self.map.axis_px.0) * self.map.per_scale.0;
            let dy = V::splat(dy as f32);
            let whole = V::splat(self.map.whole_columns() as f32);
            let groups = a.line(line);
            let mut x = a.x - self.strip.x;
            for step in 0..steps {
                let first = step * V::LANES % SIDE;
                let block = step * V::LANES / SIDE;
                let (group, i) = (&groups[block / GROUP], block % GROUP);
                let pixels = match a.special(group, i) {
                    None => self.expanded::<V, false>((group, i), first, dy, whole, (0, 0)),
                    Some(Special::Bends(from, to)) => {
                        self.expanded::<V, true>((group, i), first, dy, whole, (*from, *to))
                    }
                    Some(Special::Exact(exact)) => Pixels::<V>::exact(exact, first),
                };
                let value = self.chart.value::<V, K, N>(&pixels) * pixels.gain;
                if x >= 0 && x as usize + V::LANES <= width {
                    value.store(&mut to[x as usize..]);
                } else {
                    let mut all = [0.0; WIDEST];
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

    /// The pixels of a block from its `first` on, by its anchor.
    #[inline(always)]
    fn expanded<V: Lanes, const BENDS: bool>(
        &self,
        (group, i): (&Group, usize),
        first: usize,
        dy: V,
        whole: V,
        bends: (usize, usize),
    ) -> Pixels<V> {
        let a = self.anchors;
        let mut values = [V::splat(0.0); VALUES];
        for (value, of) in values.iter_mut().zip(&group.values) {
            *value = V::splat(of[i]);
        }
        let [row, col, more, dx, c1, c2, c3, c4, inverse, slope, gain, outer, inner] = values;
        let [gain_slope, h_outer, gain_outer, h_inner, gain_inner] = *self.knots.bends(group.step[i]);
        let zero = V::splat(0.0);
        let t = V::count() + V::splat(first as f32 - (SIDE / 2) as f32);
        let r = t * t.mul_add(t.mul_add(t.mul_add(c4, c3), c2), c1);
        let (beyond, within) = ((r - outer).max(zero), (inner - r).max(zero));
        let mut h = r.mul_add(slope, beyond.mul_add(V::splat(h_outer), within * V::splat(h_inner)));
        let mut gain = within.mul_add(V::splat(gain_inner), gain);
        gain = beyond.mul_add(V::splat(gain_outer), r.mul_add(V::splat(gain_slope), gain));
        if BENDS {
            for bend in &a.bends[bends.0..bends.1] {
                let past = ((r - V::splat(bend.at)) * V::splat(bend.side)).max(zero);
                h = past.mul_add(V::splat(bend.h), h);
                gain = past.mul_add(V::splat(bend.gain), gain);
            }
        }
        let e = r * inverse;
        let m = h * inverse * ((V::splat(1.0) - e) * e.mul_add(e, V::splat(1.0)));
        let row = dy.mul_add(m, row);
        let dx = t.mul_add(V::splat(self.map.per_scale.1 as f32), dx);
        let col = dx.mul_add(m, t.mul_add(more, col));
        let (row_cell, col_cell) = (row.floor(), col.floor());
        Pixels {
            origin: (group.row[i], group.col[i]),
            rows: row_cell.ints(),
            cols: t.mul_add(whole, col_cell).ints(),
            row_fraction: row - row_cell,
            col_fraction: col - col_cell,
            gain,
        }
    }
}

impl<V: Lanes> Pixels<V> {
    #[inline(always)]
    fn exact(exact: &Exact, first: usize) -> Self {
        Self {
            origin: (0, 0),
            rows: V::load_ints(&exact.row[first..]),
            cols: V::load_ints(&exact.col[first..]),
            row_fraction: V::load(&exact.row_fraction[first..]),
            col_fraction: V::load(&exact.col_fraction[first..]),
            gain: V::load(&exact.gain[first..]),
        }
    }
}

impl Chart<'_> {
    #[inline(always)]
    fn value<V: Lanes, K: Kernel<N>, const N: usize>(&self, p: &Pixels<V>) -> V {
        let (wy, wx) = (K::weights(p.row_fraction), K::weights(p.col_fraction));
        let (mut rows, mut cols) = ([0; WIDEST], [0; WIDEST]);
        V::store_ints(p.rows, &mut rows);
        V::store_ints(p.cols, &mut cols);
        let last = V::LANES - 1;
        let (y, x) = (rows[0].min(rows[last]), cols[0].min(cols[last]));
        let (index, row) = (V::plus(p.cols, -x), V::plus(p.rows, -y));
        let origin = (p.origin.0 - self.first.0, p.origin.1 - self.first.1);
        if !(V::within(index, (2 * V::LANES - N) as i32) && V::within(row, 1)) {
            return self.far(&rows, &cols, origin, &wy, &wx);
        }
        let first = (origin.0 + y) as usize * self.width + (origin.1 + x) as usize;
        let mut sum = self.line(first, index, &wx) * wy[0];
        if V::within(row, 0) {
            for j in 1..N {
                sum = self.line(first + j * self.width, index, &wx).mul_add(wy[j], sum);
            }
            return sum;
        }
        // The lower pixels begin a row later.
        let upper = V::equal(row, 0);
        let line = self.line(first + self.width, index, &wx);
        sum = V::select(upper, line.mul_add(wy[1], sum), line * wy[0]);
        for j in 2..N {
            let line = self.line(first + j * self.width, index, &wx);
            sum = line.mul_add(V::select(upper, wy[j], wy[j - 1]), sum);
        }
        let line = self.line(first + N * self.width, index, &wx);
        V::select(upper, sum, line.mul_add(wy[N - 1], sum))
    }

    /// Σ of one row's taps, which begin at `first`.
    #[inline(always)]
    fn line<V: Lanes, const N: usize>(&self, first: usize, index: V::Ints, wx: &[V; N]) -> V {
        let from = &self.source[first..][..2 * V::LANES];
        let (low, high) = (V::load(from), V::load(&from[V::LANES..]));
        let mut sum = V::pick(low, high, index) * wx[0];
        for k in 1..N {
            sum = V::pick(low, high, V::plus(index, k as i32)).mul_add(wx[k], sum);
        }
        sum
    }

    /// The taps pixel by pixel.
    #[inline(always)]
    fn far<V: Lanes, const N: usize>(
        &self,
        rows: &[i32; WIDEST],
        cols: &[i32; WIDEST],
        origin: (i32, i32),
        wy: &[V; N],
        wx: &[V; N],
    ) -> V {
        let mut first = [0; WIDEST];
        for (first, (y, x)) in first.iter_mut().zip(rows.iter().zip(cols)).take(V::LANES) {
            *first = (origin.0 + y) as usize * self.width + (origin.1 + x) as usize;
        }
        let mut sum = self.far_line(&first, 0, wx) * wy[0];
        for j in 1..N {
            sum = self.far_line(&first, j, wx).mul_add(wy[j], sum);
        }
        sum
    }

    /// Σ of the taps of every pixel's `j`-th row.
    #[inline(always)]
    fn far_line<V: Lanes, const N: usize>(&self, first: &[usize; WIDEST], j: usize, wx: &[V; N]) -> V {
        let mut sum = V::splat(0.0);
        for k in 0..N {
            let mut tap = [0.0; WIDEST];
            for (tap, first) in tap.iter_mut().zip(&first[..V::LANES]) {
                *tap = self.source[first + j * self.width + k];
            }
            let tap = V::load(&tap);
            sum = if k == 0 { tap * wx[0] } else { tap.mul_add(wx[k], sum) };
        }
        sum
    }
}

/// A kind of interpolation over N × N taps, weights from a fraction.
trait Kernel<const N: usize> {
    fn weights<V: Lanes>(f: V) -> [V; N];
}

/// Catmull-Rom.
struct Cubic;
/// Linear.
struct Linear;

impl Kernel<4> for Cubic {
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

impl Kernel<2> for Linear {
    #[inline(always)]
    fn weights<V: Lanes>(f: V) -> [V; 2] {
        [V::splat(1.0) - f, f]
    }
}
