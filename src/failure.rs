//! Errors on their way out: one line for the user, one exit code for scripts.

use formats::chart::{ChartError, WriteError};
use formats::durable::{self, DurableError, LockError};
use formats::export::ExportError;
use formats::film::FilmError;
use formats::picture::PictureError;
use pipeline::cuda::CudaError;
use pipeline::executor::RunError;
use std::error::Error;

/// Exit codes; documented in `--help`, stable.
pub mod code {
    /// Something failed.
    pub const FAILED: u8 = 1;
    /// The command line asks for what cannot be.
    pub const USAGE: u8 = 2;
    /// The output belongs to another job.
    pub const OTHER_JOB: u8 = 3;
    /// Checked, and found wrong or incomplete.
    pub const WRONG: u8 = 4;
    /// The same command may succeed later.
    pub const RETRY: u8 = 75;
    /// Interrupted; the same command resumes.
    pub const INTERRUPTED: u8 = 130;
}

/// An error that knows its exit code.
#[derive(Debug, thiserror::Error)]
#[error("{message}")]
pub struct Coded {
    /// Exit code.
    pub code: u8,
    /// What the user reads.
    pub message: String,
}

/// A command line that asks for what cannot be.
pub fn usage(message: impl Into<String>) -> anyhow::Error {
    Coded { code: code::USAGE, message: message.into() }.into()
}

/// An output that belongs to another job.
pub fn other_job(message: impl Into<String>) -> anyhow::Error {
    Coded { code: code::OTHER_JOB, message: message.into() }.into()
}

/// The error and its causes in one line; what an error above has told already is not told again. Control characters, which file names
/// may hold, are escaped.
pub fn line(error: &anyhow::Error) -> String {
    let mut line = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if !line.contains(&cause) {
            let colon = if line.is_empty() { "" } else { ": " };
            line = format!("{line}{colon}{cause}");
        }
    }
    line.chars().map(|c| if c.is_control() { c.escape_default().to_string() } else { c.into() }).collect()
}

/// Whether an address, or what the environment adds to it, is malformed, by the type of this one error.
fn malformed_address(error: &(dyn Error + 'static)) -> bool {
    let address = |e: &DurableError| matches!(e, DurableError::Address { .. });
    let storage = |e: Option<&DurableError>| e.is_some_and(address);
    storage(error.downcast_ref())
        || storage(error.downcast_ref::<std::io::Error>().and_then(|e| e.get_ref()?.downcast_ref()))
        || matches!(error.downcast_ref(), Some(FilmError::Storage(e)) if address(e))
        || matches!(error.downcast_ref(), Some(ChartError::Io(e)) if address(e))
        || matches!(error.downcast_ref(), Some(WriteError::Storage(e)) if address(e))
        || matches!(error.downcast_ref(), Some(PictureError::Storage(e)) if address(e))
        || matches!(error.downcast_ref(), Some(ExportError::Storage(e)) if address(e))
}

/// Whether the same command may succeed later, by the type of this one error.
pub fn retryable(error: &(dyn Error + 'static)) -> bool {
    let is = |retry: Option<bool>| retry.unwrap_or(false);
    is(error.downcast_ref().map(FilmError::retryable))
        || is(error.downcast_ref().map(DurableError::retryable))
        || is(error.downcast_ref().map(ChartError::retryable))
        || is(error.downcast_ref().map(LockError::retryable))
        || is(error.downcast_ref().map(CudaError::retryable))
        || is(error.downcast_ref().map(durable::passes))
        || is(error.downcast_ref().map(|run: &RunError| retryable(run.cause().as_ref())))
}

/// The exit code of an error, by type, wherever it stands in the chain.
pub fn exit_code(error: &anyhow::Error) -> u8 {
    for cause in error.chain() {
        if let Some(coded) = cause.downcast_ref::<Coded>() {
            return coded.code;
        }
        if malformed_address(cause) {
            return code::USAGE;
        }
        if retryable(cause) {
            return code::RETRY;
        }
        let other_film = matches!(
            cause.downcast_ref::<FilmError>(),
            Some(
                FilmError::Exists { .. }
                    | FilmError::NotFilm { .. }
                    | FilmError::Replaced { .. }
                    | FilmError::Foreign { .. }
            )
        );
        let other_chart = matches!(
            cause.downcast_ref::<WriteError>(),
            Some(WriteError::Exists { .. } | WriteError::NotChart { .. } | WriteError::Foreign { .. })
        );
        if other_film || other_chart {
            return code::OTHER_JOB;
        }
    }
    code::FAILED
}
