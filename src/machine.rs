//! Cores and memory of this machine, and memory of this process, as the system reports it.

mod cgroup;
pub mod device;
pub mod disk;

use crate::failure::usage;
use crate::progress::mib;
use cgroup::GroupMemory;
pub use disk::free_space;
use std::ffi::OsString;
use std::fmt::Display;
use std::path::{Path, PathBuf};

/// The largest default limit.
pub const MAX_DEFAULT: u64 = 4 << 30;
/// Available memory where the system does not report it.
const UNKNOWN: u64 = 4 << 30;

/// Worker threads: as given, else all cores.
pub fn threads(given: Option<usize>) -> usize {
    given.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from))
}

/// Half of the available memory, at most 4 GiB.
pub fn default_limit() -> u64 {
    (available().map_or(UNKNOWN, |(bytes, _)| bytes) / 2).min(MAX_DEFAULT)
}

/// A limit of memory: that of `--memory`, or the default.
#[derive(Clone, Copy, Debug)]
pub struct MemoryLimit {
    /// The limit.
    pub bytes: u64,
    is_given: bool,
}

impl MemoryLimit {
    /// The limit `given` by `--memory`, else at most `max_default` bytes.
    pub fn new(given: Option<u64>, max_default: u64) -> Self {
        Self { bytes: given.unwrap_or_else(|| default_limit().min(max_default)), is_given: given.is_some() }
    }

    /// `factor` times as much.
    #[must_use]
    pub fn times(self, factor: f64) -> Self {
        Self { bytes: (self.bytes as f64 * factor) as u64, ..self }
    }

    /// A usage error: the limit is too small, because of `why`.
    pub fn too_small(&self, why: impl Display) -> anyhow::Error {
        let limit = mib(usize::try_from(self.bytes).unwrap_or(usize::MAX));
        usage(match self.is_given {
            true => format!("--memory {limit} is too small: {why}"),
            false => format!("the default of --memory, {limit} on this machine now, is too small: {why}"),
        })
    }
}

/// Memory that this process can have, bytes, and what limits it: the machine, a control group (of a container or a batch job), or the size of its
/// address space (`ulimit -v`). `None` where the system reports nothing.
pub fn available() -> Option<(u64, &'static str)> {
    let machine = bytes_of("/proc/meminfo", "MemAvailable:").map(|bytes| (bytes, "of this machine"));
    let group = group().map(|memory| (memory.left, "of the control group (cgroup) of this process"));
    let space = address_space_left().map(|bytes| (bytes, "of the address space (ulimit -v)"));
    [machine, group, space].into_iter().flatten().min_by_key(|(bytes, _)| *bytes)
}

/// Memory of this machine, or of the control group if that is less, bytes, where the system reports it.
pub fn machine_memory() -> Option<u64> {
    let group = group().map(|memory| memory.limit);
    bytes_of("/proc/meminfo", "MemTotal:").into_iter().chain(group).min()
}

/// A note if `planned` bytes are more than this process can have.
pub fn excess_note(planned: usize) -> Option<String> {
    let (bytes, what) = available()?;
    (planned as u64 > bytes).then(|| {
        format!(
            "the expected peak of {} is more than the {} that are left {what}: the system may end the run; use a smaller --memory",
            mib(planned),
            mib(bytes as usize)
        )
    })
}

fn group() -> Option<GroupMemory> {
    cgroup::group_memory(&|path: &Path| std::fs::read_to_string(path).ok())
}

/// What is left of the limit of the address space, bytes; `None` without a limit.
fn address_space_left() -> Option<u64> {
    let limit = rustix::process::getrlimit(rustix::process::Resource::As).current?;
    Some(limit.saturating_sub(bytes_of("/proc/self/status", "VmSize:").unwrap_or(0)))
}

/// The bytes of `entry` in a file of `NAME: N kB` lines.
fn bytes_of(file: &str, entry: &str) -> Option<u64> {
    let text = std::fs::read_to_string(file).ok()?;
    let line = text.lines().find(|l| l.starts_with(entry))?;
    Some(line.split_whitespace().nth(1)?.parse::<u64>().ok()? << 10)
}

/// Peak resident memory of this process so far, bytes, where the system reports it.
pub fn peak_resident() -> Option<u64> {
    bytes_of("/proc/self/status", "VmHWM:")
}

/// The program's directory in the user's cache: below `XDG_CACHE_HOME`, else `~/.cache`.
pub fn user_cache() -> Option<PathBuf> {
    let absolute = |v: OsString| Some(PathBuf::from(v)).filter(|p| p.is_absolute());
    let base = std::env::var_os("XDG_CACHE_HOME").and_then(absolute);
    let base =
        base.or_else(|| std::env::var_os("HOME").and_then(absolute).map(|home| home.join(".cache")))?;
    Some(base.join("lenscube"))
}
