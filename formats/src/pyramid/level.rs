//! The levels of a pyramid.

use pipeline::geometry::Size;
use pipeline::tiling::FilmRegion;

/// Maximum side of the last level, px.
const MAX_LAST_SIDE: usize = 256;

/// Sizes of the levels of an image, beginning with the image itself.
pub fn level_sizes(size: Size) -> Vec<Size> {
    let half = |s: &Size| {
        let is_last = s.height.max(s.width) <= MAX_LAST_SIDE;
        (!is_last).then(|| Size::new(s.height.div_ceil(2), s.width.div_ceil(2)))
    };
    std::iter::successors(Some(size), half).collect()
}

/// A level other than the array itself.
#[derive(Clone, Copy, Debug)]
pub(super) struct Level {
    /// Index of the array.
    pub(super) output: usize,
    /// From 1.
    pub(super) number: usize,
    /// Its shards; `rect` is the complete level.
    pub(super) grid: FilmRegion,
}

impl Level {
    /// All shards: band, (row, column).
    pub(super) fn shards(&self, bands: usize) -> impl Iterator<Item = (usize, (usize, usize))> + use<> {
        let (rows, columns) = self.grid.count();
        (0..bands).flat_map(move |b| (0..rows).flat_map(move |i| (0..columns).map(move |j| (b, (i, j)))))
    }
}
