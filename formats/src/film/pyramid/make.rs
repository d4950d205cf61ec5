//! Making a pyramid: level after level, each shard from what lies below it in the level before.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use pipeline::geometry::{Rect, Size};

use super::super::{EncodedShard, FilmError, FilmStore, json};
use super::{Level, PLACE, PyramidState, film_group, halve, level_sizes, ome};
use crate::chart::{ChartOptions, ChartStore, NanPolicy};
use crate::hierarchy::pretty;
use crate::shard::ShardError;

/// Bytes that a worker holds: its shard, a strip of the level before, and the encoded shard.
pub(super) fn worker_bytes(shard: usize, chunk: usize) -> usize {
    let sample = size_of::<f32>();
    2 * shard * shard * sample + 4 * chunk * shard * sample + 4 * chunk * chunk * sample
}

impl FilmStore {
    /// Makes the film's pyramid, or what is missing of it, on at most `threads` threads and in about `memory` bytes. Returns
    /// whether it is whole: `cancel` ends the work after the shards in hand. `progress` is told shards done and in all.
    ///
    /// # Errors
    /// [`FilmError::Incomplete`] while the film is not all there; [`FilmError`] if files cannot be read or written.
    pub fn make_pyramid(
        &self,
        threads: usize,
        memory: usize,
        cancel: &AtomicBool,
        progress: &(dyn Fn(u64, u64) + Sync),
    ) -> Result<bool, FilmError> {
        let made = self.make_levels(threads, memory, cancel, progress);
        // Of a film that was replaced nothing else is worth reporting.
        made.map_err(|e| match self.check_in_place() {
            Err(gone @ (FilmError::Replaced { .. } | FilmError::Renewed { .. })) => gone,
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
        let stamp = self.stamp()?;
        self.begin_pyramid(&stamp)?;
        let fits = memory / worker_bytes(self.spec.shard, self.spec.chunk);
        let threads = threads.min(fits).max(1);
        let (done, all) = (AtomicUsize::new(0), self.pyramid_shards());
        let tell = || progress(done.fetch_add(1, Ordering::Relaxed) as u64 + 1, all as u64);
        for level in self.levels() {
            self.make_level(&level, threads, cancel, &tell)?;
            if cancel.load(Ordering::Relaxed) {
                return Ok(self.pyramid()? == PyramidState::Complete);
            }
        }
        if self.stamp()? != stamp {
            return Err(FilmError::Changed { path: self.path().into() });
        }
        self.tell_pyramid(&stamp)?;
        Ok(true)
    }

    fn check_complete(&self) -> Result<(), FilmError> {
        let all: Vec<_> = self.every_shard().collect();
        let found = std::iter::zip(&all, self.shards_bytes(&all)?);
        let absent = found.filter(|(_, there)| there.is_none());
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

    /// Lays the pyramid's metadata, unless those of this very film are there already.
    fn begin_pyramid(&self, stamp: &str) -> Result<(), FilmError> {
        self.check_in_place()?;
        let there = !self.store.names(PLACE)?.is_empty();
        if matches!(self.pyramid()?, PyramidState::Complete | PyramidState::Unfinished(..)) {
            return Ok(());
        }
        // The film stops telling of what goes, before it goes.
        let group = json(&self.store, "zarr.json")?.unwrap_or_default();
        if group["attributes"].get("ome").is_some() {
            self.store.write("zarr.json", pretty(&film_group(group, None, Vec::new())))?;
        }
        if there {
            self.store.remove_tree(PLACE, self.pyramid_keys())?;
        }
        for (key, metadata) in self.pyramid_metadata() {
            self.store.write(&format!("{key}/zarr.json"), pretty(&metadata))?;
        }
        // Last: a pyramid without it is begun anew.
        Ok(self.store.write(&format!("{PLACE}/zarr.json"), pretty(&self.pyramid_group(stamp)))?)
    }

    fn make_level(
        &self,
        level: &Level,
        threads: usize,
        cancel: &AtomicBool,
        tell: &(dyn Fn() + Sync),
    ) -> Result<(), FilmError> {
        let below = self.level_source(level.output, level.number - 1)?;
        let all: Vec<_> = level.every_shard(self.spec.wavelengths_nm.len()).collect();
        let (next, failed) = (AtomicUsize::new(0), Mutex::new(None));
        let work = || {
            while let Some(&(band, shard)) = all.get(next.fetch_add(1, Ordering::Relaxed)) {
                if cancel.load(Ordering::Relaxed) {
                    return;
                }
                let made = self.make_shard(level, &below, band, shard);
                if let Err(e) = made {
                    next.store(all.len(), Ordering::Relaxed);
                    failed.lock().expect("no panic while held").get_or_insert(e);
                    return;
                }
                tell();
            }
        };
        std::thread::scope(|s| (0..threads.min(all.len())).for_each(|_| drop(s.spawn(work))));
        failed.into_inner().expect("no panic while held").map_or(Ok(()), Err)
    }

    /// The array of a level, read as it is.
    fn level_source(&self, output: usize, level: usize) -> Result<ChartStore, FilmError> {
        let array = self.level_path(output, level);
        let options = ChartOptions {
            // Strips begin and end with inner chunks: nothing is asked for twice.
            cache_bytes: 0,
            nan: NanPolicy::Keep,
            wavelengths_nm: Some(self.spec.wavelengths_nm.clone()),
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
        let rect = level.rect(shard);
        let mut means = vec![0f32; rect.size().pixels()];
        let mut strip = Vec::new();
        for (k, out) in means.chunks_mut(self.spec.chunk * rect.width).enumerate() {
            let (first, rows) = (rect.y as usize + k * self.spec.chunk, out.len() / rect.width);
            let source = Rect::new(2 * first as i64, 2 * rect.x, 2 * rows, 2 * rect.width)
                .intersect(below.size().rect());
            strip.resize(source.size().pixels(), 0.0);
            below.read_rect(band, source, &mut strip).map_err(|e| FilmError::Level {
                array: self.level_path(level.output, level.number - 1),
                band,
                rect: source,
                reason: e.to_string(),
            })?;
            halve(&strip, source.size(), out);
        }
        let grid = (level.shard.0 / self.spec.chunk, level.shard.1 / self.spec.chunk);
        let encoded = self.encoder.encode(&means, (rect.height, rect.width), grid);
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

    /// Lets the film's own metadata tell of the pyramid.
    fn tell_pyramid(&self, stamp: &str) -> Result<(), FilmError> {
        let last = level_sizes(self.spec.outputs[0].rect.size());
        let (number, size): (usize, Size) = (last.len() - 1, last[last.len() - 1]);
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
            whites.push(ome::white(&pixels));
        }
        let mut members = vec![(PLACE.to_owned(), self.pyramid_group(stamp))];
        members.extend(self.pyramid_metadata());
        let group = json(&self.store, "zarr.json")?.unwrap_or_default();
        let told = film_group(group.clone(), Some(ome::ome(self, &whites)), members);
        if told != group {
            self.store.write("zarr.json", pretty(&told))?;
        }
        self.check_in_place()
    }
}
