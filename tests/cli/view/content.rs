//! What is shown of films, charts and scenes.

use super::*;

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
    let ambiguous = job.run("", &["--bands", "450"]);
    assert_eq!(ambiguous.code, 2, "{}", ambiguous.stderr);
    assert!(ambiguous.stderr.contains("bands #0 and #1 have 450 nm"), "{}", ambiguous.stderr);
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
