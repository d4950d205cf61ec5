//! Rate of SVPSF on the benchmark film (14,141² px of 2 µm), in CPU time of one thread.
//!
//! The benchmark grid has 21 heights × 36 azimuths and a window of 51 px; a finer grid and a wider window are measured as well, all on
//! tiles spread over the film with spectra in the cache. Then a complete band of a traced lens: point samples of 0.5 µm, 5,329 nodes, and
//! an empty cache of 256 MiB, so that kernels and spectra are included.

mod shared;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use lenscube_pipeline::buffer::TileBuffer;
use lenscube_pipeline::geometry::{Frame, Rect, Size};
use lenscube_pipeline::lens::{PsfSample, PsfStack};
use lenscube_pipeline::psf::grid::NodeGrid;
use lenscube_pipeline::psf::kernel::NodeKernels;
use lenscube_pipeline::psf::spectra::SpectrumCache;
use lenscube_pipeline::psf::{BandPsf, PsfScratch};
use lenscube_pipeline::simd::Isa;
use shared::{CpuTime, FILM, PITCH_UM, TRACED_HEIGHTS, available, comet, grid, traced_azimuths};

/// Timed tiles along each side of the film.
const SPREAD: usize = 7;

/// Times tiles spread over the film with an unlimited cache, or the complete film from an empty cache.
fn tiles(c: &mut Criterion<CpuTime>, name: &str, stack: &PsfStack, grid: &NodeGrid, whole_film: bool) {
    let frame = Frame::centred(Size::new(FILM, FILM), Size::new(FILM, FILM), PITCH_UM);
    let mut group = c.benchmark_group(name);
    group.sample_size(10);
    for simd in available() {
        let isa = simd.isa();
        if whole_film && isa == Isa::Portable {
            continue; // takes minutes
        }
        let psf = BandPsf::new(0, grid.clone(), NodeKernels::new(stack, PITCH_UM, None, simd), simd);
        let side = psf.blocks().tile;
        let at = |i: usize| ((FILM - side) * i / (SPREAD - 1)) as i64;
        let rects: Vec<Rect> = match whole_film {
            true => frame.film.rect().tiles(side, side).collect(),
            false => {
                (0..SPREAD * SPREAD).map(|i| Rect::new(at(i / SPREAD), at(i % SPREAD), side, side)).collect()
            }
        };
        let remapped: Vec<f32> = (0..side * side).map(|i| 0.1 + (i * 7919 % 1009) as f32 / 1009.0).collect();
        let mut cache = SpectrumCache::new(usize::MAX);
        let (mut out, mut scratch) = (TileBuffer::default(), PsfScratch::default());
        let pixels: usize = rects.iter().map(|r| r.size().pixels()).sum();
        group.throughput(Throughput::Elements(pixels as u64));
        group.bench_function(isa.name(), |b| {
            b.iter(|| {
                if whole_film {
                    cache = SpectrumCache::new(256 << 20);
                }
                for rect in &rects {
                    psf.scatter(
                        &frame,
                        *rect,
                        &remapped[..rect.size().pixels()],
                        &cache,
                        &mut out,
                        &mut scratch,
                    );
                }
            });
        });
    }
    group.finish();
}

fn svpsf(c: &mut Criterion<CpuTime>) {
    let integrated = |window, heights| comet(window, PITCH_UM, PsfSample::Integrated, heights);
    tiles(c, "svpsf 51 px, 21 x 36 nodes", &integrated(51, 21), &grid(21, |_| 36), false);
    tiles(c, "svpsf 51 px, 81 x 144 nodes", &integrated(51, 81), &grid(81, |_| 144), false);
    tiles(c, "svpsf 151 px, 21 x 36 nodes", &integrated(151, 21), &grid(21, |_| 36), false);
    for window in [51, 151] {
        let stack = comet(window, 0.5, PsfSample::Point, TRACED_HEIGHTS);
        let name = format!("svpsf {window} px, traced, from an empty cache");
        tiles(c, &name, &stack, &grid(TRACED_HEIGHTS, traced_azimuths), true);
    }
}

criterion_group!(name = benches; config = Criterion::default().with_measurement(CpuTime); targets = svpsf);
criterion_main!(benches);
