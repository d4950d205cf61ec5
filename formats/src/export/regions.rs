//! Order and size of reads for a file whose tiles contain all bands.
//!
//! A region is a rectangle that is read at a time, in all bands. It has the rows of one row of the source's chunks, and as many columns
//! of chunks as fit in memory: then every chunk is decoded once. Regions follow each other down the columns. If the exported rectangle
//! does not begin at a chunk edge, two regions share a row of chunks, which stays in the source's cache of [`Regions::cache_bytes`]; only
//! chunks at the edges between columns of regions are decoded twice. If memory is too small for the rows of a chunk, a region has fewer
//! rows, and a chunk is decoded once for each region in it ([`Regions::decoded`]).

use super::{ExportError, Samples};
use pipeline::geometry::{Rect, Size};

/// Maximum bytes of a tile: larger ones are not faster, and each thread has several in memory.
const MAX_TILE_BYTES: usize = 8 << 20;
/// Copies of a tile in memory while a thread compresses it: gathered, reordered, compressed; an upper bound.
const TILE_COPIES: usize = 4;
/// Bounds of the tile side, px.
const MAX_TILE: usize = 256;
const MIN_TILE: usize = 16;

/// Plan of the reads of an export.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Regions {
    /// Side of the file's tiles.
    pub tile: usize,
    /// Rows and columns of a region.
    pub region: Size,
    /// Required size of the source's cache in bytes.
    pub cache_bytes: usize,
    /// Mean number of times that a chunk is decoded.
    pub decoded: f64,
}

impl Regions {
    /// Plans for `memory` bytes in total: a region, tiles being compressed, and the source's cache.
    ///
    /// # Errors
    /// [`ExportError::Memory`] if a region of one tile does not fit.
    pub fn plan(samples: &Samples<'_>, bytes_per_sample: usize, memory: usize) -> Result<Self, ExportError> {
        let (bands, rect) = (samples.bands(), samples.rect);
        let mut tile = MAX_TILE;
        while tile > MIN_TILE && tile * tile * bands * bytes_per_sample > MAX_TILE_BYTES {
            tile /= 2;
        }
        let chunk = samples.chunk;
        // Without compressed chunks a read costs the same at any position.
        let aligned_rows = chunk.height == 1
            || (rect.y as usize).is_multiple_of(chunk.height) && chunk.height.is_multiple_of(tile);
        let (up_rows, up_columns) = (chunk.height.next_multiple_of(tile), chunk.width.next_multiple_of(tile));
        let fixed = samples.threads
            * (TILE_COPIES * tile * tile * bands * bytes_per_sample.max(4) + 8 * chunk.pixels());
        let rest = memory.saturating_sub(fixed);
        // Columns that fit in a region of `rows` rows; the cache has the `cached` rows of the two rows of chunks that it overlaps.
        let fits = |rows: usize, cached: usize| rest / ((rows + cached) * bands * 4);
        let mut rows = up_rows.min(rect.height.next_multiple_of(tile));
        let mut cached = if aligned_rows || rows >= rect.height { 0 } else { 2 * chunk.height };
        let mut columns = fits(rows, cached);
        if columns
            < up_columns.min(rect.width.next_multiple_of(tile)) + if cached > 0 { chunk.width } else { 0 }
        {
            (rows, cached) = (tile, 0);
            columns = fits(rows, 0);
        } else if cached > 0 {
            columns -= chunk.width;
        }
        if columns < tile {
            let minimum = fixed + tile * tile * bands * 4;
            return Err(ExportError::Memory { given: memory, minimum, bands, threads: samples.threads });
        }
        let step = if up_columns <= columns { up_columns } else { tile };
        let columns = (columns / step * step).min(rect.width.next_multiple_of(tile));
        let region = Size::new(rows, columns);
        let cache_bytes = cached * (columns + chunk.width) * bands * 4;
        let overlapped =
            |first: i64, end: i64, side: usize| (end as usize).div_ceil(side) - first as usize / side;
        let across = |r: &Rect| overlapped(r.x, r.right(), chunk.width);
        let down = |r: &Rect| overlapped(r.y, r.bottom(), chunk.height);
        let plan = Self { tile, region, cache_bytes, decoded: 1.0 };
        let decoded_chunks: usize = match cached {
            0 => plan.rects(rect).map(|r| across(&r) * down(&r)).sum(),
            _ => plan.rects(rect).filter(|r| r.y == rect.y).map(|r| across(&r) * down(&rect)).sum(),
        };
        Ok(Self { decoded: decoded_chunks as f64 / (across(&rect) * down(&rect)) as f64, ..plan })
    }

    /// The regions of `rect`, down the columns.
    pub fn rects(&self, rect: Rect) -> impl Iterator<Item = Rect> + use<> {
        split(rect, self.region, true)
    }

    /// Whether chunks are decoded repeatedly because memory is too small for their rows.
    pub fn is_short_of_memory(&self) -> bool {
        self.decoded > 1.5
    }
}

/// Parts of `rect` of at most `part`, from its first pixel; `down`: column by column, else row by row.
pub(super) fn split(rect: Rect, part: Size, down: bool) -> impl Iterator<Item = Rect> + use<> {
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
