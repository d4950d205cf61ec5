//! I/O boundaries of the pipeline: the source of chart pixels and the sink of film shards.

use crate::buffer::ShardPixels;
use crate::geometry::{Rect, Size};
use crate::tiling::ShardId;

/// Error of a source or sink.
pub type SourceSinkError = Box<dyn std::error::Error + Send + Sync>;

/// A chart, read in rectangles of one band. Called from many threads at once.
///
/// ```
/// use lenscube_pipeline::flow::{ChartSource, SourceSinkError};
/// use lenscube_pipeline::geometry::{Rect, Size};
///
/// /// A ramp from 0 to 1 along x.
/// struct Ramp(Size);
///
/// impl ChartSource for Ramp {
///     fn size(&self) -> Size {
///         self.0
///     }
///     fn read(&self, _band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
///         for row in out.chunks_exact_mut(rect.width) {
///             for (x, value) in (rect.x..).zip(row) {
///                 *value = x as f32 / (self.0.width - 1) as f32;
///             }
///         }
///         Ok(())
///     }
/// }
///
/// let mut pixels = [0.0; 4];
/// Ramp(Size::new(100, 101)).read(0, Rect::new(7, 49, 2, 2), &mut pixels).unwrap();
/// assert_eq!(pixels, [0.49, 0.5, 0.49, 0.5]);
/// ```
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
///
/// ```
/// use lenscube_pipeline::buffer::ShardPixels;
/// use lenscube_pipeline::flow::{FilmSink, SourceSinkError};
/// use lenscube_pipeline::geometry::{Rect, Size};
/// use lenscube_pipeline::tiling::ShardId;
/// use std::sync::Mutex;
///
/// /// The largest value of each shard.
/// #[derive(Default)]
/// struct Peaks(Mutex<Vec<(ShardId, f32)>>);
///
/// impl FilmSink for Peaks {
///     type Encoded = (ShardId, f32);
///     fn encode(&self, id: ShardId, rect: Rect, pixels: &ShardPixels) -> Result<Self::Encoded, SourceSinkError> {
///         Ok((id, (0..rect.height).flat_map(|y| pixels.row(y)).copied().fold(0.0, f32::max)))
///     }
///     fn commit(&self, peak: Self::Encoded) -> Result<u64, SourceSinkError> {
///         self.0.lock().unwrap().push(peak);
///         Ok(0)
///     }
/// }
///
/// let mut shard = ShardPixels::new(Size::new(2, 3));
/// shard.reach(2, Vec::new);
/// shard.row_mut(1)[2] = 0.7;
/// let id = ShardId { position: 0, region: 0, row: 0, col: 0 };
/// let peaks = Peaks::default();
/// peaks.commit(peaks.encode(id, Rect::new(0, 0, 2, 3), &shard).unwrap()).unwrap();
/// assert_eq!(peaks.0.into_inner().unwrap(), [(id, 0.7)]);
/// ```
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
