//! Films of designs: place, coarse pixels, stored pupil functions, scale, the end of the field.

use super::*;

#[test]
fn film_beside_another_has_its_lens_and_its_pixels() {
    let job = DesignJob::new();
    // The chart lies about the axis, which is 6 px farther to the right and 5 px farther down on the second film.
    let film = |name: &str, flags: &[&str]| {
        job.run("cache", name, &[&["--bands", "0", "--surround", "black"], flags].concat()).ok();
        let digest = attributes(&job.at(name))["provenance"]["job"]["lens_digest"].clone();
        assert!(digest.is_string(), "{}", attributes(&job.at(name)));
        (digest, pixels(&job.at(name), "film"))
    };
    let (lens, (size, whole)) = film("whole", &[]);
    let (moved_lens, (moved_size, moved)) = film("moved", &["--film-size", "50x46", "--axis", "25.5,28.5"]);
    assert_eq!(lens, moved_lens);
    assert_eq!(job.entries("cache").len(), 1, "both films have the bands of the lens");
    let peak = whole[0].iter().fold(0f32, |a, v| a.max(*v));
    for y in 0..size.height.min(moved_size.height - 5) {
        for x in 0..size.width {
            let (a, b) = (whole[0][y * size.width + x], moved[0][(y + 5) * moved_size.width + x + 6]);
            // Bins of tails begin at the corner of the film.
            assert!((a - b).abs() <= 4e-6 * peak, "({x}, {y}): {a} and {b} of {peak}");
        }
    }
}

#[test]
#[ignore = "long: traces a band far out of focus"]
fn bands_of_coarse_pixels_are_traced_for_them() {
    let job = DesignJob::new();
    // Out of focus at 2.3 µm: no window of 401 pixels of 2 µm holds the light.
    let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
    command.args(["run", "gen:uniform?size=24&wavelengths=2300", text(&job.at("film")), "--no-fsync"]);
    command.args(["--threads", "2", "--lens", "double-gauss-28", "--film-pitch-um", "20"]);
    CommandResult::new(&command.env("XDG_CACHE_HOME", job.at("cache")).output().unwrap()).ok();
    // Uniform but for relative illumination.
    let film = pixels(&job.at("film"), "film").1.concat();
    let (least, most) = film.iter().fold((f32::MAX, 0f32), |(a, z), v| (a.min(*v), z.max(*v)));
    assert!(least > 0.0 && most < 1.001 * least, "{least} to {most}");
    let packs: Vec<LensPack> =
        job.entries("cache").iter().map(|path| LensPack::open(path).unwrap()).collect();
    for pack in &packs {
        let source = pack.attributes().source.clone().unwrap();
        assert_eq!(source["film_pitch_um"], 20.0, "{source}");
    }
    // Traced again where its window, which has to be clear of the blur, needs more of the lens.
    assert!((1..=2).contains(&packs.len()), "{}", packs.len());
}

#[test]
fn film_of_a_pack_with_pupil_functions_is_that_of_the_pack_with_their_psfs() {
    let job = DesignJob::new();
    let film = |lens: &str, film: &str| {
        let words = ["run", text(&job.at("chart")), text(&job.at(film)), "--lens", text(&job.at(lens))]
            .map(str::to_owned);
        let words: Vec<&str> = words.iter().map(String::as_str).collect();
        lenscube(&[&words[..], &["--film-pitch-um", "10", "--no-fsync", "--bands", "1"]].concat())
    };
    for store in ["psfs", "pupils"] {
        trace(text(&job.design), &job.at(&format!("{store}.lens.zarr")), &["--store", store]).ok();
        film(&format!("{store}.lens.zarr"), store).ok();
    }
    assert!(bits(&pixels(&job.at("psfs"), "film").1) == bits(&pixels(&job.at("pupils"), "film").1));
    let size =
        |store: &str| files(&job.at(&format!("{store}.lens.zarr"))).values().map(Vec::len).sum::<usize>();
    assert!(size("pupils") < size("psfs") / 2, "{} and {}", size("pupils"), size("psfs"));
    // The digest of the pack is part of the job.
    film("pupils.lens.zarr", "pupils").ok();
    assert_exit(&film("psfs.lens.zarr", "pupils"), OTHER_JOB, &["belongs to another job", "lens"]);
    let shown = lenscube(&["lens", "show", text(&job.at("pupils.lens.zarr")), "--json"]).ok();
    assert!(shown.stdout.contains("\"stored\": \"pupil functions\""), "{}", shown.stdout);
    let out = job.at("depth.lens.zarr");
    let depth = ["--focus-m", "2", "--depths-m", "1:inf", "--store", "pupils"];
    assert_exit(&trace(text(&job.design), &out, &depth), USAGE, &["--store", "--depths-m"]);
}

#[test]
fn chart_pitch_in_mm_sets_the_scale_by_the_magnification() {
    let job = DesignJob::new();
    let pack = job.at("near.lens.zarr");
    trace(text(&job.design), &pack, &["--object-distance-mm", "100000"]).ok();
    let magnification = LensPack::open(&pack).unwrap().lens().magnification;
    let chart = job.at("chart");
    let run = |lens: &str, film: &str, flags: &[&str]| {
        let words = ["run", text(&chart), film, "--lens", lens, "--no-fsync", "--bands", "1"];
        lenscube(&[&words[..], &["--film-pitch-um", "10"], flags].concat())
    };
    let film = job.at("film");
    run(text(&pack), text(&film), &["--chart-pitch-mm", "20"]).ok();
    let metadata: Value = serde_json::from_slice(&fs::read(film.join("zarr.json")).unwrap()).unwrap();
    let scale = -magnification * 20.0 / 0.010;
    let text_of = metadata.to_string();
    assert!(text_of.contains(&format!("\"scale\":{{\"x\":{scale},\"y\":{scale}}}")), "{scale}: {text_of}");
    let rows = |n: f64| (n * scale).round() as usize;
    assert_eq!(pixels(&film, "film").0, Size::new(rows(48.0), rows(40.0)));
    let other = job.at("other");
    let bad = |lens: &str, flags: &[&str], words: &[&str]| {
        let ran = run(lens, text(&other), flags);
        assert_eq!(ran.code, USAGE, "{}", ran.stderr);
        assert!(words.iter().all(|w| ran.stderr.contains(w)) && !other.exists(), "{}", ran.stderr);
    };
    let way_out = ["--chart-pitch-mm 20", "infinity", "lenscube lens trace", "--object-distance-mm"];
    bad("double-gauss-28-npz", &["--chart-pitch-mm", "20"], &way_out);
    bad("double-gauss-28", &["--chart-pitch-mm", "20"], &way_out);
    bad(text(&pack), &["--chart-pitch-mm", "20", "--scale", "2"], &["--chart-pitch-mm", "--scale"]);
    bad(text(&pack), &["--chart-pitch-mm", "1e9"], &["magnification", "0.001 to 1000"]);
}

/// Up to 99.7 % of the field of a lens whose rays are totally reflected a little beyond it: the margin of a band is what the lens passes.
#[test]
fn films_near_the_end_of_the_field_are_traced() {
    let dir = tempfile::tempdir().unwrap();
    for (nm, size) in [(450, "1300x30"), (550, "2110x40")] {
        let (chart, film) =
            (format!("gen:uniform?size={size}&wavelengths={nm}&pitch_um=2"), dir.path().join(size));
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        command.args(["run", &chart, text(&film), "--lens", "phone", "--no-fsync"]);
        let ran =
            CommandResult::new(&command.env("XDG_CACHE_HOME", dir.path().join("cache")).output().unwrap());
        assert_exit(&ran, 0, &[]);
        assert!(!ran.stderr.contains("cannot be stored"), "{}", ran.stderr);
        let (_, bands) = pixels(&film, "film");
        // Relative illumination of the lens: 1 on the axis, 0.6 to 0.8 at 1.3 mm.
        assert!(bands[0].iter().all(|v| (0.3..=1.001).contains(v)));
    }
    let beyond = "gen:uniform?size=1900&wavelengths=550&pitch_um=2";
    let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
    command.args(["run", beyond, text(&dir.path().join("beyond")), "--lens", "phone"]);
    let ran = CommandResult::new(&command.env("XDG_CACHE_HOME", dir.path().join("cache")).output().unwrap());
    assert_exit(&ran, FAILED, &["--film-size", "--outside clamp"]);
}
