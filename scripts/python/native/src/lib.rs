//! `lenscube._native`: lenses for arrays in memory, of which `lenscube.Lens` is made.
//!
//! Errors are of the class `Failure`, with the exit code of the command and its message. Work is done on a thread of its own, without the interpreter's lock; the calling
//! thread looks for signals meanwhile. Arrays are of 32-bit floats, contiguous in C's order: the Python side converts them.

mod lens;
mod work;

use pyo3::prelude::*;
use std::sync::Mutex;

/// Lines of the log that Python has not taken yet.
static LINES: Mutex<Vec<String>> = Mutex::new(Vec::new());
/// Lines that are kept.
const MAX_LINES: usize = 1000;

/// Keeps a line of the log for Python.
fn keep_line(line: &str) {
    let mut lines = LINES.lock().expect("no panic while held");
    if lines.len() < MAX_LINES {
        lines.push(line.to_owned());
    }
}

/// Lenses for arrays in memory.
#[pymodule]
mod _native {
    #[pymodule_export]
    use super::lens::{NativeFilm, NativeLens};
    #[pymodule_export]
    use super::work::Failure;
    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        lenscube::log_to(super::keep_line);
        module.add("version", env!("CARGO_PKG_VERSION"))
    }

    /// The lines of the log since the last call.
    #[pyfunction]
    fn take_lines() -> Vec<String> {
        std::mem::take(&mut *super::LINES.lock().expect("no panic while held"))
    }
}
