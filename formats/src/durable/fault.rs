//! Fault injection for tests of the program. Debug builds only.
//!
//! `LENSCUBE_FAULT=STEP:N:FAULT` injects FAULT at the N-th execution (from 1) of STEP in the process: `create`, `write`, `sync`,
//! `rename`, `sync-directory`, `remove`, `read`, `publish`, `sweep`, or `any` of them. FAULT is an errno (`28`: no space left),
//! `kill` (SIGKILL before the step), `stop` (SIGSTOP before it), `torn` (a write of half the bytes, then SIGKILL) or `short`
//! (a write of half the bytes that reports success). With a `+` after N it is injected at every later execution as well:
//! `write:3+:28`. Several faults are separated by commas and counted separately.
//!
//! STEP may also be a named point of the program ([`point`]), at which `stop` suspends the process until SIGCONT and `kill` ends it.
//! `any` does not include them. Points: `film-opened`, `job-ready` (chart opened, lens traced), `locked`, `tiles-begin`, `commit`
//! (before the film's identity is checked), `commit-checked` (after that, before the write), `film-removed` (`--overwrite`,
//! before the new film is created), `shards-made` (before the end of the run is reported), `verified`, `shard-aside`
//! (`verify --repair`); of `sensor`: `raw-removed` (`--overwrite`), `shards-begin`, `file-begins` (the raw is complete, its DNG, TIFF or
//! PNG is not).

#[cfg(not(debug_assertions))]
mod disabled {
    use super::super::step::FileStep;

    pub(in super::super) const fn inject(_: FileStep) -> std::io::Result<()> {
        Ok(())
    }

    /// No effect in a release build.
    pub const fn point(_: &'static str) {}

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
    use std::io::Error;
    use std::sync::OnceLock;
    use std::sync::atomic::{AtomicU64, Ordering};

    #[derive(Clone, Copy, PartialEq)]
    enum Kind {
        Kill,
        Stop,
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
                "torn" => Kind::Torn,
                "short" => Kind::Short,
                errno => Kind::Errno(errno.parse().unwrap_or_else(|_| malformed())),
            },
            executions: AtomicU64::new(0),
        }
    }

    /// Counts one execution of `name` and returns the fault to inject there; `any` matches steps, not points.
    fn due(name: &str, is_step: bool) -> Option<Kind> {
        let mut due = None;
        for fault in faults() {
            if fault.step != name && !(is_step && fault.step == "any") {
                continue;
            }
            let n = fault.executions.fetch_add(1, Ordering::SeqCst) + 1;
            if due.is_none() && (n == fault.first || (fault.repeated && n > fault.first)) {
                eprintln!("fault injected by LENSCUBE_FAULT at {name} {n}");
                due = Some(fault.kind);
            }
        }
        due
    }

    fn signal(signal: rustix::process::Signal) {
        let _ = rustix::process::kill_process(rustix::process::getpid(), signal);
        // SIGKILL may be delivered after the next instruction.
        if signal == rustix::process::Signal::KILL {
            loop {
                std::thread::park();
            }
        }
    }

    fn act(kind: Kind) -> std::io::Result<()> {
        use rustix::process::Signal;
        match kind {
            Kind::Kill | Kind::Torn => signal(Signal::KILL),
            Kind::Stop => signal(Signal::STOP),
            Kind::Short => (),
            Kind::Errno(errno) => return Err(Error::from_raw_os_error(errno)),
        }
        Ok(())
    }

    pub(in super::super) fn inject(step: FileStep) -> std::io::Result<()> {
        due(step.name(), true).map_or(Ok(()), act)
    }

    /// Point of the program at which a test may suspend (`stop`) or end (`kill`) the process.
    pub fn point(name: &'static str) {
        match due(name, false) {
            Some(kind @ (Kind::Stop | Kind::Kill)) => act(kind).expect("a signal is no error"),
            Some(_) => panic!("LENSCUBE_FAULT: {name} takes stop or kill"),
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
pub use disabled::point;
#[cfg(not(debug_assertions))]
pub(super) use disabled::{inject, write};
#[cfg(debug_assertions)]
pub use enabled::point;
#[cfg(debug_assertions)]
pub(super) use enabled::{inject, write};
