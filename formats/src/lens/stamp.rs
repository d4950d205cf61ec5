//! Whether files are still what they were: size, times, inode; and a file whose bytes are known by their blake3.
//!
//! A stamp differs when a file was written, replaced or touched; then its bytes decide. The time of last status change (ctime)
//! cannot be set by a program, so equal stamps mean equal bytes.

use std::fs::{File, Metadata};
use std::io;
use std::os::unix::fs::{FileExt, MetadataExt};
use std::path::{Path, PathBuf};

/// Bytes hashed at a time.
const PIECE: usize = 1 << 20;

/// State of a file, from its metadata.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Stamp {
    inode: (u64, u64),
    length: u64,
    modified_ns: (i64, i64),
    changed_ns: (i64, i64),
}

impl Stamp {
    pub(super) fn new(meta: &Metadata) -> Self {
        Self {
            inode: (meta.dev(), meta.ino()),
            length: meta.len(),
            modified_ns: (meta.mtime(), meta.mtime_nsec()),
            changed_ns: (meta.ctime(), meta.ctime_nsec()),
        }
    }

    /// Of the file at `path`; `None` if there is none.
    pub(super) fn at(path: &Path) -> Option<Self> {
        std::fs::metadata(path).ok().map(|meta| Self::new(&meta))
    }
}

/// An open file and the blake3 of its bytes. It stays readable when its name is removed or given to another file.
#[derive(Debug)]
pub struct SealedFile {
    pub(super) path: PathBuf,
    file: File,
    stamp: Stamp,
    digest: String,
}

impl SealedFile {
    /// Opens the regular file `path` and hashes all of it.
    ///
    /// # Errors
    /// It is no regular file, cannot be read, or changes meanwhile.
    pub fn open(path: &Path) -> io::Result<Self> {
        if !std::fs::metadata(path)?.is_file() {
            return Err(io::Error::other("it is not a regular file"));
        }
        let file = File::open(path)?;
        let stamp = Stamp::new(&file.metadata()?);
        let digest = hash(&file)?;
        match Stamp::new(&file.metadata()?) == stamp {
            true => Ok(Self { path: path.into(), file, stamp, digest }),
            false => Err(io::Error::other("it changed while it was read")),
        }
    }

    /// blake3 of its bytes, 64 hexadecimal digits.
    pub fn digest(&self) -> &str {
        &self.digest
    }

    /// The file, its position shared with this one's.
    pub(super) fn reader(&self) -> io::Result<File> {
        self.file.try_clone()
    }

    /// Whether the open file still has the bytes that it was opened with.
    pub(super) fn holds(&self) -> io::Result<bool> {
        Ok(Stamp::new(&self.file.metadata()?) == self.stamp || hash(&self.file)? == self.digest)
    }
}

fn hash(file: &File) -> io::Result<String> {
    let (mut hasher, mut piece, mut at) = (blake3::Hasher::new(), vec![0; PIECE], 0);
    loop {
        match file.read_at(&mut piece, at)? {
            0 => return Ok(hasher.finalize().to_hex().to_string()),
            n => {
                hasher.update(&piece[..n]);
                at += n as u64;
            }
        }
    }
}
