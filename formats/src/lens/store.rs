//! Where a pack's bytes lie: a directory, objects below a URL, a .zip of them, or a .zip inside the program. Keys as in Zarr:
//! `psf/0/zarr.json`.
//!
//! A zip may hold the group at its root or in one top-level directory. Nothing is read that is longer than the caller
//! expects, and no size in a header is believed before the bytes are there.

use super::array::METADATA_LIMIT;
use super::error::LensPackError;
use super::stamp::SealedFile;
use crate::durable::FileState;
use crate::durable::{DurableError, Objects, is_url, passes};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufReader, Cursor, Read, Seek};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use zip::ZipArchive;
use zip::result::ZipError;

/// Bytes of a .zip that is an object, fetched at once.
const AT_ONCE: usize = 1 << 20;

trait ReadSeek: Read + Seek + Send {}
impl<T: Read + Seek + Send> ReadSeek for T {}

/// The pack's bytes by key.
pub(super) struct Store {
    /// Shown in errors.
    pub(super) path: PathBuf,
    kind: Kind,
}

enum Kind {
    /// What was read or asked for, by key, as the file system told of it first; `None`: it was not there.
    Directory(Mutex<BTreeMap<String, Option<FileState>>>),
    Objects(Objects),
    Zip {
        archive: Mutex<ZipArchive<Box<dyn ReadSeek>>>,
        prefix: String,
        from: Origin,
    },
}

/// Where a zip's bytes come from.
#[derive(Clone, Copy)]
enum Origin {
    /// The program, or a file that is checked elsewhere.
    Fixed,
    /// The file of that name.
    File(FileState),
    /// An object.
    Object,
}

impl Store {
    /// A directory, a .zip file, or one of the two at a URL.
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
        let stamp = FileState::of(&file.metadata().map_err(io)?);
        Self::file(path, file, Origin::File(stamp))
    }

    /// The .zip in an open file.
    pub(super) fn sealed(sealed: &SealedFile) -> Result<Self, LensPackError> {
        let path = &sealed.path;
        let io = |source| LensPackError::Io { path: path.clone(), action: "open the lens pack", source };
        Self::file(path, sealed.reader().map_err(io)?, Origin::Fixed)
    }

    fn file(path: &Path, mut file: File, from: Origin) -> Result<Self, LensPackError> {
        let io = |source| LensPackError::Io { path: path.into(), action: "open the lens pack", source };
        file.rewind().map_err(io)?;
        let mut magic = [0; 4];
        if file.read_exact(&mut magic).is_err() || &magic != b"PK\x03\x04" {
            let problem = "it is a file, but not a zip archive".into();
            return Err(LensPackError::NotAPack { path: path.into(), problem });
        }
        file.rewind().map_err(io)?;
        Self::zip(path.into(), Box::new(BufReader::new(file)), from)
    }

    fn objects(url: &Path) -> Result<Self, LensPackError> {
        let io = |source: DurableError| LensPackError::Io {
            path: url.into(),
            action: "open the lens pack",
            source: source.into(),
        };
        let objects = Objects::at(url).map_err(io)?;
        if objects.read_at_most("zarr.json", METADATA_LIMIT).map_err(io)?.is_some() {
            return Ok(Self { path: url.into(), kind: Kind::Objects(objects) });
        }
        match objects.size_of("").map_err(io)? {
            Some(size) => Self::zip(
                url.into(),
                Box::new(BufReader::with_capacity(AT_ONCE, Object { objects, size, at: 0 })),
                Origin::Object,
            ),
            None => Err(LensPackError::NotFound { path: url.into() }),
        }
    }

    /// A .zip in memory; `path` is what errors call it.
    pub(super) fn bytes(path: PathBuf, bytes: Cow<'static, [u8]>) -> Result<Self, LensPackError> {
        Self::zip(path, Box::new(Cursor::new(bytes)), Origin::Fixed)
    }

    /// Whether what it was read from may change.
    pub(super) fn may_change(&self) -> bool {
        !matches!(self.kind, Kind::Zip { from: Origin::Fixed, .. })
    }

    /// Whether all files that were read or asked for are as they were, by size, times and inode; `false` where nothing tells.
    pub(super) fn same_files(&self) -> bool {
        match &self.kind {
            Kind::Directory(seen) => {
                let seen = seen.lock().unwrap_or_else(PoisonError::into_inner);
                seen.iter().all(|(key, stamp)| FileState::at(&self.path.join(key)) == *stamp)
            }
            Kind::Zip { from: Origin::File(stamp), .. } => FileState::at(&self.path) == Some(*stamp),
            Kind::Zip { from, .. } => matches!(from, Origin::Fixed),
            Kind::Objects(_) => false,
        }
    }

    fn zip(path: PathBuf, reader: Box<dyn ReadSeek>, from: Origin) -> Result<Self, LensPackError> {
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
        Ok(Self { path, kind: Kind::Zip { archive: Mutex::new(archive), prefix, from } })
    }

    /// The error for what cannot be read: it may be sound if that may pass, else it is what `otherwise` says.
    pub(super) fn unread(
        &self,
        e: io::Error,
        otherwise: impl FnOnce(String) -> LensPackError,
    ) -> LensPackError {
        match passes(&e) {
            true => LensPackError::Io { path: self.path.clone(), action: "read the lens pack", source: e },
            false => otherwise(e.to_string()),
        }
    }

    /// Stored length of a key's value in bytes; `None` = no such key.
    pub(super) fn size(&self, key: &str) -> io::Result<Option<u64>> {
        match &self.kind {
            Kind::Directory(seen) => match std::fs::metadata(self.path.join(key)) {
                Ok(meta) if meta.is_file() => {
                    note(seen, key, Some(FileState::of(&meta)));
                    Ok(Some(meta.len()))
                }
                Ok(_) => Ok(None),
                Err(e) => absent(e).inspect(|_| note(seen, key, None)),
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

    /// A key's value; `None` = no such key. Longer than `limit` bytes is an error.
    pub(super) fn read(&self, key: &str, limit: u64) -> io::Result<Option<Vec<u8>>> {
        match &self.kind {
            Kind::Directory(seen) => match File::open(self.path.join(key)) {
                Ok(file) => {
                    note(seen, key, Some(FileState::of(&file.metadata()?)));
                    read_up_to(file, limit).map(Some)
                }
                Err(e) => absent(e).inspect(|_| note(seen, key, None)),
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

/// Remembers what the file system told of a key first.
fn note(seen: &Mutex<BTreeMap<String, Option<FileState>>>, key: &str, stamp: Option<FileState>) {
    seen.lock().unwrap_or_else(PoisonError::into_inner).entry(key.to_owned()).or_insert(stamp);
}

/// A .zip that is an object, read in parts.
struct Object {
    objects: Objects,
    size: u64,
    at: u64,
}

impl Read for Object {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let length = (self.size.saturating_sub(self.at)).min(out.len() as u64);
        let Some(at) = i64::try_from(self.at).ok().filter(|_| length > 0) else { return Ok(0) };
        let bytes = self.objects.read_range("", at, length)?;
        let bytes = bytes.ok_or_else(|| io::Error::other("the object vanished while it was read"))?;
        out[..bytes.len()].copy_from_slice(&bytes);
        self.at += length;
        Ok(bytes.len())
    }
}

impl Seek for Object {
    fn seek(&mut self, to: io::SeekFrom) -> io::Result<u64> {
        let at = match to {
            io::SeekFrom::Start(n) => Some(n),
            io::SeekFrom::End(n) => self.size.checked_add_signed(n),
            io::SeekFrom::Current(n) => self.at.checked_add_signed(n),
        };
        self.at = at.ok_or_else(|| io::Error::from(io::ErrorKind::InvalidInput))?;
        Ok(self.at)
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
