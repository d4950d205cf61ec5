//! The one door to where charts, films and lenses lie.

use std::path::{Path, PathBuf};

use bytes::Bytes;

use super::removal::{self, Removal};
use super::{
    Directory, DurableError, Lock, LockError, Objects, Owner, Sweep, is_url, locks, sweep, temp_files,
};

/// Where a chart, a film or a lens lies. Keys are relative, with `/` (`film/c/0/1/2`).
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
    /// [`DurableError::Address`] if the URL tells no store.
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

    /// See [`Directory::opened`]; objects cannot be held open, and stay what lies at their URL.
    ///
    /// # Errors
    /// As [`Directory::opened`].
    pub fn opened(self) -> Result<Option<Self>, DurableError> {
        match self {
            Self::Directory(d) => Ok(d.opened()?.map(Self::Directory)),
            Self::Objects(_) => Ok(Some(self)),
        }
    }

    /// Whether the directory that is open still lies at its path. Objects are what lies at their URL.
    ///
    /// # Errors
    /// As [`Directory::is_at`].
    pub fn is_in_place(&self) -> Result<bool, DurableError> {
        match self {
            Self::Directory(d) => d.is_at(d.root()),
            Self::Objects(_) => Ok(true),
        }
    }

    /// The store itself.
    pub fn root(&self) -> &Path {
        match self {
            Self::Directory(d) => d.root(),
            Self::Objects(o) => o.root(),
        }
    }

    /// Whether anything is there.
    ///
    /// # Errors
    /// [`DurableError`] if it cannot be looked up.
    pub fn exists(&self) -> Result<bool, DurableError> {
        match self {
            Self::Directory(d) => Ok(d.root().symlink_metadata().is_ok()),
            Self::Objects(o) => o.exists(),
        }
    }

    /// Writes `bytes` under `key`, replacing what was there, all at once and to last.
    ///
    /// # Errors
    /// [`DurableError`]; the key then holds what it held before.
    pub fn write(&self, key: &str, bytes: impl Into<Bytes>) -> Result<(), DurableError> {
        match self {
            Self::Directory(d) => d.write(key, &bytes.into()),
            Self::Objects(o) => o.write(key, bytes.into()),
        }
    }

    /// The bytes of `key`, or `None` if there is no such key.
    ///
    /// # Errors
    /// [`DurableError`] if it cannot be read.
    pub fn read(&self, key: &str) -> Result<Option<Vec<u8>>, DurableError> {
        self.read_at_most(key, u64::MAX)
    }

    /// As [`Store::read`], but refuses more than `limit` bytes before it reads any.
    ///
    /// # Errors
    /// [`DurableError::Length`] past the limit; [`DurableError`] if it cannot be read.
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

    /// See [`Directory::will_read`].
    pub fn will_read(&self, key: &str, offset: u64, length: u64) {
        match self {
            Self::Directory(d) => d.will_read(key, offset, length),
            Self::Objects(_) => (),
        }
    }

    /// The size of `key` in bytes, or `None` if there is no such key.
    ///
    /// # Errors
    /// [`DurableError`] if it cannot be looked up.
    pub fn size_of(&self, key: &str) -> Result<Option<u64>, DurableError> {
        match self {
            Self::Directory(d) => d.size_of(key),
            Self::Objects(o) => o.size_of(key),
        }
    }

    /// The size of each of `keys`, as [`Store::size_of`].
    ///
    /// # Errors
    /// As [`Store::size_of`].
    pub fn sizes_of(&self, keys: &[String]) -> Result<Vec<Option<u64>>, DurableError> {
        match self {
            Self::Directory(d) => keys.iter().map(|key| d.size_of(key)).collect(),
            Self::Objects(o) => Ok(o.states(keys)?.into_iter().map(|state| state.map(|s| s.size)).collect()),
        }
    }

    /// Names of what lies below `key`, sorted; temp files do not count. None if nothing does.
    ///
    /// # Errors
    /// [`DurableError`] if it cannot be listed.
    pub fn names(&self, key: &str) -> Result<Vec<String>, DurableError> {
        match self {
            Self::Directory(d) => d.names(key),
            Self::Objects(o) => o.names(key),
        }
    }

    /// Removes `key`, to last; one that is not there is fine.
    ///
    /// # Errors
    /// [`DurableError`] if it cannot be removed.
    pub fn remove(&self, key: &str) -> Result<(), DurableError> {
        match self {
            Self::Directory(d) => d.remove(key),
            Self::Objects(o) => o.remove(key),
        }
    }

    /// Removes the group `key` with all below it; nothing there is fine. `known`: keys below it that a list of a store far away may
    /// not show yet. Cut short, the group's own metadata is still there, or all of it is gone.
    ///
    /// # Errors
    /// [`DurableError`] if it cannot be removed.
    pub fn remove_tree(&self, key: &str, known: Vec<String>) -> Result<(), DurableError> {
        match self {
            Self::Directory(d) => d.remove_tree(key),
            Self::Objects(o) => o.below(key)?.remove_all(known),
        }
    }

    /// What lies in it that `own` does not know by its key, the first few; `None` if `own` knows all. A directory must be open.
    ///
    /// # Errors
    /// [`DurableError`] if it cannot be listed.
    pub fn foreign(
        &self,
        own: impl Fn(&str) -> bool + Send + Sync + 'static,
    ) -> Result<Option<Vec<String>>, DurableError> {
        match self {
            Self::Directory(d) => removal::foreign(d, &own),
            Self::Objects(o) => Ok(o.first_key(move |key| !own(key))?.map(|key| vec![key])),
        }
    }

    /// Removes the store with all in it, if `own` knows all of it by its keys; `known` are keys that a list of objects might
    /// not show yet. A directory must be open ([`Store::opened`]).
    ///
    /// # Errors
    /// [`DurableError`] if it cannot be listed or removed.
    pub fn remove_all(
        &self,
        known: Vec<String>,
        own: impl Fn(&str) -> bool + Send + Sync + 'static,
    ) -> Result<Removal, DurableError> {
        match self {
            Self::Directory(d) => removal::remove_all(d, &own),
            Self::Objects(o) => match self.foreign(own)? {
                Some(names) => Ok(Removal::Foreign(names)),
                None => o.remove_all(known).map(|()| Removal::Done),
            },
        }
    }

    /// Removes what dead processes of this host left in it.
    ///
    /// # Errors
    /// [`DurableError`] if it cannot be listed, or something not removed.
    pub fn sweep(&self) -> Result<Sweep, DurableError> {
        match self {
            Self::Directory(d) => sweep(d.root()),
            Self::Objects(_) => Ok(Sweep::default()),
        }
    }

    /// Temp files in it, and whether their maker is dead (`None`: who knows).
    ///
    /// # Errors
    /// [`DurableError`] if it cannot be listed.
    pub fn temp_files(&self) -> Result<Vec<(PathBuf, Option<bool>)>, DurableError> {
        match self {
            Self::Directory(d) => temp_files(d.root()),
            Self::Objects(_) => Ok(Vec::new()),
        }
    }

    /// Takes the lock of `unit`, kept in directory `key`. `None`: this store knows no locks.
    ///
    /// # Errors
    /// [`LockError`] if another has it.
    pub fn lock(&self, key: &str, unit: &str, take_over: bool) -> Result<Option<Lock>, LockError> {
        match self {
            Self::Directory(d) => Lock::take(&d.root().join(key), unit, take_over).map(Some),
            Self::Objects(_) => Ok(None),
        }
    }

    /// The locks in directory `key`, each with its owner and whether that one is dead, as far as can be known.
    ///
    /// # Errors
    /// [`DurableError`] if they cannot be read.
    #[allow(clippy::type_complexity, reason = "as `locks`")]
    pub fn locks(&self, key: &str) -> Result<Vec<(PathBuf, Option<Box<Owner>>, Option<bool>)>, DurableError> {
        match self {
            Self::Directory(d) => locks(&d.root().join(key)),
            Self::Objects(_) => Ok(Vec::new()),
        }
    }
}
