//! Descriptors that the kernels of `psf.cu` read: one structure here for each in `descriptors.cuh`.

use bytemuck::{Pod, Zeroable};

/// `Block` in `descriptors.cuh`: a block of a tile's remapped pixels and its place about the optical axis.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Block {
    pub(super) dy: f64,
    pub(super) dx: f64,
    pub(super) r: f64,
    pub(super) azimuth: f64,
    pub(super) cosine: f32,
    pub(super) sine: f32,
    pub(super) half_y: f32,
    pub(super) half_x: f32,
    pub(super) remapped: u64,
    pub(super) stride: u32,
    pub(super) rows: u32,
    pub(super) cols: u32,
    pub(super) height: u32,
    pub(super) width: u32,
    pub(super) near_axis: u32,
    pub(super) packed: u32,
    pub(super) unused: u32,
}
const _: () = assert!(size_of::<Block>() == 88);

/// `Weight` in `descriptors.cuh`: a node's weight over a block, and its spectrum.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Weight {
    pub(super) rise: f32,
    pub(super) rise_at: f32,
    pub(super) fall: f32,
    pub(super) fall_at: f32,
    pub(super) azimuth: f32,
    pub(super) per_rad: f32,
    pub(super) spectrum: u32,
    pub(super) unused: u32,
}
const _: () = assert!(size_of::<Weight>() == 32);

/// `Job` in `descriptors.cuh`: a node group of a block with one part of their kernels.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Job {
    pub(super) packed: u32,
    pub(super) height: u32,
    pub(super) width: u32,
    pub(super) first: u32,
    pub(super) end: u32,
    pub(super) part: u32,
    pub(super) unused: [u32; 2],
}
const _: () = assert!(size_of::<Job>() == 32);

/// `KernelPart` in `descriptors.cuh`: a part of a node's kernel to be transformed.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct KernelPart {
    pub(super) base: u32,
    pub(super) transposed: u32,
    pub(super) quarter_turns: u32,
    pub(super) y: u32,
    pub(super) x: u32,
    pub(super) rows: u32,
    pub(super) cols: u32,
    pub(super) spectrum: u32,
}
const _: () = assert!(size_of::<KernelPart>() == 32);

/// `Tile` in `descriptors.cuh`: a tile's contribution and its blocks.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Tile {
    pub(super) remapped: u64,
    pub(super) contribution: u64,
    pub(super) stride: u32,
    pub(super) rows: u32,
    pub(super) cols: u32,
    pub(super) block_y: u32,
    pub(super) block_x: u32,
    pub(super) down: u32,
    pub(super) across: u32,
    pub(super) last_rows: u32,
    pub(super) last_cols: u32,
    pub(super) first: u32,
}
const _: () = assert!(size_of::<Tile>() == 56);

/// `BlockImages` in `descriptors.cuh`: the images of a block.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct BlockImages {
    pub(super) first: u32,
    pub(super) groups: u32,
}
const _: () = assert!(size_of::<BlockImages>() == 8);
