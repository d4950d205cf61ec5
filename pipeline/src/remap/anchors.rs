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
pub(super) const GROUP: usize = 8;

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

/// What an anchor gives its pixels.
pub(super) const VALUES: usize = 13;

/// Anchors made together, side by side.
#[derive(Clone, Debug)]
pub(super) struct Group {
    /// Fractions of row and column; chart columns that a film column moves, less [`Map::whole_columns`]; dx/scale; δ's
    /// coefficients of t, t², t³, t⁴; 1/ρ; h′ − m; R; ends of the step relative to ρ.
    pub(super) values: [[f32; GROUP]; VALUES],
    pub(super) row: [i32; GROUP],
    pub(super) col: [i32; GROUP],
    /// Step of the field.
    pub(super) step: [i32; GROUP],
    /// 0, or 1 + the index of a [`Special`].
    special: [u32; GROUP],
}

impl Group {
    const EMPTY: Self = Self {
        values: [[0.0; GROUP]; VALUES],
        row: [0; GROUP],
        col: [0; GROUP],
        step: [0; GROUP],
        special: [0; GROUP],
    };
}

/// Anchors of a strip.
#[derive(Debug, Default)]
pub(super) struct Anchors {
    /// First film column of the first block.
    pub(super) x: i64,
    /// Blocks of a line.
    pub(super) count: usize,
    /// Line by line.
    groups: Vec<Group>,
    specials: Vec<Special>,
    pub(super) bends: Vec<Bend>,
    /// (least, greatest) chart row and column of any pixel.
    pub(super) ends: ((i64, i64), (i64, i64)),
}

impl Anchors {
    /// The groups of a line.
    #[inline(always)]
    pub(super) fn line(&self, line: usize) -> &[Group] {
        let groups = self.count.div_ceil(GROUP);
        &self.groups[line * groups..][..groups]
    }

    /// What is special about the `i`-th block of a group, if anything.
    #[inline(always)]
    pub(super) fn special(&self, group: &Group, i: usize) -> Option<&Special> {
        match group.special[i] {
            0 => None,
            at => Some(&self.specials[at as usize - 1]),
        }
    }

    /// Makes the anchors of `strip`.
    #[inline(always)]
    pub(super) fn fill(&mut self, map: &Map<'_>, knots: &Knots, strip: Rect) {
        let side = SIDE as i64;
        self.x = strip.x.div_euclid(side) * side;
        self.count = ((strip.right() - self.x) as usize).div_ceil(SIDE);
        let groups = self.count.div_ceil(GROUP);
        self.groups.resize(groups * strip.height, Group::EMPTY);
        self.specials.clear();
        self.bends.clear();
        let mut ends = Ends::nothing();
        for line in 0..strip.height {
            for i in 0..groups {
                let (y, block) = (strip.y + line as i64, i * GROUP);
                let at = line * groups + i;
                let odd = group(&mut self.groups[at], map, knots, y, (self.x, block, self.count), &mut ends);
                if odd {
                    self.specials(at, map, knots, y, block, &mut ends);
                }
            }
        }
        self.ends = ends.cells();
    }

    /// What the anchors of a group need beside their values.
    #[cold]
    #[inline(never)]
    fn specials(&mut self, at: usize, map: &Map<'_>, knots: &Knots, y: i64, block: usize, ends: &mut Ends) {
        for b in 0..GROUP.min(self.count - block) {
            let x = self.x + ((block + b) * SIDE) as i64;
            let (dy, dx) = (y as f64 - map.axis_px.0, (x as f64 + HALF) - map.axis_px.1);
            let r = (dy * dy + dx * dx).sqrt();
            let i = self.groups[at].step[b] as usize;
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
            self.groups[at].special[b] = self.specials.len() as u32;
        }
    }
}

type Lane = [f64; GROUP];

/// The anchors of the line `y` from the `block`-th on, of `count` whose first begins at column `x`; whether any needs more.
#[inline(always)]
fn group(
    to: &mut Group,
    map: &Map<'_>,
    knots: &Knots,
    y: i64,
    (x, block, count): (i64, usize, usize),
    ends: &mut Ends,
) -> bool {
    const NONE: Lane = [0.0; GROUP];
    let dy = y as f64 - map.axis_px.0;
    let first = x as f64 + HALF - map.axis_px.1;
    let last = (count - 1) as f64;
    let (mut dx, mut r, mut per_r) = (NONE, NONE, NONE);
    for i in 0..GROUP {
        // Behind the line's last block it stands again.
        let b = (block + i) as f64;
        dx[i] = first + SIDE as f64 * if b < last { b } else { last };
        r[i] = (dy * dy + dx[i] * dx[i]).sqrt();
        per_r[i] = 1.0 / r[i];
    }
    let (mut h_at, mut h_slope, mut gain_at, mut gain_slope) = (NONE, NONE, NONE, NONE);
    let (mut until, mut from, mut bend) = (NONE, NONE, NONE);
    for i in 0..GROUP {
        let k = map.field.step(r[i]);
        let s = &knots.steps[k];
        to.step[i] = k as i32;
        (h_at[i], h_slope[i], gain_at[i], gain_slope[i]) = (s.h_at, s.h_slope, s.gain_at, s.gain_slope);
        (until[i], from[i], bend[i]) = (s.until, s.from, knots.bend[k]);
    }
    let whole = map.whole_columns();
    let (mut departs, mut more, mut row, mut col, mut moves) = (NONE, NONE, NONE, NONE, NONE);
    let mut odd = 0.0;
    for i in 0..GROUP {
        departs[i] = h_at[i] * per_r[i]; // m − h′
        let m = h_slope[i] + departs[i];
        row[i] = map.offset.0 + dy * m * map.per_scale.0;
        col[i] = map.offset.1 + dx[i] * m * map.per_scale.1;
        more[i] = m * map.per_scale.1 - whole;
        moves[i] = HALF * (departs[i].abs() + bend[i]);
    }
    for i in 0..GROUP {
        let bad = (r[i] < NEAR) | (r[i] + HALF > knots.last_px) | (moves[i] > 1.0) | (more[i].abs() > 1.0);
        odd += if bad { 1.0 } else { 0.0 };
        // Blocks that are mapped exactly bound themselves.
        let tall = if bad { f64::NEG_INFINITY } else { moves[i] + SLACK };
        let wide = HALF * (whole + more[i].abs()) + tall;
        lower(&mut ends.row.0[i], row[i] - tall);
        raise(&mut ends.row.1[i], row[i] + tall);
        lower(&mut ends.col.0[i], col[i] - wide);
        raise(&mut ends.col.1[i], col[i] + wide);
    }
    let [row_f, col_f, more_f, dx_f, c1, c2, c3, c4, inverse, slope, gain, outer, inner] = &mut to.values;
    for i in 0..GROUP {
        let at = Coordinate::new(row[i]);
        (to.row[i], row_f[i]) = (at.cell, at.fraction);
    }
    for i in 0..GROUP {
        let at = Coordinate::new(col[i]);
        (to.col[i], col_f[i]) = (at.cell, at.fraction);
    }
    let (mut u, mut across) = (NONE, NONE);
    for i in 0..GROUP {
        u[i] = dx[i] * per_r[i];
        across[i] = 0.5 * (1.0 - u[i] * u[i]) * per_r[i];
    }
    narrow(more_f, more);
    narrow(c1, u);
    narrow(c2, across);
    narrow(inverse, per_r);
    for i in 0..GROUP {
        dx_f[i] = (dx[i] * map.per_scale.1) as f32;
    }
    for i in 0..GROUP {
        c3[i] = (-across[i] * u[i] * per_r[i]) as f32;
    }
    for i in 0..GROUP {
        c4[i] = (across[i] * (5.0 * u[i] * u[i] - 1.0) * 0.25 * per_r[i] * per_r[i]) as f32;
    }
    for i in 0..GROUP {
        slope[i] = -departs[i] as f32;
    }
    for i in 0..GROUP {
        gain[i] = (gain_at[i] + gain_slope[i] * r[i]) as f32;
    }
    for i in 0..GROUP {
        outer[i] = (until[i] - r[i]) as f32;
    }
    for i in 0..GROUP {
        inner[i] = (from[i] - r[i]) as f32;
    }
    to.special = [0; GROUP];
    (odd > 0.0) | !knots.sparse
}

#[inline(always)]
fn narrow(to: &mut [f32; GROUP], from: Lane) {
    for i in 0..GROUP {
        to[i] = from[i] as f32;
    }
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
