//! The taps in lanes: neighbours on the film read neighbours on the chart.
//!
//! Where the cells of a register's pixels span no more than two loads and two rows, a tap is two loads and a permutation;
//! elsewhere it is gathered pixel by pixel. Either way a pixel's sums run in the same order, so its bits do not depend on
//! its neighbours. All of it is inlined into the gate of the instructions.
#![allow(clippy::needless_range_loop, reason = "lanes of several arrays at once")]

use super::Taps;
use super::map::{Map, PAD, Points, ends};
use crate::geometry::Rect;
use crate::resample::Interp;
use crate::simd::Simd;
use crate::simd::lanes::{Gate, Lanes, Work};

/// Fills `to`; the least and the greatest chart row and column.
pub(super) fn map<V: Lanes>(
    simd: Simd,
    map: Map<'_>,
    strip: Rect,
    to: &mut Points,
) -> ((i64, i64), (i64, i64)) {
    let mut ends = ((0, 0), (0, 0));
    Gate::<V>::open(simd).run(Mapping { map, strip, to, ends: &mut ends });
    ends
}

/// [`Map::strip`] and the ends of the chart's rows and columns, compiled for the instructions of a gate.
struct Mapping<'a> {
    map: Map<'a>,
    strip: Rect,
    to: &'a mut Points,
    ends: &'a mut ((i64, i64), (i64, i64)),
}

impl<V: Lanes> Work<V> for Mapping<'_> {
    #[inline(always)]
    fn run(self) {
        self.map.strip(self.strip, self.to);
        *self.ends = (ends(&self.to.row), ends(&self.to.col));
    }
}

/// The taps of a strip into `out`.
pub(super) struct Resample<'a> {
    pub(super) taps: &'a Taps<'a>,
    pub(super) interp: Interp,
    pub(super) out: &'a mut [f32],
}

impl<V: Lanes> Work<V> for Resample<'_> {
    #[inline(always)]
    fn run(self) {
        match self.interp {
            Interp::Bicubic => lines::<V, Cubic, 4>(self.taps, self.out),
            Interp::Bilinear => lines::<V, Linear, 2>(self.taps, self.out),
        }
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

/// Fills the film lines of `t` in `out`.
#[inline(always)]
fn lines<V: Lanes, K: Kernel<N>, const N: usize>(t: &Taps<'_>, out: &mut [f32]) {
    let (p, width) = (t.points, t.strip.width);
    for (line, to) in out.chunks_mut(t.stride).take(t.strip.height).enumerate() {
        let to = &mut to[..width];
        for x in (0..width).step_by(V::LANES) {
            let at = line * p.stride + x..line * p.stride + x + V::LANES;
            let (rows, cols) = (&p.row[at.clone()], &p.col[at.clone()]);
            let wy = K::weights(V::load(&p.row_fraction[at.clone()]));
            let wx = K::weights(V::load(&p.col_fraction[at.clone()]));
            let sum = match near(t, rows, cols, &wy, &wx) {
                Some(sum) => sum,
                None => far(t, rows, cols, &wy, &wx),
            };
            let value = sum * V::load(&p.gain[at]);
            match to.get_mut(x..x + V::LANES) {
                Some(to) => value.store(to),
                None => {
                    let mut all = [0.0; PAD];
                    value.store(&mut all);
                    to[x..].copy_from_slice(&all[..width - x]);
                }
            }
        }
    }
}

/// The taps by permutation, if the cells lie near enough.
#[inline(always)]
fn near<V: Lanes, const N: usize>(
    t: &Taps<'_>,
    rows: &[i32],
    cols: &[i32],
    wy: &[V; N],
    wx: &[V; N],
) -> Option<V> {
    let last = V::LANES - 1;
    let (y, x) = (rows[0].min(rows[last]), cols[0].min(cols[last]));
    let (index, row) = (V::plus(V::load_ints(cols), -x), V::plus(V::load_ints(rows), -y));
    if !(V::within(index, 2 * V::LANES as i32 - 1) && V::within(row, 1)) {
        return None;
    }
    let first = (y - t.first.0) as usize * t.width + (x - t.first.1) as usize;
    let mut sum = near_line(t, first, index, wx) * wy[0];
    if V::within(row, 0) {
        for j in 1..N {
            sum = near_line(t, first + j * t.width, index, wx).mul_add(wy[j], sum);
        }
        return Some(sum);
    }
    // The lower pixels begin a row later.
    let upper = V::equal(row, 0);
    let line = near_line(t, first + t.width, index, wx);
    sum = V::select(upper, line.mul_add(wy[1], sum), line * wy[0]);
    for j in 2..N {
        let line = near_line(t, first + j * t.width, index, wx);
        sum = line.mul_add(V::select(upper, wy[j], wy[j - 1]), sum);
    }
    let line = near_line(t, first + N * t.width, index, wx);
    Some(V::select(upper, sum, line.mul_add(wy[N - 1], sum)))
}

/// Σ of one row's taps, which begin at `first`.
#[inline(always)]
fn near_line<V: Lanes, const N: usize>(t: &Taps<'_>, first: usize, index: V::Ints, wx: &[V; N]) -> V {
    let from = &t.source[first..][..N - 1 + 2 * V::LANES];
    let mut sum = V::pick(V::load(from), V::load(&from[V::LANES..]), index) * wx[0];
    for k in 1..N {
        sum = V::pick(V::load(&from[k..]), V::load(&from[k + V::LANES..]), index).mul_add(wx[k], sum);
    }
    sum
}

/// The taps pixel by pixel.
#[inline(always)]
fn far<V: Lanes, const N: usize>(t: &Taps<'_>, rows: &[i32], cols: &[i32], wy: &[V; N], wx: &[V; N]) -> V {
    let mut first = [0; PAD];
    for (first, (y, x)) in first.iter_mut().zip(rows.iter().zip(cols)) {
        *first = (y - t.first.0) as usize * t.width + (x - t.first.1) as usize;
    }
    let mut sum = far_line(t, &first, 0, wx) * wy[0];
    for j in 1..N {
        sum = far_line(t, &first, j, wx).mul_add(wy[j], sum);
    }
    sum
}

/// Σ of the taps of every pixel's `j`-th row.
#[inline(always)]
fn far_line<V: Lanes, const N: usize>(t: &Taps<'_>, first: &[usize; PAD], j: usize, wx: &[V; N]) -> V {
    let mut sum = V::splat(0.0);
    for k in 0..N {
        let mut tap = [0.0; PAD];
        for (tap, first) in tap.iter_mut().zip(&first[..V::LANES]) {
            *tap = t.source[first + j * t.width + k];
        }
        let tap = V::load(&tap);
        sum = if k == 0 { tap * wx[0] } else { tap.mul_add(wx[k], sum) };
    }
    sum
}
