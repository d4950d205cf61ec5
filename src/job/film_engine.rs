//! The engine of a film: recorded in its attributes (`provenance.engine`) and in its plan, and used by every run that resumes it.
//!
//! Another engine is rejected (exit code 3) unless `--mixed-engines`; it is then recorded in the film
//! ([`FilmStore::mark_engine`]) before its first shard, so that an interruption cannot leave it unrecorded.

use crate::args::engine::Engine;
use crate::args::{Device, RunArgs};
use crate::failure::{other_job, usage};
use crate::machine::device::{DeviceSelection, check_agreement};
use crate::progress::log_line;
use anyhow::Result;
use formats::film::FilmStore;
use formats::group::GroupError;
use std::path::Path;

/// The film at `path`; `None` without a film, without a path (of arrays in memory), or if `--overwrite` removes it.
///
/// # Errors
/// The store cannot be read.
pub fn existing(path: &Path, overwrite: bool) -> Result<Option<FilmStore>> {
    if overwrite || path.as_os_str().is_empty() {
        return Ok(None);
    }
    match FilmStore::open(path, true) {
        Ok(store) => Ok(Some(store)),
        // These errors are reported where the film is opened.
        Err(
            GroupError::NotOfKind { .. }
            | GroupError::Damaged { .. }
            | GroupError::ArrayMetadata { .. }
            | GroupError::Spec { .. },
        ) => Ok(None),
        Err(e) => Err(e.into()),
    }
}

/// The engine recorded in a film.
pub fn recorded(film: &FilmStore) -> Option<Engine> {
    film.engine().and_then(|name| name.parse().ok())
}

/// The device of a job; `on_cpu`: what GPUs do not compute of it.
///
/// # Errors
/// Usage: what GPUs do not compute with `--device cuda` or a GPU's `--engine`.
pub fn device<'a>(args: &'a RunArgs, on_cpu: Option<&str>) -> Result<&'a Device> {
    let Some(what) = on_cpu else { return Ok(&args.device) };
    match (&args.device, args.engine.explicit()) {
        (Device::Cuda(_), _) => {
            Err(usage(format!("{what} is computed on the CPU, not with --device {}", args.device)))
        }
        (_, Some(engine @ Engine::Cuda(_))) => {
            Err(usage(format!("{what} is computed on the CPU, not with --engine {engine}")))
        }
        _ => Ok(&Device::Cpu),
    }
}

/// The engine of a plan's workers: `--engine`, else that of the film, else the default on this machine, which is of the CPU where GPUs do
/// not compute `on_cpu`.
///
/// # Errors
/// `--device cuda` without `--engine` where there is no GPU; as [`device`].
pub fn planned(args: &RunArgs, on_cpu: Option<&str>) -> Result<Engine> {
    let device = device(args, on_cpu)?;
    let film = existing(&args.film, args.process.overwrite)?;
    let film = film.as_ref().and_then(recorded).filter(|engine| device.allows(*engine));
    match args.engine.explicit().or(film) {
        Some(engine) => {
            check_agreement(engine, device)?;
            Ok(engine)
        }
        None => DeviceSelection::new(device, None, None).map(|selected| selected.engine).map_err(|e| {
            usage(format!("{e}; to plan for other machines name their engine, e.g. `--engine cuda-sm_90`"))
        }),
    }
}

/// Fails if `--engine` names another engine than the film's, even if all shards are present.
pub fn check_explicit(store: &FilmStore, args: &RunArgs) -> Result<()> {
    match args.engine.explicit() {
        Some(engine) => check(store, engine, args.mixed_engines).map(|_| ()),
        None => Ok(()),
    }
}

/// Fails unless `engine` may compute shards of the film; records it in the film if it is an additional engine.
///
/// # Errors
/// Another engine's film without `--mixed-engines` (exit code 3); the store.
pub fn check_and_record(store: &FilmStore, engine: Engine, args: &RunArgs) -> Result<()> {
    if !check(store, engine, args.mixed_engines)? {
        store.mark_engine(&engine.to_string())?;
        log_line(format!(
            "note: {} was created with engine {}; this run computes with {engine} (--mixed-engines)",
            store.path().display(),
            store.engine().unwrap_or("unknown")
        ));
    }
    Ok(())
}

/// Whether `engine` is the film's own; `mixed` permits another one.
///
/// # Errors
/// Another engine without `mixed` (exit code 3).
pub fn check(store: &FilmStore, engine: Engine, mixed: bool) -> Result<bool> {
    let recorded = store.engine();
    if recorded == Some(engine.to_string().as_str()) {
        return Ok(true);
    }
    if mixed {
        return Ok(false);
    }
    let (state, remedy) = match recorded {
        Some(name) => (format!("was created with engine {name}"), format!("use --engine {name}, ")),
        None => ("does not record the engine that it was created with".into(), String::new()),
    };
    Err(other_job(format!(
        "{} {state}, and this run would continue with {engine}, whose values differ by up to 2e-6 of the peak; {remedy}\
         continue with --mixed-engines, or start again with --overwrite",
        store.path().display()
    )))
}
