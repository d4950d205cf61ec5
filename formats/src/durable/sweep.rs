//! Temp names that tell who made them, and the sweep of those whose maker is gone.
//!
//! `.tmp-<host>-<boot>-<pid namespace>-<pid>-<start>-<nonce>`, the words of a [`Maker`]. No zarr key begins with `.tmp-`, so
//! no reader ever asks for one.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use super::fault::strike;
use super::{DurableError, Maker, Step};

const PREFIX: &str = ".tmp-";

/// Who made the file of that name; `None` if the name does not tell.
fn maker(name: &str) -> Option<Maker> {
    let mut parts = name.strip_prefix(PREFIX)?.split('-');
    let mut word = || parts.next().map(str::to_owned);
    Some(Maker {
        host: word()?,
        boot: word()?,
        namespace: word()?,
        pid: word()?.parse().ok()?,
        start: word()?.parse().ok()?,
    })
}

/// A name that no other process, and no other call in this one, uses.
pub fn temp_name() -> String {
    static NONCE: AtomicU64 = AtomicU64::new(0);
    let m = Maker::here();
    let nonce = NONCE.fetch_add(1, Ordering::Relaxed);
    format!("{PREFIX}{}-{}-{}-{}-{}-{nonce}", m.host, m.boot, m.namespace, m.pid, m.start)
}

/// Whether a file name is a temp name, of whatever maker.
pub fn is_temp_name(name: &str) -> bool {
    name.starts_with(PREFIX)
}

/// What [`sweep`] found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Sweep {
    /// Removed: their makers are gone.
    pub removed: Vec<PathBuf>,
    /// Left alone: made by a process of this host that lives.
    pub live: Vec<PathBuf>,
    /// Left alone: made on another host or in another container; only a person can say whether it still runs.
    pub foreign: Vec<PathBuf>,
}

/// Removes what dead processes of this host left below `root`; tells what others left.
///
/// # Errors
/// [`DurableError`] if a directory cannot be listed or a file not removed. A `root` that is not there is clean.
pub fn sweep(root: &Path) -> Result<Sweep, DurableError> {
    remove_dead(temp_files(root)?)
}

/// As [`sweep`], but looks only at the entries of `directory` itself, files and unfinished directories alike.
///
/// # Errors
/// As [`sweep`].
pub fn sweep_entries(directory: &Path) -> Result<Sweep, DurableError> {
    let mut found = Vec::new();
    walk(directory, false, &mut found)?;
    remove_dead(found)
}

/// The temp files and directories below `root`, and whether their maker is dead (`None`: who knows).
///
/// # Errors
/// [`DurableError`] if a directory cannot be listed.
pub fn temp_files(root: &Path) -> Result<Vec<(PathBuf, Option<bool>)>, DurableError> {
    let mut found = Vec::new();
    walk(root, true, &mut found)?;
    Ok(found)
}

fn remove_dead(found: Vec<(PathBuf, Option<bool>)>) -> Result<Sweep, DurableError> {
    let mut sweep = Sweep::default();
    for (path, dead) in found {
        match dead {
            None => sweep.foreign.push(path),
            Some(false) => sweep.live.push(path),
            Some(true) => {
                remove_temp(&path)?;
                sweep.removed.push(path);
            }
        }
    }
    Ok(sweep)
}

/// Removes a temp file or directory; one that is gone already is fine.
///
/// # Errors
/// [`DurableError`] if it cannot be removed.
pub fn remove_temp(path: &Path) -> Result<(), DurableError> {
    let is_dir = path.symlink_metadata().is_ok_and(|m| m.is_dir());
    let gone = strike(Step::Sweep).and_then(|()| match is_dir {
        true => std::fs::remove_dir_all(path),
        false => std::fs::remove_file(path),
    });
    match gone {
        Err(e) if !super::absent(&e) => Err(DurableError::io("remove", path, 0, e)),
        _ => Ok(()),
    }
}

fn walk(directory: &Path, deep: bool, found: &mut Vec<(PathBuf, Option<bool>)>) -> Result<(), DurableError> {
    let entries = match std::fs::read_dir(directory) {
        Err(e) if super::absent(&e) => return Ok(()),
        other => other.map_err(|e| DurableError::io("list", directory, 0, e))?,
    };
    for entry in entries {
        let entry = entry.map_err(|e| DurableError::io("list", directory, 0, e))?;
        let path = entry.path();
        let name = entry.file_name();
        let name = name.to_string_lossy();
        if is_temp_name(&name) {
            found.push((path, maker(&name).and_then(|m| m.is_dead())));
        } else if deep && entry.file_type().is_ok_and(|t| t.is_dir()) {
            walk(&path, deep, found)?;
        }
    }
    Ok(())
}
