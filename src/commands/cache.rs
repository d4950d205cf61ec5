//! `lenscube cache`: size of the cache of traced bands and reduced charts, and removal of the least recently used.
//!
//! The last use of an entry is the later of its times of last access and last modification; where the file system records no access, that
//! of its creation.

use crate::args::{CacheAction, CacheArgs};
use crate::job::lens::cache::directory;
use crate::job::lens::cache::entries::{Entry, described, entries};
use crate::progress::{detail_line, print};
use anyhow::{Context, Result};
use std::time::{Duration, SystemTime};

/// Bytes that runs leave in the cache.
const LIMIT: u64 = 2_000_000_000;
/// Entries used since stay when a run trims the cache: another run may use them.
const RECENT: Duration = Duration::from_secs(3600);

/// Runs the command.
pub fn command(args: &CacheArgs) -> Result<()> {
    let directory = directory().context("neither XDG_CACHE_HOME nor HOME names a directory")?;
    let all = entries(&directory)?;
    let removed = match args.action {
        CacheAction::Show => Vec::new(),
        CacheAction::Trim => beyond(all, args.limit),
        CacheAction::Clear => all,
    };
    remove(&removed)?;
    print(format!("{}: {}", directory.display(), described(&entries(&directory)?)));
    if args.action != CacheAction::Show {
        print(format!("removed: {}", described(&removed)));
    }
    Ok(())
}

/// Removes the least recently used entries beyond [`LIMIT`], after a run. What cannot be removed remains for the next run.
pub fn trim_after_run() {
    let Some(all) = directory().and_then(|d| entries(&d).ok()) else { return };
    let now = SystemTime::now();
    let mut old = beyond(all, LIMIT);
    old.retain(|e| now.duration_since(e.used).is_ok_and(|age| age > RECENT));
    if remove(&old).is_ok() && !old.is_empty() {
        detail_line(format!("removed from the cache: {}", described(&old)));
    }
}

/// The least recently used of `all` without which the others have at most `limit` bytes.
fn beyond(mut all: Vec<Entry>, limit: u64) -> Vec<Entry> {
    all.sort_by_key(|e| std::cmp::Reverse(e.used));
    let mut kept = 0;
    let first = all.iter().position(|e| {
        kept += e.bytes;
        kept > limit
    });
    all.split_off(first.unwrap_or(all.len()))
}

fn remove(entries: &[Entry]) -> Result<()> {
    for entry in entries {
        match std::fs::remove_file(&entry.path) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
                return Err(e).with_context(|| format!("removing {}", entry.path.display()));
            }
            _ => (),
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::job::lens::cache::entries::Kind;

    #[test]
    fn least_recently_used_entries_beyond_the_limit_are_removed() {
        let entry = |name: &str, bytes, age: u64| Entry {
            path: name.into(),
            kind: Kind::Band,
            bytes,
            used: SystemTime::UNIX_EPOCH + Duration::from_secs(1000 - age),
        };
        let all = || vec![entry("old", 10, 900), entry("new", 20, 1), entry("middle", 30, 500)];
        let names =
            |limit| beyond(all(), limit).iter().map(|e| e.path.display().to_string()).collect::<Vec<_>>();
        assert_eq!(names(60), Vec::<String>::new());
        assert_eq!(names(59), ["old"]);
        assert_eq!(names(49), ["middle", "old"]);
        assert_eq!(names(0), ["new", "middle", "old"]);
    }
}
