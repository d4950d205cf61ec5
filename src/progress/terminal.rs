//! Standard output and error of the process: the only place that writes to them, so that no text of a file, a path or an argument reaches
//! a terminal unescaped (see `formats::escape`). Progress bars, drawn by `indicatif`, show numbers and words of the program alone.

#![allow(clippy::disallowed_methods, reason = "the place that they are reserved for")]

use formats::escape;
use std::io::{self, IsTerminal, Read, Write, stderr, stdout};

/// Writes lines to stderr. Errors are ignored: stderr may be closed.
pub fn error_line(line: &str) {
    let _ = writeln!(stderr(), "{}", escape::lines(line));
}

/// Writes lines to stdout, at once. JSON keeps its value.
pub fn result_line(line: &str) -> io::Result<()> {
    let mut out = stdout().lock();
    writeln!(out, "{}", escape::lines(line))?;
    out.flush()
}

/// Copies a file, or text that the program generates, to stdout as it is.
pub fn copy(from: &mut dyn Read) -> io::Result<()> {
    let mut out = stdout().lock();
    io::copy(from, &mut out)?;
    out.flush()
}

/// Whether stdout is a terminal.
pub fn is_stdout() -> bool {
    stdout().is_terminal()
}

/// Whether stderr is a terminal.
pub fn is_stderr() -> bool {
    stderr().is_terminal()
}
