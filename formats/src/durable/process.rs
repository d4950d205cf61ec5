//! Identity of a process, and whether that process has ended.
//!
//! | process compared with this one | conclusion |
//! |---|---|
//! | other host name | none: it may run |
//! | same host name and boot id: the same kernel | by pid namespace, pid and start time; none for another namespace (a container) |
//! | same host name and machine id, other boot id, initial pid namespace | it ended when this machine was restarted |
//! | same host name, other boot id, anything else | none: it may run on another machine of that name |
//!
//! The machine id is that of `/etc/machine-id` (machine-id(5): one per installation, the same after a restart), kept as a hash
//! because it is confidential. Where it is missing or empty, as in many containers, and on systems without boot ids, no conclusion
//! is drawn from a restart. In a container it may come from the image and be the same on many hosts: hence the initial pid namespace.
//! Two virtual machines cloned with host name *and* machine id are one machine by this rule, as for systemd: give cloned virtual
//! machines different machine ids.
//! Files of processes of unknown state are kept: locks need `--take-over`, temporary files `verify --repair` or manual removal.

use std::sync::OnceLock;

use serde::{Deserialize, Serialize};

/// Identity of a process: host name and machine id identify the machine, the boot id its current start, the namespace a container
/// on it; the start time distinguishes it from another process with the same pid.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ProcessIdentity {
    /// Name of the host.
    pub host: String,
    /// First digits of a hash of its machine id; empty if it has none.
    #[serde(default)]
    pub machine: String,
    /// First digits of its boot id.
    pub boot: String,
    /// Number of the pid namespace.
    pub namespace: String,
    /// Process id in that namespace.
    pub pid: u32,
    /// Start time in clock ticks since boot.
    pub start: u64,
}

/// Hexadecimal digits kept of machine and boot ids.
const DIGITS: usize = 16;
/// The pid namespace in which a machine starts (PROC_PID_INIT_INO of the Linux kernel).
const INITIAL_NAMESPACE: &str = "4026531836";

impl ProcessIdentity {
    /// This process.
    pub fn current() -> &'static Self {
        static CURRENT: OnceLock<ProcessIdentity> = OnceLock::new();
        CURRENT.get_or_init(|| {
            let name = |s: &str| -> String {
                s.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).take(64).collect()
            };
            let boot = std::fs::read_to_string("/proc/sys/kernel/random/boot_id").unwrap_or_default();
            let machine = std::fs::read_to_string("/etc/machine-id").unwrap_or_default();
            let namespace = std::fs::read_link("/proc/self/ns/pid").unwrap_or_default();
            let digits = |s: &str| s.chars().filter(char::is_ascii_digit).collect::<String>();
            let pid = std::process::id();
            Self {
                host: name(&rustix::system::uname().nodename().to_string_lossy()),
                machine: machine_hash(&machine),
                boot: boot.chars().filter(char::is_ascii_hexdigit).take(DIGITS).collect(),
                namespace: digits(&namespace.to_string_lossy()),
                pid,
                start: start_time(pid).unwrap_or(0),
            }
        })
    }

    /// Whether it has ended; `None` if unknown (see the head of this file).
    pub fn has_ended(&self) -> Option<bool> {
        self.has_ended_relative_to(Self::current())
    }

    fn has_ended_relative_to(&self, current: &Self) -> Option<bool> {
        let known = !self.boot.is_empty() && !current.boot.is_empty();
        if !known || self.host != current.host {
            return None;
        }
        if self.boot != current.boot {
            let restarted = !self.machine.is_empty() && self.machine == current.machine;
            return (restarted && self.namespace == INITIAL_NAMESPACE).then_some(true);
        }
        if self.namespace != current.namespace {
            return None;
        }
        Some(match start_time(self.pid) {
            Some(start) => start != self.start,
            None => !is_alive(self.pid),
        })
    }
}

/// systemd writes `uninitialized` into the file until the first start is complete.
fn machine_hash(id: &str) -> String {
    match id.trim() {
        "" | "uninitialized" => String::new(),
        id => blake3::hash(format!("lenscube machine {id}").as_bytes()).to_hex()[..DIGITS].to_owned(),
    }
}

/// Start time of process `pid` in clock ticks since boot: field 22 of /proc/<pid>/stat, counted after the last `)`
/// because the command's name may contain any character. 0 for a zombie (state Z), which has ended.
fn start_time(pid: u32) -> Option<u64> {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    let mut fields = stat.rsplit_once(')')?.1.split_whitespace();
    match fields.next()? {
        "Z" | "X" => Some(0),
        _ => fields.nth(18)?.parse().ok(),
    }
}

/// Whether signal 0 finds the process, for systems without /proc; also one of another user (EPERM).
fn is_alive(pid: u32) -> bool {
    let Some(pid) = i32::try_from(pid).ok().and_then(rustix::process::Pid::from_raw) else { return false };
    !matches!(rustix::process::test_kill_process(pid), Err(rustix::io::Errno::SRCH))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn local() -> ProcessIdentity {
        ProcessIdentity {
            host: "node".into(),
            machine: "3d12".into(),
            boot: "b1".into(),
            namespace: INITIAL_NAMESPACE.into(),
            ..ProcessIdentity::current().clone()
        }
    }

    #[test]
    fn process_with_other_boot_id_has_ended_only_if_the_machine_is_the_same() {
        let current = local();
        let ended = |change: &dyn Fn(&mut ProcessIdentity)| {
            let mut process = current.clone();
            change(&mut process);
            process.has_ended_relative_to(&current)
        };
        assert_eq!(ended(&|_| ()), Some(false));
        assert_eq!(ended(&|m| m.pid = 4_194_303), Some(true));
        assert_eq!(ended(&|m| m.start += 1), Some(true));
        assert_eq!(ended(&|m| m.boot = "b0".into()), Some(true));
        let unknown: [&dyn Fn(&mut ProcessIdentity); 5] = [
            &|m| m.host = "other".into(),
            &|m| m.namespace = "4026532841".into(),
            &|m| (m.boot, m.machine) = ("b0".into(), "77aa".into()),
            &|m| (m.boot, m.machine) = ("b0".into(), String::new()),
            &|m| (m.boot, m.namespace) = ("b0".into(), "4026532841".into()),
        ];
        for (n, change) in unknown.into_iter().enumerate() {
            assert_eq!(ended(change), None, "case {n}");
        }
    }

    #[test]
    fn state_is_unknown_without_machine_id_or_boot_id() {
        let no_machine = ProcessIdentity { machine: String::new(), ..local() };
        let before = ProcessIdentity { boot: "b0".into(), ..no_machine.clone() };
        assert_eq!(before.has_ended_relative_to(&no_machine), None);
        let no_boot = ProcessIdentity { boot: String::new(), pid: 4_194_303, ..local() };
        assert_eq!(no_boot.has_ended_relative_to(&no_boot), None);
        assert_eq!((machine_hash("\n"), machine_hash("uninitialized\n")), Default::default());
        assert_eq!(machine_hash("3d1219c7c4c5404aaa1f6d2a48adfda4\n").len(), DIGITS);
    }
}
