//! `lenscube cache`: size of the cache of traced bands, and removal of the least recently used.
//!
//! The last use of an entry is the later of its times of last access and last modification; where the file system records no access, that
//! of its creation.

use crate::args::{CacheAction, CacheArgs};
use crate::lens::cache::directory;
use crate::progress::{detail_line, print};
use anyhow::{Context, Result};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

/// Extension of an entry.
const EXTENSION: &str = ".lens.zip";
/// Bytes that runs leave in the cache.
const LIMIT: u64 = 2_000_000_000;
/// Entries used since stay when a run trims the cache: another run may use them.
const RECENT: Duration = Duration::from_secs(3600);

/// A traced band.
struct Entry {
    path: PathBuf,
    bytes: u64,
    used: SystemTime,
}

/// Runs the command.
pub fn command(args: &CacheArgs) -> Result<()> {
    let directory = directory().context("neither XDG_CACHE_HOME nor HOME names a directory")?;
    let all = entries(&directory)?;
    let (count, bytes) = (all.len(), sum(&all));
    let removed = match args.action {
        CacheAction::Show => Vec::new(),
        CacheAction::Trim => beyond(all, args.limit),
        CacheAction::Clear => all,
    };
    remove(&removed)?;
    let (left, left_bytes) = (count - removed.len(), bytes - sum(&removed));
    print(format!("{}: {left} traced bands, {}", directory.display(), megabytes(left_bytes)));
    if args.action != CacheAction::Show {
        print(format!("removed: {} bands, {}", removed.len(), megabytes(sum(&removed))));
    }
    Ok(())
}

/// Removes the least recently used entries beyond [`LIMIT`], after a run with a design. What cannot be removed remains for the next run.
pub fn trim_after_run() {
    let Some(all) = directory().and_then(|d| entries(&d).ok()) else { return };
    let now = SystemTime::now();
    let mut old = beyond(all, LIMIT);
    old.retain(|e| now.duration_since(e.used).is_ok_and(|age| age > RECENT));
    if remove(&old).is_ok() && !old.is_empty() {
        detail_line(format!(
            "{} traced bands, {}, were removed from the cache",
            old.len(),
            megabytes(sum(&old))
        ));
    }
}

/// The entries of the cache; none if there is no directory.
fn entries(directory: &Path) -> Result<Vec<Entry>> {
    let listed = match std::fs::read_dir(directory) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        listed => listed.with_context(|| format!("listing {}", directory.display()))?,
    };
    let mut all = Vec::new();
    for entry in listed.flatten().filter(|e| e.file_name().to_string_lossy().ends_with(EXTENSION)) {
        // Another process may have removed it.
        let Ok(meta) = entry.metadata() else { continue };
        let modified = meta.modified().unwrap_or(SystemTime::UNIX_EPOCH);
        let used = meta.accessed().map_or(modified, |accessed| accessed.max(modified));
        all.push(Entry { path: entry.path(), bytes: meta.len(), used });
    }
    Ok(all)
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

fn sum(entries: &[Entry]) -> u64 {
    entries.iter().map(|e| e.bytes).sum()
}

fn megabytes(bytes: u64) -> String {
    format!("{:.1} MB", bytes as f64 * 1e-6)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn least_recently_used_entries_beyond_the_limit_are_removed() {
        let entry = |name: &str, bytes, age: u64| Entry {
            path: name.into(),
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
