//! A queue of work for one GPU: batches of tiles go up, through stages 1-3, and down, several at a time.
//!
//!     claim → workers read the charts → upload │ scene, PSF │ download → add in tile order
//! Three streams, ordered by events: while one batch is computed, the next goes up and the last comes down. One thread
//! claims and launches, one waits for what has come down and hands it in. Work is bounded by the slots ([`super::memory`]).
//! When the device fails, all that has not come down goes back to the one sequence, for the devices that are left; when it is
//! short of memory, the queue starts anew with half of it, until even the least does not fit.

use super::CudaError;
use super::band::{Enqueued, OnDevice, Slot, Streams, Tile};
use super::drain::{DeviceFigures, Drain};
use super::memory::{DeviceQueue, MOST_TILES};
use super::pool::{Downloaded, Pool};
use crate::executor::devices::{Asking, Batch, Claim, Fetch, Fetched};
use crate::executor::feed::{Running, Shared};
use crate::flow::FilmSink;
use crate::geometry::Rect;
use crossbeam::channel::{Receiver, Sender, unbounded};
use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

/// What the launching thread learns of a batch that was on the device.
pub(super) enum Back {
    /// Down; its slot is free.
    Slot(Slot),
    /// The device has failed.
    Failed(CudaError),
}

/// A batch whose charts are being read.
struct Reading {
    batch: Batch,
    slot: Slot,
    rects: Vec<Rect>,
    answers: Receiver<Fetched>,
}

/// A batch whose charts are read.
struct Assembled {
    tiles: Vec<Tile>,
    /// Places in the sequence of those whose chart could not be read.
    lost: Vec<usize>,
}

/// One queue at work: the launching thread's side.
struct Queue<'a, 'b, S: FilmSink> {
    shared: &'a Shared<'b, S>,
    bands: &'a Receiver<Running>,
    own: &'a DeviceQueue,
    gone: &'a AtomicBool,
    down: Sender<Enqueued>,
    back: Receiver<Back>,
    streams: Streams,
    charts: Pool,
    lights: Pool,
    band: Option<OnDevice>,
    free: Vec<Slot>,
    reading: VecDeque<Reading>,
    /// Slots on the device.
    flying: usize,
    /// Times that its share of the device's memory was halved.
    halved: u32,
}

/// Serves one queue until there is no work left or its device fails.
pub(crate) fn serve<S: FilmSink>(
    shared: &Shared<'_, S>,
    bands: &Receiver<Running>,
    own: &DeviceQueue,
    figures: &Mutex<DeviceFigures>,
) {
    let gone = AtomicBool::new(false);
    let (down, inbox) = unbounded();
    let (outbox, back) = unbounded();
    let failed = std::thread::scope(|scope| {
        let gone = &gone;
        scope.spawn(move || Drain::new(shared, own, gone, figures).run(&inbox, &outbox));
        let streams = Streams::new(&own.device);
        let queue = streams.map(|streams| Queue {
            shared,
            bands,
            own,
            gone,
            down,
            back,
            streams,
            charts: Pool::new(),
            lights: Pool::new(),
            band: None,
            free: Vec::new(),
            reading: VecDeque::new(),
            flying: 0,
            halved: 0,
        });
        queue.and_then(Queue::run).err()
    });
    if let Some(error) = failed {
        figures.lock().expect("no panic while held").left = Some(error.to_string());
        shared.leave(&own.name(), error);
    }
}

impl<S: FilmSink> Queue<'_, '_, S> {
    fn run(mut self) -> Result<(), CudaError> {
        let ended = loop {
            match self.step() {
                Ok(true) => (),
                Ok(false) => break None,
                Err(error) => match self.make_do(error) {
                    Ok(()) => (),
                    Err(error) => break Some(error),
                },
            }
        };
        if ended.is_some() {
            self.gone.store(true, Ordering::SeqCst);
        }
        self.return_unread();
        // What is on the device the other thread waits for, or gives back.
        self.down = unbounded().0;
        let failed = self.back.iter().find_map(|back| match back {
            Back::Failed(error) => Some(error),
            Back::Slot(_) => None,
        });
        ended.or(failed).map_or(Ok(()), Err)
    }

    /// Does what can be done next; `false`: there is nothing left to do.
    fn step(&mut self) -> Result<bool, CudaError> {
        while let Ok(back) = self.back.try_recv() {
            self.home(back)?;
        }
        if self.band.is_none() || !self.free.is_empty() {
            match self.claim(self.reading.is_empty()) {
                Claim::Batch(batch) => return self.start(batch).map(|()| true),
                Claim::Over if self.reading.is_empty() => return Ok(false),
                Claim::Over | Claim::Wait => (),
            }
        }
        match self.reading.pop_front() {
            Some(reading) => self.launch(reading)?,
            None => self.wait()?,
        }
        Ok(true)
    }

    fn claim(&self, wait: bool) -> Claim {
        let most = |band: &Running| match &self.band {
            Some(present) if present.position == band.position => present.memory.tiles,
            // How many fit is known when it is begun.
            _ => MOST_TILES,
        };
        self.shared.claim(self.bands, &Asking { most: &most, gone: self.gone, wait })
    }

    /// Waits for a slot.
    fn wait(&mut self) -> Result<(), CudaError> {
        let back = self.back.recv().expect("the other thread lives as long as this one");
        self.home(back)
    }

    fn home(&mut self, back: Back) -> Result<(), CudaError> {
        match back {
            Back::Slot(slot) => {
                self.flying -= 1;
                self.free.push(slot);
                Ok(())
            }
            Back::Failed(error) => Err(error),
        }
    }

    /// Has the charts of `batch` read, after its band has been begun where it is another one.
    fn start(&mut self, mut batch: Batch) -> Result<(), CudaError> {
        if self.band.as_ref().is_none_or(|present| present.position != batch.band.position) {
            let begun = self.begin(&batch.band);
            if begun.is_err() {
                self.shared.give_back(batch);
                return begun;
            }
            let most = self.band.as_ref().map_or(1, |present| present.memory.tiles);
            batch.cut(most).into_iter().for_each(|rest| self.shared.give_back(rest));
        }
        let tiling = &self.shared.work.bands[batch.band.position].tiling;
        let scene = &batch.band.stages.scene;
        let rects: Vec<Rect> = batch.tiles().map(|(_, tile)| scene.upload_rect(tiling.rect(tile))).collect();
        let mut buffers = Vec::new();
        for _ in &rects {
            match self.charts.take(&self.own.device, true, &|| false) {
                Ok(buffer) => buffers.extend(buffer),
                Err(error) => {
                    self.shared.give_back(batch);
                    return Err(error);
                }
            }
        }
        let (back, answers) = unbounded();
        for (i, (into, &rect)) in buffers.into_iter().zip(&rects).enumerate() {
            let (band, index) = (Arc::clone(&batch.band), batch.first + i);
            self.shared.ask(Fetch { band, index, rect, into, back: back.clone() });
        }
        let slot = self.free.pop().expect("claimed with a free slot, or a band just begun");
        self.reading.push_back(Reading { batch, slot, rects, answers });
        Ok(())
    }

    /// Makes the stages of `band` on the device, once nothing of the last one is on it.
    fn begin(&mut self, band: &Running) -> Result<(), CudaError> {
        while let Some(reading) = self.reading.pop_front() {
            self.launch(reading)?;
        }
        self.clear()?;
        let (on_device, slots) = OnDevice::new(self.shared.work, band, self.own, self.halved, &self.streams)?;
        let (memory, needs) = (on_device.memory, on_device.needs);
        self.charts.allow(memory.slots * memory.tiles, needs.chart_px);
        self.lights.allow((memory.slots + 1) * memory.tiles, needs.light_px.max(needs.scene_px));
        (self.band, self.free) = (Some(on_device), slots);
        Ok(())
    }

    /// Waits for all that is on the device and gives its memory back.
    fn clear(&mut self) -> Result<(), CudaError> {
        while self.flying > 0 {
            self.wait()?;
        }
        self.free.clear();
        self.band = None;
        self.own.device.context.synchronize().map_err(self.own.device.failed("ending a band"))
    }

    /// Sends a batch on its way once its charts are read.
    fn launch(&mut self, reading: Reading) -> Result<(), CudaError> {
        let Reading { batch, mut slot, rects, answers } = reading;
        let Assembled { mut tiles, lost } = match self.assemble(&batch, &rects, &answers) {
            Ok(Some(assembled)) => assembled,
            // The run has failed, or the device has: this batch comes no further.
            ended => {
                self.free.push(slot);
                self.shared.give_back(batch);
                return ended.map(|_| ());
            }
        };
        let band = self.band.as_mut().expect("begun");
        match band.enqueue(&self.own.device, &self.streams, &mut slot, &mut tiles) {
            Ok(events) => {
                self.flying += 1;
                let home = self.charts.home().clone();
                let enqueued = Enqueued { batch, slot, tiles, lost, events, home };
                self.down.send(enqueued).expect("the other thread lives as long as this one");
                Ok(())
            }
            Err(error) => {
                // Some of it may be under way in the buffers that end here.
                let _ = self.own.device.context.synchronize();
                self.free.push(slot);
                self.shared.give_back(batch);
                Err(error)
            }
        }
    }

    /// The tiles of `batch` with their charts and buffers for their light, and the places of those whose chart could not be
    /// read; `None` if the run or the device fails meanwhile.
    fn assemble(
        &mut self,
        batch: &Batch,
        rects: &[Rect],
        answers: &Receiver<Fetched>,
    ) -> Result<Option<Assembled>, CudaError> {
        let mut read: Vec<Fetched> = answers.iter().take(rects.len()).collect();
        if read.len() < rects.len() {
            return Ok(None);
        }
        read.sort_by_key(|answer| answer.0);
        let tiling = &self.shared.work.bands[batch.band.position].tiling;
        let (mut tiles, mut lost) = (Vec::new(), Vec::new());
        for (((sequence, tile), &chart_rect), (_, chart, outcome)) in batch.tiles().zip(rects).zip(read) {
            if let Err(source) = outcome {
                self.shared.unread(&batch.band, tile, source);
                lost.push(sequence);
                let _ = self.charts.home().send(chart);
                continue;
            }
            let rect = tiling.rect(tile);
            let reach = if self.own_light() { tiling.reach(tile) } else { rect };
            let Some(light) = self.light(batch, reach)? else { return Ok(None) };
            tiles.push(Tile { sequence, rect, chart_rect, chart, light });
        }
        Ok(Some(Assembled { tiles, lost }))
    }

    /// Whether light is another thing than scene.
    fn own_light(&self) -> bool {
        self.band.as_ref().is_some_and(|band| band.needs.light_px > 0)
    }

    /// A buffer for the light on `reach`. What a device has returned may go beyond the bound: all others wait for it.
    fn light(&mut self, batch: &Batch, reach: Rect) -> Result<Option<Downloaded>, CudaError> {
        let stopped = || self.shared.failed() || self.gone.load(Ordering::SeqCst);
        let buffer = self.lights.take(&self.own.device, batch.returned, &stopped)?;
        Ok(buffer.map(|buffer| Downloaded::new(buffer, reach.size().pixels(), reach.width, &self.lights)))
    }

    /// Gives back what has not gone to the device.
    fn return_unread(&mut self) {
        for Reading { batch, slot, .. } in self.reading.drain(..) {
            self.free.push(slot);
            self.shared.give_back(batch);
        }
    }

    /// Starts anew with half the device's memory, if that was what it lacked.
    fn make_do(&mut self, error: CudaError) -> Result<(), CudaError> {
        if !error.out_of_memory() {
            return Err(error);
        }
        self.shared.progress.device_short(&self.own.name(), &error);
        self.return_unread();
        self.clear()?;
        self.halved += 1;
        Ok(())
    }
}
