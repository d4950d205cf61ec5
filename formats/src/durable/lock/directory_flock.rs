//! `flock` on a directory: serialises the changes of its lock files, so that of several processes that find the lock of an ended owner
//! one takes it.
//!
//! A stopped process, or a network file system that does not respond, may hold it for long: the wait is reported on stderr after
//! [`REPORT_AFTER`] and ends after [`GIVE_UP_AFTER`] with [`LockError::Busy`]. The kernel releases the flock of an ended process. A file system without
//! flock leaves a short race, which costs duplicate work at most.

use std::fs::File;
use std::io::Write;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::Path;
use std::time::{Duration, Instant};

use rustix::fs::{FlockOperation, OFlags, flock};
use rustix::io::Errno;

use super::super::error::DurableError;
use super::error::{LockError, process_name};
use crate::escape;

/// The wait is reported after this time.
pub(super) const REPORT_AFTER: Duration = Duration::from_secs(2);
/// The wait ends after this time.
pub(super) const GIVE_UP_AFTER: Duration = Duration::from_secs(30);
/// Time between two attempts.
const PAUSE: Duration = Duration::from_millis(20);

/// Holds `flock` on the directory until the result is dropped.
pub(super) fn hold(directory: &Path, note: Duration, limit: Duration) -> Result<File, LockError> {
    let failed = |e| DurableError::io("open", directory, 0, e);
    let only_a_directory = (OFlags::DIRECTORY | OFlags::NONBLOCK).bits() as i32;
    let file = File::options().read(true).custom_flags(only_a_directory).open(directory).map_err(failed)?;
    let (start, mut reported) = (Instant::now(), false);
    while let Err(Errno::WOULDBLOCK | Errno::INTR) = flock(&file, FlockOperation::NonBlockingLockExclusive) {
        let waited = start.elapsed();
        if waited >= limit {
            let holder = holder(&file);
            return Err(LockError::Busy { directory: directory.into(), holder, seconds: waited.as_secs() });
        }
        if waited >= note && !reported {
            reported = true;
            report_wait(limit, &file, directory);
        }
        std::thread::sleep(PAUSE);
    }
    Ok(file)
}

/// Reports the wait on stderr. A closed stderr is no reason to end.
#[allow(clippy::disallowed_methods, reason = "the wait is reported while it lasts, and the text is escaped")]
fn report_wait(limit: Duration, file: &File, directory: &Path) {
    let (seconds, holder) = (limit.as_secs(), process_name(holder(file)));
    let directory = directory.display();
    let text = format!("waiting at most {seconds} s for {holder} to release the flock of {directory}");
    let _ = writeln!(std::io::stderr(), "{}", escape::lines(&text));
}

/// Id of the process that holds `flock` on a file. Lines of /proc/locks: `1: FLOCK  ADVISORY  WRITE <pid> <major>:<minor>:<inode> 0 EOF`.
fn holder(file: &File) -> Option<u32> {
    let meta = file.metadata().ok()?;
    let (major, minor) = (rustix::fs::major(meta.dev()), rustix::fs::minor(meta.dev()));
    let inode = format!("{major:02x}:{minor:02x}:{}", meta.ino());
    let table = std::fs::read_to_string("/proc/locks").ok()?;
    let lines = table.lines().map(|l| l.split_whitespace().collect::<Vec<_>>());
    let mut pids =
        lines.filter(|f| f.len() > 5 && f[1] == "FLOCK" && f[5] == inode).map(|f| f[4].parse().ok());
    // Processes of other namespaces are listed as 0.
    pids.find_map(|pid| pid.filter(|&p| p > 0))
}
