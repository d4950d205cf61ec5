//! An advisory lock: a file that names the process which does a unit of work, so that no second one does it as well.
//!
//! Nothing depends on it but time: writers of one job write the same bytes, each file at once. The file appears whole
//! (written aside, then linked), and is removed at the end. The lock of a process that has provably ended ([`Maker::is_dead`]) is
//! taken over; any other only if the user says so (`take_over`).
//!
//! While a process looks at a lock and acts, it holds `flock` on the directory, for milliseconds. One that is stopped, or a network
//! file system in trouble, may hold it for long: the wait is reported on stderr and ends after [`FLOCK_LIMIT`] with
//! [`LockError::Busy`]. Only regular files are read: a FIFO or a device in the place of a lock is an error, not a wait.

use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

use rustix::fs::{FlockOperation, OFlags, flock};
use rustix::io::Errno;
use serde::{Deserialize, Serialize};

use super::{DurableError, Maker, temp_name};

const SUFFIX: &str = ".lock";
const LARGEST: u64 = 4096;
/// The wait for `flock` is reported after this time,
const FLOCK_NOTE: Duration = Duration::from_secs(2);
/// and given up after this time.
const FLOCK_LIMIT: Duration = Duration::from_secs(30);
/// Time between two attempts.
const FLOCK_PAUSE: Duration = Duration::from_millis(20);

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
    /// Another process is taking or removing a lock of the same directory, for longer than that can last.
    #[error(
        "taking a lock in {} waited {seconds} s for {}, which holds the directory's flock; continue or stop that process, then \
         run the same command again", .directory.display(), holder_name(*.holder)
    )]
    Busy {
        /// The directory.
        directory: PathBuf,
        /// The process id of the holder, if the system tells.
        holder: Option<u32>,
        /// Time waited.
        seconds: u64,
    },
    /// What lies in the lock's place is no regular file, so no process of this program made it.
    #[error("{} is {found}, expected a lock file; remove it, then run the same command again", .path.display())]
    NotAFile {
        /// The lock.
        path: PathBuf,
        /// What lies there.
        found: &'static str,
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
            Self::NotAFile { .. } => false,
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
        let _held = hold(directory, FLOCK_NOTE, FLOCK_LIMIT)?;
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
            && let Some(bytes) = listed(&path)?
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

/// The bytes of a lock that a listing names; of what is no regular file nothing is known.
fn listed(path: &Path) -> Result<Option<Vec<u8>>, DurableError> {
    match read(path) {
        Err(LockError::Storage(e)) => Err(e),
        Err(_) => Ok(Some(Vec::new())),
        Ok(bytes) => Ok(bytes),
    }
}

/// The bytes of a lock, none of one that is too long for a lock; `None` if there is no file.
fn read(path: &Path) -> Result<Option<Vec<u8>>, LockError> {
    let failed = |e| DurableError::io("read", path, 0, e);
    let kind = match path.symlink_metadata() {
        Err(e) if super::absent(&e) => return Ok(None),
        other => other.map_err(failed)?.file_type(),
    };
    let not_a_file = |kind| LockError::NotAFile { path: path.into(), found: kind_name(kind) };
    if !kind.is_file() {
        return Err(not_a_file(kind));
    }
    // It may have been replaced since: neither follow a link nor wait for the writer of a FIFO.
    let flags = (OFlags::NOFOLLOW | OFlags::NONBLOCK).bits();
    let file = match File::options().read(true).custom_flags(flags as i32).open(path) {
        Err(e) if super::absent(&e) => return Ok(None),
        other => other.map_err(failed)?,
    };
    let meta = file.metadata().map_err(failed)?;
    if !meta.is_file() {
        return Err(not_a_file(meta.file_type()));
    }
    let mut bytes = Vec::new();
    file.take(LARGEST + 1).read_to_end(&mut bytes).map_err(failed)?;
    Ok(Some(if bytes.len() as u64 > LARGEST { Vec::new() } else { bytes }))
}

fn kind_name(kind: std::fs::FileType) -> &'static str {
    use std::os::unix::fs::FileTypeExt;
    match kind {
        k if k.is_dir() => "a directory",
        k if k.is_symlink() => "a symbolic link",
        k if k.is_fifo() => "a FIFO",
        k if k.is_socket() => "a socket",
        _ => "a device",
    }
}

/// Holds `flock` on the directory until the result is dropped, so that of several processes that find a lock of an ended owner one
/// follows it. The kernel releases the flock of an ended process. A file system without flock leaves a small gap, and nothing
/// depends on that.
fn hold(directory: &Path, note: Duration, limit: Duration) -> Result<File, LockError> {
    let failed = |e| DurableError::io("open", directory, 0, e);
    let only_a_directory = (OFlags::DIRECTORY | OFlags::NONBLOCK).bits() as i32;
    let file = File::options().read(true).custom_flags(only_a_directory).open(directory).map_err(failed)?;
    let (start, mut reported) = (Instant::now(), false);
    while let Err(Errno::WOULDBLOCK | Errno::INTR) = flock(&file, FlockOperation::NonBlockingLockExclusive) {
        let waited = start.elapsed();
        if waited >= limit {
            let holder = flock_holder(&file);
            return Err(LockError::Busy { directory: directory.into(), holder, seconds: waited.as_secs() });
        }
        if waited >= note && !reported {
            reported = true;
            let (by, at) = (holder_name(flock_holder(&file)), directory.display());
            // A closed stderr is no reason to end.
            let _ = writeln!(
                std::io::stderr(),
                "waiting at most {} s for {by} to release the flock of {at}",
                limit.as_secs()
            );
        }
        std::thread::sleep(FLOCK_PAUSE);
    }
    Ok(file)
}

/// The process that holds `flock` on a file, as Linux lists it: `1: FLOCK  ADVISORY  WRITE <pid> <major>:<minor>:<inode> 0 EOF`.
fn flock_holder(file: &File) -> Option<u32> {
    let meta = file.metadata().ok()?;
    let (major, minor) = (rustix::fs::major(meta.dev()), rustix::fs::minor(meta.dev()));
    let place = format!("{major:02x}:{minor:02x}:{}", meta.ino());
    let table = std::fs::read_to_string("/proc/locks").ok()?;
    let held = table.lines().map(|l| l.split_whitespace().collect::<Vec<_>>());
    let mut pids =
        held.filter(|w| w.len() > 5 && w[1] == "FLOCK" && w[5] == place).map(|w| w[4].parse().ok());
    // Processes of other namespaces are listed as 0.
    pids.find_map(|pid| pid.filter(|&p| p > 0))
}

fn holder_name(holder: Option<u32>) -> String {
    holder.map_or("an unknown process, perhaps of another host".into(), |pid| {
        format!("process {pid} of this host")
    })
}

/// Makes the file, whole, if there is none: `AlreadyExists` otherwise.
fn place(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let temp = path.with_file_name(temp_name());
    std::fs::write(&temp, bytes).inspect_err(|_| drop(std::fs::remove_file(&temp)))?;
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
        let dead: [&dyn Fn(&mut Maker); 2] = [&|m| m.pid = 4_194_303, &|m| m.start += 1];
        for change in dead {
            leave(change);
            assert_eq!(locks(dir.path()).unwrap()[0].2, Some(true));
            drop(Lock::take(dir.path(), "film", false).unwrap());
        }
        let strange: [&dyn Fn(&mut Maker); 3] = [
            &|m| m.host = "elsewhere".into(),
            &|m| m.namespace = "1".into(),
            // Two machines of one host name.
            &|m| (m.boot, m.machine) = ("0123456789abcdef".into(), "another".into()),
        ];
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
    fn what_is_no_regular_file_in_the_place_of_a_lock_is_named_and_nothing_waits_for_it() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("film.lock");
        let take = || Lock::take(dir.path(), "film", true).unwrap_err();
        let named = |found: &str| {
            let e = take();
            assert!(matches!(e, LockError::NotAFile { .. }) && !e.retryable(), "{found}: {e}");
            assert!(e.to_string().contains(found) && e.to_string().contains("film.lock"), "{e}");
            assert_eq!(locks(dir.path()).unwrap()[0].2, None, "{found}");
        };
        let fifo = || rustix::fs::mkfifoat(rustix::fs::CWD, &path, 0o600.into()).unwrap();
        fifo();
        named("a FIFO");
        std::fs::remove_file(&path).unwrap();
        std::fs::create_dir(&path).unwrap();
        named("a directory");
        std::fs::remove_dir(&path).unwrap();
        let socket = std::os::unix::net::UnixListener::bind(&path).unwrap();
        named("a socket");
        drop(socket);
        std::fs::remove_file(&path).unwrap();
        std::os::unix::fs::symlink("/dev/zero", &path).unwrap();
        named("a symbolic link");
        std::fs::remove_file(&path).unwrap();
        File::create(&path).unwrap().set_len(1 << 40).unwrap();
        assert!(matches!(
            Lock::take(dir.path(), "film", false),
            Err(LockError::Elsewhere { owner: None, .. })
        ));
        drop(Lock::take(dir.path(), "film", true).unwrap());
        let file = dir.path().join("runs");
        rustix::fs::mkfifoat(rustix::fs::CWD, &file, 0o600.into()).unwrap();
        assert!(matches!(Lock::take(&file, "film", false), Err(LockError::Storage(_))));
    }

    #[test]
    fn a_flock_that_is_held_too_long_is_a_retryable_error_that_names_its_holder() {
        let dir = tempfile::tempdir().unwrap();
        let held = hold(dir.path(), FLOCK_NOTE, FLOCK_LIMIT).unwrap();
        let waited = hold(dir.path(), Duration::ZERO, Duration::from_millis(60)).unwrap_err();
        assert!(waited.retryable(), "{waited}");
        let own = format!("process {} of this host", std::process::id());
        let listed = Path::new("/proc/locks").exists();
        assert!(waited.to_string().contains(if listed { &own } else { "an unknown process" }), "{waited}");
        drop(held);
        drop(hold(dir.path(), FLOCK_NOTE, FLOCK_LIMIT).unwrap());
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
