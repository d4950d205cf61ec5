//! The limit of the size of files (`ulimit -f`, RLIMIT_FSIZE): an error of the write instead of the end of the process.

use rustix::io::Errno;
use rustix::process::{Resource, Signal, getrlimit};
use std::error::Error;
use tokio::signal::unix::{SignalKind, signal};

/// Takes the signal (SIGXFSZ) by which a write beyond the limit would end the process; the write then fails with EFBIG. Without a limit nothing
/// is done.
pub fn catch_signal() {
    if getrlimit(Resource::Fsize).current.is_none() {
        return;
    }
    // A handler of the system is installed once, and remains when the runtime ends. Without it the process ends by the signal, as by default.
    if let Ok(runtime) = tokio::runtime::Builder::new_current_thread().enable_all().build() {
        let _inside = runtime.enter();
        let _ = signal(SignalKind::from_raw(Signal::XFSZ.as_raw()));
    }
}

/// What to do about an error caused by a file that is too large; `None` for other errors.
pub fn advice(error: &anyhow::Error) -> Option<String> {
    error.chain().any(is_too_large).then(|| match getrlimit(Resource::Fsize).current {
        Some(bytes) => format!(
            "the file size limit of this process (ulimit -f) of {bytes} bytes is reached; raise it, then run the same command again"
        ),
        None => "the file system holds no file of this size; choose another directory".into(),
    })
}

/// Whether the error (without its causes) is EFBIG.
fn is_too_large(error: &(dyn Error + 'static)) -> bool {
    error.downcast_ref().is_some_and(|e| Errno::from_io_error(e) == Some(Errno::FBIG))
}
