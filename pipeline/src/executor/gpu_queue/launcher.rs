//! The second thread of a GPU queue: enqueues planned batches once their charts are read.

use super::planner::Planned;
use super::{Failure, Session};
use crate::clock::thread_cpu_s;
use crate::cuda::LaunchTimes;
use crate::cuda::kernel_timer::timed;
use crate::cuda::memory::STRIP_ROWS;
use crate::cuda::pool::{Pinned, PinnedPool};
use crate::cuda::slice::CudaSlice;
use crate::executor::gpu_queue::collector::{Launched, Strips};
use crate::executor::gpu_tasks::ChartReply;
use crate::flow::FilmSink;
use crate::stages::Compute;
use crate::stages::cuda::band::QueueBuffers;
use crate::stages::cuda::film_rows::strips;
use crossbeam::channel::{Receiver, Sender};

/// The launching thread.
pub(super) struct Launcher<'s, 'a, 'b, C: Compute, S: FilmSink> {
    session: &'s Session<'a, 'b, C, S>,
    buffers: &'s mut QueueBuffers,
    /// Device memory for the charts of a batch.
    free: Receiver<CudaSlice<f32>>,
    launched: Sender<Launched<C::Band>>,
    strips: PinnedPool,
    times: LaunchTimes,
}

impl<'s, 'a, 'b, C: Compute, S: FilmSink> Launcher<'s, 'a, 'b, C, S> {
    /// Launches with `buffers` and those that are `free`, and sends the batches to `launched`.
    pub(super) fn new(
        session: &'s Session<'a, 'b, C, S>,
        buffers: &'s mut QueueBuffers,
        free: Receiver<CudaSlice<f32>>,
        launched: Sender<Launched<C::Band>>,
    ) -> Self {
        let strip = STRIP_ROWS * session.needs.film_columns;
        let strips = PinnedPool::new(session.memory.strips, strip);
        Self { session, buffers, free, launched, strips, times: LaunchTimes::default() }
    }

    /// Launches the batches of `planned`, until it ends or the session or the run has failed.
    pub(super) fn run(mut self, planned: &Receiver<Planned<C::Band>>) -> Result<(), Failure> {
        let before = thread_cpu_s();
        let mut result = Ok(true);
        while let Ok(true) = result {
            let Ok(batch) = timed(&mut self.times.plan_s, || planned.recv()) else { break };
            result = self.launch(batch);
        }
        self.times.core_s = thread_cpu_s() - before;
        self.session.figures.lock().expect("no panic while held").launch.add(&self.times);
        result.map(|_| ())
    }

    /// Launches a batch; `false`: stopped.
    fn launch(&mut self, batch: Planned<C::Band>) -> Result<bool, Failure> {
        let Planned { portion, plan, replies, charts: returns } = batch;
        let (session, run, count) = (self.session, self.session.run, plan.tiles.len());
        let mut read: Vec<ChartReply> =
            timed(&mut self.times.chart_s, || replies.iter().take(count).collect());
        if read.len() < count {
            return Ok(false);
        }
        read.sort_by_key(|reply| reply.0);
        let position = portion.batch.band.position;
        let mut parts = Vec::new();
        for (tile, (_, part, outcome)) in plan.added.range.tiles().zip(read) {
            // The values of such a tile only reach shards that are discarded.
            if let Err(source) = outcome {
                let shards = portion.discard(tile, &run.work.bands[position], run.work.regions, run);
                run.unreadable(position, tile, shards, source);
            }
            parts.push(part);
        }
        let charts = Pinned::join(parts);
        let free = timed(&mut self.times.batch_s, || self.free.recv());
        let Ok(mut buffer) = free else { return Ok(false) };
        if session.stopped() {
            return Ok(false);
        }
        let mut rows = Vec::new();
        for _ in strips(&plan.added.finished) {
            let take = || self.strips.take(&session.queue.device, &|| session.stopped());
            let Some(strip) = timed(&mut self.times.strip_s, take)? else { return Ok(false) };
            rows.push(strip);
        }
        let enqueued = self.buffers.enqueue(&session.streams, &plan, &charts, &mut buffer, &mut rows);
        if enqueued.is_err() {
            // Copies may still use the buffers that are freed here.
            let _ = session.streams.synchronize(&session.queue.device, "after a failed launch");
        }
        let events = enqueued?;
        let rects = strips(&plan.added.finished).map(|rows| self.buffers.rect(&rows));
        let strips = Strips { rects: rects.collect(), values: rows, returns: self.strips.returns().clone() };
        let launched = Launched { portion, plan, charts, returns, buffer, strips, events };
        self.launched.send(launched).expect("the collector ends after this thread");
        Ok(true)
    }
}
