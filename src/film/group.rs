//! What the commands that write a raw or a scene shard by shard have in common: whose group it is, its removal, its lock, the record of a run.

use super::differences;
use crate::failure::{self, Coded, code, other_job};
use crate::machine::peak_resident;
use crate::progress::{interrupt, log_line, plural, report_kept};
use anyhow::Result;
use formats::durable::{Lock, ProcessIdentity, Store, fault_point};
use formats::group::{GroupError, JobGroup};
use serde_json::{Map, Value, json};
use std::path::Path;
use std::time::{Instant, SystemTime};

/// What to do about an output of another job that a command with `--overwrite` finds although it removed what was there.
pub const MADE_MEANWHILE: &str = "another process has made it since --overwrite removed what was there; choose another path for one of the two";

/// Fails (exit code 3) unless the group `kind` at `path` with `attributes` is of the job `identity`. `overwrite`: what was there before is removed.
///
/// # Errors
/// Another job.
pub fn check_job(
    (kind, path): (&str, &Path),
    attributes: &Map<String, Value>,
    identity: &Map<String, Value>,
    overwrite: bool,
) -> Result<()> {
    let theirs = attributes.get("provenance").and_then(|p| p["job"].as_object()).cloned().unwrap_or_default();
    let differ = differences(&theirs, identity);
    if differ.is_empty() {
        return Ok(());
    }
    let differences: Vec<String> = differ
        .iter()
        .map(|(key, there, asked)| format!("{key} ({kind} {there}, requested {asked})"))
        .collect();
    let remedy = match overwrite {
        true => MADE_MEANWHILE,
        false => "choose another path, or replace it with --overwrite",
    };
    Err(other_job(format!(
        "{} exists and belongs to another job: {}; {remedy}",
        path.display(),
        differences.join(", ")
    )))
}

/// The error (exit code 75) of an output at `path` that was there when it was to be made, and was gone when it was to be opened.
pub fn contended(path: &Path) -> anyhow::Error {
    let message = format!(
        "{}: another process removes and makes it at the same time; run the same command again",
        path.display()
    );
    Coded { code: code::RETRY, message }.into()
}

/// Removes the group at `path` by `remove`, unless a run holds its lock.
///
/// # Errors
/// A run holds it; those of `remove`.
pub fn remove(
    path: &Path,
    take_over: bool,
    remove: impl FnOnce(&Path) -> Result<(), GroupError>,
) -> Result<()> {
    let _held = match JobGroup::locks(path)?.is_empty() {
        true => None,
        false => Store::at(path)?.lock("runs", JobGroup::WHOLE, take_over)?,
    };
    Ok(remove(path)?)
}

/// Of a group whose `shards` are all there: removes temporary files of a run that was killed after its last shard, and says so.
pub fn report_complete(group: &JobGroup, take_over: bool, shards: usize) {
    let _ = (group.lock(JobGroup::WHOLE, take_over), group.sweep());
    log_line(format!("{} is complete: {}, nothing to do", group.path().display(), plural(shards, "shard")));
}

/// Locks the group and removes temporary files of ended processes.
///
/// # Errors
/// Another run holds the lock; the files cannot be listed or removed.
pub fn lock_and_sweep(group: &JobGroup, take_over: bool, no_fsync: bool) -> Result<Option<Lock>> {
    let lock = group.lock(JobGroup::WHOLE, take_over)?;
    if let Some(lock) = &lock {
        interrupt::release_on_exit(lock.path());
    }
    fault_point("locked");
    if no_fsync {
        log_line("--no-fsync: a power failure may lose shards that were reported as written");
    }
    report_kept(&group.sweep()?);
    Ok(lock)
}

/// Says how many of `all` shards are missing, if some are there.
pub fn report_resumed(group: &JobGroup, missing: usize, all: usize) {
    if missing < all {
        log_line(format!("resuming {}: {missing} of {all} shards to make", group.path().display()));
    }
}

/// Keeps in the group what a run did, however it ended: `outcome` is the number of shards that it left. `further` figures follow those of every run.
pub fn write_record(
    group: &JobGroup,
    outcome: Result<usize, &anyhow::Error>,
    (threads, memory_limit_bytes): (usize, u64),
    start: Instant,
    further: Map<String, Value>,
) {
    let seconds = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).map_or(0, |d| d.as_secs());
    let host = &ProcessIdentity::current().host;
    let mut record = formats::object! {
        "finished_unix_s": seconds,
        "program": concat!("lenscube ", env!("CARGO_PKG_VERSION")),
        "outcome": match outcome { Err(_) => "failed", Ok(0) => "complete", Ok(_) => "interrupted" },
        "error": outcome.err().map(failure::line),
        "host": host,
        "threads": threads,
        "memory_limit_bytes": memory_limit_bytes,
        "peak_resident_bytes": peak_resident(),
        "wall_s": start.elapsed().as_secs_f64(),
    };
    record.extend(further);
    let name = format!("runs/{seconds}-{host}-{}.json", std::process::id());
    if let Err(e) = group.write_record(&name, json!(record).to_string().as_bytes()) {
        log_line(format!("note: the run's record {name} could not be written: {e}"));
    }
}
