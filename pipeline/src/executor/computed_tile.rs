//! A computed tile on its way to the shards.

use crate::buffer::TileBuffer;

/// Contribution of a tile.
pub(super) enum TileOutput {
    /// Computed by a worker.
    Cpu(TileBuffer),
    /// The chart could not be read: the shards that the tile reaches are dropped.
    Unreadable,
}

/// A tile of the job: position of its band, sequence number among all tiles, row and column in the band.
#[derive(Clone, Copy, Debug)]
pub(super) struct TileId {
    pub(super) position: usize,
    pub(super) sequence: usize,
    pub(super) tile: (usize, usize),
}

/// A computed tile.
pub(super) struct ComputedTile {
    pub(super) place: TileId,
    pub(super) output: TileOutput,
}

impl ComputedTile {
    /// Its values, row-major, and the number of values from one row to the next.
    pub(super) fn pixels(&self) -> (&[f32], usize) {
        match &self.output {
            TileOutput::Cpu(buffer) => (&buffer.data, buffer.stride),
            TileOutput::Unreadable => unreachable!("it is discarded, not added"),
        }
    }
}
