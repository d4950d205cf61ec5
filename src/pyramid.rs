//! `lenscube pyramid`: adds levels of decreasing resolution to a film, for viewers.

use crate::args::PyramidArgs;
use crate::failure::{Coded, code};
use crate::interrupt;
use crate::job;
use crate::memory::{default_limit, mib};
use crate::progress::{counting, log_line, report_kept};
use crate::run::film::FILM_LOCK;
use crate::status;
use anyhow::Result;
use formats::film::{FilmError, FilmStore, PyramidState};
use std::time::Instant;

/// Runs the command; the exit code.
pub fn command(args: &PyramidArgs) -> Result<u8> {
    interrupt::listen();
    make(&status::open(&args.film)?, args.threads, args.memory, args.take_over)
}

/// Makes the pyramid of a film, or completes it; the exit code.
pub fn make(store: &FilmStore, threads: Option<usize>, memory: Option<u64>, take_over: bool) -> Result<u8> {
    let shards = store.pyramid_shards();
    let state = store.pyramid()?;
    if state == PyramidState::Complete {
        store.check_in_place()?;
        log_line(format!(
            "the pyramid of {} is complete: {shards} shards, nothing to do",
            store.path().display()
        ));
        return Ok(0);
    }
    let lock = store.lock(FILM_LOCK, take_over)?;
    if let Some(lock) = &lock {
        interrupt::release_on_exit(lock.path());
    }
    report_kept(&store.sweep()?);
    match state {
        PyramidState::Unfinished(done, _) => {
            log_line(format!("resuming: {} of {shards} shards to compute", shards - done))
        }
        PyramidState::Stale => log_line("the pyramid is of an earlier version of the film: replacing it"),
        _ => (),
    }
    let start = Instant::now();
    let limit = memory.unwrap_or_else(default_limit);
    let (bar, progress) = counting("pyramid");
    let cancel = interrupt::cancel_flag();
    let limit_bytes = usize::try_from(limit).unwrap_or(usize::MAX);
    let made = store.make_pyramid(job::threads(threads), limit_bytes, cancel, &progress);
    bar.finish_and_clear();
    match made {
        Ok(true) => {
            print_summary(store, start, limit);
            Ok(0)
        }
        Ok(false) => {
            log_line("interrupted; the same command resumes");
            Ok(code::INTERRUPTED)
        }
        Err(e @ FilmError::Incomplete { .. }) => {
            Err(Coded { code: code::WRONG, message: e.to_string() }.into())
        }
        Err(e) => Err(e.into()),
    }
}

fn print_summary(store: &FilmStore, start: Instant, limit: u64) {
    let levels: Vec<String> = (0..store.spec().outputs.len())
        .map(|output| {
            let size = store.spec().outputs[output].rect.size();
            let levels = formats::film::level_sizes(size);
            let last = levels[levels.len() - 1];
            format!("{} in {} levels down to {last} px", store.spec().outputs[output].name, levels.len())
        })
        .collect();
    log_line(format!(
        "{}: {}; {} shards in {:.1} s (memory at most {})",
        store.path().display(),
        levels.join(", "),
        store.pyramid_shards(),
        start.elapsed().as_secs_f64(),
        mib(limit as usize)
    ));
}
