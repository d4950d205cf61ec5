//! What the benches share: core time as the measure, and lenses to measure with.
#![allow(dead_code, missing_docs, reason = "each bench uses its part")]

use criterion::measurement::{Measurement, ValueFormatter, WallTime};
use lenscube_pipeline::lens::{PsfSample, PsfStack};
use lenscube_pipeline::psf::grid::NodeGrid;
use rustix::time::{ClockId, clock_gettime};
use std::time::Duration;

/// Time that the thread has had a core: what other programs take of a busy machine does not count.
pub struct CoreTime;

fn now() -> Duration {
    let t = clock_gettime(ClockId::ThreadCPUTime);
    Duration::new(t.tv_sec as u64, t.tv_nsec as u32)
}

impl Measurement for CoreTime {
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

/// The paper's film: pixels a side, pitch, and the height that its grids reach.
pub const FILM: usize = 14_141;
pub const PITCH_UM: f64 = 2.0;
pub const MAX_MM: f64 = 20.0;

/// A comet on +x, its own mirror image: `window` film pixels wide, `heights` times the same.
pub fn comet(window: usize, pitch_um: f64, sample: PsfSample, heights: usize) -> PsfStack {
    // Point samples just fill their film pixels.
    let size = (window as f64 * PITCH_UM / pitch_um) as usize - usize::from(sample == PsfSample::Point);
    let size = size - usize::from(size.is_multiple_of(2));
    let (c, unit_um) = ((size / 2) as f64, window as f64 / 51.0);
    let one = (0..size * size).map(|i| {
        let at = |index: usize| (index as f64 - c) * pitch_um / unit_um;
        let (y, x) = (at(i / size), at(i % size));
        let spot =
            |cx: f64, a: f64, b: f64| (-((x - cx).powi(2) / (2.0 * a * a) + y * y / (2.0 * b * b))).exp();
        // The skirt is what diffraction leaves all over a window.
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

/// Heights of a traced band, and its azimuths: 5,329 nodes as for an error of 1 % half-way.
pub const TRACED_HEIGHTS: usize = 42;
pub fn traced_azimuths(k: usize) -> usize {
    (16 * k).min(144)
}
