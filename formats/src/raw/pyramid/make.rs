//! Making a pyramid: level after level, each shard from its pixels in the level before.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use pipeline::geometry::Rect;

use super::mosaic::{Period, halve_mosaic, mosaic_below};
use super::{Level, LevelShard, ome, pyramid_group_of};
use crate::chart::{ChartOptions, ChartStore};
use crate::film::{PyramidState, list, write_metadata};
use crate::parallel;
use crate::raw::{RawError, RawStore};

/// Memory of a worker in bytes: digital numbers of its shard, rows of the level before and of this one, and the encoded shard.
const fn worker_bytes(shard: usize, chunk: usize) -> usize {
    2 * 2 * shard * shard + 4 * (2 * (chunk + 8)) * (2 * shard + 16) + 4 * chunk * shard
}

impl RawStore {
    /// Makes the missing part of the raw's pyramid on at most `threads` threads and in about `memory` bytes. Returns whether it is
    /// complete: `cancel` stops the work after the current shards. `progress` receives the numbers of shards done and in total.
    ///
    /// # Errors
    /// [`RawError::Incomplete`] if the raw is incomplete; [`RawError`] if files cannot be read or written.
    pub fn make_pyramid(
        &self,
        threads: usize,
        memory: usize,
        cancel: &AtomicBool,
        progress: &(dyn Fn(u64, u64) + Sync),
    ) -> Result<bool, RawError> {
        let made = self.make_levels(threads, memory, cancel, progress);
        // If the raw was replaced, that is the error to report.
        made.map_err(|e| match self.check_in_place() {
            Err(replaced @ (RawError::Replaced { .. } | RawError::Recreated { .. })) => replaced,
            _ => e,
        })
    }

    fn make_levels(
        &self,
        threads: usize,
        memory: usize,
        cancel: &AtomicBool,
        progress: &(dyn Fn(u64, u64) + Sync),
    ) -> Result<bool, RawError> {
        self.check_complete()?;
        let (period, stamp) = (self.period()?, self.stamp()?);
        self.write_pyramid_metadata(&stamp)?;
        let most = memory / worker_bytes(self.spec.shard, self.spec.chunk);
        let threads = threads.min(most).max(1);
        let (done, all) = (AtomicUsize::new(0), self.pyramid_shards());
        for level in self.levels() {
            let below = self.level_source(level.output, level.number - 1)?;
            let shards = self.level_shards(&level);
            parallel::for_each::<RawError>(threads.min(shards.len()), shards.len(), &|_, _| (), |n| {
                if cancel.load(Ordering::Relaxed) {
                    return Ok(());
                }
                self.make_shard(&level, &below, period, shards[n])?;
                progress(done.fetch_add(1, Ordering::Relaxed) as u64 + 1, all as u64);
                Ok(())
            })?;
            if cancel.load(Ordering::Relaxed) {
                return Ok(self.pyramid()? == PyramidState::Complete);
            }
        }
        if self.stamp()? != stamp {
            return Err(RawError::Changed { path: self.path().into() });
        }
        self.list_pyramid(&stamp)?;
        Ok(true)
    }

    fn check_complete(&self) -> Result<(), RawError> {
        let all: Vec<_> = self.spec.all_shards().into_iter().filter(|s| s.frame.is_some()).collect();
        let missing = self.missing(&all)?;
        match missing.first() {
            None => Ok(()),
            Some(&first) => Err(RawError::Incomplete {
                path: self.path().into(),
                missing: missing.len(),
                shards: all.len(),
                first: self.spec.key(first),
            }),
        }
    }

    /// Writes the pyramid's metadata, unless there is a pyramid of the same pixels; removes a stale one.
    fn write_pyramid_metadata(&self, stamp: &str) -> Result<(), RawError> {
        self.check_in_place()?;
        if matches!(self.pyramid()?, PyramidState::Complete | PyramidState::Unfinished(..)) {
            return Ok(());
        }
        let (metadata, keys) = (self.pyramid_metadata(), self.pyramid_keys());
        Ok(write_metadata(&self.store, &pyramid_group_of(stamp), metadata, keys)?)
    }

    /// A reader of a level.
    fn level_source(&self, output: usize, level: usize) -> Result<ChartStore, RawError> {
        let array = self.level_path(output, level);
        let options = ChartOptions {
            cache_bytes: 0,
            // Frames take the place of bands, which have wavelengths.
            wavelengths_nm: Some((1..=self.spec.exposure_s.len()).map(|f| f as f64).collect()),
            ..ChartOptions::default()
        };
        ChartStore::open_at(self.path(), &array, options)
            .map_err(|e| RawError::Level { array, reason: e.to_string() })
    }

    fn make_shard(
        &self,
        level: &Level,
        below: &ChartStore,
        period: Period,
        shard: LevelShard,
    ) -> Result<(), RawError> {
        let key = self.level_key(level, shard);
        if self.store.size_of(&key)?.is_some() {
            return Ok(());
        }
        let rect = self.spec.rect_of_shard(level.size, shard.1);
        let mut counts = vec![0u16; rect.size().pixels()];
        let (mut pixels, mut means) = (Vec::new(), Vec::new());
        for (k, line) in counts.chunks_mut(self.spec.chunk * rect.width).enumerate() {
            let first = rect.y + (k * self.spec.chunk) as i64;
            let part = Rect::new(first, rect.x, line.len() / rect.width, rect.width);
            let source = mosaic_below(part, below.size(), period);
            pixels.resize(source.size().pixels(), 0.0);
            below.read_rect(shard.0, source, &mut pixels).map_err(|e| RawError::Level {
                array: self.level_path(level.output, level.number - 1),
                reason: e.to_string(),
            })?;
            means.resize(line.len(), 0.0);
            halve_mosaic(&pixels, source, period, part, &mut means);
            // Rounded means of 16-bit numbers.
            std::iter::zip(line, &means).for_each(|(count, mean)| *count = *mean as u16);
        }
        let (rows, columns) = self.spec.shard_shape_of(level.size);
        let grid = (rows / self.spec.chunk, columns / self.spec.chunk);
        let bytes = self.counts.encode_counts(&counts, (rect.height, rect.width), grid);
        let bytes = bytes.map_err(|e| RawError::Codec { reason: e.to_string() })?;
        self.check_in_place()?;
        self.in_place(self.store.write(&key, bytes))
    }

    /// Adds the pyramid to the raw's group metadata.
    fn list_pyramid(&self, stamp: &str) -> Result<(), RawError> {
        list(&self.store, ome::ome_attribute(self), pyramid_group_of(stamp), self.pyramid_metadata())?;
        self.check_in_place()
    }
}
