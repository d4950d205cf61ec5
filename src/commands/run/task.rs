//! The part of a job that a process computes.

use super::record;
use super::units::Units;
use crate::args::{ProgressArg, RunArgs};
use crate::job::Job;
use crate::progress::interrupt;
use crate::progress::jsonl::Jsonl;
use crate::progress::{json_path, log_line, plural, report_kept};
use anyhow::Result;
use formats::durable::{Lock, ProcessIdentity, fault_point};
use formats::film::FilmStore;
use formats::group::JobGroup;
use serde_json::json;
use std::time::Instant;

/// The part of a job that this process computes.
pub struct Task<'a> {
    pub args: &'a RunArgs,
    pub store: &'a FilmStore,
    /// `None`: the complete film.
    pub units: Option<&'a Units>,
    pub jsonl: Option<&'a Jsonl>,
    pub progress: ProgressArg,
    pub start: Instant,
}

impl Task<'_> {
    /// Name in messages.
    pub fn name(&self) -> String {
        let film = self.store.path().display();
        self.units.map_or_else(|| film.to_string(), |u| format!("units {} of {film}", u.listed()))
    }

    fn lock(&self) -> Result<Option<Lock>> {
        match self.units {
            Some(units) => units.lock(self.store),
            None => Ok(self.store.group().lock(JobGroup::WHOLE, self.args.process.take_over)?),
        }
    }

    /// All `shards` are present; `verb` fits [`Task::name`].
    pub fn already_complete(&self, shards: usize, verb: &str) -> Result<u8> {
        // Removes temporary files of a run that was killed after its last shard. Fails on a read-only film, which is complete as well.
        let _ = (self.lock(), self.store.group().sweep());
        fault_point("shards-made");
        self.store.group().check_in_place()?;
        log_line(format!("{} {verb} complete: {}, nothing to do", self.name(), plural(shards, "shard")));
        record::nothing_to_do(self.jsonl, self.store, shards);
        Ok(0)
    }

    /// Locks the film and removes temporary files of ended processes.
    pub fn lock_and_sweep(&self) -> Result<Option<Lock>> {
        let lock = self.lock()?;
        if let Some(lock) = &lock {
            interrupt::release_on_exit(lock.path());
        }
        fault_point("locked");
        if self.args.no_fsync {
            log_line("--no-fsync: a power failure may lose shards that were reported as written");
        }
        let swept = self.store.group().sweep()?;
        report_kept(&swept);
        if !swept.removed.is_empty() {
            log_line(format!("removed {} temporary files of an interrupted run", swept.removed.len()));
        }
        Ok(lock)
    }

    /// Writes the `start` event.
    pub fn write_start_event(&self, job: &Job, shards: &ShardCount, tiles: &[(u64, u64)]) {
        let Some(jsonl) = self.jsonl else { return };
        let (tiles, pixels) = tiles.iter().fold((0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
        jsonl.set_totals(shards.missing as u64, tiles, pixels);
        let fields = json!({
            "film": json_path(self.store.path()),
            "device": job.device(),
            "engine": job.engine.to_string(),
            "threads": job.threads,
            "pid": std::process::id(),
            "host": ProcessIdentity::current().host,
            "shards": shards.all,
            "shards_done": shards.all - shards.missing,
            "tiles": tiles,
            "pixels": pixels,
            "startup_s": self.start.elapsed().as_secs_f64(),
        });
        jsonl.write("start", fields);
    }
}

/// Shards of a task.
pub struct ShardCount {
    pub all: usize,
    pub missing: usize,
}
