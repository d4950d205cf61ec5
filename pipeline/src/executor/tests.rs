//! The scheduler without optics: every tile is added once for any number of threads; cost of scheduling.

use super::*;
use crate::buffer::{ShardPixels, TileBuffer};
use crate::cuda::band::GpuBand;
use crate::cuda::memory::QueueMemory;
use crate::cuda::{CudaError, Device};
use crate::flow::SourceSinkError;
use crate::geometry::{Rect, Size};
use crate::plan::{FilmRegion, ShardId, Tiling};
use crate::psf::blocks::Blocks;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::time::Duration;

const TILE: usize = 16;

struct Blank(Size);

impl ChartSource for Blank {
    fn size(&self) -> Size {
        self.0
    }
    fn read(&self, _band: usize, _rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        out.fill(0.0);
        Ok(())
    }
}

/// Time that a tile takes to compute.
#[derive(Clone, Copy)]
enum TileTime {
    /// On a core.
    Busy(Duration),
    /// Without a core: as many workers as wanted compute at a time.
    Asleep(Duration),
}

/// Fills each tile with 1.
struct Ones {
    time: TileTime,
    tiles: AtomicU64,
}

impl Compute for Ones {
    type Band = ();
    type Scratch = ();

    fn spectra_built(&self) -> u64 {
        0
    }
    fn prepare(&self, _position: usize) -> Result<(), SourceSinkError> {
        Ok(())
    }
    fn compute(
        &self,
        _band: &(),
        _chart: &dyn ChartSource,
        _chart_band: usize,
        tile: Rect,
        out: &mut TileBuffer,
        _scratch: &mut (),
        _clock: &Clock,
    ) -> Result<(), SourceSinkError> {
        let start = Instant::now();
        match self.time {
            TileTime::Busy(time) => {
                while start.elapsed() < time {
                    std::hint::spin_loop();
                }
            }
            TileTime::Asleep(time) => std::thread::sleep(time),
        }
        self.tiles.fetch_add(1, Ordering::Relaxed);
        out.copy(&vec![1.0; tile.size().pixels()], tile.width);
        Ok(())
    }
    fn chart_hint(&self, _band: &(), _chart: Size, tile: Rect) -> Rect {
        tile
    }
    fn chart_rect(&self, _band: &(), tile: Rect) -> Rect {
        tile
    }
    fn read_chart(
        &self,
        _band: &(),
        _chart: &dyn ChartSource,
        _chart_band: usize,
        _rect: Rect,
        _out: &mut [f32],
        _scratch: &mut (),
    ) -> Result<(), SourceSinkError> {
        unreachable!("no GPU")
    }
    fn begin_on_gpu(
        &self,
        _band: &(),
        _tiling: &Tiling,
        _device: &Arc<Device>,
        _memory: &QueueMemory,
    ) -> Result<GpuBand, CudaError> {
        unreachable!("no GPU")
    }
}

/// Number of pixels that are 1.
#[derive(Default)]
struct Count(AtomicU64);

impl FilmSink for Count {
    type Encoded = u64;

    fn encode(&self, _id: ShardId, rect: Rect, pixels: &ShardPixels) -> Result<u64, SourceSinkError> {
        Ok((0..rect.height).flat_map(|y| pixels.row(y)).filter(|v| **v == 1.0).count() as u64)
    }
    fn commit(&self, ones: u64) -> Result<u64, SourceSinkError> {
        self.0.fetch_add(ones, Ordering::Relaxed);
        Ok(0)
    }
}

/// Runs `bands` bands of a square film of `side` px; the seconds that it took.
fn schedule(bands: usize, side: usize, threads: usize, time: TileTime) -> f64 {
    let film = Size::new(side, side);
    let blocks = Blocks { window: 1, fft: 0, block: TILE, tile: TILE };
    let window = FilmRegion { rect: film.rect(), shard: Size::new(8 * TILE, 8 * TILE) };
    let (rows, columns) = window.count();
    let band = |position: usize| BandWork {
        chart_band: position,
        tiling: Tiling::new(film, Some(&blocks)),
        shards: (0..rows)
            .flat_map(|row| (0..columns).map(move |col| ShardId { position, region: 0, row, col }))
            .collect(),
    };
    let cancel = AtomicBool::new(false);
    let work = Work {
        film,
        regions: &[window],
        bands: (0..bands).map(band).collect(),
        threads,
        max_encoded_shards: 3,
        gpus: &[],
        cancel: &cancel,
    };
    let (compute, sink) = (Ones { time, tiles: AtomicU64::new(0) }, Count::default());
    let summary = run(&work, &Blank(film), &sink, &compute, &()).unwrap();
    let tiles = (bands * side.div_ceil(TILE).pow(2)) as u64;
    assert_eq!((summary.tiles, compute.tiles.into_inner()), (tiles, tiles));
    assert_eq!(summary.shards, (bands * rows * columns) as u64);
    assert_eq!(sink.0.into_inner(), (bands * film.pixels()) as u64);
    summary.wall_s
}

#[test]
fn every_tile_is_added_once_for_any_number_of_threads() {
    for threads in [1, 2, 3, 16, 64] {
        for (bands, side) in [(1, TILE), (3, 5 * TILE - 1), (7, 40 * TILE)] {
            schedule(bands, side, threads, TileTime::Busy(Duration::ZERO));
            schedule(bands, side, threads, TileTime::Busy(Duration::from_micros(3)));
        }
    }
}

/// CPU seconds of this process.
fn cpu_s() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

#[test]
#[ignore = "measurement: run alone, with --nocapture"]
fn cost_of_scheduling_a_tile() {
    let (bands, side) = (4, 128 * TILE);
    let tiles = (bands * 128 * 128) as f64;
    for threads in [1, 2, 4, 16] {
        for time in [Duration::ZERO, Duration::from_micros(20)] {
            let mut rounds: Vec<(f64, f64)> = (0..5)
                .map(|_| {
                    let start = cpu_s();
                    let wall = schedule(bands, side, threads, TileTime::Busy(time));
                    (wall, cpu_s() - start)
                })
                .collect();
            rounds.sort_by(|a, b| a.0.total_cmp(&b.0));
            let (wall, cpu) = rounds[2];
            println!(
                "{threads} threads, tiles of {} µs: wall {:.2} µs a tile, CPU {:.2} µs a tile",
                time.as_micros(),
                wall * 1e6 / tiles,
                cpu * 1e6 / tiles
            );
        }
    }
}

#[test]
#[ignore = "measurement: run alone, with --nocapture"]
fn share_of_the_ideal_rate_of_many_workers() {
    let (bands, side, tile) = (6, 34 * TILE, Duration::from_millis(13));
    for threads in [1, 2, 4, 8, 16, 32, 64] {
        let tiles = (bands * 34 * 34) as f64;
        let wall = schedule(if threads < 8 { 1 } else { bands }, side, threads, TileTime::Asleep(tile));
        let tiles = if threads < 8 { tiles / bands as f64 } else { tiles };
        let ideal = tiles * tile.as_secs_f64() / threads as f64;
        println!("{threads} workers: {:.3} of the ideal rate", ideal / wall);
    }
}
