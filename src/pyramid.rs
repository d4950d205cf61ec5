//! `lenscube pyramid`: adds levels of decreasing resolution to a film or a raw, for viewers.

use crate::args::PyramidArgs;
use crate::failure::{Coded, code};
use crate::interrupt;
use crate::job;
use crate::memory::{default_limit, mib};
use crate::progress::{counting, log_line, report_kept};
use crate::run::film::FILM_LOCK;
use crate::sensor::check::open as open_raw;
use crate::status;
use anyhow::Result;
use formats::durable::{Lock, Sweep};
use formats::film::{FilmError, FilmStore, PyramidState, level_sizes};
use formats::raw::{RawError, RawStore};
use pipeline::geometry::Size;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

type Progress<'a> = &'a (dyn Fn(u64, u64) + Sync);

/// A store that can have a pyramid: a film or a raw.
pub trait Levels {
    /// Its path or URL.
    fn path(&self) -> &Path;
    /// Name and size of every array.
    fn arrays(&self) -> Vec<(String, Size)>;
    /// Shards of all levels except the first.
    fn shards(&self) -> usize;
    /// State of its pyramid.
    fn state(&self) -> Result<PyramidState>;
    /// Fails unless it is still at its path.
    fn check(&self) -> Result<()>;
    /// Locks it; removes what dead processes left.
    fn prepare(&self, take_over: bool) -> Result<(Option<Lock>, Sweep)>;
    /// Makes what is missing; whether all is made.
    fn make(
        &self,
        threads: usize,
        memory: usize,
        cancel: &AtomicBool,
        progress: Progress<'_>,
    ) -> Result<bool>;
}

impl Levels for FilmStore {
    fn path(&self) -> &Path {
        self.path()
    }
    fn arrays(&self) -> Vec<(String, Size)> {
        self.spec().outputs.iter().map(|o| (o.name.clone(), o.rect.size())).collect()
    }
    fn shards(&self) -> usize {
        self.pyramid_shards()
    }
    fn state(&self) -> Result<PyramidState> {
        Ok(self.pyramid()?)
    }
    fn check(&self) -> Result<()> {
        Ok(self.check_in_place()?)
    }
    fn prepare(&self, take_over: bool) -> Result<(Option<Lock>, Sweep)> {
        Ok((self.lock(FILM_LOCK, take_over)?, self.sweep()?))
    }
    fn make(
        &self,
        threads: usize,
        memory: usize,
        cancel: &AtomicBool,
        progress: Progress<'_>,
    ) -> Result<bool> {
        self.make_pyramid(threads, memory, cancel, progress).map_err(|e| match e {
            FilmError::Incomplete { .. } => Coded { code: code::WRONG, message: e.to_string() }.into(),
            e => e.into(),
        })
    }
}

impl Levels for RawStore {
    fn path(&self) -> &Path {
        self.path()
    }
    fn arrays(&self) -> Vec<(String, Size)> {
        self.spec().outputs.iter().map(|o| (o.name.clone(), o.rect.size())).collect()
    }
    fn shards(&self) -> usize {
        self.pyramid_shards()
    }
    fn state(&self) -> Result<PyramidState> {
        Ok(self.pyramid()?)
    }
    fn check(&self) -> Result<()> {
        Ok(self.check_in_place()?)
    }
    fn prepare(&self, take_over: bool) -> Result<(Option<Lock>, Sweep)> {
        Ok((self.lock(take_over)?, self.sweep()?))
    }
    fn make(
        &self,
        threads: usize,
        memory: usize,
        cancel: &AtomicBool,
        progress: Progress<'_>,
    ) -> Result<bool> {
        self.make_pyramid(threads, memory, cancel, progress).map_err(|e| match e {
            RawError::Incomplete { .. } => Coded { code: code::WRONG, message: e.to_string() }.into(),
            e => e.into(),
        })
    }
}

/// Runs the command; the exit code.
pub fn command(args: &PyramidArgs) -> Result<u8> {
    interrupt::listen();
    match open_raw(&args.film)? {
        Some(raw) => make(&raw, args.threads, args.memory, args.take_over),
        None => make(&status::open(&args.film)?, args.threads, args.memory, args.take_over),
    }
}

/// Makes the pyramid of a film or raw, or completes it; the exit code.
pub fn make(store: &impl Levels, threads: Option<usize>, memory: Option<u64>, take_over: bool) -> Result<u8> {
    let shards = store.shards();
    let state = store.state()?;
    if state == PyramidState::Complete {
        store.check()?;
        log_line(format!(
            "the pyramid of {} is complete: {shards} shards, nothing to do",
            store.path().display()
        ));
        return Ok(0);
    }
    let (lock, sweep) = store.prepare(take_over)?;
    if let Some(lock) = &lock {
        interrupt::release_on_exit(lock.path());
    }
    report_kept(&sweep);
    match state {
        PyramidState::Unfinished(done, _) => {
            log_line(format!("resuming: {} of {shards} shards to compute", shards - done))
        }
        PyramidState::Stale => log_line("the pyramid is of an earlier version of these pixels: replacing it"),
        _ => (),
    }
    let start = Instant::now();
    let limit = memory.unwrap_or_else(default_limit);
    let (bar, progress) = counting("pyramid");
    let limit_bytes = usize::try_from(limit).unwrap_or(usize::MAX);
    let made = store.make(job::threads(threads), limit_bytes, interrupt::cancel_flag(), &progress);
    bar.finish_and_clear();
    if !made? {
        log_line("interrupted; the same command resumes");
        return Ok(code::INTERRUPTED);
    }
    print_summary(store, start, limit);
    Ok(0)
}

fn print_summary(store: &impl Levels, start: Instant, limit: u64) {
    let levels = |(name, size): (String, Size)| {
        let levels = level_sizes(size);
        let last = levels[levels.len() - 1];
        format!("{name} in {} levels down to {last} px", levels.len())
    };
    let levels: Vec<String> = store.arrays().into_iter().map(levels).collect();
    log_line(format!(
        "{}: {}; {} shards in {:.1} s (memory at most {})",
        store.path().display(),
        levels.join(", "),
        store.shards(),
        start.elapsed().as_secs_f64(),
        mib(limit as usize)
    ));
}
