use super::directory_flock::{GIVE_UP_AFTER, REPORT_AFTER, hold};
use super::*;
use std::fs::File;
use std::time::Duration;

#[test]
fn second_lock_of_a_unit_is_held_by_this_process() {
    let dir = tempfile::tempdir().unwrap();
    let runs = dir.path().join("runs");
    let lock = Lock::take(&runs, "film", false).unwrap();
    let e = Lock::take(&runs, "film", true).unwrap_err();
    assert!(
        matches!(&e, LockError::Held { owner, .. } if owner.process == *ProcessIdentity::current()),
        "{e}"
    );
    assert!(e.retryable() && e.to_string().contains(&std::process::id().to_string()), "{e}");
    let other = Lock::take(&runs, "unit-7", false).unwrap();
    let found = locks(&runs).unwrap();
    assert_eq!(found.iter().map(|l| l.2).collect::<Vec<_>>(), [Some(false); 2]);
    drop((lock, other));
    assert_eq!(std::fs::read_dir(&runs).unwrap().count(), 0);
    Lock::take(&runs, "film", false).unwrap();
}

#[test]
fn lock_of_ended_owner_is_taken_and_of_unknown_owner_needs_take_over() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("film.lock");
    let write_lock = |change: &dyn Fn(&mut ProcessIdentity)| {
        let process = ProcessIdentity::current().clone();
        let mut owner = LockOwner { unit: "film".into(), process, since_unix_s: 1 };
        change(&mut owner.process);
        std::fs::write(&path, serde_json::to_vec(&owner).unwrap()).unwrap();
    };
    let ended: [&dyn Fn(&mut ProcessIdentity); 2] = [&|p| p.pid = 4_194_303, &|p| p.start += 1];
    for change in ended {
        write_lock(change);
        assert_eq!(locks(dir.path()).unwrap()[0].2, Some(true));
        drop(Lock::take(dir.path(), "film", false).unwrap());
    }
    let unknown: [&dyn Fn(&mut ProcessIdentity); 3] = [
        &|p| p.host = "elsewhere".into(),
        &|p| p.namespace = "1".into(),
        // Two machines with one host name.
        &|p| (p.boot, p.machine) = ("0123456789abcdef".into(), "another".into()),
    ];
    for change in unknown {
        write_lock(change);
        let e = Lock::take(dir.path(), "film", false).unwrap_err();
        assert!(matches!(e, LockError::Elsewhere { owner: Some(_), .. }) && path.exists(), "{e}");
        assert!(e.to_string().contains("--take-over"), "{e}");
        drop(Lock::take(dir.path(), "film", true).unwrap());
    }
    std::fs::write(&path, b"{").unwrap();
    let e = Lock::take(dir.path(), "film", false).unwrap_err();
    assert!(matches!(e, LockError::Elsewhere { owner: None, .. }), "{e}");
    drop(Lock::take(dir.path(), "film", true).unwrap());
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
}

#[test]
fn lock_path_that_is_not_a_regular_file_is_an_error_without_blocking() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("film.lock");
    let take = || Lock::take(dir.path(), "film", true).unwrap_err();
    let rejects = |found: &str| {
        let e = take();
        assert!(matches!(e, LockError::NotAFile { .. }) && !e.retryable(), "{found}: {e}");
        assert!(e.to_string().contains(found) && e.to_string().contains("film.lock"), "{e}");
        assert_eq!(locks(dir.path()).unwrap()[0].2, None, "{found}");
    };
    let fifo = || rustix::fs::mkfifoat(rustix::fs::CWD, &path, 0o600.into()).unwrap();
    fifo();
    rejects("a FIFO");
    std::fs::remove_file(&path).unwrap();
    std::fs::create_dir(&path).unwrap();
    rejects("a directory");
    std::fs::remove_dir(&path).unwrap();
    let socket = std::os::unix::net::UnixListener::bind(&path).unwrap();
    rejects("a socket");
    drop(socket);
    std::fs::remove_file(&path).unwrap();
    std::os::unix::fs::symlink("/dev/zero", &path).unwrap();
    rejects("a symbolic link");
    std::fs::remove_file(&path).unwrap();
    File::create(&path).unwrap().set_len(1 << 40).unwrap();
    assert!(matches!(Lock::take(dir.path(), "film", false), Err(LockError::Elsewhere { owner: None, .. })));
    drop(Lock::take(dir.path(), "film", true).unwrap());
    let file = dir.path().join("runs");
    rustix::fs::mkfifoat(rustix::fs::CWD, &file, 0o600.into()).unwrap();
    assert!(matches!(Lock::take(&file, "film", false), Err(LockError::Storage(_))));
}

#[test]
fn flock_held_beyond_the_limit_is_a_retryable_error_naming_the_holder() {
    let dir = tempfile::tempdir().unwrap();
    let held = hold(dir.path(), REPORT_AFTER, GIVE_UP_AFTER).unwrap();
    let waited = hold(dir.path(), Duration::ZERO, Duration::from_millis(60)).unwrap_err();
    assert!(waited.retryable(), "{waited}");
    let own = format!("process {} of this host", std::process::id());
    let listed = Path::new("/proc/locks").exists();
    assert!(waited.to_string().contains(if listed { &own } else { "an unknown process" }), "{waited}");
    drop(held);
    drop(hold(dir.path(), REPORT_AFTER, GIVE_UP_AFTER).unwrap());
}

#[test]
fn one_of_many_takes_the_lock_of_an_ended_owner() {
    let dir = tempfile::tempdir().unwrap();
    let ended = LockOwner {
        unit: "film".into(),
        process: ProcessIdentity { start: 1, ..ProcessIdentity::current().clone() },
        since_unix_s: 1,
    };
    for _ in 0..20 {
        std::fs::write(dir.path().join("film.lock"), serde_json::to_vec(&ended).unwrap()).unwrap();
        let won: Vec<_> = std::thread::scope(|s| {
            let all: Vec<_> = (0..6).map(|_| s.spawn(|| Lock::take(dir.path(), "film", false))).collect();
            all.into_iter().filter_map(|t| t.join().unwrap().ok()).collect()
        });
        assert_eq!(won.len(), 1);
        drop(won);
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
    }
}
