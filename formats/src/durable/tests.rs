use std::io::{Error, ErrorKind};
use std::sync::Mutex;

use super::*;

fn names(root: &Path) -> Vec<String> {
    let mut names: Vec<_> = std::fs::read_dir(root)
        .unwrap()
        .map(|e| e.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

#[test]
fn a_file_is_written_whole_and_replaced_whole() {
    let dir = tempfile::tempdir().unwrap();
    let store = Directory::new(dir.path());
    store.write("film/c/0/1/2", b"first").unwrap();
    store.write("film/c/0/1/2", b"second").unwrap();
    assert_eq!(store.read("film/c/0/1/2").unwrap().unwrap(), b"second");
    assert_eq!(store.read_range("film/c/0/1/2", -3, 3).unwrap().unwrap(), b"ond");
    assert_eq!(names(&dir.path().join("film/c/0/1")), ["2"]);
    assert_eq!(store.read("film/c/9").unwrap(), None);
    assert_eq!(store.read("film/c/0/1/2/deeper").unwrap(), None);
    store.remove("film/c/0/1/2").unwrap();
    store.remove("film/c/0/1/2").unwrap();
    assert_eq!(store.size_of("film/c/0/1/2").unwrap(), None);
}

#[test]
fn a_failing_step_leaves_the_old_file_and_no_temp() {
    for step in [Step::Create, Step::Write, Step::Sync, Step::Rename] {
        let dir = tempfile::tempdir().unwrap();
        Directory::new(dir.path()).write("a", b"old").unwrap();
        let full = Directory::new(dir.path()).with_fault(move |s, _| {
            if s == step { Err(Error::from(ErrorKind::StorageFull)) } else { Ok(()) }
        });
        let e = full.write("a", b"new bytes").unwrap_err();
        assert!(e.is_storage_full() && e.retryable(), "{step:?}: {e}");
        assert!(e.to_string().contains(dir.path().to_str().unwrap()), "{e}");
        assert_eq!(full.read("a").unwrap().unwrap(), b"old");
        assert_eq!(names(dir.path()), ["a"]);
    }
}

#[test]
fn steps_come_in_the_order_that_survives_a_power_cut() {
    let dir = tempfile::tempdir().unwrap();
    let seen = Arc::new(Mutex::new(Vec::new()));
    let log = seen.clone();
    let store = Directory::new(dir.path()).with_fault(move |s, _| {
        log.lock().unwrap().push(s);
        Ok(())
    });
    store.write("a", b"x").unwrap();
    let mut seen = seen.lock().unwrap().clone();
    seen.dedup();
    assert_eq!(seen, [Step::Create, Step::Write, Step::Sync, Step::Rename, Step::SyncDirectory]);
}

#[test]
#[cfg_attr(not(target_os = "linux"), ignore = "unavailable: no /dev/full")]
fn a_full_device_is_told_apart() {
    let e = std::fs::File::options().write(true).open("/dev/full").unwrap().write_all(b"x").unwrap_err();
    assert!(DurableError::io("write", Path::new("/dev/full"), 1, e).is_storage_full());
}

#[test]
fn keys_do_not_leave_the_directory() {
    let store = Directory::new("/tmp/x");
    for key in ["../y", "/etc/passwd", "a/../../y"] {
        assert!(matches!(store.path(key), Err(DurableError::Key { .. })), "{key}");
    }
}

#[test]
fn the_sweep_takes_dead_files_only() {
    let dir = tempfile::tempdir().unwrap();
    let deep = dir.path().join("film/c/0");
    std::fs::create_dir_all(&deep).unwrap();
    let mine = temp_name();
    let parts: Vec<&str> = mine.splitn(8, '-').collect();
    let with = |i: usize, word: &str| {
        let mut p = parts.clone();
        p[i] = word;
        p.join("-")
    };
    let dead = [with(5, "4194303"), with(6, "1"), with(5, "4194302") + ".zip"];
    // Another host; another machine of this host name; a container; a name of an older version; no name of this program.
    let another = format!("{}-another-0123456789abcdef-{}", parts[..2].join("-"), parts[4..].join("-"));
    let older = [&parts[..2], &parts[3..]].concat().join("-");
    let foreign = [with(1, "elsewhere"), another, with(4, "12345"), older, ".tmp-what".to_owned()];
    for name in dead.iter().chain(&foreign).chain([&mine]) {
        std::fs::write(deep.join(name), b"half").unwrap();
    }
    std::fs::write(deep.join("7"), b"whole").unwrap();
    assert_eq!(Directory::new(dir.path()).names("film/c/0").unwrap(), ["7"]);
    let s = sweep(dir.path()).unwrap();
    assert_eq!((s.removed.len(), s.live.len(), s.foreign.len(), s.kept.len()), (3, 1, 5, 0), "{s:?}");
    assert_eq!(names(&deep).len(), 7);
    assert_eq!(sweep(&dir.path().join("nowhere")).unwrap(), Sweep::default());
}

#[test]
fn the_sweep_removes_temporary_files_of_every_kind() {
    let dir = tempfile::tempdir().unwrap();
    let dead = |n: &str| {
        let mine = temp_name();
        let parts: Vec<&str> = mine.splitn(8, '-').collect();
        dir.path().join(format!("{}-4194303-{}-{n}", parts[..5].join("-"), parts[6]))
    };
    let outside = dir.path().join("outside");
    std::fs::create_dir(&outside).unwrap();
    std::fs::write(outside.join("mine"), b"mine").unwrap();
    rustix::fs::mkfifoat(rustix::fs::CWD, dead("fifo"), 0o600.into()).unwrap();
    std::os::unix::fs::symlink(&outside, dead("link")).unwrap();
    drop(std::os::unix::net::UnixListener::bind(dir.path().join("s")).unwrap());
    std::fs::rename(dir.path().join("s"), dead("socket")).unwrap();
    std::fs::create_dir_all(dead("directory").join("a/b")).unwrap();
    let s = sweep(dir.path()).unwrap();
    assert_eq!((s.removed.len(), s.kept.len()), (4, 0), "{s:?}");
    assert_eq!((names(dir.path()), names(&outside)), (vec!["outside".to_owned()], vec!["mine".to_owned()]));
}
