//! Removal of temporary files of ended processes.
//!
//! Each command that writes into a directory sweeps it first. Files that this process may not remove or list (another user's file in a
//! sticky directory, a read-only file system, a directory without read permission) do not affect any output: they are reported in
//! [`Sweep::kept`].

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use super::error::{DurableError, is_not_found};
use super::temp::{is_temp_name, process_of, remove_temp};

/// Result of a sweep.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Sweep {
    /// Removed: their processes have ended.
    pub removed: Vec<PathBuf>,
    /// Kept: made by a running process of this host.
    pub live: Vec<PathBuf>,
    /// Kept: made on another host or in another container, where the state of their processes is unknown.
    pub foreign: Vec<PathBuf>,
    /// Permission denied: files of ended processes that could not be removed and directories that could not be listed, with the
    /// system's error.
    pub kept: Vec<(PathBuf, String)>,
}

/// Removes temporary files of ended processes of this host below `root`, recursively. A missing `root` is no error.
pub fn sweep(root: &Path) -> Result<Sweep, DurableError> {
    sweep_tree(root, true)
}

/// As [`sweep`], of the entries of `directory` itself only: files and incomplete directories.
pub fn sweep_entries(directory: &Path) -> Result<Sweep, DurableError> {
    sweep_tree(directory, false)
}

/// Temporary files and directories below `root`, each with whether its process has ended (`None`: unknown). Directories without
/// permission to list are skipped.
pub fn temp_files(root: &Path) -> Result<Vec<(PathBuf, Option<bool>)>, DurableError> {
    let mut found = Found::default();
    found.walk(root, true)?;
    Ok(found.temp)
}

fn sweep_tree(root: &Path, recursive: bool) -> Result<Sweep, DurableError> {
    let mut found = Found::default();
    found.walk(root, recursive)?;
    let mut sweep = Sweep { kept: found.unlisted, ..Sweep::default() };
    for (path, ended) in found.temp {
        match ended {
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

/// Result of a directory walk.
#[derive(Default)]
struct Found {
    temp: Vec<(PathBuf, Option<bool>)>,
    /// Directories without permission to list, and the system's error.
    unlisted: Vec<(PathBuf, String)>,
}

impl Found {
    fn walk(&mut self, directory: &Path, recursive: bool) -> Result<(), DurableError> {
        let failed = |e| DurableError::io("list", directory, 0, e);
        let entries = match std::fs::read_dir(directory) {
            Err(e) if is_not_found(&e) => return Ok(()),
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
                self.temp.push((path, process_of(&name).and_then(|p| p.has_ended())));
            } else if recursive && entry.file_type().is_ok_and(|t| t.is_dir()) {
                self.walk(&path, recursive)?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::durable::temp::temp_name;

    fn names(root: &Path) -> Vec<String> {
        let entries = std::fs::read_dir(root).unwrap();
        let mut names: Vec<_> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn sweep_removes_only_files_of_ended_processes() {
        let dir = tempfile::tempdir().unwrap();
        let deep = dir.path().join("film/c/0");
        std::fs::create_dir_all(&deep).unwrap();
        let own = temp_name();
        let parts: Vec<&str> = own.splitn(8, '-').collect();
        let with = |i: usize, field: &str| {
            let mut p = parts.clone();
            p[i] = field;
            p.join("-")
        };
        let ended = [with(5, "4194303"), with(6, "1"), with(5, "4194302") + ".zip"];
        // Another host; another machine with this host name; a container; a name of an older version; a name of no process.
        let another = format!("{}-another-0123456789abcdef-{}", parts[..2].join("-"), parts[4..].join("-"));
        let older = [&parts[..2], &parts[3..]].concat().join("-");
        let foreign = [with(1, "elsewhere"), another, with(4, "12345"), older, ".tmp-what".to_owned()];
        for name in ended.iter().chain(&foreign).chain([&own]) {
            std::fs::write(deep.join(name), b"incomplete").unwrap();
        }
        std::fs::write(deep.join("7"), b"complete").unwrap();
        let s = sweep(dir.path()).unwrap();
        assert_eq!((s.removed.len(), s.live.len(), s.foreign.len(), s.kept.len()), (3, 1, 5, 0), "{s:?}");
        assert_eq!(names(&deep).len(), 7);
        assert_eq!(sweep(&dir.path().join("nowhere")).unwrap(), Sweep::default());
    }

    #[test]
    fn sweep_removes_temporary_fifos_links_sockets_and_directories() {
        let dir = tempfile::tempdir().unwrap();
        let ended = |n: &str| {
            let own = temp_name();
            let parts: Vec<&str> = own.splitn(8, '-').collect();
            dir.path().join(format!("{}-4194303-{}-{n}", parts[..5].join("-"), parts[6]))
        };
        let outside = dir.path().join("outside");
        std::fs::create_dir(&outside).unwrap();
        std::fs::write(outside.join("kept"), b"kept").unwrap();
        rustix::fs::mkfifoat(rustix::fs::CWD, ended("fifo"), 0o600.into()).unwrap();
        std::os::unix::fs::symlink(&outside, ended("link")).unwrap();
        drop(std::os::unix::net::UnixListener::bind(dir.path().join("s")).unwrap());
        std::fs::rename(dir.path().join("s"), ended("socket")).unwrap();
        std::fs::create_dir_all(ended("directory").join("a/b")).unwrap();
        let s = sweep(dir.path()).unwrap();
        assert_eq!((s.removed.len(), s.kept.len()), (4, 0), "{s:?}");
        assert_eq!(
            (names(dir.path()), names(&outside)),
            (vec!["outside".to_owned()], vec!["kept".to_owned()])
        );
    }
}
