//! Where a pack's bytes lie: a directory, a .zip of it, or a .zip inside the program. Keys as in Zarr: `psf/0/zarr.json`.
//!
//! A zip may hold the group at its root or in one top-level directory. Nothing is read that is longer than the caller
//! expects, and no size in a header is believed before the bytes are there.

use super::error::LensPackError;
use std::borrow::Cow;
use std::fs::File;
use std::io::{self, BufReader, Cursor, Read, Seek};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use zip::ZipArchive;
use zip::result::ZipError;

trait ReadSeek: Read + Seek + Send {}
impl<T: Read + Seek + Send> ReadSeek for T {}

/// The pack's bytes by key.
pub(super) struct Store {
    /// Shown in errors.
    pub(super) path: PathBuf,
    kind: Kind,
}

enum Kind {
    Directory,
    Zip { archive: Mutex<ZipArchive<Box<dyn ReadSeek>>>, prefix: String },
}

impl Store {
    /// A directory, or a .zip file.
    pub(super) fn open(path: &Path) -> Result<Self, LensPackError> {
        let io = |source| LensPackError::Io { path: path.into(), action: "open the lens pack", source };
        let meta = match std::fs::metadata(path) {
            Ok(meta) => meta,
            Err(e) if e.kind() == io::ErrorKind::NotFound => {
                return Err(LensPackError::NotFound { path: path.into() });
            }
            Err(e) => return Err(io(e)),
        };
        if meta.is_dir() {
            return Ok(Self { path: path.into(), kind: Kind::Directory });
        }
        let mut file = File::open(path).map_err(io)?;
        let mut magic = [0; 4];
        if file.read_exact(&mut magic).is_err() || &magic != b"PK\x03\x04" {
            let problem = "it is a file, but not a zip archive".into();
            return Err(LensPackError::NotAPack { path: path.into(), problem });
        }
        file.rewind().map_err(io)?;
        Self::zip(path.into(), Box::new(BufReader::new(file)))
    }

    /// A .zip in memory; `path` is what errors call it.
    pub(super) fn bytes(path: PathBuf, bytes: Cow<'static, [u8]>) -> Result<Self, LensPackError> {
        Self::zip(path, Box::new(Cursor::new(bytes)))
    }

    fn zip(path: PathBuf, reader: Box<dyn ReadSeek>) -> Result<Self, LensPackError> {
        let archive = ZipArchive::new(reader)
            .map_err(|e| LensPackError::Zip { path: path.clone(), problem: e.to_string() })?;
        let prefix = match group_prefix(&archive) {
            Ok(prefix) => prefix,
            Err(problem) => return Err(LensPackError::NotAPack { path, problem }),
        };
        Ok(Self { path, kind: Kind::Zip { archive: Mutex::new(archive), prefix } })
    }

    /// Stored length of a key's value in bytes; `None` = no such key.
    pub(super) fn size(&self, key: &str) -> io::Result<Option<u64>> {
        match &self.kind {
            Kind::Directory => match std::fs::metadata(self.path.join(key)) {
                Ok(meta) if meta.is_file() => Ok(Some(meta.len())),
                Ok(_) => Ok(None),
                Err(e) => absent(e),
            },
            Kind::Zip { archive, prefix } => {
                let mut archive = archive.lock().unwrap_or_else(PoisonError::into_inner);
                match archive.by_name(&format!("{prefix}{key}")) {
                    Ok(file) => Ok(Some(file.compressed_size())),
                    Err(ZipError::FileNotFound) => Ok(None),
                    Err(e) => Err(io::Error::other(e)),
                }
            }
        }
    }

    /// A key's value; `None` = no such key. Longer than `limit` bytes is an error.
    pub(super) fn read(&self, key: &str, limit: u64) -> io::Result<Option<Vec<u8>>> {
        match &self.kind {
            Kind::Directory => match File::open(self.path.join(key)) {
                Ok(file) => read_up_to(file, limit).map(Some),
                Err(e) => absent(e),
            },
            Kind::Zip { archive, prefix } => {
                let mut archive = archive.lock().unwrap_or_else(PoisonError::into_inner);
                match archive.by_name(&format!("{prefix}{key}")) {
                    Ok(file) => read_up_to(file, limit).map(Some),
                    Err(ZipError::FileNotFound) => Ok(None),
                    Err(e) => Err(io::Error::other(e)),
                }
            }
        }
    }
}

fn absent<T>(e: io::Error) -> io::Result<Option<T>> {
    match e.kind() {
        io::ErrorKind::NotFound | io::ErrorKind::NotADirectory => Ok(None),
        _ => Err(e),
    }
}

/// The whole of `from` (a zip entry checks its CRC at the end), grown as it comes.
fn read_up_to(from: impl Read, limit: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    from.take(limit.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > limit {
        return Err(io::Error::other(format!("is longer than the {limit} bytes it can be")));
    }
    Ok(bytes)
}

/// `""`, or the one top-level directory (with its `/`) that holds a `zarr.json`.
fn group_prefix<R>(archive: &ZipArchive<R>) -> Result<String, String>
where
    R: Read + Seek,
{
    let mut found = Vec::new();
    for name in archive.file_names().flatten() {
        match name.split_once('/') {
            None if name == "zarr.json" => return Ok(String::new()),
            Some((top, "zarr.json")) => found.push(format!("{top}/")),
            _ => {}
        }
    }
    match found.len() {
        1 => Ok(found.remove(0)),
        0 => Err("the archive has no zarr.json at its root nor in one top-level directory".into()),
        n => Err(format!("the archive holds {n} groups ({})", found.join(", "))),
    }
}
