//! A directory with durable, atomic writes, addressed by keys.

use std::fs::File;
use std::io::ErrorKind;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use rustix::fs::{CWD, FileType};

use super::direct::{self, FileBytes};
use super::error::{DurableError, is_not_found};
use super::step::FileStep;
use super::temp::is_temp_name;
use super::{fault, handle};

mod batch;
mod write;

pub use batch::Batch;

#[cfg(test)]
type Hook = dyn Fn(FileStep, &Path) -> std::io::Result<()> + Send + Sync;

/// A directory with durable, atomic writes. Keys are relative paths with `/` (`film/c/0/1/2`).
///
/// After [`Directory::opened`] all operations are relative to the open directory, also if it is renamed or another directory takes its
/// path; before, to the directory that is at the path at each call.
#[derive(Clone)]
pub struct Directory {
    root: PathBuf,
    handle: Option<Arc<OwnedFd>>,
    fsync: bool,
    #[cfg(test)]
    fault: Option<Arc<Hook>>,
}

impl std::fmt::Debug for Directory {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Directory({}, fsync: {})", self.root.display(), self.fsync)
    }
}

impl Directory {
    /// The directory `root`, which need not exist yet.
    pub fn new(root: impl Into<PathBuf>) -> Self {
        Self {
            root: root.into(),
            handle: None,
            fsync: true,
            #[cfg(test)]
            fault: None,
        }
    }

    /// Whether writes are flushed to the disk (default). Without it a power failure may lose complete files; a killed process still
    /// leaves none incomplete.
    pub fn with_fsync(mut self, fsync: bool) -> Self {
        self.fsync = fsync;
        self
    }

    /// Calls `fault` before every step and fails with its error.
    #[cfg(test)]
    pub(crate) fn with_fault(
        mut self,
        fault: impl Fn(FileStep, &Path) -> std::io::Result<()> + Send + Sync + 'static,
    ) -> Self {
        self.fault = Some(Arc::new(fault));
        self
    }

    /// Opens the directory, so that all later operations are in it. `None` if it does not exist.
    pub fn opened(mut self) -> Result<Option<Self>, DurableError> {
        match handle::directory(CWD, &self.root) {
            Ok(fd) => self.handle = Some(Arc::new(fd)),
            Err(e) if is_not_found(&e) => return Ok(None),
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

    /// Whether the open directory is the one at `path` (device and inode). True if it is not open.
    pub fn is_at(&self, path: &Path) -> Result<bool, DurableError> {
        let Some(fd) = &self.handle else { return Ok(true) };
        let identity = |found: std::io::Result<rustix::fs::Stat>| match found {
            Ok(stat) => Ok(Some((stat.st_dev, stat.st_ino))),
            Err(e) if is_not_found(&e) => Ok(None),
            Err(e) => Err(DurableError::io("look up", path, 0, e)),
        };
        let opened = identity(handle::stat(fd.as_fd(), Path::new("")))?;
        Ok(identity(handle::stat(CWD, path))? == opened)
    }

    /// Path of the directory.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Path of `key`.
    ///
    /// # Errors
    /// [`DurableError::Key`] for a key outside the directory.
    pub fn path(&self, key: &str) -> Result<PathBuf, DurableError> {
        let relative = Path::new(key);
        if relative.components().all(|c| matches!(c, Component::Normal(_))) {
            Ok(self.root.join(relative))
        } else {
            Err(DurableError::Key { key: key.into(), root: self.root.clone() })
        }
    }

    /// Base directory of system calls, and `path` (below the root) relative to it.
    fn resolve(&self, path: &Path) -> (BorrowedFd<'_>, PathBuf) {
        match &self.handle {
            Some(fd) => (fd.as_fd(), path.strip_prefix(&self.root).unwrap_or(path).to_path_buf()),
            None => (CWD, path.to_path_buf()),
        }
    }

    /// Keys of all files and of empty directories (these with a final `/`) below the root, sorted; links are not followed.
    pub fn all_entries(&self) -> Result<Vec<String>, DurableError> {
        let mut found = Vec::new();
        let mut pending = vec![String::new()];
        while let Some(key) = pending.pop() {
            let path = self.root.join(&key);
            let (base, relative) = self.resolve(&path);
            let entries = match handle::entries(base, &relative) {
                // Removed since it was listed.
                Err(e) if is_not_found(&e) => continue,
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

    /// Names of the entries of directory `key`, sorted, without temporary files. Empty if there is no such directory.
    pub fn names(&self, key: &str) -> Result<Vec<String>, DurableError> {
        let path = self.path(key)?;
        let (base, relative) = self.resolve(&path);
        let entries = match handle::entries(base, &relative) {
            Err(e) if is_not_found(&e) => return Ok(Vec::new()),
            other => other.map_err(|e| DurableError::io("list", &path, 0, e))?,
        };
        let names = entries.into_iter().filter_map(|(name, _)| name.into_string().ok());
        let mut names: Vec<String> = names.filter(|name| !is_temp_name(name)).collect();
        names.sort();
        Ok(names)
    }

    /// The bytes of `key`, or `None` if there is no such file.
    pub fn read(&self, key: &str) -> Result<Option<Vec<u8>>, DurableError> {
        self.read_at_most(key, u64::MAX)
    }

    /// As [`Directory::read`]; a file of more than `limit` bytes is an error, and is not read.
    ///
    /// # Errors
    /// [`DurableError::Length`] above the limit; [`DurableError`] if it cannot be read.
    pub fn read_at_most(&self, key: &str, limit: u64) -> Result<Option<Vec<u8>>, DurableError> {
        use std::io::Read;
        let path = self.path(key)?;
        let Some((mut file, size)) = self.open(&path)? else { return Ok(None) };
        if size > limit {
            return Err(DurableError::Length { path, expected: limit, found: size });
        }
        let mut bytes = Vec::with_capacity(size as usize);
        self.step(FileStep::Read, &path, |_| file.read_to_end(&mut bytes), size)?;
        Ok(Some(bytes))
    }

    /// `length` bytes of `key` from `offset`, or `None` if there is no such file. A negative offset counts from the end.
    ///
    /// # Errors
    /// [`DurableError::Range`] if the file is too short; nothing is allocated then.
    pub fn read_range(&self, key: &str, offset: i64, length: u64) -> Result<Option<Vec<u8>>, DurableError> {
        use std::io::{Read, Seek, SeekFrom};
        let path = self.path(key)?;
        let Some((mut file, start)) = self.open_range(&path, offset, length)? else { return Ok(None) };
        // Not zeroed first.
        let mut bytes = Vec::with_capacity(length as usize);
        let read = |_: &Path| {
            bytes.clear();
            file.seek(SeekFrom::Start(start))?;
            match (&mut file).take(length).read_to_end(&mut bytes)? as u64 == length {
                true => Ok(()),
                false => Err(ErrorKind::UnexpectedEof.into()),
            }
        };
        let done = self.step(FileStep::Read, &path, read, length);
        done.map_err(|e| shortened(e, &file, offset, length))?;
        Ok(Some(bytes))
    }

    /// As [`Directory::read_range`], from `offset`, past the page cache where the file system allows that.
    ///
    /// # Errors
    /// As [`Directory::read_range`].
    pub fn read_direct(
        &self,
        key: &str,
        offset: u64,
        length: u64,
    ) -> Result<Option<FileBytes>, DurableError> {
        let path = self.path(key)?;
        let at = i64::try_from(offset).unwrap_or(i64::MAX);
        let Some((file, start)) = self.open_range(&path, at, length)? else { return Ok(None) };
        let read = |_: &Path| direct::read_exact(&file, start, length as usize);
        let read = self.step(FileStep::Read, &path, read, length);
        read.map(Some).map_err(|e| shortened(e, &file, at, length))
    }

    /// Hint to the kernel (POSIX_FADV_WILLNEED) to read `length` bytes of `key` from `offset` (0: to the end) ahead. Errors are
    /// ignored: the later read reports them.
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
    pub fn size_of(&self, key: &str) -> Result<Option<u64>, DurableError> {
        let path = self.path(key)?;
        let (base, relative) = self.resolve(&path);
        match handle::stat(base, &relative) {
            Ok(stat) => Ok(handle::is_file(&stat).then_some(stat.st_size as u64)),
            Err(e) if is_not_found(&e) => Ok(None),
            Err(e) => Err(DurableError::io("look up", &path, 0, e)),
        }
    }

    /// The file and its size; `None` if there is no regular file.
    fn open(&self, path: &Path) -> Result<Option<(File, u64)>, DurableError> {
        let (base, relative) = self.resolve(path);
        match handle::open(base, &relative).and_then(|f| f.metadata().map(|m| (f, m))) {
            Ok((file, m)) if m.is_file() => Ok(Some((file, m.len()))),
            Ok(_) => Ok(None),
            Err(e) if is_not_found(&e) => Ok(None),
            Err(e) => Err(DurableError::io("open", path, 0, e)),
        }
    }

    /// Opens the file at `path` for `length` bytes at `offset`, which counts from the end if it is negative; the file and their start.
    fn open_range(&self, path: &Path, offset: i64, length: u64) -> Result<Option<(File, u64)>, DurableError> {
        let Some((file, size)) = self.open(path)? else { return Ok(None) };
        let start = if offset < 0 { size.checked_sub(offset.unsigned_abs()) } else { Some(offset as u64) };
        let fits = |start: &u64| start.checked_add(length).is_some_and(|end| end <= size);
        match start.filter(fits) {
            Some(start) => Ok(Some((file, start))),
            None => Err(DurableError::Range { path: path.into(), offset, length, size }),
        }
    }

    /// Executes one step, or fails with the error injected there.
    fn step<T>(
        &self,
        step: FileStep,
        path: &Path,
        act: impl FnOnce(&Path) -> std::io::Result<T>,
        bytes: u64,
    ) -> Result<T, DurableError> {
        let failed = |e| DurableError::io(step.verb(), path, bytes, e);
        #[cfg(test)]
        self.fault.as_ref().map_or(Ok(()), |fault| fault(step, path)).map_err(failed)?;
        // Faults of a write are injected by `fault::write`.
        let injected = if step == FileStep::Write { Ok(()) } else { fault::inject(step) };
        injected.and_then(|()| act(path)).map_err(failed)
    }
}

/// `error` of reading a range of `file`; [`DurableError::Range`] if the file became shorter after its size was compared with the range.
fn shortened(error: DurableError, file: &File, offset: i64, length: u64) -> DurableError {
    match (error, file.metadata()) {
        (DurableError::Io { path, source, .. }, Ok(m)) if source.kind() == ErrorKind::UnexpectedEof => {
            DurableError::Range { path, offset, length, size: m.len() }
        }
        (error, _) => error,
    }
}

#[cfg(test)]
mod tests;
