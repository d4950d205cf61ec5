//! Storage of a pack: a directory, objects below a URL, a .zip as file or object, or a .zip in memory. Keys as in Zarr: `psf/0/zarr.json`.
//!
//! A zip has the group at its root or in one top-level directory. Every read has a maximum length, and no buffer is allocated by a size
//! that a header states.

use super::error::LensPackError;
use crate::durable::{DurableError, FileState, HashedFile, Objects, is_not_found, is_url, passes};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufReader, Cursor, Read, Seek};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use zip::ZipArchive;
use zip::result::ZipError;

/// Maximum size of a `zarr.json`, enough for a long source record.
pub(super) const MAX_METADATA_BYTES: u64 = 32 << 20;
/// Bytes of one request of a .zip that is an object.
const REQUEST_BYTES: usize = 1 << 20;

trait ReadSeek: Read + Seek + Send {}
impl<T: Read + Seek + Send> ReadSeek for T {}

/// Values of a pack by key.
pub(super) struct PackStore {
    /// Path in errors.
    pub(super) path: PathBuf,
    kind: Kind,
}

enum Kind {
    /// First state of each file that was read or looked up, by key; `None`: it did not exist.
    Directory(Mutex<BTreeMap<String, Option<FileState>>>),
    Objects(Objects),
    Zip {
        archive: Mutex<ZipArchive<Box<dyn ReadSeek>>>,
        prefix: String,
        origin: Origin,
    },
}

/// Source of a zip's bytes.
#[derive(Clone, Copy)]
enum Origin {
    /// Memory, or a [`HashedFile`], which checks for changes itself.
    Fixed,
    /// The file at the path, and its state when it was opened.
    File(FileState),
    /// An object.
    Object,
}

impl PackStore {
    /// Opens a directory, a .zip file, or either at a URL.
    pub(super) fn open(path: &Path) -> Result<Self, LensPackError> {
        if is_url(path) {
            return Self::objects(path);
        }
        let io = |source| LensPackError::Io { path: path.into(), action: "open the lens pack", source };
        let meta = match std::fs::metadata(path) {
            Ok(meta) => meta,
            Err(e) if e.kind() == io::ErrorKind::NotFound => {
                return Err(LensPackError::NotFound { path: path.into() });
            }
            Err(e) => return Err(io(e)),
        };
        if meta.is_dir() {
            return Ok(Self { path: path.into(), kind: Kind::Directory(Mutex::default()) });
        }
        let file = File::open(path).map_err(io)?;
        let state = FileState::from_metadata(&file.metadata().map_err(io)?);
        Self::file(path, file, Origin::File(state))
    }

    /// Opens the .zip in an open file.
    pub(super) fn hashed(hashed: &HashedFile) -> Result<Self, LensPackError> {
        let path = &hashed.path;
        let io = |source| LensPackError::Io { path: path.clone(), action: "open the lens pack", source };
        Self::file(path, hashed.try_clone().map_err(io)?, Origin::Fixed)
    }

    fn file(path: &Path, mut file: File, origin: Origin) -> Result<Self, LensPackError> {
        let io = |source| LensPackError::Io { path: path.into(), action: "open the lens pack", source };
        file.rewind().map_err(io)?;
        let mut magic = [0; 4];
        if file.read_exact(&mut magic).is_err() || &magic != b"PK\x03\x04" {
            let problem = "it is a file, but not a zip archive".into();
            return Err(LensPackError::NotAPack { path: path.into(), problem });
        }
        file.rewind().map_err(io)?;
        Self::zip(path.into(), Box::new(BufReader::new(file)), origin)
    }

    fn objects(url: &Path) -> Result<Self, LensPackError> {
        let io = |source: DurableError| LensPackError::Io {
            path: url.into(),
            action: "open the lens pack",
            source: source.into(),
        };
        let objects = Objects::at(url).map_err(io)?;
        if objects.read_at_most("zarr.json", MAX_METADATA_BYTES).map_err(io)?.is_some() {
            return Ok(Self { path: url.into(), kind: Kind::Objects(objects) });
        }
        match objects.size_of("").map_err(io)? {
            Some(size) => Self::zip(
                url.into(),
                Box::new(BufReader::with_capacity(
                    REQUEST_BYTES,
                    ObjectReader { objects, size, position: 0 },
                )),
                Origin::Object,
            ),
            None => Err(LensPackError::NotFound { path: url.into() }),
        }
    }

    /// Opens a .zip in memory; `path` is its name in errors.
    pub(super) fn bytes(path: PathBuf, bytes: Cow<'static, [u8]>) -> Result<Self, LensPackError> {
        Self::zip(path, Box::new(Cursor::new(bytes)), Origin::Fixed)
    }

    /// Whether the storage may change: not memory, nor a [`HashedFile`], which detects changes itself.
    pub(super) fn may_change(&self) -> bool {
        !matches!(self.kind, Kind::Zip { origin: Origin::Fixed, .. })
    }

    /// Whether all files that were read or looked up are unchanged, by size, times and inode; `false` if that is unknown.
    pub(super) fn files_are_unchanged(&self) -> bool {
        match &self.kind {
            Kind::Directory(seen) => {
                let seen = seen.lock().unwrap_or_else(PoisonError::into_inner);
                seen.iter().all(|(key, state)| FileState::from_path(&self.path.join(key)) == *state)
            }
            Kind::Zip { origin: Origin::File(state), .. } => FileState::from_path(&self.path) == Some(*state),
            Kind::Zip { origin, .. } => matches!(origin, Origin::Fixed),
            Kind::Objects(_) => false,
        }
    }

    fn zip(path: PathBuf, reader: Box<dyn ReadSeek>, origin: Origin) -> Result<Self, LensPackError> {
        let archive = ZipArchive::new(reader).map_err(|e| match e {
            ZipError::Io(source) if passes(&source) => {
                LensPackError::Io { path: path.clone(), action: "read the lens pack", source }
            }
            e => LensPackError::Zip { path: path.clone(), problem: e.to_string() },
        })?;
        let prefix = match group_prefix(&archive) {
            Ok(prefix) => prefix,
            Err(problem) => return Err(LensPackError::NotAPack { path, problem }),
        };
        Ok(Self { path, kind: Kind::Zip { archive: Mutex::new(archive), prefix, origin } })
    }

    /// Classifies an error of a read: one that may pass, or else the permanent error that `otherwise` makes of its text.
    pub(super) fn read_error(
        &self,
        e: io::Error,
        otherwise: impl FnOnce(String) -> LensPackError,
    ) -> LensPackError {
        match passes(&e) {
            true => LensPackError::Io { path: self.path.clone(), action: "read the lens pack", source: e },
            false => otherwise(e.to_string()),
        }
    }

    /// Stored length in bytes of the value of `key`; `None`: no such key.
    pub(super) fn size(&self, key: &str) -> io::Result<Option<u64>> {
        match &self.kind {
            Kind::Directory(seen) => match std::fs::metadata(self.path.join(key)) {
                Ok(meta) if meta.is_file() => {
                    record_first_state(seen, key, Some(FileState::from_metadata(&meta)));
                    Ok(Some(meta.len()))
                }
                Ok(_) => Ok(None),
                Err(e) => missing(e).inspect(|_| record_first_state(seen, key, None)),
            },
            Kind::Objects(objects) => Ok(objects.size_of(key)?),
            Kind::Zip { archive, prefix, .. } => {
                let mut archive = archive.lock().unwrap_or_else(PoisonError::into_inner);
                match archive.by_name(&format!("{prefix}{key}")) {
                    Ok(file) => Ok(Some(file.compressed_size())),
                    Err(ZipError::FileNotFound) => Ok(None),
                    Err(ZipError::Io(e)) => Err(e),
                    Err(e) => Err(io::Error::other(e)),
                }
            }
        }
    }

    /// The value of `key`; `None`: no such key. More than `limit` bytes are an error.
    pub(super) fn read(&self, key: &str, limit: u64) -> io::Result<Option<Vec<u8>>> {
        match &self.kind {
            Kind::Directory(seen) => match File::open(self.path.join(key)) {
                Ok(file) => {
                    record_first_state(seen, key, Some(FileState::from_metadata(&file.metadata()?)));
                    read_up_to(file, limit).map(Some)
                }
                Err(e) => missing(e).inspect(|_| record_first_state(seen, key, None)),
            },
            Kind::Objects(objects) => Ok(objects.read_at_most(key, limit)?),
            Kind::Zip { archive, prefix, .. } => {
                let mut archive = archive.lock().unwrap_or_else(PoisonError::into_inner);
                match archive.by_name(&format!("{prefix}{key}")) {
                    Ok(file) => read_up_to(file, limit).map(Some),
                    Err(ZipError::FileNotFound) => Ok(None),
                    Err(ZipError::Io(e)) => Err(e),
                    Err(e) => Err(io::Error::other(e)),
                }
            }
        }
    }
}

fn record_first_state(
    seen: &Mutex<BTreeMap<String, Option<FileState>>>,
    key: &str,
    state: Option<FileState>,
) {
    seen.lock().unwrap_or_else(PoisonError::into_inner).entry(key.to_owned()).or_insert(state);
}

/// Reader of an object by range requests.
struct ObjectReader {
    objects: Objects,
    size: u64,
    position: u64,
}

impl Read for ObjectReader {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let length = (self.size.saturating_sub(self.position)).min(out.len() as u64);
        let Some(offset) = i64::try_from(self.position).ok().filter(|_| length > 0) else { return Ok(0) };
        let bytes = self.objects.read_range("", offset, length)?;
        let bytes = bytes.ok_or_else(|| io::Error::other("the object was removed while it was read"))?;
        out[..bytes.len()].copy_from_slice(&bytes);
        self.position += length;
        Ok(bytes.len())
    }
}

impl Seek for ObjectReader {
    fn seek(&mut self, to: io::SeekFrom) -> io::Result<u64> {
        let position = match to {
            io::SeekFrom::Start(n) => Some(n),
            io::SeekFrom::End(n) => self.size.checked_add_signed(n),
            io::SeekFrom::Current(n) => self.position.checked_add_signed(n),
        };
        self.position = position.ok_or_else(|| io::Error::from(io::ErrorKind::InvalidInput))?;
        Ok(self.position)
    }
}

/// `None` if a file does not exist.
fn missing<T>(e: io::Error) -> io::Result<Option<T>> {
    if is_not_found(&e) { Ok(None) } else { Err(e) }
}

/// Reads to the end (where a zip entry checks its CRC); the buffer grows with the bytes read.
fn read_up_to(from: impl Read, limit: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    from.take(limit.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > limit {
        return Err(io::Error::other(format!("is longer than the maximum of {limit} bytes")));
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
        0 => Err("the archive has no zarr.json at its root or in one top-level directory".into()),
        n => Err(format!("the archive contains {n} groups ({})", found.join(", "))),
    }
}
