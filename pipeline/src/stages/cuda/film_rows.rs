//! Film rows on a device: contributions are added to them in the order of the tiles, and finished rows are downloaded once.
//!
//! The rows are a ring: rows that tiles reach for the first time are zeroed and follow the last ones; rows that no later tile reaches are
//! downloaded and make way. So the rows of a batch and its tail suffice, for any height of the film, and a band follows the last one
//! without waiting. A row that is used again waits, on the device, for the download of the row that was there.
#![allow(unsafe_code)]

use super::batches::{AddedTiles, Window};
use crate::cuda::handle::{BLOCKING_EVENT, CudaEvent, CudaStream};
use crate::cuda::launch::{CudaFunction, LaunchConfig};
use crate::cuda::memory::STRIP_ROWS;
use crate::cuda::slice::{CudaSlice, DeviceMemory, DeviceMemoryMut, DeviceRepr};
use crate::cuda::{CudaError, Device, ptx};
use crate::geometry::Rect;
use crate::tiling::Tiling;
use std::collections::VecDeque;
use std::ops::Range;
use std::sync::Arc;

/// Threads of a thread block, which has 8 rows of 32 pixels.
const THREADS: u32 = 256;

/// `Add` in `overlap_add.cu`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
struct Add([i32; 16]);
// SAFETY: numbers in C's layout, as declared in `overlap_add.cu`.
unsafe impl DeviceRepr for Add {}

/// Film rows on a device; see the module.
#[derive(Debug)]
pub struct FilmRows {
    device: Arc<Device>,
    kernel: CudaFunction,
    rows: CudaSlice<f32>,
    /// Film columns.
    columns: Range<i64>,
    window: Window,
    /// End of the rows of each download, and the event behind it, oldest first.
    downloads: VecDeque<(u64, CudaEvent)>,
    /// End of the rows whose download the compute stream has waited for.
    free: u64,
}

impl FilmRows {
    /// `capacity` rows of the film columns `columns`.
    ///
    /// # Errors
    /// Out of memory, or another error of the driver.
    pub fn new(
        device: &Arc<Device>,
        stream: &Arc<CudaStream>,
        columns: Range<i64>,
        capacity: usize,
    ) -> Result<Self, CudaError> {
        let width = (columns.end - columns.start) as usize;
        Ok(Self {
            kernel: device.kernel(&ptx::OVERLAP_ADD, "add_tiles")?,
            rows: device.allocate(stream, capacity * width, "film rows")?,
            device: Arc::clone(device),
            columns,
            window: Window::new(capacity),
            downloads: VecDeque::new(),
            free: 0,
        })
    }

    fn width(&self) -> usize {
        (self.columns.end - self.columns.start) as usize
    }

    /// Extends the rows to those that `tiles` reach, in the order of `stream`: waits for the downloads of the rows that were in their places, and
    /// sets them to zeros.
    ///
    /// # Errors
    /// An error of the driver.
    ///
    /// # Panics
    /// If the rows do not fit.
    pub fn extend(&mut self, stream: &CudaStream, tiles: &AddedTiles) -> Result<(), CudaError> {
        let failed = || self.device.failed("extending the film rows");
        let new = self.window.reach(tiles);
        let needed = new.end.saturating_sub(self.window.capacity as u64);
        while self.free < needed {
            let (end, downloaded) = self.downloads.pop_front().expect("the ring holds the rows of a batch");
            // Downloads are done one after the other.
            if end >= needed {
                stream.wait(&downloaded).map_err(failed())?;
            }
            self.free = end;
        }
        let width = self.width();
        for part in self.window.parts(new) {
            let part = &mut self.rows.slice_mut(part.start * width..part.end * width);
            stream.fill_zeros(part).map_err(failed())?;
        }
        Ok(())
    }

    /// Adds the `contributions` of `tiles` of `tiling`, whose rows [`FilmRows::extend`] has added, in the order of `stream`: `slot` values from one
    /// tile to the next, the rows of each follow one another.
    ///
    /// # Errors
    /// An error of the driver.
    ///
    /// # Panics
    /// If `contributions` are too short.
    pub fn add(
        &mut self,
        stream: &CudaStream,
        tiling: &Tiling,
        tiles: &AddedTiles,
        contributions: &CudaSlice<f32>,
        slot: usize,
    ) -> Result<(), CudaError> {
        let width = self.width();
        let range = &tiles.range;
        assert!(!range.is_empty() && contributions.len() >= range.len() * slot);
        let (tile, tail) = (tiling.tile() as i64, 2 * tiling.margin() as i64);
        let x = (range.columns.start as i64 * tile - tail).max(self.columns.start);
        let end_x = (range.columns.end as i64 * tile).min(self.columns.end);
        let y = tiles.reached.start;
        let (height, columns) = ((tiles.reached.end - y).max(0), (end_x - x).max(0));
        if height == 0 || columns == 0 {
            return Ok(());
        }
        let [first_row, end_row, first_column, end_column] =
            [range.rows.start, range.rows.end, range.columns.start, range.columns.end].map(|v| v as i64);
        let add = [
            y,
            x,
            height,
            columns,
            self.window.place(self.window.row(y)) as i64,
            x - self.columns.start,
            self.window.capacity as i64,
            width as i64,
            first_row,
            end_row,
            first_column,
            end_column,
            tile,
            tail,
            tiling.grown().width as i64,
            slot as i64,
        ];
        let add = Add(add.map(|v| i32::try_from(v).expect("films are below 2^31 px wide")));
        let shape = LaunchConfig {
            grid_dim: ((columns as u32).div_ceil(32), (height as u32).div_ceil(THREADS / 32), 1),
            block_dim: (THREADS, 1, 1),
            shared_mem_bytes: 0,
        };
        let mut launch = stream.launch_builder(&self.kernel);
        launch.arg(&add).arg(contributions).arg(&self.rows);
        // SAFETY: add_tiles(Add, float *, float *); the contributions of all tiles are present, and `extend` has checked that the rows fit.
        unsafe { launch.launch(shape) }.map_err(self.device.failed("adding tiles"))
    }

    /// Downloads the finished rows of `tiles` in the order of `stream`, which waits for the addition: [`strips`] of them to `into`. After
    /// that the rows may be used again.
    ///
    /// # Errors
    /// An error of the driver.
    pub fn download<'a>(
        &mut self,
        stream: &CudaStream,
        tiles: &AddedTiles,
        into: impl Iterator<Item = &'a mut [f32]>,
    ) -> Result<(), CudaError> {
        let width = self.width();
        for (rows, to) in strips(&tiles.finished).zip(into) {
            let mut done = 0;
            for part in self.window.parts(self.window.row(rows.start)..self.window.row(rows.end)) {
                let n = part.len() * width;
                let from = self.rows.slice(part.start * width..part.end * width);
                stream
                    .memcpy_dtoh(&from, &mut to[done..done + n])
                    .map_err(self.device.failed("downloading film rows"))?;
                done += n;
            }
        }
        if !tiles.finished.is_empty() {
            let event =
                stream.record_event(BLOCKING_EVENT).map_err(self.device.failed("downloading film rows"))?;
            self.downloads.push_back((self.window.row(tiles.finished.end), event));
        }
        Ok(())
    }

    /// The film rectangle of `rows`.
    pub fn rect(&self, rows: &Range<i64>) -> Rect {
        Rect::new(rows.start, self.columns.start, (rows.end - rows.start) as usize, self.width())
    }
}

/// Film rows in parts of at most [`STRIP_ROWS`], as they are downloaded.
pub fn strips(rows: &Range<i64>) -> impl Iterator<Item = Range<i64>> + use<> {
    let end = rows.end;
    (rows.start..end).step_by(STRIP_ROWS).map(move |start| start..(start + STRIP_ROWS as i64).min(end))
}
