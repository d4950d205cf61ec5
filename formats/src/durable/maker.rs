//! Which process made a file, and whether it still runs.

use std::sync::OnceLock;

use serde::{Deserialize, Serialize};

/// A process: the boot id tells a restarted host, the namespace another container on this one, the start time (clock
/// ticks since boot) another process that got the same pid.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Maker {
    /// Name of the host.
    pub host: String,
    /// First digits of its boot id.
    pub boot: String,
    /// Number of the pid namespace.
    pub namespace: String,
    /// Process id in that namespace.
    pub pid: u32,
    /// Start time in clock ticks since boot.
    pub start: u64,
}

impl Maker {
    /// This process.
    pub fn here() -> &'static Self {
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

    /// `None` when this process cannot know: another host, or another container of this one.
    pub fn is_dead(&self) -> Option<bool> {
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
/// because the command's name may hold anything. A zombie (state Z) has ended, so it has no start.
fn start_of(pid: u32) -> Option<u64> {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    let mut fields = stat.rsplit_once(')')?.1.split_whitespace();
    match fields.next()? {
        "Z" | "X" => Some(0),
        _ => fields.nth(18)?.parse().ok(),
    }
}

/// Without /proc: does a signal find it? One that belongs to another user is there as well.
fn is_alive(pid: u32) -> bool {
    let Some(pid) = i32::try_from(pid).ok().and_then(rustix::process::Pid::from_raw) else { return false };
    !matches!(rustix::process::test_kill_process(pid), Err(rustix::io::Errno::SRCH))
}
