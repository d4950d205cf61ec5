use super::*;
use std::collections::BTreeMap;

const V2_MOUNT: &str = "30 23 0:28 / /sys/fs/cgroup rw,nosuid shared:4 - cgroup2 cgroup2 rw,nsdelegate\n";
const V1_MOUNTS: &str = "31 23 0:28 / /sys/fs/cgroup rw - tmpfs tmpfs rw,mode=755\n\
                         32 31 0:29 / /sys/fs/cgroup/cpu rw - cgroup cgroup rw,cpu\n\
                         35 31 0:32 / /sys/fs/cgroup/memory rw,relatime - cgroup cgroup rw,memory\n\
                         41 31 0:38 / /sys/fs/cgroup/unified rw - cgroup2 cgroup2 rw\n";

/// The memory that files with these texts describe.
fn memory_of(files: &[(&str, &str)]) -> Option<GroupMemory> {
    let files: BTreeMap<&Path, &str> = files.iter().map(|(path, text)| (Path::new(*path), *text)).collect();
    group_memory(&|path| files.get(path).map(|text| (*text).to_owned()))
}

fn v2<'a>(more: &[(&'a str, &'a str)]) -> Option<GroupMemory> {
    let head = [("/proc/self/cgroup", "0::/user/job\n"), ("/proc/self/mountinfo", V2_MOUNT)];
    memory_of(&[&head, more].concat())
}

#[test]
fn version_2_counts_inactive_file_pages_as_available() {
    let files = [
        ("/sys/fs/cgroup/user/job/memory.max", "1000\n"),
        ("/sys/fs/cgroup/user/job/memory.high", "max\n"),
        ("/sys/fs/cgroup/user/job/memory.current", "700\n"),
        ("/sys/fs/cgroup/user/job/memory.stat", "anon 100\ninactive_anon 9\ninactive_file 200\nslab 3\n"),
    ];
    assert_eq!(v2(&files), Some(GroupMemory { limit: 1000, left: 500 }));
}

#[test]
fn version_2_high_limits_as_max_does() {
    let files = [
        ("/sys/fs/cgroup/user/job/memory.max", "1000\n"),
        ("/sys/fs/cgroup/user/job/memory.high", "800\n"),
        ("/sys/fs/cgroup/user/job/memory.current", "700\n"),
    ];
    assert_eq!(v2(&files), Some(GroupMemory { limit: 800, left: 100 }));
}

#[test]
fn every_group_above_limits() {
    let files = [
        ("/sys/fs/cgroup/user/job/memory.max", "1000\n"),
        ("/sys/fs/cgroup/user/job/memory.current", "100\n"),
        ("/sys/fs/cgroup/user/memory.max", "2000\n"),
        ("/sys/fs/cgroup/user/memory.current", "1900\n"),
        ("/sys/fs/cgroup/user/memory.stat", "inactive_file 50\n"),
    ];
    assert_eq!(v2(&files), Some(GroupMemory { limit: 1000, left: 150 }));
    // More used than allowed: a limit that was lowered.
    let files = [("/sys/fs/cgroup/user/memory.max", "5\n"), ("/sys/fs/cgroup/user/memory.current", "9\n")];
    assert_eq!(v2(&files), Some(GroupMemory { limit: 5, left: 0 }));
}

#[test]
fn no_limit_is_none() {
    let max = [
        ("/sys/fs/cgroup/user/job/memory.max", "max\n"),
        ("/sys/fs/cgroup/user/job/memory.high", "max\n"),
        ("/sys/fs/cgroup/user/job/memory.current", "700\n"),
    ];
    assert_eq!(v2(&max), None);
    assert_eq!(v2(&[]), None);
    assert_eq!(memory_of(&[]), None);
    // Not Linux's text.
    assert_eq!(
        memory_of(&[("/proc/self/cgroup", "x\n0:\n"), ("/proc/self/mountinfo", "31 23 - \n -\n")]),
        None
    );
    // Version 1: the largest number of pages.
    let files = [
        ("/proc/self/cgroup", "4:memory:/\n"),
        ("/proc/self/mountinfo", V1_MOUNTS),
        ("/sys/fs/cgroup/memory/memory.limit_in_bytes", "9223372036854771712\n"),
        ("/sys/fs/cgroup/memory/memory.usage_in_bytes", "700\n"),
    ];
    assert_eq!(memory_of(&files), None);
}

#[test]
fn version_1_has_its_own_names_and_the_limit_of_hidden_ancestors() {
    let files = [
        ("/proc/self/cgroup", "9:name=systemd:/\n4:hugetlb,memory:/a b\n1:cpu:/\n0::/\n"),
        ("/proc/self/mountinfo", V1_MOUNTS),
        ("/sys/fs/cgroup/memory/a b/memory.limit_in_bytes", "1000\n"),
        ("/sys/fs/cgroup/memory/a b/memory.usage_in_bytes", "700\n"),
        (
            "/sys/fs/cgroup/memory/a b/memory.stat",
            "inactive_file 1\nhierarchical_memory_limit 900\ntotal_inactive_file 100\n",
        ),
    ];
    assert_eq!(memory_of(&files), Some(GroupMemory { limit: 900, left: 300 }));
}

#[test]
fn group_of_a_container_is_found_where_it_is_mounted() {
    // Without a namespace of its own: the group's name is that outside, and the container's group is what is mounted.
    let mount = "50 49 0:32 /docker/4f3a /sys/fs/my\\040cgroup ro - cgroup cgroup rw,memory\n";
    let files = |group: &'static str| {
        [
            ("/proc/self/cgroup", group),
            ("/proc/self/mountinfo", mount),
            ("/sys/fs/my cgroup/memory.limit_in_bytes", "1000\n"),
            ("/sys/fs/my cgroup/memory.usage_in_bytes", "700\n"),
            ("/sys/fs/my cgroup/inner/memory.limit_in_bytes", "400\n"),
            ("/sys/fs/my cgroup/inner/memory.usage_in_bytes", "200\n"),
        ]
    };
    assert_eq!(memory_of(&files("4:memory:/docker/4f3a\n")), Some(GroupMemory { limit: 1000, left: 300 }));
    assert_eq!(
        memory_of(&files("4:memory:/docker/4f3a/inner\n")),
        Some(GroupMemory { limit: 400, left: 200 })
    );
    // A group that is not below the mounted one.
    assert_eq!(memory_of(&files("4:memory:/docker/other\n")), Some(GroupMemory { limit: 1000, left: 300 }));
    assert_eq!(memory_of(&files("4:memory:/../other\n")), Some(GroupMemory { limit: 1000, left: 300 }));
}
