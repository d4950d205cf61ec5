//! One interface to directories and to objects below a URL.

use std::path::{Path, PathBuf};

use bytes::Bytes;

use super::direct::FileBytes;
use super::directory::Directory;
use super::error::DurableError;
use super::lock::{Lock, LockError, LockOwner, locks};
use super::objects::Objects;
use super::removal::{self, Removal};
use super::sweep::{Sweep, sweep, temp_files};
use super::url::is_url;

/// Store of a chart, a film or a lens. Keys are relative, with `/` (`film/c/0/1/2`).
#[derive(Clone, Debug)]
pub enum Store {
    /// Files of this machine, or of a network file system.
    Directory(Directory),
    /// Objects below a URL.
    Objects(Objects),
}

impl Store {
    /// The store at `path`, a directory or a URL, which need not exist yet.
    ///
    /// # Errors
    /// [`DurableError::Address`] if the URL names no store.
    pub fn at(path: &Path) -> Result<Self, DurableError> {
        match is_url(path) {
            true => Ok(Self::Objects(Objects::at(path)?)),
            false => Ok(Self::Directory(Directory::new(path))),
        }
    }

    /// See [`Directory::with_fsync`].
    pub fn with_fsync(self, fsync: bool) -> Self {
        match self {
            Self::Directory(d) => Self::Directory(d.with_fsync(fsync)),
            Self::Objects(_) => self,
        }
    }

    /// See [`Directory::opened`]; objects are always those at their URL.
    pub fn opened(self) -> Result<Option<Self>, DurableError> {
        match self {
            Self::Directory(d) => Ok(d.opened()?.map(Self::Directory)),
            Self::Objects(_) => Ok(Some(self)),
        }
    }

    /// Whether the open directory is still at its path; true for objects.
    pub fn is_in_place(&self) -> Result<bool, DurableError> {
        match self {
            Self::Directory(d) => d.is_at(d.root()),
            Self::Objects(_) => Ok(true),
        }
    }

    /// Path or URL of the store.
    pub fn root(&self) -> &Path {
        match self {
            Self::Directory(d) => d.root(),
            Self::Objects(o) => o.root(),
        }
    }

    /// Whether the directory, or an object below the URL, exists.
    pub fn exists(&self) -> Result<bool, DurableError> {
        match self {
            Self::Directory(d) => Ok(d.root().symlink_metadata().is_ok()),
            Self::Objects(o) => o.exists(),
        }
    }

    /// Writes `bytes` under `key`, replacing an existing value, atomically and durably.
    ///
    /// # Errors
    /// [`DurableError`]; the value is then unchanged.
    pub fn write(&self, key: &str, bytes: impl Into<Bytes>) -> Result<(), DurableError> {
        match self {
            Self::Directory(d) => d.write(key, &bytes.into()),
            Self::Objects(o) => o.write(key, bytes.into()),
        }
    }

    /// The bytes of `key`, or `None` if there is no such key.
    pub fn read(&self, key: &str) -> Result<Option<Vec<u8>>, DurableError> {
        self.read_at_most(key, u64::MAX)
    }

    /// As [`Store::read`]; more than `limit` bytes are an error, and are not read.
    ///
    /// # Errors
    /// [`DurableError::Length`] above the limit; [`DurableError`] if it cannot be read.
    pub fn read_at_most(&self, key: &str, limit: u64) -> Result<Option<Vec<u8>>, DurableError> {
        match self {
            Self::Directory(d) => d.read_at_most(key, limit),
            Self::Objects(o) => o.read_at_most(key, limit),
        }
    }

    /// `length` bytes of `key` from `offset`, or `None` if there is no such key. A negative offset counts from the end.
    ///
    /// # Errors
    /// [`DurableError::Range`] if it is too short.
    pub fn read_range(&self, key: &str, offset: i64, length: u64) -> Result<Option<Vec<u8>>, DurableError> {
        match self {
            Self::Directory(d) => d.read_range(key, offset, length),
            Self::Objects(o) => o.read_range(key, offset, length),
        }
    }

    /// `length` bytes of `key` from `offset` past the page cache, or `None` if there is no such key, or it is an object.
    ///
    /// # Errors
    /// [`DurableError::Range`] if it is too short.
    pub fn read_direct(
        &self,
        key: &str,
        offset: u64,
        length: u64,
    ) -> Result<Option<FileBytes>, DurableError> {
        match self {
            Self::Directory(d) => d.read_direct(key, offset, length),
            Self::Objects(_) => Ok(None),
        }
    }

    /// See [`Directory::will_read`]; no effect on objects.
    pub fn will_read(&self, key: &str, offset: u64, length: u64) {
        match self {
            Self::Directory(d) => d.will_read(key, offset, length),
            Self::Objects(_) => (),
        }
    }

    /// The size of `key` in bytes, or `None` if there is no such key.
    pub fn size_of(&self, key: &str) -> Result<Option<u64>, DurableError> {
        match self {
            Self::Directory(d) => d.size_of(key),
            Self::Objects(o) => o.size_of(key),
        }
    }

    /// The size of each of `keys`, as [`Store::size_of`].
    pub fn sizes_of(&self, keys: &[String]) -> Result<Vec<Option<u64>>, DurableError> {
        match self {
            Self::Directory(d) => keys.iter().map(|key| d.size_of(key)).collect(),
            Self::Objects(o) => Ok(o.states(keys)?.into_iter().map(|state| state.map(|s| s.size)).collect()),
        }
    }

    /// Names directly below `key`, sorted, without temporary files.
    pub fn names(&self, key: &str) -> Result<Vec<String>, DurableError> {
        match self {
            Self::Directory(d) => d.names(key),
            Self::Objects(o) => o.names(key),
        }
    }

    /// Removes `key`, durably; a missing key is no error.
    pub fn remove(&self, key: &str) -> Result<(), DurableError> {
        match self {
            Self::Directory(d) => d.remove(key),
            Self::Objects(o) => o.remove(key),
        }
    }

    /// Removes the group `key` with its contents; a missing one is no error. `unlisted`: keys below it that a list of a remote store
    /// may not include yet. After an interruption the group's own metadata still exists, or the group is removed.
    pub fn remove_tree(&self, key: &str, unlisted: Vec<String>) -> Result<(), DurableError> {
        match self {
            Self::Directory(d) => d.remove_tree(key),
            Self::Objects(o) => o.below(key)?.remove_all(unlisted),
        }
    }

    /// The first few keys in it for which `is_own` is false; `None` if there are none. A directory must be open.
    pub fn foreign(
        &self,
        is_own: impl Fn(&str) -> bool + Send + Sync + 'static,
    ) -> Result<Option<Vec<String>>, DurableError> {
        match self {
            Self::Directory(d) => removal::foreign_entries(d, &is_own),
            Self::Objects(o) => Ok(o.first_key(move |key| !is_own(key))?.map(|key| vec![key])),
        }
    }

    /// Removes the store with its contents, if `is_own` is true for all keys in it. `unlisted`: keys that a list of objects may not
    /// include yet. A directory must be open ([`Store::opened`]).
    pub fn remove_all(
        &self,
        unlisted: Vec<String>,
        is_own: impl Fn(&str) -> bool + Send + Sync + 'static,
    ) -> Result<Removal, DurableError> {
        match self {
            Self::Directory(d) => removal::remove_all(d, &is_own),
            Self::Objects(o) => match self.foreign(is_own)? {
                Some(names) => Ok(Removal::Foreign(names)),
                None => o.remove_all(unlisted).map(|()| Removal::Done),
            },
        }
    }

    /// Removes temporary files of ended processes of this host.
    ///
    /// # Errors
    /// As [`sweep`](super::sweep()).
    pub fn sweep(&self) -> Result<Sweep, DurableError> {
        match self {
            Self::Directory(d) => sweep(d.root()),
            Self::Objects(_) => Ok(Sweep::default()),
        }
    }

    /// Temporary files in it, each with whether its process has ended (`None`: unknown).
    pub fn temp_files(&self) -> Result<Vec<(PathBuf, Option<bool>)>, DurableError> {
        match self {
            Self::Directory(d) => temp_files(d.root()),
            Self::Objects(_) => Ok(Vec::new()),
        }
    }

    /// Takes the lock of `unit` in directory `key`. `None`: objects have no locks.
    ///
    /// # Errors
    /// [`LockError`] if another process has it.
    pub fn lock(&self, key: &str, unit: &str, take_over: bool) -> Result<Option<Lock>, LockError> {
        match self {
            Self::Directory(d) => Lock::take(&d.root().join(key), unit, take_over).map(Some),
            Self::Objects(_) => Ok(None),
        }
    }

    /// See [`locks`], of directory `key`; none for objects.
    #[allow(clippy::type_complexity, reason = "as `locks`")]
    pub fn locks(
        &self,
        key: &str,
    ) -> Result<Vec<(PathBuf, Option<Box<LockOwner>>, Option<bool>)>, DurableError> {
        match self {
            Self::Directory(d) => locks(&d.root().join(key)),
            Self::Objects(_) => Ok(Vec::new()),
        }
    }
}
