//! Removing a directory of ours, and nothing that others put into it.
//!
//! All of it is listed, and what is not known refuses the removal. Then it is renamed, so that it is whole or not there; the
//! renamed one is compared with the one that was opened (another process may have replaced it), listed again, and removed.

use std::path::Path;

use rustix::fs::CWD;

use super::{Directory, DurableError, handle, parent_of, publish, temp_name};

/// Foreign files that are named.
const NAMED: usize = 8;

/// What became of a removal.
#[derive(Clone, Debug, PartialEq, Eq)]
#[must_use]
pub enum Removal {
    /// It is gone.
    Done,
    /// Nothing was removed: these are in it and were put there by others; the first few.
    Foreign(Vec<String>),
    /// Nothing was removed: another directory has taken its place.
    Replaced,
}

/// Removes an open directory, if `own` knows all files in it.
pub(super) fn remove_all(directory: &Directory, own: &dyn Fn(&str) -> bool) -> Result<Removal, DurableError> {
    if let Some(names) = foreign(directory, own)? {
        return Ok(Removal::Foreign(names));
    }
    let root = directory.root();
    let temp = parent_of(root).join(temp_name());
    publish(root, &temp, true)?;
    let back = |removal| put_back(&temp, root).map(|()| removal);
    if !directory.is_at(&temp)? {
        return back(Removal::Replaced);
    }
    // Again: something may have been put there until the rename.
    if let Some(names) = foreign(directory, own)? {
        return back(Removal::Foreign(names));
    }
    handle::remove_tree(CWD, &temp).map_err(|e| DurableError::io("remove", &temp, 0, e))?;
    Ok(Removal::Done)
}

fn put_back(temp: &Path, root: &Path) -> Result<(), DurableError> {
    match publish(temp, root, true)? {
        true => Ok(()),
        false => Err(DurableError::Address {
            path: temp.into(),
            problem: format!(
                "it was {} and could not be put back there: something else is there now",
                root.display()
            ),
        }),
    }
}

/// What `own` does not know.
pub(super) fn foreign(
    directory: &Directory,
    own: &dyn Fn(&str) -> bool,
) -> Result<Option<Vec<String>>, DurableError> {
    let mut names: Vec<String> = directory.all_entries()?;
    names.retain(|key| match key.strip_suffix('/') {
        None => !own(key),
        // An empty directory is known if a file of ours may lie in it.
        Some(empty) => {
            let inside = ["zarr.json", "0", "c/0", "x.lock"];
            !inside.iter().any(|name| own(&format!("{empty}/{name}")))
        }
    });
    let more = names.len().saturating_sub(NAMED);
    names.truncate(NAMED);
    if more > 0 {
        names.push(format!("and {more} more"));
    }
    Ok(Some(names).filter(|names| !names.is_empty()))
}
