//! Chart coordinates of the pixels of a film row from one f64 anchor per sixteen pixels, expanded by SIMD (`lanes`).
//!
//! Film columns are divided into blocks of [`ANCHOR_SPACING_PX`] at multiples of it, independent of the rectangle being computed, so
//! the coordinates of a pixel do not depend on the rectangle. The anchor of a block is its middle pixel, at radius ρ and offset
//! (dx, dy) from the axis, computed in f64:
//! ```text
//! m = h(ρ)/ρ,   row = offset + dy·m/scale,   col = offset + dx·m/scale,   split into an integer and an f32 fraction.
//! ```
//! A pixel t columns on (|t| ≤ 8) lies δ = r − ρ farther out. With u = dx/ρ, ε = t/ρ:
//! ```text
//! δ = ρ·(uε + (1 − u²)/2·(ε² − uε³ + (5u² − 1)/4·ε⁴))                 (Taylor series of √(1 + 2uε + ε²))
//! ```
//! The field's table is linear in r between its knots r_j, with slope h′_j and change of slope κ_j = h′_j − h′_{j−1}, so exactly
//! ```text
//! h(r)/r − m = ((h′ − m)·δ + Σ_{r_j > ρ} κ_j·max(0, r − r_j) + Σ_{r_j ≤ ρ} κ_j·max(0, r_j − r)) / r
//! ```
//! and 1/r = (1 − δ/ρ)(1 + δ²/ρ²)/ρ. R follows from its own table likewise. All terms but the anchor are of the size of the change
//! within a block, for which f32 suffices.
//!
//! Error bound: beyond ρ = [`NEAR_AXIS_PX`] the Taylor series is within 1.2e-6 px of r and that of 1/r within 1e-6 of it; blocks whose
//! magnification may move a pixel by more than 1 px are not expanded. Coordinates are within 2e-6 px of the exact map, typically
//! 3e-7 (fractions are f32). Blocks that are not expanded (near the axis, large slope changes, film beyond the table) are mapped pixel by
//! pixel in f64.

#![allow(clippy::needless_range_loop, reason = "lanes of several arrays at once")]

use super::extent::{ChartExtent, GROUP, Lane, lower, raise};
use super::knots::{HALF_PX, Knots, SlopeChange};
use super::map::{ANCHOR_SPACING_PX, ExactBlock, Map, NEAR_AXIS_PX};
use crate::geometry::Rect;
use crate::resample::Coordinate;

/// Margin of the bounds on cells, px: more than any rounding.
const SLACK_PX: f64 = 1e-3;
/// A block that the values of its anchor do not suffice for.
#[derive(Clone, Debug)]
pub(super) enum Special {
    /// More slope changes than the two at the ends of the anchor's step: a range of [`Anchors::slope_changes`].
    SlopeChanges(usize, usize),
    /// Mapped pixel by pixel.
    Exact(Box<ExactBlock>),
}

/// Values of [`GROUP`] anchors, from which the coordinates of their blocks' pixels follow.
#[derive(Clone, Debug, Default)]
pub(super) struct AnchorValues {
    pub(super) row_fraction: [f32; GROUP],
    pub(super) col_fraction: [f32; GROUP],
    /// Chart columns per film column minus [`Map::integer_columns`].
    pub(super) extra_columns: [f32; GROUP],
    /// dx/scale.
    pub(super) dx: [f32; GROUP],
    /// Coefficients of t, t², t³, t⁴ in δ.
    pub(super) delta: [[f32; GROUP]; 4],
    /// 1/ρ.
    pub(super) inverse_r: [f32; GROUP],
    /// h′ − m.
    pub(super) slope: [f32; GROUP],
    /// R.
    pub(super) gain: [f32; GROUP],
    /// Outer end of the step relative to ρ, px.
    pub(super) outer: [f32; GROUP],
    /// Inner end of the step relative to ρ, px.
    pub(super) inner: [f32; GROUP],
}

/// Anchors computed together.
#[derive(Clone, Debug, Default)]
pub(super) struct Group {
    pub(super) values: AnchorValues,
    pub(super) row: [i32; GROUP],
    pub(super) col: [i32; GROUP],
    /// Step of the field.
    pub(super) step: [i32; GROUP],
    /// 0, or 1 + the index of a [`Special`].
    special: [u32; GROUP],
}

/// Anchors of a film rectangle.
#[derive(Debug, Default)]
pub(super) struct Anchors {
    /// First film column of the first block.
    pub(super) x: i64,
    /// Blocks per row.
    pub(super) count: usize,
    /// Row by row.
    groups: Vec<Group>,
    specials: Vec<Special>,
    pub(super) slope_changes: Vec<SlopeChange>,
    /// (minimum, maximum) chart row and column over all pixels.
    pub(super) cells: ((i64, i64), (i64, i64)),
}

impl Anchors {
    /// The groups of a row of the rectangle.
    #[inline(always)]
    pub(super) fn row(&self, row: usize) -> &[Group] {
        let groups = self.count.div_ceil(GROUP);
        &self.groups[row * groups..][..groups]
    }

    /// The special treatment of the `i`-th block of a group, if any.
    #[inline(always)]
    pub(super) fn special(&self, group: &Group, i: usize) -> Option<&Special> {
        match group.special[i] {
            0 => None,
            at => Some(&self.specials[at as usize - 1]),
        }
    }

    /// Computes the anchors of `rect`.
    #[inline(always)]
    pub(super) fn fill(&mut self, map: &Map<'_>, knots: &Knots, rect: Rect) {
        let side = ANCHOR_SPACING_PX as i64;
        self.x = rect.x.div_euclid(side) * side;
        self.count = ((rect.right() - self.x) as usize).div_ceil(ANCHOR_SPACING_PX);
        let groups = self.count.div_ceil(GROUP);
        self.groups.resize(groups * rect.height, Group::default());
        self.specials.clear();
        self.slope_changes.clear();
        let mut extent = ChartExtent::empty();
        for row in 0..rect.height {
            for i in 0..groups {
                let at =
                    GroupPosition { y: rect.y + row as i64, x: self.x, block: i * GROUP, count: self.count };
                let index = row * groups + i;
                if self.groups[index].fill(map, knots, &at, &mut extent) {
                    self.fill_specials(index, map, knots, &at, &mut extent);
                }
            }
        }
        self.cells = extent.cells();
    }

    /// Finds the special blocks of a group.
    #[cold]
    #[inline(never)]
    fn fill_specials(
        &mut self,
        index: usize,
        map: &Map<'_>,
        knots: &Knots,
        at: &GroupPosition,
        extent: &mut ChartExtent,
    ) {
        for b in 0..GROUP.min(at.count - at.block) {
            let x = at.x + ((at.block + b) * ANCHOR_SPACING_PX) as i64;
            let (dy, dx) = (at.y as f64 - map.axis_px.0, (x as f64 + HALF_PX) - map.axis_px.1);
            let r = (dy * dy + dx * dx).sqrt();
            let i = self.groups[index].step[b] as usize;
            let first = self.slope_changes.len();
            let mut shift = HALF_PX * ((knots.steps[i].h_at / r).abs() + knots.slope_change_sum[i]);
            let in_range = r >= NEAR_AXIS_PX && r + HALF_PX <= knots.last_px;
            if in_range && !knots.sparse {
                self.collect_slope_changes(knots, r, i);
                shift +=
                    self.slope_changes[first..].iter().map(|k| HALF_PX * f64::from(k.h.abs())).sum::<f64>();
            }
            let m = knots.steps[i].h_slope + knots.steps[i].h_at / r;
            let straight = (m * map.per_scale.1 - map.integer_columns()).abs() <= 1.0;
            if in_range && shift <= 1.0 && straight {
                if self.slope_changes.len() == first {
                    continue;
                }
                // `Group::fill` bounded the shift by two slope changes; here by all of them, at most 1.
                let row = map.offset.0 + dy * m * map.per_scale.0;
                let col = map.offset.1 + dx * m * map.per_scale.1;
                let spread = HALF_PX * (m * map.per_scale.1).abs() + shift + SLACK_PX;
                extent
                    .include((row - shift - SLACK_PX, row + shift + SLACK_PX), (col - spread, col + spread));
                self.specials.push(Special::SlopeChanges(first, self.slope_changes.len()));
            } else {
                let exact = map.exact_block(at.y, x);
                for (&row, &col) in exact.row.iter().zip(&exact.col) {
                    let (row, col) = (f64::from(row), f64::from(col));
                    extent.include((row, row), (col, col));
                }
                self.specials.push(Special::Exact(Box::new(exact)));
            }
            self.groups[index].special[b] = self.specials.len() as u32;
        }
    }

    /// Appends the slope changes within half a block of radius `r` beyond the ends of its step `i`.
    fn collect_slope_changes(&mut self, knots: &Knots, r: f64, i: usize) {
        let change = |j: usize, side: f32| SlopeChange {
            side,
            at: (knots.steps[j].from - r) as f32,
            h: knots.slope_changes(j as i32)[3],
            gain: knots.slope_changes(j as i32)[4],
        };
        let outer = (i + 2..knots.steps.len()).take_while(|&j| knots.steps[j].from < r + HALF_PX);
        self.slope_changes.extend(outer.map(|j| change(j, 1.0)));
        let inner = (1..i).rev().take_while(|&j| knots.steps[j].from > r - HALF_PX);
        self.slope_changes.extend(inner.map(|j| change(j, -1.0)));
    }
}

/// A group in film row `y`: its blocks from `block` on, of `count`, the first of which begins at column `x`.
struct GroupPosition {
    y: i64,
    x: i64,
    block: usize,
    count: usize,
}

/// Intermediate values of the anchors of a group, in f64.
#[derive(Default)]
struct AnchorLanes {
    dy: f64,
    /// Offset from the axis, radius ρ and 1/ρ.
    dx: Lane,
    r: Lane,
    per_r: Lane,
    /// The field's step at ρ.
    h_at: Lane,
    h_slope: Lane,
    gain_at: Lane,
    gain_slope: Lane,
    until: Lane,
    from: Lane,
    slope_change_sum: Lane,
    /// Chart coordinates.
    row: Lane,
    col: Lane,
    /// m − h′.
    excess: Lane,
    /// Chart columns per film column minus [`Map::integer_columns`].
    extra_columns: Lane,
    /// Bound of the shift of a pixel by the change of magnification within its block, px.
    shift: Lane,
}

impl AnchorLanes {
    /// Offsets and radii.
    #[inline(always)]
    fn locate(&mut self, map: &Map<'_>, at: &GroupPosition) {
        self.dy = at.y as f64 - map.axis_px.0;
        let first = at.x as f64 + HALF_PX - map.axis_px.1;
        let last = (at.count - 1) as f64;
        for i in 0..GROUP {
            // Past the last block of the row that block is repeated.
            let b = (at.block + i) as f64;
            self.dx[i] = first + ANCHOR_SPACING_PX as f64 * if b < last { b } else { last };
            self.r[i] = (self.dy * self.dy + self.dx[i] * self.dx[i]).sqrt();
            self.per_r[i] = 1.0 / self.r[i];
        }
    }

    /// The field's steps; `index` gets their indices.
    #[inline(always)]
    fn look_up(&mut self, map: &Map<'_>, knots: &Knots, index: &mut [i32; GROUP]) {
        for i in 0..GROUP {
            let k = map.field.step(self.r[i]);
            let s = &knots.steps[k];
            index[i] = k as i32;
            (self.h_at[i], self.h_slope[i]) = (s.h_at, s.h_slope);
            (self.gain_at[i], self.gain_slope[i]) = (s.gain_at, s.gain_slope);
            (self.until[i], self.from[i], self.slope_change_sum[i]) =
                (s.until, s.from, knots.slope_change_sum[k]);
        }
    }

    /// Chart coordinates.
    #[inline(always)]
    fn map(&mut self, map: &Map<'_>) {
        let integer_columns = map.integer_columns();
        for i in 0..GROUP {
            self.excess[i] = self.h_at[i] * self.per_r[i];
            let m = self.h_slope[i] + self.excess[i];
            self.row[i] = map.offset.0 + self.dy * m * map.per_scale.0;
            self.col[i] = map.offset.1 + self.dx[i] * m * map.per_scale.1;
            self.extra_columns[i] = m * map.per_scale.1 - integer_columns;
            self.shift[i] = HALF_PX * (self.excess[i].abs() + self.slope_change_sum[i]);
        }
    }

    /// Includes the blocks' pixels in `extent`; whether any block cannot be expanded.
    #[inline(always)]
    fn bound(&self, map: &Map<'_>, last_px: f64, extent: &mut ChartExtent) -> bool {
        let integer_columns = map.integer_columns();
        let mut unexpandable = 0.0;
        for i in 0..GROUP {
            let bad = (self.r[i] < NEAR_AXIS_PX)
                | (self.r[i] + HALF_PX > last_px)
                | (self.shift[i] > 1.0)
                | (self.extra_columns[i].abs() > 1.0);
            unexpandable += if bad { 1.0 } else { 0.0 };
            // Blocks that are mapped pixel by pixel are included then.
            let height = if bad { f64::NEG_INFINITY } else { self.shift[i] + SLACK_PX };
            let width = HALF_PX * (integer_columns + self.extra_columns[i].abs()) + height;
            lower(&mut extent.row.0[i], self.row[i] - height);
            raise(&mut extent.row.1[i], self.row[i] + height);
            lower(&mut extent.col.0[i], self.col[i] - width);
            raise(&mut extent.col.1[i], self.col[i] + width);
        }
        unexpandable > 0.0
    }
}

impl Group {
    /// Computes the anchors at `at` and includes their blocks in `extent`; whether the group may have special blocks.
    #[inline(always)]
    fn fill(&mut self, map: &Map<'_>, knots: &Knots, at: &GroupPosition, extent: &mut ChartExtent) -> bool {
        let mut lanes = AnchorLanes::default();
        lanes.locate(map, at);
        lanes.look_up(map, knots, &mut self.step);
        lanes.map(map);
        let unexpandable = lanes.bound(map, knots.last_px, extent);
        self.split_coordinates(&lanes);
        self.values.fill(map, &lanes);
        self.special = [0; GROUP];
        unexpandable | !knots.sparse
    }

    #[inline(always)]
    fn split_coordinates(&mut self, lanes: &AnchorLanes) {
        for i in 0..GROUP {
            let at = Coordinate::new(lanes.row[i]);
            (self.row[i], self.values.row_fraction[i]) = (at.cell, at.fraction);
        }
        for i in 0..GROUP {
            let at = Coordinate::new(lanes.col[i]);
            (self.col[i], self.values.col_fraction[i]) = (at.cell, at.fraction);
        }
    }
}

impl AnchorValues {
    /// Everything but the fractions.
    #[inline(always)]
    fn fill(&mut self, map: &Map<'_>, lanes: &AnchorLanes) {
        let (mut u, mut across) = ([0.0; GROUP], [0.0; GROUP]);
        for i in 0..GROUP {
            u[i] = lanes.dx[i] * lanes.per_r[i];
            across[i] = 0.5 * (1.0 - u[i] * u[i]) * lanes.per_r[i];
        }
        let [c1, c2, c3, c4] = &mut self.delta;
        to_f32(&mut self.extra_columns, &lanes.extra_columns);
        to_f32(c1, &u);
        to_f32(c2, &across);
        to_f32(&mut self.inverse_r, &lanes.per_r);
        for i in 0..GROUP {
            self.dx[i] = (lanes.dx[i] * map.per_scale.1) as f32;
        }
        for i in 0..GROUP {
            c3[i] = (-across[i] * u[i] * lanes.per_r[i]) as f32;
        }
        for i in 0..GROUP {
            c4[i] = (across[i] * (5.0 * u[i] * u[i] - 1.0) * 0.25 * lanes.per_r[i] * lanes.per_r[i]) as f32;
        }
        for i in 0..GROUP {
            self.slope[i] = -lanes.excess[i] as f32;
        }
        for i in 0..GROUP {
            self.gain[i] = (lanes.gain_at[i] + lanes.gain_slope[i] * lanes.r[i]) as f32;
        }
        for i in 0..GROUP {
            self.outer[i] = (lanes.until[i] - lanes.r[i]) as f32;
        }
        for i in 0..GROUP {
            self.inner[i] = (lanes.from[i] - lanes.r[i]) as f32;
        }
    }
}

#[inline(always)]
fn to_f32(to: &mut [f32; GROUP], from: &Lane) {
    for i in 0..GROUP {
        to[i] = from[i] as f32;
    }
}
