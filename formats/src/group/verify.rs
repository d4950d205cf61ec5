//! Verification of stored shards: present, intact, and with finite pixels; removal of bad ones.

use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use pipeline::geometry::{Rect, Size};

use super::JobGroup;
use super::error::GroupError;
use crate::durable::{DurableError, Store, fault_point, temp_name};
use crate::parallel::{self, Progress};
use crate::shard::{ShardDefect, ShardEncoder};

/// A defect of a film or raw.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Finding {
    /// A missing shard.
    Missing {
        /// Its key.
        key: String,
    },
    /// A shard that cannot be read because of an error of the system; it may be intact.
    Unreadable {
        /// Its key.
        key: String,
        /// The error.
        reason: String,
    },
    /// A shard that does not decode, or has a NaN or infinite pixel.
    Bad {
        /// Its key.
        key: String,
        /// The defect.
        reason: String,
    },
    /// Attributes of the group that contradict their digests; nothing else has them.
    Attributes {
        /// The defect.
        reason: String,
    },
    /// Metadata or coordinates that contradict the group's attributes, or a pyramid its metadata.
    Metadata {
        /// The file.
        key: String,
        /// The defect.
        reason: String,
    },
}

impl Finding {
    /// Kind, key and reason.
    pub fn fields(&self) -> (&'static str, &str, &str) {
        match self {
            Self::Missing { key } => ("missing", key, "no such file"),
            Self::Bad { key, reason } => ("bad", key, reason),
            Self::Unreadable { key, reason } => ("unreadable", key, reason),
            Self::Attributes { reason } => ("metadata", "zarr.json", reason),
            Self::Metadata { key, reason } => ("metadata", key, reason),
        }
    }
}

/// Result of the verification of a film or raw.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct VerifyReport {
    /// Shards that it must have.
    pub shards: usize,
    /// Bytes of shards read.
    pub bytes: u64,
    /// Defects, in the order of the shards.
    pub findings: Vec<Finding>,
    /// Temporary files, and whether the process that wrote them has ended (`None`: unknown).
    pub temp: Vec<(PathBuf, Option<bool>)>,
}

/// A shard as it is stored.
pub(crate) struct ShardFile<'a> {
    /// Its key.
    pub(crate) key: String,
    /// Encoder of its array.
    pub(crate) encoder: &'a ShardEncoder,
    /// Its shape in pixels, a multiple of that of an inner chunk.
    pub(crate) shape: Size,
    /// Its pixels inside the image.
    pub(crate) rect: Rect,
}

impl JobGroup {
    /// Checks `files` on `threads` threads, each of which holds one shard: bytes read, and defects in the order of the files. `progress`
    /// receives the numbers of shards done and in total.
    pub(crate) fn check_files(
        &self,
        files: &[ShardFile<'_>],
        threads: usize,
        progress: Progress<'_>,
    ) -> Result<(u64, Vec<Finding>), GroupError> {
        let (bytes, found) = (AtomicU64::new(0), Mutex::new(Vec::new()));
        parallel::for_each::<GroupError>(threads, files.len(), progress, |n| {
            let (read, finding) = self.check_file(&files[n])?;
            bytes.fetch_add(read, Relaxed);
            found.lock().expect("no panic while held").extend(finding.map(|f| (n, f)));
            Ok(())
        })?;
        let mut found = found.into_inner().expect("no panic while held");
        found.sort_by_key(|f| f.0);
        Ok((bytes.into_inner(), found.into_iter().map(|f| f.1).collect()))
    }

    /// Reads and decodes one shard: its size in bytes, and its defect.
    pub(crate) fn check_file(&self, file: &ShardFile<'_>) -> Result<(u64, Option<Finding>), GroupError> {
        self.check_file_at(&file.key, file)
    }

    /// As [`JobGroup::check_file`], of a shard that is stored as `key`.
    fn check_file_at(&self, key: &str, file: &ShardFile<'_>) -> Result<(u64, Option<Finding>), GroupError> {
        let (key, rect) = (key.to_owned(), file.rect);
        // Codecs lengthen incompressible data slightly; a longer file is not read.
        let limit = (file.shape.pixels() * file.encoder.sample.bytes()) as u64 * 2 + (1 << 20);
        let bytes = match self.read_to_check(&key, limit)? {
            Ok(bytes) => bytes,
            Err(finding) => return Ok((0, Some(finding))),
        };
        let defect =
            file.encoder.check(&bytes, (rect.height, rect.width), file.encoder.chunks_of(file.shape));
        let finding = defect.err().map(|defect| {
            let reason = match defect {
                ShardDefect::Damaged(reason) => reason,
                ShardDefect::NotFinite { row, column, value } => {
                    let (row, column) = (rect.y + row as i64, rect.x + column as i64);
                    format!("{value} at row {row}, column {column} of the {}", self.kind)
                }
            };
            Finding::Bad { key, reason }
        });
        Ok((bytes.len() as u64, finding))
    }

    /// The bytes of the file `key`, or why it cannot be checked: it is missing, unreadable, or longer than `limit` bytes.
    pub(crate) fn read_to_check(
        &self,
        key: &str,
        limit: u64,
    ) -> Result<Result<Vec<u8>, Finding>, GroupError> {
        let key = key.to_owned();
        match self.store.read_at_most(&key, limit) {
            Ok(Some(bytes)) => Ok(Ok(bytes)),
            Ok(None) => {
                self.check_in_place()?;
                Ok(Err(Finding::Missing { key }))
            }
            Err(e @ DurableError::Length { .. }) => Ok(Err(Finding::Bad { key, reason: e.to_string() })),
            Err(e) if e.is_device_error() || !e.retryable() => {
                Ok(Err(Finding::Unreadable { key, reason: e.to_string() }))
            }
            Err(e) => Err(e.into()),
        }
    }

    /// Removes a shard that a check found to be bad, and returns whether it did: another process may have replaced it by an intact one
    /// since. No lock prevents that, so a file is renamed, checked again under its new name, which no writer uses, and removed only then;
    /// an intact one is renamed back. An object cannot be renamed: it is checked again and removed, and one that is put in between is
    /// lost and computed again by the next run.
    pub(crate) fn remove_bad(&self, file: &ShardFile<'_>) -> Result<bool, GroupError> {
        self.check_in_place()?;
        let key = &file.key;
        let Store::Directory(directory) = &self.store else {
            let bad = matches!(self.check_file(file)?.1, Some(Finding::Bad { .. }));
            return if bad { Ok(self.store.remove(key).map(|()| true)?) } else { Ok(false) };
        };
        let aside = match key.rsplit_once('/') {
            Some((parent, _)) => format!("{parent}/{}", temp_name()),
            None => temp_name(),
        };
        if !directory.rename(key, &aside)? {
            return Ok(false);
        }
        fault_point("shard-aside");
        let bad = matches!(self.check_file_at(&aside, file)?.1, Some(Finding::Bad { .. }));
        if !bad && directory.size_of(key)?.is_none() {
            directory.rename(&aside, key)?;
        } else {
            // Either bad, or an intact copy already exists.
            directory.remove(&aside)?;
        }
        Ok(bad)
    }
}
