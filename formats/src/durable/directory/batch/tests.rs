use std::io::{Error, ErrorKind};
use std::sync::{Arc, Mutex};

use super::super::super::step::FileStep;
use super::super::super::temp::is_temp_name;
use super::*;

/// Rank 0: two files beside the shards. Rank 1: three shards.
const FILES: [(&str, u8); 5] =
    [("veil/c/0", 0), ("film/c/0/0/0", 1), ("film/c/0/1/0", 1), ("veil/c/1", 0), ("film/c/1/0/0", 1)];

fn staged(directory: &Directory) -> Batch {
    let mut batch = Batch::new(directory.clone());
    for (key, rank) in FILES {
        batch.stage(key, rank, key.as_bytes()).unwrap();
    }
    batch
}

/// Keys that have their complete bytes; other files below the root are an error, unless they are temporary.
fn present(root: &Path) -> Vec<String> {
    let keys = Directory::new(root).all_entries().unwrap();
    let names =
        |key: &String| key.rsplit('/').next().is_some_and(|name| !name.is_empty() && !is_temp_name(name));
    let keys: Vec<String> = keys.into_iter().filter(names).collect();
    for key in &keys {
        assert_eq!(std::fs::read(root.join(key)).unwrap(), key.as_bytes(), "{key}");
    }
    keys
}

#[test]
fn files_are_flushed_before_they_have_their_names_and_lower_ranks_before_higher() {
    let dir = tempfile::tempdir().unwrap();
    let log: Arc<Mutex<Vec<(FileStep, PathBuf)>>> = Arc::default();
    let steps = Arc::clone(&log);
    let directory = Directory::new(dir.path()).with_fault(move |step, path| {
        steps.lock().unwrap().push((step, path.into()));
        Ok(())
    });
    for directory in [directory.clone(), directory.opened().unwrap().unwrap()] {
        log.lock().unwrap().clear();
        let mut batch = staged(&directory);
        assert_eq!(present(dir.path()), Vec::<String>::new());
        batch.commit().unwrap();
        assert_eq!(present(dir.path()).len(), FILES.len());
        let log = log.lock().unwrap();
        let at = |wanted: FileStep| -> Vec<usize> {
            log.iter().enumerate().filter(|(_, (step, _))| *step == wanted).map(|(n, _)| n).collect()
        };
        let (written, flushed, renamed) = (at(FileStep::Write), at(FileStep::Sync), at(FileStep::Rename));
        assert_eq!((flushed.len(), renamed.len()), (FILES.len(), FILES.len()));
        assert!(written.last() < flushed.first() && flushed.last() < renamed.first());
        for rank in [0, 1] {
            let keys: Vec<&str> = FILES.iter().filter(|f| f.1 == rank).map(|f| f.0).collect();
            let (first, last) = if rank == 0 { (0, 1) } else { (2, 4) };
            for at in &renamed[first..=last] {
                let key = log[*at].1.strip_prefix(dir.path()).unwrap().to_str().unwrap();
                assert!(keys.contains(&key), "rank {rank}: {key}");
            }
            let end = renamed.get(last + 1).copied().unwrap_or(log.len());
            let flushed: BTreeSet<&Path> =
                log[renamed[last] + 1..end].iter().map(|(_, p)| p.as_path()).collect();
            let above = |key: &&str| {
                Path::new(key).ancestors().skip(1).map(|p| dir.path().join(p)).collect::<Vec<_>>()
            };
            let expected: BTreeSet<PathBuf> = keys.iter().flat_map(above).collect();
            assert_eq!(flushed, expected.iter().map(PathBuf::as_path).collect(), "rank {rank}");
            assert!(log[renamed[last] + 1..end].iter().all(|(step, _)| *step == FileStep::SyncDirectory));
        }
        drop(log);
        std::fs::remove_dir_all(dir.path().join("film")).unwrap();
        std::fs::remove_dir_all(dir.path().join("veil")).unwrap();
    }
}

#[test]
fn failed_step_leaves_complete_files_of_lower_ranks_first_and_no_temporary_file() {
    for failing in [FileStep::Sync, FileStep::Rename, FileStep::SyncDirectory] {
        for n in 0.. {
            let dir = tempfile::tempdir().unwrap();
            let count = Mutex::new(0);
            let directory = Directory::new(dir.path()).with_fault(move |step, _| {
                let mut count = count.lock().unwrap();
                *count += u32::from(step == failing);
                if step == failing && *count == n + 1 {
                    Err(Error::from(ErrorKind::StorageFull))
                } else {
                    Ok(())
                }
            });
            let mut batch = staged(&directory);
            let committed = batch.commit();
            let keys = present(dir.path());
            let all = directory.all_entries().unwrap();
            assert!(!all.iter().any(|key| key.contains(".tmp-")), "{failing:?} {n}: {all:?}");
            assert!(batch.is_empty());
            let Err(error) = committed else {
                assert!(n > 4 && keys.len() == FILES.len(), "{failing:?} {n}");
                break;
            };
            assert!(error.is_storage_full(), "{error}");
            let of = |array: &str| keys.iter().filter(|key| key.starts_with(array)).count();
            assert!(failing != FileStep::Sync || keys.is_empty(), "{failing:?} {n}: {keys:?}");
            assert!(of("film") == 0 || of("veil") == 2, "{failing:?} {n}: {keys:?}");
        }
    }
}

#[test]
fn batch_that_is_dropped_leaves_nothing_and_one_of_many_files_is_due() {
    let dir = tempfile::tempdir().unwrap();
    let directory = Directory::new(dir.path());
    drop(staged(&directory));
    assert!(!directory.all_entries().unwrap().iter().any(|key| !key.ends_with('/')));
    let mut batch = Batch::new(directory.with_fsync(false));
    for n in 0..MAX_FILES {
        assert!(!batch.is_due());
        batch.stage(&format!("c/{n}"), 0, b"").unwrap();
    }
    assert!(batch.is_due());
    batch.commit().unwrap();
    assert!(batch.is_empty() && !batch.is_due());
}
