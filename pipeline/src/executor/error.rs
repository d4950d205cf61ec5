//! Why a run stops, and what it costs.

use crate::flow::SourceSinkError;
use crate::geometry::Rect;
use crate::plan::ShardId;
use thiserror::Error;

/// Why a run stopped.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RunError {
    /// A band's stages could not be made.
    #[error("preparing its stages: {source}")]
    Prepare {
        /// Position in the job.
        position: usize,
        /// What went wrong.
        source: SourceSinkError,
    },
    /// The chart could not be read.
    #[error("reading the chart for film rows {}..{}, columns {}..{}: {source}", .rect.y, .rect.bottom(), .rect.x, .rect.right())]
    Read {
        /// Position in the job.
        position: usize,
        /// Film rectangle being made.
        rect: Rect,
        /// Shards that its light reaches and that cannot be made without it.
        shards: Vec<ShardId>,
        /// What went wrong.
        source: SourceSinkError,
    },
    /// A shard could not be encoded or written.
    #[error("making shard row {}, column {}: {source}", .id.row, .id.col)]
    Write {
        /// Which shard.
        id: ShardId,
        /// What went wrong.
        source: SourceSinkError,
    },
    /// No device is left; what the last one said.
    #[error("computing on GPUs, of which none is left: {source}")]
    Device {
        /// Position in the job.
        position: usize,
        /// What went wrong.
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
            Self::Write { id, .. } => id.band,
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
