//! The correction of a tile, in the cells that need it.

use super::cell::{CellScratch, Correction};
use super::edges::{Edges, LEAST_STEP_PX};
use super::layer::{CELL_PX, Layer, cells};
use crate::depth::planes::Planes;
use crate::depth::slabs::Slabs;
use crate::geometry::Rect;

/// Blur radii below this are in focus, px.
const IN_FOCUS_PX: f64 = 0.1;
/// A kernel of a smaller blur radius does not show the shape of the pupil, px.
pub(in crate::depth) const LEAST_WIDE_PX: f64 = 2.0;

impl Correction<'_> {
    /// Adds the correction of `layers`, the nearest first, with the D `doubt` of its pixels and the share of light `open` that
    /// no slab hides, to the film of `tile` whose planes have `edges`.
    pub(in crate::depth) fn add(
        &self,
        tile: Rect,
        (planes, edges): (&Planes, &Edges),
        (layers, doubt, open): (&[Layer], &[f32], &[f32]),
        film: &mut [f32],
        s: &mut CellScratch,
    ) {
        for (at, cell) in cells(tile).enumerate() {
            let seen: Vec<&Layer> = layers.iter().filter(|layer| layer.presence[at].is_seen).collect();
            if self.is_needed(at, planes, &seen) {
                let middle =
                    |first: i64| (first.div_euclid(CELL_PX) * CELL_PX) as f64 + (CELL_PX - 1) as f64 / 2.0;
                let (dy, dx) = (middle(cell.y) - self.frame.axis_px.0, middle(cell.x) - self.frame.axis_px.1);
                let pieces = self.shape.pieces(dy, dx);
                if edges.reach(cell, &pieces) {
                    self.cell(cell, tile, &pieces, planes, (&seen, doubt, open), film, s);
                }
            }
        }
    }

    /// Whether a slab out of focus covers a part of the pupil before another one out of focus in cell `at`.
    fn is_needed(&self, at: usize, planes: &Planes, layers: &[&Layer]) -> bool {
        let is_blurred = |layer: &Layer| is_blurred(self.slabs, planes.slabs[layer.plane].slab);
        let near = layers.iter().position(|near| near.presence[at].is_partial && is_blurred(near));
        near.is_some_and(|near| {
            layers[near + 1..].iter().any(|far| far.presence[at].is_present && is_blurred(far))
        })
    }
}

/// Whether a tile with `planes` may need the correction, but for their edges.
pub(in crate::depth) fn may_need(slabs: &Slabs, planes: &Planes) -> bool {
    planes.slabs.iter().filter(|plane| is_blurred(slabs, plane.slab)).count() > 1
}

/// Whether surfaces in the slabs `occupied`, within `extent_px`, are expected to have edges, both sides out of focus: an empty slab lies between them, or one
/// surface would be steep.
pub(in crate::depth) fn may_have_edges(slabs: &Slabs, occupied: &[bool], extent_px: usize) -> bool {
    let mut blurred = (0..occupied.len()).filter(|&s| occupied[s] && is_blurred(slabs, s));
    let Some(first) = blurred.next() else { return false };
    let last = blurred.next_back().unwrap_or(first);
    let range_px = slabs.blur_at(slabs.ends(last).0) - slabs.blur_at(slabs.ends(first).1);
    last > first
        && (range_px >= f64::from(LEAST_STEP_PX) * extent_px as f64
            || !occupied[first..=last].iter().all(|is| *is))
}

fn is_blurred(slabs: &Slabs, slab: usize) -> bool {
    slabs.blur_px(slab) > IN_FOCUS_PX
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_are_expected_beside_empty_slabs_and_on_steep_surfaces() {
        // 2 px of blur a slab.
        let slabs = Slabs::new(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0], 0.0, 2.0);
        let of = |occupied: [bool; 5], extent_px: usize| may_have_edges(&slabs, &occupied, extent_px);
        assert!(!of([false; 5], 100) && !of([false, true, false, false, false], 100));
        assert!(of([false, true, false, true, false], 10_000));
        // A surface of 2 to 8 px, that is 2 to 6 px at least within its slabs: 0.01 px per px over 200 px are 2 px.
        assert!(of([false, true, true, true, false], 200));
        assert!(!of([false, true, true, true, false], 201));
        let near_focus = Slabs::new(&[0.0, 0.01, 2.0, 3.0], 0.0, 2.0);
        assert!(!may_have_edges(&near_focus, &[true, false, true], 100), "one of two surfaces is in focus");
    }
}
