//! The scheduler: claims tiles, computes them, adds their contributions in order, writes finished shards. Independent of the
//! equations of the stages; of a GPU's stages it knows the buffers and streams ([`crate::stages::cuda::band`]).
//!
//! ```text
//! prepare thread   Compute::prepare(band)          → TileSource (one band ahead)
//! worker           TileSource → Compute::compute   → OrderedAdder → ShardWriter
//! GPU queue        TileSource → charts read by workers → upload │ compute │ download → film rows copied to shards by workers
//! worker           ShardWriter: encode → queue → writing threads: commit
//! ```
//! [`Compute`] constructs the stages of a band and computes its tiles ([`crate::stages`] implements it). `tile_source` assigns tiles in
//! one sequence, or rows of shards to GPUs, and requeues those of a failed GPU; `ordered_adder` adds contributions in the order of the tiles,
//! as GPUs do on the device, so that the film has the same bits for any number of threads or of devices; `shard_writer` encodes and
//! writes. They have separate locks; `signal` wakes the workers. Workers compute tiles shard by shard (`walk`), GPUs row by row. Memory is bounded: a worker claims at most
//! [`MAX_TILES_AHEAD_PER_WORKER`] tiles per worker more than the walk requires; a GPU queue is bounded by its batch buffers and
//! page-locked buffers; [`Work::max_encoded_shards`]. [`memory`] computes what the queues hold.

mod computed_tile;
mod error;
mod gpu_queue;
mod gpu_tasks;
pub mod memory;
mod ordered_adder;
mod overlap_add;
mod portion;
mod progress;
mod run_state;
mod shard_writer;
mod signal;
mod tile_source;
mod walk;
mod work;
mod worker;

pub use error::RunError;
pub use memory::MAX_TILES_AHEAD_PER_WORKER;
pub use progress::Progress;
pub use work::{BandWork, Summary, Work};

use crate::clock::{Clock, TimedChart};
use crate::cuda::GpuFigures;
use crate::cuda::memory::DeviceQueue;
use crate::flow::{ChartSource, FilmSink};
use crate::stages::Compute;
use gpu_tasks::TaskQueue;
use ordered_adder::OrderedAdder;
use run_state::RunState;
use shard_writer::ShardWriter;
use signal::Signal;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;
use tile_source::TileSource;

/// Runs `work` from `chart` to `sink`; `compute` constructs the stages of each band.
///
/// The complete way, `pipeline/examples/film_of_a_chart.rs`:
///
#[doc = concat!("```\n", include_str!("../examples/film_of_a_chart.rs"), "```")]
///
/// # Errors
/// The first [`RunError`] after which [`Progress::continue_after`] does not continue; shards committed before remain.
///
/// # Panics
/// If `compute`, `sink`, `chart` or `progress` do, once all threads have ended.
pub fn run<C: Compute, S: FilmSink>(
    work: &Work<'_>,
    chart: &dyn ChartSource,
    sink: &S,
    compute: &C,
    progress: &dyn Progress,
) -> Result<Summary, RunError> {
    let start = Instant::now();
    let (clock, signal) = (Clock::default(), Signal::default());
    let chart = TimedChart::new(chart, &clock);
    let state = RunState {
        work,
        compute,
        chart: &chart,
        progress,
        clock: &clock,
        signal: &signal,
        source: TileSource::new(&signal, work.cancel, work.gpus.len()),
        reads: TaskQueue::new(&signal),
        rows: TaskQueue::new(&signal),
        adder: OrderedAdder::new(work.film, work.regions, &work.bands, &clock),
        writer: ShardWriter::new(sink, work.max_encoded_shards, &clock, &signal),
        error: Mutex::new(None),
        failed: AtomicBool::new(false),
    };
    let figures = |queue: &DeviceQueue| Mutex::new(GpuFigures::new(&queue.device));
    let figures: Vec<_> = work.gpus.iter().map(figures).collect();
    std::thread::scope(|scope| {
        let (encoded_out, encoded_in) = ShardWriter::<S>::queue();
        let state = &state;
        scope.spawn(move || state.or_stop(|| state.prepare_bands()));
        for _ in 0..state.writer.threads() {
            let inbox = encoded_in.clone();
            scope.spawn(move || {
                // Ends the workers that wait for it, if it panics.
                let _drained = state.writer.drained_at_end(&inbox);
                state.or_stop(|| state.writer.write(&inbox, progress, &|error| state.fail(error)));
            });
        }
        for (queue, figures) in work.gpus.iter().zip(&figures) {
            scope.spawn(move || state.or_stop(|| gpu_queue::run_queue(state, queue, figures)));
        }
        for _ in 0..work.threads.max(1) {
            let encoded = encoded_out.clone();
            scope.spawn(move || state.or_stop(|| state.worker(&encoded)));
        }
    });
    let (tiles, pixels) = state.adder.added();
    let (shards, bytes_written) = state.writer.written();
    if let Some(error) = state.error.into_inner().expect("no panic while held") {
        return Err(error);
    }
    Ok(Summary {
        times: clock.wall(),
        core: clock.core(),
        wall_s: start.elapsed().as_secs_f64(),
        tiles,
        pixels,
        spectra: compute.spectra_built(),
        shards,
        bytes_written,
        gpus: figures.into_iter().map(|f| f.into_inner().expect("no panic while held")).collect(),
        interrupted: work.cancel.load(Ordering::Relaxed),
    })
}

#[cfg(test)]
mod tests;
