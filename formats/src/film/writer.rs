//! Writing the shards of a film, and what is stored beside them: one by one, or, of a small film, as batches.
//!
//! Each file of a film of [`BATCHED_BYTES`] or more is durable and present when its commit returns. A smaller film in a directory takes
//! less time to compute than to flush file by file: its files are staged and committed together ([`Batch`]) at the end of the run,
//! or earlier, when the batch has 64 files or is a second old. Until then they are absent: for other processes, and after a kill or a power
//! failure, the film is that of the last batch. A shard is present only beside its layers and shares ([`BESIDE`] is committed first).
//! At a URL each object is put alone: there is nothing to flush.

use std::sync::Mutex;

use super::shards::EncodedShard;
use super::store::FilmStore;
use crate::durable::{Batch, Store};
use crate::group::GroupError;

/// Bytes of the pixels of a film, not compressed, from which its files are committed one by one.
const BATCHED_BYTES: u64 = 64_000_000;

/// Rank of a file in a batch: layers and shares.
const BESIDE: u8 = 0;
/// Rank of shards.
const SHARD: u8 = 1;

/// Writes files of a film, on many threads. Files that are not committed by [`FilmWriter::finish`] are removed when it is dropped.
#[derive(Debug)]
pub struct FilmWriter<'a> {
    store: &'a FilmStore,
    batch: Option<Mutex<Batch>>,
}

impl<'a> FilmWriter<'a> {
    /// A writer of shards of `store`.
    pub fn new(store: &'a FilmStore) -> Self {
        let batch = match &store.group.store {
            Store::Directory(directory) if store.spec.bytes() < BATCHED_BYTES => {
                Some(Mutex::new(Batch::new(directory.clone())))
            }
            _ => None,
        };
        Self { store, batch }
    }

    /// The film.
    pub fn store(&self) -> &'a FilmStore {
        self.store
    }

    /// Writes a shard atomically; the film has it, durably, after [`FilmWriter::finish`] at the latest.
    ///
    /// # Errors
    /// As [`FilmStore::commit`]; if the batch was due and cannot be committed, none of its files is there.
    pub fn commit(&self, shard: &EncodedShard) -> Result<(), GroupError> {
        self.write(shard, SHARD)
    }

    /// As [`FilmWriter::commit`], of what is stored beside shards, before the first of them.
    ///
    /// # Errors
    /// As there.
    pub fn commit_beside(&self, chunk: &EncodedShard) -> Result<(), GroupError> {
        self.write(chunk, BESIDE)
    }

    fn write(&self, EncodedShard { key, bytes }: &EncodedShard, rank: u8) -> Result<(), GroupError> {
        let group = self.store.group();
        let Some(batch) = &self.batch else { return group.commit(key, bytes.clone()) };
        let mut batch = batch.lock().expect("no panic while held");
        group.stage(&mut batch, key, rank, bytes)?;
        if batch.is_due() { group.commit_batch(&mut batch) } else { Ok(()) }
    }

    /// Commits what is staged.
    ///
    /// # Errors
    /// [`GroupError::Storage`]; files that were staged are absent then. As [`JobGroup::check_in_place`](crate::group::JobGroup::check_in_place).
    pub fn finish(&self) -> Result<(), GroupError> {
        let Some(batch) = &self.batch else { return Ok(()) };
        self.store.group().commit_batch(&mut batch.lock().expect("no panic while held"))
    }
}
