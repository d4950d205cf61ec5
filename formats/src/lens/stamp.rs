//! A file whose bytes are known by their blake3: its state is compared first ([`FileState`]); where that differs, its bytes decide.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use crate::durable::FileState;

/// Bytes hashed at a time.
const PIECE: usize = 1 << 20;

/// An open file and the blake3 of its bytes. It stays readable when its name is removed or given to another file.
#[derive(Debug)]
pub struct SealedFile {
    pub(super) path: PathBuf,
    file: File,
    stamp: FileState,
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
        let stamp = FileState::of(&file.metadata()?);
        let digest = hash(&file)?;
        match FileState::of(&file.metadata()?) == stamp {
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
        Ok(FileState::of(&self.file.metadata()?) == self.stamp || hash(&self.file)? == self.digest)
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
