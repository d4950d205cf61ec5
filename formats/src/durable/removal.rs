//! Removal of a directory of this program without removing files of others.
//!
//! All entries are listed; an unknown one prevents the removal. Then the directory is renamed to a temporary name, so that an interrupted
//! removal leaves no incomplete directory at its path. The renamed directory is compared with the one that was opened (another process may
//! have replaced it), listed again, and removed.

use std::path::Path;

use rustix::fs::CWD;

use super::directory::Directory;
use super::error::{DurableError, is_not_found};
use super::file_system::parent_of;
use super::handle;
use super::rename::publish;
use super::temp::temp_name;

/// Maximum number of foreign files listed.
const MAX_LISTED: usize = 8;

/// Result of a removal.
#[derive(Clone, Debug, PartialEq, Eq)]
#[must_use]
pub enum Removal {
    /// The store was removed.
    Done,
    /// Nothing was removed: the store contains these files of others (the first few).
    Foreign(Vec<String>),
    /// Nothing was removed: another directory is at the path now.
    Replaced,
}

/// Removes an open directory, if `is_own` is true for all files in it.
pub(super) fn remove_all(
    directory: &Directory,
    is_own: &dyn Fn(&str) -> bool,
) -> Result<Removal, DurableError> {
    if let Some(names) = foreign_entries(directory, is_own)? {
        return Ok(Removal::Foreign(names));
    }
    let root = directory.root();
    // Renamed for as short a time as possible if it is another one: a run that writes to it would fail.
    if !directory.is_at(root)? && root.symlink_metadata().is_ok() {
        return Ok(Removal::Replaced);
    }
    let temp = parent_of(root).join(temp_name());
    match publish(root, &temp, true) {
        // Another process has removed it meanwhile.
        Err(DurableError::Io { source, .. }) if is_not_found(&source) => return Ok(Removal::Done),
        renamed => renamed?,
    };
    let restored = |removal| restore(&temp, root).map(|()| removal);
    if !directory.is_at(&temp)? {
        return restored(Removal::Replaced);
    }
    // Again: a file may have been added before the rename.
    if let Some(names) = foreign_entries(directory, is_own)? {
        return restored(Removal::Foreign(names));
    }
    handle::remove_tree(CWD, &temp).map_err(|e| DurableError::io("remove", &temp, 0, e))?;
    Ok(Removal::Done)
}

/// Renames the directory back to its path.
fn restore(temp: &Path, root: &Path) -> Result<(), DurableError> {
    match publish(temp, root, true)? {
        true => Ok(()),
        false => Err(DurableError::Address {
            path: temp.into(),
            problem: format!(
                "this is the former {}, which could not be renamed back: something else is there now",
                root.display()
            ),
        }),
    }
}

/// The first few entries for which `is_own` is false; `None` if there are none.
pub(super) fn foreign_entries(
    directory: &Directory,
    is_own: &dyn Fn(&str) -> bool,
) -> Result<Option<Vec<String>>, DurableError> {
    let mut names: Vec<String> = directory.all_entries()?;
    names.retain(|key| match key.strip_suffix('/') {
        None => !is_own(key),
        // An empty directory is own if it may contain an own file.
        Some(empty) => {
            let inside = ["zarr.json", "0", "c/0", "x.lock"];
            !inside.iter().any(|name| is_own(&format!("{empty}/{name}")))
        }
    });
    let more = names.len().saturating_sub(MAX_LISTED);
    names.truncate(MAX_LISTED);
    if more > 0 {
        names.push(format!("and {more} more"));
    }
    Ok(Some(names).filter(|names| !names.is_empty()))
}
