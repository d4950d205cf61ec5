//! Files that a command writes where the user says: never in place of its inputs ([`Guard`]), and one that exists is replaced with `--overwrite`
//! only.

mod guard;
mod job;
pub mod page;
mod place;

pub use guard::Guard;
pub use place::resolve_links;

use crate::failure::other_job;
use anyhow::{Context, Result};
use std::io::ErrorKind;
use std::path::Path;

/// Fails (exit code 3) if something exists at `path`, unless `overwrite`.
pub fn check_absent(path: &Path, overwrite: bool) -> Result<()> {
    match overwrite || path.symlink_metadata().is_err() {
        true => Ok(()),
        false => Err(other_job(format!("{} already exists; replace it with --overwrite", path.display()))),
    }
}

/// As [`check_absent`], of files in a directory.
pub fn check_absent_in(
    directory: &Path,
    names: impl IntoIterator<Item = impl AsRef<Path>>,
    overwrite: bool,
) -> Result<()> {
    names.into_iter().try_for_each(|name| check_absent(&directory.join(name), overwrite))
}

/// Removes a file of an earlier report, if it is there.
///
/// # Errors
/// It cannot be removed.
pub fn remove_earlier(path: &Path) -> Result<()> {
    match std::fs::remove_file(path) {
        Err(e) if e.kind() != ErrorKind::NotFound => {
            Err(e).with_context(|| format!("removing {} of an earlier report", path.display()))
        }
        _ => Ok(()),
    }
}
