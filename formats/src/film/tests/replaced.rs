//! Films that are removed or replaced while they are written; removal of films; links.

use super::*;

#[test]
fn commit_to_a_removed_film_fails_and_creates_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("film.zarr");
    let film = FilmStore::create(&path, spec(), provenance(), false).unwrap();
    let shard = film.encode_shard(0, 0, (2, 1), &vec![1.0; 22 * 36]).unwrap();
    std::fs::remove_dir_all(&path).unwrap();
    let e = film.commit(&shard).unwrap_err();
    assert!(e.retryable() && e.to_string().contains("has disappeared since the job started"), "{e}");
    assert!(film.verify(1, &|_, _| ()).unwrap_err().retryable() && !path.exists());
}

/// A film of job `digest`, without a shard.
fn film_of_job(path: &Path, digest: &str) -> FilmStore {
    let mut attributes = provenance();
    attributes.insert("job_digest".into(), digest.into());
    FilmStore::create(path, spec(), attributes, true).unwrap()
}

#[test]
fn write_during_which_the_film_is_replaced_fails_and_leaves_the_new_film_unchanged() {
    use std::sync::atomic::{AtomicBool, Ordering};
    let dir = tempfile::tempdir().unwrap();
    for (n, at) in
        [FileStep::Create, FileStep::Write, FileStep::Sync, FileStep::Rename, FileStep::SyncDirectory]
            .into_iter()
            .enumerate()
    {
        for digest in ["b", "a"] {
            let path = dir.path().join(format!("{n}-{digest}.zarr"));
            let (target, replaced) = (path.clone(), AtomicBool::new(false));
            let film = film_of_job(&path, "a").with_directory(|d| {
                d.with_fault(move |step, _| {
                    if step == at && !replaced.swap(true, Ordering::SeqCst) {
                        FilmStore::remove(&target).unwrap();
                        film_of_job(&target, digest);
                    }
                    Ok(())
                })
            });
            let shard = film.encode_shard(0, 0, (0, 0), &[1.0; 64 * 64]).unwrap();
            let e = film.commit(&shard).unwrap_err();
            let expected = match digest {
                "b" => matches!(e, GroupError::Replaced { .. }) && !e.retryable(),
                _ => matches!(e, GroupError::Recreated { .. }) && e.retryable(),
            };
            assert!(expected, "{at:?}: {e}");
            assert!(
                film.group().write_record("runs/1.json", b"{}").is_err()
                    && film.group().lock("whole", false).is_err()
            );
            let fresh = film_of_job(&dir.path().join(format!("fresh-{n}-{digest}.zarr")), digest);
            assert_eq!(contents(&FilmStore::open(&path, false).unwrap()), contents(&fresh), "{at:?}");
            assert!(!path.join("runs").exists());
        }
    }
    let names = std::fs::read_dir(dir.path()).unwrap().map(|e| e.unwrap().file_name());
    assert!(names.into_iter().all(|n| n.to_string_lossy().ends_with(".zarr")), "no temp directory is left");
}

#[test]
fn film_with_foreign_files_is_not_removed() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("film.zarr");
    for foreign in ["chart.npy", "pack.lens.zarr/zarr.json", "film/notes.txt", "runs/job.json"] {
        let film = FilmStore::create(&path, spec(), provenance(), false).unwrap();
        film.group().write_record("runs/1763740000-host-7.json", b"{}").unwrap();
        film.group().write_record(foreign, b"mine").unwrap();
        let before = contents(&film);
        let e = FilmStore::remove(&path).unwrap_err();
        assert!(matches!(&e, GroupError::Foreign { names, .. } if *names == [foreign]), "{e}");
        assert_eq!(contents(&film), before);
        std::fs::remove_file(path.join(foreign)).unwrap();
        if foreign.starts_with("pack") {
            // An empty directory is foreign, too.
            assert!(matches!(FilmStore::remove(&path), Err(GroupError::Foreign { .. })));
            std::fs::remove_dir(path.join("pack.lens.zarr")).unwrap();
        }
        FilmStore::remove(&path).unwrap();
    }
    // At a URL.
    let url = Path::new("memory://foreign/film.zarr");
    let film = FilmStore::create(url, spec(), provenance(), false).unwrap();
    film.group().write_record("chart.npy", b"mine").unwrap();
    assert!(matches!(FilmStore::remove(url), Err(GroupError::Foreign { .. })));
    assert!(
        film.group().store.read("chart.npy").unwrap().is_some()
            && film.group().store.read("zarr.json").unwrap().is_some()
    );
}

#[test]
fn symbolic_link_to_a_film_is_kept() {
    let dir = tempfile::tempdir().unwrap();
    let (real, link) = (dir.path().join("disk/film.zarr"), dir.path().join("film.zarr"));
    std::os::unix::fs::symlink("disk/film.zarr", &link).unwrap();
    // A dangling link; a link to a film; the same with a trailing slash.
    for path in [link.clone(), link.clone(), dir.path().join("film.zarr/")] {
        FilmStore::remove(&path).unwrap();
        let film = FilmStore::create(&path, spec(), provenance(), false).unwrap();
        fill(&film);
        assert!(link.is_symlink() && real.join("film/c/0/0/0").is_file() && !real.is_symlink());
        check(&link, "film", Rect::new(0, 0, 150, 100), false);
    }
}
