//! Whether a film is all there and sound: metadata that agree with each other, every shard present, whole and of numbers.

use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use pipeline::geometry::Rect;
use serde_json::Value;

use super::{FilmError, FilmStore, json};
use crate::durable::{DurableError, Store, fault_point, temp_name};
use crate::shard::Flaw;

/// Something that is not as it must be.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Finding {
    /// A shard that is not there.
    Missing {
        /// Its path in the film.
        key: String,
    },
    /// A shard that the system does not let be read: it may be sound.
    Unreadable {
        /// Its path in the film.
        key: String,
        /// In the system's words.
        reason: String,
    },
    /// A shard that does not decode, or holds what is no number.
    Bad {
        /// Its path in the film.
        key: String,
        /// What is wrong with it.
        reason: String,
    },
    /// Metadata or coordinates that do not fit the film's attributes.
    Metadata {
        /// The file.
        key: String,
        /// What is wrong with it.
        reason: String,
    },
}

/// What a check of a film has found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Verdict {
    /// Shards that the film must have.
    pub shards: usize,
    /// Bytes of shards read.
    pub bytes: u64,
    /// What is wrong, in the film's order.
    pub findings: Vec<Finding>,
    /// Temp files, and whether their maker is dead (`None`: who knows). They spoil nothing.
    pub temp: Vec<(PathBuf, Option<bool>)>,
}

impl FilmStore {
    /// Checks all of the film on `threads` threads, each of which holds one shard; `progress` is told shards done and in all.
    ///
    /// # Errors
    /// [`FilmError::Storage`] if the store does not answer; what is wrong with the film is no error but a finding.
    pub fn verify(&self, threads: usize, progress: &(dyn Fn(u64, u64) + Sync)) -> Result<Verdict, FilmError> {
        let all: Vec<_> = self.every_shard().collect();
        let (next, done, found) = (AtomicUsize::new(0), AtomicUsize::new(0), Mutex::new(Vec::new()));
        let work = || -> Result<u64, FilmError> {
            let mut bytes = 0;
            loop {
                let n = next.fetch_add(1, Ordering::Relaxed);
                let Some(&(output, band, shard)) = all.get(n) else { return Ok(bytes) };
                let (read, finding) = self
                    .check_shard(output, band, shard)
                    .inspect_err(|_| next.store(all.len(), Ordering::Relaxed))?;
                bytes += read;
                found.lock().expect("no panic while held").extend(finding.map(|f| (n, f)));
                progress(done.fetch_add(1, Ordering::Relaxed) as u64 + 1, all.len() as u64);
            }
        };
        let bytes: u64 = std::thread::scope(|s| {
            let workers: Vec<_> = (0..threads.max(1)).map(|_| s.spawn(work)).collect();
            workers.into_iter().map(|w| w.join().expect("workers return their errors")).sum::<Result<_, _>>()
        })?;
        let mut found = found.into_inner().expect("no panic while held");
        found.sort_by_key(|f| f.0);
        let mut findings = self.check_metadata()?;
        findings.extend(found.into_iter().map(|f| f.1));
        let (levels, wrong) = self.check_pyramid()?;
        findings.extend(wrong);
        let bytes = bytes + levels;
        self.check_in_place()?;
        Ok(Verdict { shards: all.len(), bytes, findings, temp: self.store.temp_files()? })
    }

    /// Removes the shard (of the film or its pyramid) that a check found to be bad, and returns whether it did: by now another
    /// process may have replaced it by a sound one. No lock prevents that, so a file is renamed, checked again under its new
    /// name, which no writer knows, and removed only then; a sound one gets its name back. An object cannot be renamed: it is
    /// checked again and removed, and one that is put in between is lost and made again by the next run.
    ///
    /// # Errors
    /// [`FilmError::Storage`] if it cannot be read or removed; as [`FilmStore::check_in_place`].
    pub fn remove_bad(&self, key: &str) -> Result<bool, FilmError> {
        let Some((shape, rect)) = self.shard_named(key) else { return Ok(false) };
        self.check_in_place()?;
        let Store::Directory(directory) = &self.store else {
            let (_, finding) = self.check_file(key.to_owned(), shape, rect)?;
            let bad = matches!(finding, Some(Finding::Bad { .. }));
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
        let (_, finding) = self.check_file(aside.clone(), shape, rect)?;
        let bad = matches!(finding, Some(Finding::Bad { .. }));
        if !bad && directory.size_of(key)?.is_none() {
            directory.rename(&aside, key)?;
        } else {
            // Either bad, or one of the same bytes is there already.
            directory.remove(&aside)?;
        }
        Ok(bad)
    }

    /// Shape and pixels of the shard `key`, of the film or of its pyramid.
    fn shard_named(&self, key: &str) -> Option<((usize, usize), Rect)> {
        let of_film = self.every_shard().find(|&(o, b, s)| self.key(o, b, s) == key);
        let of_film = of_film.map(|(o, _, s)| (self.spec.shard_shape(o), self.shard_rect(o, s)));
        of_film.or_else(|| self.level_shard_named(key))
    }

    /// Reads and decodes one shard: its bytes, and what is wrong with it.
    pub(super) fn check_shard(
        &self,
        output: usize,
        band: usize,
        shard: (usize, usize),
    ) -> Result<(u64, Option<Finding>), FilmError> {
        let key = self.key(output, band, shard);
        self.check_file(key, self.spec.shard_shape(output), self.shard_rect(output, shard))
    }

    /// The same of the file `key`, which holds the pixels of `rect` in a shard of (`sh`, `sw`).
    pub(super) fn check_file(
        &self,
        key: String,
        (sh, sw): (usize, usize),
        rect: Rect,
    ) -> Result<(u64, Option<Finding>), FilmError> {
        // What the encoder may lengthen, and more; a file beyond that is none of ours and is not read.
        let limit = (sh * sw * self.spec.sample.bytes()) as u64 * 2 + (1 << 20);
        let bytes = match self.store.read_at_most(&key, limit) {
            Ok(Some(bytes)) => bytes,
            Ok(None) => {
                self.check_in_place()?;
                return Ok((0, Some(Finding::Missing { key })));
            }
            Err(e @ DurableError::Length { .. }) => {
                return Ok((0, Some(Finding::Bad { key, reason: e.to_string() })));
            }
            Err(e) if e.is_device_error() || !e.retryable() => {
                return Ok((0, Some(Finding::Unreadable { key, reason: e.to_string() })));
            }
            Err(e) => return Err(e.into()),
        };
        let grid = (sh / self.spec.chunk, sw / self.spec.chunk);
        let flaw = self.encoder.check(&bytes, (rect.height, rect.width), grid).err();
        let finding = flaw.map(|flaw| {
            let reason = match flaw {
                Flaw::Damaged(reason) => reason,
                Flaw::NotFinite { row, column, value } => {
                    format!(
                        "{value} at row {}, column {} of the film",
                        rect.y + row as i64,
                        rect.x + column as i64
                    )
                }
            };
            Finding::Bad { key, reason }
        });
        Ok((bytes.len() as u64, finding))
    }

    /// Coordinates and consolidated metadata against the attributes; the arrays' own were checked on opening.
    fn check_metadata(&self) -> Result<Vec<Finding>, FilmError> {
        let mut findings = Vec::new();
        let mut wrong = |key: &str, reason: &str| {
            findings.push(Finding::Metadata { key: key.into(), reason: reason.into() });
        };
        let group = json(&self.store, "zarr.json")?.unwrap_or_default();
        let copies = &group["consolidated_metadata"]["metadata"];
        let mut check = |name: &str, expected: &Value| -> Result<(), FilmError> {
            let key = format!("{name}/zarr.json");
            if json(&self.store, &key)?.as_ref() != Some(expected) {
                wrong(&key, "not the metadata of this film's layout");
            }
            if copies.get(name) != Some(expected) {
                wrong("zarr.json", &format!("its copy of {key} is missing or another"));
            }
            Ok(())
        };
        for output in &self.spec.outputs {
            check(&output.name, &self.spec.array(output))?;
        }
        let coordinates = self.spec.coordinates();
        for (name, (metadata, _)) in &coordinates {
            check(name, metadata)?;
        }
        for (name, (_, bytes)) in &coordinates {
            let key = format!("{name}/c/0");
            if self.store.read_at_most(&key, bytes.len() as u64).ok().flatten().as_ref() != Some(bytes) {
                wrong(&key, "not the coordinate of this film");
            }
        }
        Ok(findings)
    }
}
