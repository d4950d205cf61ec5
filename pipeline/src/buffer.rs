//! f32 buffers aligned to a cache line, for aligned loads of every SIMD width.

use bytemuck::{Pod, Zeroable};

/// One cache line of f32.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(64))]
struct Line([f32; 16]);

/// `len` f32, initially zero, 64-byte aligned.
#[derive(Clone, Debug, Default)]
pub struct AlignedBuf {
    lines: Vec<Line>,
    len: usize,
}

impl AlignedBuf {
    /// A buffer of `len` zeros.
    pub fn zeroed(len: usize) -> Self {
        Self { lines: vec![Line::zeroed(); len.div_ceil(16)], len }
    }

    /// Bytes allocated.
    pub fn bytes(&self) -> usize {
        self.lines.capacity() * size_of::<Line>()
    }

    /// Resizes to `len` zeros, keeping the allocation where it is large enough.
    pub fn reset(&mut self, len: usize) {
        self.lines.resize(len.div_ceil(16), Line::zeroed());
        self.len = len;
        self.fill(0.0);
    }
}

impl std::ops::Deref for AlignedBuf {
    type Target = [f32];
    fn deref(&self) -> &[f32] {
        &bytemuck::cast_slice(&self.lines)[..self.len]
    }
}

impl std::ops::DerefMut for AlignedBuf {
    fn deref_mut(&mut self) -> &mut [f32] {
        &mut bytemuck::cast_slice_mut(&mut self.lines)[..self.len]
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
