//! Directories of a classic TIFF file, bounded: every offset and size is checked against the file before memory is allocated.
//!
//! A directory is a number of entries of 12 bytes (tag, type, count, value or its offset) and the offset of the next one. A chain and its
//! sub-directories (tag 330) are followed to at most [`MAX_DIRECTORIES`] of them, each once. Source: TIFF 6.0 (Adobe, 1992), section 2; TIFF
//! Technical Note 1 (sub-directories). Not included: BigTIFF.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use super::error::DngError;

/// Directories of a file, at most: a DNG has one for each preview.
const MAX_DIRECTORIES: usize = 64;
/// Values of an entry, at most, in bytes.
const MAX_VALUE_BYTES: u64 = 16 << 20;
/// Tag of the offsets of sub-directories.
const SUB_DIRECTORIES: u16 = 330;

/// A TIFF file.
#[derive(Debug)]
pub(super) struct Tiff {
    path: PathBuf,
    file: File,
    length: u64,
    pub(super) is_big_endian: bool,
}

/// Entries of a directory by tag.
#[derive(Clone, Debug, Default)]
pub(super) struct Directory(BTreeMap<u16, Entry>);

/// Type, count and place of the values.
#[derive(Clone, Copy, Debug)]
struct Entry {
    kind: u16,
    count: u64,
    at: u64,
}

/// Bytes of a value of each type.
const BYTES: [u64; 14] = [0, 1, 1, 2, 4, 8, 1, 1, 2, 4, 8, 4, 8, 4];

impl Tiff {
    /// Opens a file; `None` if it does not begin as a classic TIFF.
    pub(super) fn open(path: &Path) -> Result<Option<Self>, DngError> {
        let io = |e| DngError::Read { path: path.into(), source: e };
        if !path.is_file() {
            return Ok(None);
        }
        let file = File::open(path).map_err(io)?;
        let length = file.metadata().map_err(io)?.len();
        let mut tiff = Self { path: path.into(), file, length, is_big_endian: false };
        if length < 8 {
            return Ok(None);
        }
        let head = tiff.bytes(0, 4)?;
        tiff.is_big_endian = match head[..] {
            [b'I', b'I', 42, 0] => false,
            [b'M', b'M', 0, 42] => true,
            _ => return Ok(None),
        };
        Ok(Some(tiff))
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    pub(super) fn damaged(&self, reason: impl Into<String>) -> DngError {
        DngError::Damaged { path: self.path.clone(), reason: reason.into() }
    }

    /// Fails unless the bytes are inside the file.
    pub(super) fn check(&self, at: u64, bytes: u64) -> Result<(), DngError> {
        match at.checked_add(bytes) {
            Some(end) if end <= self.length => Ok(()),
            _ => {
                Err(self
                    .damaged(format!("{bytes} bytes at {at} are expected, and the file has {}", self.length)))
            }
        }
    }

    /// Bytes of the file.
    pub(super) fn bytes(&self, at: u64, bytes: u64) -> Result<Vec<u8>, DngError> {
        self.check(at, bytes)?;
        let mut out = vec![0; bytes as usize];
        self.file
            .read_exact_at(&mut out, at)
            .map_err(|source| DngError::Read { path: self.path.clone(), source })?;
        Ok(out)
    }

    fn whole(&self, bytes: &[u8]) -> u64 {
        let add = |n: u64, byte: &u8| n << 8 | u64::from(*byte);
        if self.is_big_endian { bytes.iter().fold(0, add) } else { bytes.iter().rev().fold(0, add) }
    }

    /// The directory at an offset, and the offset of the next one, 0 for none.
    fn directory(&self, at: u64) -> Result<(Directory, u64), DngError> {
        let count = self.whole(&self.bytes(at, 2)?);
        let all = self.bytes(at + 2, 12 * count + 4)?;
        let (entries, next) = all.split_at(12 * count as usize);
        let mut directory = Directory::default();
        for (k, entry) in entries.chunks_exact(12).enumerate() {
            let (tag, kind) = (self.whole(&entry[..2]) as u16, self.whole(&entry[2..4]) as u16);
            let count = self.whole(&entry[4..8]);
            let Some(bytes) = BYTES.get(usize::from(kind)).filter(|b| **b > 0) else { continue };
            let in_place = at + 2 + 12 * k as u64 + 8;
            let at = if bytes * count <= 4 { in_place } else { self.whole(&entry[8..]) };
            directory.0.insert(tag, Entry { kind, count, at });
        }
        Ok((directory, self.whole(next)))
    }

    /// The first directory.
    pub(super) fn first(&self) -> Result<Directory, DngError> {
        Ok(self.directory(self.whole(&self.bytes(4, 4)?))?.0)
    }

    /// All directories, the first one first.
    pub(super) fn directories(&self) -> Result<Vec<Directory>, DngError> {
        let mut waiting = vec![self.whole(&self.bytes(4, 4)?)];
        let (mut seen, mut all) = (BTreeSet::new(), Vec::new());
        while let Some(at) = waiting.pop() {
            // Sub-directories may be a chain as well, and a damaged chain a circle.
            if !seen.insert(at) {
                continue;
            }
            if seen.len() > MAX_DIRECTORIES {
                return Err(self.damaged(format!("it has more than {MAX_DIRECTORIES} directories")));
            }
            let (directory, next) = self.directory(at)?;
            if next != 0 {
                waiting.push(next);
            }
            let below = self.numbers(&directory, SUB_DIRECTORIES)?.unwrap_or_default();
            if below.len() > MAX_DIRECTORIES {
                return Err(self.damaged(format!("a directory has {} sub-directories", below.len())));
            }
            waiting.extend(below.iter().rev().map(|at| *at as u64));
            all.push(directory);
        }
        Ok(all)
    }

    /// The directory that a tag points to.
    pub(super) fn pointed_to(&self, from: &Directory, tag: u16) -> Result<Option<Directory>, DngError> {
        match self.number(from, tag)? {
            Some(at) if at > 0.0 => Ok(Some(self.directory(at as u64)?.0)),
            _ => Ok(None),
        }
    }

    /// Bytes of a tag's values.
    pub(super) fn raw(&self, directory: &Directory, tag: u16) -> Result<Option<Vec<u8>>, DngError> {
        let Some(entry) = directory.0.get(&tag) else { return Ok(None) };
        let bytes = BYTES[usize::from(entry.kind)] * entry.count;
        if bytes > MAX_VALUE_BYTES {
            return Err(self.damaged(format!("the values of tag {tag} have {bytes} bytes")));
        }
        self.bytes(entry.at, bytes).map(Some)
    }

    /// Numbers of a tag; those of a denominator of 0 are infinite or NaN.
    ///
    /// # Errors
    /// A tag that is no number; values outside the file.
    pub(super) fn numbers(&self, directory: &Directory, tag: u16) -> Result<Option<Vec<f64>>, DngError> {
        let Some(bytes) = self.raw(directory, tag)? else { return Ok(None) };
        let kind = directory.0[&tag].kind;
        let number = |b: &[u8]| {
            let n = self.whole(b);
            let half = |b: &[u8]| self.whole(b) as u32;
            match kind {
                6 => f64::from(n as u8 as i8),
                8 => f64::from(n as u16 as i16),
                9 => f64::from(n as u32 as i32),
                5 => f64::from(half(&b[..4])) / f64::from(half(&b[4..])),
                10 => f64::from(half(&b[..4]) as i32) / f64::from(half(&b[4..]) as i32),
                11 => f64::from(f32::from_bits(n as u32)),
                12 => f64::from_bits(n),
                _ => n as f64,
            }
        };
        if kind == 2 {
            return Err(self.damaged(format!("tag {tag} is a text, expected numbers")));
        }
        Ok(Some(bytes.chunks_exact(BYTES[usize::from(kind)] as usize).map(number).collect()))
    }

    /// The first number of a tag.
    pub(super) fn number(&self, directory: &Directory, tag: u16) -> Result<Option<f64>, DngError> {
        Ok(self.numbers(directory, tag)?.and_then(|all| all.first().copied()))
    }

    /// The text of a tag.
    pub(super) fn text(&self, directory: &Directory, tag: u16) -> Result<Option<String>, DngError> {
        let text = self.raw(directory, tag)?.map(|bytes| {
            let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
            String::from_utf8_lossy(&bytes[..end]).trim().replace(char::is_control, " ")
        });
        Ok(text.filter(|t| !t.is_empty()))
    }
}

impl Directory {
    /// Whether it has a tag.
    pub(super) fn has(&self, tag: u16) -> bool {
        self.0.contains_key(&tag)
    }
}
