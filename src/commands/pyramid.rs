//! `lenscube pyramid`: adds levels of decreasing resolution to a film or a raw, for viewers.

use crate::args::PyramidArgs;
use crate::failure::{Coded, code};
use crate::film::reported;
use crate::machine::{self, default_limit};
use crate::progress::interrupt;
use crate::progress::mib;
use crate::progress::{counting, log_line, plural, report_kept};
use anyhow::Result;
use formats::film::FilmStore;
use formats::group::{GroupError, JobGroup};
use formats::pyramid::{Pyramid, PyramidState, level_sizes};
use pipeline::geometry::Size;
use std::time::Instant;

/// Runs the command; the exit code.
pub fn command(args: &PyramidArgs) -> Result<u8> {
    interrupt::listen();
    match reported::raw(&args.film)? {
        Some(raw) => make(&raw.pyramid(), args.threads, args.memory, args.take_over),
        None => {
            let film = reported::opened_of_kinds("a film or raw", FilmStore::open(&args.film, true))?;
            make(&film.pyramid(), args.threads, args.memory, args.take_over)
        }
    }
}

/// Makes the pyramid of a film or raw, or completes it; the exit code.
pub fn make(
    pyramid: &Pyramid<'_>,
    threads: Option<usize>,
    memory: Option<u64>,
    take_over: bool,
) -> Result<u8> {
    let (group, shards) = (pyramid.group(), pyramid.shards());
    let state = pyramid.state()?;
    if state == PyramidState::Complete {
        group.check_in_place()?;
        log_line(format!(
            "the pyramid of {} is complete: {}, nothing to do",
            group.path().display(),
            plural(shards, "shard")
        ));
        return Ok(0);
    }
    let lock = group.lock(JobGroup::WHOLE, take_over)?;
    let sweep = group.sweep()?;
    if let Some(lock) = &lock {
        interrupt::release_on_exit(lock.path());
    }
    report_kept(&sweep);
    match state {
        PyramidState::Unfinished(done, _) => {
            log_line(format!("resuming: {} of {shards} shards to compute", shards - done))
        }
        PyramidState::Stale => log_line("the pyramid is of an earlier version of these pixels: replacing it"),
        _ => (),
    }
    let start = Instant::now();
    let limit = memory.unwrap_or_else(default_limit);
    let (bar, progress) = counting("pyramid");
    let limit_bytes = usize::try_from(limit).unwrap_or(usize::MAX);
    let made = pyramid.make(machine::threads(threads), limit_bytes, interrupt::cancel_flag(), &progress);
    bar.finish_and_clear();
    let made = made.map_err(|e| match e {
        GroupError::Incomplete { .. } => Coded { code: code::WRONG, message: e.to_string() }.into(),
        e => anyhow::Error::from(e),
    });
    if !made? {
        log_line("interrupted; the same command resumes");
        return Ok(code::INTERRUPTED);
    }
    print_summary(pyramid, start, limit);
    Ok(0)
}

fn print_summary(pyramid: &Pyramid<'_>, start: Instant, limit: u64) {
    let levels = |(name, size): (&str, Size)| {
        let levels = level_sizes(size);
        let last = levels[levels.len() - 1];
        format!("{name} in {} levels down to {last} px", levels.len())
    };
    let levels: Vec<String> = pyramid.arrays().into_iter().map(levels).collect();
    log_line(format!(
        "{}: {}; {} in {:.1} s (memory at most {})",
        pyramid.group().path().display(),
        levels.join(", "),
        plural(pyramid.shards(), "shard"),
        start.elapsed().as_secs_f64(),
        mib(limit as usize)
    ));
}
