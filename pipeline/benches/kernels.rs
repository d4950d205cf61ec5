//! Cost of preparing a node, in CPU time: its base kernel (rotated and integrated), and the spectrum of its kernel.
//!
//! Point samples of 0.5 µm, as traced lenses have them, for windows of 51 and 151 film pixels.

mod shared;

use criterion::{Criterion, criterion_group, criterion_main};
use lenscube_pipeline::lens::PsfSample;
use lenscube_pipeline::psf::BandPsf;
use lenscube_pipeline::psf::grid::Node;
use lenscube_pipeline::psf::kernel::{KernelScratch, NodeKernels};
use lenscube_pipeline::psf::spectra::SpectrumCache;
use shared::{CpuTime, PITCH_UM, available, comet, grid, traced_azimuths};

fn kernels(c: &mut Criterion<CpuTime>) {
    for window in [51, 151] {
        let stack = comet(window, 0.5, PsfSample::Point, 2);
        // Two heights: of the nodes only the second's azimuth matters here.
        let nodes = grid(2, |_| traced_azimuths(9));
        for simd in available() {
            let isa = simd.isa();
            let kernels = NodeKernels::new(&stack, PITCH_UM, None, simd);
            let mut group =
                c.benchmark_group(format!("base kernel of {window} px from {} samples", stack.size));
            group.sample_size(10);
            let mut scratch = KernelScratch::default();
            group.bench_function(isa.name(), |b| {
                b.iter(|| kernels.base_kernel(&nodes, Node { k: 1, j: 7 }, &mut scratch)[0]);
            });
            group.finish();
            let psf = BandPsf::new(0, grid(42, traced_azimuths), kernels, simd);
            let mut group = c.benchmark_group(format!("spectrum of {window} px, F = {}", psf.blocks().fft));
            group.sample_size(10);
            // The cache keeps one spectrum, so alternating between two nodes builds one each time. Their kernels are unrotated.
            let (cache, mut k) = (SpectrumCache::new(0), 0);
            group.bench_function(isa.name(), |b| {
                b.iter(|| {
                    k = 1 - k;
                    psf.prepare(Node { k, j: 0 }, &cache);
                });
            });
            group.finish();
        }
    }
}

criterion_group!(name = benches; config = Criterion::default().with_measurement(CpuTime); targets = kernels);
criterion_main!(benches);
