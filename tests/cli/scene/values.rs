//! What a scene holds: distances, weights of 32 and 16 bits, numbers of objects, the margin.

use super::*;
use pipeline::colour::Illuminant;

#[test]
fn values_are_those_of_the_mesh_and_the_light() {
    let place = Place::new();
    let (mesh, out, film) = (place.mesh(), place.at("scene.zarr"), place.at("film.zarr"));
    // The blur of the two differs by half a pixel.
    scene(&mesh, &out, "400x300", &["--quiet", "--gap-px", "0.1"]).ok();
    let (height, width, depth) = plane(&out, "depth", 0);
    let (.., coverage) = plane(&out, "coverage", 0);
    let (.., red) = plane(&out, "weights", 0);
    let (.., green) = plane(&out, "weights", 1);
    let (.., behind) = plane(&out, "hidden/1/depth", 0);
    let (.., behind_red) = plane(&out, "hidden/1/weights", 0);
    // The wall at the left edge; the ball where the axis of its centre, x/z = 0.2, meets the film.
    let middle = height / 2 * width;
    assert_eq!((depth[middle + 2], coverage[middle + 2]), (3.0, 1.0));
    assert!((red[middle + 2] - 0.5).abs() < 1e-6 && (green[middle + 2] - 0.5).abs() < 1e-6);
    let report: serde_json::Value = serde_json::from_str(
        &lenscube(&[
            "lens",
            "camera",
            "phone",
            "--focus-m",
            "1",
            "--film-size",
            "400x300",
            "--film-pitch-um",
            "6",
            "--json",
        ])
        .ok()
        .stdout,
    )
    .unwrap();
    let focal_mm = report["focal_length_mm"].as_f64().unwrap();
    let column = ((width as f64 - 1.0) / 2.0 + 0.2 * focal_mm / 6e-3).round() as usize;
    let ball = middle + column;
    assert!((depth[ball] - 0.8).abs() < 0.01, "{}", depth[ball]);
    assert!((red[ball] - 0.6).abs() < 1e-6 && green[ball] == 0.0);
    // Behind the ball the wall is seen, never the ball's back; far from edges nothing is stored.
    let hidden =
        (0..width).map(|x| middle + x).find(|&i| behind[i] > 0.0).expect("a hidden surface near the rim");
    assert!(
        (behind[hidden] - 3.0).abs() < 1e-6 && (behind_red[hidden] - 0.5).abs() < 1e-6,
        "{}",
        behind[hidden]
    );
    assert!(behind.iter().all(|z| *z == 0.0 || (z - 3.0).abs() < 1e-6));
    // The film: radiance ρE/π of the wall, D65 of 1000 lx, left of the axis, where the relative illumination is 1; the lens passes all light.
    let nm = "400:700:20";
    lenscube(&[
        "run",
        text(&out),
        text(&film),
        "--lens",
        "phone",
        "--focus-m",
        "1",
        "--wavelengths",
        nm,
        "--tails",
        "off",
        "--quiet",
    ])
    .ok();
    let (size, bands) = pixels(&film, "film");
    let expected = 0.5 * Illuminant::D65.irradiance_scale(1000.0) * Illuminant::D65.relative_power(560.0)
        / std::f64::consts::PI;
    let found = f64::from(bands[8][size.height / 2 * size.width + size.width / 2 - 25]);
    assert!((found / expected - 1.0).abs() < 0.01, "{found:e} {expected:e}");
}

/// A floor whose corners are behind the camera and far before it is seen nearer than any corner: the chart has the margin of its blur.
#[test]
fn surfaces_between_corners_count_for_the_margin() {
    let place = Place::new();
    let mut obj = Obj::default();
    let corners = [[-20.0, -0.3, 2.0], [20.0, -0.3, 2.0], [20.0, -0.3, -30.0], [-20.0, -0.3, -30.0]];
    let [a, b, c, d] = corners.map(|corner| obj.vertex(corner));
    writeln!(obj.text, "f {a} {b} {c} {d}").unwrap();
    let floor = place.at("floor.obj");
    std::fs::write(&floor, obj.text).unwrap();
    let overscan = |flags: &[&str]| {
        let words = [&["scene", text(&floor), "--info"], &VIEW[..], &["600x600"], flags].concat();
        let info = lenscube(&words).ok().stdout;
        let line = info.lines().find(|line| line.contains("beyond the film")).unwrap().to_owned();
        line.split("px, ").nth(1).unwrap().split(' ').next().unwrap().parse::<usize>().unwrap()
    };
    // The nearest point seen is about 0.3 / tan 24° = 0.67 m away.
    assert!(overscan(&[]) >= overscan(&["--depths-m", "0.6:30"]) - 1, "{}", overscan(&[]));
    let wrong = [&["scene", text(&floor), "--info"], &VIEW[..], &["600x600", "--depths-m", "5:30"]].concat();
    assert_error_line(&lenscube(&wrong), USAGE, &["--depths-m", "is seen, nearer than 5.0000 m"]);
}

/// Weights of 16 bits are those of 32, rounded; both options belong to the job; the film of such a scene.
#[test]
fn weights_of_16_bits_and_numbers_of_objects_are_of_the_job() {
    let place = Place::new();
    let (mesh, whole, small) = (place.mesh(), place.at("whole.zarr"), place.at("small.zarr"));
    let flags = ["--samples-per-px", "4", "--quiet", "--sun", "150,40"];
    let both = [&flags[..], &["--half", "--ids"]].concat();
    scene(&mesh, &whole, "120x90", &flags).ok();
    for fault in ["scene-shard:3:kill", "commit:2:kill"] {
        let mut command = command(&mesh, &small, "120x90", &both);
        assert!(!command.env("LENSCUBE_FAULT", fault).output().unwrap().status.success(), "{fault}");
    }
    scene(&mesh, &small, "120x90", &[&both[..], &["--threads", "1"]].concat()).ok();
    let again = place.at("again.zarr");
    scene(&mesh, &again, "120x90", &[&both[..], &["--threads", "2"]].concat()).ok();
    assert!(files(&small) == files(&again));
    for array in ["weights", "hidden/1/weights"] {
        let (expected, found) = (pixels(&whole, array).1, pixels(&small, array).1);
        let mut lit = 0;
        for (a, b) in expected.iter().flatten().zip(found.iter().flatten()) {
            // Half a unit of the last of 11 bits; below 2^-14 the step is 2^-24.
            assert!((a - b).abs() <= (a.abs() / 2048.0).max(1.0 / (1 << 25) as f32), "{array}: {a} {b}");
            lit += usize::from(*b > 0.0);
        }
        assert!(lit > 1000 || array != "weights", "{lit}");
    }
    assert_eq!(bits(&pixels(&whole, "depth").1), bits(&pixels(&small, "depth").1));
    assert!(small.join("object/c/0/0").is_file() && !whole.join("object").exists());
    assert_exit(&lenscube(&["verify", text(&small)]), 0, &["16 shards", "0 defects"]);
    assert_exit(&scene(&mesh, &small, "120x90", &[&flags[..], &["--half"]].concat()), OTHER_JOB, &["ids"]);
    assert_exit(&scene(&mesh, &whole, "120x90", &both), OTHER_JOB, &["half", "ids"]);
    let film = |scene: &Path, film: &str| {
        let film = place.at(film);
        let lens = ["--lens", "phone", "--focus-m", "1", "--wavelengths", "500,600", "--quiet"];
        lenscube(&[&["run", text(scene), text(&film)], &lens[..]].concat()).ok();
        pixels(&film, "film").1
    };
    let (a, b) = (film(&whole, "a.zarr"), film(&small, "b.zarr"));
    let peak = a.iter().flatten().fold(0.0f32, |m, v| m.max(*v));
    // The absolute sum of the weights of the bicubic interpolation is below 1.3 of 2^-11.
    assert!(a.iter().flatten().zip(b.iter().flatten()).all(|(a, b)| (a - b).abs() <= peak / 1575.0));
    assert!(bits(&a) != bits(&b));
}
