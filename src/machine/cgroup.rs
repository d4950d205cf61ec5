//! Limits of the memory that the control groups (cgroups) of this process have, versions 1 and 2 of the Linux kernel's interface.
//!
//! `/proc/self/cgroup` names the group in each hierarchy, `/proc/self/mountinfo` says where hierarchies are mounted and from which group on:
//! in a container often from the container's own. The limit of every group from the process's up to the mounted one holds. Pages of files that
//! were not used of late (`inactive_file`) count as use, but the kernel frees them first: they are available.

use std::path::{Path, PathBuf};

/// Memory of the tightest group, bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GroupMemory {
    /// The lowest limit.
    pub limit: u64,
    /// The least that is left of any limit.
    pub left: u64,
}

/// Text of a file; `None` if there is none.
pub type Read<'a> = &'a dyn Fn(&Path) -> Option<String>;

/// Names of the files of a group.
struct Names {
    limits: &'static [&'static str],
    usage: &'static str,
    /// Entries of `memory.stat`: further limits, and pages that are freed first.
    limits_in_stat: &'static [&'static str],
    inactive: &'static str,
}

/// Of version 1; a limit of an ancestor that is not mounted is in `memory.stat`.
const V1: Names = Names {
    limits: &["memory.limit_in_bytes"],
    usage: "memory.usage_in_bytes",
    limits_in_stat: &["hierarchical_memory_limit"],
    inactive: "total_inactive_file",
};
/// Of version 2. Above `memory.high` the kernel slows the process down.
const V2: Names = Names {
    limits: &["memory.max", "memory.high"],
    usage: "memory.current",
    limits_in_stat: &[],
    inactive: "inactive_file",
};

/// Memory that the groups of this process leave; `None` without a limit.
pub fn group_memory(read: Read<'_>) -> Option<GroupMemory> {
    let groups = read(Path::new("/proc/self/cgroup"))?;
    let mounts = read(Path::new("/proc/self/mountinfo"))?;
    let memories = groups.lines().filter_map(|line| {
        let [_, controllers, group] = line.splitn(3, ':').collect::<Vec<_>>()[..] else { return None };
        let names = match controllers {
            "" => &V2,
            list if list.split(',').any(|name| name == "memory") => &V1,
            _ => return None,
        };
        let mount =
            mounts.lines().filter_map(Mount::parse).find(|mount| mount.is_of(controllers.is_empty()))?;
        tightest(mount.groups_from(group).iter().filter_map(|place| of_group(read, place, names)))
    });
    tightest(memories)
}

fn tightest(memories: impl Iterator<Item = GroupMemory>) -> Option<GroupMemory> {
    memories.reduce(|a, b| GroupMemory { limit: a.limit.min(b.limit), left: a.left.min(b.left) })
}

/// Limit of one group; `None` if it has none.
fn of_group(read: Read<'_>, place: &Path, names: &Names) -> Option<GroupMemory> {
    let stat = read(&place.join("memory.stat")).unwrap_or_default();
    let entry = |name: &str| {
        let line = stat.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' '));
        line.and_then(|value| value.trim().parse::<u64>().ok())
    };
    let number = |file: &str| read(&place.join(file))?.trim().parse::<u64>().ok();
    // `max` is not a number.
    let limits = names.limits.iter().filter_map(|file| number(file));
    let limit = limits.chain(names.limits_in_stat.iter().filter_map(|name| entry(name))).min()?;
    // Version 1 writes the largest number of pages for no limit.
    if limit >= 1 << 60 {
        return None;
    }
    let used = number(names.usage)?.saturating_sub(entry(names.inactive).unwrap_or(0));
    Some(GroupMemory { limit, left: limit.saturating_sub(used) })
}

/// A mounted hierarchy.
struct Mount<'a> {
    /// The group that is mounted.
    root: String,
    point: PathBuf,
    kind: &'a str,
    options: &'a str,
}

impl<'a> Mount<'a> {
    /// Of a line `ID PARENT MAJOR:MINOR ROOT POINT OPTIONS [FIELD…] - TYPE SOURCE SUPER-OPTIONS`.
    fn parse(line: &'a str) -> Option<Self> {
        let (mount, system) = line.split_once(" - ")?;
        let mut mount = mount.split(' ').skip(3);
        let (root, point) = (unescaped(mount.next()?), unescaped(mount.next()?));
        let mut system = system.split(' ');
        let kind = system.next()?;
        Some(Self { root, point: point.into(), kind, options: system.nth(1).unwrap_or_default() })
    }

    fn is_of(&self, version_2: bool) -> bool {
        match version_2 {
            true => self.kind == "cgroup2",
            false => self.kind == "cgroup" && self.options.split(',').any(|option| option == "memory"),
        }
    }

    /// Folders of `group` and of the groups that contain it, as far as they are mounted.
    fn groups_from(&self, group: &str) -> Vec<PathBuf> {
        // A group outside of the mounted one is written with `..`, or is not below it: only the mounted one is visible.
        let inside = Path::new(group).strip_prefix(&self.root).ok().filter(|path| !path.starts_with(".."));
        let place = inside.map_or_else(|| self.point.clone(), |inside| self.point.join(inside));
        place.ancestors().take_while(|folder| folder.starts_with(&self.point)).map(PathBuf::from).collect()
    }
}

/// A path of mountinfo, where spaces, tabs, line ends and backslashes are octal: `\040`.
fn unescaped(text: &str) -> String {
    let mut parts = text.split('\\');
    let mut out = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        match part.get(..3).and_then(|digits| u8::from_str_radix(digits, 8).ok()) {
            Some(code) => {
                out.push(char::from(code));
                out.push_str(&part[3..]);
            }
            None => out.push_str(part),
        }
    }
    out
}

#[cfg(test)]
mod tests;
