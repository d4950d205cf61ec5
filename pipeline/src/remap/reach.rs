//! Bounds of the chart rectangle that a film rectangle needs, without mapping its pixels.
//!
//! Within one step of the field's table h/r = h′ + c/r is monotone in r, so over a small square of film h/r lies between the minimum
//! and maximum of its values at the square's smallest and largest radius and at the knots between, and (dy, dx)·h/r between the
//! products of the extremes. With squares of [`SQUARE_PX`] the bound exceeds the exact rectangle by about a pixel. Lenses without rotational symmetry:
//! `planar/reach.rs`.

use super::Remap;
use super::chart_map::ChartMap;
use super::map::Map;
use crate::field::{Field, Stretch};
use crate::geometry::Rect;
use crate::real;
use crate::resample::box_span;
use crate::tiling::Tiling;

/// Side of a square, film px.
const SQUARE_PX: usize = 32;
/// Margin of coordinates, px: more than any rounding.
pub(super) const SLACK_PX: f64 = 1e-3;

/// (minimum, maximum).
pub(super) type Span = (f64, f64);

pub(super) const EMPTY: Span = (f64::INFINITY, f64::NEG_INFINITY);

/// The span of both.
pub(super) fn union(a: Span, b: Span) -> Span {
    (a.0.min(b.0), a.1.max(b.1))
}

impl Remap {
    /// A chart rectangle, surround included, that contains every tap of the film rectangle `rect`: the upload for a GPU.
    pub fn upload_rect(&self, rect: Rect) -> Rect {
        let (mut rows, mut cols) = (EMPTY, EMPTY);
        let map = self.map();
        for square in rect.tiles(SQUARE_PX, SQUARE_PX) {
            let (row, col) = map.bound(square);
            (rows, cols) = (union(rows, row), union(cols, col));
        }
        let (sy, sx) = self.frame.scale;
        if sy.min(sx) >= 1.0 {
            let cells = |(low, high): Span| (low.floor() as i64, high.floor() as i64);
            return self.interpolation.chart_rect((cells(rows), cells(cols))).0;
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

/// Bounds up to this many chart pixels are not refined.
const SMALL_PX: f64 = (1u64 << 18) as f64;
/// Up to this stretch the bound over the complete film is close to that of each part.
const USUAL_STRETCH: f64 = 4.0;
/// Largest number of parts that are bounded one by one.
const MAX_PARTS: usize = 1 << 20;

impl Remap {
    /// Upper bound of the chart pixels, surround included, that a worker holds at a time for tiles of `tiling`; tight if it is large.
    ///
    /// With J the Jacobian of the map, |J_yy| ≤ max(h/r, h′) and |J_yx| ≤ |h′ − h/r|/2 ([`Stretch`]), so a part of H × W film px spans at most
    /// H·|J_yy| + W·|J_yx| rows of a chart of scale 1. Parts for which this bound exceeds the maximum so far are bounded by
    /// [`Remap::upload_rect`].
    pub fn max_chart_px(&self, tiling: &Tiling) -> u64 {
        let (rows, cols) = self.part_size();
        let (rows, cols) = (rows.min(tiling.tile()), cols.min(tiling.tile()));
        let stretch = self.stretch(tiling);
        let bound = self.part_bound_px(Rect::new(0, 0, rows, cols), stretch);
        let (down, across) = tiling.count();
        let parts = [down, across, tiling.tile().div_ceil(rows), tiling.tile().div_ceil(cols)];
        let few = parts.iter().try_fold(1usize, |n, &s| n.checked_mul(s)).is_some_and(|n| n <= MAX_PARTS);
        if bound <= SMALL_PX || stretch.greatest <= USUAL_STRETCH || !few {
            return bound as u64;
        }
        let mut max = 0u64;
        for tile in (0..down).flat_map(|i| (0..across).map(move |j| (i, j))) {
            for part in tiling.rect(tile).tiles(rows, cols) {
                if self.part_bound_px(part, self.stretch_over(part)) > max as f64 {
                    let rect = self.upload_rect(part);
                    max = max.max((rect.height as u64).saturating_mul(rect.width as u64));
                }
            }
        }
        max
    }

    /// The stretch of the map over the film and its margin.
    pub fn stretch(&self, tiling: &Tiling) -> Stretch {
        self.stretch_over(tiling.grown())
    }

    /// The stretch of the map over `rect`; for a lens with rotational symmetry over all radii up to the farthest in it.
    fn stretch_over(&self, rect: Rect) -> Stretch {
        match self.map() {
            ChartMap::Radial(map) => map.field.stretch(self.frame.farthest_mm(rect) / self.frame.pitch_mm()),
            ChartMap::Planar(map) => map.stretch(rect),
        }
    }

    /// Upper bound of the chart pixels of a part on which the map stretches by `stretch`.
    fn part_bound_px(&self, part: Rect, Stretch { greatest, shear, .. }: Stretch) -> f64 {
        let side = |along: usize, other: usize, scale: f64| {
            let span = (along as f64 * greatest + other as f64 * shear) / scale;
            // Taps, or the box of a film pixel, and rounding.
            span + (1.0 / scale).max(1.0) + 6.0
        };
        let (sy, sx) = self.frame.scale;
        side(part.height, part.width, sy) * side(part.width, part.height, sx)
    }
}

impl Map<'_> {
    /// Bounds of the chart rows and columns of the pixels of `rect`.
    pub(super) fn bound(&self, rect: Rect) -> (Span, Span) {
        let ends =
            |first: i64, n: usize, axis: f64| (first as f64 - axis, (first + n as i64 - 1) as f64 - axis);
        let dy = ends(rect.y, rect.height, self.axis_px.0);
        let dx = ends(rect.x, rect.width, self.axis_px.1);
        let nearest = |d: Span| if d.0 <= 0.0 && d.1 >= 0.0 { 0.0 } else { d.0.abs().min(d.1.abs()) };
        let farthest = |d: Span| d.0.abs().max(d.1.abs());
        let m = magnification(
            self.field,
            (real::hypot(nearest(dy), nearest(dx)), real::hypot(farthest(dy), farthest(dx))),
        );
        let span = |d: Span, offset: f64, per_scale: f64| {
            let products = [d.0 * m.0, d.0 * m.1, d.1 * m.0, d.1 * m.1].map(|p| offset + p * per_scale);
            let min = products.iter().copied().fold(f64::INFINITY, f64::min);
            (min - SLACK_PX, products.iter().copied().fold(f64::NEG_INFINITY, f64::max) + SLACK_PX)
        };
        (span(dy, self.offset.0, self.per_scale.0), span(dx, self.offset.1, self.per_scale.1))
    }
}

/// Minimum and maximum of h/r for radii between `from` and `to`, px.
fn magnification(field: &Field, (from, to): Span) -> Span {
    let steps = field.steps();
    let last = to.min(field.last_px());
    let knots = steps[field.step(from.min(last))..].iter().map(|s| s.from);
    let between = knots.skip_while(|&r| r <= from).take_while(|&r| r < last);
    let at = |r: f64| field.at(r).0;
    between.map(at).fold((at(from).min(at(to)), at(from).max(at(to))), |b, m| (b.0.min(m), b.1.max(m)))
}
