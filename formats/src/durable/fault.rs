//! Faults on demand, so that tests can make the real program meet them. Debug builds only; a release has none of this.
//!
//! `LENSCUBE_FAULT=STEP:N:WHAT` strikes the N-th time (from 1) that the process comes to STEP: `create`, `write`, `sync`,
//! `rename`, `sync-directory`, `remove`, `read`, `publish`, `sweep`, or `any` of them. WHAT is an errno (`28`: no space left),
//! `kill` (SIGKILL before the step), `stop` (SIGSTOP before it), `torn` (a write of half the bytes, then SIGKILL) or `short`
//! (half the bytes, and no word about it). With a `+` after N every later time is struck as well: `write:3+:28`. Several
//! faults are separated by commas, each with a count of its own.
//!
//! STEP may also be a named point of the program ([`point`]), at which `stop` holds the process until SIGCONT and `kill` ends it.
//! `any` does not include them. Points: `film-opened`, `job-ready` (chart opened, lens traced), `locked`, `tiles-begin`, `commit`
//! (before the film's identity is checked), `commit-checked` (after that, before the write), `film-removed` (`--overwrite`,
//! before the new film is created), `shards-made` (before the end of the run is reported), `shard-aside` (`verify --repair`).

#[cfg(not(debug_assertions))]
mod none {
    use super::super::Step;

    pub(in super::super) const fn strike(_: Step) -> std::io::Result<()> {
        Ok(())
    }

    /// Nothing in a release.
    pub const fn point(_: &'static str) {}

    pub(in super::super) fn write(
        bytes: &[u8],
        write: &mut dyn FnMut(&[u8]) -> std::io::Result<()>,
    ) -> std::io::Result<()> {
        write(bytes)
    }
}

#[cfg(debug_assertions)]
mod asked {
    use super::super::Step;
    use std::io::Error;
    use std::sync::OnceLock;
    use std::sync::atomic::{AtomicU64, Ordering};

    #[derive(Clone, Copy, PartialEq)]
    enum What {
        Kill,
        Stop,
        Torn,
        Short,
        Error(i32),
    }

    struct Asked {
        step: String,
        from: u64,
        on: bool,
        what: What,
    }

    fn asked() -> &'static [(Asked, AtomicU64)] {
        static ASKED: OnceLock<Vec<(Asked, AtomicU64)>> = OnceLock::new();
        ASKED.get_or_init(|| {
            let text = std::env::var("LENSCUBE_FAULT").unwrap_or_default();
            let each = text.split(',').filter(|part| !part.is_empty());
            each.map(|part| (parse(part), AtomicU64::new(0))).collect()
        })
    }

    fn parse(text: &str) -> Asked {
        let wrong = || panic!("LENSCUBE_FAULT={text}: expected STEP:N:WHAT");
        let [step, n, what] = text.split(':').collect::<Vec<_>>()[..] else { wrong() };
        Asked {
            step: step.into(),
            from: n.trim_end_matches('+').parse().unwrap_or_else(|_| wrong()),
            on: n.ends_with('+'),
            what: match what {
                "kill" => What::Kill,
                "stop" => What::Stop,
                "torn" => What::Torn,
                "short" => What::Short,
                errno => What::Error(errno.parse().unwrap_or_else(|_| wrong())),
            },
        }
    }

    const fn name(step: Step) -> &'static str {
        match step {
            Step::Create => "create",
            Step::Write => "write",
            Step::Sync => "sync",
            Step::Rename => "rename",
            Step::SyncDirectory => "sync-directory",
            Step::Remove => "remove",
            Step::Read => "read",
            Step::Publish => "publish",
            Step::Sweep => "sweep",
        }
    }

    /// The fault that is due at `name`; `any` stands for it if it is a step.
    fn due(name: &str, is_step: bool) -> Option<What> {
        let mut what = None;
        for (asked, count) in asked() {
            if asked.step != name && !(is_step && asked.step == "any") {
                continue;
            }
            let n = count.fetch_add(1, Ordering::SeqCst) + 1;
            if what.is_none() && (n == asked.from || (asked.on && n > asked.from)) {
                eprintln!("struck by LENSCUBE_FAULT at {name} {n}");
                what = Some(asked.what);
            }
        }
        what
    }

    fn signal(signal: rustix::process::Signal) {
        let _ = rustix::process::kill_process(rustix::process::getpid(), signal);
        // SIGKILL comes at once, but perhaps not before the next instruction.
        if signal == rustix::process::Signal::KILL {
            loop {
                std::thread::park();
            }
        }
    }

    fn act(what: What) -> std::io::Result<()> {
        use rustix::process::Signal;
        match what {
            What::Kill | What::Torn => signal(Signal::KILL),
            What::Stop => signal(Signal::STOP),
            What::Short => (),
            What::Error(errno) => return Err(Error::from_raw_os_error(errno)),
        }
        Ok(())
    }

    pub(in super::super) fn strike(step: Step) -> std::io::Result<()> {
        due(name(step), true).map_or(Ok(()), act)
    }

    /// A place in the program at which a test may hold (`stop`) or end (`kill`) the process.
    pub fn point(name: &'static str) {
        match due(name, false) {
            Some(what @ (What::Stop | What::Kill)) => act(what).expect("a signal is no error"),
            Some(_) => panic!("LENSCUBE_FAULT: {name} takes stop or kill"),
            None => (),
        }
    }

    pub(in super::super) fn write(
        bytes: &[u8],
        write: &mut dyn FnMut(&[u8]) -> std::io::Result<()>,
    ) -> std::io::Result<()> {
        let Some(what) = due(name(Step::Write), true) else { return write(bytes) };
        if matches!(what, What::Torn | What::Short) {
            write(&bytes[..bytes.len() / 2])?;
        }
        act(what)?;
        if what == What::Short { Ok(()) } else { write(bytes) }
    }
}

#[cfg(debug_assertions)]
pub use asked::point;
#[cfg(debug_assertions)]
pub(super) use asked::{strike, write};
#[cfg(not(debug_assertions))]
pub use none::point;
#[cfg(not(debug_assertions))]
pub(super) use none::{strike, write};
