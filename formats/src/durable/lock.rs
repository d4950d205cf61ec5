//! An advisory lock: a file that names the process which does a unit of work, so that no second one does it as well.
//!
//! Nothing depends on it but time: writers of one job write the same bytes, each file at once. The file appears whole
//! (written aside, then linked), and is removed at the end. The lock of a dead process is taken over; whether a process
//! of another host lives only a person can say (`take_over`).

use std::fs::File;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use serde::{Deserialize, Serialize};

use super::{DurableError, Maker, temp_name};

const SUFFIX: &str = ".lock";
const LARGEST: u64 = 4096;

/// Who holds a lock.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Owner {
    /// What is being worked on.
    pub unit: String,
    /// The process.
    #[serde(flatten)]
    pub maker: Maker,
    /// Since when, in seconds since 1970.
    pub since_unix_s: u64,
}

/// Why a lock is not to be had.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LockError {
    /// Its owner runs on this host.
    #[error(
        "{} is locked by process {} of this host, which runs; wait for it or stop it: what it has written stays", .path.display(),
        .owner.maker.pid
    )]
    Held {
        /// The lock.
        path: PathBuf,
        /// Who has it.
        owner: Box<Owner>,
    },
    /// Its owner runs, or ran, where this process cannot look.
    #[error(
        "{} is locked by {}; if that one has ended, --take-over", .path.display(),
        .owner.as_ref().map_or("an unknown process".into(), |o| format!("process {} of host {}", o.maker.pid, o.maker.host))
    )]
    Elsewhere {
        /// The lock.
        path: PathBuf,
        /// Who has it, if the file tells.
        owner: Option<Box<Owner>>,
    },
    /// The files.
    #[error("locking: {0}")]
    Storage(#[from] DurableError),
}

impl LockError {
    /// Whether the same call may succeed later: the other run ends.
    pub fn retryable(&self) -> bool {
        match self {
            Self::Storage(e) => e.retryable(),
            _ => true,
        }
    }
}

/// A lock held; removed when dropped.
#[derive(Debug)]
pub struct Lock {
    path: PathBuf,
    own: Vec<u8>,
}

impl Lock {
    /// Takes the lock of `unit` in `directory`. `take_over`: also from an owner elsewhere.
    ///
    /// # Errors
    /// [`LockError`] if another has it, or the files cannot be written.
    pub fn take(directory: &Path, unit: &str, take_over: bool) -> Result<Self, LockError> {
        // Not what lies above it: a film that is gone does not come back as a lock.
        match std::fs::create_dir(directory) {
            Err(e) if e.kind() != ErrorKind::AlreadyExists => {
                return Err(DurableError::io("create directory", directory, 0, e).into());
            }
            _ => (),
        }
        let path = directory.join(format!("{unit}{SUFFIX}"));
        let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).map_or(0, |d| d.as_secs());
        let owner = Owner { unit: unit.into(), maker: Maker::here().clone(), since_unix_s: since };
        let own = serde_json::to_vec(&owner).expect("JSON values are JSON");
        // One process at a time looks and acts, so that of several that find a dead owner one follows it. The kernel lets go
        // of a dead process's flock; a file system without it leaves the small gap, and nothing depends on that.
        let turn = File::open(directory).map_err(|e| DurableError::io("open", directory, 0, e))?;
        let _ = rustix::fs::flock(&turn, rustix::fs::FlockOperation::LockExclusive);
        free(&path, take_over)?;
        match place(&path, &own) {
            Ok(()) => Ok(Self { path, own }),
            Err(e) if e.kind() == ErrorKind::AlreadyExists => {
                Err(LockError::Elsewhere { owner: read(&path)?.and_then(|b| parse(&b)), path })
            }
            Err(e) => Err(DurableError::io("create", &path, own.len() as u64, e).into()),
        }
    }

    /// Where the lock lies.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Gives it up, whoever holds this value: for a process that is about to end without dropping it.
    pub fn release(path: &Path) {
        let own = |bytes: &[u8]| parse(bytes).is_some_and(|o| o.maker == *Maker::here());
        if read(path).ok().flatten().is_some_and(|b| own(&b)) {
            // One that stays is taken over: its owner is dead by then.
            let _ = std::fs::remove_file(path);
        }
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        if read(&self.path).ok().flatten().as_ref() == Some(&self.own) {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

/// The locks in `directory`, each with its owner if the file tells, and whether that one is dead (`None`: who knows).
///
/// # Errors
/// [`DurableError`] if they cannot be listed or read.
#[allow(clippy::type_complexity, reason = "a list of three plain things")]
pub fn locks(directory: &Path) -> Result<Vec<(PathBuf, Option<Box<Owner>>, Option<bool>)>, DurableError> {
    let failed = |e| DurableError::io("list", directory, 0, e);
    let entries = match std::fs::read_dir(directory) {
        Err(e) if super::absent(&e) => return Ok(Vec::new()),
        other => other.map_err(failed)?,
    };
    let mut found = Vec::new();
    for entry in entries {
        let path = entry.map_err(failed)?.path();
        if path.file_name().is_some_and(|n| n.to_string_lossy().ends_with(SUFFIX))
            && let Some(bytes) = read(&path)?
        {
            let owner = parse(&bytes);
            let dead = owner.as_ref().and_then(|o| o.maker.is_dead());
            found.push((path, owner, dead));
        }
    }
    found.sort_by(|a, b| a.0.cmp(&b.0));
    Ok(found)
}

fn parse(bytes: &[u8]) -> Option<Box<Owner>> {
    serde_json::from_slice(bytes).ok()
}

fn read(path: &Path) -> Result<Option<Vec<u8>>, DurableError> {
    match super::open(path)? {
        Some((_, size)) if size <= LARGEST => match std::fs::read(path) {
            Err(e) if super::absent(&e) => Ok(None),
            other => other.map(Some).map_err(|e| DurableError::io("read", path, size, e)),
        },
        Some(_) => Ok(Some(Vec::new())),
        None => Ok(None),
    }
}

/// Makes the file, whole, if there is none: `AlreadyExists` otherwise.
fn place(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let temp = path.with_file_name(temp_name());
    std::fs::write(&temp, bytes)?;
    let linked = match std::fs::hard_link(&temp, path) {
        // A file system without hard links: a process killed between the two calls leaves an empty lock, of nobody known.
        Err(e) if !matches!(e.kind(), ErrorKind::AlreadyExists | ErrorKind::NotFound) => {
            File::options().write(true).create_new(true).open(path).and_then(|mut f| f.write_all(bytes))
        }
        other => other,
    };
    let _ = std::fs::remove_file(&temp);
    linked
}

/// Removes the lock if its owner is dead or, with `take_over`, elsewhere.
fn free(path: &Path, take_over: bool) -> Result<(), LockError> {
    let Some(bytes) = read(path)? else { return Ok(()) };
    let owner = parse(&bytes);
    match (owner.as_ref().and_then(|o| o.maker.is_dead()), owner) {
        (Some(true), _) => (),
        (Some(false), Some(owner)) => return Err(LockError::Held { path: path.into(), owner }),
        (_, owner) if !take_over => return Err(LockError::Elsewhere { path: path.into(), owner }),
        _ => (),
    }
    match std::fs::remove_file(path) {
        Err(e) if !super::absent(&e) => Err(DurableError::io("remove", path, 0, e).into()),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_unit_has_one_owner_at_a_time() {
        let dir = tempfile::tempdir().unwrap();
        let place = dir.path().join("runs");
        let lock = Lock::take(&place, "film", false).unwrap();
        let e = Lock::take(&place, "film", true).unwrap_err();
        assert!(matches!(&e, LockError::Held { owner, .. } if owner.maker == *Maker::here()), "{e}");
        assert!(e.retryable() && e.to_string().contains(&std::process::id().to_string()), "{e}");
        let other = Lock::take(&place, "unit-7", false).unwrap();
        let found = locks(&place).unwrap();
        assert_eq!(found.iter().map(|l| l.2).collect::<Vec<_>>(), [Some(false); 2]);
        drop((lock, other));
        assert_eq!(std::fs::read_dir(&place).unwrap().count(), 0);
        Lock::take(&place, "film", false).unwrap();
    }

    #[test]
    fn a_dead_owner_is_followed_and_a_stranger_asked_about() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("film.lock");
        let leave = |change: &dyn Fn(&mut Maker)| {
            let mut owner = Owner { unit: "film".into(), maker: Maker::here().clone(), since_unix_s: 1 };
            change(&mut owner.maker);
            std::fs::write(&path, serde_json::to_vec(&owner).unwrap()).unwrap();
        };
        let dead: [&dyn Fn(&mut Maker); 3] =
            [&|m| m.boot = "0123456789abcdef".into(), &|m| m.pid = 4_194_303, &|m| m.start += 1];
        for change in dead {
            leave(change);
            assert_eq!(locks(dir.path()).unwrap()[0].2, Some(true));
            drop(Lock::take(dir.path(), "film", false).unwrap());
        }
        let strange: [&dyn Fn(&mut Maker); 2] =
            [&|m| m.host = "elsewhere".into(), &|m| m.namespace = "1".into()];
        for change in strange {
            leave(change);
            let e = Lock::take(dir.path(), "film", false).unwrap_err();
            assert!(matches!(e, LockError::Elsewhere { owner: Some(_), .. }) && path.exists(), "{e}");
            assert!(e.to_string().contains("--take-over"), "{e}");
            drop(Lock::take(dir.path(), "film", true).unwrap());
        }
        std::fs::write(&path, b"{").unwrap();
        let e = Lock::take(dir.path(), "film", false).unwrap_err();
        assert!(matches!(e, LockError::Elsewhere { owner: None, .. }), "{e}");
        drop(Lock::take(dir.path(), "film", true).unwrap());
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
    }

    #[test]
    fn of_many_that_follow_a_dead_owner_one_wins() {
        let dir = tempfile::tempdir().unwrap();
        let dead = Owner {
            unit: "film".into(),
            maker: Maker { start: 1, ..Maker::here().clone() },
            since_unix_s: 1,
        };
        for _ in 0..20 {
            std::fs::write(dir.path().join("film.lock"), serde_json::to_vec(&dead).unwrap()).unwrap();
            let won: Vec<_> = std::thread::scope(|s| {
                let all: Vec<_> = (0..6).map(|_| s.spawn(|| Lock::take(dir.path(), "film", false))).collect();
                all.into_iter().filter_map(|t| t.join().unwrap().ok()).collect()
            });
            assert_eq!(won.len(), 1);
            drop(won);
            assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
        }
    }
}
