//! Shared by the benches: CPU time as the measurement, and test lenses.
#![allow(dead_code, missing_docs, reason = "each bench uses its part")]

use criterion::measurement::{Measurement, ValueFormatter, WallTime};
use lenscube_pipeline::lens::{PsfSample, PsfStack};
use lenscube_pipeline::psf::grid::NodeGrid;
use lenscube_pipeline::simd::{Isa, Simd};
use rustix::time::{ClockId, clock_gettime};
use std::time::Duration;

/// CPU time of the thread: independent of other programs on the machine.
pub struct CpuTime;

fn now() -> Duration {
    let t = clock_gettime(ClockId::ThreadCPUTime);
    Duration::new(t.tv_sec as u64, t.tv_nsec as u32)
}

impl Measurement for CpuTime {
    type Intermediate = Duration;
    type Value = Duration;

    fn start(&self) -> Duration {
        now()
    }
    fn end(&self, start: Duration) -> Duration {
        now() - start
    }
    fn add(&self, a: &Duration, b: &Duration) -> Duration {
        *a + *b
    }
    fn zero(&self) -> Duration {
        Duration::ZERO
    }
    fn to_f64(&self, value: &Duration) -> f64 {
        value.as_nanos() as f64
    }
    fn formatter(&self) -> &dyn ValueFormatter {
        WallTime.formatter()
    }
}

/// The instruction sets of this processor, the fastest first; the others are reported.
pub fn available() -> impl Iterator<Item = Simd> {
    let require = |isa| Simd::require(isa).map_err(|e| eprintln!("skipped: {e}"));
    Isa::ALL.into_iter().filter_map(move |isa| require(isa).ok())
}

/// The benchmark film: pixels a side, pitch, and the largest height of node grids.
pub const FILM: usize = 14_141;
pub const PITCH_UM: f64 = 2.0;
pub const MAX_MM: f64 = 20.0;

/// PSFs with coma along +x, symmetric about the meridian: `window` film pixels wide, the same for all `heights`.
pub fn comet(window: usize, pitch_um: f64, sample: PsfSample, heights: usize) -> PsfStack {
    // Point samples end at the border of the film window.
    let size = (window as f64 * PITCH_UM / pitch_um) as usize - usize::from(sample == PsfSample::Point);
    let size = size - usize::from(size.is_multiple_of(2));
    let (c, unit_um) = ((size / 2) as f64, window as f64 / 51.0);
    let one = (0..size * size).map(|i| {
        let at = |index: usize| (index as f64 - c) * pitch_um / unit_um;
        let (y, x) = (at(i / size), at(i % size));
        let spot =
            |cx: f64, a: f64, b: f64| (-((x - cx).powi(2) / (2.0 * a * a) + y * y / (2.0 * b * b))).exp();
        // The last term is the diffraction background.
        spot(0.4, 1.3, 0.9) + 0.2 * spot(6.0, 4.0, 2.0) + 1e-3 / (1.0 + x * x + y * y)
    });
    let one: Vec<f64> = one.collect();
    let sum: f64 = one.iter().sum();
    let one: Vec<f32> = one.iter().map(|v| (v / sum) as f32).collect();
    PsfStack { size, pitch_um, sample, samples: one.repeat(heights) }
}

/// Evenly spaced heights, `count(k)` azimuths on each but the axis.
pub fn grid(heights: usize, count: impl Fn(usize) -> usize) -> NodeGrid {
    let height_mm: Vec<f64> = (0..heights).map(|k| MAX_MM * k as f64 / (heights - 1) as f64).collect();
    let counts: Vec<usize> = (0..heights).map(|k| if k == 0 { 1 } else { count(k) }).collect();
    NodeGrid::new(&height_mm, &counts, PITCH_UM * 1e-3)
}

/// Heights and azimuths of a traced band: 5,329 nodes, for an error of 1 % half-way between nodes.
pub const TRACED_HEIGHTS: usize = 42;
pub fn traced_azimuths(k: usize) -> usize {
    (16 * k).min(144)
}
