//! Films at a URL.

use super::*;

#[test]
fn film_at_a_url_has_the_same_content_as_in_a_directory() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("film.zarr");
    let url = Path::new("memory://film/deep/film.zarr");
    let both = [&path, url].map(|path| {
        let film = FilmStore::create(path, spec(), provenance(), false).unwrap();
        fill(&film);
        film.group().write_record("runs/1-host-2.json", b"{}").unwrap();
        check(path, "film", Rect::new(0, 0, 150, 100), false);
        assert!(matches!(
            FilmStore::create(path, spec(), provenance(), false),
            Err(GroupError::Exists { .. })
        ));
        FilmStore::open(path, false).unwrap()
    });
    assert_eq!(contents(&both[0]), contents(&both[1]));
    let film = &both[1];
    assert!(
        film.group().lock("whole", false).unwrap().is_none()
            && film.group().sweep().unwrap() == Sweep::default()
    );
    assert_eq!(
        (film.group().runs().unwrap().len(), film.verify(2, &|_, _| ()).unwrap().findings),
        (1, vec![])
    );
    film.remove_shard(0, 1, (2, 1)).unwrap();
    let missing = Finding::Missing { key: "film/c/1/2/1".into() };
    assert_eq!(film.verify(2, &|_, _| ()).unwrap().findings, [missing]);
    FilmStore::remove(url).unwrap();
    assert!(!film.group().store.exists().unwrap());
    assert!(matches!(FilmStore::open(url, false), Err(GroupError::NotOfKind { .. })));
}

#[test]
fn unfinished_creation_at_a_url_is_resumed_and_foreign_objects_are_an_error() {
    let url = Path::new("memory://other/film.zarr");
    let store = Store::at(url).unwrap();
    // From a creation that was killed.
    store.write("y/c/0", vec![0; 3]).unwrap();
    FilmStore::create(url, spec(), provenance(), false).unwrap();
    FilmStore::remove(url).unwrap();
    // A shard without a film may belong to any job.
    store.write("film/c/0/0/0", vec![0; 3]).unwrap();
    assert!(matches!(FilmStore::create(url, spec(), provenance(), false), Err(GroupError::Exists { .. })));
    assert!(matches!(FilmStore::open(url, false), Err(GroupError::NotOfKind { .. })));
    assert!(matches!(FilmStore::remove(url), Err(GroupError::NotOfKind { .. })));
}

#[test]
fn commit_at_a_url_fails_if_the_film_was_removed_or_replaced() {
    let url = Path::new("memory://replaced/film.zarr");
    let job = |digest: &str| {
        let mut attributes = provenance();
        attributes.insert("job_digest".into(), digest.into());
        FilmStore::create(url, spec(), attributes, false).unwrap()
    };
    let film = job("a");
    let shard = film.encode_shard(0, 0, (0, 0), &[1.0; 64 * 64]).unwrap();
    film.commit(&shard).unwrap();
    FilmStore::remove(url).unwrap();
    let e = film.commit(&shard).unwrap_err();
    assert!(matches!(e, GroupError::Storage(DurableError::StoreMissing { .. })) && e.retryable(), "{e}");
    let other = job("b");
    assert!(matches!(film.commit(&shard), Err(GroupError::Replaced { .. })));
    assert!(other.shards_bytes(&[(0, 0, (0, 0))]).unwrap()[0].is_none());
}
