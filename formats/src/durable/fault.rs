//! Faults on demand, so that tests can make the real program meet them. Debug builds only; a release has none of this.
//!
//! `LENSCUBE_FAULT=STEP:N:WHAT` strikes the N-th time (from 1) that the process comes to STEP: `create`, `write`, `sync`,
//! `rename`, `sync-directory`, `remove`, `read`, `publish`, `sweep`, or `any` of them. WHAT is an errno (`28`: no space left),
//! `kill` (SIGKILL before the step), `stop` (SIGSTOP before it), `torn` (a write of half the bytes, then SIGKILL) or `short`
//! (half the bytes, and no word about it). With a `+` after N every later time is struck as well: `write:3+:28`.

#[cfg(not(debug_assertions))]
mod none {
    use super::super::Step;

    pub(in super::super) const fn strike(_: Step) -> std::io::Result<()> {
        Ok(())
    }

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

    fn asked() -> Option<&'static Asked> {
        static ASKED: OnceLock<Option<Asked>> = OnceLock::new();
        ASKED.get_or_init(|| std::env::var("LENSCUBE_FAULT").ok().map(|text| parse(&text))).as_ref()
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

    fn due(step: Step) -> Option<What> {
        static COUNT: AtomicU64 = AtomicU64::new(0);
        let asked = asked()?;
        if asked.step != "any" && asked.step != name(step) {
            return None;
        }
        let n = COUNT.fetch_add(1, Ordering::SeqCst) + 1;
        let struck = n == asked.from || (asked.on && n > asked.from);
        if struck {
            eprintln!("struck by LENSCUBE_FAULT at {} {n}", name(step));
        }
        struck.then_some(asked.what)
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
        due(step).map_or(Ok(()), act)
    }

    pub(in super::super) fn write(
        bytes: &[u8],
        write: &mut dyn FnMut(&[u8]) -> std::io::Result<()>,
    ) -> std::io::Result<()> {
        let Some(what) = due(Step::Write) else { return write(bytes) };
        if matches!(what, What::Torn | What::Short) {
            write(&bytes[..bytes.len() / 2])?;
        }
        act(what)?;
        if what == What::Short { Ok(()) } else { write(bytes) }
    }
}

#[cfg(debug_assertions)]
pub(super) use asked::{strike, write};
#[cfg(not(debug_assertions))]
pub(super) use none::{strike, write};
