//! Verification of a raw and of its pyramid: every shard present and intact.

use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use pipeline::geometry::Size;

use super::{RawError, RawShard, RawStore};
use crate::durable::DurableError;
use crate::parallel;
use crate::shard::{ShardDefect, ShardEncoder};

/// A defect of a raw.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RawFinding {
    /// Key of the file.
    pub key: String,
    /// The defect; none: it is missing.
    pub reason: Option<String>,
    /// Whether it is a shard, which a repair removes.
    pub removable: bool,
}

impl RawStore {
    /// Reads and checks every shard on `threads` threads: bytes read, and defects in the order of the shards.
    ///
    /// # Errors
    /// [`RawError::Storage`] if the store cannot be read. Defects are findings, not errors.
    pub fn verify(
        &self,
        threads: usize,
        progress: &(dyn Fn(u64, u64) + Sync),
    ) -> Result<(u64, Vec<RawFinding>), RawError> {
        let all = self.spec.all_shards();
        let (bytes, found) = (AtomicU64::new(0), Mutex::new(Vec::new()));
        parallel::for_each::<RawError>(threads, all.len(), progress, |n| {
            let (read, finding) = self.check_shard(all[n])?;
            bytes.fetch_add(read, Relaxed);
            found.lock().expect("no panic while held").extend(finding.map(|f| (n, f)));
            Ok(())
        })?;
        let mut found = found.into_inner().expect("no panic while held");
        found.sort_by_key(|f| f.0);
        let (pyramid_bytes, of_pyramid) = self.check_pyramid()?;
        self.check_in_place()?;
        let all = found.into_iter().map(|f| f.1).chain(of_pyramid).collect();
        Ok((bytes.into_inner() + pyramid_bytes, all))
    }

    fn check_shard(&self, shard: RawShard) -> Result<(u64, Option<RawFinding>), RawError> {
        let encoder = if shard.frame.is_some() { &self.counts } else { &self.signal };
        let size = self.spec.shard_rect(shard).size();
        self.check_key(self.spec.key(shard), encoder, self.spec.shard_shape(shard.output), size)
    }

    /// Bytes read and defect of the shard `key` of `shape` (rows, columns), whose pixels are `size`.
    pub(super) fn check_key(
        &self,
        key: String,
        encoder: &ShardEncoder,
        (rows, columns): (usize, usize),
        size: Size,
    ) -> Result<(u64, Option<RawFinding>), RawError> {
        let finding = |reason| Some(RawFinding { key: key.clone(), reason, removable: true });
        // Compression never doubles a shard: a longer file is none of this program's and is not read.
        let limit = (rows * columns * 4) as u64 * 2 + (1 << 20);
        let bytes = match self.store.read_at_most(&key, limit) {
            Ok(Some(bytes)) => bytes,
            Ok(None) => return Ok((0, finding(None))),
            Err(e @ DurableError::Length { .. }) => return Ok((0, finding(Some(e.to_string())))),
            Err(e) => return Err(e.into()),
        };
        let grid = (rows / self.spec.chunk, columns / self.spec.chunk);
        let defect = encoder.check(&bytes, (size.height, size.width), grid).err();
        let reason = defect.map(|defect| match defect {
            ShardDefect::Damaged(reason) => reason,
            ShardDefect::NotFinite { row, column, value } => format!("{value} at row {row}, column {column}"),
        });
        Ok((bytes.len() as u64, reason.and_then(|reason| finding(Some(reason)))))
    }

    /// Removes a shard that a check found to be bad, while the raw is locked.
    ///
    /// # Errors
    /// As [`RawStore::commit_counts`].
    pub fn remove_bad(&self, finding: &RawFinding) -> Result<(), RawError> {
        self.check_in_place()?;
        Ok(self.store.remove(&finding.key)?)
    }
}
