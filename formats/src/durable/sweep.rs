//! Temp names that tell who made them, and the sweep of those whose maker is gone.
//!
//! `.tmp-<host>-<boot>-<pid namespace>-<pid>-<start>-<nonce>`: the boot id tells a restarted host, the namespace another
//! container on this one, the start time (clock ticks since boot) another process that got the same pid. No zarr key
//! begins with `.tmp-`, so no reader ever asks for one.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

use super::DurableError;

const PREFIX: &str = ".tmp-";

/// Who made a temp file.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Maker {
    host: String,
    boot: String,
    namespace: String,
    pid: u32,
    start: u64,
}

impl Maker {
    fn here() -> &'static Self {
        static HERE: OnceLock<Maker> = OnceLock::new();
        HERE.get_or_init(|| {
            let word = |s: &str| -> String {
                s.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).take(64).collect()
            };
            let boot = std::fs::read_to_string("/proc/sys/kernel/random/boot_id").unwrap_or_default();
            let namespace = std::fs::read_link("/proc/self/ns/pid").unwrap_or_default();
            let digits = |s: &str| s.chars().filter(char::is_ascii_digit).collect::<String>();
            let pid = std::process::id();
            Self {
                host: word(&rustix::system::uname().nodename().to_string_lossy()),
                boot: boot.chars().filter(char::is_ascii_hexdigit).take(16).collect(),
                namespace: digits(&namespace.to_string_lossy()),
                pid,
                start: start_of(pid).unwrap_or(0),
            }
        })
    }

    fn parse(name: &str) -> Option<Self> {
        let mut parts = name.strip_prefix(PREFIX)?.split('-');
        let mut word = || parts.next().map(str::to_owned);
        Some(Self {
            host: word()?,
            boot: word()?,
            namespace: word()?,
            pid: word()?.parse().ok()?,
            start: word()?.parse().ok()?,
        })
    }

    /// `None` when this process cannot know: another host, or another container of this one.
    fn is_dead(&self) -> Option<bool> {
        let here = Self::here();
        if self.host != here.host {
            None
        } else if self.boot != here.boot {
            Some(true)
        } else if self.namespace != here.namespace {
            None
        } else {
            Some(match start_of(self.pid) {
                Some(start) => start != self.start,
                None => !is_alive(self.pid),
            })
        }
    }
}

/// When process `pid` started, in clock ticks since boot: field 22 of /proc/<pid>/stat, counted after the last `)`
/// because the command's name may hold anything.
fn start_of(pid: u32) -> Option<u64> {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    stat.rsplit_once(')')?.1.split_whitespace().nth(19)?.parse().ok()
}

/// Without /proc: does a signal find it? One that belongs to another user is there as well.
fn is_alive(pid: u32) -> bool {
    let Some(pid) = i32::try_from(pid).ok().and_then(rustix::process::Pid::from_raw) else { return false };
    !matches!(rustix::process::test_kill_process(pid), Err(rustix::io::Errno::SRCH))
}

/// A name that no other process, and no other call in this one, uses.
pub fn temp_name() -> String {
    static NONCE: AtomicU64 = AtomicU64::new(0);
    let m = Maker::here();
    let nonce = NONCE.fetch_add(1, Ordering::Relaxed);
    format!("{PREFIX}{}-{}-{}-{}-{}-{nonce}", m.host, m.boot, m.namespace, m.pid, m.start)
}

/// Whether a file name is a temp name, of whatever maker.
pub fn is_temp_name(name: &str) -> bool {
    name.starts_with(PREFIX)
}

/// What [`sweep`] found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Sweep {
    /// Removed: their makers are gone.
    pub removed: Vec<PathBuf>,
    /// Left alone: made by a process of this host that lives.
    pub live: Vec<PathBuf>,
    /// Left alone: made on another host or in another container; only a person can say whether it still runs.
    pub foreign: Vec<PathBuf>,
}

/// Removes what dead processes of this host left below `root`; tells what others left.
///
/// # Errors
/// [`DurableError`] if a directory cannot be listed or a file not removed. A `root` that is not there is clean.
pub fn sweep(root: &Path) -> Result<Sweep, DurableError> {
    let mut found = Sweep::default();
    walk(root, true, &mut found)?;
    Ok(found)
}

/// As [`sweep`], but looks only at the entries of `directory` itself, files and unfinished directories alike.
///
/// # Errors
/// As [`sweep`].
pub fn sweep_entries(directory: &Path) -> Result<Sweep, DurableError> {
    let mut found = Sweep::default();
    walk(directory, false, &mut found)?;
    Ok(found)
}

fn walk(directory: &Path, deep: bool, found: &mut Sweep) -> Result<(), DurableError> {
    let entries = match std::fs::read_dir(directory) {
        Err(e) if super::absent(&e) => return Ok(()),
        other => other.map_err(|e| DurableError::io("list", directory, 0, e))?,
    };
    for entry in entries {
        let entry = entry.map_err(|e| DurableError::io("list", directory, 0, e))?;
        let path = entry.path();
        let is_dir = entry.file_type().is_ok_and(|t| t.is_dir());
        let name = entry.file_name();
        let name = name.to_string_lossy();
        if !is_temp_name(&name) {
            if is_dir && deep {
                walk(&path, deep, found)?;
            }
            continue;
        }
        match Maker::parse(&name).and_then(|m| m.is_dead()) {
            None => found.foreign.push(path),
            Some(false) => found.live.push(path),
            Some(true) => {
                let gone = if is_dir { std::fs::remove_dir_all(&path) } else { std::fs::remove_file(&path) };
                match gone {
                    Err(e) if !super::absent(&e) => return Err(DurableError::io("remove", &path, 0, e)),
                    _ => found.removed.push(path),
                }
            }
        }
    }
    Ok(())
}
