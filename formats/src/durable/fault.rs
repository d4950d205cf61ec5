//! Fault injection for tests of the program. Debug builds only.
//!
//! `LENSCUBE_FAULT=STEP:N:FAULT` injects FAULT at the N-th execution (from 1) of STEP in the process: `create`, `write`, `sync`,
//! `rename`, `sync-directory`, `remove`, `read`, `publish`, `sweep`, or `any` of them. FAULT is an errno (`28`: no space left),
//! `kill` (SIGKILL before the step), `stop` (SIGSTOP before it), `interrupt` or `terminate` (SIGINT or SIGTERM before it, of which the step
//! waits until the program has handled it: [`signal_handled`]), `torn` (a write of half the bytes, then SIGKILL) or `short`
//! (a write of half the bytes that reports success). With a `+` after N it is injected at every later execution as well:
//! `write:3+:28`. Several faults are separated by commas and counted separately.
//!
//! With `+`, `interrupt` and `terminate` send one signal; the later executions wait for it as well.
//!
//! STEP may also be a named point of the program ([`point`]), at which `stop` suspends the process until SIGCONT, `kill` ends it, and
//! `interrupt` and `terminate` are as above.
//! `any` does not include them. Points: `film-opened`, `tracing` (before a lens is traced), `job-ready` (chart opened, lens traced), `locked`, `tiles-begin`, `commit`
//! (before the film's identity is checked), `commit-checked` (after that, before the write), `batch-staged` (before the files of a batch
//! are flushed), `batch-flushed` (before they have their names), `film-removed` (`--overwrite`,
//! before the new film is created), `layer-made` and `layer-committed` (a layer of light of a band), `shards-made` (before the end of the run is reported), `verified`, `shard-aside`
//! (`verify --repair`); `export-reads` (each part of the chart); of `sensor`: `raw-removed` (`--overwrite`), `shards-begin`,
//! `file-begins` (the raw is complete, its DNG, TIFF or PNG is not).

#[cfg(not(debug_assertions))]
mod disabled {
    use super::super::step::FileStep;

    pub(in super::super) const fn inject(_: FileStep) -> std::io::Result<()> {
        Ok(())
    }

    /// No effect in a release build.
    pub const fn point(_: &'static str) {}

    /// No effect in a release build.
    pub const fn signal_handled() {}

    pub(in super::super) fn write(
        bytes: &[u8],
        write: &mut dyn FnMut(&[u8]) -> std::io::Result<()>,
    ) -> std::io::Result<()> {
        write(bytes)
    }
}

#[cfg(debug_assertions)]
mod enabled {
    use super::super::step::FileStep;
    use rustix::process::Signal;
    use std::io::Error;
    use std::sync::atomic::{AtomicU64, Ordering};
    use std::sync::{Condvar, Mutex, OnceLock};

    #[derive(Clone, Copy, PartialEq)]
    enum Kind {
        Kill,
        Stop,
        /// Whether it is sent, or awaited only.
        Signal(Signal, bool),
        Torn,
        Short,
        Errno(i32),
    }

    struct Fault {
        step: String,
        /// First execution of the step at which it is injected, from 1.
        first: u64,
        /// Also at every later execution.
        repeated: bool,
        kind: Kind,
        executions: AtomicU64,
    }

    fn faults() -> &'static [Fault] {
        static FAULTS: OnceLock<Vec<Fault>> = OnceLock::new();
        FAULTS.get_or_init(|| {
            let text = std::env::var("LENSCUBE_FAULT").unwrap_or_default();
            text.split(',').filter(|part| !part.is_empty()).map(parse).collect()
        })
    }

    fn parse(text: &str) -> Fault {
        let malformed = || panic!("LENSCUBE_FAULT={text}: expected STEP:N:FAULT");
        let [step, n, kind] = text.split(':').collect::<Vec<_>>()[..] else { malformed() };
        Fault {
            step: step.into(),
            first: n.trim_end_matches('+').parse().unwrap_or_else(|_| malformed()),
            repeated: n.ends_with('+'),
            kind: match kind {
                "kill" => Kind::Kill,
                "stop" => Kind::Stop,
                "interrupt" => Kind::Signal(Signal::INT, true),
                "terminate" => Kind::Signal(Signal::TERM, true),
                "torn" => Kind::Torn,
                "short" => Kind::Short,
                errno => Kind::Errno(errno.parse().unwrap_or_else(|_| malformed())),
            },
            executions: AtomicU64::new(0),
        }
    }

    #[allow(clippy::print_stderr, reason = "debug builds only")]
    /// Counts one execution of `name` and returns the fault to inject there; `any` matches steps, not points.
    fn due(name: &str, is_step: bool) -> Option<Kind> {
        /// Held while an execution is counted, which is then the same one of every fault.
        static COUNTING: Mutex<()> = Mutex::new(());
        let _counting = COUNTING.lock().expect("no panic while held");
        let mut due = None;
        for fault in faults() {
            if fault.step != name && !(is_step && fault.step == "any") {
                continue;
            }
            let n = fault.executions.fetch_add(1, Ordering::SeqCst) + 1;
            if due.is_none() && (n == fault.first || (fault.repeated && n > fault.first)) {
                eprintln!("fault injected by LENSCUBE_FAULT at {name} {n}");
                due = Some(match fault.kind {
                    Kind::Signal(signal, _) => Kind::Signal(signal, n == fault.first),
                    kind => kind,
                });
            }
        }
        due
    }

    /// Signals of faults that the program has not handled yet.
    static UNHANDLED: Mutex<u64> = Mutex::new(0);
    static HANDLED: Condvar = Condvar::new();

    /// Sends a signal that the program handles, after the earlier ones were handled, and waits until none is unhandled.
    fn interrupt(signal: Signal, send: bool) {
        let none = |unhandled: &mut u64| *unhandled > 0;
        let unhandled = UNHANDLED.lock().expect("no panic while held");
        let mut unhandled = HANDLED.wait_while(unhandled, none).expect("no panic while held");
        if send {
            *unhandled += 1;
            let _ = rustix::process::kill_process(rustix::process::getpid(), signal);
            drop(HANDLED.wait_while(unhandled, none));
        }
    }

    /// The program has handled a signal: the faults that wait for it go on.
    pub fn signal_handled() {
        let mut unhandled = UNHANDLED.lock().expect("no panic while held");
        *unhandled = unhandled.saturating_sub(1);
        HANDLED.notify_all();
    }

    /// Sends a signal to this process. Another thread may take it: this one goes no further until it takes effect.
    fn signal(signal: Signal) {
        let _ = rustix::process::kill_process(rustix::process::getpid(), signal);
        if signal == Signal::KILL {
            loop {
                std::thread::park();
            }
        }
        // The thread that takes SIGSTOP marks all others in the same step: this one stops at the end of the call that finds it taken.
        while is_pending(signal) {
            std::thread::yield_now();
        }
    }

    /// Whether a signal of this process has been taken by no thread yet.
    fn is_pending(signal: Signal) -> bool {
        let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
        let pending = status.lines().find_map(|line| line.strip_prefix("ShdPnd:"));
        let pending = pending.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
        pending.unwrap_or(0) >> (signal.as_raw() - 1) & 1 == 1
    }

    fn act(kind: Kind) -> std::io::Result<()> {
        match kind {
            Kind::Kill | Kind::Torn => signal(Signal::KILL),
            Kind::Stop => signal(Signal::STOP),
            Kind::Signal(signal, send) => interrupt(signal, send),
            Kind::Short => (),
            Kind::Errno(errno) => return Err(Error::from_raw_os_error(errno)),
        }
        Ok(())
    }

    pub(in super::super) fn inject(step: FileStep) -> std::io::Result<()> {
        due(step.name(), true).map_or(Ok(()), act)
    }

    /// Point of the program at which a test may suspend (`stop`), interrupt or end (`kill`) the process.
    pub fn point(name: &'static str) {
        match due(name, false) {
            Some(kind @ (Kind::Stop | Kind::Kill | Kind::Signal(..))) => {
                act(kind).expect("a signal is no error")
            }
            Some(_) => panic!("LENSCUBE_FAULT: {name} takes stop, kill, interrupt or terminate"),
            None => (),
        }
    }

    pub(in super::super) fn write(
        bytes: &[u8],
        write: &mut dyn FnMut(&[u8]) -> std::io::Result<()>,
    ) -> std::io::Result<()> {
        let Some(kind) = due(FileStep::Write.name(), true) else { return write(bytes) };
        if matches!(kind, Kind::Torn | Kind::Short) {
            write(&bytes[..bytes.len() / 2])?;
        }
        act(kind)?;
        if kind == Kind::Short { Ok(()) } else { write(bytes) }
    }
}

#[cfg(not(debug_assertions))]
pub(super) use disabled::{inject, write};
#[cfg(not(debug_assertions))]
pub use disabled::{point, signal_handled};
#[cfg(debug_assertions)]
pub(super) use enabled::{inject, write};
#[cfg(debug_assertions)]
pub use enabled::{point, signal_handled};
