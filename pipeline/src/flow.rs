//! Where charts are read from and shards of the film are written to. Implemented by stores, by generators, by tests.

use crate::geometry::{Rect, Size};
use crate::plan::ShardId;

/// An error of a chart source or a film sink, with its own message.
pub type SourceSinkError = Box<dyn std::error::Error + Send + Sync>;

/// A chart that hands out rectangles of one band. Called from many threads at once.
pub trait ChartSource: Sync {
    /// Chart size in pixels.
    fn size(&self) -> Size;

    /// Fills `out` (row-major, `rect.height` × `rect.width`) with the pixels of `rect`, which lies inside the chart.
    ///
    /// # Errors
    /// Whatever keeps the pixels from being read, in words for the user: it names band, row and column.
    fn read(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError>;

    /// Says that about these pixels will be read soon: a source on a disk may start fetching them. Returns at once, changes
    /// nothing, and whatever fails here fails again, and is told, when they are read.
    fn prefetch(&self, _band: usize, _rect: Rect) {}
}

/// Where finished shards go. `encode` is pure computing and runs on the workers; `commit` does the writing, elsewhere.
pub trait FilmSink: Sync {
    /// A shard ready to be written.
    type Encoded: Send;

    /// Encodes the pixels of one shard (row-major, `rect` of the film).
    ///
    /// # Errors
    /// A value that the film's type cannot hold.
    fn encode(&self, id: ShardId, rect: Rect, pixels: &[f32]) -> Result<Self::Encoded, SourceSinkError>;

    /// Writes one shard: absent or complete, never half. Returns the bytes written.
    ///
    /// # Errors
    /// What the store says: disk full, permission, gone.
    fn commit(&self, encoded: Self::Encoded) -> Result<u64, SourceSinkError>;

    /// Shards to write at once: each waits most of the time, on a disk or on the way to a store.
    fn writers(&self) -> usize {
        2
    }
}
