//! A directory in which a file is absent or complete, never half: what a killed job leaves behind can be trusted.
//!
//! `write` = unique temp name in the same directory → write → check the length → fsync → rename → fsync the directory.
//! A reader, or a job resumed after `kill -9` or a power cut, sees the old bytes or the new ones. Directories are made
//! durable the same way (fsync of the parent). [`sweep`] removes the temp files of processes that are gone.
//!
//! An opened [`Directory`] works through a handle: what later takes its path gets nothing of what is written into it.
//!
//! None of this needs a lock: two writers of one key each rename a whole file, the last one wins, and all writers of one job
//! write the same bytes. [`Lock`] only keeps two runs from doing the same work twice.

mod direct;
mod error;
mod fault;
mod file_state;
mod handle;
mod lock;
mod maker;
mod objects;
mod removal;
mod store;
mod sweep;
mod whole;
mod zarr;

pub(crate) use error::store_error;
pub use error::{DurableError, passes};
pub use fault::point as fault_point;
pub(crate) use file_state::FileState;
pub use lock::{Lock, LockError, Owner, locks};
pub use maker::Maker;
pub use objects::{ObjectState, Objects, check_url, is_url};
pub use removal::Removal;
pub use store::Store;
pub use sweep::{Sweep, is_temp_name, remove_temp, sweep, sweep_entries, temp_files, temp_name};
pub use whole::{WholeFile, finish_together, nameless_file, replace_directory};

use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use rustix::fs::{CWD, FileType};

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
///
/// Opened ([`Directory::opened`]) it stays the directory that it was, whatever takes its path later; else it is the one that
/// lies at its path at each call.
#[derive(Clone)]
pub struct Directory {
    root: PathBuf,
    handle: Option<Arc<OwnedFd>>,
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
        Self { root: root.into(), handle: None, fsync: true, fault: None }
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

    /// The same directory, held open: all that follows happens in it and in no other of that name. `None` if it is not there.
    ///
    /// # Errors
    /// [`DurableError`] if it cannot be opened.
    pub fn opened(mut self) -> Result<Option<Self>, DurableError> {
        match handle::directory(CWD, &self.root) {
            Ok(fd) => self.handle = Some(Arc::new(fd)),
            Err(e) if absent(&e) => return Ok(None),
            Err(e) => return Err(DurableError::io("open directory", &self.root, 0, e)),
        }
        Ok(Some(self))
    }

    /// The same open directory after it was renamed to `root`.
    #[must_use]
    pub fn renamed(mut self, root: &Path) -> Self {
        self.root = root.into();
        self
    }

    /// Whether the directory that is open is the one at `path`.
    ///
    /// # Errors
    /// [`DurableError`] if it cannot be looked up.
    pub fn is_at(&self, path: &Path) -> Result<bool, DurableError> {
        let Some(fd) = &self.handle else { return Ok(true) };
        let identity = |found: std::io::Result<rustix::fs::Stat>| match found {
            Ok(stat) => Ok(Some((stat.st_dev, stat.st_ino))),
            Err(e) if absent(&e) => Ok(None),
            Err(e) => Err(DurableError::io("look up", path, 0, e)),
        };
        let own = identity(handle::stat(fd.as_fd(), Path::new("")))?;
        Ok(identity(handle::stat(CWD, path))? == own)
    }

    /// Paths below it, files and empty directories (these end in `/`), sorted; links are not followed.
    ///
    /// # Errors
    /// [`DurableError`] if it cannot be listed.
    pub fn all_entries(&self) -> Result<Vec<String>, DurableError> {
        let mut found = Vec::new();
        let mut pending = vec![String::new()];
        while let Some(key) = pending.pop() {
            let path = self.root.join(&key);
            let (base, relative) = self.place(&path);
            let entries = match handle::entries(base, &relative) {
                // Removed since it was listed.
                Err(e) if absent(&e) => continue,
                other => other.map_err(|e| DurableError::io("list", &path, 0, e))?,
            };
            if entries.is_empty() && !key.is_empty() {
                found.push(key.clone());
            }
            for (name, kind) in entries {
                let name = format!("{key}{}", name.to_string_lossy());
                match kind {
                    FileType::Directory => pending.push(name + "/"),
                    _ => found.push(name),
                }
            }
        }
        found.sort();
        Ok(found)
    }

    /// What paths are relative to, and `path` (below the root) in those terms.
    fn place(&self, path: &Path) -> (BorrowedFd<'_>, PathBuf) {
        match &self.handle {
            Some(fd) => (fd.as_fd(), path.strip_prefix(&self.root).unwrap_or(path).to_path_buf()),
            None => (CWD, path.to_path_buf()),
        }
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
        self.create_directories(&directory)?;
        let temp = directory.join(temp_name());
        let (base, from) = self.place(&temp);
        let rename = |p: &Path| handle::rename(base, &from, &self.place(p).1);
        self.write_temp(&temp, bytes)
            .and_then(|()| self.step(Step::Rename, &path, rename, bytes.len() as u64))
            .inspect_err(|_| {
                // The error that matters is already in hand; a temp file that stays is swept later.
                let _ = handle::remove_file(base, &from);
            })?;
        self.sync_directory(&directory)
    }

    fn create_directories(&self, path: &Path) -> Result<(), DurableError> {
        let (base, relative) = match &self.handle {
            Some(_) => self.place(path),
            None => return create_directories(path, self.fsync),
        };
        handle::create_directories(base, &relative, self.fsync)
            .map_err(|e| DurableError::io("create directory", path, 0, e))
    }

    fn write_temp(&self, temp: &Path, bytes: &[u8]) -> Result<(), DurableError> {
        let size = bytes.len() as u64;
        let (base, relative) = self.place(temp);
        let mut file = self.step(Step::Create, temp, |_| handle::create_new(base, &relative), size)?;
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
            let (base, relative) = self.place(directory);
            self.step(Step::SyncDirectory, directory, |_| handle::sync_directory(base, &relative), 0)?;
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
        let Some((mut file, size)) = self.open(&path)? else { return Ok(None) };
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
        let Some((file, size)) = self.open(&path)? else { return Ok(None) };
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
            && let Ok(Some((file, _))) = self.open(&path)
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
        let (base, relative) = self.place(&path);
        match handle::stat(base, &relative) {
            Ok(stat) => Ok(handle::is_file(&stat).then_some(stat.st_size as u64)),
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
        let (base, relative) = self.place(&path);
        let entries = match handle::entries(base, &relative) {
            Err(e) if absent(&e) => return Ok(Vec::new()),
            other => other.map_err(|e| DurableError::io("list", &path, 0, e))?,
        };
        let names = entries.into_iter().filter_map(|(name, _)| name.into_string().ok());
        let mut names: Vec<String> = names.filter(|name| !is_temp_name(name)).collect();
        names.sort();
        Ok(names)
    }

    /// Removes `key`, durably; a key that is not there is fine.
    ///
    /// # Errors
    /// [`DurableError`] if it cannot be removed.
    pub fn remove(&self, key: &str) -> Result<(), DurableError> {
        let path = self.path(key)?;
        let (base, relative) = self.place(&path);
        let gone = self.step(
            Step::Remove,
            &path,
            |_| match handle::remove_file(base, &relative) {
                Err(e) if absent(&e) => Ok(false),
                other => other.map(|()| true),
            },
            0,
        )?;
        if gone { self.sync_directory(path.parent().unwrap_or(&self.root)) } else { Ok(()) }
    }

    /// Gives the file `key` the name `to`, replacing what was there. `false` if there is no such file.
    ///
    /// # Errors
    /// [`DurableError`] if it cannot be renamed.
    pub fn rename(&self, key: &str, to: &str) -> Result<bool, DurableError> {
        let (from, to) = (self.path(key)?, self.path(to)?);
        let ((base, old), (_, new)) = (self.place(&from), self.place(&to));
        match self.step(Step::Rename, &to, |_| handle::rename(base, &old, &new), 0) {
            Err(DurableError::Io { source, .. }) if absent(&source) => Ok(false),
            other => other.map(|()| true),
        }
    }

    /// Removes directory `key` with all in it; one that is not there is fine. It is renamed first: whole or not there, also
    /// if the removal is cut short.
    ///
    /// # Errors
    /// [`DurableError`] if it cannot be renamed or removed.
    pub fn remove_tree(&self, key: &str) -> Result<(), DurableError> {
        let path = self.path(key)?;
        let temp = path.with_file_name(temp_name());
        let ((base, from), (_, aside)) = (self.place(&path), self.place(&temp));
        match fault::strike(Step::Publish).and_then(|()| handle::rename(base, &from, &aside)) {
            Err(e) if absent(&e) => return Ok(()),
            other => other.map_err(|e| DurableError::io("rename", &path, 0, e))?,
        }
        self.sync_directory(path.parent().unwrap_or(&self.root))?;
        handle::remove_tree(base, &aside).map_err(|e| DurableError::io("remove", &temp, 0, e))
    }

    fn open(&self, path: &Path) -> Result<Option<(File, u64)>, DurableError> {
        let (base, relative) = self.place(path);
        regular(path, handle::open(base, &relative))
    }
}

pub(crate) fn absent(e: &std::io::Error) -> bool {
    matches!(e.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory)
}

/// The file and its size; `None` if nothing is there, or no regular file.
fn regular(path: &Path, opened: std::io::Result<File>) -> Result<Option<(File, u64)>, DurableError> {
    match opened.and_then(|f| f.metadata().map(|m| (f, m))) {
        Ok((file, m)) if m.is_file() => Ok(Some((file, m.len()))),
        Ok(_) => Ok(None),
        Err(e) if absent(&e) => Ok(None),
        Err(e) => Err(DurableError::io("open", path, 0, e)),
    }
}

fn sync_directory(path: &Path) -> std::io::Result<()> {
    handle::sync_directory(CWD, path)
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

/// Gives the directory or file `temp` the name `path`, durably. `false` if another has taken the name meanwhile.
///
/// # Errors
/// [`DurableError`] if it cannot be renamed.
pub fn publish(temp: &Path, path: &Path, fsync: bool) -> Result<bool, DurableError> {
    // A file would replace another one that has the name, a directory does not.
    let rename = || match temp.symlink_metadata()?.is_file() {
        true => match std::fs::hard_link(temp, path) {
            Err(e) if e.kind() == ErrorKind::AlreadyExists => Err(e),
            Ok(()) => std::fs::remove_file(temp),
            // A file system without hard links: a moment is left in which another may take the name.
            Err(_) if path.symlink_metadata().is_ok() => Err(ErrorKind::AlreadyExists.into()),
            Err(_) => std::fs::rename(temp, path),
        },
        false => std::fs::rename(temp, path),
    };
    match fault::strike(Step::Publish).and_then(|()| rename()) {
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

/// Where `path` leads if it is a link, also one to nothing; else `path` itself, without a `/` at its end. Whatever is put
/// there by renaming then leaves the link as it is.
pub fn link_target(path: &Path) -> PathBuf {
    if is_url(path) {
        return path.to_path_buf();
    }
    let mut place: PathBuf = path.components().collect();
    // As many links in a row as the system follows; a loop is reported by whatever is done to it next.
    for _ in 0..40 {
        let Ok(target) = std::fs::read_link(&place) else { break };
        place = parent_of(&place).join(target).components().collect();
    }
    place
}

/// Fails if this process may not create files in `directory`.
///
/// # Errors
/// [`DurableError::Permission`] if it may not; [`DurableError`] if the file system does not answer.
pub fn check_writable(directory: &Path) -> Result<(), DurableError> {
    use rustix::fs::Access;
    rustix::fs::access(directory, Access::WRITE_OK | Access::EXEC_OK)
        .map_err(|e| DurableError::io("write into", directory, 0, e.into()))
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
