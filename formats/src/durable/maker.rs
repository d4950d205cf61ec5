//! Which process made a file, and whether it has provably ended.
//!
//! | maker against this process | known |
//! |---|---|
//! | another host name | nothing: it may run |
//! | same host name and boot id: the same kernel | by pid namespace, pid and start time; nothing of another namespace (a container) |
//! | same host name and machine id, another boot id, initial pid namespace | it ended when this machine was restarted |
//! | same host name, another boot id, anything else | nothing: it may run on another machine of that name |
//!
//! The machine id is that of `/etc/machine-id` (machine-id(5): one per installation, the same after a restart), kept as a hash
//! because it is confidential. Where it is missing or empty, as in many containers, and on systems without boot ids, a restart proves
//! nothing. In a container it may come from the image and be the same on many hosts: hence the initial pid namespace.
//! Two virtual machines cloned with host name *and* machine id are one machine to this rule, and to systemd; give each its own.
//! What is unknown is left alone: locks need `--take-over`, temporary files `verify --repair` or a person.

use std::sync::OnceLock;

use serde::{Deserialize, Serialize};

/// A process: host name and machine id name the machine, the boot id its present start, the namespace a container on it, the
/// start time (clock ticks since boot) tells it from another process that got the same pid.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Maker {
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

impl Maker {
    /// This process.
    pub fn here() -> &'static Self {
        static HERE: OnceLock<Maker> = OnceLock::new();
        HERE.get_or_init(|| {
            let word = |s: &str| -> String {
                s.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).take(64).collect()
            };
            let boot = std::fs::read_to_string("/proc/sys/kernel/random/boot_id").unwrap_or_default();
            let machine = std::fs::read_to_string("/etc/machine-id").unwrap_or_default();
            let namespace = std::fs::read_link("/proc/self/ns/pid").unwrap_or_default();
            let digits = |s: &str| s.chars().filter(char::is_ascii_digit).collect::<String>();
            let pid = std::process::id();
            Self {
                host: word(&rustix::system::uname().nodename().to_string_lossy()),
                machine: machine_hash(&machine),
                boot: boot.chars().filter(char::is_ascii_hexdigit).take(DIGITS).collect(),
                namespace: digits(&namespace.to_string_lossy()),
                pid,
                start: start_of(pid).unwrap_or(0),
            }
        })
    }

    /// Whether it has ended; `None` where this process cannot know (see the head of this file).
    pub fn is_dead(&self) -> Option<bool> {
        self.is_dead_seen_from(Self::here())
    }

    fn is_dead_seen_from(&self, here: &Self) -> Option<bool> {
        let known = !self.boot.is_empty() && !here.boot.is_empty();
        if !known || self.host != here.host {
            return None;
        }
        if self.boot != here.boot {
            let restarted = !self.machine.is_empty() && self.machine == here.machine;
            return (restarted && self.namespace == INITIAL_NAMESPACE).then_some(true);
        }
        if self.namespace != here.namespace {
            return None;
        }
        Some(match start_of(self.pid) {
            Some(start) => start != self.start,
            None => !is_alive(self.pid),
        })
    }
}

/// `uninitialized` stands in the file until the first start is complete.
fn machine_hash(id: &str) -> String {
    match id.trim() {
        "" | "uninitialized" => String::new(),
        id => blake3::hash(format!("lenscube machine {id}").as_bytes()).to_hex()[..DIGITS].to_owned(),
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

#[cfg(test)]
mod tests {
    use super::*;

    fn here() -> Maker {
        Maker {
            host: "node".into(),
            machine: "3d12".into(),
            boot: "b1".into(),
            namespace: INITIAL_NAMESPACE.into(),
            ..Maker::here().clone()
        }
    }

    #[test]
    fn only_a_restart_of_the_same_machine_proves_the_end_of_a_maker_with_another_boot_id() {
        let here = here();
        let seen = |change: &dyn Fn(&mut Maker)| {
            let mut maker = here.clone();
            change(&mut maker);
            maker.is_dead_seen_from(&here)
        };
        assert_eq!(seen(&|_| ()), Some(false));
        assert_eq!(seen(&|m| m.pid = 4_194_303), Some(true));
        assert_eq!(seen(&|m| m.start += 1), Some(true));
        assert_eq!(seen(&|m| m.boot = "b0".into()), Some(true));
        let unknown: [&dyn Fn(&mut Maker); 5] = [
            &|m| m.host = "other".into(),
            &|m| m.namespace = "4026532841".into(),
            &|m| (m.boot, m.machine) = ("b0".into(), "77aa".into()),
            &|m| (m.boot, m.machine) = ("b0".into(), String::new()),
            &|m| (m.boot, m.namespace) = ("b0".into(), "4026532841".into()),
        ];
        for (n, change) in unknown.into_iter().enumerate() {
            assert_eq!(seen(change), None, "case {n}");
        }
    }

    #[test]
    fn without_a_machine_id_or_boot_ids_a_restart_proves_nothing() {
        let nameless = Maker { machine: String::new(), ..here() };
        let before = Maker { boot: "b0".into(), ..nameless.clone() };
        assert_eq!(before.is_dead_seen_from(&nameless), None);
        let bootless = Maker { boot: String::new(), pid: 4_194_303, ..here() };
        assert_eq!(bootless.is_dead_seen_from(&bootless), None);
        assert_eq!((machine_hash("\n"), machine_hash("uninitialized\n")), Default::default());
        assert_eq!(machine_hash("3d1219c7c4c5404aaa1f6d2a48adfda4\n").len(), DIGITS);
    }
}
