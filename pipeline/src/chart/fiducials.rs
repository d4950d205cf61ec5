//! Corner marks, by which a chart is found in a picture ([`measure::fiducial`](crate::measure::fiducial)).
//!
//! Each is three concentric squares of 7, 5 and 3 modules, drawn last in a corner of the film; the side of the largest is
//! `fiducials` px, a module 1/7 of it. Distances from the film's corner, modules:
//!
//! | corner | squares 7, 5, 3 | from .. to | surround |
//! |---|---|---|---|
//! | top right, bottom right, bottom left | dark, light, dark | 2 .. 9 | light, 0 .. 11 |
//! | top left | light, dark, light | 2 .. 9 | dark, 0 .. 11 down and 0 .. 14 to the right; light beyond it, 0 .. 13 and 0 .. 16 |
//!
//! The wider surround shows which of its neighbours is the top right one, so that a mirror-reversed picture is recognised. Dark and light
//! are ink and paper, of a uniform chart its value and 1/30 of it. What lies below the marks is covered: positions of targets there are not reported (`Generator::new`).

use super::drawing::Drawing;
use super::error::ChartError;
use super::targets::{INK, PAPER};
use crate::geometry::Rect;

/// Modules of the side of a mark, of its centre from the film's corner, of the light surround, and of the complete mark at the top left.
const SIDE: f64 = 7.0;
const CENTRE: f64 = 5.5;
const SURROUND: f64 = 11.0;
const LARGEST: [f64; 2] = [16.0, 13.0];

/// Smallest and largest side, px.
pub(super) const SIDE_PX: (f64, f64) = (21.0, 100_000.0);

/// Columns and rows that the largest mark covers, px.
pub(super) fn covered_px(side_px: f64) -> [f64; 2] {
    LARGEST.map(|modules| modules * side_px / SIDE)
}

impl Drawing {
    /// Draws the marks and removes the positions of targets that they cover.
    pub(super) fn fiducials(
        &mut self,
        side_px: f64,
        uniform: Option<f64>,
    ) -> Result<[(f64, f64); 4], ChartError> {
        let module = side_px / SIDE;
        let (height, width) = (self.film.height as f64, self.film.width as f64);
        // Along the longer of both surrounds of the left marks and the right one.
        let (needed_px, spacing_px) = ((LARGEST[0] + SURROUND) * module, height.min(width));
        if needed_px > spacing_px {
            return Err(ChartError::Crowded { what: "corner marks", count: 2, spacing_px, needed_px });
        }
        let (paper, ink) = match uniform {
            Some(value) => (self.inks.radiance(value), self.inks.radiance(INK / PAPER * value)),
            None => (self.inks.grey(PAPER), self.inks.grey(INK)),
        };
        let [x0, y0] = self.at(-0.5, -0.5);
        let mut centres = [(0.0, 0.0); 4];
        for (centre, (bottom, right)) in
            centres.iter_mut().zip([(false, false), (false, true), (true, true), (true, false)])
        {
            let inverted = !bottom && !right;
            let (light, dark) = if inverted { (ink, paper) } else { (paper, ink) };
            let block = |from: f64, across: f64, down: f64| {
                let along = |far: bool, origin: f64, length: f64, to: f64| match far {
                    true => [origin + length - to * module, origin + length - from * module],
                    false => [origin + from * module, origin + to * module],
                };
                let (x, y) = (along(right, x0, width, across), along(bottom, y0, height, down));
                [x[0], y[0], x[1], y[1]]
            };
            if inverted {
                self.marks.push(self.film_rect(block(0.0, LARGEST[0], LARGEST[1])));
                self.boxed(block(0.0, LARGEST[0], LARGEST[1]), paper);
                self.boxed(block(0.0, SURROUND + 3.0, SURROUND), light);
            } else {
                self.marks.push(self.film_rect(block(0.0, SURROUND, SURROUND)));
                self.boxed(block(0.0, SURROUND, SURROUND), light);
            }
            for (half, colour) in [(3.5, dark), (2.5, light), (1.5, dark)] {
                let (from, to) = (CENTRE - half, CENTRE + half);
                self.boxed(block(from, to, to), colour);
            }
            let along = |far: bool, length: f64| match far {
                true => length - CENTRE * module - 0.5,
                false => CENTRE * module - 0.5,
            };
            *centre = (along(bottom, height), along(right, width));
        }
        self.uncover();
        Ok(centres)
    }

    /// Removes points below the marks; of the rectangle of a patch or an edge the largest part that is not covered remains.
    fn uncover(&mut self) {
        let marks = &self.marks;
        let uncovered = |rect: Rect| marks.iter().fold(rect, |part, mark| largest_part(part, *mark));
        self.points.retain(|(row, column)| {
            let at = Rect::new(row.floor() as i64, column.floor() as i64, 2, 2);
            marks.iter().all(|m| m.intersect(at).is_empty())
        });
        self.patches.iter_mut().for_each(|patch| *patch = uncovered(*patch));
        self.edges.iter_mut().for_each(|edge| edge.patch = uncovered(edge.patch));
        self.edges.retain(|edge| {
            let (row, column) = edge.centre_px;
            edge.patch.contains(Rect::new(row.floor() as i64, column.floor() as i64, 2, 2))
        });
    }
}

/// The largest of the parts of `rect` above, below, left and right of `mark`.
fn largest_part(rect: Rect, mark: Rect) -> Rect {
    if rect.intersect(mark).is_empty() {
        return rect;
    }
    let part = |y: i64, x: i64, bottom: i64, right: i64| {
        Rect::new(y, x, (bottom - y).max(0) as usize, (right - x).max(0) as usize)
    };
    let parts = [
        part(rect.y, rect.x, mark.y, rect.right()),
        part(mark.bottom(), rect.x, rect.bottom(), rect.right()),
        part(rect.y, rect.x, rect.bottom(), mark.x),
        part(rect.y, mark.right(), rect.bottom(), rect.right()),
    ];
    parts.into_iter().max_by_key(|p| p.size().pixels()).unwrap_or(rect)
}
