//! The chart rectangle that a film rectangle is made from, bounded without mapping its pixels.
//!
//! Within one step of the field's table h/r = h′ + c/r is monotone in r, so over a small piece of film h/r lies between its
//! values at the piece's least and greatest radius and at the knots between; with (dy, dx) between their ends, so does
//! (dy, dx)·h/r. Pieces of [`PIECE`] px a side: the bound exceeds the exact one by about a pixel.

use super::Remap;
use super::map::Map;
use crate::field::{Field, Stretch};
use crate::geometry::Rect;
use crate::plan::Tiling;
use crate::real;
use crate::resample::box_span;

/// Side of a piece, film px.
const PIECE: usize = 32;
/// More than any rounding of a coordinate, px.
const SLACK: f64 = 1e-3;

type Span = (f64, f64);

impl Remap {
    /// The chart rectangle, surround included, that holds every tap of the film rectangle `rect`: what goes to a GPU.
    pub fn upload_rect(&self, rect: Rect) -> Rect {
        let (mut rows, mut cols) = (NOTHING, NOTHING);
        let map = Map::new(&self.frame, &self.field);
        for piece in rect.tiles(PIECE, PIECE) {
            let (row, col) = map.bound(piece);
            rows = (rows.0.min(row.0), rows.1.max(row.1));
            cols = (cols.0.min(col.0), cols.1.max(col.1));
        }
        let (sy, sx) = self.frame.scale;
        if sy.min(sx) >= 1.0 {
            let cells = |(low, high): Span| (low.floor() as i64, high.floor() as i64);
            return self.reading.needs((cells(rows), cells(cols))).0;
        }
        let boxes = |(low, high): Span, scale: f64| {
            let width = (1.0 / scale).max(1.0);
            let ((first, _), (last, n)) = (box_span(low, width), box_span(high, width));
            (first, (last - first) as usize + n)
        };
        let ((y, height), (x, width)) = (boxes(rows, sy), boxes(cols, sx));
        Rect::new(y, x, height, width)
    }
}

/// Chart rectangles of this many pixels need no closer look.
const SMALL_PX: f64 = (1u64 << 18) as f64;
/// Up to this stretch the bound of the whole film is near enough that of its strips.
const USUAL_STRETCH: f64 = 4.0;
/// Most strips looked at one by one.
const MAX_STRIPS: usize = 1 << 20;

impl Remap {
    /// The most chart pixels, surround included, that a worker holds at a time for tiles of `tiling`, or a bound of them
    /// where that is small.
    ///
    /// With J the Jacobian of the remap, |J_yy| ≤ max(h/r, h′) and |J_yx| ≤ |h′ − h/r|/2, so a strip of H × W film px spans at
    /// most H·|J_yy| + W·|J_yx| rows of a chart of scale 1. Strips for which this bound exceeds the most found so far are
    /// bounded piece by piece ([`Remap::upload_rect`]).
    pub fn most_chart_px(&self, tiling: &Tiling) -> u64 {
        let (rows, cols) = self.strip();
        let (rows, cols) = (rows.min(tiling.tile()), cols.min(tiling.tile()));
        let largest = self.strip_bound_px(Rect::new(0, 0, rows, cols), self.farthest_px(tiling.grown()));
        let (down, across) = tiling.count();
        let strips = [down, across, tiling.tile().div_ceil(rows), tiling.tile().div_ceil(cols)];
        let few = strips.iter().try_fold(1usize, |n, &s| n.checked_mul(s)).is_some_and(|n| n <= MAX_STRIPS);
        if largest <= SMALL_PX || self.stretch(tiling).greatest <= USUAL_STRETCH || !few {
            return largest as u64;
        }
        let mut most = 0u64;
        for tile in (0..down).flat_map(|i| (0..across).map(move |j| (i, j))) {
            for strip in tiling.rect(tile).tiles(rows, cols) {
                if self.strip_bound_px(strip, self.farthest_px(strip)) > most as f64 {
                    let need = self.upload_rect(strip);
                    most = most.max((need.height as u64).saturating_mul(need.width as u64));
                }
            }
        }
        most
    }

    /// The stretch of the remap over the film and its margin.
    pub fn stretch(&self, tiling: &Tiling) -> Stretch {
        self.field.stretch(self.farthest_px(tiling.grown()))
    }

    fn farthest_px(&self, rect: Rect) -> f64 {
        self.frame.farthest_mm(rect) / self.frame.pitch_mm()
    }

    /// Bound of the chart pixels of a strip whose pixels lie within `reach_px` of the axis.
    fn strip_bound_px(&self, strip: Rect, reach_px: f64) -> f64 {
        let Stretch { greatest, shear, .. } = self.field.stretch(reach_px);
        let side = |own: usize, other: usize, scale: f64| {
            let span = (own as f64 * greatest + other as f64 * shear) / scale;
            // Taps, or the box of a film pixel, and rounding.
            span + (1.0 / scale).max(1.0) + 6.0
        };
        let (sy, sx) = self.frame.scale;
        side(strip.height, strip.width, sy) * side(strip.width, strip.height, sx)
    }
}

const NOTHING: Span = (f64::INFINITY, f64::NEG_INFINITY);

impl Map<'_> {
    /// Bounds of the chart row and column of every pixel of `piece`.
    fn bound(&self, piece: Rect) -> (Span, Span) {
        let ends =
            |first: i64, n: usize, axis: f64| (first as f64 - axis, (first + n as i64 - 1) as f64 - axis);
        let dy = ends(piece.y, piece.height, self.axis_px.0);
        let dx = ends(piece.x, piece.width, self.axis_px.1);
        let least = |d: Span| if d.0 <= 0.0 && d.1 >= 0.0 { 0.0 } else { d.0.abs().min(d.1.abs()) };
        let greatest = |d: Span| d.0.abs().max(d.1.abs());
        let m = magnification(
            self.field,
            (real::hypot(least(dy), least(dx)), real::hypot(greatest(dy), greatest(dx))),
        );
        let span = |d: Span, offset: f64, per_scale: f64| {
            let products = [d.0 * m.0, d.0 * m.1, d.1 * m.0, d.1 * m.1].map(|p| offset + p * per_scale);
            let least = products.iter().copied().fold(f64::INFINITY, f64::min);
            (least - SLACK, products.iter().copied().fold(f64::NEG_INFINITY, f64::max) + SLACK)
        };
        (span(dy, self.offset.0, self.per_scale.0), span(dx, self.offset.1, self.per_scale.1))
    }
}

/// Between what h/r lies for radii between `from` and `to`, px.
fn magnification(field: &Field, (from, to): Span) -> Span {
    let steps = field.steps();
    let last = to.min(field.last_px());
    let knots = steps[field.step(from.min(last))..].iter().map(|s| s.from);
    let between = knots.skip_while(|&r| r <= from).take_while(|&r| r < last);
    let at = |r: f64| field.at(r).0;
    between.map(at).fold(bounds(at(from), at(to)), |b, m| (b.0.min(m), b.1.max(m)))
}

fn bounds(a: f64, b: f64) -> Span {
    (a.min(b), a.max(b))
}
