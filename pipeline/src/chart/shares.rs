//! Shares of pixels that shapes cover, computed once for all bands.
//!
//! The shares are most of the work of drawing and do not depend on the band. The chart is divided into cells; when the first pixel of a
//! cell is requested, its objects are found, and the shares of those with curved or slanted edges are stored as runs,
//! ```text
//! row → (first column, length) of fully covered pixels, or of pixels with a share each
//! ```
//! as long as the cache has space; others are computed again for every band. Shares are obtained from the drawing itself: an object of ink 1
//! on a pixel of 0 leaves the share, and on a pixel that is not a number leaves 1 if the pixel is covered fully.

use super::picture::Object;
use crate::geometry::{Rect, Size};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Side of a cell, px: a few cells per tile of a run, and runs whose columns fit 16 bits.
const CELL_PX: usize = 256;
/// [`Run::first`] of a fully covered run.
const COVERED: u32 = u32::MAX;

/// The cells of a chart.
pub(super) struct Cells {
    columns: usize,
    cells: Vec<OnceLock<Cell>>,
    /// Bytes of shares that may still be stored.
    left: AtomicUsize,
}

/// The objects of a cell, in the order of drawing: index, and stored shares.
type Cell = Vec<(u32, Option<Box<Shares>>)>;

/// Shares of the pixels of one object in one cell.
pub(super) struct Shares {
    area: Rect,
    /// First run of every row, and the end of the last.
    rows: Vec<u32>,
    runs: Vec<Run>,
    shares: Vec<f32>,
}

struct Run {
    /// First column, from that of the area.
    column: u16,
    length: u16,
    /// Index of its first share, or [`COVERED`].
    first: u32,
}

impl Cells {
    /// For a chart of `size` px; stores nothing until [`Cells::set_cache_bytes`].
    pub(super) fn new(size: Size) -> Self {
        let (rows, columns) = (size.height.div_ceil(CELL_PX), size.width.div_ceil(CELL_PX));
        let cells = std::iter::repeat_with(OnceLock::new).take(rows * columns).collect();
        Self { columns, cells, left: AtomicUsize::new(0) }
    }

    /// Sets the bytes of shares to store, and empties the cells.
    pub(super) fn set_cache_bytes(&mut self, bytes: usize) {
        self.cells.fill_with(OnceLock::new);
        self.left = AtomicUsize::new(bytes);
    }

    /// Bytes of shares that may still be stored.
    #[cfg(test)]
    pub(super) fn bytes_left(&self) -> usize {
        self.left.load(Ordering::Relaxed)
    }

    /// Calls `draw` for the part of `rect` in each cell and each object there, with its shares if they are stored.
    pub(super) fn for_each(
        &self,
        objects: &[Object],
        rect: Rect,
        mut draw: impl FnMut(&Object, Option<&Shares>, Rect),
    ) {
        let side = CELL_PX as i64;
        for i in rect.y.div_euclid(side)..=(rect.bottom() - 1).div_euclid(side) {
            for j in rect.x.div_euclid(side)..=(rect.right() - 1).div_euclid(side) {
                let cell = Rect::new(i * side, j * side, CELL_PX, CELL_PX);
                let found = self.cells[i as usize * self.columns + j as usize]
                    .get_or_init(|| self.find(objects, cell));
                for (index, shares) in found {
                    let object = &objects[*index as usize];
                    let area = object.bounds.intersect(cell).intersect(rect);
                    if !area.is_empty() {
                        draw(object, shares.as_deref(), area);
                    }
                }
            }
        }
    }

    fn find(&self, objects: &[Object], cell: Rect) -> Cell {
        let touching = (0..).zip(objects).filter(|(_, object)| object.may_touch(cell));
        let stored = |object: &Object| {
            if !object.has_costly_edges() || self.left.load(Ordering::Relaxed) == 0 {
                return None;
            }
            let shares = Box::new(Shares::of(object, object.bounds.intersect(cell)));
            let take = |left: usize| left.checked_sub(shares.bytes());
            match self.left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, take) {
                Ok(_) => Some(shares),
                Err(_) => {
                    // Full: later objects are not computed in vain.
                    self.left.store(0, Ordering::Relaxed);
                    None
                }
            }
        };
        touching.map(|(index, object)| (index, stored(object))).collect()
    }
}

impl Shares {
    fn of(object: &Object, area: Rect) -> Self {
        let (mut share, mut covered) =
            (vec![0.0; area.size().pixels()], vec![f32::NAN; area.size().pixels()]);
        object.paint(1.0, area, area, &mut share);
        object.paint(1.0, area, area, &mut covered);
        let mut shares =
            Self { area, rows: Vec::with_capacity(area.height + 1), runs: Vec::new(), shares: Vec::new() };
        for (share, covered) in share.chunks_exact(area.width).zip(covered.chunks_exact(area.width)) {
            shares.rows.push(shares.runs.len() as u32);
            shares.push_row(share, covered);
        }
        shares.rows.push(shares.runs.len() as u32);
        shares.runs.shrink_to_fit();
        shares.shares.shrink_to_fit();
        shares
    }

    fn push_row(&mut self, share: &[f32], covered: &[f32]) {
        let kind = |x: usize| (share[x] != 0.0, covered[x] == 1.0);
        let mut x = 0;
        while x < share.len() {
            let (touched, full) = kind(x);
            let end = (x..share.len()).find(|&i| kind(i) != (touched, full)).unwrap_or(share.len());
            if touched {
                let first = if full { COVERED } else { self.shares.len() as u32 };
                self.runs.push(Run { column: x as u16, length: (end - x) as u16, first });
                if !full {
                    self.shares.extend_from_slice(&share[x..end]);
                }
            }
            x = end;
        }
    }

    fn bytes(&self) -> usize {
        size_of::<Self>() + 4 * self.rows.len() + size_of::<Run>() * self.runs.len() + 4 * self.shares.len()
    }

    /// Paints `area`, a part of its own, in `ink`; `out` are the pixels of `rect`.
    pub(super) fn paint(&self, ink: f32, rect: Rect, area: Rect, out: &mut [f32]) {
        let (from, to) = ((area.x - self.area.x) as usize, (area.right() - self.area.x) as usize);
        for y in area.y..area.bottom() {
            let row = (y - self.area.y) as usize;
            let runs = &self.runs[self.rows[row] as usize..self.rows[row + 1] as usize];
            let line =
                &mut out[(y - rect.y) as usize * rect.width + (area.x - rect.x) as usize..][..area.width];
            let first = runs.partition_point(|run| usize::from(run.column + run.length) <= from);
            for run in &runs[first..] {
                let (start, end) =
                    (usize::from(run.column).max(from), usize::from(run.column + run.length).min(to));
                if start >= end {
                    break;
                }
                let pixels = &mut line[start - from..end - from];
                match run.first {
                    COVERED => pixels.fill(ink),
                    share => {
                        let shares = &self.shares[share as usize + start - usize::from(run.column)..];
                        pixels.iter_mut().zip(shares).for_each(|(p, share)| *p += share * (ink - *p));
                    }
                }
            }
        }
    }
}
