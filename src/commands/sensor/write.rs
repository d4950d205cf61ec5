//! The shards of a raw: rows of shards of the signal, exposed and encoded shard by shard.

use super::exposure_times::ExposureTimes;
use super::memory::STRIP;
use super::resolve::{RawJob, Source};
use super::signal::{self, Measured, Stored};
use crate::progress::counting;
use crate::progress::interrupt;
use anyhow::Result;
use formats::durable::fault_point;
use formats::parallel::{self, Progress};
use formats::raw::{RawShard, RawStore};
use pipeline::geometry::Rect;
use pipeline::sensor::SignalHistogram;
use pipeline::sensor::noise::{Exposer, clipped};
use pipeline::sensor::overflow::received;
use rustix::time::{ClockId, Timespec, clock_gettime};
use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::Ordering;

/// What was made.
#[derive(Clone, Debug, Default)]
pub struct Done {
    /// Shards made.
    pub shards: usize,
    /// Shards still missing.
    pub left: usize,
    /// Bytes of them.
    pub bytes: u64,
    /// Sensor pixels whose signal was made.
    pub pixels: u64,
    /// Those of them whose signal is below 0, which count as 0.
    pub negative: u64,
    /// Digital numbers made.
    pub numbers: u64,
    /// Digital numbers at white or above.
    pub white: u64,
    /// Digital numbers at 0.
    pub black: u64,
    /// Digital numbers above a tenth of the range from black to white.
    pub lit: u64,
    /// Values of the signal.
    pub histogram: SignalHistogram,
    /// Core seconds of the noises, and of encoding and writing.
    pub noise_s: f64,
    /// See `noise_s`.
    pub write_s: f64,
}

/// CPU time of this thread, s.
fn thread_core_s() -> f64 {
    seconds(clock_gettime(ClockId::ThreadCPUTime))
}

/// Seconds of a clock.
pub fn seconds(t: Timespec) -> f64 {
    t.tv_sec as f64 + t.tv_nsec as f64 * 1e-9
}

/// Work on some shards of one place: frames, and perhaps the signal itself.
struct Writer<'a> {
    job: &'a RawJob,
    store: &'a RawStore,
    times: &'a ExposureTimes,
    done: Mutex<Done>,
    all: usize,
    progress: Progress<'a>,
}

/// Missing shards by output and place.
type Places = BTreeMap<(usize, (usize, usize)), Vec<RawShard>>;

/// Computes the shards `missing`.
pub fn shards(
    job: &RawJob,
    store: &RawStore,
    times: &ExposureTimes,
    missing: &[RawShard],
    measured: Option<Measured>,
) -> Result<Done> {
    let mut places = Places::new();
    for shard in missing {
        places.entry((shard.output, shard.place)).or_default().push(*shard);
    }
    let (bar, progress) = counting("exposing");
    let writer = Writer {
        job,
        store,
        times,
        done: Mutex::new(Done::default()),
        all: missing.len(),
        progress: &progress,
    };
    let stored = match (&measured, &job.source) {
        (_, Source::Kept(kept)) => Some(Stored::Kept(kept)),
        (Some(measured), _) => measured.stored(job),
        (None, Source::Film(..)) => None,
    };
    fault_point("shards-begin");
    match stored {
        Some(stored) if job.sensor.pixel.overflow.flows() => writer.expose_columns(&places, stored)?,
        Some(stored) => writer.expose_stored(&places, stored)?,
        None => writer.expose_film(&places)?,
    }
    bar.finish_and_clear();
    fault_point("shards-made");
    let mut done = writer.done.into_inner().expect("no panic while held");
    done.left = missing.len() - done.shards;
    Ok(done)
}

impl Writer<'_> {
    /// Each place from a signal on the disk.
    fn expose_stored(&self, places: &Places, stored: Stored<'_>) -> Result<()> {
        let places: Vec<&Vec<RawShard>> = places.values().collect();
        let cancel = interrupt::cancel_flag();
        parallel::for_each(self.job.memory.threads.min(places.len()), places.len(), &|_, _| (), |k| {
            if cancel.load(Ordering::Relaxed) {
                return Ok(());
            }
            let rect = self.store.spec().shard_rect(places[k][0]);
            let mut tile = vec![0.0; rect.size().pixels()];
            stored.read(rect, &mut tile)?;
            self.count_signal(&tile);
            places[k].iter().try_for_each(|shard| self.shard(*shard, rect, (&tile, &[])))
        })
    }

    /// Columns of places from a signal on the disk, in whose columns charge flows.
    fn expose_columns(&self, places: &Places, stored: Stored<'_>) -> Result<()> {
        let mut columns: BTreeMap<(usize, usize), Vec<&Vec<RawShard>>> = BTreeMap::new();
        for ((output, (_, column)), shards) in places {
            columns.entry((*output, *column)).or_default().push(shards);
        }
        let columns: Vec<Vec<&Vec<RawShard>>> = columns.into_values().collect();
        parallel::for_each(self.job.memory.threads.min(columns.len()), columns.len(), &|_, _| (), |k| {
            let mut frames: Vec<Option<usize>> =
                columns[k].iter().flat_map(|p| p.iter().map(|s| s.frame)).collect();
            frames.sort_unstable();
            frames.dedup();
            for (i, frame) in frames.iter().enumerate() {
                let across = self.store.spec().shard_rect(columns[k][0][0]);
                let received = match frame {
                    Some(frame) => self.received(stored, *frame, across)?,
                    None => Vec::new(),
                };
                for place in &columns[k] {
                    let rect = self.store.spec().shard_rect(place[0]);
                    let mut tile = vec![0.0; rect.size().pixels()];
                    stored.read(rect, &mut tile)?;
                    if i == 0 {
                        self.count_signal(&tile);
                    }
                    let first = rect.y as usize * rect.width;
                    let received = received.get(first..first + tile.len()).unwrap_or_default();
                    let mut own = place.iter().filter(|shard| shard.frame == *frame);
                    own.try_for_each(|shard| self.shard(*shard, rect, (&tile, received)))?;
                }
            }
            Ok(())
        })
    }

    /// Electrons that the pixels of the columns of `across` receive from others in a frame, all rows of the sensor; empty if none do, or after an interruption.
    fn received(&self, stored: Stored<'_>, frame: usize, across: Rect) -> Result<Vec<f32>> {
        let exposer = Exposer::new(&self.job.sensor, &self.job.frame(self.times, frame));
        let (height, width) = (self.job.size().height, across.width);
        let mut all = Vec::new();
        for first in (0..width).step_by(STRIP) {
            if interrupt::cancel_flag().load(Ordering::Relaxed) {
                return Ok(Vec::new());
            }
            let rect = Rect::new(0, across.x + first as i64, height, STRIP.min(width - first));
            let mut signal = vec![0.0; rect.size().pixels()];
            stored.read(rect, &mut signal)?;
            let part = received(&exposer, &signal, rect);
            if !part.is_empty() {
                all.resize(height * width, 0.0);
                for (to, from) in all.chunks_mut(width).zip(part.chunks(rect.width)) {
                    to[first..first + rect.width].copy_from_slice(from);
                }
            }
        }
        Ok(all)
    }

    /// Rows of shards from the film, runs of them in one pass.
    fn expose_film(&self, places: &Places) -> Result<()> {
        let Source::Film(film, geometry) = &self.job.source else { return Ok(()) };
        let planes = self.job.planes(film, false);
        for output in 0..self.store.spec().outputs.len() {
            let mut rows: Vec<usize> = places.keys().filter(|p| p.0 == output).map(|p| p.1.0).collect();
            rows.dedup();
            let window = self.store.rect(output);
            let height = self.store.spec().shard_shape(output).0;
            for run in rows.chunk_by(|a, b| a + 1 == *b) {
                let wanted = run[0] * height..((run[run.len() - 1] + 1) * height).min(window.height);
                let mut signal: Vec<f32> = Vec::with_capacity(height.min(window.height) * window.width);
                let (mut row, mut failed) = (run[0], None);
                let mut deliver = |_: usize, planes: &[Vec<f32>]| {
                    let mut rest = &planes[0][..];
                    loop {
                        // Never more than a row of shards, so that memory does not depend on the blocks.
                        let rows = height.min(window.height - (row * height).min(window.height));
                        let missing = rows * window.width - signal.len().min(rows * window.width);
                        let (next, after) = rest.split_at(missing.min(rest.len()));
                        signal.extend_from_slice(next);
                        rest = after;
                        if rows == 0 || signal.len() < rows * window.width {
                            return Ok(());
                        }
                        if let Err(e) = self.shard_row(places, (output, row), window, &signal) {
                            // Kept apart: boxed, it would lose its type, from which the exit code follows.
                            failed = Some(e);
                            return Err("a shard could not be written".into());
                        }
                        signal.clear();
                        row += 1;
                    }
                };
                let passed = signal::pass(self.job, (film, geometry), window, &planes, wanted, &mut deliver);
                match (failed, passed) {
                    (Some(e), _) => return Err(e),
                    (None, Ok(true)) => {}
                    (None, passed) => return passed.map(drop),
                }
            }
        }
        Ok(())
    }

    /// A row of shards of an output from its signal.
    fn shard_row(
        &self,
        places: &Places,
        (output, row): (usize, usize),
        window: Rect,
        signal: &[f32],
    ) -> Result<()> {
        self.count_signal(signal);
        let shards: Vec<RawShard> = places
            .range((output, (row, 0))..(output, (row + 1, 0)))
            .flat_map(|(_, shards)| shards.iter().copied())
            .collect();
        parallel::for_each(self.job.memory.threads.min(shards.len()), shards.len(), &|_, _| (), |k| {
            let rect = self.store.spec().shard_rect(shards[k]);
            let first = (rect.x - window.x) as usize;
            let mut tile = Vec::with_capacity(rect.size().pixels());
            for line in signal.chunks(window.width) {
                tile.extend_from_slice(&line[first..first + rect.width]);
            }
            self.shard(shards[k], rect, (&tile, &[]))
        })
    }

    /// One shard of the signal `tile` of the pixels `rect`, which receive so many electrons of others; nothing after an interruption.
    fn shard(&self, shard: RawShard, rect: Rect, (tile, received_e): (&[f32], &[f32])) -> Result<()> {
        if interrupt::cancel_flag().load(Ordering::Relaxed) {
            return Ok(());
        }
        let start_s = thread_core_s();
        let mut exposed_s = start_s;
        let bytes = match shard.frame {
            None => self.store.commit_signal(shard, tile)?,
            Some(frame) => {
                let sensor = &self.job.sensor;
                let mut numbers = vec![0; tile.len()];
                let exposer = Exposer::new(sensor, &self.job.frame(self.times, frame));
                exposer.expose_with(tile, received_e, rect, &mut numbers);
                exposed_s = thread_core_s();
                let (white, black) = (sensor.white_dn(self.job.gain), sensor.adc.black_dn);
                let ends = clipped(&numbers, sensor.adc.stored_dn(white));
                let tenth = sensor.adc.stored_dn(black + 0.1 * (white - black));
                let lit = numbers.iter().filter(|v| f64::from(**v) > tenth).count() as u64;
                let bytes = self.store.commit_counts(shard, &numbers)?;
                let mut done = self.done.lock().expect("no panic while held");
                done.numbers += numbers.len() as u64;
                (done.white, done.black, done.lit) =
                    (done.white + ends.white, done.black + ends.black, done.lit + lit);
                bytes
            }
        };
        let mut done = self.done.lock().expect("no panic while held");
        done.shards += 1;
        done.bytes += bytes;
        done.noise_s += exposed_s - start_s;
        done.write_s += thread_core_s() - exposed_s;
        (self.progress)(done.shards as u64, self.all as u64);
        Ok(())
    }

    fn count_signal(&self, signal: &[f32]) {
        let mut done = self.done.lock().expect("no panic while held");
        done.pixels += signal.len() as u64;
        done.negative += signal.iter().filter(|v| **v < 0.0).count() as u64;
        done.histogram.add(signal);
    }
}
