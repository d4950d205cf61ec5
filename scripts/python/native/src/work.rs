//! Work beside the interpreter: signals end it, its errors become exceptions.

use anyhow::Result;
use pyo3::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::time::Duration;

/// Time between two looks for signals.
const SIGNALS_EVERY: Duration = Duration::from_millis(50);

pyo3::create_exception!(_native, Failure, pyo3::exceptions::PyException, "(exit code, message)");

/// The exception of `error`.
pub fn failure(error: &anyhow::Error) -> PyErr {
    Failure::new_err(lenscube::code_and_message(error))
}

/// Does `work` on a thread of its own, which a signal tells to end; it is waited for, as it uses arrays of the interpreter.
pub fn cancellable<T: Send>(
    py: Python<'_>,
    work: impl FnOnce(&AtomicBool) -> Result<T> + Send,
) -> PyResult<T> {
    let cancel = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let (sender, results) = mpsc::channel();
        let cancel = &cancel;
        scope.spawn(move || sender.send(work(cancel)));
        result_of(py, results, |results| {
            cancel.store(true, Ordering::SeqCst);
            let _ = py.detach(move || results.recv());
        })
    })
}

/// Does `work` on a thread of its own. A signal ends the call at once; the thread goes on, so that what it traces is in the cache for the next call.
pub fn abandonable<T: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce() -> Result<T> + Send + 'static,
) -> PyResult<T> {
    let (sender, results) = mpsc::channel();
    std::thread::spawn(move || sender.send(work()));
    result_of(py, results, drop)
}

/// The result that arrives; after a signal `interrupted` is called and the signal's exception returned.
fn result_of<T: Send>(
    py: Python<'_>,
    mut results: Receiver<Result<T>>,
    interrupted: impl FnOnce(Receiver<Result<T>>),
) -> PyResult<T> {
    loop {
        let (receiver, result) = py.detach(move || {
            let result = results.recv_timeout(SIGNALS_EVERY);
            (results, result)
        });
        results = receiver;
        match result {
            Ok(result) => return result.map_err(|error| failure(&error)),
            Err(RecvTimeoutError::Timeout) => {
                if let Err(signal) = py.check_signals() {
                    interrupted(results);
                    return Err(signal);
                }
            }
            // The thread panicked.
            Err(RecvTimeoutError::Disconnected) => {
                return Err(Failure::new_err((1, "lenscube failed inside; please report what was called")));
            }
        }
    }
}
