//! The way back of a queue: waits for each batch's last event, hands its tiles in, counts what the device did.

use super::CudaError;
use super::band::{Enqueued, Events, Tile};
use super::handle::CudaEvent;
use super::memory::DeviceQueue;
use super::queue::Back;
use crate::executor::devices::Batch;
use crate::executor::feed::Shared;
use crate::executor::turn::Thrown;
use crate::flow::FilmSink;
use crossbeam::channel::{Receiver, Sender};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

/// What a device did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DeviceFigures {
    /// Its index.
    pub index: usize,
    /// Its name.
    pub name: String,
    /// Tiles done.
    pub tiles: u64,
    /// Batches done.
    pub batches: u64,
    /// Scene pixels of those tiles.
    pub pixels: u64,
    /// The upload stream was busy, s.
    pub upload_s: f64,
    /// The compute stream, s.
    pub compute_s: f64,
    /// The download stream, s.
    pub download_s: f64,
    /// From the first upload's start to the last download's end, s.
    pub span_s: f64,
    /// Bytes of charts that went up.
    pub bytes_up: u64,
    /// Bytes of light that came down.
    pub bytes_down: u64,
    /// Why it left before the end.
    pub left: Option<String>,
}

/// The thread that waits for what comes down.
pub(super) struct Drain<'a, 'b, S: FilmSink> {
    shared: &'a Shared<'b, S>,
    own: &'a DeviceQueue,
    gone: &'a AtomicBool,
    figures: &'a Mutex<DeviceFigures>,
    first: Option<CudaEvent>,
}

impl<'a, 'b, S: FilmSink> Drain<'a, 'b, S> {
    pub(super) fn new(
        shared: &'a Shared<'b, S>,
        own: &'a DeviceQueue,
        gone: &'a AtomicBool,
        figures: &'a Mutex<DeviceFigures>,
    ) -> Self {
        Self { shared, own, gone, figures, first: None }
    }

    /// Hands in what comes down, in the order in which it was launched.
    pub(super) fn run(mut self, inbox: &Receiver<Enqueued>, outbox: &Sender<Back>) {
        let mut failed = false;
        for Enqueued { batch, slot, tiles, lost, events, home } in inbox {
            let down = match failed {
                false => self.down(&batch, &tiles, events),
                true => Err(None),
            };
            if let Err(error) = down {
                failed = true;
                self.gone.store(true, Ordering::SeqCst);
                // Copies may be under way in the buffers that end here.
                let _ = self.own.device.context.synchronize();
                self.shared.give_back(batch);
                if let Some(error) = error {
                    // Whoever would hear of it is waiting, or ends for a reason of its own.
                    let _ = outbox.send(Back::Failed(error));
                }
                continue;
            }
            let _ = outbox.send(Back::Slot(slot));
            let mut done: Vec<(usize, Thrown)> = lost.into_iter().map(|s| (s, Thrown::Lost)).collect();
            for Tile { sequence, chart, light, .. } in tiles {
                let _ = home.send(chart);
                done.push((sequence, Thrown::Down(light)));
            }
            for (sequence, light) in done {
                self.shared.hand_in(&batch, sequence, light);
            }
        }
    }

    /// Waits until `tiles` are down and counts them.
    fn down(&mut self, batch: &Batch, tiles: &[Tile], events: Events) -> Result<(), Option<CudaError>> {
        let device = &self.own.device;
        let failed = |e| Some(CudaError::new(device.index(), "computing tiles", e));
        events.download[1].synchronize().map_err(failed)?;
        let seconds =
            |[a, b]: &[CudaEvent; 2]| a.elapsed_ms(b).map(|ms| f64::from(ms) * 1e-3).map_err(failed);
        let (up, computing, down) =
            (seconds(&events.upload)?, seconds(&events.compute)?, seconds(&events.download)?);
        let mut f = self.figures.lock().expect("no panic while held");
        let [start, _] = events.upload;
        let first = self.first.get_or_insert(start);
        f.span_s = f64::from(first.elapsed_ms(&events.download[1]).map_err(failed)?) * 1e-3;
        f.upload_s += up;
        f.compute_s += computing;
        f.download_s += down;
        f.batches += 1;
        f.tiles += batch.count as u64;
        f.pixels += tiles.iter().map(|t| t.rect.size().pixels() as u64).sum::<u64>();
        f.bytes_up += tiles.iter().map(|t| 4 * t.chart_rect.size().pixels() as u64).sum::<u64>();
        f.bytes_down += tiles.iter().map(|t| 4 * t.light.data().len() as u64).sum::<u64>();
        Ok(())
    }
}
