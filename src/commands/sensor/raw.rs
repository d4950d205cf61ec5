//! The raw of a job: created, resumed, or found complete; its missing shards are made.

use super::record::Start;
use super::resolve::RawJob;
use super::{record, signal, warnings_after, write};
use crate::args::ExposeArgs;
use crate::failure::{code, other_job, usage};
use crate::film::group;
use crate::progress::interrupt;
use crate::progress::{detail_line, log_line, resume_note};
use anyhow::Result;
use formats::durable::{fault_point, link_target, parent_of, sweep_entries};
use formats::group::{Found, GroupError};
use formats::raw::RawStore;
use std::path::Path;

/// Exposes the film of `job` into the raw `raw`.
pub fn expose(args: &ExposeArgs, job: &RawJob, raw: &Path) -> Result<u8> {
    let start = Start::now();
    interrupt::listen();
    if !args.overwrite
        && let Some(store) = resumed(args, job, raw)?
    {
        return work(args, job, &store, None, start);
    }
    job.log_warnings();
    // Without exposures there is nothing to create yet: the signal comes first.
    let measured = match job.needs_signal_first() {
        true => match signal::measure(job, parent_of(&link_target(raw)))? {
            Some(measured) => Some(measured),
            None => return Ok(interrupted("nothing was written; the same command starts again")),
        },
        false => None,
    };
    let times = job.exposure_times(measured.as_ref())?;
    let spec = job.spec(&times);
    if !spec.holds() {
        return Err(usage(format!(
            "{} frames of {} arrays: expected at most 10000 frames, 4096 arrays and 4194304 shards",
            spec.exposure_s.len(),
            spec.outputs.len()
        )));
    }
    // Only now, when all that can fail before the first pixel has passed.
    if args.overwrite {
        remove(raw, args.take_over)?;
        fault_point("raw-removed");
    }
    let store = match RawStore::create(raw, spec, job.attributes(&times), !args.no_fsync) {
        Err(GroupError::Exists { .. }) => resumed(args, job, raw)?.ok_or_else(|| group::contended(raw))?,
        created => created?,
    };
    work(args, job, &store, measured, start)
}

/// The raw at `path`, if it is this job's own; `None` if nothing is there.
fn resumed(args: &ExposeArgs, job: &RawJob, path: &Path) -> Result<Option<RawStore>> {
    let store = match RawStore::open(path, !args.no_fsync) {
        Ok(store) => store,
        Err(GroupError::NotOfKind { found: Found::Nothing, .. }) => return Ok(None),
        Err(e @ GroupError::NotOfKind { .. }) => return Err(other_job(e.to_string())),
        Err(e) => return Err(e.into()),
    };
    sweep_entries(parent_of(&link_target(path)))?;
    group::check_job(("raw", path), store.attributes(), &job.identity, args.overwrite)?;
    Ok(Some(store))
}

/// Writes the shards that are missing.
fn work(
    args: &ExposeArgs,
    job: &RawJob,
    store: &RawStore,
    measured: Option<signal::Measured>,
    start: Start,
) -> Result<u8> {
    let all = store.spec().all_shards();
    if store.missing(&all)?.is_empty() {
        group::report_complete(store.group(), args.take_over, all.len());
        return Ok(0);
    }
    let _lock = group::lock_and_sweep(store.group(), args.take_over, args.no_fsync)?;
    let missing = store.missing(&all)?;
    group::report_resumed(store.group(), missing.len(), all.len());
    let times = job.recorded_times(store)?;
    job.log_start(store.spec(), &times);
    // Charge that flows along columns needs all rows of a signal.
    let measured = match measured {
        None if job.needs_columns() => match signal::measure(job, parent_of(&link_target(store.path())))? {
            None => return Ok(interrupted(resume_note(args.overwrite))),
            measured => measured,
        },
        measured => measured,
    };
    let outcome = write::shards(job, store, &times, &missing, measured);
    let outcome = outcome.and_then(|done| store.group().check_in_place().map(|()| done).map_err(Into::into));
    record::write(job, store, &outcome, start);
    let done = outcome?;
    warnings_after::print(job, &times, &done);
    if done.left > 0 {
        return Ok(interrupted(&format!(
            "{} of {} shards are missing; {}",
            done.left,
            missing.len(),
            resume_note(args.overwrite)
        )));
    }
    detail_line(record::details(job, &done, start));
    log_line(record::summary(&done, start));
    Ok(0)
}

fn interrupted(message: &str) -> u8 {
    log_line(format!("interrupted: {message}"));
    code::INTERRUPTED
}

/// Removes the raw, unless a run holds its lock.
pub fn remove(path: &Path, take_over: bool) -> Result<()> {
    group::remove(path, take_over, RawStore::remove)
}
