//! Where a run's time goes, stage by stage, over all its threads: by the wall, and in seconds of a core.
//!
//! The two differ by waiting: for the disk, or for a core that another thread has. Σ core seconds / cores bounds the run
//! from below, whatever overlaps.

use crate::flow::{ChartSource, SourceSinkError};
use crate::geometry::{Rect, Size};
use rustix::time::{ClockId, clock_gettime};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Instant;

/// Seconds per stage, summed over threads.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StageTimes {
    /// Reading and decoding the chart.
    pub read_s: f64,
    /// RI, distortion and interpolation.
    pub remap_s: f64,
    /// SVPSF, kernels and spectra included.
    pub svpsf_s: f64,
    /// Adding tails.
    pub add_s: f64,
    /// Encoding shards.
    pub encode_s: f64,
    /// Writing shards.
    pub write_s: f64,
    /// Preparing bands: PSF stacks and their splines, beside the workers.
    pub prepare_s: f64,
}

impl StageTimes {
    /// All of them together.
    pub fn total_s(&self) -> f64 {
        self.read_s + self.remap_s + self.svpsf_s + self.add_s + self.encode_s + self.write_s + self.prepare_s
    }
}

/// A stage's counters, in ns.
#[derive(Debug, Default)]
pub(crate) struct Stage {
    wall: AtomicU64,
    core: AtomicU64,
}

impl Stage {
    /// Runs `f` on this stage's account.
    pub(crate) fn time<T>(&self, f: impl FnOnce() -> T) -> T {
        let (wall, core) = (Instant::now(), core_ns());
        let value = f();
        self.core.fetch_add(core_ns() - core, Relaxed);
        self.wall.fetch_add(wall.elapsed().as_nanos() as u64, Relaxed);
        value
    }
}

/// Time that this thread has had a core, ns.
fn core_ns() -> u64 {
    let t = clock_gettime(ClockId::ThreadCPUTime);
    t.tv_sec as u64 * 1_000_000_000 + t.tv_nsec as u64
}

/// All stages. Reading happens inside the remap stage and is taken out of it.
#[derive(Debug, Default)]
pub struct Clock {
    pub(crate) read: Stage,
    pub(crate) remap: Stage,
    pub(crate) svpsf: Stage,
    pub(crate) add: Stage,
    pub(crate) encode: Stage,
    pub(crate) write: Stage,
    pub(crate) prepare: Stage,
}

impl Clock {
    /// By the wall.
    pub(crate) fn wall(&self) -> StageTimes {
        self.times(|s| &s.wall)
    }

    /// In seconds of a core.
    pub(crate) fn core(&self) -> StageTimes {
        self.times(|s| &s.core)
    }

    fn times(&self, of: impl Fn(&Stage) -> &AtomicU64) -> StageTimes {
        let seconds = |s: &Stage| of(s).load(Relaxed) as f64 * 1e-9;
        StageTimes {
            read_s: seconds(&self.read),
            remap_s: seconds(&self.remap) - seconds(&self.read),
            svpsf_s: seconds(&self.svpsf),
            add_s: seconds(&self.add),
            encode_s: seconds(&self.encode),
            write_s: seconds(&self.write),
            prepare_s: seconds(&self.prepare),
        }
    }
}

/// A chart whose reading time is counted apart from resampling.
pub(crate) struct TimedChart<'a> {
    chart: &'a dyn ChartSource,
    read: &'a Stage,
}

impl<'a> TimedChart<'a> {
    /// `chart`, its time on `clock`.
    pub(crate) fn new(chart: &'a dyn ChartSource, clock: &'a Clock) -> Self {
        Self { chart, read: &clock.read }
    }
}

impl ChartSource for TimedChart<'_> {
    fn size(&self) -> Size {
        self.chart.size()
    }
    fn read(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        self.read.time(|| self.chart.read(band, rect, out))
    }
    fn prefetch(&self, band: usize, rect: Rect) {
        self.read.time(|| self.chart.prefetch(band, rect));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waiting_takes_no_core() {
        let stage = Stage::default();
        stage.time(|| std::thread::sleep(std::time::Duration::from_millis(30)));
        let (wall, core) = (stage.wall.load(Relaxed), stage.core.load(Relaxed));
        assert!(wall >= 30_000_000 && core < wall / 3, "wall {wall} ns, core {core} ns");
    }
}
