//! What the correction needs of a slab that `composite` has laid over a tile.

use crate::depth::planes::for_each_row;
use crate::geometry::Rect;

/// Side of the cells of the film, px: pieces of the pupil are those of a cell's middle.
pub(super) const CELL_PX: i64 = 64;
/// Least U that is divided by.
pub(in crate::depth) const FLOOR: f32 = 1e-3;
/// Shares of the light below this count less for what is unknown behind them.
pub(super) const FEW: f32 = 0.01;
/// Shares of the light below this are not seen.
const SEEN: f32 = 1e-5;
/// Shares of the light below this do not count as present, those above one minus this as all.
pub(super) const PRESENT: f32 = 1e-3;

/// What `composite` found of one slab of a tile.
#[derive(Debug)]
pub(in crate::depth) struct Layer {
    /// Index in the tile's planes.
    pub(in crate::depth) plane: usize,
    /// g of each pixel; `None`: 1 everywhere.
    pub(in crate::depth) gain: Option<Vec<f32>>,
    /// Per cell of the tile.
    pub(super) presence: Vec<Presence>,
}

/// How much of a slab is seen in a cell: of T w, the share of the light of a pixel that it hides and that nothing in front does.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Presence {
    /// Some of it.
    pub(super) is_seen: bool,
    /// More than a little.
    pub(super) is_present: bool,
    /// And it covers a part of the pupil of a pixel only.
    pub(super) is_partial: bool,
}

impl Layer {
    /// Of the slab at `plane` of the planes of `tile`, with its shares w, T w and g of the tile's pixels. Raises their `doubt` D.
    pub(in crate::depth) fn new(
        plane: usize,
        tile: Rect,
        share: &[f32],
        visible: &[f32],
        gain: Vec<f32>,
        doubt: &mut [f32],
    ) -> Self {
        for ((doubt, g), visible) in doubt.iter_mut().zip(&gain).zip(visible) {
            *doubt = doubt.max((g - 1.0) * (visible / FEW).clamp(0.0, 1.0));
        }
        let presence = |cell: Rect| {
            let mut presence = Presence::default();
            for_each_row(tile, cell, |first, _, width| {
                for i in first..first + width {
                    presence.is_seen |= visible[i] > SEEN;
                    presence.is_present |= visible[i] > PRESENT;
                    presence.is_partial |= visible[i] > PRESENT && share[i] < 1.0 - PRESENT;
                }
            });
            presence
        };
        let presence = cells(tile).map(presence).collect();
        let is_one = gain.iter().all(|g| *g <= 1.0 + 1e-6);
        Self { plane, gain: (!is_one).then_some(gain), presence }
    }
}

/// The cells of a tile: parts of it in squares of a grid from the film's first pixel, row by row.
pub(super) fn cells(tile: Rect) -> impl Iterator<Item = Rect> {
    let steps = |first: i64, end: i64| {
        (first.div_euclid(CELL_PX)..(end - 1).div_euclid(CELL_PX) + 1).map(|i| i * CELL_PX)
    };
    steps(tile.y, tile.bottom()).flat_map(move |y| {
        let square = move |x| Rect::new(y, x, CELL_PX as usize, CELL_PX as usize).intersect(tile);
        steps(tile.x, tile.right()).map(square)
    })
}
