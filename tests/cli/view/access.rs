//! Access control, and checks of paths and parameters.

use super::*;

#[test]
fn foreign_host_origin_or_method_is_rejected() {
    let job = film();
    let server = Server::start(&[text(&job.film)]);
    let own = format!("Host: 127.0.0.1:{}\r\n", server.port);
    let page = server.get_text("/");
    let policy = "content-security-policy: default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'";
    assert!(
        page.contains(policy) && page.contains("cache-control: no-store") && page.contains("nosniff"),
        "{page}"
    );
    assert!(
        page.contains("cross-origin-resource-policy: same-origin") && page.contains("<title>lenscube"),
        "{page}"
    );
    assert_eq!(server.get_as("/", &format!("Host: localhost:{}\r\n", server.port)).0, 200);
    for host in ["evil.example", "127.0.0.1", "127.0.0.1:1", "127.0.0.1.evil.example", "169.254.1.1", ""] {
        for path in ["/", "/api/content", "/tile/film/0/0_0.png?band=0&exposure=1&gamma=1"] {
            assert_eq!(server.get_as(path, &format!("Host: {host}\r\n")).0, 403, "{host}{path}");
        }
    }
    assert_eq!(server.get_as("/", &format!("{own}Host: evil.example\r\n")).0 / 100, 4);
    assert_eq!(server.get_as("/", "").0 / 100, 4);
    let mine = format!("{own}Origin: http://127.0.0.1:{}\r\n", server.port);
    assert_eq!(server.get_as("/api/content", &mine).0, 200);
    for origin in ["http://evil.example", "null", "https://127.0.0.1", "http://127.0.0.1:1"] {
        assert_eq!(server.get_as("/api/content", &format!("{own}Origin: {origin}\r\n")).0, 403, "{origin}");
    }
    for site in ["cross-site", "same-site"] {
        let from = format!("{own}Sec-Fetch-Site: {site}\r\n");
        assert_eq!(server.get_as("/api/content", &from).0, 403, "{site}");
        assert_eq!(server.get_as("/", &format!("{from}Sec-Fetch-Mode: navigate\r\n")).0, 200, "{site}");
        assert_eq!(
            server.get_as("/crop.png", &format!("{from}Sec-Fetch-Mode: navigate\r\n")).0,
            403,
            "{site}"
        );
    }
    assert_eq!(
        server
            .send(&format!(
                "POST /api/content HTTP/1.1\r\n{own}Content-Length: 0\r\nConnection: close\r\n\r\n"
            ))
            .0,
        405
    );
}

#[test]
fn invalid_paths_and_parameters_return_4xx() {
    let job = film();
    let server = Server::start(&[text(&job.film)]);
    for path in [
        "/../../etc/passwd",
        "/..%2f..%2fetc/passwd",
        "/tile/../../zarr.json",
        "/tile/film/0/..%2f..%2fzarr.json",
        "/tile/%2e%2e/0/0_0.png?band=0&exposure=1&gamma=1",
        "/page/page.html",
        "//etc/passwd",
    ] {
        let (status, answer) = server.get(path);
        assert!((400..500).contains(&status), "{path}: {status}");
        assert!(!String::from_utf8_lossy(&answer).contains("root:"), "{path}");
    }
    let tile = |what: &str| server.get(&format!("/tile/{what}")).0;
    let look = "band=0&exposure=1&gamma=1";
    assert_eq!(tile(&format!("film/0/0_0.png?{look}")), 200);
    for what in [
        "film/3/0_0.png",
        "film/0/3_0.png",
        "film/0/0_3.png",
        "film/99999999999999999999/0_0.png",
        "film/0/-1_0.png",
        "film/0/0_0.jpg",
        "film/0/4294967296_0.png",
        "film/-1/0_0.png",
        "chart/0/0_0.png",
        "nothing/0/0_0.png",
        "film/0/0.png",
        "film/0/٠_0.png",
    ] {
        assert!((400..=404).contains(&tile(&format!("{what}?{look}"))), "{what}");
    }
    for look in [
        "",
        "band=2&exposure=1&gamma=1",
        "band=0&exposure=0&gamma=1",
        "band=0&exposure=1e99&gamma=1",
        "band=0&exposure=NaN&gamma=1",
        "band=0&exposure=1&gamma=9",
        "white=D50&exposure=1&gamma=1",
    ] {
        assert_eq!(tile(&format!("film/0/0_0.png?{look}")), 400, "{look}");
    }
    for crop in ["x=0&y=0&w=706&h=1", "x=705&y=0&w=1&h=1", "x=0&y=0&w=0&h=0", "x=-1&y=0&w=1&h=1", "w=1&h=1"] {
        assert_eq!(server.get(&format!("/crop.png?{crop}&{look}")).0, 400, "{crop}");
    }
    assert_eq!(server.get("/api/pixel?x=705&y=0").0, 400);
    assert_eq!(server.get(&format!("/api/pixel?x={}&y=0", "9".repeat(5000))).0, 400);
    assert!((400..500).contains(&server.get(&format!("/{}", "a".repeat(70_000))).0));
}

#[test]
fn connections_without_a_complete_request_do_not_block_others() {
    let job = film();
    let server = Server::start_with_descriptors(&[text(&job.film)], 40);
    let connect = |sent: &str| {
        let mut stream = TcpStream::connect(("127.0.0.1", server.port)).unwrap();
        stream.write_all(sent.as_bytes()).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        stream
    };
    // More than the server may open: silent ones, parts of a head, and idle ones after a complete request.
    let host = format!("Host: 127.0.0.1:{}\r\n", server.port);
    let head = format!("GET / HTTP/1.1\r\n{host}");
    let complete = format!("GET /icon.svg HTTP/1.1\r\n{host}\r\n");
    let held: Vec<TcpStream> = (0..48).map(|n| connect([&complete, "", "GET /", &head][n % 4])).collect();
    for path in ["/", "/api/content", "/tile/film/0/0_0.png?band=0&exposure=1&gamma=1"] {
        assert_eq!(server.get(path).0, 200, "{path}");
    }
    // The server has closed them, also those that nothing was sent to.
    for mut stream in held {
        let mut answer = Vec::new();
        let ended = stream.read_to_end(&mut answer).map_err(|e| e.kind());
        assert!(ended.is_ok() || ended == Err(std::io::ErrorKind::ConnectionReset), "{ended:?}");
    }
}
