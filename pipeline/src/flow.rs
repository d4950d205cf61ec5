//! I/O boundaries of the pipeline: the source of chart pixels and the sink of film shards.

use crate::buffer::ShardPixels;
use crate::geometry::{Rect, Size};
use crate::plan::ShardId;

/// Error of a source or sink.
pub type SourceSinkError = Box<dyn std::error::Error + Send + Sync>;

/// A chart, read in rectangles of one band. Called from many threads at once.
pub trait ChartSource: Sync {
    /// Chart size in pixels.
    fn size(&self) -> Size;

    /// Fills `out` (row-major, `rect.height` × `rect.width`) with the pixels of `rect`, which lies inside the chart.
    ///
    /// # Errors
    /// The pixels cannot be read; the message names band, row and column.
    fn read(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError>;

    /// Announces that these pixels, approximately, will be read soon, so that a source may prefetch them. Returns at once; errors are
    /// reported when the pixels are read.
    fn prefetch(&self, _band: usize, _rect: Rect) {}
}

/// The sink of finished shards. `encode` only computes and runs on the workers; `commit` writes, on separate threads.
pub trait FilmSink: Sync {
    /// An encoded shard.
    type Encoded: Send;

    /// Encodes the pixels of shard `id`, `rect` of the film.
    ///
    /// # Errors
    /// A value outside the range of the film's sample type.
    fn encode(&self, id: ShardId, rect: Rect, pixels: &ShardPixels)
    -> Result<Self::Encoded, SourceSinkError>;

    /// Writes one shard atomically; returns the bytes written.
    ///
    /// # Errors
    /// The store cannot be written.
    fn commit(&self, encoded: Self::Encoded) -> Result<u64, SourceSinkError>;

    /// Shards written concurrently; most of that time is latency of the disk or the network.
    fn writers(&self) -> usize {
        2
    }
}
