//! A queue of work for one GPU: portions (rows of shards of a band) are divided into batches of tiles, which are uploaded, remapped,
//! convolved with the PSFs and added to film rows on the device; finished rows are downloaded once.
//!
//! ```text
//! planner    claims a portion → batches: reads for the workers, descriptors and base kernels for the device
//! launcher   charts are read → upload │ compute │ download
//! collector  rows are downloaded → workers copy them to shards
//! ```
//! Three streams, ordered by events: while one batch is computed, the next is uploaded and the last one downloaded. The planner is ahead of
//! the launcher by as many batches as there are buffers for, also across bands: the device does not wait for the host between bands. A
//! portion is a band, or a part of one where fewer bands are left than GPUs; a device adds all tiles that reach its shards in the order of
//! the tiles ([`crate::stages::cuda::film_rows`]), so the film has the same bits for any number of GPUs, and tiles at the border of two portions are
//! computed by both.
//!
//! A session is the time between two failures: if the device fails, the rows of shards that are not downloaded are requeued for the
//! remaining GPUs; if memory of the device or page-locked memory does not suffice, the queue begins another session with half of it, down
//! to the minimum.

mod collector;
mod launcher;
mod planner;

use super::portion::Portion;
use super::run_state::RunState;
use crate::cuda::memory::{BandNeeds, DeviceQueue, Halvings, QueueMemory};
use crate::cuda::{CudaError, GpuFigures};
use crate::flow::FilmSink;
use crate::stages::Compute;
use crate::stages::cuda::band::{QueueBuffers, Streams};
use crate::tiling::film_columns;
use collector::Collector;
use crossbeam::channel::{bounded, unbounded};
use launcher::Launcher;
use planner::Planner;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

/// Why a session ends before the run.
enum Failure {
    Device(CudaError),
    /// The chart under a tile has so many pixels, more than planned.
    LargerChart(usize),
}

impl From<CudaError> for Failure {
    fn from(error: CudaError) -> Self {
        Self::Device(error)
    }
}

/// What the threads of a session share.
struct Session<'a, 'b, C: Compute, S: FilmSink> {
    run: &'a RunState<'b, C, S>,
    queue: &'a DeviceQueue,
    needs: BandNeeds,
    memory: QueueMemory,
    streams: Streams,
    figures: &'a Mutex<GpuFigures>,
    /// Portions that were claimed and may be incomplete.
    portions: Mutex<Vec<Arc<Portion<C::Band>>>>,
    failure: Mutex<Option<Failure>>,
    failed: AtomicBool,
}

/// Runs one queue until all shards are computed or its device fails.
pub(super) fn run_queue<C: Compute, S: FilmSink>(
    run: &RunState<'_, C, S>,
    queue: &DeviceQueue,
    figures: &Mutex<GpuFigures>,
) {
    let (mut needs, mut halvings, mut shortage) = (queue.needs, Halvings::default(), None);
    loop {
        let error = match Session::new(run, queue, needs, halvings, figures).and_then(|s| s.run()) {
            Ok(()) => return,
            Err(Failure::LargerChart(chart_px)) => {
                needs.chart_px = chart_px;
                continue;
            }
            Err(Failure::Device(error)) => error,
        };
        if !error.is_out_of_memory() {
            // If half of the memory is too little, the error of memory is the cause.
            let cause = shortage.filter(|_| matches!(error, CudaError::TooSmall { .. }));
            let error = cause.unwrap_or(error);
            figures.lock().expect("no panic while held").removed = Some(error.to_string());
            return run.remove_gpu(&queue.name(), error);
        }
        run.progress.gpu_short_of_memory(&queue.name(), &error);
        match error {
            CudaError::OutOfHostMemory { .. } => halvings.host += 1,
            _ => halvings.device += 1,
        }
        shortage = Some(error);
    }
}

impl<'a, 'b, C: Compute, S: FilmSink> Session<'a, 'b, C, S> {
    fn new(
        run: &'a RunState<'b, C, S>,
        queue: &'a DeviceQueue,
        needs: BandNeeds,
        halvings: Halvings,
        figures: &'a Mutex<GpuFigures>,
    ) -> Result<Self, Failure> {
        let memory = queue.plan(&needs, halvings)?;
        let streams = Streams::new(&queue.device)?;
        let (portions, failure, failed) = (Mutex::default(), Mutex::new(None), AtomicBool::new(false));
        Ok(Self { run, queue, needs, memory, streams, figures, portions, failure, failed })
    }

    fn run(self) -> Result<(), Failure> {
        let (device, columns) = (&self.queue.device, film_columns(self.run.work.regions));
        let (mut buffers, charts) =
            QueueBuffers::new(device, &self.streams, &self.needs, &self.memory, columns)?;
        let (planned, planned_in) = bounded(self.memory.batches);
        let (launched, launched_in) = unbounded();
        let (free, free_in) = unbounded();
        charts.into_iter().for_each(|charts| free.send(charts).expect("its receiver exists"));
        std::thread::scope(|scope| {
            let (session, buffers) = (&self, &mut buffers);
            scope.spawn(move || session.end(Planner::new(session, planned).run()));
            scope.spawn(move || {
                session.end(Launcher::new(session, buffers, free_in, launched).run(&planned_in))
            });
            Collector::new(session, free).run(&launched_in);
        });
        // Nothing uses the buffers after that; a device that failed computes no longer.
        let _ = self.streams.synchronize(device, "ending");
        let failure = self.failure.into_inner().expect("no panic while held");
        for portion in self.portions.into_inner().expect("no panic while held") {
            portion.missing().into_iter().for_each(|batch| self.run.requeue(batch));
        }
        failure.map_or(Ok(()), Err)
    }

    /// Ends the session if a thread of it failed.
    fn end(&self, result: Result<(), Failure>) {
        if let Err(failure) = result {
            self.failure.lock().expect("no panic while held").get_or_insert(failure);
            self.failed.store(true, Ordering::SeqCst);
            self.run.signal.notify_all();
        }
    }

    /// Whether the session or the run has failed.
    fn stopped(&self) -> bool {
        self.failed.load(Ordering::SeqCst) || self.run.failed()
    }
}
