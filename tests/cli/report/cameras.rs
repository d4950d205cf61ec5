//! Noise of cameras: two side by side, and a DNG.

use super::*;

/// Two cameras of other noise, found by the fiducials of a chart that is smaller in the picture, rotated by 180 degrees.
#[test]
fn tones_of_two_cameras_stand_side_by_side_found_by_fiducials() {
    let place = Place::new();
    let chart = "oecf?size=700&wavelengths=550&density=2&fiducials=42";
    let (size, pixels) = film(chart);
    let white = pixels.iter().copied().fold(0.0, f64::max);
    let camera = |name: &str, full_e: f64| {
        // Poisson noise as a normal number of its variance, by Box and Muller.
        let mut state = 1u64;
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((state >> 11) as f64 + 0.5) / (1u64 << 53) as f64
        };
        let noisy: Vec<f64> = (0..pixels.len())
            .map(|i| {
                let electrons = full_e * pixels[pixels.len() - 1 - i] / white;
                let normal = (-2.0 * uniform().ln()).sqrt() * (2.0 * PI * uniform()).cos();
                (electrons + electrons.sqrt() * normal) / full_e
            })
            .collect();
        let path = place.at(name);
        write(&path, size, &[&noisy]);
        path
    };
    let (a, b) = (camera("a.exr", 20_000.0), camera("b.exr", 5_000.0));
    let out = place.at("two");
    let words =
        ["report", text(&a), "--chart", chart, "--against", text(&b), "--name", "first", "--name", "second"];
    let ran = lenscube(&[&words[..], &["--out", text(&out)]].concat()).ok();
    assert!(ran.stdout.contains("first: dynamic range, grey: at least"), "{}", ran.stdout);
    let all: Value = serde_json::from_slice(&std::fs::read(out.join("report.json")).unwrap()).unwrap();
    for (camera, full_e) in [(0, 20_000.0), (1, 5_000.0)] {
        let colour = &all["cameras"][camera]["sections"][0]["values"]["colours"][0];
        let tones = colour["tones"].as_array().unwrap();
        assert_eq!(tones.len(), 20);
        // SNR = √electrons; mean of the twenty, each of about 300 pixels: 4 % / √20.
        let ratio = |t: &Value| {
            let electrons = full_e * number(&t["reflectance"]) / 0.9;
            number(&t["snr"]) / electrons.sqrt()
        };
        let mean = tones.iter().map(ratio).sum::<f64>() / 20.0;
        assert!((mean - 1.0).abs() < 0.03, "camera {camera}: {mean}");
    }
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    assert!(page.contains("class=\"sides\"") && page.contains("Report of first and second"));
    for name in ["a1-noise-1.svg", "b1-noise-3.svg"] {
        assert!(std::fs::read_to_string(out.join(name)).unwrap().starts_with("<svg"), "{name}");
    }
}

#[test]
fn dng_of_a_camera_is_measured_as_its_raw_and_tells_its_gain() {
    let place = Place::new();
    let exposed = |chart: &str| {
        let film = place.at("film.zarr");
        let wavelengths = "wavelengths=450:650:50&pitch_um=2";
        let generator = format!("gen:{chart}&{wavelengths}");
        let optics = ["--lens", "double-gauss-28-npz", "--stages", "ri", "--overwrite"];
        lenscube(&[&["run", &generator, text(&film)], &optics[..]].concat()).ok();
        ["a.zarr", "a.dng"].map(|name| {
            let out = place.at(name);
            let flags = ["--sensor", "example-2um", "--exposure", "auto", "--overwrite"];
            lenscube(&[&["sensor", text(&film), text(&out)], &flags[..]].concat()).ok();
            out
        })
    };
    let chart = "oecf?size=600x600";
    let [raw, dng] = exposed(chart);
    let attributes: Value = serde_json::from_slice(&std::fs::read(raw.join("zarr.json")).unwrap()).unwrap();
    let measured = [&raw, &dng].map(|picture| place.measured(picture, chart, &[]).remove(0));
    let page = std::fs::read_to_string(place.at("report").join("report.html")).unwrap();
    assert!(page.contains("lenscube example-2um"), "the page names the camera");
    assert!(page.contains("electrons are not known"));
    assert_eq!(measured[0]["photon_transfer"][1], Value::Null);
    for colour in [0, 1, 2] {
        let tones = |k: usize| measured[k]["colours"][colour]["tones"].as_array().unwrap().clone();
        assert_eq!(measured[1]["colours"][colour]["unit"], "DN");
        assert_eq!(tones(0).len(), tones(1).len());
        // The lightest patches: DN per electron, the dark current being small.
        let (e, dn) = (&tones(0)[19], &tones(1)[19]);
        let gain = number(&dn["mean"]) / number(&e["mean"]);
        let spread = number(&dn["standard_deviation"]) / number(&e["standard_deviation"]);
        assert!((spread / gain - 1.0).abs() < 2e-3, "{gain} {spread}");
        assert!((number(&dn["snr"]) / number(&e["snr"]) - 1.0).abs() < 5e-3);
        // Twenty variances, of some hundred pixels each, and three terms of noise.
        let found = number(&measured[1]["photon_transfer"][colour]["gain_dn_per_e"]);
        assert!((found / gain - 1.0).abs() < 0.15, "colour {colour}: {found} for {gain}; {attributes}");
    }
    let chart = "checker?size=300x200";
    let [raw, dng] = exposed(chart);
    let [raw, dng] = [&raw, &dng].map(|picture| place.measured(picture, chart, &[]).remove(0));
    for k in 0..24 {
        for c in 0..3 {
            let value = |v: &Value| number(&v["patches"][k]["linear_srgb"][c]);
            assert!((value(&raw) - value(&dng)).abs() < 2e-3, "patch {k}: {} {}", value(&raw), value(&dng));
        }
    }
    assert!((number(&raw["mean_delta_e_2000"]) - number(&dng["mean_delta_e_2000"])).abs() < 0.05);
    let file = std::fs::read(place.at("a.dng")).unwrap();
    let cut = place.at("cut.dng");
    std::fs::write(&cut, &file[..file.len() * 3 / 4]).unwrap();
    let out = place.at("none");
    let words = ["report", text(&cut), "--chart", chart, "--out", text(&out)];
    assert_exit(&lenscube(&words), 1, &["cut.dng"]);
    assert!(!out.exists());
}
