//! Making a pyramid: level after level, each shard from its pixels in the level before.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use pipeline::geometry::{Rect, Size};

use super::halve::halve;
use super::level::{Level, level_sizes};
use super::{PyramidState, list, ome, write_metadata};
use crate::chart::{ChartOptions, ChartStore, NanPolicy};
use crate::film::error::FilmError;
use crate::film::shards::EncodedShard;
use crate::film::store::FilmStore;
use crate::parallel;
use crate::shard::ShardError;

/// Memory of a worker in bytes: its shard, rows of the level before, and the encoded shard.
fn worker_bytes(shard: usize, chunk: usize) -> usize {
    let sample = size_of::<f32>();
    2 * shard * shard * sample + 4 * chunk * shard * sample + 4 * chunk * chunk * sample
}

impl FilmStore {
    /// Makes the missing part of the film's pyramid on at most `threads` threads and in about `memory` bytes. Returns whether it is
    /// complete: `cancel` stops the work after the current shards. `progress` receives the numbers of shards done and in total.
    ///
    /// # Errors
    /// [`FilmError::Incomplete`] if the film is incomplete; [`FilmError`] if files cannot be read or written.
    pub fn make_pyramid(
        &self,
        threads: usize,
        memory: usize,
        cancel: &AtomicBool,
        progress: &(dyn Fn(u64, u64) + Sync),
    ) -> Result<bool, FilmError> {
        let made = self.make_levels(threads, memory, cancel, progress);
        // If the film was replaced, that is the error to report.
        made.map_err(|e| match self.check_in_place() {
            Err(replaced @ (FilmError::Replaced { .. } | FilmError::Recreated { .. })) => replaced,
            _ => e,
        })
    }

    fn make_levels(
        &self,
        threads: usize,
        memory: usize,
        cancel: &AtomicBool,
        progress: &(dyn Fn(u64, u64) + Sync),
    ) -> Result<bool, FilmError> {
        self.check_complete()?;
        let fingerprint = self.fingerprint()?;
        self.write_pyramid_metadata(&fingerprint)?;
        let max_threads = memory / worker_bytes(self.spec.shard, self.spec.chunk);
        let threads = threads.min(max_threads).max(1);
        let (done, all) = (AtomicUsize::new(0), self.pyramid_shards());
        let count_shard = || progress(done.fetch_add(1, Ordering::Relaxed) as u64 + 1, all as u64);
        for level in self.levels() {
            self.make_level(&level, threads, cancel, &count_shard)?;
            if cancel.load(Ordering::Relaxed) {
                return Ok(self.pyramid()? == PyramidState::Complete);
            }
        }
        if self.fingerprint()? != fingerprint {
            return Err(FilmError::Changed { path: self.path().into() });
        }
        self.list_pyramid(&fingerprint)?;
        Ok(true)
    }

    fn check_complete(&self) -> Result<(), FilmError> {
        let all: Vec<_> = self.all_shards().collect();
        let found = std::iter::zip(&all, self.shards_bytes(&all)?);
        let absent = found.filter(|(_, bytes)| bytes.is_none());
        let missing: Vec<String> = absent.map(|(&(o, b, s), _)| self.key(o, b, s)).collect();
        let shards = all.len();
        match missing.first() {
            None => Ok(()),
            Some(first) => Err(FilmError::Incomplete {
                path: self.path().into(),
                missing: missing.len(),
                shards,
                first: first.clone(),
            }),
        }
    }

    /// Writes the pyramid's metadata, unless there is a pyramid of the same pixels; removes a stale one.
    fn write_pyramid_metadata(&self, fingerprint: &str) -> Result<(), FilmError> {
        self.check_in_place()?;
        if matches!(self.pyramid()?, PyramidState::Complete | PyramidState::Unfinished(..)) {
            return Ok(());
        }
        let (metadata, keys) = (self.pyramid_metadata(), self.pyramid_keys());
        Ok(write_metadata(&self.store, &self.pyramid_group(fingerprint), metadata, keys)?)
    }

    fn make_level(
        &self,
        level: &Level,
        threads: usize,
        cancel: &AtomicBool,
        count_shard: &(dyn Fn() + Sync),
    ) -> Result<(), FilmError> {
        let below = self.level_source(level.output, level.number - 1)?;
        let all: Vec<_> = level.all_shards(self.spec.wavelengths_nm.len()).collect();
        parallel::for_each::<FilmError>(threads.min(all.len()), all.len(), &|_, _| (), |n| {
            if cancel.load(Ordering::Relaxed) {
                return Ok(());
            }
            let (band, shard) = all[n];
            self.make_shard(level, &below, band, shard)?;
            count_shard();
            Ok(())
        })
    }

    /// A reader of a level.
    fn level_source(&self, output: usize, level: usize) -> Result<ChartStore, FilmError> {
        let array = self.level_path(output, level);
        let options = ChartOptions {
            // Rows are read in multiples of inner chunks: no chunk is requested twice.
            cache_bytes: 0,
            nan: NanPolicy::Keep,
            wavelengths_nm: Some(self.spec.wavelengths_nm.clone()),
            ..ChartOptions::default()
        };
        ChartStore::open_at(self.path(), &array, options).map_err(|e| FilmError::Level {
            array,
            band: 0,
            rect: Rect::new(0, 0, 0, 0),
            reason: e.to_string(),
        })
    }

    fn make_shard(
        &self,
        level: &Level,
        below: &ChartStore,
        band: usize,
        shard: (usize, usize),
    ) -> Result<(), FilmError> {
        let key = self.level_key(level, band, shard);
        if self.store.size_of(&key)?.is_some() {
            return Ok(());
        }
        let rect = level.grid.shard_rect(shard.0, shard.1);
        let mut means = vec![0f32; rect.size().pixels()];
        let mut rows_below = Vec::new();
        for (k, out) in means.chunks_mut(self.spec.chunk * rect.width).enumerate() {
            let (first, rows) = (rect.y as usize + k * self.spec.chunk, out.len() / rect.width);
            let source = Rect::new(2 * first as i64, 2 * rect.x, 2 * rows, 2 * rect.width)
                .intersect(below.size().rect());
            rows_below.resize(source.size().pixels(), 0.0);
            below.read_rect(band, source, &mut rows_below).map_err(|e| FilmError::Level {
                array: self.level_path(level.output, level.number - 1),
                band,
                rect: source,
                reason: e.to_string(),
            })?;
            halve(&rows_below, source.size(), out);
        }
        let chunks = self.spec.chunks_of(level.grid.shard);
        let encoded = self.encoder.encode(&means, (rect.height, rect.width), chunks);
        let bytes = encoded.map_err(|e| match e {
            ShardError::Overflow { row, column, value } => FilmError::Overflow {
                output: self.level_path(level.output, level.number),
                band,
                row: rect.y + row as i64,
                column: rect.x + column as i64,
                value,
            },
            ShardError::NotFinite { row, column, value } => FilmError::Level {
                array: self.level_path(level.output, level.number),
                band,
                rect,
                reason: format!("{value} at row {}, column {}", rect.y + row as i64, rect.x + column as i64),
            },
            ShardError::Codec(reason) => FilmError::Codec { reason },
        })?;
        self.commit(&EncodedShard { key, bytes: bytes.into() })
    }

    /// Adds the pyramid to the film's group metadata.
    fn list_pyramid(&self, fingerprint: &str) -> Result<(), FilmError> {
        let sizes = level_sizes(self.spec.outputs[0].rect.size());
        let (number, size): (usize, Size) = (sizes.len() - 1, sizes[sizes.len() - 1]);
        let source = self.level_source(0, number)?;
        let mut pixels = vec![0f32; size.pixels()];
        let mut whites = Vec::new();
        for band in 0..self.spec.wavelengths_nm.len() {
            source.read_rect(band, size.rect(), &mut pixels).map_err(|e| FilmError::Level {
                array: self.level_path(0, number),
                band,
                rect: size.rect(),
                reason: e.to_string(),
            })?;
            whites.push(ome::white_level(&pixels));
        }
        list(
            &self.store,
            ome::ome_attribute(self, &whites),
            self.pyramid_group(fingerprint),
            self.pyramid_metadata(),
        )?;
        self.check_in_place()
    }
}
