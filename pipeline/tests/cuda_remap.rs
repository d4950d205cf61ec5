//! Remap stage on a GPU: the checks of every engine, on the emulated driver and on the machine's GPU.

mod emulated_cuda;
mod oracle;
mod remap_cases;

use emulated_cuda::{Build, Case, SANITIZED_BUILD, Target};
use lenscube_pipeline::cuda::Device;
use lenscube_pipeline::flow::ChartSource;
use lenscube_pipeline::geometry::{Frame, Rect, Size};
use lenscube_pipeline::remap::cuda::{RemapOnDevice, RemapTile};
use lenscube_pipeline::remap::{ChartInterpolation, Remap, RemapScratch};
use lenscube_pipeline::resample::{Interp, Surround};
use lenscube_pipeline::simd::Simd;
use oracle::Noise;
use remap_cases::{CHECKS, Check, Engine, FIRST_TWO, Job, band, noise_chart};
use std::process::ExitCode;
use std::sync::Arc;

/// A GPU; a rectangle is computed in tiles of this size, all in one batch.
struct Gpu {
    device: Arc<Device>,
    tile: (usize, usize),
}

impl Engine for Gpu {
    fn remap(&self, job: &Job<'_>, chart: &dyn ChartSource, rect: Rect) -> Vec<f32> {
        let remap = Remap::new(job.frame, job.lens, job.stages, job.interpolation, job.gain, Simd::PORTABLE);
        let stage = RemapOnDevice::new(&self.device, &remap).unwrap();
        let stream = self.device.context.new_stream().unwrap();
        let (mut charts, mut scratch, mut tiles) = (Vec::new(), RemapScratch::default(), Vec::new());
        let mut remapped_offset = 0;
        for part in rect.tiles(self.tile.0, self.tile.1) {
            let chart_rect = remap.upload_rect(part);
            let chart_offset = charts.len();
            charts.resize(chart_offset + chart_rect.size().pixels(), f32::NAN);
            remap.fill(chart, 0, chart_rect, &mut charts[chart_offset..], &mut scratch).unwrap();
            tiles.push(RemapTile { rect: part, chart_rect, chart_offset, remapped_offset });
            remapped_offset += part.size().pixels();
        }
        let charts = stream.clone_htod(&charts).unwrap();
        let mut remapped = self.device.allocate::<f32>(&stream, remapped_offset, "a test").unwrap();
        stage.launch(&stream, &tiles, &charts, &mut remapped).unwrap();
        let remapped = stream.clone_dtoh(&remapped).unwrap();
        self.device.context.synchronize().unwrap();
        let mut got = vec![f32::NAN; remapped_offset];
        for tile in &tiles {
            let (y, x) = ((tile.rect.y - rect.y) as usize, (tile.rect.x - rect.x) as usize);
            for (i, row) in
                remapped[tile.remapped_offset..].chunks(tile.rect.width).take(tile.rect.height).enumerate()
            {
                got[(y + i) * rect.width + x..][..tile.rect.width].copy_from_slice(row);
            }
        }
        got
    }
}

fn gpu(tile: (usize, usize)) -> Gpu {
    Gpu { device: Device::open(0).unwrap(), tile }
}

/// Check number I: a case has a function pointer without arguments.
fn run<const I: usize>() {
    (CHECKS[I].1 as Check)(&gpu((61, 150)));
}

const RUN: [fn(); 8] = [run::<0>, run::<1>, run::<2>, run::<3>, run::<4>, run::<5>, run::<6>, run::<7>];

/// For any division into tiles and any number of launches.
fn batches_of_any_tiles_give_the_same_pixels() {
    let mut noise = Noise(41);
    let film = Size::new(900, 2000);
    let frame = Frame::centred(film, Size::new(820, 1900), 2.0);
    let lens = band(&mut noise, 300, frame.farthest_mm(film.rect()));
    let chart = noise_chart(&mut noise, frame.chart);
    let interpolation =
        ChartInterpolation { interp: Interp::Bicubic, surround: Surround::Edge, outside: OUTSIDE };
    let job = Job { frame: &frame, lens: &lens, stages: FIRST_TWO, interpolation, gain: 3.0 };
    let rect = Rect::new(40, 900, 200, 777);
    let full = gpu((200, 777)).remap(&job, &chart, rect);
    for tile in [(13, 777), (64, 33), (200, 16)] {
        let tiled = gpu(tile).remap(&job, &chart, rect);
        assert_eq!(tiled.len(), full.len(), "tiles of {tile:?}");
        assert!(tiled.iter().zip(&full).all(|(a, b)| a.to_bits() == b.to_bits()), "tiles of {tile:?}");
    }
}

const OUTSIDE: lenscube_pipeline::field::Outside = lenscube_pipeline::field::Outside::Error;

/// The chart rectangle of a tile is little larger than the pixels read.
fn upload_rect_is_close_to_the_tile_size() {
    let film = Size::new(14_141, 14_141);
    let frame = Frame::centred(film, film, 2.0);
    let last = frame.farthest_mm(film.rect()) + 1e-9;
    let lens = oracle::lens_band((0..1000).map(|i| last * f64::from(i) / 999.0).collect(), 1.0, -0.05);
    let interpolation =
        ChartInterpolation { interp: Interp::Bicubic, surround: Surround::Edge, outside: OUTSIDE };
    let remap = Remap::new(&frame, &lens, FIRST_TWO, interpolation, 1.0, Simd::PORTABLE);
    for (y, x) in [(0, 0), (0, 7000), (7000, 7000), (13_000, 3000)] {
        let need = remap.upload_rect(Rect::new(y, x, 512, 512)).size();
        assert!(
            need.height.max(need.width) <= 530 && need.height.min(need.width) >= 440,
            "({y}, {x}): {need}"
        );
    }
}

fn main() -> ExitCode {
    const NO_BARRIER: Build = Build { sanitized: false, defines: "-DWITHOUT=1" };
    const NO_HALO: Build = Build { sanitized: false, defines: "-DWITHOUT=2" };
    type Settings = &'static [(&'static str, &'static str)];
    let settings: [(&str, Build, Settings); 3] = [
        ("forward", emulated_cuda::PLAIN, &[]),
        ("reverse", emulated_cuda::PLAIN, &[("ORDER", "reverse"), ("STREAMS", "deferred")]),
        ("sanitized", SANITIZED_BUILD, &[("ORDER", "random"), ("STREAMS", "hasty")]),
    ];
    let mut cases = Vec::new();
    for ((name, _), run) in CHECKS.into_iter().zip(RUN) {
        cases.push(Case::device(name, run));
        for (how, build, settings) in settings {
            let name = format!("emulated::{how}::{name}");
            cases.push(Case {
                name,
                run,
                target: Target::Emulated(build, settings),
                must_fail: false,
                long: false,
            });
        }
        for (what, build) in [("without_barrier", NO_BARRIER), ("without_halo", NO_HALO)] {
            let detects = match what {
                "without_barrier" => name == "white_noise_far_from_the_axis_equals_the_f64_model",
                _ => name == "remap_equals_the_f64_model",
            };
            if detects {
                let name = format!("emulated::{what}_is_detected_by::{name}");
                cases.push(Case {
                    name,
                    run,
                    target: Target::Emulated(build, &[]),
                    must_fail: true,
                    long: false,
                });
            }
        }
    }
    cases.push(Case::device(
        "batches_of_any_tiles_give_the_same_pixels",
        batches_of_any_tiles_give_the_same_pixels,
    ));
    cases.push(Case::emulated(
        "batches_of_any_tiles_give_the_same_pixels",
        &[],
        batches_of_any_tiles_give_the_same_pixels,
    ));
    cases.push(Case::emulated(
        "upload_rect_is_close_to_the_tile_size",
        &[],
        upload_rect_is_close_to_the_tile_size,
    ));
    emulated_cuda::run(cases)
}
