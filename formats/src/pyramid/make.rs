//! Making a pyramid: level after level, each shard from its pixels in the level before.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use super::level::Level;
use super::{Halving, LevelReader, Pyramid, PyramidState};
use crate::chart::ChartStore;
use crate::group::GroupError;
use crate::parallel::{self, Progress};

impl Pyramid<'_> {
    /// Makes the missing part of the pyramid on at most `threads` threads and in about `memory` bytes. Returns whether it is complete:
    /// `cancel` stops the work after the current shards. `progress` receives the numbers of shards done and in total.
    ///
    /// # Errors
    /// [`GroupError::Incomplete`] if the film or raw is incomplete; [`GroupError`] if files cannot be read or written.
    pub fn make(
        &self,
        threads: usize,
        memory: usize,
        cancel: &AtomicBool,
        progress: Progress<'_>,
    ) -> Result<bool, GroupError> {
        let made = self.make_levels(threads, memory, cancel, progress);
        // If the film or raw was replaced, that is the error to report.
        made.map_err(|e| match self.group().check_in_place() {
            Err(replaced @ (GroupError::Replaced { .. } | GroupError::Recreated { .. })) => replaced,
            _ => e,
        })
    }

    fn make_levels(
        &self,
        threads: usize,
        memory: usize,
        cancel: &AtomicBool,
        progress: Progress<'_>,
    ) -> Result<bool, GroupError> {
        self.check_complete()?;
        let (halving, stamp) = (self.0.halving()?, self.stamp()?);
        self.group().check_in_place()?;
        if matches!(self.state()?, PyramidState::None | PyramidState::Stale) {
            self.write_metadata(&stamp)?;
        }
        let threads = threads.min(memory / self.0.worker_bytes()).max(1);
        let (done, all) = (AtomicUsize::new(0), self.shards());
        let count_shard = || progress(done.fetch_add(1, Ordering::Relaxed) as u64 + 1, all as u64);
        for level in self.levels() {
            self.make_level(&level, &halving, threads, cancel, &count_shard)?;
            if cancel.load(Ordering::Relaxed) {
                return Ok(self.state()? == PyramidState::Complete);
            }
        }
        if self.stamp()? != stamp {
            return Err(GroupError::Changed { kind: self.group().kind, path: self.group().path().into() });
        }
        self.list(&stamp)?;
        Ok(true)
    }

    fn check_complete(&self) -> Result<(), GroupError> {
        let group = self.group();
        let keys: Vec<String> = self.0.source_files().into_iter().map(|file| file.key).collect();
        let found = std::iter::zip(&keys, group.store.sizes_of(&keys)?);
        let missing: Vec<&String> = found.filter(|(_, size)| size.is_none()).map(|(key, _)| key).collect();
        match missing.first() {
            None => Ok(()),
            Some(&first) => Err(GroupError::Incomplete {
                kind: group.kind,
                path: group.path().into(),
                missing: missing.len(),
                shards: keys.len(),
                first: first.clone(),
            }),
        }
    }

    fn make_level(
        &self,
        level: &Level,
        halving: &Halving<'_>,
        threads: usize,
        cancel: &AtomicBool,
        count_shard: &(dyn Fn() + Sync),
    ) -> Result<(), GroupError> {
        let (store, array) = self.open_level(level.output, level.number - 1)?;
        let all: Vec<_> = level.shards(self.0.bands()).collect();
        parallel::for_each::<GroupError>(threads.min(all.len()), all.len(), &|_, _| (), |n| {
            if cancel.load(Ordering::Relaxed) {
                return Ok(());
            }
            let file = self.shard_file(level, all[n]);
            if self.group().store.size_of(&file.key)?.is_none() {
                let below = LevelReader { store: &store, array: &array, band: all[n].0 };
                self.group().commit(&file.key, halving(&below, file.rect, file.shape)?.into())?;
            }
            count_shard();
            Ok(())
        })
    }

    /// Opens a level; also returns the path of its array.
    fn open_level(&self, output: usize, level: usize) -> Result<(ChartStore, String), GroupError> {
        let array = self.level_path(output, level);
        match ChartStore::open_at(self.group().path(), &array, self.0.reader_options()) {
            Ok(store) => Ok((store, array)),
            Err(e) => Err(GroupError::Level { place: array, reason: e.to_string() }),
        }
    }

    /// Calls `use_pixels` with the pixels of every band of a level.
    pub(crate) fn for_each_band(
        &self,
        (output, level): (usize, usize),
        mut use_pixels: impl FnMut(&[f32]),
    ) -> Result<(), GroupError> {
        let (store, array) = self.open_level(output, level)?;
        let mut pixels = Vec::new();
        for band in 0..self.0.bands() {
            LevelReader { store: &store, array: &array, band }.read(store.size().rect(), &mut pixels)?;
            use_pixels(&pixels);
        }
        Ok(())
    }
}
