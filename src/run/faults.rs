//! Following a run: what it has done so far, and what went wrong, in the user's words.

use super::shown::Shown;
use crate::failure::{self, Coded, code};
use crate::job::Job;
use crate::progress::say;
use anyhow::Result;
use formats::chart::ChartError;
use formats::film::{FilmError, FilmStore};
use pipeline::cuda::CudaError;
use pipeline::executor::Progress;
use pipeline::executor::{RunError, Summary};
use pipeline::plan::ShardId;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// Writes that fail one after the other before `--keep-going` believes that all will.
const HOPELESS: u64 = 3;

/// Shows progress, counts, and decides whether a run goes on after a fault.
pub struct Follow<'a> {
    /// What the user sees.
    pub shown: Shown<'a>,
    /// Tiles added.
    pub tiles: AtomicU64,
    /// Their film pixels.
    pub pixels: AtomicU64,
    /// Shards committed.
    pub shards: AtomicU64,
    /// Their bytes.
    pub bytes: AtomicU64,
    /// When it began.
    pub start: Instant,
    /// Seconds that opening had taken by then.
    pub startup_s: f64,
    keep_going: bool,
    failed_writes: AtomicU64,
    left_out: Mutex<BTreeMap<(usize, String), LeftOut>>,
}

/// What one cause has cost one band.
struct LeftOut {
    /// Empty: all shards of the band.
    shards: BTreeSet<ShardId>,
    retry: bool,
}

/// A run that did not come to its end, or left something out.
pub struct Failed {
    /// For the user.
    pub error: anyhow::Error,
    /// What it did nevertheless.
    pub summary: Option<Summary>,
}

impl<'a> Follow<'a> {
    /// With `keep_going`, a fault costs only the shards that depend on it.
    pub fn new(shown: Shown<'a>, startup_s: f64, keep_going: bool) -> Self {
        let zero = || AtomicU64::new(0);
        let (tiles, pixels, shards, bytes) = (zero(), zero(), zero(), zero());
        let left_out = Mutex::default();
        let start = Instant::now();
        Self {
            shown,
            tiles,
            pixels,
            shards,
            bytes,
            start,
            startup_s,
            keep_going,
            failed_writes: zero(),
            left_out,
        }
    }

    /// The run's result in the user's words: the shards that it was to make and has not, and why.
    pub fn outcome(
        &self,
        job: &Job,
        store: &FilmStore,
        missing: u64,
        result: Result<Summary, RunError>,
    ) -> Result<Summary, Box<Failed>> {
        let incomplete = format!(
            "the film {} is incomplete; once the cause is gone, the same command resumes",
            store.path().display()
        );
        let left_out = self.left_out.lock().expect("no panic while held");
        let summary = match result {
            Ok(summary) if left_out.is_empty() => return Ok(summary),
            Ok(summary) => summary,
            Err(error) => {
                let shards = shards_of(&error);
                let place = match error {
                    RunError::Device { .. } => None,
                    _ => Some(place(job, store, error.position(), &shards)),
                };
                let mut error = anyhow::Error::from(error);
                if let Some(place) = place {
                    error = error.context(place);
                }
                let error = error.context(incomplete);
                return Err(Box::new(Failed { error, summary: None }));
            }
        };
        for ((band, reason), what) in left_out.iter() {
            say(format!("left out: {}: {reason}", place(job, store, *band, &what.shards)));
        }
        let retry = left_out.values().all(|l| l.retry);
        let message =
            format!("{} of {missing} shards could not be made: {incomplete}", missing - summary.shards);
        let code = if retry { code::RETRY } else { code::FAILED };
        Err(Box::new(Failed { error: Coded { code, message }.into(), summary: Some(summary) }))
    }
}

/// The shards that depend on what failed; empty: all of the band.
fn shards_of(error: &RunError) -> BTreeSet<ShardId> {
    match error {
        RunError::Read { shards, .. } => shards.iter().copied().collect(),
        RunError::Write { id, .. } => [*id].into(),
        _ => BTreeSet::new(),
    }
}

/// `band 1 (500 nm), shard film/c/1/0/2 and 3 more`.
fn place(job: &Job, store: &FilmStore, band: usize, shards: &BTreeSet<ShardId>) -> String {
    let nm = job.plans[band].lens.wavelength_nm;
    let first = shards.first().map(|id| store.key(id.window, job.film_bands[id.band], (id.row, id.col)));
    let shards = match (first, shards.len()) {
        (None, _) => "all its shards".into(),
        (Some(first), 1) => format!("shard {first}"),
        (Some(first), n) => format!("shard {first} and {} more", n - 1),
    };
    format!("band {} ({nm} nm), {shards}", job.film_bands[band])
}

/// Whether the rest may go well: what failed is one chunk of the chart, one value or one band, not the store as a whole.
fn is_local(error: &RunError) -> bool {
    if let RunError::Device { .. } = error {
        return false;
    }
    let cause = error.cause();
    match cause.downcast_ref() {
        Some(FilmError::Storage(e)) => return !e.retryable(),
        Some(FilmError::Replaced { .. } | FilmError::Renewed { .. }) => return false,
        _ => (),
    }
    match cause.downcast_ref::<ChartError>() {
        Some(ChartError::Io(e)) => e.is_device_error() || !e.retryable(),
        _ => true,
    }
}

impl Progress for Follow<'_> {
    fn band(&self, position: usize, pixels: u64) {
        self.shown.band(position, pixels);
    }

    fn tile(&self, position: usize, pixels: usize) {
        self.tiles.fetch_add(1, Ordering::Relaxed);
        self.pixels.fetch_add(pixels as u64, Ordering::Relaxed);
        self.shown.tile(position, pixels);
    }

    fn shard(&self, id: ShardId, bytes: u64) {
        self.shards.fetch_add(1, Ordering::Relaxed);
        self.bytes.fetch_add(bytes, Ordering::Relaxed);
        self.failed_writes.store(0, Ordering::Relaxed);
        self.shown.shard(id, bytes);
    }

    fn gpu_removed(&self, device: &str, error: &CudaError, left: usize) {
        // The last one ends the run, which is told then.
        if left > 0 {
            say(format!(
                "{device} takes part no longer, the other queues do its tiles ({left} left): {error}"
            ));
        }
    }

    fn gpu_short_of_memory(&self, device: &str, error: &CudaError) {
        say(format!("{device} goes on with half of the memory it had: {error}"));
    }

    fn fault(&self, error: &RunError) -> bool {
        let storage = matches!(error.cause().downcast_ref(), Some(FilmError::Storage(_)));
        let hopeless = storage && self.failed_writes.fetch_add(1, Ordering::Relaxed) + 1 >= HOPELESS;
        if !self.keep_going || hopeless || !is_local(error) {
            return false;
        }
        let mut all = self.left_out.lock().expect("no panic while held");
        let key = (error.position(), error.cause().to_string());
        let retry = failure::retryable(error.cause().as_ref());
        let left = all.entry(key).or_insert_with(|| LeftOut { shards: BTreeSet::new(), retry });
        left.shards.extend(shards_of(error));
        true
    }
}
