//! The doors of the pipeline: where charts come from and films go to. Implemented by stores, by generators, by tests.

use crate::geometry::{Rect, Size};

/// An error of a source or a sink, kept with its own words.
pub type DoorError = Box<dyn std::error::Error + Send + Sync>;

/// A chart that hands out rectangles of one band. Called from many threads at once.
pub trait ChartSource: Sync {
    /// Chart size in pixels.
    fn size(&self) -> Size;

    /// Fills `out` (row-major, `rect.height` × `rect.width`) with the pixels of `rect`, which lies inside the chart.
    ///
    /// # Errors
    /// Whatever keeps the pixels from being read, in words for the user: it names band, row and column.
    fn read(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), DoorError>;
}
