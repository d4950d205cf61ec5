//! Time of a run by stage, summed over all threads: wall time and CPU time.
//!
//! The two differ by waiting, for the disk or for a core. Σ CPU time / cores is a lower bound of a run's duration.

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
    /// SVPSF, including kernels and spectra.
    pub svpsf_s: f64,
    /// Overlap-add.
    pub add_s: f64,
    /// Encoding shards.
    pub encode_s: f64,
    /// Writing shards.
    pub write_s: f64,
    /// Preparing bands: PSF stacks and their splines, outside the workers.
    pub prepare_s: f64,
}

/// Time counters of one stage.
#[derive(Debug, Default)]
pub(crate) struct StageClock {
    wall_ns: AtomicU64,
    cpu_ns: AtomicU64,
}

impl StageClock {
    /// Runs `f` and adds its time.
    pub(crate) fn time<T>(&self, f: impl FnOnce() -> T) -> T {
        let (wall, cpu) = (Instant::now(), thread_cpu_ns());
        let value = f();
        self.cpu_ns.fetch_add(thread_cpu_ns() - cpu, Relaxed);
        self.wall_ns.fetch_add(wall.elapsed().as_nanos() as u64, Relaxed);
        value
    }
}

/// CPU time of this thread, s.
pub(crate) fn thread_cpu_s() -> f64 {
    thread_cpu_ns() as f64 * 1e-9
}

/// CPU time of this thread, ns.
fn thread_cpu_ns() -> u64 {
    let t = clock_gettime(ClockId::ThreadCPUTime);
    t.tv_sec as u64 * 1_000_000_000 + t.tv_nsec as u64
}

/// Clocks of all stages. Reading is part of the remap stage and is subtracted from it in [`StageTimes`].
#[derive(Debug, Default)]
pub struct Clock {
    pub(crate) read: StageClock,
    pub(crate) remap: StageClock,
    pub(crate) svpsf: StageClock,
    pub(crate) add: StageClock,
    pub(crate) encode: StageClock,
    pub(crate) write: StageClock,
    pub(crate) prepare: StageClock,
}

impl Clock {
    /// Wall time.
    pub(crate) fn wall(&self) -> StageTimes {
        self.times(|s| &s.wall_ns)
    }

    /// CPU time.
    pub(crate) fn core(&self) -> StageTimes {
        self.times(|s| &s.cpu_ns)
    }

    fn times(&self, counter: impl Fn(&StageClock) -> &AtomicU64) -> StageTimes {
        let seconds = |s: &StageClock| counter(s).load(Relaxed) as f64 * 1e-9;
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

/// A chart whose reading time is measured.
pub(crate) struct TimedChart<'a> {
    chart: &'a dyn ChartSource,
    read: &'a StageClock,
}

impl<'a> TimedChart<'a> {
    /// `chart`, its time added to `clock`.
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
    fn waiting_takes_no_cpu_time() {
        let stage = StageClock::default();
        stage.time(|| std::thread::sleep(std::time::Duration::from_millis(30)));
        let (wall, cpu) = (stage.wall_ns.load(Relaxed), stage.cpu_ns.load(Relaxed));
        assert!(wall >= 30_000_000 && cpu < wall / 3, "wall {wall} ns, CPU {cpu} ns");
    }
}
