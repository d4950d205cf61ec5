//! A directory in which a file is absent or complete, never half: what a killed job leaves behind can be trusted.
//!
//! `write` = unique temp name in the same directory → write → check the length → fsync → rename → fsync the directory.
//! A reader, or a job resumed after `kill -9` or a power cut, sees the old bytes or the new ones. Directories are made
//! durable the same way (fsync of the parent). [`sweep`] removes the temp files of processes that are gone.
//!
//! None of this needs a lock: two writers of one key each rename a whole file, the last one wins, and all writers of one job
//! write the same bytes. [`Lock`] only keeps two runs from doing the same work twice.

mod direct;
mod error;
mod fault;
mod lock;
mod maker;
mod objects;
mod store;
mod sweep;
mod whole;
mod zarr;

pub(crate) use error::store_error;
pub use error::{DurableError, passes};
pub use lock::{Lock, LockError, Owner, locks};
pub use maker::Maker;
pub use objects::{ObjectState, Objects, check_url, is_url};
pub use store::Store;
pub use sweep::{Sweep, is_temp_name, remove_temp, sweep, sweep_entries, temp_files, temp_name};
pub use whole::{WholeFile, finish_together, nameless_file, replace_directory};

use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

/// What [`Directory::write`] is about to do; a fault hook is asked before each step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Step {
    /// Create the temp file.
    Create,
    /// Write the bytes into it.
    Write,
    /// Flush them to the disk.
    Sync,
    /// Give the file its final name.
    Rename,
    /// Flush the directory.
    SyncDirectory,
    /// Remove a file.
    Remove,
    /// Read a file, or a part of it.
    Read,
    /// Give a new directory its final name.
    Publish,
    /// Remove what a dead process left.
    Sweep,
}

type Fault = dyn Fn(Step, &Path) -> std::io::Result<()> + Send + Sync;

/// A directory with durable, atomic writes. Keys are relative paths with `/` (`film/c/0/1/2`).
#[derive(Clone)]
pub struct Directory {
    root: PathBuf,
    fsync: bool,
    fault: Option<Arc<Fault>>,
}

impl std::fmt::Debug for Directory {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Directory({}, fsync: {})", self.root.display(), self.fsync)
    }
}

impl Directory {
    /// The directory `root`, which need not exist yet.
    pub fn new(root: impl Into<PathBuf>) -> Self {
        Self { root: root.into(), fsync: true, fault: None }
    }

    /// Whether writes are flushed to the disk before they count (default). Without it a power cut may cost complete
    /// files, but a killed process still leaves none half.
    pub fn with_fsync(mut self, fsync: bool) -> Self {
        self.fsync = fsync;
        self
    }

    /// Asks `fault` before every step of a write, for tests of what happens when one fails.
    pub fn with_fault(
        mut self,
        fault: impl Fn(Step, &Path) -> std::io::Result<()> + Send + Sync + 'static,
    ) -> Self {
        self.fault = Some(Arc::new(fault));
        self
    }

    /// The directory itself.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Where `key` lies.
    ///
    /// # Errors
    /// [`DurableError::Key`] for a key that would leave the directory.
    pub fn path(&self, key: &str) -> Result<PathBuf, DurableError> {
        let relative = Path::new(key);
        if relative.components().all(|c| matches!(c, Component::Normal(_))) {
            Ok(self.root.join(relative))
        } else {
            Err(DurableError::Key { key: key.into(), root: self.root.clone() })
        }
    }

    /// Writes `bytes` under `key`, replacing what was there.
    ///
    /// # Errors
    /// [`DurableError`]; the key then holds what it held before, and the temp file is removed.
    pub fn write(&self, key: &str, bytes: &[u8]) -> Result<(), DurableError> {
        let path = self.path(key)?;
        let directory = path.parent().unwrap_or(&self.root).to_path_buf();
        create_directories(&directory, self.fsync)?;
        let temp = directory.join(temp_name());
        self.write_temp(&temp, bytes)
            .and_then(|()| self.step(Step::Rename, &path, |p| std::fs::rename(&temp, p), bytes.len() as u64))
            .inspect_err(|_| {
                // The error that matters is already in hand; a temp file that stays is swept later.
                let _ = std::fs::remove_file(&temp);
            })?;
        self.sync_directory(&directory)
    }

    fn write_temp(&self, temp: &Path, bytes: &[u8]) -> Result<(), DurableError> {
        let size = bytes.len() as u64;
        let mut file =
            self.step(Step::Create, temp, |p| File::options().write(true).create_new(true).open(p), size)?;
        let mut write = |part: &[u8]| match self.fsync {
            true => direct::write_all(&mut file, part),
            false => file.write_all(part),
        };
        self.step(Step::Write, temp, |_| fault::write(bytes, &mut write), size)?;
        let found = self.step(Step::Write, temp, |_| file.metadata(), size)?.len();
        if found != size {
            return Err(DurableError::Length { path: temp.into(), expected: size, found });
        }
        if self.fsync {
            self.step(Step::Sync, temp, |_| file.sync_all(), size)?;
        }
        Ok(())
    }

    fn step<T>(
        &self,
        step: Step,
        path: &Path,
        act: impl FnOnce(&Path) -> std::io::Result<T>,
        bytes: u64,
    ) -> Result<T, DurableError> {
        self.fault
            .as_ref()
            .map_or(Ok(()), |fault| fault(step, path))
            .and_then(|()| if step == Step::Write { Ok(()) } else { fault::strike(step) })
            .and_then(|()| act(path))
            .map_err(|e| DurableError::io(step.doing(), path, bytes, e))
    }

    fn sync_directory(&self, directory: &Path) -> Result<(), DurableError> {
        if self.fsync {
            self.step(Step::SyncDirectory, directory, sync_directory, 0)?;
        }
        Ok(())
    }

    /// The bytes of `key`, or `None` if there is no such file.
    ///
    /// # Errors
    /// [`DurableError`] if it cannot be read.
    pub fn read(&self, key: &str) -> Result<Option<Vec<u8>>, DurableError> {
        self.read_at_most(key, u64::MAX)
    }

    /// As [`Directory::read`], but refuses a file of more than `limit` bytes before it reads any.
    ///
    /// # Errors
    /// [`DurableError::Length`] past the limit; [`DurableError`] if it cannot be read.
    pub fn read_at_most(&self, key: &str, limit: u64) -> Result<Option<Vec<u8>>, DurableError> {
        let path = self.path(key)?;
        let Some((mut file, size)) = open(&path)? else { return Ok(None) };
        if size > limit {
            return Err(DurableError::Length { path, expected: limit, found: size });
        }
        let mut bytes = Vec::with_capacity(size as usize);
        self.step(Step::Read, &path, |_| file.read_to_end(&mut bytes), size)?;
        Ok(Some(bytes))
    }

    /// `length` bytes of `key` from `offset`, or `None` if there is no such file. A negative offset counts from the end.
    ///
    /// # Errors
    /// [`DurableError::Range`] if the file is too short; nothing is allocated then.
    pub fn read_range(&self, key: &str, offset: i64, length: u64) -> Result<Option<Vec<u8>>, DurableError> {
        use std::os::unix::fs::FileExt;
        let path = self.path(key)?;
        let Some((file, size)) = open(&path)? else { return Ok(None) };
        let start = if offset < 0 { size.checked_sub(offset.unsigned_abs()) } else { Some(offset as u64) };
        let fits = |s: &u64| s.checked_add(length).is_some_and(|end| end <= size);
        let Some(start) = start.filter(fits) else {
            return Err(DurableError::Range { path, offset, length, size });
        };
        let mut bytes = vec![0; length as usize];
        self.step(Step::Read, &path, |_| file.read_exact_at(&mut bytes, start), length)?;
        Ok(Some(bytes))
    }

    /// Tells the system that `length` bytes of `key` from `offset` will be read soon (0: to the end). Only a hint: what
    /// fails is met again by whoever reads.
    pub fn will_read(&self, key: &str, offset: u64, length: u64) {
        #[cfg(target_os = "linux")]
        if let Ok(path) = self.path(key)
            && let Ok(Some((file, _))) = open(&path)
        {
            let length = std::num::NonZeroU64::new(length);
            let _ = rustix::fs::fadvise(&file, offset, length, rustix::fs::Advice::WillNeed);
        }
    }

    /// The size of `key` in bytes, or `None` if there is no such file.
    ///
    /// # Errors
    /// [`DurableError`] if it cannot be looked up.
    pub fn size_of(&self, key: &str) -> Result<Option<u64>, DurableError> {
        let path = self.path(key)?;
        match std::fs::metadata(&path) {
            Ok(m) => Ok(m.is_file().then_some(m.len())),
            Err(e) if absent(&e) => Ok(None),
            Err(e) => Err(DurableError::io("look up", &path, 0, e)),
        }
    }

    /// Names of what lies in directory `key`, sorted; temp files do not count. None if there is no such directory.
    ///
    /// # Errors
    /// [`DurableError`] if it cannot be listed.
    pub fn names(&self, key: &str) -> Result<Vec<String>, DurableError> {
        let path = self.path(key)?;
        let failed = |e| DurableError::io("list", &path, 0, e);
        let listing = match std::fs::read_dir(&path) {
            Err(e) if absent(&e) => return Ok(Vec::new()),
            other => other.map_err(failed)?,
        };
        let mut names = Vec::new();
        for entry in listing {
            names.extend(entry.map_err(failed)?.file_name().into_string().ok().filter(|n| !is_temp_name(n)));
        }
        names.sort();
        Ok(names)
    }

    /// Removes `key`, durably; a key that is not there is fine.
    ///
    /// # Errors
    /// [`DurableError`] if it cannot be removed.
    pub fn remove(&self, key: &str) -> Result<(), DurableError> {
        let path = self.path(key)?;
        let gone = self.step(
            Step::Remove,
            &path,
            |p| match std::fs::remove_file(p) {
                Err(e) if absent(&e) => Ok(false),
                other => other.map(|()| true),
            },
            0,
        )?;
        if gone { self.sync_directory(path.parent().unwrap_or(&self.root)) } else { Ok(()) }
    }
}

fn absent(e: &std::io::Error) -> bool {
    matches!(e.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory)
}

fn open(path: &Path) -> Result<Option<(File, u64)>, DurableError> {
    let opened = File::open(path).and_then(|f| f.metadata().map(|m| (f, m)));
    match opened {
        Ok((file, m)) if m.is_file() => Ok(Some((file, m.len()))),
        Ok(_) => Ok(None),
        Err(e) if absent(&e) => Ok(None),
        Err(e) => Err(DurableError::io("open", path, 0, e)),
    }
}

/// Flushes a directory's entries. File systems that cannot (some network ones) say so with EINVAL, and are believed.
fn sync_directory(path: &Path) -> std::io::Result<()> {
    match File::open(path)?.sync_all() {
        Err(e) if matches!(e.kind(), ErrorKind::InvalidInput | ErrorKind::Unsupported) => Ok(()),
        other => other,
    }
}

/// Creates `path` and what lacks above it; with `fsync` each new entry is flushed in its parent.
///
/// # Errors
/// [`DurableError`] naming the directory that could not be made.
pub fn create_directories(path: &Path, fsync: bool) -> Result<(), DurableError> {
    if path.as_os_str().is_empty() || path.is_dir() {
        return Ok(());
    }
    if is_url(path) {
        return Err(DurableError::Address {
            path: path.into(),
            problem: "expected a directory of this machine".into(),
        });
    }
    let parent = path.parent().unwrap_or(Path::new(""));
    create_directories(parent, fsync)?;
    match std::fs::create_dir(path) {
        Err(e) if e.kind() == ErrorKind::AlreadyExists && path.is_dir() => Ok(()),
        Err(e) => Err(DurableError::io("create directory", path, 0, e)),
        Ok(()) if fsync => {
            let parent = if parent.as_os_str().is_empty() { Path::new(".") } else { parent };
            sync_directory(parent).map_err(|e| DurableError::io("flush directory", parent, 0, e))
        }
        Ok(()) => Ok(()),
    }
}

/// Gives the directory `temp` the name `path`, durably. `false` if another has taken the name meanwhile.
///
/// # Errors
/// [`DurableError`] if it cannot be renamed.
pub fn publish(temp: &Path, path: &Path, fsync: bool) -> Result<bool, DurableError> {
    match fault::strike(Step::Publish).and_then(|()| std::fs::rename(temp, path)) {
        Err(e)
            if matches!(
                e.kind(),
                ErrorKind::DirectoryNotEmpty | ErrorKind::AlreadyExists | ErrorKind::NotADirectory
            ) =>
        {
            return Ok(false);
        }
        Err(e) => return Err(DurableError::io("rename", path, 0, e)),
        Ok(()) => {}
    }
    if fsync {
        let parent = parent_of(path);
        sync_directory(parent).map_err(|e| DurableError::io("flush directory", parent, 0, e))?;
    }
    Ok(true)
}

/// The directory that holds `path`; `.` for a bare name.
pub fn parent_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Removes a directory with all in it. It is renamed first: whole or not there, also if the removal is cut short.
///
/// # Errors
/// [`DurableError`] if it cannot be renamed or removed.
pub fn remove_directory(path: &Path) -> Result<(), DurableError> {
    let temp = parent_of(path).join(temp_name());
    publish(path, &temp, true)?;
    std::fs::remove_dir_all(&temp).map_err(|e| DurableError::io("remove", &temp, 0, e))
}

/// Bytes that an ordinary user may still write on the file system that holds `path`, which must exist.
///
/// # Errors
/// [`DurableError`] if the file system cannot be asked.
pub fn free_bytes(path: &Path) -> Result<u64, DurableError> {
    let s = rustix::fs::statvfs(path)
        .map_err(|e| DurableError::io("ask the free space of", path, 0, e.into()))?;
    Ok(s.f_bavail.saturating_mul(s.f_frsize))
}

/// Takes a file out of the page cache, so that the next reader meets the disk; a hint that the system may ignore.
///
/// # Errors
/// [`DurableError`] if it cannot be opened.
pub fn evict(path: &Path) -> Result<(), DurableError> {
    let file = File::open(path).map_err(|e| DurableError::io("open", path, 0, e))?;
    #[cfg(target_os = "linux")]
    rustix::fs::fadvise(&file, 0, None, rustix::fs::Advice::DontNeed)
        .map_err(|e| DurableError::io("advise about", path, 0, e.into()))?;
    Ok(())
}

#[cfg(test)]
mod tests;
