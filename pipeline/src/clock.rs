//! Time of a run by phase, summed over all threads: wall time and CPU time.
//!
//! The two differ by waiting, for the disk or for a core. Σ CPU time / cores is a lower bound of a run's duration. Threads that a phase starts for its
//! own work belong to it (`on_threads`).

use crate::flow::{ChartSource, SourceSinkError};
use crate::geometry::{Rect, Size};
use rustix::time::{ClockId, clock_gettime};
use std::cell::Cell;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Instant;

/// A phase of a run whose time is counted: a stage, or what every film takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Reading and decoding the chart.
    Read,
    /// RI, distortion and interpolation.
    Remap,
    /// SVPSF, including kernels and spectra.
    Svpsf,
    /// Overlap-add.
    Add,
    /// Encoding shards.
    Encode,
    /// Writing shards.
    Write,
    /// Preparing bands: PSF stacks and their splines, outside the workers.
    Prepare,
}

impl Phase {
    /// All, in the order of records.
    pub const ALL: [Self; 7] =
        [Self::Read, Self::Remap, Self::Svpsf, Self::Add, Self::Encode, Self::Write, Self::Prepare];

    /// Its name in records.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Read => "read",
            Self::Remap => "remap",
            Self::Svpsf => "svpsf",
            Self::Add => "add",
            Self::Encode => "encode",
            Self::Write => "write",
            Self::Prepare => "prepare",
        }
    }
}

/// Seconds of each phase, summed over threads.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PhaseTimes([f64; Phase::ALL.len()]);

impl PhaseTimes {
    /// Seconds of `phase`.
    pub const fn of(&self, phase: Phase) -> f64 {
        self.0[phase as usize]
    }
}

/// Time counters of one phase.
#[derive(Debug, Default)]
pub(crate) struct PhaseClock {
    wall_ns: AtomicU64,
    cpu_ns: AtomicU64,
}

impl PhaseClock {
    /// Runs `f` and adds its time.
    pub(crate) fn time<T>(&self, f: impl FnOnce() -> T) -> T {
        let (wall, cpu) = (Instant::now(), phase_cpu_ns());
        let value = f();
        self.cpu_ns.fetch_add(phase_cpu_ns() - cpu, Relaxed);
        self.wall_ns.fetch_add(wall.elapsed().as_nanos() as u64, Relaxed);
        value
    }
}

thread_local! {
    /// CPU time of the threads that this thread has started with [`on_threads`], ns.
    static HELPERS_NS: Cell<u64> = const { Cell::new(0) };
}

/// Runs `work` on `threads` threads at the same time, one of them this one, whose phase their CPU time is part of.
pub(crate) fn on_threads(threads: usize, work: impl Fn() + Sync) {
    let helpers_ns = AtomicU64::new(0);
    std::thread::scope(|scope| {
        for _ in 1..threads.max(1) {
            scope.spawn(|| {
                work();
                helpers_ns.fetch_add(phase_cpu_ns(), Relaxed);
            });
        }
        work();
    });
    HELPERS_NS.set(HELPERS_NS.get() + helpers_ns.into_inner());
}

/// Runs `here` on this thread and `there` on another one at the same time; both are part of the phase of this one.
pub fn at_once<A, B: Send>(here: impl FnOnce() -> A, there: impl FnOnce() -> B + Send) -> (A, B) {
    let (found, other) = std::thread::scope(|scope| {
        let other = scope.spawn(|| (there(), phase_cpu_ns()));
        (here(), other.join())
    });
    let (other, other_ns) = other.unwrap_or_else(|panic| std::panic::resume_unwind(panic));
    HELPERS_NS.set(HELPERS_NS.get() + other_ns);
    (found, other)
}

/// CPU time of this thread and of those that it has started, ns.
fn phase_cpu_ns() -> u64 {
    thread_cpu_ns() + HELPERS_NS.get()
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

/// Clocks of all phases. Reading is a part of the remap phase and is subtracted from it in [`PhaseTimes`].
#[derive(Debug, Default)]
pub struct Clock([PhaseClock; Phase::ALL.len()]);

impl Clock {
    /// The counters of `phase`.
    pub(crate) const fn of(&self, phase: Phase) -> &PhaseClock {
        &self.0[phase as usize]
    }

    /// Wall time.
    pub(crate) fn wall(&self) -> PhaseTimes {
        self.times(|s| &s.wall_ns)
    }

    /// CPU time.
    pub(crate) fn core(&self) -> PhaseTimes {
        self.times(|s| &s.cpu_ns)
    }

    fn times(&self, counter: impl Fn(&PhaseClock) -> &AtomicU64) -> PhaseTimes {
        let mut seconds = Phase::ALL.map(|phase| counter(self.of(phase)).load(Relaxed) as f64 * 1e-9);
        seconds[Phase::Remap as usize] -= seconds[Phase::Read as usize];
        PhaseTimes(seconds)
    }
}

/// A chart whose reading time is measured.
pub(crate) struct TimedChart<'a> {
    chart: &'a dyn ChartSource,
    read: &'a PhaseClock,
}

impl<'a> TimedChart<'a> {
    /// `chart`, its time added to `clock`.
    pub(crate) fn new(chart: &'a dyn ChartSource, clock: &'a Clock) -> Self {
        Self { chart, read: clock.of(Phase::Read) }
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
        let phase = PhaseClock::default();
        phase.time(|| std::thread::sleep(std::time::Duration::from_millis(30)));
        let (wall, cpu) = (phase.wall_ns.load(Relaxed), phase.cpu_ns.load(Relaxed));
        assert!(wall >= 30_000_000 && cpu < wall / 3, "wall {wall} ns, CPU {cpu} ns");
    }

    #[test]
    fn threads_of_a_phase_are_part_of_it() {
        // Each thread computes for 20 ms of its own CPU time.
        let work = || {
            let start = thread_cpu_ns();
            while thread_cpu_ns() - start < 20_000_000 {}
        };
        let phase = PhaseClock::default();
        phase.time(|| on_threads(3, work));
        let cpu = phase.cpu_ns.load(Relaxed);
        assert!(cpu >= 60_000_000, "{cpu} ns");
    }
}
