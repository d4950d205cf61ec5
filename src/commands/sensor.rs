//! `lenscube sensor`: film → signal → raw; the raw is created, resumed, or found complete.

mod attributes;
mod exposure;
mod figures;
mod film;
mod geometry;
mod identity;
mod memory;
mod picture;
mod record;
mod resolve;
mod settle;
mod show;
mod signal;
mod validate;
mod warnings;
mod write;

use crate::args::{ExposeArgs, SensorArgs, SensorCommand};
use crate::failure::{code, other_job, usage};
use crate::progress::interrupt;
use crate::progress::{detail_line, log_line, plural, report_kept, resume_note};
use anyhow::Result;
use formats::durable::{Store, fault_point, link_target, parent_of, sweep_entries};
use formats::group::{Found, GroupError, GroupKind, JobGroup};
use formats::raw::{RawSpec, RawStore};
use formats::sensor::{SensorError, SensorFile};
pub use picture::temporary_raw;
use resolve::Plan;
use serde_json::Value;
use std::path::Path;
use std::time::Instant;

/// Names of the files of `sensor show --plot`.
pub use show::FIGURES;

/// Names of the files of `sensor validate --out`.
pub fn validation_files() -> impl Iterator<Item = &'static str> {
    validate::FILES.into_iter().chain(show::FIGURES)
}

/// Whether `out` is a file of one frame, as opposed to a raw.
///
/// # Errors
/// Usage: a file of another kind.
pub fn is_file(out: &Path) -> Result<bool> {
    Ok(picture::format_of(out)?.is_some())
}

/// Runs the command; the exit code.
pub fn command(args: &SensorArgs) -> Result<u8> {
    match &args.command {
        Some(SensorCommand::List) => show::list().map(|()| 0),
        Some(SensorCommand::Show(args)) => show::show(args).map(|()| 0),
        Some(SensorCommand::Validate(args)) => validate::command(args),
        None => expose(&args.expose),
    }
}

/// The sensor of a name or path, with `--set` applied.
fn open_sensor(name: &str, set: &[String]) -> Result<SensorFile> {
    SensorFile::open(name, set).map_err(|e| match e {
        SensorError::Storage(_) => e.into(),
        e => usage(e.to_string()),
    })
}

/// Exposes a sensor to a film; the exit code.
pub fn expose(args: &ExposeArgs) -> Result<u8> {
    let (Some(film), Some(raw)) = (&args.film, &args.raw) else {
        return Err(usage("expected FILM and RAW; see `lenscube sensor --help`"));
    };
    match picture::format_of(raw)? {
        Some(format) => picture::command(args, (film, raw, format), expose_raw),
        None => expose_raw(args, &Plan::new(args, film)?, raw),
    }
}

/// Exposes the film of `plan` into the raw `raw`.
fn expose_raw(args: &ExposeArgs, plan: &Plan, raw: &Path) -> Result<u8> {
    let start = Instant::now();
    interrupt::listen();
    if !args.overwrite
        && let Some(store) = resumed(plan, raw, !args.no_fsync)?
    {
        return work(args, plan, &store, None, start);
    }
    plan.log_warnings();
    // Without exposures there is nothing to create yet: the signal comes first.
    let measured = match plan.needs_signal_first() {
        true => match signal::measure(plan, parent_of(&link_target(raw)))? {
            Some(measured) => Some(measured),
            None => return Ok(interrupted("nothing was written; the same command starts again")),
        },
        false => None,
    };
    let settled = plan.settle(measured.as_ref())?;
    let spec = plan.spec(&settled);
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
    let store = match RawStore::create(raw, spec, plan.attributes(&settled), !args.no_fsync) {
        Err(GroupError::Exists { .. }) => match resumed(plan, raw, !args.no_fsync)? {
            Some(store) => store,
            None => return Err(GroupError::Exists { kind: GroupKind::Raw, path: raw.into() }.into()),
        },
        created => created?,
    };
    work(args, plan, &store, measured, start)
}

/// The raw at `path`, if it is this job's own; `None` if nothing is there.
fn resumed(plan: &Plan, path: &Path, fsync: bool) -> Result<Option<RawStore>> {
    let store = match RawStore::open(path, fsync) {
        Ok(store) => store,
        Err(GroupError::NotOfKind { found: Found::Nothing, .. }) => return Ok(None),
        Err(e @ GroupError::NotOfKind { .. }) => return Err(other_job(e.to_string())),
        Err(e) => return Err(e.into()),
    };
    sweep_entries(parent_of(&link_target(path)))?;
    let theirs =
        store.attributes().get("provenance").and_then(|p| p["job"].as_object()).cloned().unwrap_or_default();
    let differ = crate::film::differences(&theirs, &plan.identity);
    if differ.is_empty() {
        return Ok(Some(store));
    }
    let differences: Vec<String> =
        differ.iter().map(|(key, there, asked)| format!("{key} (raw {there}, requested {asked})")).collect();
    Err(other_job(format!(
        "{} exists and belongs to another job: {}; choose another path, or replace it with --overwrite",
        path.display(),
        differences.join(", ")
    )))
}

/// Writes the shards that are missing.
fn work(
    args: &ExposeArgs,
    plan: &Plan,
    store: &RawStore,
    measured: Option<signal::Measured>,
    start: Instant,
) -> Result<u8> {
    let all = store.spec().all_shards();
    if store.missing(&all)?.is_empty() {
        let _ = (store.group().lock(JobGroup::WHOLE, args.take_over), store.group().sweep());
        log_line(format!(
            "{} is complete: {}, nothing to do",
            store.path().display(),
            plural(all.len(), "shard")
        ));
        return Ok(0);
    }
    let lock = store.group().lock(JobGroup::WHOLE, args.take_over)?;
    if let Some(lock) = &lock {
        interrupt::release_on_exit(lock.path());
    }
    fault_point("locked");
    if args.no_fsync {
        log_line("--no-fsync: a power failure may lose shards that were reported as written");
    }
    let swept = store.group().sweep()?;
    report_kept(&swept);
    let missing = store.missing(&all)?;
    if missing.len() < all.len() {
        log_line(format!(
            "resuming {}: {} of {} shards to make",
            store.path().display(),
            missing.len(),
            all.len()
        ));
    }
    let settled = plan.settled_of(store)?;
    plan.log_start(store.spec(), &settled);
    let outcome = write::shards(plan, store, &settled, &missing, measured);
    let outcome = outcome.and_then(|done| store.group().check_in_place().map(|()| done).map_err(Into::into));
    record::write(plan, store, &outcome, start);
    let done = outcome?;
    warnings::after(plan, &settled, &done);
    if done.left > 0 {
        return Ok(interrupted(&format!(
            "{} of {} shards are missing; {}",
            done.left,
            missing.len(),
            resume_note(args.overwrite)
        )));
    }
    detail_line(record::details(plan, &done));
    log_line(record::summary(&done, start));
    Ok(0)
}

fn interrupted(message: &str) -> u8 {
    log_line(format!("interrupted: {message}"));
    code::INTERRUPTED
}

/// Removes the raw, unless a run holds its lock.
pub fn remove(path: &Path, take_over: bool) -> Result<()> {
    let _held = match JobGroup::locks(path)?.is_empty() {
        true => None,
        false => Store::at(path)?.lock("runs", JobGroup::WHOLE, take_over)?,
    };
    Ok(RawStore::remove(path)?)
}

/// Shards of a raw as they are laid out by this program.
fn layout() -> Value {
    serde_json::json!({ "shard": RawSpec::LAYOUT.0, "chunk": RawSpec::LAYOUT.1, "codec": "zstd" })
}
