//! Errors of the command: one line for the user, one exit code for scripts.

pub mod file_size;

use formats::chart::{ChartError, WriteError};
use formats::durable::{self, DurableError, LockError};
use formats::escape;
use formats::export::ExportError;
use formats::group::GroupError;
use formats::lens::LensPackError;
use formats::picture::PictureError;
use pipeline::cuda::CudaError;
use pipeline::executor::RunError;
use std::error::Error;

/// Exit codes; documented in `--help`, stable.
pub mod code {
    /// The command failed. Also where a file would exceed the limit of `ulimit -f`: the same command fails until that is raised.
    pub const FAILED: u8 = 1;
    /// The command line is not valid.
    pub const USAGE: u8 = 2;
    /// The output belongs to another job.
    pub const OTHER_JOB: u8 = 3;
    /// A check found errors or missing parts.
    pub const WRONG: u8 = 4;
    /// The same command may succeed later.
    pub const RETRY: u8 = 75;
    /// Interrupted; the same command resumes.
    pub const INTERRUPTED: u8 = 130;

    /// All, with their meanings for people.
    pub const MEANINGS: [(u8, &str); 7] = [
        (0, "complete"),
        (FAILED, "failed"),
        (USAGE, "usage"),
        (OTHER_JOB, "the output belongs to another job"),
        (WRONG, "a check found errors or missing parts"),
        (RETRY, "temporary error (retry)"),
        (INTERRUPTED, "interrupted (the same command resumes)"),
    ];
}

/// An error with an exit code.
#[derive(Debug, thiserror::Error)]
#[error("{message}")]
pub struct Coded {
    /// Exit code.
    pub code: u8,
    /// Message for the user.
    pub message: String,
}

/// An error of the command line.
pub fn usage(message: impl Into<String>) -> anyhow::Error {
    Coded { code: code::USAGE, message: message.into() }.into()
}

/// An output that belongs to another job.
pub fn other_job(message: impl Into<String>) -> anyhow::Error {
    Coded { code: code::OTHER_JOB, message: message.into() }.into()
}

/// Runs `step`, a part of a command with `--overwrite` or without: with it, an output of another job is removed by `remove` and made again, and one
/// of the same job is resumed.
pub fn replacing_other_job<T>(
    overwrite: bool,
    step: impl Fn() -> anyhow::Result<T>,
    remove: impl Fn() -> anyhow::Result<()>,
) -> anyhow::Result<T> {
    match step() {
        Err(e) if overwrite && exit_code(&e) == code::OTHER_JOB => {
            remove()?;
            step()
        }
        done => done,
    }
}

/// `error` in a command without `flags`: if it names one of them, with the command that has it, "`COMMAND` has it, and makes …".
pub fn without_flags(
    flags: &[&str],
    error: anyhow::Error,
    command: impl FnOnce() -> String,
) -> anyhow::Error {
    let text = line(&error);
    match flags.iter().find(|flag| text.contains(**flag)) {
        None => error,
        Some(flag) => error.context(format!("this command has no {flag}; {}", command())),
    }
}

/// The error and its causes in one line, as [`text`]; characters that a terminal obeys, which file names may contain, are escaped.
pub fn line(error: &anyhow::Error) -> String {
    escape::one_line(&text(error)).into_owned()
}

/// The error and its causes, and what to do about a file that is too large; a cause that an outer error contains is not repeated.
pub fn text(error: &anyhow::Error) -> String {
    let mut line = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if !line.contains(&cause) {
            let colon = if line.is_empty() { "" } else { ": " };
            line = format!("{line}{colon}{cause}");
        }
    }
    if let Some(advice) = file_size::advice(error) {
        line = format!("{line}; {advice}");
    }
    line
}

/// Whether the error (without its causes) is a malformed URL, or one that the environment makes malformed.
fn malformed_address(error: &(dyn Error + 'static)) -> bool {
    let address = |e: &DurableError| matches!(e, DurableError::Address { .. });
    let storage = |e: Option<&DurableError>| e.is_some_and(address);
    storage(error.downcast_ref())
        || storage(error.downcast_ref::<std::io::Error>().and_then(|e| e.get_ref()?.downcast_ref()))
        || matches!(error.downcast_ref(), Some(GroupError::Storage(e)) if address(e))
        || matches!(error.downcast_ref(), Some(ChartError::Io(e)) if address(e))
        || matches!(error.downcast_ref(), Some(WriteError::Storage(e)) if address(e))
        || matches!(error.downcast_ref(), Some(PictureError::Storage(e)) if address(e))
        || matches!(error.downcast_ref(), Some(ExportError::Storage(e)) if address(e))
}

/// Whether the same command may succeed later, by the type of the error (without its causes).
pub fn retryable(error: &(dyn Error + 'static)) -> bool {
    let is = |retry: Option<bool>| retry.unwrap_or(false);
    is(error.downcast_ref().map(GroupError::retryable))
        || is(error.downcast_ref().map(DurableError::retryable))
        || is(error.downcast_ref().map(ChartError::retryable))
        || is(error.downcast_ref().map(LockError::retryable))
        || is(error.downcast_ref().map(CudaError::retryable))
        || is(error.downcast_ref().map(durable::passes))
        || is(error.downcast_ref().map(|run: &RunError| retryable(run.cause().as_ref())))
}

/// The exit code of an error: that of the first error in its chain with a code of its own.
pub fn exit_code(error: &anyhow::Error) -> u8 {
    for cause in error.chain() {
        if let Some(coded) = cause.downcast_ref::<Coded>() {
            return coded.code;
        }
        if malformed_address(cause) || matches!(cause.downcast_ref(), Some(ChartError::Usage(_))) {
            return code::USAGE;
        }
        if retryable(cause) {
            return code::RETRY;
        }
        let other_group = matches!(
            cause.downcast_ref::<GroupError>(),
            Some(
                GroupError::Exists { .. }
                    | GroupError::NotOfKind { .. }
                    | GroupError::Replaced { .. }
                    | GroupError::Foreign { .. }
            )
        );
        let other_chart = matches!(
            cause.downcast_ref::<WriteError>(),
            Some(WriteError::Exists { .. } | WriteError::NotChart { .. } | WriteError::Foreign { .. })
        );
        let other_pack = matches!(cause.downcast_ref(), Some(LensPackError::Exists { .. }));
        if other_group || other_chart || other_pack {
            return code::OTHER_JOB;
        }
    }
    code::FAILED
}
