//! Batches of files of a [`Directory`] that are committed together.
//!
//! A file that is written alone is flushed, then its directory, and each new directory before it: five flushes one after another for a
//! first shard. A batch has two for all its files of one rank, and one more for each further rank:
//!
//! | step | files of the batch after a kill or a power failure |
//! |---|---|
//! | [`Batch::stage`]: temporary name, write, check of the length | absent; the temporary files are swept |
//! | [`Batch::flush`]: all files are flushed, concurrently | absent |
//! | [`Batch::publish`]: for each rank, ascending, renames to the final names, then all directories from those of the files to the root are flushed, concurrently | each absent or complete; one that exists has all of lower ranks |
//! | after it | complete |
//!
//! A file has its final name only after its bytes are on the disk, as of a single write. All directories above a file are flushed, also
//! those that existed: another process may have created them for its batch and not flushed them yet. The file system as a whole is not
//! flushed (`syncfs`): that would wait for what all other programs have written.

use std::collections::BTreeSet;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use super::super::error::DurableError;
use super::Directory;
use crate::parallel;

/// Files of a batch, which are open until it is committed.
const MAX_FILES: usize = 64;
/// Age of a batch.
const MAX_AGE: Duration = Duration::from_secs(1);
/// Flushes at a time; disks and file systems combine those that arrive together.
const CONCURRENT_FLUSHES: usize = 8;

/// Files that are committed together. Those that are not published when it is dropped are removed.
#[derive(Debug)]
pub struct Batch {
    directory: Directory,
    files: Vec<StagedFile>,
    /// When the first file was staged.
    since: Instant,
}

/// A complete file under its temporary name, not flushed yet.
#[derive(Debug)]
struct StagedFile {
    file: File,
    temp: PathBuf,
    path: PathBuf,
    rank: u8,
    bytes: u64,
}

impl Batch {
    /// An empty batch of files of `directory`.
    pub fn new(directory: Directory) -> Self {
        Self { directory, files: Vec::new(), since: Instant::now() }
    }

    /// Writes `bytes` for `key` under a temporary name.
    ///
    /// # Errors
    /// [`DurableError`]; the batch is then as before.
    pub fn stage(&mut self, key: &str, rank: u8, bytes: &[u8]) -> Result<(), DurableError> {
        if self.files.is_empty() {
            self.since = Instant::now();
        }
        let path = self.directory.path(key)?;
        let (file, temp) = self.directory.write_beside(&path, bytes, false)?;
        self.files.push(StagedFile { file, temp, path, rank, bytes: bytes.len() as u64 });
        Ok(())
    }

    /// Whether no file is staged.
    pub fn is_empty(&self) -> bool {
        self.files.is_empty()
    }

    /// Whether it is to be committed before more files are staged: it bounds the open files, and the work that a kill loses.
    pub fn is_due(&self) -> bool {
        self.files.len() >= MAX_FILES || (!self.is_empty() && self.since.elapsed() >= MAX_AGE)
    }

    /// Flushes and publishes the files.
    ///
    /// # Errors
    /// As [`Batch::flush`] and [`Batch::publish`].
    pub fn commit(&mut self) -> Result<(), DurableError> {
        self.flush()?;
        self.publish()
    }

    /// Flushes all files to the disk.
    ///
    /// # Errors
    /// [`DurableError`]; the files are removed then: a second flush would not report bytes that the first one lost.
    pub fn flush(&mut self) -> Result<(), DurableError> {
        let flushed = concurrently(&self.files, |f| self.directory.sync_file(&f.file, &f.temp, f.bytes));
        flushed.inspect_err(|_| self.remove_staged())
    }

    /// Renames the files, which are flushed, to their final names, and flushes their directories. The batch is empty afterwards.
    ///
    /// # Errors
    /// [`DurableError`]; files of lower ranks, or some of one rank, are published then, and the others removed.
    pub fn publish(&mut self) -> Result<(), DurableError> {
        self.publish_ranks().inspect_err(|_| self.remove_staged())?;
        self.files.clear();
        Ok(())
    }

    fn publish_ranks(&self) -> Result<(), DurableError> {
        let ranks: BTreeSet<u8> = self.files.iter().map(|f| f.rank).collect();
        let root = self.directory.root();
        for rank in ranks {
            let mut directories = BTreeSet::new();
            for file in self.files.iter().filter(|f| f.rank == rank) {
                self.directory.rename_file(&file.temp, &file.path, file.bytes)?;
                let above = file.path.ancestors().skip(1).take_while(|path| path.starts_with(root));
                directories.extend(above.map(Path::to_path_buf));
            }
            let directories: Vec<PathBuf> = directories.into_iter().collect();
            concurrently(&directories, |path| self.directory.sync_directory(path))?;
        }
        Ok(())
    }

    /// Removes the files that still have temporary names.
    fn remove_staged(&mut self) {
        self.files.drain(..).for_each(|f| self.directory.remove_temp(&f.temp));
    }
}

impl Drop for Batch {
    fn drop(&mut self) {
        self.remove_staged();
    }
}

/// Calls `flush` for each of `all`, on several threads.
fn concurrently<T: Sync>(
    all: &[T],
    flush: impl Fn(&T) -> Result<(), DurableError> + Sync,
) -> Result<(), DurableError> {
    match all {
        [] => Ok(()),
        [one] => flush(one),
        _ => parallel::for_each(all.len().min(CONCURRENT_FLUSHES), all.len(), &|_, _| (), |n| flush(&all[n])),
    }
}

#[cfg(test)]
mod tests;
