//! Server of `lenscube view`: access control, parameter checks, pixel values; shell completions and manual pages.

use crate::common::camera::{Place, develop, frame};
use crate::common::test_job::TestJob;
use crate::common::{lenscube, pixels, text};
use formats::chart::image::{ImageFile, Transfer};
use pipeline::geometry::Size;
use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

struct Server {
    child: Child,
    port: u16,
}

impl Server {
    fn start(words: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        command.arg("view").args(words);
        Self::start_as(command)
    }

    /// With at most `descriptors` open files.
    fn start_with_descriptors(words: &[&str], descriptors: usize) -> Self {
        let mut command = Command::new("sh");
        let limited = format!("ulimit -n {descriptors} && exec \"$0\" view \"$@\"");
        command.args(["-c", &limited, env!("CARGO_BIN_EXE_lenscube")]).args(words);
        Self::start_as(command)
    }

    fn start_as(mut command: Command) -> Self {
        command.stdout(Stdio::piped()).stderr(Stdio::null());
        let mut child = command.spawn().unwrap();
        let mut url = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut url).unwrap();
        let port = url.trim().strip_prefix("http://127.0.0.1:").and_then(|u| u.strip_suffix('/'));
        Self { child, port: port.unwrap_or_else(|| panic!("{url}")).parse().unwrap() }
    }

    /// Sends a raw request; status and complete response.
    fn send(&self, request: &str) -> (u16, Vec<u8>) {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        stream.write_all(request.as_bytes()).unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).unwrap();
        let status = String::from_utf8_lossy(&answer[..answer.len().min(12)]).into_owned();
        (status.get(9..12).and_then(|s| s.parse().ok()).unwrap_or_else(|| panic!("{status}")), answer)
    }

    fn get_as(&self, path: &str, headers: &str) -> (u16, Vec<u8>) {
        self.send(&format!("GET {path} HTTP/1.1\r\n{headers}Connection: close\r\n\r\n"))
    }

    fn get(&self, path: &str) -> (u16, Vec<u8>) {
        self.get_as(path, &format!("Host: 127.0.0.1:{}\r\n", self.port))
    }

    fn get_text(&self, path: &str) -> String {
        let (status, answer) = self.get(path);
        let answer = String::from_utf8_lossy(&answer).into_owned();
        assert_eq!(status, 200, "{path}: {answer}");
        answer
    }

    fn body(&self, path: &str) -> Vec<u8> {
        let (status, answer) = self.get(path);
        assert_eq!(status, 200, "{path}");
        let start = answer.windows(4).position(|w| w == b"\r\n\r\n").unwrap() + 4;
        answer[start..].to_vec()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn film() -> TestJob {
    let job = TestJob::large();
    job.run("", &["--no-fsync", "--pyramid"]).ok();
    job
}

/// A scene is shown as the chart that it is, with bands every 10 nm.
#[cfg(feature = "mesh")]
#[test]
fn a_scene_is_shown_as_a_chart() {
    use pipeline::colour::Illuminant;
    let folder = tempfile::tempdir().unwrap();
    let (mesh, scene) = (folder.path().join("wall.obj"), folder.path().join("scene.zarr"));
    std::fs::write(&mesh, "v -6 -6 -3\nv 6 -6 -3\nv 6 6 -3\nv -6 6 -3\nf 1 2 3 4\n").unwrap();
    let lens = ["--lens", "phone", "--focus-m", "1", "--film-size", "60x40", "--film-pitch-um", "6"];
    let view = ["--mesh-unit", "m", "--eye", "0,0,0", "--target", "0,0,-1", "--samples-per-px", "1"];
    lenscube(&[&["scene", text(&mesh), text(&scene)], &lens[..], &view].concat()).ok();
    let server = Server::start(&[text(&scene)]);
    let json = |path: &str| serde_json::from_slice::<Value>(&server.body(path)).unwrap();
    assert_eq!(json("/api/content")["bands"].as_array().unwrap().len(), 31);
    // Without a material the wall is 0.8 grey: radiance 0.8 E/π at 560 nm.
    let light = Illuminant::D65.irradiance_scale(1000.0) * Illuminant::D65.relative_power(560.0);
    let expected = 0.8 * light / std::f64::consts::PI;
    let found = json("/api/pixel?y=20&x=30")["film"][16].as_f64().unwrap();
    assert!((found / expected - 1.0).abs() < 0.01, "{found} {expected}");
}

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

#[test]
fn pixel_values_equal_those_of_the_store() {
    let job = film();
    let server = Server::start(&[text(&job.film), "--chart", text(&job.chart), "--lens", text(&job.pack)]);
    let (size, film) = pixels(&job.film, "film");
    let (_, chart) = pixels(&job.chart, "chart");
    for (x, y) in [(0, 0), (704, 630), (300, 77)] {
        let reading = String::from_utf8(server.body(&format!("/api/pixel?x={x}&y={y}"))).unwrap();
        for (name, bands) in [("film", &film), ("chart", &chart)] {
            let list =
                reading.split(&format!("\"{name}\":[")).nth(1).and_then(|t| t.split(']').next()).unwrap();
            let values: Vec<f32> = list.split(',').map(|v| v.parse().unwrap()).collect();
            let expected: Vec<f32> = bands.iter().map(|b| b[y * size.width + x]).collect();
            assert_eq!(values, expected, "{name} {x} {y}");
        }
    }
    let content = server.get_text("/api/content");
    for part in [
        "\"pyramid\":\"complete\"",
        "\"size\":[631,705]",
        "\"place\":[0.0,0.0,705.0,631.0]",
        "\"lens\":{\"name\":\"test\",\"note\":null}",
    ] {
        assert!(content.contains(part), "{part}: {content}");
    }
    let lens = server.get_text("/api/lens?x=704&y=0&band=1");
    assert!(lens.contains("\"relative_illumination\":1.0") && lens.contains("\"size\":5"), "{lens}");
    assert!(server.body("/psf.png?x=704&y=0&band=1&log=1").starts_with(b"\x89PNG"));
}

#[test]
fn tiles_are_equal_with_and_without_a_stored_pyramid() {
    let job = film();
    let bare = job.at("bare.zarr");
    job.command(&bare, "", &["--no-fsync"]).output().unwrap();
    assert!(!bare.join("pyramid").exists());
    let (with, without) = (Server::start(&[text(&job.film)]), Server::start(&[text(&bare)]));
    for look in ["band=1&exposure=1&gamma=1", "white=A&exposure=0.7&gamma=1.8"] {
        for tile in ["2/0_0", "1/1_1", "1/0_0", "0/2_2"] {
            let path = format!("/tile/film/{tile}.png?{look}");
            assert_eq!(with.body(&path), without.body(&path), "{path}");
        }
    }
    assert_eq!(with.body("/api/exposure?white=D65"), without.body("/api/exposure?white=D65"));
}

#[test]
fn missing_lens_and_used_port_are_reported_and_sigint_stops_the_server() {
    let job = film();
    let mut server = Server::start(&[text(&job.film)]);
    let content = server.get_text("/api/content");
    assert!(
        content.contains("the film was made with test, which is not built in; name its file with --lens"),
        "{content}"
    );
    let (status, answer) = server.get("/api/lens?x=1&y=1&band=0");
    assert!(status == 404 && String::from_utf8_lossy(&answer).contains("--lens"));
    let ran = lenscube(&["view", text(&job.film), "--lens", "nothing.lens.zarr"]);
    assert!(ran.code != 0 && ran.stderr.contains("nothing.lens.zarr"), "{}", ran.stderr);
    let taken = server.port.to_string();
    let ran = lenscube(&["view", text(&job.film), "--port", &taken]);
    assert!(
        ran.code != 0 && ran.stderr.contains(&taken) && ran.stderr.contains("--port 0"),
        "{}",
        ran.stderr
    );
    // An idle connection does not delay the shutdown.
    let _idle = TcpStream::connect(("127.0.0.1", server.port)).unwrap();
    let sent = Command::new("kill").args(["-s", "INT", &server.child.id().to_string()]).status().unwrap();
    assert!(sent.success());
    let status = server.child.wait().unwrap();
    assert!(status.code() == Some(0), "{status}");
}

#[test]
fn completions_and_manual_pages_include_every_command() {
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let script = lenscube(&["completions", shell]).ok().stdout;
        assert!(script.contains("pyramid") && script.contains("take-over"), "{shell}");
    }
    assert_eq!(lenscube(&["completions", "tcsh"]).code, 2);
    let dir = tempfile::tempdir().unwrap();
    let pages = dir.path().join("man1");
    lenscube(&["man", text(&pages)]).ok();
    let names: Vec<String> =
        std::fs::read_dir(&pages).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    let help = lenscube(&["--help"]).ok().stdout;
    let commands = help.split("Simulate:").nth(1).unwrap().split("Options:").next().unwrap();
    let commands = commands
        .lines()
        .filter(|l| l.starts_with("  ") && !l.starts_with("   "))
        .filter_map(|l| l.split_whitespace().next());
    let mut count = 0;
    for command in commands.filter(|c| *c != "help") {
        assert!(names.contains(&format!("lenscube-{command}.1")), "{command}: {names:?}");
        count += 1;
    }
    assert!(count > 10 && names.contains(&"lenscube-lens-trace.1".to_owned()), "{names:?}");
    let charts = lenscube(&["help", "charts"]).ok().stdout;
    assert!(charts.starts_with("# Charts\n") && names.contains(&"lenscube-charts.7".to_owned()), "{charts}");
    assert!(lenscube(&["help", "lens", "trace"]).ok().stdout.contains("--max-nodes"));
    assert!(lenscube(&["help"]).ok().stdout.contains("limits"));
    let unknown = lenscube(&["help", "chart", "nowhere"]);
    assert!(unknown.code == 2 && unknown.stderr.contains("accuracy"), "{}", unknown.stderr);
    let page = std::fs::read_to_string(pages.join("lenscube-view.1")).unwrap();
    assert!(page.contains(".TH lenscube") && page.contains("\\-\\-port"), "{page}");
    assert!(lenscube(&["man"]).ok().stdout.contains(".TH lenscube"));
    let listing: serde_json::Value = serde_json::from_str(&lenscube(&["man", "--json"]).ok().stdout).unwrap();
    let run = listing["commands"].as_array().unwrap().iter().find(|c| c["name"] == "run").unwrap();
    let argument =
        |name: &str| run["arguments"].as_array().unwrap().iter().find(|a| a["name"] == name).unwrap();
    let lens = argument("lens");
    assert_eq!((&lens["flag"], &lens["takes_value"]), (&"--lens".into(), &true.into()), "{lens}");
    assert_eq!((&argument("roi")["repeatable"], argument("chart").get("flag")), (&true.into(), None));
    assert_eq!(listing["exit_codes"].as_array().unwrap().len(), 7);
    assert_eq!(lenscube(&["man", "--json", text(&pages)]).code, 2);
}

#[test]
fn two_bands_at_one_wavelength_have_separate_tiles() {
    let job = TestJob::large();
    std::fs::remove_dir_all(&job.chart).unwrap();
    let meta = formats::chart::ChartMeta {
        wavelengths_nm: vec![450.0, 450.0],
        pitch_um: Some(2.0),
        ..formats::chart::ChartMeta::default()
    };
    let picture = crate::common::Picture::noise(11, pipeline::geometry::Size::new(631, 705), 2);
    let codec = formats::chart::Codec::Zstd;
    formats::chart::write_chart(&job.chart, &picture, &meta, codec, 1, &|_, _| ()).unwrap();
    job.run("", &["--no-fsync", "--pyramid"]).ok();
    let server = Server::start(&[text(&job.film), "--chart", text(&job.chart)]);
    assert!(server.get_text("/api/content").contains("\"pyramid\":\"complete\""));
    let tile = |stack: &str, band: usize| {
        server.body(&format!("/tile/{stack}/1/0_0.png?band={band}&exposure=1&gamma=1"))
    };
    for stack in ["film", "chart"] {
        assert_ne!(tile(stack, 0), tile(stack, 1), "{stack}: two bands of noise look the same");
    }
    assert!(server.get_text("/api/content").contains("\"colour\":true"));
}

#[test]
fn chart_without_wavelengths_has_those_of_the_film() {
    let job = film();
    let npy = job.at("chart.npy");
    lenscube(&["export", text(&job.chart), text(&npy)]).ok();
    let server = Server::start(&[text(&job.film), "--chart", text(&npy), "--axes", "wavelength,y,x"]);
    let (size, chart) = pixels(&job.chart, "chart");
    let reading = String::from_utf8(server.body("/api/pixel?x=300&y=77")).unwrap();
    let list = reading.split("\"chart\":[").nth(1).and_then(|t| t.split(']').next()).unwrap();
    let values: Vec<f32> = list.split(',').map(|v| v.parse().unwrap()).collect();
    let expected: Vec<f32> = chart.iter().map(|b| b[77 * size.width + 300]).collect();
    assert_eq!(values, expected);
}

/// A raw: its development has the pixels of `lenscube develop`, its mosaic those of the store, with and without levels.
#[test]
fn raw_is_shown_developed_and_as_its_mosaic() {
    let place = Place::new();
    let film = place.noise(Size::new(600, 700));
    let flags = ["--sensor", "example-2um", "--exposure", "5ms,20ms", "--keep-signal"];
    let raw = place.raw("raw.zarr", &film, &flags);
    let (mosaic, (signal_size, signal)) = (frame(&raw, "raw", 1), pixels(&raw, "signal"));
    let bare = Server::start(&[text(&raw)]);
    let tiles = ["0/0_1.png?frame=1&white=A", "1/1_0.png?frame=0&mosaic=1", "2/0_0.png?frame=1&white=D65"];
    let tile = |server: &Server, tile: &str| server.body(&format!("/tile/film/{tile}&exposure=1&gamma=1.3"));
    let computed = tiles.map(|t| tile(&bare, t));
    drop(bare);
    lenscube(&["pyramid", text(&raw)]).ok();
    let server = Server::start(&[text(&raw)]);
    let content = server.get_text("/api/content");
    for part in [
        r#""sensor":"example-2um""#,
        r#""pyramid":"complete""#,
        r#""exposure_s":[0.005,0.02]"#,
        r#""levels":3"#,
    ] {
        assert!(content.contains(part), "{part}: {content}");
    }
    assert!(computed == tiles.map(|t| tile(&server, t)));
    // A crop of the development, and the same pixels by `develop`.
    let own = server.body("/crop.png?x=30&y=41&w=300&h=200&frame=1&white=D65&exposure=1&gamma=1");
    let (ours, theirs) = (place.at("own.png"), place.at("develop.png"));
    std::fs::write(&ours, own).unwrap();
    develop(&raw, &theirs, &["--frame", "1", "--white", "D65", "--crop", "30,41,300,200"]).ok();
    assert!(colours(&ours) == colours(&theirs));
    for (x, y) in [(0, 0), (699, 599), (123, 77)] {
        let body = server.body(&format!("/api/pixel?x={x}&y={y}&frame=1&white=D65"));
        let reading: Value = serde_json::from_slice(&body).unwrap();
        let dn = f64::from(mosaic.1[y * 700 + x]);
        let found = &reading["raw"]["frames"][1];
        assert_eq!(found["dn"].as_f64().unwrap(), dn);
        assert!((found["electrons"].as_f64().unwrap() - (dn - 256.0) / 0.28).abs() < 1e-9, "{found}");
        let light = 0.02 * f64::from(signal[0][y * signal_size.width + x]);
        assert!((found["signal_e"].as_f64().unwrap() - light).abs() < 1e-9 * light, "{found}");
        assert_eq!(reading["raw"]["filter"], ["R", "G", "G", "B"][y % 2 * 2 + x % 2]);
        assert_eq!(reading["developed"].as_array().unwrap().len(), 3);
    }
    for bad in ["frame=2&white=D65", "white=D65", "frame=0&white=D50", "band=0"] {
        assert_eq!(server.get(&format!("/tile/film/0/0_0.png?{bad}&exposure=1&gamma=1")).0, 400, "{bad}");
    }
    assert_eq!(server.get("/api/lens?x=1&y=1&band=0").0, 404);
    let ran = lenscube(&["view", text(&raw), "--lens", "double-gauss-28"]);
    assert!(ran.code == 2 && ran.stderr.contains("--lens is for films"), "{}", ran.stderr);
    std::fs::remove_file(raw.join("raw/c/1/0/0")).unwrap();
    let ran = lenscube(&["view", text(&raw)]);
    assert!(ran.code == 1 && ran.stderr.contains("1 of 1 shards of frame 1 are missing"), "{}", ran.stderr);
}

#[test]
fn film_of_several_arrays_needs_the_name_of_one() {
    let dir = tempfile::tempdir().unwrap();
    let film = dir.path().join("film.zarr");
    let chart = "gen:checker?size=64&pitch_um=5&wavelengths=550";
    let lens = ["--lens", "double-gauss-28-npz", "--stages", "ri,distortion"];
    let regions = ["--roi", "0,0,20,20", "--roi", "30,30,20,20"];
    lenscube(&[&["run", chart, text(&film)], &lens[..], &regions].concat()).ok();
    for words in [["view", text(&film)], ["view", &format!("{}//x", text(&film))]] {
        let ran = lenscube(&words);
        assert!(ran.code == 2 && ran.stderr.contains("roi_0, roi_1"), "{}", ran.stderr);
    }
}

/// Linear channels of a picture.
#[test]
fn raw_of_few_rows_is_shown_without_smaller_levels() {
    let place = Place::new();
    for (rows, levels, developed) in [(1, 1, 404), (3, 2, 200)] {
        let film = place.film_named(&format!("{rows}.film"), Size::new(rows, 700), |_, _, _| 1e-3);
        let raw = place.raw(&format!("{rows}.raw"), &film, &["--sensor", "example-2um", "--exposure", "5ms"]);
        let server = Server::start(&[text(&raw)]);
        assert!(server.get_text("/api/content").contains(&format!(r#""levels":{levels},"#)));
        server.body("/api/pixel?x=1&y=0&frame=0&white=D65");
        let tile =
            |mode: &str| server.get(&format!("/tile/film/0/0_0.png?frame=0&{mode}&exposure=1&gamma=1"));
        assert_eq!((tile("mosaic=1").0, tile("white=D65").0), (200, developed));
    }
}

fn colours(path: &std::path::Path) -> Vec<Vec<f32>> {
    let file = ImageFile::open(path).unwrap();
    let size = file.size();
    let source = file.linear(Transfer::Linear, path.parent().unwrap(), 2, &|_, _| ()).unwrap();
    let read = |c| {
        let mut pixels = vec![0.0; size.pixels()];
        source.read(c, size.rect(), &mut pixels).unwrap();
        pixels
    };
    (0..3).map(read).collect()
}
