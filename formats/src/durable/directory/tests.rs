use std::io::{Error, ErrorKind, Write};
use std::sync::Mutex;

use super::super::temp::temp_name;
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
fn write_replaces_the_complete_file() {
    let dir = tempfile::tempdir().unwrap();
    let store = Directory::new(dir.path());
    store.write("film/c/0/1/2", b"first").unwrap();
    store.write("film/c/0/1/2", b"second").unwrap();
    assert_eq!(store.read("film/c/0/1/2").unwrap().unwrap(), b"second");
    assert_eq!(store.read_range("film/c/0/1/2", -3, 3).unwrap().unwrap(), b"ond");
    assert_eq!(names(&dir.path().join("film/c/0/1")), ["2"]);
    std::fs::write(dir.path().join("film/c/0/1").join(temp_name()), b"incomplete").unwrap();
    assert_eq!(store.names("film/c/0/1").unwrap(), ["2"]);
    assert_eq!(store.read("film/c/9").unwrap(), None);
    assert_eq!(store.read("film/c/0/1/2/deeper").unwrap(), None);
    store.remove("film/c/0/1/2").unwrap();
    store.remove("film/c/0/1/2").unwrap();
    assert_eq!(store.size_of("film/c/0/1/2").unwrap(), None);
}

#[test]
fn failed_step_leaves_the_old_file_and_no_temporary_file() {
    for step in [FileStep::Create, FileStep::Write, FileStep::Sync, FileStep::Rename] {
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
fn a_file_that_becomes_shorter_while_it_is_read_is_truncated() {
    let dir = tempfile::tempdir().unwrap();
    let store = Directory::new(dir.path()).with_fault(|step, path| match step {
        FileStep::Read => std::fs::write(path, b"short"),
        _ => Ok(()),
    });
    let range = |read: Result<(), DurableError>| match read.unwrap_err() {
        DurableError::Range { offset, length, size, .. } => (offset, length, size),
        other => panic!("{other:?}"),
    };
    for direct in [false, true] {
        std::fs::write(dir.path().join("a"), [7; 10_000]).unwrap();
        let read = match direct {
            true => store.read_direct("a", 100, 9000).map(drop),
            false => store.read_range("a", 100, 9000).map(drop),
        };
        assert_eq!(range(read), (100, 9000, 5), "{direct}");
    }
}

#[test]
fn steps_of_a_write_are_in_durable_order() {
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
    assert_eq!(
        seen,
        [FileStep::Create, FileStep::Write, FileStep::Sync, FileStep::Rename, FileStep::SyncDirectory]
    );
}

#[test]
#[cfg_attr(not(target_os = "linux"), ignore = "unavailable: no /dev/full")]
fn full_device_is_storage_full() {
    let e = std::fs::File::options().write(true).open("/dev/full").unwrap().write_all(b"x").unwrap_err();
    assert!(DurableError::io("write", Path::new("/dev/full"), 1, e).is_storage_full());
}

#[test]
fn key_outside_the_directory_is_an_error() {
    let store = Directory::new("/tmp/x");
    for key in ["../y", "/etc/passwd", "a/../../y"] {
        assert!(matches!(store.path(key), Err(DurableError::Key { .. })), "{key}");
    }
}
