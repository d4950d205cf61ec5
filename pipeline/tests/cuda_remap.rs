//! Stages 1-2 on a GPU: what they must do on any engine, over the emulated driver and on the machine's own.

mod emulated_cuda;
mod oracle;
mod remap_cases;

use emulated_cuda::{Build, Case, On, WATCHED};
use lenscube_pipeline::cuda::Device;
use lenscube_pipeline::flow::ChartSource;
use lenscube_pipeline::geometry::{Frame, Rect, Size};
use lenscube_pipeline::remap::cuda::{RemapOnDevice, RemapTile};
use lenscube_pipeline::remap::{Reading, Remap, RemapScratch};
use lenscube_pipeline::resample::{Interp, Surround};
use lenscube_pipeline::simd::Simd;
use oracle::Noise;
use remap_cases::{CHECKS, Check, Engine, FIRST_TWO, Job, band, noise_chart};
use std::process::ExitCode;
use std::sync::Arc;

/// A GPU, to which a rectangle goes in tiles of this size, all in one batch.
struct Gpu {
    device: Arc<Device>,
    tile: (usize, usize),
}

impl Engine for Gpu {
    fn remap(&self, job: &Job<'_>, chart: &dyn ChartSource, rect: Rect) -> Vec<f32> {
        let remap = Remap::new(job.frame, job.lens, job.stages, job.reading, job.gain, Simd::PORTABLE);
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

/// The check of this process, by its place: a case holds no more than a function.
fn run<const I: usize>() {
    (CHECKS[I].1 as Check)(&gpu((61, 150)));
}

const RUN: [fn(); 8] = [run::<0>, run::<1>, run::<2>, run::<3>, run::<4>, run::<5>, run::<6>, run::<7>];

/// However a rectangle is cut into tiles, and however many launches they take.
fn tiles_do_not_change_pixels() {
    let mut noise = Noise(41);
    let film = Size::new(900, 2000);
    let frame = Frame::centred(film, Size::new(820, 1900), 2.0);
    let lens = band(&mut noise, 300, frame.farthest_mm(film.rect()));
    let chart = noise_chart(&mut noise, frame.chart);
    let reading = Reading { interp: Interp::Bicubic, surround: Surround::Edge, outside: OUTSIDE };
    let job = Job { frame: &frame, lens: &lens, stages: FIRST_TWO, reading, gain: 3.0 };
    let rect = Rect::new(40, 900, 200, 777);
    let whole = gpu((200, 777)).remap(&job, &chart, rect);
    for tile in [(13, 777), (64, 33), (200, 16)] {
        let cut = gpu(tile).remap(&job, &chart, rect);
        assert_eq!(cut.len(), whole.len(), "tiles of {tile:?}");
        assert!(cut.iter().zip(&whole).all(|(a, b)| a.to_bits() == b.to_bits()), "tiles of {tile:?}");
    }
}

const OUTSIDE: lenscube_pipeline::field::Outside = lenscube_pipeline::field::Outside::Error;

/// What goes up is hardly more than what is read.
fn reach_is_close() {
    let film = Size::new(14_141, 14_141);
    let frame = Frame::centred(film, film, 2.0);
    let last = frame.farthest_mm(film.rect()) + 1e-9;
    let lens = oracle::lens_band((0..1000).map(|i| last * f64::from(i) / 999.0).collect(), 1.0, -0.05);
    let reading = Reading { interp: Interp::Bicubic, surround: Surround::Edge, outside: OUTSIDE };
    let remap = Remap::new(&frame, &lens, FIRST_TWO, reading, 1.0, Simd::PORTABLE);
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
        ("watched", WATCHED, &[("ORDER", "random"), ("STREAMS", "hasty")]),
    ];
    let mut cases = Vec::new();
    for ((name, _), run) in CHECKS.into_iter().zip(RUN) {
        cases.push(Case::device(name, run));
        for (how, build, settings) in settings {
            let name = format!("emulated::{how}::{name}");
            cases.push(Case { name, run, on: On::Emulated(build, settings), must_fail: false, long: false });
        }
        for (what, build) in [("without_barrier", NO_BARRIER), ("without_halo", NO_HALO)] {
            let seen = match what {
                "without_barrier" => name == "noise_far_from_the_axis_keeps_its_edges",
                _ => name == "remap_equals_the_map",
            };
            if seen {
                let name = format!("emulated::{what}_it_is_seen_that::{name}");
                cases.push(Case { name, run, on: On::Emulated(build, &[]), must_fail: true, long: false });
            }
        }
    }
    cases.push(Case::device("tiles_do_not_change_pixels", tiles_do_not_change_pixels));
    cases.push(Case::emulated("tiles_do_not_change_pixels", &[], tiles_do_not_change_pixels));
    cases.push(Case::emulated("reach_is_close", &[], reach_is_close));
    emulated_cuda::run(cases)
}
