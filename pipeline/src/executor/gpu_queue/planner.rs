//! The first thread of a GPU queue: claims portions and plans their batches.

use super::{Failure, Session};
use crate::cuda::pool::{Pinned, PinnedPool};
use crate::executor::gpu_tasks::{ChartRead, ChartReply};
use crate::executor::portion::Portion;
use crate::executor::tile_source::{Batch, Claim};
use crate::executor::worker::READ_AHEAD;
use crate::flow::FilmSink;
use crate::geometry::Rect;
use crate::stages::Compute;
use crate::stages::cuda::band::{BatchPlan, GpuBand};
use crate::stages::cuda::batches::{AddedTiles, batches};
use crossbeam::channel::{Receiver, Sender, unbounded};
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// A batch whose charts are being read.
pub(super) struct Planned<B> {
    pub(super) portion: Arc<Portion<B>>,
    pub(super) plan: BatchPlan,
    pub(super) replies: Receiver<ChartReply>,
    /// Returns the buffer of the charts to its pool.
    pub(super) charts: Sender<Pinned>,
}

/// The planning thread.
pub(super) struct Planner<'s, 'a, 'b, C: Compute, S: FilmSink> {
    session: &'s Session<'a, 'b, C, S>,
    planned: Sender<Planned<C::Band>>,
    charts: PinnedPool,
    band: Option<(usize, GpuBand)>,
}

impl<'s, 'a, 'b, C: Compute, S: FilmSink> Planner<'s, 'a, 'b, C, S> {
    /// Sends its batches to `planned`.
    pub(super) fn new(session: &'s Session<'a, 'b, C, S>, planned: Sender<Planned<C::Band>>) -> Self {
        let memory = &session.memory;
        let charts = PinnedPool::new(memory.batches, memory.tiles * session.needs.chart_px);
        Self { session, planned, charts, band: None }
    }

    /// Plans batches until all shards are computed, or the session or the run has failed.
    pub(super) fn run(mut self) -> Result<(), Failure> {
        let (run, memory) = (self.session.run, &self.session.memory);
        while let Some(batch) = self.claim() {
            let work = &run.work.bands[batch.band.position];
            let portion = Arc::new(Portion::new(batch, work, run.work.regions));
            self.session.portions.lock().expect("no panic while held").push(Arc::clone(&portion));
            self.begin(&portion)?;
            let (mut first, mut end) = (0, i64::MIN);
            for added in
                batches(&work.tiling, &portion.tiles, &portion.film_rows, memory.tiles, memory.tile_rows)
            {
                if run.work.cancel.load(Ordering::Relaxed) {
                    portion.end_at(end, run);
                    break;
                }
                (first, end) = (first + added.range.len(), added.finished.end);
                if !self.plan(&portion, added, first)? {
                    return Ok(());
                }
            }
        }
        Ok(())
    }

    /// The next portion; waits until there is one or none will follow.
    fn claim(&self) -> Option<Batch<C::Band>> {
        let run = self.session.run;
        loop {
            let seen = run.signal.generation();
            if self.session.stopped() {
                return None;
            }
            match run.claim_portion() {
                Claim::Batch(batch) => return Some(batch),
                Claim::Over => return None,
                Claim::None => run.signal.wait_as_queue(seen),
            }
        }
    }

    /// Constructs the stages of the band of `portion` on the device, if it is a new one.
    fn begin(&mut self, portion: &Portion<C::Band>) -> Result<(), Failure> {
        let (session, band) = (self.session, &portion.batch.band);
        if self.band.as_ref().is_none_or(|(position, _)| *position != band.position) {
            let tiling = &session.run.work.bands[band.position].tiling;
            let (device, memory) = (&session.queue.device, &session.memory);
            let on_gpu = session.run.compute.begin_on_gpu(&band.stages, tiling, device, memory)?;
            self.band = Some((band.position, on_gpu));
        }
        Ok(())
    }

    /// Queues the reads of the charts of `added` and plans it; `next`: index of the tile after it in the portion. `false`: stopped.
    fn plan(
        &mut self,
        portion: &Arc<Portion<C::Band>>,
        added: AddedTiles,
        next: usize,
    ) -> Result<bool, Failure> {
        let (session, run, band) = (self.session, self.session.run, &portion.batch.band);
        let tiling = &run.work.bands[band.position].tiling;
        let chart_rect = |tile| run.compute.chart_rect(&band.stages, tiling.rect(tile));
        let rects: Vec<Rect> = added.range.tiles().map(chart_rect).collect();
        let largest = rects.iter().map(|rect| rect.size().pixels()).max().unwrap_or(0);
        if largest > session.needs.chart_px {
            return Err(Failure::LargerChart(largest));
        }
        let Some(buffer) = self.charts.take(&session.queue.device, &|| session.stopped())? else {
            return Ok(false);
        };
        let parts = buffer.divide(rects.iter().map(|rect| rect.size().pixels()));
        let (reply, replies) = unbounded();
        let first = next - rects.len();
        for (index, (into, &rect)) in parts.into_iter().zip(&rects).enumerate() {
            let later = portion.tiles.get(first + index + READ_AHEAD * run.work.threads.max(1));
            let later = later.map(|&tile| tiling.rect(tile));
            run.reads.push(ChartRead {
                band: Arc::clone(band),
                index,
                rect,
                later,
                into,
                reply: reply.clone(),
            });
        }
        let (_, on_gpu) = self.band.as_mut().expect("begun");
        let plan = on_gpu.plan(added, &rects)?;
        let (portion, charts) = (Arc::clone(portion), self.charts.returns().clone());
        // Not received if the launcher has failed.
        Ok(self.planned.send(Planned { portion, plan, replies, charts }).is_ok())
    }
}
