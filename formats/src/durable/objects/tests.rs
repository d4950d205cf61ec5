use super::*;

fn store(name: &str) -> Objects {
    Objects::at(Path::new(&format!("memory://{name}/deep/film.zarr"))).unwrap()
}

#[test]
fn what_is_put_is_read_whole_and_in_part() {
    let o = store("whole");
    assert_eq!((o.read_at_most("a/c/0", 9).unwrap(), o.size_of("a/c/0").unwrap()), (None, None));
    o.write("a/c/0", Bytes::from_static(b"first")).unwrap();
    o.write("a/c/0", Bytes::from_static(b"second")).unwrap();
    assert_eq!(o.read_at_most("a/c/0", 6).unwrap().unwrap(), b"second");
    assert!(matches!(o.read_at_most("a/c/0", 5), Err(DurableError::Length { expected: 5, found: 6, .. })));
    assert_eq!(o.read_range("a/c/0", 1, 3).unwrap().unwrap(), b"eco");
    assert_eq!(o.read_range("a/c/0", -3, 3).unwrap().unwrap(), b"ond");
    assert_eq!(o.read_range("a/c/0", -4, 2).unwrap().unwrap(), b"co");
    assert_eq!(o.read_range("a/c/1", -3, 3).unwrap(), None);
    for (offset, length) in [(4, 3), (6, 1), (60, 1), (-7, 7), (i64::MIN, 1), (i64::MAX, 9)] {
        let e = o.read_range("a/c/0", offset, length).unwrap_err();
        assert!(matches!(e, DurableError::Range { size: 6, .. }), "{offset} {length}: {e}");
    }
    let keys = ["a/c/1", "a/c/0"].map(str::to_owned);
    let states = o.states(&keys).unwrap();
    assert_eq!((states[0].as_ref(), states[1].as_ref().map(|s| s.size)), (None, Some(6)));
    o.write("a/c/0", Bytes::from_static(b"3econd")).unwrap();
    assert_ne!(o.states(&keys).unwrap(), states);
    o.remove("a/c/0").unwrap();
    o.remove("a/c/0").unwrap();
    assert_eq!(o.size_of("a/c/0").unwrap(), None);
}

#[test]
fn what_is_new_is_put_once() {
    let o = store("new");
    let put = |bytes: &'static [u8]| o.write_new("zarr.json", Bytes::from_static(bytes)).unwrap();
    assert!(put(b"one") && put(b"one") && !put(b"two"));
    assert_eq!(o.read_at_most("zarr.json", 9).unwrap().unwrap(), b"one");
}

#[test]
fn names_and_keys_are_those_below() {
    let o = store("names");
    assert!(!o.exists().unwrap() && o.names("").unwrap().is_empty());
    for key in ["film/c/0", "film/c/1", "runs/2.json", "runs/1.json", "zarr.json"] {
        o.write(key, Bytes::from_static(b"x")).unwrap();
    }
    let beside = Objects::at(Path::new("memory://names/deep/film.zarr.old")).unwrap();
    beside.write("zarr.json", Bytes::from_static(b"x")).unwrap();
    assert_eq!(o.names("").unwrap(), ["film", "runs", "zarr.json"]);
    assert_eq!(o.names("runs").unwrap(), ["1.json", "2.json"]);
    assert_eq!(o.first_key(|key| key.starts_with("runs")).unwrap().unwrap(), "runs/1.json");
    assert!(o.exists().unwrap());
    o.remove_all(vec!["film/c/7".into()]).unwrap();
    assert!(!o.exists().unwrap() && beside.exists().unwrap());
}

#[test]
fn keys_do_not_leave_the_prefix() {
    for key in ["../y", "a/../../y", "a//b"] {
        assert!(matches!(store("keys").size_of(key), Err(DurableError::Key { .. })), "{key}");
    }
}

#[test]
fn threads_of_another_runtime_may_wait_as_well() {
    let other = tokio::runtime::Builder::new_multi_thread().worker_threads(1).build().unwrap();
    let told = other.block_on(async { store("other").exists() });
    assert!(!told.unwrap());
}
