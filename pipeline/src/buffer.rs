//! Buffers of f32: aligned to a cache line, for aligned loads of every SIMD width; of a tile; of a shard.

use crate::geometry::Size;
use bytemuck::{Pod, Zeroable};
use memmap2::MmapMut;
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering::Relaxed;

/// One cache line of f32.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(64))]
struct Line([f32; 16]);

/// `len` f32, initially zero, 64-byte aligned.
#[derive(Debug, Default)]
pub struct AlignedBuf {
    memory: Memory,
    len: usize,
}

#[derive(Debug)]
enum Memory {
    Heap(Vec<Line>),
    /// Pages of its own, which go back to the system when it is dropped.
    Mapped(Pages),
}

/// A mapping, one of [`MAX_MAPPED`].
#[derive(Debug)]
struct Pages(MmapMut);

/// Number of mappings.
static MAPPED: AtomicUsize = AtomicUsize::new(0);
/// Mappings that buffers may take, of the 65,530 that Linux grants a process.
const MAX_MAPPED: usize = 20_000;

impl Pages {
    /// Zeroed pages, unless there are too many mappings.
    fn new(bytes: usize) -> Option<Self> {
        if MAPPED.load(Relaxed) >= MAX_MAPPED {
            return None;
        }
        let map = MmapMut::map_anon(bytes).ok()?;
        MAPPED.fetch_add(1, Relaxed);
        Some(Self(map))
    }
}

impl Drop for Pages {
    fn drop(&mut self) {
        MAPPED.fetch_sub(1, Relaxed);
    }
}

impl Default for Memory {
    fn default() -> Self {
        Self::Heap(Vec::new())
    }
}

impl AlignedBuf {
    /// A buffer of `len` zeros.
    pub fn zeroed(len: usize) -> Self {
        Self { memory: Memory::Heap(vec![Line::zeroed(); len.div_ceil(16)]), len }
    }

    /// An empty buffer with `bytes` allocated in pages of its own; with none allocated if that is not possible.
    pub fn mapped(bytes: usize) -> Self {
        let pages = Pages::new(bytes.next_multiple_of(size_of::<Line>()));
        Self { memory: pages.map_or_else(Memory::default, Memory::Mapped), len: 0 }
    }

    /// Bytes allocated.
    pub fn bytes(&self) -> usize {
        match &self.memory {
            Memory::Heap(lines) => lines.capacity() * size_of::<Line>(),
            Memory::Mapped(pages) => pages.0.len(),
        }
    }

    /// Resizes to `len` zeros, keeping the allocation where it is large enough.
    pub fn reset(&mut self, len: usize) {
        self.resize(len);
        self.fill(0.0);
    }

    /// Resizes to `len` values, those of before or zeros, keeping the allocation where it is large enough.
    pub fn resize(&mut self, len: usize) {
        match &mut self.memory {
            Memory::Heap(lines) => lines.resize(len.div_ceil(16), Line::zeroed()),
            Memory::Mapped(pages) if len * size_of::<f32>() <= pages.0.len() => (),
            Memory::Mapped(_) => self.memory = Memory::Heap(vec![Line::zeroed(); len.div_ceil(16)]),
        }
        self.len = len;
    }
}

impl std::ops::Deref for AlignedBuf {
    type Target = [f32];
    fn deref(&self) -> &[f32] {
        let values: &[f32] = match &self.memory {
            Memory::Heap(lines) => bytemuck::cast_slice(lines),
            Memory::Mapped(pages) => bytemuck::cast_slice(&pages.0),
        };
        &values[..self.len]
    }
}

impl std::ops::DerefMut for AlignedBuf {
    fn deref_mut(&mut self) -> &mut [f32] {
        let values: &mut [f32] = match &mut self.memory {
            Memory::Heap(lines) => bytemuck::cast_slice_mut(lines),
            Memory::Mapped(pages) => bytemuck::cast_slice_mut(&mut pages.0),
        };
        &mut values[..self.len]
    }
}

/// Rows of a strip of [`ShardPixels`].
pub const STRIP_ROWS: usize = 256;

/// Pixels of a shard in strips of [`STRIP_ROWS`] rows, which are allocated when they are first reached: of the shards that the tiles have
/// only begun, the rows below are not in memory.
#[derive(Clone, Debug)]
pub struct ShardPixels {
    size: Size,
    strips: Vec<Vec<f32>>,
}

impl ShardPixels {
    /// A shard of `size` px without any rows yet.
    pub fn new(size: Size) -> Self {
        Self { size, strips: Vec::new() }
    }

    /// Rows of a shard of `height` px that are allocated once its first `reached` rows are.
    pub fn allocated_rows(height: usize, reached: usize) -> usize {
        reached.next_multiple_of(STRIP_ROWS).min(height)
    }

    /// Adds strips until the first `rows` rows exist; `spare` supplies buffers, whose values remain.
    pub fn reach(&mut self, rows: usize, mut spare: impl FnMut() -> Vec<f32>) {
        let allocated = Self::allocated_rows(self.size.height, rows);
        while self.strips.len() * STRIP_ROWS < allocated {
            let rows = STRIP_ROWS.min(self.size.height - self.strips.len() * STRIP_ROWS);
            let mut strip = spare();
            strip.resize(rows * self.size.width, 0.0);
            self.strips.push(strip);
        }
    }

    /// Height and width, px.
    pub fn size(&self) -> Size {
        self.size
    }

    /// Row `y`.
    ///
    /// # Panics
    /// The row has not been reached.
    pub fn row(&self, y: usize) -> &[f32] {
        &self.strips[y / STRIP_ROWS][y % STRIP_ROWS * self.size.width..][..self.size.width]
    }

    /// As [`ShardPixels::row`].
    ///
    /// # Panics
    /// The row has not been reached.
    pub fn row_mut(&mut self, y: usize) -> &mut [f32] {
        &mut self.strips[y / STRIP_ROWS][y % STRIP_ROWS * self.size.width..][..self.size.width]
    }

    /// The buffers, for reuse.
    pub fn into_strips(self) -> Vec<Vec<f32>> {
        self.strips
    }
}

/// Contribution of a tile: the tile and its tail (the margin that its PSFs reach), rows `stride` apart.
#[derive(Debug, Default)]
pub struct TileBuffer {
    /// Values, row-major.
    pub data: AlignedBuf,
    /// Values from one row to the next.
    pub stride: usize,
}

impl TileBuffer {
    /// Copies `pixels`, rows `width` wide: a tile without a tail.
    pub fn copy(&mut self, pixels: &[f32], width: usize) {
        self.stride = width;
        self.data.reset(pixels.len());
        self.data.copy_from_slice(pixels);
    }
}

/// `n` zeros, written: a page of a buffer that begins as zeros of the system and is read before it is written has two faults.
pub(crate) fn zeros(n: usize) -> Vec<f32> {
    let mut buffer = Vec::with_capacity(n);
    buffer.resize(n, 0.0);
    buffer
}

/// Resizes a buffer, discarding its values, without spare capacity: its size is part of the memory plan.
pub(crate) fn resize_exact(buffer: &mut Vec<f32>, n: usize) {
    if buffer.capacity() < n {
        *buffer = Vec::new();
        buffer.reserve_exact(n);
    }
    buffer.resize(n, 0.0);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mapped_buffers_are_kept_while_they_are_large_enough() {
        let mut buffer = AlignedBuf::mapped(1000);
        assert_eq!((buffer.bytes(), buffer.len()), (1024, 0));
        buffer.reset(256);
        buffer[255] = 1.0;
        buffer.reset(250);
        assert_eq!((buffer.bytes(), buffer.iter().sum::<f32>()), (1024, 0.0));
        buffer.reset(300);
        assert!(buffer.len() == 300 && buffer.bytes() >= 1200 && buffer.iter().all(|v| *v == 0.0));
    }
}
