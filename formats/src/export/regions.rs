//! What is read at once for a file whose tiles hold all bands.
//!
//! A region is all bands of some rows and columns. Rows are those of the source's pieces and columns whole pieces, as many as
//! memory holds: then every piece is decoded once. Regions go down the columns, so that for a window that does not begin where
//! pieces do, the row of pieces that two regions share stays in the source's cache, which this plan says the size of; then only
//! pieces across the edges between columns of regions are decoded twice. Where memory does not hold the rows of one piece, rows
//! are fewer and a piece is decoded once for each part of it; the plan tells how often.

use super::{ExportError, Samples};
use pipeline::geometry::{Rect, Size};

/// Most bytes of a tile: above it nothing gets faster, and each thread holds several.
const TILE_BYTES: usize = 8 << 20;
/// Copies of a tile that a thread holds while it is compressed: as put together, as reordered, as compressed.
const TILE_COPIES: usize = 4;
const MAX_TILE: usize = 256;
const MIN_TILE: usize = 16;

/// How a window is read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Regions {
    /// Side of the file's tiles.
    pub tile: usize,
    /// Rows and columns of a region.
    pub region: Size,
    /// Bytes that the source's cache should hold.
    pub cache_bytes: usize,
    /// How often a piece is decoded, in the mean.
    pub decoded: f64,
}

impl Regions {
    /// Plans for `memory` bytes, which hold regions, tiles in work and the source's cache.
    ///
    /// # Errors
    /// [`ExportError::Memory`] if they do not hold one row of tiles of the source's pieces.
    pub fn plan(samples: &Samples<'_>, bytes_per_sample: usize, memory: usize) -> Result<Self, ExportError> {
        let (bands, window) = (samples.bands(), samples.window);
        let mut tile = MAX_TILE;
        while tile > MIN_TILE && tile * tile * bands * bytes_per_sample > TILE_BYTES {
            tile /= 2;
        }
        let piece = samples.piece;
        // A source without pieces is read at any place at the same cost.
        let whole_rows = piece.height == 1
            || (window.y as usize).is_multiple_of(piece.height) && piece.height.is_multiple_of(tile);
        let (up_rows, up_columns) = (up(piece.height, tile), up(piece.width, tile));
        let fixed = samples.threads
            * (TILE_COPIES * tile * tile * bands * bytes_per_sample.max(4) + 8 * piece.pixels());
        let rest = memory.saturating_sub(fixed);
        // Columns that fit if a region has so many rows; the cache holds the two rows of pieces that it touches.
        let fits = |rows: usize, cached: usize| rest / ((rows + cached) * bands * 4);
        let mut rows = up_rows.min(up(window.height, tile));
        let mut cached = if whole_rows || rows >= window.height { 0 } else { 2 * piece.height };
        let mut columns = fits(rows, cached);
        if columns < up_columns.min(up(window.width, tile)) + if cached > 0 { piece.width } else { 0 } {
            (rows, cached) = (tile, 0);
            columns = fits(rows, 0);
        } else if cached > 0 {
            columns -= piece.width;
        }
        if columns < tile {
            let least = fixed + tile * tile * bands * 4;
            return Err(ExportError::Memory { given: memory, least, bands, threads: samples.threads });
        }
        let step = if up_columns <= columns { up_columns } else { tile };
        let columns = (columns / step * step).min(up(window.width, tile));
        let region = Size::new(rows, columns);
        let cache_bytes = cached * (columns + piece.width) * bands * 4;
        let touched =
            |first: i64, end: i64, side: usize| (end as usize).div_ceil(side) - first as usize / side;
        let across = |rect: &Rect| touched(rect.x, rect.right(), piece.width);
        let down = |rect: &Rect| touched(rect.y, rect.bottom(), piece.height);
        let all = Self { tile, region, cache_bytes, decoded: 1.0 };
        let pieces: usize = match cached {
            0 => all.rects(window).map(|r| across(&r) * down(&r)).sum(),
            _ => all.rects(window).filter(|r| r.y == window.y).map(|r| across(&r) * down(&window)).sum(),
        };
        Ok(Self { decoded: pieces as f64 / (across(&window) * down(&window)) as f64, ..all })
    }

    /// The regions of `window`, down the columns.
    pub fn rects(&self, window: Rect) -> impl Iterator<Item = Rect> + use<> {
        cut(window, self.region, true)
    }

    /// Whether pieces are decoded more often than at the edges of regions.
    pub fn is_short_of_memory(&self) -> bool {
        self.decoded > 1.5
    }
}

/// `rect` in parts of at most `part`, from its first pixel on; `down`: column by column.
pub(super) fn cut(rect: Rect, part: Size, down: bool) -> impl Iterator<Item = Rect> + use<> {
    let (rows, columns) = (rect.height.div_ceil(part.height), rect.width.div_ceil(part.width));
    (0..rows * columns).map(move |n| {
        let (i, j) = if down { (n % rows, n / rows) } else { (n / columns, n % columns) };
        let (y, x) = (i * part.height, j * part.width);
        Rect::new(
            rect.y + y as i64,
            rect.x + x as i64,
            part.height.min(rect.height - y),
            part.width.min(rect.width - x),
        )
    })
}

/// The least multiple of `step` that holds `n`.
fn up(n: usize, step: usize) -> usize {
    n.div_ceil(step) * step
}
