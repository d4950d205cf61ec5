//! The taps in lanes: neighbours on the film read neighbours on the chart.
//!
//! Where the cells of a register's pixels span no more than two loads and two rows, a tap is two loads and a permutation;
//! elsewhere it is gathered pixel by pixel. Either way a pixel's sums run in the same order, so its bits do not depend on
//! its neighbours. All of it is inlined into the functions compiled for the instructions ([`super::avx512`],
//! [`super::avx2`]).
#![allow(clippy::needless_range_loop, reason = "lanes of several arrays at once")]

use super::Taps;
use super::map::PAD;
use std::ops::{Add, Mul, Sub};

/// A register of f32 lanes; made only where the processor has been asked for its instructions.
pub(super) trait Lanes: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// Lanes of a register; divides [`PAD`].
    const LANES: usize;
    /// One bit a lane.
    type Mask: Copy;
    /// Lane → one of `2·LANES` consecutive values.
    type Index: Copy;

    fn splat(v: f32) -> Self;
    fn load(from: &[f32]) -> Self;
    fn store(self, to: &mut [f32]);
    /// self·b + c, rounded once.
    fn mul_add(self, b: Self, c: Self) -> Self;
    /// `self` where `mask`, else `b`.
    fn or(self, mask: Self::Mask, b: Self) -> Self;
    /// (cells − base, whether all are in 0..=`limit`).
    fn index(cells: &[i32], base: i32, limit: i32) -> (Self::Index, bool);
    /// Where cells = `at`.
    fn equal(cells: &[i32], at: i32) -> Self::Mask;
    /// `from[index]`; `from` holds `2·LANES` values.
    fn pick(from: &[f32], index: Self::Index) -> Self;
}

/// A kind of interpolation over N × N taps, weights from a fraction.
pub(super) trait Kernel<const N: usize> {
    fn weights<V: Lanes>(f: V) -> [V; N];
}

/// Catmull-Rom.
pub(super) struct Cubic;
/// Linear.
pub(super) struct Linear;

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
pub(super) fn lines<V: Lanes, K: Kernel<N>, const N: usize>(t: &Taps<'_>, out: &mut [f32]) {
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
    let (index, narrow) = V::index(cols, x, 2 * V::LANES as i32 - 1);
    let (_, low) = V::index(rows, y, 1);
    if !(narrow && low) {
        return None;
    }
    let first = (y - t.first.0) as usize * t.width + (x - t.first.1) as usize;
    let mut sum = near_line(t, first, index, wx) * wy[0];
    if V::index(rows, y, 0).1 {
        for j in 1..N {
            sum = near_line(t, first + j * t.width, index, wx).mul_add(wy[j], sum);
        }
        return Some(sum);
    }
    // The lower pixels begin a row later.
    let upper = V::equal(rows, y);
    let line = near_line(t, first + t.width, index, wx);
    sum = line.mul_add(wy[1], sum).or(upper, line * wy[0]);
    for j in 2..N {
        let line = near_line(t, first + j * t.width, index, wx);
        sum = line.mul_add(wy[j].or(upper, wy[j - 1]), sum);
    }
    let line = near_line(t, first + N * t.width, index, wx);
    Some(sum.or(upper, line.mul_add(wy[N - 1], sum)))
}

/// Σ of one row's taps, which begin at `first`.
#[inline(always)]
fn near_line<V: Lanes, const N: usize>(t: &Taps<'_>, first: usize, index: V::Index, wx: &[V; N]) -> V {
    let from = &t.source[first..][..N - 1 + 2 * V::LANES];
    let mut sum = V::pick(from, index) * wx[0];
    for k in 1..N {
        sum = V::pick(&from[k..], index).mul_add(wx[k], sum);
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
