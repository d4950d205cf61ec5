//! The correction of a tile, in the cells that need it.

use super::cell::{CellScratch, Correction};
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
    /// no slab hides, to the film of `tile`.
    pub(in crate::depth) fn add(
        &self,
        tile: Rect,
        planes: &Planes,
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
                self.cell(cell, tile, &pieces, planes, (&seen, doubt, open), film, s);
            }
        }
    }

    /// Whether a slab out of focus covers a part of the pupil before another one out of focus in cell `at`.
    fn is_needed(&self, at: usize, planes: &Planes, layers: &[&Layer]) -> bool {
        let slab = |layer: &Layer| planes.slabs[layer.plane].slab;
        let mut partial = layers.iter().enumerate().filter(|(_, near)| near.presence[at].is_partial);
        partial.any(|(i, near)| {
            let mut behind = layers[i + 1..].iter().filter(|far| far.presence[at].is_present);
            behind.any(|far| may_hide(self.slabs, slab(far), slab(near)))
        })
    }
}

/// Whether a tile with `planes` may need the correction.
pub(in crate::depth) fn may_need(slabs: &Slabs, planes: &Planes) -> bool {
    let all = &planes.slabs;
    (0..all.len()).any(|far| all[far + 1..].iter().any(|near| may_hide(slabs, all[far].slab, near.slab)))
}

/// Whether slabs `far` < `near` are of two surfaces, both out of focus.
fn may_hide(slabs: &Slabs, far: usize, near: usize) -> bool {
    slabs.blur_px(far) > IN_FOCUS_PX && slabs.blur_px(near) > IN_FOCUS_PX && slabs.apart(far, near)
}
