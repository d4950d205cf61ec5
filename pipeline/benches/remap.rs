//! Rate of the remap stage on the benchmark film (14,141² px of 2 µm), in CPU time: one tile halfway out and one at the corner.
//!
//! The lens has 1001 field points and 2 % of distortion at the corner; the chart is in memory. `planar` is the same lens as a map of 129 x 129 nodes, the grid of built
//! lenses.

#[path = "../tests/oracle/mod.rs"]
mod oracle;
mod shared;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use lenscube_pipeline::field::{Field, Outside};
use lenscube_pipeline::flow::{ChartSource, SourceSinkError};
use lenscube_pipeline::geometry::{Frame, Rect, Size};
use lenscube_pipeline::lens::LensBand;
use lenscube_pipeline::lens::planar::PlanarMap;
use lenscube_pipeline::remap::{ChartInterpolation, Remap, RemapScratch};
use lenscube_pipeline::resample::{Interp, Surround};
use lenscube_pipeline::stage::{Stage, Stages};
use shared::{CpuTime, FILM, PITCH_UM, available};

const TILE: usize = 512;

/// A periodic chart in memory.
struct Chart(Vec<f32>);

/// Period in pixels.
const PERIOD: usize = 1024;

impl ChartSource for Chart {
    fn size(&self) -> Size {
        Size::new(FILM, FILM)
    }

    fn read(&self, _band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        for (y, to) in out.chunks_exact_mut(rect.width).enumerate() {
            let row = (rect.y as usize + y) % PERIOD;
            let at = row * 2 * PERIOD + rect.x as usize % PERIOD;
            to.copy_from_slice(&self.0[at..at + rect.width]);
        }
        Ok(())
    }
}

fn lens(last_mm: f64) -> LensBand {
    oracle::lens_band((0..=1000).map(|i| last_mm * f64::from(i) / 1000.0).collect(), 1.0, -0.02)
}

/// The map of `lens` up to `side_mm` from the axis in each direction.
fn planar_map(lens: &LensBand, side_mm: f64) -> PlanarMap {
    let field = Field::new(lens, PITCH_UM * 1e-3, true, true, 1.0);
    let nodes: Vec<f64> = (-64..=64).map(|i| side_mm * f64::from(i) / 64.0).collect();
    let places = || nodes.iter().flat_map(|&y| nodes.iter().map(move |&x| (x, y)));
    let at = |x: f64, y: f64| field.at((x * x + y * y).sqrt() / (PITCH_UM * 1e-3));
    PlanarMap {
        ideal_x_mm: places().map(|(x, y)| x * at(x, y).0).collect(),
        ideal_y_mm: places().map(|(x, y)| y * at(x, y).0).collect(),
        relative_illumination: places().map(|(x, y)| at(x, y).1).collect(),
        x_mm: nodes.clone(),
        y_mm: nodes,
    }
}

fn remap(c: &mut Criterion<CpuTime>) {
    let frame = Frame::centred(Size::new(FILM, FILM), Size::new(FILM, FILM), PITCH_UM);
    let lens = lens(frame.farthest_mm(frame.film.rect()) + 1e-6);
    let chart = Chart((0..2 * PERIOD * PERIOD).map(|i| (i * 7919 % 1009) as f32 / 1009.0).collect());
    let planar = lens.clone().with_map(planar_map(&lens, FILM as f64 / 2.0 * PITCH_UM * 1e-3));
    let half = (FILM / 4) as i64;
    let stages = Stages::of(&[Stage::Ri, Stage::Distortion]);
    for (place, rect) in
        [("halfway", Rect::new(half, half, TILE, TILE)), ("corner", Rect::new(0, 0, TILE, TILE))]
    {
        for interp in [Interp::Bicubic, Interp::Bilinear] {
            let mut group = c.benchmark_group(format!("remap {interp:?} {place}"));
            group.throughput(Throughput::Elements((TILE * TILE) as u64));
            for simd in available() {
                let isa = simd.isa();
                let interpolation =
                    ChartInterpolation { interp, surround: Surround::Edge, outside: Outside::Error };
                let radial = Remap::new(&frame, &lens, stages, interpolation, 1.0, simd);
                let planar = Remap::new(&frame, &planar, stages, interpolation, 1.0, simd);
                for (name, remap) in
                    [(isa.name().to_owned(), radial), (format!("planar {}", isa.name()), planar)]
                {
                    let (mut out, mut s) = (vec![0.0; TILE * TILE], RemapScratch::default());
                    group.bench_function(name, |b| {
                        b.iter(|| remap.apply(&chart, 0, rect, &mut out, &mut s).unwrap());
                    });
                }
            }
            group.finish();
        }
    }
}

criterion_group!(name = benches; config = Criterion::default().with_measurement(CpuTime); targets = remap);
criterion_main!(benches);
