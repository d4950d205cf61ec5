//! The limit of the size of files (`ulimit -f`, RLIMIT_FSIZE): an error of the write instead of the end of the process.

use rustix::io::Errno;
use rustix::process::{Resource, Signal, getrlimit};
use std::error::Error;
use std::sync::Arc;

/// Takes the signal (SIGXFSZ) by which a write beyond the limit would end the process; the write then fails with EFBIG. Without a limit nothing
/// is done.
pub fn catch_signal() {
    if getrlimit(Resource::Fsize).current.is_none() {
        return;
    }
    // Without the handler the process ends by the signal, as by default.
    let _ = signal_hook::flag::register(Signal::XFSZ.as_raw(), Arc::default());
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
