//! Tracing the built-in lens: one PSF, one field point's height and RI, one band's tables.
#![allow(missing_docs)]

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use lenscube_pipeline::design::System;
use lenscube_pipeline::design::illumination::solid_angle_sr;
use lenscube_pipeline::design::psf::{PsfGrid, PsfScratch, PupilFunction};
use lenscube_pipeline::design::ray::Tracer;
use std::hint::black_box;

/// Image height: there the pupil is far from circular.
const HEIGHT_MM: f64 = 17.0;

fn psf(c: &mut Criterion) {
    let system = System::double_gauss_28();
    let mut group = c.benchmark_group("trace one PSF, one thread");
    group.throughput(Throughput::Elements(1));
    // Windows of 99 % of the light, samples finer than Nyquist.
    for (nm, half, pitch_um) in [(400.0, 341, 0.5), (550.0, 80, 2.0 / 3.0)] {
        let tracer = Tracer::new(&system, nm / 1e3).unwrap();
        let tan = tracer.field_of_height(HEIGHT_MM).unwrap();
        let grid = PsfGrid::new(half, pitch_um);
        let mut scratch = PsfScratch::default();
        for (rotation, azimuth) in [("unrotated", 0.0), ("rotated", 0.7)] {
            group.bench_function(format!("{nm} nm, {} samples a side, {rotation}", grid.size()), |b| {
                b.iter(|| {
                    let f = PupilFunction::trace(&tracer, black_box(tan)).unwrap();
                    grid.psf(&f, azimuth, &mut scratch)
                });
            });
        }
    }
    group.finish();
}

fn field_point(c: &mut Criterion) {
    let system = System::double_gauss_28();
    let tracer = Tracer::new(&system, 0.55).unwrap();
    let tan = tracer.field_of_height(HEIGHT_MM).unwrap();
    let mut group = c.benchmark_group("trace one field point");
    group.throughput(Throughput::Elements(1));
    group.bench_function("real height", |b| b.iter(|| tracer.chief_height_mm(black_box(tan)).unwrap()));
    group.bench_function("field of a height", |b| {
        b.iter(|| tracer.field_of_height(black_box(HEIGHT_MM)).unwrap())
    });
    group.bench_function("relative illumination", |b| {
        b.iter(|| solid_angle_sr(&tracer, black_box(tan)).unwrap())
    });
    group.finish();
}

criterion_group!(benches, psf, field_point);
criterion_main!(benches);
