//! The scheduler without optics: every tile is added once for any number of threads; cost of scheduling.

use super::*;
use crate::buffer::{ShardPixels, TileBuffer};
use crate::cuda::memory::QueueMemory;
use crate::cuda::{CudaError, Device};
use crate::flow::SourceSinkError;
use crate::geometry::{Rect, Size};
use crate::psf::blocks::Blocks;
use crate::stages::cuda::band::GpuBand;
use crate::tiling::{FilmRegion, ShardId, Tiling};
use std::collections::BTreeSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::AtomicU64;
use std::sync::{Arc, mpsc};
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

/// Fills the contribution of each tile with 1.
struct Ones<'a> {
    time: TileTime,
    tiles: AtomicU64,
    /// Pixels that a contribution is larger than its tile.
    tail: usize,
    /// Set after so many tiles.
    cancel: Option<(u64, &'a AtomicBool)>,
    panics: Option<Panics>,
}

/// Where a run panics.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Panics {
    Prepare,
    Compute,
    Encode,
    Commit,
}

impl Compute for Ones<'_> {
    type Band = ();
    type Scratch = ();

    fn spectra_built(&self) -> u64 {
        0
    }
    fn prepare(&self, position: usize) -> Result<(), SourceSinkError> {
        assert!(position == 0 || self.panics != Some(Panics::Prepare), "on purpose");
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
        let tiles = self.tiles.fetch_add(1, Ordering::Relaxed) + 1;
        assert!(tiles != 99 || self.panics != Some(Panics::Compute), "on purpose");
        if let Some((after, cancel)) = self.cancel {
            cancel.fetch_or(tiles >= after, Ordering::Relaxed);
        }
        let (height, width) = (tile.height + self.tail, tile.width + self.tail);
        out.copy(&vec![1.0; height * width], width);
        Ok(())
    }
    fn finish(&self, _band: &(), _rect: Rect, _pixels: &mut ShardPixels) {}
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
struct Count(AtomicU64, Option<Panics>);

impl FilmSink for Count {
    type Encoded = u64;

    fn encode(&self, _id: ShardId, rect: Rect, pixels: &ShardPixels) -> Result<u64, SourceSinkError> {
        assert!(self.1 != Some(Panics::Encode), "on purpose");
        Ok((0..rect.height).flat_map(|y| pixels.row(y)).filter(|v| **v == 1.0).count() as u64)
    }
    fn commit(&self, ones: u64) -> Result<u64, SourceSinkError> {
        assert!(self.1 != Some(Panics::Commit), "on purpose");
        self.0.fetch_add(ones, Ordering::Relaxed);
        Ok(0)
    }
}

/// `bands` bands of a square film of `side` px, for PSFs of `window` px.
fn bands_of(bands: usize, side: usize, window: usize) -> (FilmRegion, Vec<BandWork>) {
    let film = Size::new(side, side);
    let blocks = Blocks { window, fft: 0, block: TILE, tile: TILE };
    let region = FilmRegion { rect: film.rect(), shard: Size::new(8 * TILE, 8 * TILE) };
    let (rows, columns) = region.count();
    let band = |position: usize| BandWork {
        chart_band: position,
        tiling: Tiling::new(film, Some(&blocks)),
        shards: (0..rows)
            .flat_map(|row| (0..columns).map(move |col| ShardId { position, region: 0, row, col }))
            .collect(),
    };
    (region, (0..bands).map(band).collect())
}

/// Runs `bands` bands of a square film of `side` px; the seconds that it took.
fn schedule(bands: usize, side: usize, threads: usize, time: TileTime) -> f64 {
    let film = Size::new(side, side);
    let (region, work_of_bands) = bands_of(bands, side, 1);
    let (rows, columns) = region.count();
    let cancel = AtomicBool::new(false);
    let work = Work {
        film,
        regions: &[region],
        bands: work_of_bands,
        threads,
        max_encoded_shards: 3,
        gpus: &[],
        cancel: &cancel,
    };
    let compute = Ones { time, tiles: AtomicU64::new(0), tail: 0, cancel: None, panics: None };
    let sink = Count::default();
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

/// Runs a band of 19 x 19 tiles and four shards whose PSFs reach three tiles, cancelled after `after` tiles: the tiles computed, and the
/// shards written.
fn cancelled(threads: usize, after: u64) -> (u64, u64) {
    let (side, window) = (16 * TILE, 3 * TILE + 1);
    let film = Size::new(side, side);
    let (region, bands) = bands_of(1, side, window);
    let cancel = AtomicBool::new(false);
    let work =
        Work { film, regions: &[region], bands, threads, max_encoded_shards: 3, gpus: &[], cancel: &cancel };
    let time = TileTime::Busy(Duration::from_micros(3));
    let compute = Ones {
        time,
        tiles: AtomicU64::new(0),
        tail: window - 1,
        cancel: Some((after, &cancel)),
        panics: None,
    };
    let summary = run(&work, &Blank(film), &Count::default(), &compute, &()).unwrap();
    assert!(summary.interrupted);
    (compute.tiles.into_inner(), summary.shards)
}

/// Tiles of [`cancelled`].
const TILES: u64 = 19 * 19;

#[test]
fn cancelled_run_ends_at_any_tile_although_tiles_wait_for_others() {
    let (done, ended) = mpsc::channel();
    std::thread::spawn(move || {
        for threads in [1, 2, 5] {
            for after in 1..=TILES {
                done.send((threads, after, cancelled(threads, after))).expect("the test runs");
            }
        }
    });
    let mut shards = BTreeSet::new();
    for expected in 0..3 * TILES {
        let minute = Duration::from_secs(60);
        let got = ended.recv_timeout(minute);
        let (threads, after, (tiles, written)) = got.unwrap_or_else(|e| panic!("run {expected}: {e}"));
        assert!(
            tiles >= after && tiles < after + threads as u64,
            "{tiles} tiles computed, cancelled after {after}"
        );
        assert!(written < 4 || tiles == TILES, "all shards need all tiles");
        shards.insert(written);
    }
    assert_eq!(
        shards.into_iter().collect::<Vec<_>>(),
        [0, 1, 2, 3, 4],
        "shards that were complete are written"
    );
}

#[test]
fn a_panic_of_any_thread_ends_the_run() {
    let side = 20 * TILE;
    for panics in [Panics::Prepare, Panics::Compute, Panics::Encode, Panics::Commit] {
        for threads in [1, 4, 16] {
            let (done, ended) = mpsc::channel();
            std::thread::spawn(move || {
                let (film, cancel) = (Size::new(side, side), AtomicBool::new(false));
                let (region, bands) = bands_of(3, side, 1);
                let (regions, gpus) = (&[region], &[]);
                let work =
                    Work { film, regions, bands, threads, max_encoded_shards: 1, gpus, cancel: &cancel };
                let (time, tiles, panics) = (TileTime::Busy(Duration::ZERO), AtomicU64::new(0), Some(panics));
                let compute = Ones { time, tiles, tail: 0, cancel: None, panics };
                let sink = Count(AtomicU64::new(0), panics);
                let result =
                    catch_unwind(AssertUnwindSafe(|| run(&work, &Blank(film), &sink, &compute, &())));
                done.send(result.is_err()).expect("the test runs");
            });
            let panicked = ended.recv_timeout(Duration::from_secs(60));
            assert_eq!(panicked, Ok(true), "{panics:?} with {threads} threads");
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
