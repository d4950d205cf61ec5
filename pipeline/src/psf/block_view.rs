//! What an engine computes with: pixels of a block, and spectra of nodes.

use super::grid::Node;
use super::polar::BlockPlace;
use crate::buffer::AlignedBuf;
use std::sync::Arc;

/// Pixels of a block of the remapped image inside a larger buffer.
#[derive(Clone, Copy, Debug)]
pub struct BlockView<'a> {
    /// The buffer from the block's first pixel on.
    pub pixels: &'a [f32],
    /// Pixels from one row to the next.
    pub stride: usize,
    /// Position of the block relative to the axis, and its size.
    pub place: BlockPlace,
}

/// Source of node spectra for an engine.
pub trait Spectra {
    /// The spectrum of `node`, in the layout of the engine.
    fn get(&self, node: Node) -> Arc<AlignedBuf>;
}
