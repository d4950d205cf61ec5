//! Errors of a run, and the shards that depend on them.

use crate::flow::SourceSinkError;
use crate::geometry::Rect;
use crate::tiling::ShardId;
use thiserror::Error;

/// Why a run stopped.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RunError {
    /// The stages of a band could not be constructed.
    #[error("preparing the band's kernels and tables: {source}")]
    Prepare {
        /// Position in the job.
        position: usize,
        /// Cause.
        source: SourceSinkError,
    },
    /// The chart could not be read.
    #[error("reading the chart for film rows {}..{}, columns {}..{}: {source}", .rect.y, .rect.bottom(), .rect.x, .rect.right())]
    Read {
        /// Position in the job.
        position: usize,
        /// Film rectangle being computed.
        rect: Rect,
        /// Shards that its contribution reaches.
        shards: Vec<ShardId>,
        /// Cause.
        source: SourceSinkError,
    },
    /// A shard could not be encoded or written.
    #[error("writing shard row {}, column {}: {source}", .id.row, .id.col)]
    Write {
        /// Which shard.
        id: ShardId,
        /// Cause.
        source: SourceSinkError,
    },
    /// The last GPU failed.
    #[error("the last GPU failed: {source}")]
    Device {
        /// Position in the job.
        position: usize,
        /// Cause.
        source: SourceSinkError,
    },
}

impl RunError {
    /// The band's position in the job.
    pub fn position(&self) -> usize {
        match self {
            Self::Prepare { position, .. } | Self::Read { position, .. } | Self::Device { position, .. } => {
                *position
            }
            Self::Write { id, .. } => id.position,
        }
    }

    /// The error of the source, the sink or the GPU.
    pub fn cause(&self) -> &SourceSinkError {
        match self {
            Self::Prepare { source, .. }
            | Self::Read { source, .. }
            | Self::Write { source, .. }
            | Self::Device { source, .. } => source,
        }
    }
}
