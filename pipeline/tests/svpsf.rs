//! SVPSF compared with the f64 sum, for any window, grid and axis.
//!
//! Each case runs once per instruction set; sets that the machine lacks are reported as ignored.

mod oracle;

use lenscube_pipeline::bench::Strided;
use lenscube_pipeline::buffer::TileBuffer;
use lenscube_pipeline::geometry::{Frame, Rect, Size};
use lenscube_pipeline::lens::{PsfSample, PsfStack};
use lenscube_pipeline::psf::grid::{Node, NodeGrid};
use lenscube_pipeline::psf::kernel::{KernelScratch, NodeKernels};
use lenscube_pipeline::psf::spectra::SpectrumCache;
use lenscube_pipeline::psf::{BandPsf, PsfScratch};
use lenscube_pipeline::simd::{Isa, Simd};
use libtest_mimic::{Arguments, Trial};
use oracle::{Grid, Image, Noise, errors};
use std::process::ExitCode;
use std::sync::{Arc, OnceLock};

/// Random, asymmetric windows of sum 1.
fn stack(noise: &mut Noise, n: usize, heights: usize) -> PsfStack {
    let c = (n as f64 - 1.0) / 2.0;
    let mut samples = Vec::new();
    for k in 0..heights {
        let width = 0.15 * n as f64 + 0.5;
        let w: Vec<f64> = (0..n * n)
            .map(|i| {
                let (y, x) = ((i / n) as f64 - c, (i % n) as f64 - c - 0.1 * k as f64);
                (-(x * x + 1.7 * y * y + 0.4 * x * y) / (2.0 * width * width)).exp() * noise.between(0.5, 1.5)
            })
            .collect();
        let sum: f64 = w.iter().sum();
        samples.extend(w.iter().map(|v| (v / sum) as f32));
    }
    PsfStack { size: n, pitch_um: 2.0, sample: PsfSample::Integrated, samples }
}

/// A film: its PSFs, its place about the axis, and its remapped image on the film grown by half the window.
struct Case {
    name: String,
    heights_mm: Vec<f64>,
    stack: PsfStack,
    frame: Frame,
    remapped: Image,
    expected: OnceLock<Vec<f64>>,
}

impl Case {
    /// `heights`: relative to the farthest remapped pixel.
    fn new(n: usize, heights: &[f64], size: Size, axis_px: (f64, f64)) -> Self {
        let mut noise = Noise((n * size.width + heights.len()) as u64);
        let frame = Frame { axis_px, ..Frame::centred(size, size, 2.0) };
        let grown = size.rect().grown(n / 2);
        let last = frame.farthest_mm(grown);
        let pixel = |i: usize| if i.is_multiple_of(977) { 50.0 } else { f64::from(noise.next() as f32) };
        let remapped = Image { size: grown.size(), data: (0..grown.size().pixels()).map(pixel).collect() };
        Self {
            name: format!("{n} px, {} heights, film {size}, axis {axis_px:?}", heights.len()),
            heights_mm: heights.iter().map(|h| h * last).collect(),
            stack: stack(&mut noise, n, heights.len()),
            frame,
            remapped,
            expected: OnceLock::new(),
        }
    }

    fn psf(&self, simd: Simd) -> BandPsf {
        let mut counts = vec![4; self.heights_mm.len()];
        counts[0] = 1;
        let grid = NodeGrid::new(&self.heights_mm, &counts, self.frame.pitch_mm());
        BandPsf::new(0, grid, NodeKernels::new(&self.stack, 2.0, None, simd), simd)
    }

    /// The film by the f64 sum over pixels, computed once for all engines.
    fn expected(&self) -> &[f64] {
        self.expected.get_or_init(|| {
            let heights = 0..self.heights_mm.len();
            let base: Vec<Vec<f64>> =
                heights.map(|k| self.stack.window(k).iter().map(|&v| f64::from(v)).collect()).collect();
            let film = self.frame.film.rect();
            let origin = film.grown(self.stack.size / 2);
            let grid = Grid::quarter_turns(self.stack.size, &self.heights_mm, &base);
            oracle::svpsf(&self.remapped, (origin.y, origin.x), &self.frame, &grid, film).data
        })
    }

    /// The contribution of each tile of `psf`, computed in the order set by `reorder`.
    fn tiles(
        &self,
        psf: &BandPsf,
        cache: &SpectrumCache,
        reorder: impl Fn(&mut Vec<Rect>),
    ) -> Vec<(Rect, TileBuffer)> {
        let grown = psf.reaches(self.frame.film.rect());
        let mut tiles: Vec<Rect> = grown.tiles(psf.blocks().tile, psf.blocks().tile).collect();
        reorder(&mut tiles);
        let mut scratch = PsfScratch::default();
        let scatter = |tile: Rect| {
            let mut out = TileBuffer::default();
            let pixels: Vec<f32> = (0..tile.size().pixels())
                .map(|i| {
                    let (y, x) = ((tile.y - grown.y) as usize, (tile.x - grown.x) as usize);
                    self.remapped.at(y + i / tile.width, x + i % tile.width) as f32
                })
                .collect();
            psf.scatter(&self.frame, tile, &pixels, cache, &mut out, &mut scratch);
            (tile, out)
        };
        tiles.into_iter().map(scatter).collect()
    }

    /// The complete film.
    fn film(&self, simd: Simd) -> Vec<f32> {
        let psf = self.psf(simd);
        let size = self.frame.film;
        let mut film = vec![0f32; size.pixels()];
        for (tile, out) in self.tiles(&psf, &SpectrumCache::new(64 << 20), |_| ()) {
            let reach = psf.reaches(tile);
            let on_film = reach.intersect(size.rect());
            for y in on_film.y..on_film.bottom() {
                for x in on_film.x..on_film.right() {
                    film[y as usize * size.width + x as usize] +=
                        out.data[(y - reach.y) as usize * out.stride + (x - reach.x) as usize];
                }
            }
        }
        film
    }

    fn film_equals_the_f64_sum(&self, simd: Simd) {
        let (worst, l2) = errors(&self.film(simd), self.expected());
        assert!(worst <= 2e-6 && l2 <= 1e-6, "{}: max {worst:.1e}, L2 {l2:.1e}", self.name);
    }

    /// In any order of tiles, with a cache for all spectra or for none.
    fn same_bits_for_any_tile_order_and_cache_size(&self, simd: Simd) {
        let psf = self.psf(simd);
        let plain = self.tiles(&psf, &SpectrumCache::new(usize::MAX), |_| ());
        assert!(plain.len() > 3, "a case of several tiles");
        let mut back = self.tiles(&psf, &SpectrumCache::new(1), |tiles| tiles.reverse());
        back.reverse();
        assert_eq!(plain.len(), back.len(), "tiles");
        for ((tile, a), (other, b)) in plain.iter().zip(&back) {
            assert_eq!((tile, a.stride, a.data.len()), (other, b.stride, b.data.len()));
            assert!(a.data.iter().zip(b.data.iter()).all(|(a, b)| a.to_bits() == b.to_bits()), "{tile:?}");
        }
    }

    fn film_equals_that_of_the_portable_engine(&self, simd: Simd) {
        let portable: Vec<f64> = self.film(Simd::PORTABLE).into_iter().map(f64::from).collect();
        let (worst, _) = errors(&self.film(simd), &portable);
        assert!(worst <= 2e-6, "max {worst:.1e} of the peak");
    }

    /// Values that would become denormal count as zero, also beside larger values.
    fn zero_and_denormal_input_give_zero(&self, simd: Simd) {
        let psf = self.psf(simd);
        let side = psf.blocks().block;
        let tile = Rect::new(0, 0, side, side);
        let (mut out, mut scratch) = (TileBuffer::default(), PsfScratch::default());
        let mut scatter = |remapped: &[f32]| {
            psf.scatter(&self.frame, tile, remapped, &SpectrumCache::new(64 << 20), &mut out, &mut scratch);
            out.data.iter().map(|&v| f64::from(v)).sum::<f64>()
        };
        let mut remapped = vec![1e-38; side * side];
        assert_eq!(scatter(&remapped), 0.0);
        remapped[side + 1] = 1.0;
        assert!((scatter(&remapped) - 1.0).abs() < 1e-5);
        assert_eq!(scatter(&vec![0.0; side * side]), 0.0);
    }
}

/// A comatic PSF: an elliptical Gaussian and a fainter one farther out, off the meridian.
fn comet(n: usize, pitch_um: f64, sample: PsfSample) -> PsfStack {
    let c = (n as f64 - 1.0) / 2.0;
    let one = (0..n * n).map(|i| {
        let (y, x) = (((i / n) as f64 - c) * pitch_um, ((i % n) as f64 - c) * pitch_um);
        let spot = |cx: f64, cy: f64, a: f64, b: f64| {
            (-((x - cx).powi(2) / (2.0 * a * a) + (y - cy).powi(2) / (2.0 * b * b))).exp()
        };
        spot(0.4, 0.0, 1.3, 0.9) + 0.2 * spot(6.0, 0.7, 4.0, 2.0)
    });
    let one: Vec<f64> = one.collect();
    let sum: f64 = one.iter().sum();
    let one: Vec<f32> = one.iter().map(|v| (v / sum) as f32).collect();
    PsfStack { size: n, pitch_um, sample, samples: [one.clone(), one].concat() }
}

/// Kernels rotated in f32 lanes compared with the portable engine's f64 sums.
fn kernels_equal_those_of_the_portable_engine(simd: Simd) {
    let grid = NodeGrid::new(&[0.0, 1.0], &[1, 72], 2e-3);
    let kernel = |kernels: &NodeKernels, j: usize| {
        let mut out = vec![0.0; kernels.size() * kernels.size()];
        kernels.kernel(&grid, Node { k: 1, j }, &mut KernelScratch::default(), &mut out);
        out
    };
    for (n, pitch, sample, window) in [
        (205, 0.5, PsfSample::Point, None),
        (171, 0.6, PsfSample::Point, Some(31)),
        (33, 2.0, PsfSample::Integrated, None),
        (33, 2.0, PsfSample::Integrated, Some(21)),
        (45, 0.9, PsfSample::Integrated, None),
    ] {
        let stack = comet(n, pitch, sample);
        let made = |simd| NodeKernels::new(&stack, 2.0, window, simd);
        let (lanes, plain) = (made(simd), made(Simd::PORTABLE));
        for j in [1, 4, 9, 13, 17, 35, 60] {
            let (a, b) = (kernel(&lanes, j), kernel(&plain, j));
            let peak = b.iter().fold(0.0f32, |m, v| m.max(*v));
            let worst = a.iter().zip(&b).fold(0.0f32, |m, (a, b)| m.max((a - b).abs())) / peak;
            let l1: f64 = a.iter().zip(&b).map(|(a, b)| f64::from((a - b).abs())).sum();
            assert!(worst < 1e-6 && l1 < 2e-6, "{n} samples, azimuth {j}: {worst:.1e}, L1 {l1:.1e}");
        }
    }
}

/// The strided direct sum of the published system, a benchmark baseline, equals the stage.
fn strided_sum_equals_the_stage(simd: Simd) {
    let frame = Frame::centred(Size::new(400, 400), Size::new(400, 400), 2.0);
    let n = 9;
    let samples: Vec<f32> = (0..3 * n * n).map(|i| (1 + i * 31 % 17) as f32).collect();
    let stack = PsfStack { size: n, pitch_um: 2.0, sample: PsfSample::Integrated, samples };
    let grid = NodeGrid::new(&[0.0, 0.2, 0.6], &[1, 8, 16], 2e-3);
    for tile in [Rect::new(180, 190, 40, 30), Rect::new(20, 300, 30, 40)] {
        let kernels = || NodeKernels::new(&stack, 2.0, None, simd);
        let remapped: Vec<f32> =
            (0..tile.size().pixels()).map(|i| 0.1 + (i * 7919 % 1009) as f32 / 1009.0).collect();
        let (height, width) = (tile.height + n - 1, tile.width + n - 1);
        let mut film = vec![0.0; height * width];
        Strided::new(&frame, &grid, &kernels(), tile).scatter(tile, &remapped, &mut film, simd);
        let stage = BandPsf::new(0, grid.clone(), kernels(), simd);
        let (mut out, mut scratch) = (TileBuffer::default(), PsfScratch::default());
        let cache = SpectrumCache::new(usize::MAX);
        stage.scatter(&frame, tile, &remapped, &cache, &mut out, &mut scratch);
        let peak = film.iter().fold(0f32, |m, v| m.max(*v));
        for (y, line) in film.chunks(width).enumerate() {
            for (x, v) in line.iter().enumerate() {
                let other = out.data[y * out.stride + x];
                assert!((v - other).abs() < 2e-6 * peak, "({y}, {x}): {v} and {other}");
            }
        }
    }
}

fn main() -> ExitCode {
    let uneven = [0.0, 0.11, 0.17, 0.6, 0.95, 1.0];
    let mut cases = Vec::new();
    for (n, size, axis) in [
        (15, Size::new(61, 77), (30.0, 38.0)),
        (15, Size::new(300, 211), (149.5, 105.0)),
        (51, Size::new(200, 333), (20.3, 301.7)),
        (3, Size::new(64, 600), (-40.0, 10.25)),
        (1, Size::new(33, 45), (16.0, 22.0)),
        (33, Size::new(1, 1), (0.0, 0.0)),
        (25, Size::new(130, 120), (-900.0, 5000.5)),
    ] {
        cases.push(Case::new(n, &[0.0, 1.0], size, axis));
        cases.push(Case::new(n, &uneven, size, axis));
    }
    cases.push(Case::new(151, &[0.0, 0.3, 1.0], Size::new(40, 50), (19.5, 24.5)));
    cases.push(Case::new(401, &[0.0, 0.5, 1.0], Size::new(20, 30), (9.5, 14.5)));
    let wide = Arc::new(Case::new(9, &uneven, Size::new(520, 600), (100.5, 340.0)));

    let mut trials = Vec::new();
    let mut trial = |isa: Isa, name: &str, case: &Arc<Case>, check: fn(&Case, Simd)| {
        let case = Arc::clone(case);
        let run = move || {
            check(&case, Simd::require(isa)?);
            Ok(())
        };
        trials
            .push(Trial::test(format!("{}::{name}", isa.name()), run).with_ignored_flag(!isa.is_available()));
    };
    for case in cases.into_iter().map(Arc::new) {
        for isa in Isa::ALL {
            let name = format!("film_equals_the_f64_sum ({})", case.name);
            trial(isa, &name, &case, Case::film_equals_the_f64_sum);
        }
    }
    for isa in Isa::ALL {
        trial(
            isa,
            "same_bits_for_any_tile_order_and_cache_size",
            &wide,
            Case::same_bits_for_any_tile_order_and_cache_size,
        );
        trial(isa, "zero_and_denormal_input_give_zero", &wide, Case::zero_and_denormal_input_give_zero);
        trial(isa, "strided_sum_equals_the_stage", &wide, |_, simd| strided_sum_equals_the_stage(simd));
    }
    // The portable engine is not compared with itself.
    for isa in Isa::ALL.into_iter().filter(|isa| *isa != Isa::Portable) {
        trial(
            isa,
            "film_equals_that_of_the_portable_engine",
            &wide,
            Case::film_equals_that_of_the_portable_engine,
        );
        trial(isa, "kernels_equal_those_of_the_portable_engine", &wide, |_, simd| {
            kernels_equal_those_of_the_portable_engine(simd)
        });
    }
    libtest_mimic::run(&Arguments::from_args(), trials).exit_code()
}
