//! Temporary names that state their maker, and the sweep of those whose maker has provably ended.
//!
//! `.tmp-<host>-<machine>-<boot>-<pid namespace>-<pid>-<start>-<nonce>`, the fields of a [`Maker`]. No zarr key begins with
//! `.tmp-`, so no reader ever requests one.
//!
//! Every temporary file or directory of this program has such a name, beside the output that it becomes; the next command that writes
//! beside it sweeps. What the system does not let this process remove or list (another user's file in a sticky directory, a
//! file system mounted read-only, a directory without read permission) harms no output: it is reported in [`Sweep::kept`].

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use super::fault::strike;
use super::{DurableError, Maker, Step};

const PREFIX: &str = ".tmp-";

/// The maker of the file of that name; `None` if the name does not state it.
fn maker(name: &str) -> Option<Maker> {
    let fields: Vec<&str> = name.strip_prefix(PREFIX)?.split('-').collect();
    // The nonce may have an ending, as in `.tmp-….zip`.
    let [host, machine, boot, namespace, pid, start, _nonce] = fields[..] else { return None };
    Some(Maker {
        host: host.into(),
        machine: machine.into(),
        boot: boot.into(),
        namespace: namespace.into(),
        pid: pid.parse().ok()?,
        start: start.parse().ok()?,
    })
}

/// A name that no other process, and no other call in this one, uses.
pub fn temp_name() -> String {
    static NONCE: AtomicU64 = AtomicU64::new(0);
    let m = Maker::here();
    let nonce = NONCE.fetch_add(1, Ordering::Relaxed);
    format!("{PREFIX}{}-{}-{}-{}-{}-{}-{nonce}", m.host, m.machine, m.boot, m.namespace, m.pid, m.start)
}

/// Whether a file name is a temporary name, of whatever maker.
pub fn is_temp_name(name: &str) -> bool {
    name.starts_with(PREFIX)
}

/// What [`sweep`] found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Sweep {
    /// Removed: their makers have ended.
    pub removed: Vec<PathBuf>,
    /// Left alone: made by a process of this host that runs.
    pub live: Vec<PathBuf>,
    /// Left alone: made on another host or in another container; this process cannot know whether their makers run.
    pub foreign: Vec<PathBuf>,
    /// Not allowed: files of ended makers that could not be removed and directories that could not be listed, with the
    /// system's reason.
    pub kept: Vec<(PathBuf, String)>,
}

/// Removes what ended processes of this host left below `root`.
///
/// # Errors
/// [`DurableError`] if a directory cannot be listed or a file not removed, permissions excepted ([`Sweep::kept`]). A `root`
/// that is not there is clean.
pub fn sweep(root: &Path) -> Result<Sweep, DurableError> {
    sweep_found(root, true)
}

/// As [`sweep`], but looks only at the entries of `directory` itself, files and unfinished directories alike.
///
/// # Errors
/// As [`sweep`].
pub fn sweep_entries(directory: &Path) -> Result<Sweep, DurableError> {
    sweep_found(directory, false)
}

/// The temporary files and directories below `root`, and whether their maker has ended (`None`: unknown). Directories that may not
/// be listed are passed over.
///
/// # Errors
/// [`DurableError`] if a directory cannot be listed for another reason.
pub fn temp_files(root: &Path) -> Result<Vec<(PathBuf, Option<bool>)>, DurableError> {
    let mut found = Found::default();
    found.walk(root, true)?;
    Ok(found.temp)
}

fn sweep_found(root: &Path, deep: bool) -> Result<Sweep, DurableError> {
    let mut found = Found::default();
    found.walk(root, deep)?;
    let mut sweep = Sweep { kept: found.unlisted, ..Sweep::default() };
    for (path, dead) in found.temp {
        match dead {
            None => sweep.foreign.push(path),
            Some(false) => sweep.live.push(path),
            Some(true) => match remove_temp(&path) {
                Ok(()) => sweep.removed.push(path),
                Err(DurableError::Permission { source, .. }) => sweep.kept.push((path, source.to_string())),
                Err(e) => return Err(e),
            },
        }
    }
    Ok(sweep)
}

/// Removes a temporary file or directory; one that is gone already is fine.
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

/// What a walk finds.
#[derive(Default)]
struct Found {
    temp: Vec<(PathBuf, Option<bool>)>,
    /// Directories that may not be listed, and why.
    unlisted: Vec<(PathBuf, String)>,
}

impl Found {
    fn walk(&mut self, directory: &Path, deep: bool) -> Result<(), DurableError> {
        let failed = |e| DurableError::io("list", directory, 0, e);
        let entries = match std::fs::read_dir(directory) {
            Err(e) if super::absent(&e) => return Ok(()),
            Err(e) if e.kind() == ErrorKind::PermissionDenied => {
                self.unlisted.push((directory.into(), e.to_string()));
                return Ok(());
            }
            other => other.map_err(failed)?,
        };
        for entry in entries {
            let entry = entry.map_err(failed)?;
            let path = entry.path();
            let name = entry.file_name();
            let name = name.to_string_lossy();
            if is_temp_name(&name) {
                self.temp.push((path, maker(&name).and_then(|m| m.is_dead())));
            } else if deep && entry.file_type().is_ok_and(|t| t.is_dir()) {
                self.walk(&path, deep)?;
            }
        }
        Ok(())
    }
}
