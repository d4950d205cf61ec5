//! An open file with the blake3 of its bytes. Later checks compare its state first ([`FileState`]), and its bytes if the state differs.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use super::file_state::FileState;

/// Bytes hashed at a time.
const BUFFER_BYTES: usize = 1 << 20;

/// An open file and the blake3 of its bytes. It remains readable when its name is removed or given to another file.
#[derive(Debug)]
pub struct HashedFile {
    pub(crate) path: PathBuf,
    file: File,
    state: FileState,
    digest: String,
}

impl HashedFile {
    /// Opens the regular file `path` and hashes its bytes.
    ///
    /// # Errors
    /// It is not a regular file, cannot be read, or changes meanwhile.
    pub fn open(path: &Path) -> io::Result<Self> {
        if !std::fs::metadata(path)?.is_file() {
            return Err(io::Error::other("it is not a regular file"));
        }
        let file = File::open(path)?;
        let state = FileState::from_metadata(&file.metadata()?);
        let digest = hash(&file)?;
        match FileState::from_metadata(&file.metadata()?) == state {
            true => Ok(Self { path: path.into(), file, state, digest }),
            false => Err(io::Error::other("it changed while it was read")),
        }
    }

    /// blake3 of its bytes, 64 hexadecimal digits.
    pub fn digest(&self) -> &str {
        &self.digest
    }

    /// A second handle of the open file, with the same file position.
    pub(crate) fn try_clone(&self) -> io::Result<File> {
        self.file.try_clone()
    }

    /// Whether the open file still has the bytes that were hashed.
    pub(crate) fn is_unchanged(&self) -> io::Result<bool> {
        let state = FileState::from_metadata(&self.file.metadata()?);
        Ok(state == self.state || hash(&self.file)? == self.digest)
    }
}

fn hash(file: &File) -> io::Result<String> {
    let (mut hasher, mut buffer, mut offset) = (blake3::Hasher::new(), vec![0; BUFFER_BYTES], 0);
    loop {
        match file.read_at(&mut buffer, offset)? {
            0 => return Ok(hasher.finalize().to_hex().to_string()),
            n => {
                hasher.update(&buffer[..n]);
                offset += n as u64;
            }
        }
    }
}
