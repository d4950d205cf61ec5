//! Rate of SVPSF on the paper's film (14,141² of 2 µm): tiles spread over it, all spectra in the cache, one thread.
//!
//! The benchmark grid has 21 heights × 36 azimuths and a window of 51 px; beside it finer grids and other windows.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use lenscube_pipeline::geometry::{Frame, Rect, Size};
use lenscube_pipeline::lens::{PsfSample, PsfStack};
use lenscube_pipeline::psf::grid::NodeGrid;
use lenscube_pipeline::psf::kernel::NodeKernels;
use lenscube_pipeline::psf::spectra::SpectrumCache;
use lenscube_pipeline::psf::{BandPsf, PsfScratch, Scattered};
use lenscube_pipeline::simd::{Isa, Simd};

const FILM: usize = 14_141;
const PITCH_UM: f64 = 2.0;
const FARTHEST_MM: f64 = 20.0;

/// Tiles along each side of the film that are timed.
const SPREAD: usize = 7;

fn stage(window: usize, heights: usize, azimuths: usize, simd: Simd) -> BandPsf {
    let c = (window / 2) as f32;
    let one = (0..window * window).map(|i| {
        let (y, x) = ((i / window) as f32 - c, (i % window) as f32 - c - 2.0);
        (-(y * y + 2.0 * x * x) / window as f32).exp() + 1e-4
    });
    let one: Vec<f32> = one.collect();
    let stack = PsfStack {
        size: window,
        pitch_um: PITCH_UM,
        sample: PsfSample::Integrated,
        samples: one.repeat(heights),
    };
    let height_mm: Vec<f64> = (0..heights).map(|k| FARTHEST_MM * k as f64 / (heights - 1) as f64).collect();
    let mut counts = vec![azimuths; heights];
    counts[0] = 1;
    let grid = NodeGrid::new(&height_mm, &counts, PITCH_UM * 1e-3);
    BandPsf::new(0, grid, NodeKernels::new(&stack, PITCH_UM, None, simd), simd)
}

fn tiles(c: &mut Criterion, name: &str, window: usize, heights: usize, azimuths: usize) {
    let frame = Frame::centred(Size::new(FILM, FILM), Size::new(FILM, FILM), PITCH_UM);
    let mut group = c.benchmark_group(name);
    group.sample_size(10);
    for isa in Isa::ALL {
        let Ok(simd) = Simd::of(isa) else {
            eprintln!("{name}/{}: ignored, this processor has none", isa.name());
            continue;
        };
        let psf = stage(window, heights, azimuths, simd);
        let side = psf.blocks().tile;
        let at = |i: usize| ((FILM - side) * i / (SPREAD - 1)) as i64;
        let rects: Vec<Rect> =
            (0..SPREAD * SPREAD).map(|i| Rect::new(at(i / SPREAD), at(i % SPREAD), side, side)).collect();
        let scene: Vec<f32> = (0..side * side).map(|i| 0.1 + (i * 7919 % 1009) as f32 / 1009.0).collect();
        let cache = SpectrumCache::new(usize::MAX);
        let (mut out, mut scratch) = (Scattered::default(), PsfScratch::default());
        group.throughput(Throughput::Elements((rects.len() * side * side) as u64));
        group.bench_function(isa.name(), |b| {
            b.iter(|| {
                for rect in &rects {
                    psf.scatter(&frame, *rect, &scene, &cache, &mut out, &mut scratch);
                }
            });
        });
    }
    group.finish();
}

fn svpsf(c: &mut Criterion) {
    tiles(c, "svpsf 51 px, 21 x 36 nodes", 51, 21, 36);
    tiles(c, "svpsf 51 px, 81 x 144 nodes", 51, 81, 144);
    tiles(c, "svpsf 151 px, 21 x 36 nodes", 151, 21, 36);
}

criterion_group!(benches, svpsf);
criterion_main!(benches);
