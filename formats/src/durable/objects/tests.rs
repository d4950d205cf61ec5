use std::io::{Read, Write};

use super::super::url::check_url;
use super::*;

fn store(name: &str) -> Objects {
    Objects::at(Path::new(&format!("memory://{name}/deep/film.zarr"))).unwrap()
}

#[test]
fn written_object_is_read_completely_and_by_range() {
    let o = store("range");
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
fn write_new_does_not_replace_other_contents() {
    let o = store("new");
    let put = |bytes: &'static [u8]| o.write_new("zarr.json", Bytes::from_static(bytes)).unwrap();
    assert!(put(b"one") && put(b"one") && !put(b"two"));
    assert_eq!(o.read_at_most("zarr.json", 9).unwrap().unwrap(), b"one");
}

#[test]
fn names_and_keys_are_those_below_the_prefix() {
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
fn key_outside_the_prefix_is_an_error() {
    for key in ["../y", "a/../../y", "a//b"] {
        assert!(matches!(store("keys").size_of(key), Err(DurableError::Key { .. })), "{key}");
    }
}

#[test]
fn requests_work_on_threads_of_another_runtime() {
    let other = tokio::runtime::Builder::new_multi_thread().worker_threads(1).build().unwrap();
    let exists = other.block_on(async { store("other").exists() });
    assert!(!exists.unwrap());
}

fn problem(url: &str) -> String {
    Objects::at(Path::new(url)).unwrap_err().to_string()
}

#[test]
fn invalid_url_is_an_error_without_credentials() {
    for url in ["s3://AKIA:hush@bucket/x", "https://me:hush@host/x", "https://host/x?X-Amz-Signature=hush"] {
        let message = problem(url);
        assert!(!message.contains("hush") && !message.contains("AKIA"), "{message}");
    }
    assert!(problem("gs://bucket/x").contains("s3://BUCKET/PREFIX"));
    assert!(problem("s3:///x").contains("s3://BUCKET"));
    assert!(problem("s3://bucket/a//b").contains("s3://bucket/a//b"));
}

#[test]
fn malformed_address_is_an_error_and_no_panic() {
    for (url, expected) in [
        ("s3://my bucket/x", "bucket"),
        ("s3://bucket\n/x", "line breaks"),
        ("s3://bücket/x", "bucket"),
        ("http://ho st/x", "http://ho st/x"),
        ("http://host:port/x", "port"),
    ] {
        let message = problem(url);
        assert!(message.contains(expected) && !message.contains('\n'), "{url:?}: {message}");
        assert!(check_url(url).is_err(), "{url:?}");
    }
}

/// A web server that sends the first `interrupted` of its responses, each of a missing object, incompletely.
fn server_of_nothing(interrupted: usize) -> (String, std::thread::JoinHandle<usize>) {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("http://{}/x.zarr", listener.local_addr().unwrap());
    let server = std::thread::spawn(move || {
        let mut requests = 0;
        loop {
            let (mut stream, _) = listener.accept().unwrap();
            requests += 1;
            let mut request = [0; 4096];
            assert!(stream.read(&mut request).unwrap() > 0);
            let (sent, last) =
                (if requests <= interrupted { "not" } else { "not found" }, requests > interrupted);
            let head = "HTTP/1.1 404 Not Found\r\nContent-Length: 9\r\nConnection: close\r\n\r\n";
            stream.write_all(format!("{head}{sent}").as_bytes()).unwrap();
            if last {
                return requests;
            }
        }
    });
    (url, server)
}

#[test]
fn missing_object_is_missing_although_the_response_was_interrupted() {
    let (url, server) = server_of_nothing(2);
    let objects = Objects::at(Path::new(&url)).unwrap();
    assert_eq!(objects.read_at_most("a", 100).unwrap(), None);
    assert_eq!(server.join().unwrap(), 3);
}
