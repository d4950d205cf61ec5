//! Export to standard output (`-`): by way of a temporary file, since a file of a film is not written in order.

use super::to_file;
use crate::args::{ExportArgs, ExportFormatArg};
use crate::failure::usage;
use crate::progress::terminal;
use anyhow::{Context, Result};
use formats::durable;
use std::fs::{self, File};
use std::io::ErrorKind;
use std::path::PathBuf;

/// A directory that is removed when dropped.
struct TempDirectory(PathBuf);

impl TempDirectory {
    fn create() -> Result<Self> {
        let temp = std::env::temp_dir();
        // Leftover directories of killed exports.
        durable::sweep_entries(&temp)?;
        let path = temp.join(durable::temp_name());
        fs::create_dir(&path)
            .with_context(|| format!("creating the temporary directory {}", path.display()))?;
        Ok(Self(path))
    }
}

impl Drop for TempDirectory {
    fn drop(&mut self) {
        // What remains is in the system's temporary directory.
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// Writes the file of `args` to standard output: a PNG, unless `--format` is given.
pub fn command(args: &ExportArgs) -> Result<u8> {
    let format = args.format.unwrap_or(ExportFormatArg::Png);
    if format == ExportFormatArg::Envi {
        return Err(usage("-: an ENVI image is two files; use another --format, or a path"));
    }
    if terminal::is_stdout() {
        return Err(usage("-: standard output is a terminal; redirect it, e.g. `> film.png`"));
    }
    let directory = TempDirectory::create()?;
    let path = directory.0.join("out");
    let code = to_file(&ExportArgs { temporary: Some(path.clone()), ..args.clone() }, format)?;
    if code != 0 {
        return Ok(code);
    }
    let mut file = File::open(&path).context("reading the temporary file")?;
    match terminal::copy(&mut file) {
        // As `| head`.
        Err(e) if e.kind() == ErrorKind::BrokenPipe => Ok(0),
        copied => copied.map(|()| 0).context("writing to standard output"),
    }
}
