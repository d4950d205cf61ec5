//! The PSF stage on a GPU compared with the CPU and with the f64 sum, on the emulated driver and on the machine's GPU.

mod emulated_cuda;
mod oracle;

use emulated_cuda::{Build, Case, SANITIZED_BUILD, Target};
use lenscube_pipeline::buffer::TileBuffer;
use lenscube_pipeline::cuda::handle::CudaStream;
use lenscube_pipeline::cuda::kernel_timer::KernelTimer;
use lenscube_pipeline::cuda::{CudaError, Device};
use lenscube_pipeline::geometry::{Frame, Rect, Size};
use lenscube_pipeline::lens::{PsfSample, PsfStack};
use lenscube_pipeline::psf::cuda::{PsfOnDevice, PsfStage, PsfTile};
use lenscube_pipeline::psf::grid::{Node, NodeGrid};
use lenscube_pipeline::psf::kernel::{KernelScratch, NodeKernels};
use lenscube_pipeline::psf::spectra::SpectrumCache;
use lenscube_pipeline::psf::{BandPsf, PsfScratch};
use lenscube_pipeline::simd::Simd;
use oracle::{Grid, Image, Noise, errors};
use std::process::ExitCode;
use std::sync::Arc;

/// Allowed difference of devices, relative to the peak.
const TOLERANCE: f64 = 2e-6;

/// Random windows of sum 1, symmetric about the meridian if `mirrored`.
fn stack(noise: &mut Noise, n: usize, heights: usize, mirrored: bool) -> PsfStack {
    let c = (n as f64 - 1.0) / 2.0;
    let width = 0.15 * n as f64 + 0.5;
    let mut samples = Vec::new();
    for k in 0..heights {
        let mut w: Vec<f64> = (0..n * n)
            .map(|i| {
                let (y, x) = ((i / n) as f64 - c, (i % n) as f64 - c - 0.1 * k as f64);
                (-(x * x + 1.7 * y * y) / (2.0 * width * width)).exp() * noise.between(0.5, 1.5)
            })
            .collect();
        if mirrored {
            for y in 0..n / 2 {
                let (upper, lower) = w.split_at_mut((n - 1 - y) * n);
                lower[..n].copy_from_slice(&upper[y * n..][..n]);
            }
        }
        let sum: f64 = w.iter().sum();
        samples.extend(w.iter().map(|v| (v / sum) as f32));
    }
    PsfStack { size: n, pitch_um: 2.0, sample: PsfSample::Integrated, samples }
}

/// A band of a film, with its remapped image on the film grown by half the window.
struct Film {
    psf: BandPsf,
    frame: Frame,
    remapped: Image,
}

impl Film {
    /// `heights`: relative to the farthest remapped pixel, each with its number of azimuths.
    fn new(n: usize, heights: &[(f64, usize)], size: Size, axis_px: (f64, f64)) -> Self {
        let mut noise = Noise((n * 1000 + size.width + heights.len()) as u64);
        let frame = Frame { axis_px, ..Frame::centred(size, size, 2.0) };
        let grown = size.rect().grown(n / 2);
        let last = frame.farthest_mm(grown);
        let pixel = |i: usize| if i.is_multiple_of(977) { 50.0 } else { f64::from(noise.next() as f32) };
        let remapped = Image { size: grown.size(), data: (0..grown.size().pixels()).map(pixel).collect() };
        let (height_mm, azimuths): (Vec<f64>, Vec<usize>) =
            heights.iter().map(|(h, j)| (h * last, *j)).unzip();
        let grid = NodeGrid::new(&height_mm, &azimuths, frame.pitch_mm());
        let stack = stack(&mut noise, n, heights.len(), n.is_multiple_of(3));
        let simd = Simd::PORTABLE;
        Self { psf: BandPsf::new(0, grid, NodeKernels::new(&stack, 2.0, None, simd), simd), frame, remapped }
    }

    fn grown(&self) -> Rect {
        self.psf.reaches(self.frame.film.rect())
    }

    fn tiles(&self) -> Vec<Rect> {
        let side = self.psf.blocks().tile;
        self.grown().tiles(side, side).collect()
    }

    fn pixels(&self, tile: Rect) -> Vec<f32> {
        let (y, x) = ((tile.y - self.grown().y) as usize, (tile.x - self.grown().x) as usize);
        let at = |i: usize| self.remapped.at(y + i / tile.width, x + i % tile.width) as f32;
        (0..tile.size().pixels()).map(at).collect()
    }

    fn stage(&self, device: &Arc<Device>, bytes: usize) -> Result<PsfStage, CudaError> {
        PsfStage::new(device, &self.frame, &self.psf, bytes)
    }

    fn min_bytes(&self) -> usize {
        PsfOnDevice::min_bytes(self.psf.blocks(), self.psf.grid(), self.psf.blocks().tile)
    }

    /// The contributions of `tiles` as one batch, with gaps between tiles and rows.
    fn batch(
        &self,
        device: &Device,
        stream: &Arc<CudaStream>,
        stage: &mut PsfStage,
        tiles: &[Rect],
    ) -> Vec<Vec<f32>> {
        let (mut remapped, mut contribution, mut batch) = (vec![7.0; 3], 5, Vec::new());
        for (i, &rect) in tiles.iter().enumerate() {
            let (reach, remapped_offset) = (self.psf.reaches(rect), remapped.len());
            remapped.extend(self.pixels(rect));
            let contribution_stride = reach.width + i % 3;
            batch.push(PsfTile {
                rect,
                remapped_offset,
                contribution_offset: contribution,
                contribution_stride,
            });
            contribution += contribution_stride * reach.height + 1;
        }
        let uploaded = stream.clone_htod(&remapped).unwrap();
        let mut out = stream.clone_htod(&vec![f32::NAN; contribution]).unwrap();
        let timer = &mut KernelTimer::new(device, stream);
        stage.launch(stream, &batch, &uploaded, &mut out, timer).unwrap();
        let all = stream.clone_dtoh(&out).unwrap();
        stream.synchronize().map_err(device.failed("a test")).unwrap();
        let contribution = |tile: &PsfTile| -> Vec<f32> {
            let reach = self.psf.reaches(tile.rect);
            let rows = all[tile.contribution_offset..].chunks(tile.contribution_stride).take(reach.height);
            rows.flat_map(|row| row[..reach.width].to_vec()).collect()
        };
        let untouched = all.iter().filter(|v| v.is_nan()).count();
        let set: usize = tiles.iter().map(|t| self.psf.reaches(*t).size().pixels()).sum();
        assert_eq!(all.len() - untouched, set, "exactly the values of the contributions are set");
        batch.iter().map(contribution).collect()
    }

    /// The contributions of all tiles, in batches of `batch`.
    fn contributions(&self, batch: usize, bytes: usize) -> Vec<Vec<f32>> {
        let device = Device::open(0).unwrap();
        let stream = device.context.new_stream().unwrap();
        let mut stage = self.stage(&device, bytes).unwrap();
        let tiles = self.tiles();
        let contributions =
            tiles.chunks(batch).flat_map(|some| self.batch(&device, &stream, &mut stage, some)).collect();
        device.context.synchronize().unwrap();
        contributions
    }

    /// The contribution of a tile computed by the CPU.
    fn cpu(&self, tile: Rect, cache: &SpectrumCache) -> Vec<f64> {
        let mut out = TileBuffer::default();
        self.psf.scatter(&self.frame, tile, &self.pixels(tile), cache, &mut out, &mut PsfScratch::default());
        let reach = self.psf.reaches(tile);
        let rows = out.data.chunks(out.stride).take(reach.height);
        rows.flat_map(|row| row[..reach.width].iter().map(|&v| f64::from(v)).collect::<Vec<_>>()).collect()
    }

    /// Compares each contribution with the CPU's.
    fn assert_equals_cpu(&self, contributions: &[Vec<f32>]) {
        let cache = SpectrumCache::new(64 << 20);
        assert_eq!(self.tiles().len(), contributions.len(), "tiles");
        for (tile, contribution) in self.tiles().into_iter().zip(contributions) {
            let (worst, l2) = errors(contribution, &self.cpu(tile, &cache));
            assert!(worst <= TOLERANCE, "{tile}: max {worst:.1e}, L2 {l2:.1e} from the CPU");
        }
    }

    /// Compares the sum of all contributions with the f64 sum over pixels.
    fn assert_equals_f64_sum(&self, contributions: &[Vec<f32>]) {
        let (n, grid, kernels) = (self.psf.kernels().size(), self.psf.grid(), self.psf.kernels());
        let kernel = |k: usize, j: usize| {
            let mut out = vec![0.0; n * n];
            kernels.kernel(grid, Node { k, j }, &mut KernelScratch::default(), &mut out);
            out.into_iter().map(f64::from).collect::<Vec<_>>()
        };
        let ring = |k: usize| (0..grid.azimuths()[k]).map(|j| kernel(k, j)).collect();
        let heights_mm = grid.heights_px().iter().map(|h| h * self.frame.pitch_mm()).collect::<Vec<_>>();
        let all = Grid { n, kernels: (0..heights_mm.len()).map(ring).collect(), heights_mm };
        let (film, origin) = (self.frame.film.rect(), self.grown());
        let expected = oracle::svpsf(&self.remapped, (origin.y, origin.x), &self.frame, &all, film);
        let mut got = vec![0f32; film.size().pixels()];
        assert_eq!(self.tiles().len(), contributions.len(), "tiles");
        for (tile, contribution) in self.tiles().into_iter().zip(contributions) {
            let reach = self.psf.reaches(tile);
            let on_film = reach.intersect(film);
            for y in on_film.y..on_film.bottom() {
                for x in on_film.x..on_film.right() {
                    got[y as usize * film.width + x as usize] +=
                        contribution[(y - reach.y) as usize * reach.width + (x - reach.x) as usize];
                }
            }
        }
        let (worst, l2) = errors(&got, &expected.data);
        assert!(worst <= TOLERANCE && l2 <= 1e-6, "max {worst:.1e}, L2 {l2:.1e} from the sum over pixels");
        println!("{n} px: max {worst:.1e}, L2 {l2:.1e}");
    }
}

const AMPLE: usize = 1 << 30;
const UNEVEN: [(f64, usize); 6] = [(0.0, 1), (0.11, 4), (0.17, 12), (0.6, 24), (0.95, 36), (1.0, 8)];
const FINE: [(f64, usize); 9] =
    [(0.0, 1), (0.05, 16), (0.1, 24), (0.2, 48), (0.3, 72), (0.45, 72), (0.6, 72), (0.8, 72), (1.0, 72)];
const QUARTERS: [(f64, usize); 3] = [(0.0, 1), (0.4, 4), (1.0, 4)];

fn check(n: usize, heights: &[(f64, usize)], size: Size, axis: (f64, f64)) {
    let film = Film::new(n, heights, size, axis);
    let contributions = film.contributions(2, AMPLE);
    film.assert_equals_cpu(&contributions);
    film.assert_equals_f64_sum(&contributions);
}

fn narrow_windows_equal_cpu_and_f64_sum() {
    check(1, &UNEVEN, Size::new(33, 45), (16.0, 22.0));
    check(3, &UNEVEN, Size::new(61, 77), (30.0, 38.0));
    check(3, &QUARTERS, Size::new(30, 560), (-40.0, 10.25));
    check(15, &UNEVEN, Size::new(1, 1), (0.0, 0.0));
    check(25, &QUARTERS, Size::new(130, 120), (-900.0, 5000.5));
}

fn windows_of_one_slice_equal_cpu_and_f64_sum() {
    check(51, &UNEVEN, Size::new(100, 133), (20.3, 101.7));
    check(51, &FINE, Size::new(90, 80), (44.5, 39.5));
    check(63, &QUARTERS, Size::new(60, 70), (29.5, 134.5));
}

fn windows_of_four_slices_equal_cpu_and_f64_sum() {
    check(65, &FINE, Size::new(60, 70), (29.5, 34.5));
    check(101, &UNEVEN, Size::new(50, 40), (11.0, 300.0));
    check(151, &QUARTERS, Size::new(40, 50), (19.5, 24.5));
    check(151, &UNEVEN, Size::new(20, 20), (-300.0, 500.25));
}

fn windows_in_parts_equal_cpu_and_f64_sum() {
    check(201, &QUARTERS, Size::new(30, 20), (9.5, 14.5));
    check(401, &QUARTERS, Size::new(20, 15), (9.5, 4.5));
}

fn widest_window_equals_cpu() {
    let film = Film::new(639, &QUARTERS, Size::new(3, 2), (1.0, 700.5));
    film.assert_equals_cpu(&film.contributions(1, AMPLE));
}

/// Random cases with fixed seeds, which are printed.
fn random_cases_equal_cpu_and_f64_sum() {
    for seed in 1..=6u64 {
        let mut noise = Noise(seed * 77);
        let n = 3 + 2 * noise.below(40);
        let heights: Vec<(f64, usize)> = (0..4 + noise.below(5))
            .scan(0.0, |at, k| {
                let height = (*at, if k == 0 { 1 } else { 4 * (1 + noise.below(9)) });
                *at += noise.between(0.05, 0.4);
                Some(height)
            })
            .collect();
        let size = Size::new(20 + noise.below(90), 20 + noise.below(90));
        let axis = (noise.between(-80.0, 150.0), noise.between(-80.0, 150.0));
        println!("{seed}: {n} px, {size}, axis {axis:?}, {heights:?}");
        check(n, &heights, size, axis);
    }
}

fn bits(contributions: &[Vec<f32>]) -> Vec<Vec<u32>> {
    contributions.iter().map(|contribution| contribution.iter().map(|v| v.to_bits()).collect()).collect()
}

/// For any batch size and any memory limit.
fn same_bits_in_any_batch_and_memory() {
    for (film, several) in [
        (Film::new(9, &FINE, Size::new(12, 1700), (840.5, -20.0)), true),
        (Film::new(101, &UNEVEN, Size::new(1700, 8), (3.5, 840.5)), true),
        (Film::new(229, &QUARTERS, Size::new(20, 20), (9.5, 9.5)), false),
    ] {
        let one = bits(&film.contributions(1, AMPLE));
        assert!(!several || one.len() > 3, "a case of several tiles");
        assert!(bits(&film.contributions(3, AMPLE)) == one, "batches of 3");
        assert!(
            bits(&film.contributions(usize::MAX, film.min_bytes())) == one,
            "one batch, the minimum of memory"
        );
    }
}

fn too_little_memory_reports_the_minimum() {
    let film = Film::new(51, &FINE, Size::new(60, 60), (29.5, 29.5));
    let device = Device::open(0).unwrap();
    let min = film.min_bytes();
    let error = film.stage(&device, min - 1).unwrap_err();
    assert!(
        matches!(error, CudaError::OutOfMemory { requested_bytes, .. } if requested_bytes == min as u64),
        "{error}"
    );
    film.stage(&device, min).unwrap();
    let narrow = film.stage(&device, AMPLE);
    assert!(narrow.is_ok());
}

fn device_memory_stays_within_the_limit() {
    let film = Film::new(101, &FINE, Size::new(240, 240), (119.5, 119.5));
    let device = Device::open(0).unwrap();
    let stream = device.context.new_stream().unwrap();
    for bytes in [film.min_bytes(), film.min_bytes() * 2] {
        let (free, _) = device.memory().unwrap();
        let mut stage = film.stage(&device, bytes).unwrap();
        let tiles = film.tiles();
        let buffer_px: usize =
            tiles.iter().map(|t| t.size().pixels() + film.psf.reaches(*t).size().pixels()).sum();
        film.batch(&device, &stream, &mut stage, &tiles);
        let (left, _) = device.memory().unwrap();
        let used = (free - left) as usize;
        assert!(
            used <= bytes + 8 * buffer_px + (1 << 20),
            "{used} of {bytes}, contributions and remapped tiles {}",
            4 * buffer_px
        );
    }
}

fn zero_input_gives_zero() {
    let mut film = Film::new(51, &UNEVEN, Size::new(60, 60), (29.5, 29.5));
    film.remapped.data.fill(0.0);
    assert!(film.contributions(1, AMPLE).iter().flatten().all(|v| *v == 0.0));
}

/// Small enough for sanitizers and for kernels with a barrier omitted.
fn one_and_four_slices_equal_cpu_and_f64_sum() {
    check(25, &UNEVEN, Size::new(60, 50), (20.3, 25.0));
    check(101, &QUARTERS, Size::new(20, 20), (9.5, -20.0));
}

fn one_slice() {
    check(25, &UNEVEN, Size::new(60, 50), (20.3, 25.0));
}

fn emulated(name: &str, build: Build, settings: &'static [(&'static str, &'static str)], run: fn()) -> Case {
    Case { target: Target::Emulated(build, settings), ..Case::emulated(name, &[], run) }
}

fn main() -> ExitCode {
    let all: [(&str, fn()); 6] = [
        ("narrow_windows_equal_cpu_and_f64_sum", narrow_windows_equal_cpu_and_f64_sum),
        ("windows_in_parts_equal_cpu_and_f64_sum", windows_in_parts_equal_cpu_and_f64_sum),
        ("random_cases_equal_cpu_and_f64_sum", random_cases_equal_cpu_and_f64_sum),
        ("same_bits_in_any_batch_and_memory", same_bits_in_any_batch_and_memory),
        ("too_little_memory_reports_the_minimum", too_little_memory_reports_the_minimum),
        ("zero_input_gives_zero", zero_input_gives_zero),
    ];
    let mut cases = Vec::new();
    for (name, run) in all {
        cases.push(Case::emulated(name, &[], run));
        cases.push(Case::device(name, run));
    }
    // 15 to 30 s each on the emulated driver, where only `scripts/check-long` runs them; windows of one slice and of four are among the random cases.
    let long: [(&str, fn()); 3] = [
        ("windows_of_one_slice_equal_cpu_and_f64_sum", windows_of_one_slice_equal_cpu_and_f64_sum),
        ("windows_of_four_slices_equal_cpu_and_f64_sum", windows_of_four_slices_equal_cpu_and_f64_sum),
        ("widest_window_equals_cpu", widest_window_equals_cpu),
    ];
    for (name, run) in long {
        cases.push(Case { long: true, ..Case::emulated(name, &[], run) });
        cases.push(Case::device(name, run));
    }
    cases.push(Case::emulated(
        "device_memory_stays_within_the_limit",
        &[],
        device_memory_stays_within_the_limit,
    ));
    for (name, settings) in [
        ("reverse", &[("ORDER", "reverse")][..]),
        ("random", &[("ORDER", "random"), ("CAPABILITY", "8.6"), ("CUBINS", "1")]),
        ("deferred", &[("STREAMS", "deferred"), ("CAPABILITY", "9.0")]),
        ("hasty", &[("STREAMS", "hasty")]),
    ] {
        cases.push(Case::emulated(
            &format!("one_and_four_slices_equal_cpu_and_f64_sum::{name}"),
            settings,
            one_and_four_slices_equal_cpu_and_f64_sum,
        ));
    }
    cases.push(emulated(
        "one_and_four_slices_equal_cpu_and_f64_sum::sanitized",
        SANITIZED_BUILD,
        &[],
        one_and_four_slices_equal_cpu_and_f64_sum,
    ));
    cases.push(emulated("windows_in_parts_equal_cpu_and_f64_sum::sanitized", SANITIZED_BUILD, &[], || {
        check(229, &QUARTERS, Size::new(2, 2), (9.5, 9.5))
    }));
    for (defines, order) in [
        ("-DWITHOUT=1", "forward"),
        ("-DWITHOUT=2", "forward"),
        ("-DWITHOUT=3", "forward"),
        ("-DWITHOUT=4", "forward"),
        ("-DWITHOUT=5", "forward"),
        ("-DWITHOUT=6", "forward"),
        ("-DWITHOUT=7", "forward"),
    ] {
        let name =
            format!("missing_barrier_is_detected{}::{order}", defines.trim_start_matches("-DWITHOUT="));
        let settings: &[(&str, &str)] = if order == "reverse" { &[("ORDER", "reverse")] } else { &[] };
        let case = emulated(&name, Build { sanitized: false, defines }, settings, one_slice);
        cases.push(Case { must_fail: true, ..case });
    }
    emulated_cuda::run(cases)
}
