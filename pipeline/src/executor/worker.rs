//! A worker's loop, and that of a thread that writes.

use super::RunError;
use super::feed::{Running, Shared, Task};
use super::turn::{Light, Thrown};
use crate::flow::{ChartSource, DoorError, FilmSink};
use crate::plan::ShardId;
use crate::psf::PsfScratch;
use crate::scene::SceneScratch;
use crossbeam::channel::{Receiver, Sender};
use std::sync::atomic::{AtomicU64, Ordering};

/// Tiles, per worker, between the one that is computed and the one whose chart is fetched: some tens of milliseconds.
pub(super) const READ_AHEAD: usize = 4;

impl<S: FilmSink> Shared<'_, S> {
    pub(super) fn compute(&self, bands: &Receiver<Running>, encoded: &Sender<(ShardId, S::Encoded)>) {
        let (mut scene, mut scratch, mut psf) = (Vec::new(), SceneScratch::default(), PsfScratch::default());
        loop {
            match self.next(bands) {
                Task::Over => return,
                Task::Encode(shard) => {
                    let done =
                        self.clock.encode.time(|| self.sink.encode(shard.id, shard.rect, &shard.pixels));
                    self.overlap.lock().expect("workers do not panic").recycle(shard.pixels);
                    match done {
                        Ok(bytes) => {
                            // Writers are gone only after an error, which is told elsewhere.
                            let _ = encoded.send((shard.id, bytes));
                        }
                        Err(source) => self.fail(RunError::Write { id: shard.id, source }),
                    }
                }
                Task::Fetch(fetch) => self.fetch(fetch, &mut scratch),
                Task::Tile { sequence, band, index, mut light } => {
                    let work = &self.work.bands[band.position];
                    let (tile, stages) = (band.tiles[index], &band.stages);
                    let rect = work.tiling.rect(tile);
                    scene.resize(rect.size().pixels(), 0.0);
                    self.expect(&band, index + READ_AHEAD * self.work.threads.max(1));
                    let read = self.clock.scene.time(|| {
                        stages.scene.apply(&self.chart, work.chart_band, rect, &mut scene, &mut scratch)
                    });
                    if let Err(source) = read {
                        self.unread(&band, tile, source);
                        self.add(sequence, Light { band, tile, light: Thrown::Lost });
                        continue;
                    }
                    self.clock.svpsf.time(|| match &stages.psf {
                        Some(stage) => {
                            stage.scatter(
                                &self.work.frame,
                                rect,
                                &scene,
                                &self.spectra,
                                &mut light,
                                &mut psf,
                            );
                        }
                        None => light.copy(&scene, rect.width),
                    });
                    self.add(sequence, Light { band, tile, light: Thrown::Here(light) });
                }
            }
        }
    }

    /// The chart under `tile` could not be read.
    pub(crate) fn unread(&self, band: &Running, tile: (usize, usize), source: DoorError) {
        let rect = self.work.bands[band.position].tiling.rect(tile);
        let shards = self.shards(band, tile);
        self.fail(RunError::Read { position: band.position, rect, shards, source });
    }

    /// Lets the chart fetch what a later tile of the band will ask for.
    pub(super) fn expect(&self, band: &Running, index: usize) {
        let work = &self.work.bands[band.position];
        if let Some(&tile) = band.tiles.get(index) {
            let rect = band.stages.scene.about(self.chart.size(), work.tiling.rect(tile));
            self.clock.scene.time(|| self.chart.expect(work.chart_band, rect));
        }
    }

    pub(super) fn write(
        &self,
        inbox: &Receiver<(ShardId, S::Encoded)>,
        shards: &AtomicU64,
        bytes: &AtomicU64,
    ) {
        for (id, encoded) in inbox {
            match self.clock.write.time(|| self.sink.commit(encoded)) {
                Ok(written) => {
                    shards.fetch_add(1, Ordering::Relaxed);
                    bytes.fetch_add(written, Ordering::Relaxed);
                    self.progress.shard(id, written);
                }
                Err(source) => self.fail(RunError::Write { id, source }),
            }
        }
    }
}
