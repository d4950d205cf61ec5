//! Where on the chart a film line's pixels lie, from one f64 anchor in sixteen: what the lanes expand.
//!
//! Film columns are cut into blocks of [`SIDE`] at multiples of it, wherever a strip begins, so a pixel's coordinates are
//! its own. A block's anchor is its pixel in the middle, at radius ρ and offset (dx, dy) from the axis, in f64:
//!     m = h(ρ)/ρ,   row = offset + dy·m/scale,   col = offset + dx·m/scale,   split into an integer and an f32 fraction.
//! A pixel t columns on (|t| ≤ 8) lies δ = r − ρ farther out. With u = dx/ρ, ε = t/ρ:
//!     δ = ρ·(uε + (1 − u²)/2·(ε² − uε³ + (5u² − 1)/4·ε⁴))                 (Taylor of √(1 + 2uε + ε²))
//! The field's table is linear in r between its knots r_j, of slope h′_j and bend κ_j = h′_j − h′_{j−1}, so exactly
//!     h(r)/r − m = ((h′ − m)·δ + Σ_{r_j > ρ} κ_j·max(0, r − r_j) + Σ_{r_j ≤ ρ} κ_j·max(0, r_j − r)) / r
//! and 1/r = (1 − δ/ρ)(1 + δ²/ρ²)/ρ. R follows its own table likewise. All of this but the anchor is of the size of
//! what changes within a block, and f32 holds it.
//!
//! Bound: beyond ρ = [`NEAR`] px the Taylor series ends within 1.2e-6 px of r and that of 1/r within 1e-6 of it; blocks
//! whose magnification may move a pixel by more than 1 px are not expanded. So coordinates are within 2e-6 px of the exact
//! map, and typically 3e-7 (fractions are f32). What is not expanded (near the axis, a table that bends hard, film
//! beyond the table) is mapped pixel by pixel in f64.

#![allow(clippy::needless_range_loop, reason = "lanes of several arrays at once")]

use super::map::Map;
use crate::field::{Field, Step};
use crate::geometry::Rect;
use crate::resample::Coordinate;

/// Pixels of a block.
pub(super) const SIDE: usize = 16;
/// The anchor's place in it: its farthest pixel is this far.
const HALF: f64 = (SIDE / 2) as f64;
/// Anchors nearer to the axis than this are not expanded, px.
const NEAR: f64 = 256.0;
/// Slack of the bounds on cells, px: more than any rounding.
const SLACK: f64 = 1e-3;
/// Anchors made together.
const GROUP: usize = 8;

/// The field's table as the lanes want it: what a step is bent by at its ends.
#[derive(Clone, Debug)]
pub(super) struct Knots {
    steps: Vec<Step>,
    /// Per step: slope of R, bends of h and R at its outer end, the same at its inner end.
    bends: Vec<[f32; 5]>,
    /// Per step: how much h bends at both ends.
    bend: Vec<f64>,
    last_px: f64,
    /// No block sees more than its anchor's step and a part of the next on either side.
    sparse: bool,
}

impl Knots {
    pub(super) fn new(field: &Field) -> Self {
        let steps = field.steps().to_vec();
        let n = steps.len();
        let bend = |i: usize| match (1..n).contains(&i) {
            true => (
                steps[i].h_slope - steps[i - 1].h_slope,
                (steps[i].gain_slope - steps[i - 1].gain_slope) as f32,
            ),
            false => (0.0, 0.0),
        };
        let narrow = |i: usize| steps[i].until - steps[i].from < HALF;
        Self {
            bends: (0..n)
                .map(|i| {
                    let (outer, inner) = (bend(i + 1), bend(i));
                    [steps[i].gain_slope as f32, outer.0 as f32, outer.1, inner.0 as f32, inner.1]
                })
                .collect(),
            bend: (0..n).map(|i| bend(i).0.abs() + bend(i + 1).0.abs()).collect(),
            last_px: field.last_px(),
            sparse: !(0..n).any(narrow),
            steps,
        }
    }

    /// Slope of R, then (bend of h, of R) at the outer and at the inner end of step `i`.
    #[inline(always)]
    pub(super) fn bends(&self, i: i32) -> &[f32; 5] {
        &self.bends[i as usize]
    }
}

/// A bend beyond the ends of the anchor's step.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bend {
    /// +1: seen by pixels farther out than `at`; −1: by those nearer.
    pub(super) side: f32,
    /// Where, relative to ρ, px.
    pub(super) at: f32,
    /// Bend of h.
    pub(super) h: f32,
    /// Bend of R.
    pub(super) gain: f32,
}

/// A block that is not as others.
#[derive(Clone, Debug)]
pub(super) enum Special {
    /// More bends than the two at the ends of the anchor's step: a range of [`Anchors::bends`].
    Bends(usize, usize),
    /// Mapped pixel by pixel.
    Exact(Box<Exact>),
}

/// Pixels of a block, one by one.
#[derive(Clone, Debug)]
pub(super) struct Exact {
    pub(super) row: [i32; SIDE],
    pub(super) col: [i32; SIDE],
    pub(super) row_fraction: [f32; SIDE],
    pub(super) col_fraction: [f32; SIDE],
    pub(super) gain: [f32; SIDE],
}

/// Anchors of a strip, line by line, `stride` a line.
#[derive(Debug, Default)]
pub(super) struct Anchors {
    /// First film column of the first block.
    pub(super) x: i64,
    /// Blocks of a line.
    pub(super) count: usize,
    pub(super) stride: usize,
    /// 0, or 1 + the index of a [`Special`].
    pub(super) special: Vec<u32>,
    pub(super) specials: Vec<Special>,
    pub(super) bends: Vec<Bend>,
    pub(super) row: Vec<i32>,
    pub(super) col: Vec<i32>,
    /// Step of the field.
    pub(super) step: Vec<i32>,
    /// The rest, by the names below.
    pub(super) values: [Vec<f32>; VALUES],
    /// (least, greatest) chart row and column of any pixel.
    pub(super) ends: ((i64, i64), (i64, i64)),
}

/// What [`Anchors::values`] hold: fractions of row and column; columns a film column moves, less
/// [`Map::whole_columns`]; dx/scale; δ's coefficients of t, t², t³, t⁴; 1/ρ; h′ − m; R; ends of the step relative to ρ.
pub(super) const VALUES: usize = 13;

impl Anchors {
    /// What is special about a block, if anything.
    #[inline(always)]
    pub(super) fn special(&self, block: usize) -> Option<&Special> {
        match self.special[block] {
            0 => None,
            i => Some(&self.specials[i as usize - 1]),
        }
    }

    fn resize(&mut self, strip: Rect) {
        let side = SIDE as i64;
        self.x = strip.x.div_euclid(side) * side;
        self.count = ((strip.right() - self.x) as usize).div_ceil(SIDE);
        self.stride = self.count.next_multiple_of(GROUP);
        let n = self.stride * strip.height;
        self.special.clear();
        self.special.resize(n, 0);
        self.specials.clear();
        self.bends.clear();
        for ints in [&mut self.row, &mut self.col, &mut self.step] {
            ints.resize(n, 0);
        }
        for values in &mut self.values {
            values.resize(n, 0.0);
        }
    }

    /// Makes the anchors of `strip`.
    #[inline(always)]
    pub(super) fn fill(&mut self, map: &Map<'_>, knots: &Knots, strip: Rect) {
        self.resize(strip);
        let mut ends = Ends::nothing();
        for (line, y) in (strip.y..strip.bottom()).enumerate() {
            for block in (0..self.count).step_by(GROUP) {
                let odd = self.group(map, knots, y, line, block, &mut ends);
                if odd {
                    self.specials(map, knots, y, line, block, &mut ends);
                }
            }
        }
        self.ends = ends.cells();
    }

    /// The `GROUP` anchors from `block` on; whether any needs more.
    #[inline(always)]
    fn group(
        &mut self,
        map: &Map<'_>,
        knots: &Knots,
        y: i64,
        line: usize,
        block: usize,
        ends: &mut Ends,
    ) -> bool {
        type Lane = [f64; GROUP];
        const NONE: Lane = [0.0; GROUP];
        let dy = y as f64 - map.axis_px.0;
        let first = self.x as f64 + HALF - map.axis_px.1;
        let last = (self.count - 1) as f64;
        let (mut dx, mut r, mut per_r) = (NONE, NONE, NONE);
        for i in 0..GROUP {
            // Behind the line's last block it stands again.
            let b = (block + i) as f64;
            dx[i] = first + SIDE as f64 * if b < last { b } else { last };
            r[i] = (dy * dy + dx[i] * dx[i]).sqrt();
            per_r[i] = 1.0 / r[i];
        }
        let at = line * self.stride + block;
        let (mut h_at, mut h_slope, mut gain_at, mut gain_slope) = (NONE, NONE, NONE, NONE);
        let (mut until, mut from, mut bend) = (NONE, NONE, NONE);
        let steps = part(&mut self.step, at);
        for i in 0..GROUP {
            let k = map.field.step(r[i]);
            let s = &knots.steps[k];
            steps[i] = k as i32;
            (h_at[i], h_slope[i], gain_at[i], gain_slope[i]) = (s.h_at, s.h_slope, s.gain_at, s.gain_slope);
            (until[i], from[i], bend[i]) = (s.until, s.from, knots.bend[k]);
        }
        let whole = map.whole_columns();
        let mut odd = false;
        let [row_f, col_f, more, dx_at, c1, c2, c3, c4, inverse, slope, gain, outer, inner] =
            self.values.each_mut();
        let (row_f, col_f, more) = (part(row_f, at), part(col_f, at), part(more, at));
        let (dx_at, slope, inverse) = (part(dx_at, at), part(slope, at), part(inverse, at));
        let (c1, c2, c3, c4) = (part(c1, at), part(c2, at), part(c3, at), part(c4, at));
        let (gain, outer, inner) = (part(gain, at), part(outer, at), part(inner, at));
        let (row_cell, col_cell) = (part(&mut self.row, at), part(&mut self.col, at));
        for i in 0..GROUP {
            let departs = h_at[i] * per_r[i]; // m − h′
            let m = h_slope[i] + departs;
            let row = map.offset.0 + dy * m * map.per_scale.0;
            let col = map.offset.1 + dx[i] * m * map.per_scale.1;
            let a_column = m * map.per_scale.1;
            let moves = HALF * (departs.abs() + bend[i]);
            let bad = (r[i] < NEAR)
                | (r[i] + HALF > knots.last_px)
                | (moves > 1.0)
                | ((a_column - whole).abs() > 1.0);
            odd |= bad;
            // Blocks that are mapped exactly bound themselves.
            let (tall, wide) = (moves + SLACK, HALF * a_column.abs() + moves + SLACK);
            lower(&mut ends.row.0[i], if bad { f64::INFINITY } else { row - tall });
            raise(&mut ends.row.1[i], if bad { f64::NEG_INFINITY } else { row + tall });
            lower(&mut ends.col.0[i], if bad { f64::INFINITY } else { col - wide });
            raise(&mut ends.col.1[i], if bad { f64::NEG_INFINITY } else { col + wide });
            let (row, col) = (Coordinate::new(row), Coordinate::new(col));
            (row_cell[i], row_f[i]) = (row.cell, row.fraction);
            (col_cell[i], col_f[i]) = (col.cell, col.fraction);
            more[i] = (a_column - whole) as f32;
            dx_at[i] = (dx[i] * map.per_scale.1) as f32;
            slope[i] = -departs as f32;
        }
        for i in 0..GROUP {
            let u = dx[i] * per_r[i];
            let across = 0.5 * (1.0 - u * u) * per_r[i];
            c1[i] = u as f32;
            c2[i] = across as f32;
            c3[i] = (-across * u * per_r[i]) as f32;
            c4[i] = (across * (5.0 * u * u - 1.0) * 0.25 * per_r[i] * per_r[i]) as f32;
            inverse[i] = per_r[i] as f32;
            gain[i] = (gain_at[i] + gain_slope[i] * r[i]) as f32;
            outer[i] = (until[i] - r[i]) as f32;
            inner[i] = (from[i] - r[i]) as f32;
        }
        odd | !knots.sparse
    }

    /// What the anchors of a group need beside their values.
    #[cold]
    #[inline(never)]
    fn specials(&mut self, map: &Map<'_>, knots: &Knots, y: i64, line: usize, block: usize, ends: &mut Ends) {
        for b in block..(block + GROUP).min(self.count) {
            let at = line * self.stride + b;
            let x = self.x + (b * SIDE) as i64;
            let (dy, dx) = (y as f64 - map.axis_px.0, (x as f64 + HALF) - map.axis_px.1);
            let r = (dy * dy + dx * dx).sqrt();
            let i = self.step[at] as usize;
            let first = self.bends.len();
            let mut moves = HALF * ((knots.steps[i].h_at / r).abs() + knots.bend[i]);
            let expandable = r >= NEAR && r + HALF <= knots.last_px && !knots.sparse;
            if expandable {
                let bend = |j: usize, side: f32| Bend {
                    side,
                    at: (knots.steps[j].from - r) as f32,
                    h: knots.bends[j][3],
                    gain: knots.bends[j][4],
                };
                let outer = (i + 2..knots.steps.len()).take_while(|&j| knots.steps[j].from < r + HALF);
                self.bends.extend(outer.map(|j| bend(j, 1.0)));
                let inner = (1..i).rev().take_while(|&j| knots.steps[j].from > r - HALF);
                self.bends.extend(inner.map(|j| bend(j, -1.0)));
                moves += self.bends[first..].iter().map(|b| HALF * f64::from(b.h.abs())).sum::<f64>();
            }
            let m = knots.steps[i].h_slope + knots.steps[i].h_at / r;
            let straight = (m * map.per_scale.1 - map.whole_columns()).abs() <= 1.0;
            if r >= NEAR && r + HALF <= knots.last_px && moves <= 1.0 && straight {
                if self.bends.len() == first {
                    continue;
                }
                // `group` counted the moves of two bends; all are bounded by 1.
                let row = map.offset.0 + dy * m * map.per_scale.0;
                let col = map.offset.1 + dx * m * map.per_scale.1;
                let spread = HALF * (m * map.per_scale.1).abs() + moves + SLACK;
                ends.include((row - moves - SLACK, row + moves + SLACK), (col - spread, col + spread));
                self.specials.push(Special::Bends(first, self.bends.len()));
            } else {
                let exact = map.exactly(y, x);
                for (&row, &col) in exact.row.iter().zip(&exact.col) {
                    let (row, col) = (f64::from(row), f64::from(col));
                    ends.include((row, row), (col, col));
                }
                self.specials.push(Special::Exact(Box::new(exact)));
            }
            self.special[at] = self.specials.len() as u32;
        }
    }
}

/// A group of `values` from `at` on.
#[inline(always)]
fn part<T>(values: &mut [T], at: usize) -> &mut [T; GROUP] {
    (&mut values[at..at + GROUP]).try_into().expect("a group")
}

#[inline(always)]
fn lower(least: &mut f64, v: f64) {
    *least = if v < *least { v } else { *least };
}

#[inline(always)]
fn raise(greatest: &mut f64, v: f64) {
    *greatest = if v > *greatest { v } else { *greatest };
}

/// The least and the greatest so far, by lane.
struct Ends {
    row: ([f64; GROUP], [f64; GROUP]),
    col: ([f64; GROUP], [f64; GROUP]),
}

impl Ends {
    fn nothing() -> Self {
        let none = ([f64::INFINITY; GROUP], [f64::NEG_INFINITY; GROUP]);
        Self { row: none, col: none }
    }

    fn include(&mut self, row: (f64, f64), col: (f64, f64)) {
        self.row.0[0] = self.row.0[0].min(row.0);
        self.row.1[0] = self.row.1[0].max(row.1);
        self.col.0[0] = self.col.0[0].min(col.0);
        self.col.1[0] = self.col.1[0].max(col.1);
    }

    fn cells(&self) -> ((i64, i64), (i64, i64)) {
        let whole = |(low, high): &([f64; GROUP], [f64; GROUP])| {
            let least = low.iter().copied().fold(f64::INFINITY, f64::min);
            let greatest = high.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            (least.floor() as i64, greatest.floor() as i64)
        };
        (whole(&self.row), whole(&self.col))
    }
}
