//! Monitoring a run: counts what it completes, decides whether it continues after an error, and reports what was left out.

use super::display::Display;
use crate::failure::{self, Coded, code};
use crate::job::Job;
use crate::progress::log_line;
use anyhow::Result;
use formats::chart::ChartError;
use formats::film::FilmStore;
use formats::group::GroupError;
use pipeline::cuda::CudaError;
use pipeline::executor::{Progress, RunError, Summary};
use pipeline::tiling::ShardId;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// Successive failed writes after which `--keep-going` stops: the store is assumed unreachable.
const MAX_FAILED_WRITES: u64 = 3;

/// Displays progress, counts, and decides whether a run continues after an error.
pub struct Monitor<'a> {
    /// Display of progress.
    pub display: Display<'a>,
    /// Tiles added.
    pub tiles: AtomicU64,
    /// Their film pixels.
    pub pixels: AtomicU64,
    /// Shards committed.
    pub shards: AtomicU64,
    /// Bytes of these shards.
    pub bytes: AtomicU64,
    /// Start of the computation.
    pub start: Instant,
    /// Time from the start of the command to that of the computation, s.
    pub startup_s: f64,
    keep_going: bool,
    failed_writes: AtomicU64,
    /// By band and error message.
    left_out: Mutex<BTreeMap<(usize, String), LeftOut>>,
}

/// Shards of one band that were not computed because of one error.
struct LeftOut {
    /// Empty: all shards of the band.
    shards: BTreeSet<ShardId>,
    retry: bool,
}

/// A run that stopped at an error, or left shards out.
pub struct RunFailure {
    /// The error.
    pub error: anyhow::Error,
    /// What was completed, unless the run stopped.
    pub summary: Option<Summary>,
}

impl<'a> Monitor<'a> {
    /// With `keep_going`, an error leaves out only the shards that depend on it.
    pub fn new(display: Display<'a>, startup_s: f64, keep_going: bool) -> Self {
        Self {
            display,
            tiles: AtomicU64::default(),
            pixels: AtomicU64::default(),
            shards: AtomicU64::default(),
            bytes: AtomicU64::default(),
            start: Instant::now(),
            startup_s,
            keep_going,
            failed_writes: AtomicU64::default(),
            left_out: Mutex::default(),
        }
    }

    /// The result of the run, with messages for the user: which of the `missing` shards were not computed, and why. `committed`: whether
    /// the last batch of them was committed.
    pub fn outcome(
        &self,
        job: &Job,
        store: &FilmStore,
        missing: u64,
        result: Result<Summary, RunError>,
        committed: Result<(), GroupError>,
    ) -> Result<Summary, Box<RunFailure>> {
        let incomplete = format!(
            "the film {} is incomplete: once the cause is removed, the same command resumes it",
            store.path().display()
        );
        let left_out = self.left_out.lock().expect("no panic while held");
        let failed = |error: anyhow::Error, other: &str| {
            let text = format!("{}; {incomplete}{other}", failure::text(&error));
            Err(Box::new(RunFailure { error: error.context(text), summary: None }))
        };
        let summary = match (result, committed) {
            (Ok(summary), Ok(())) if left_out.is_empty() => return Ok(summary),
            (Ok(summary), Ok(())) => summary,
            (Ok(_), Err(error)) => {
                return failed(anyhow::Error::from(error).context("writing the last shards"), "");
            }
            (Err(error), _) => {
                let shards = shards_of(&error);
                let place = match error {
                    RunError::Device { .. } => None,
                    _ => Some(place(job, store, error.position(), &shards)),
                };
                let mut error = anyhow::Error::from(error);
                if let Some(place) = place {
                    error = error.context(place);
                }
                // After the cause, which this text contains and `failure::line` does not repeat.
                let is_nan =
                    error.chain().any(|e| matches!(e.downcast_ref(), Some(ChartError::NotFinite { .. })));
                let other = if is_nan {
                    "; with another --nan it begins again, with --overwrite if it has shards"
                } else {
                    ""
                };
                return failed(error, other);
            }
        };
        for ((position, reason), what) in left_out.iter() {
            log_line(format!("left out: {}: {reason}", place(job, store, *position, &what.shards)));
        }
        let retry = left_out.values().all(|l| l.retry);
        let message =
            format!("{} of {missing} shards could not be computed: {incomplete}", missing - summary.shards);
        let code = if retry { code::RETRY } else { code::FAILED };
        Err(Box::new(RunFailure { error: Coded { code, message }.into(), summary: Some(summary) }))
    }
}

/// The shards that depend on the failed operation; empty: all of the band.
fn shards_of(error: &RunError) -> BTreeSet<ShardId> {
    match error {
        RunError::Read { shards, .. } => shards.iter().copied().collect(),
        RunError::Write { id, .. } => [*id].into(),
        _ => BTreeSet::new(),
    }
}

/// `band 1 (500 nm), shard film/c/1/0/2 and 3 more`.
fn place(job: &Job, store: &FilmStore, position: usize, shards: &BTreeSet<ShardId>) -> String {
    let nm = job.plans[position].lens.wavelength_nm;
    let first = shards.first().map(|id| store.key(id.region, job.film_bands[id.position], (id.row, id.col)));
    let shards = match (first, shards.len()) {
        (None, _) => "all its shards".into(),
        (Some(first), 1) => format!("shard {first}"),
        (Some(first), n) => format!("shard {first} and {} more", n - 1),
    };
    format!("band {} ({nm} nm), {shards}", job.film_bands[position])
}

/// Whether other shards may succeed: the error is of one chunk of the chart, one value or one band, not of the complete store.
fn is_local(error: &RunError) -> bool {
    if let RunError::Device { .. } = error {
        return false;
    }
    let cause = error.cause();
    match cause.downcast_ref() {
        Some(GroupError::Storage(e)) => return !e.retryable(),
        Some(GroupError::Replaced { .. } | GroupError::Recreated { .. }) => return false,
        _ => (),
    }
    match cause.downcast_ref::<ChartError>() {
        Some(ChartError::Io(e)) => e.is_device_error() || !e.retryable(),
        _ => true,
    }
}

impl Progress for Monitor<'_> {
    fn band(&self, position: usize, pixels: u64) {
        self.display.band(position, pixels);
    }

    fn tile(&self, position: usize, pixels: usize) {
        self.tiles.fetch_add(1, Ordering::Relaxed);
        self.pixels.fetch_add(pixels as u64, Ordering::Relaxed);
        self.display.tile(position, pixels);
    }

    fn shard(&self, id: ShardId, bytes: u64) {
        self.shards.fetch_add(1, Ordering::Relaxed);
        self.bytes.fetch_add(bytes, Ordering::Relaxed);
        self.failed_writes.store(0, Ordering::Relaxed);
        self.display.shard(id, bytes);
    }

    fn gpu_removed(&self, device: &str, error: &CudaError, left: usize) {
        // Without GPUs the run ends with this error.
        if left > 0 {
            log_line(format!(
                "{device} was removed after a failure; its tiles were reassigned to the other queues ({left} left): {error}"
            ));
        }
    }

    fn gpu_short_of_memory(&self, device: &str, error: &CudaError) {
        log_line(format!("{device} continues with half of its memory: {error}"));
    }

    fn continue_after(&self, error: &RunError) -> bool {
        let storage = matches!(error.cause().downcast_ref(), Some(GroupError::Storage(_)));
        let failed_writes = || self.failed_writes.fetch_add(1, Ordering::Relaxed) + 1;
        let unreachable = storage && failed_writes() >= MAX_FAILED_WRITES;
        if !self.keep_going || unreachable || !is_local(error) {
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
