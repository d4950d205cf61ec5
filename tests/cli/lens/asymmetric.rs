//! Designs without rotational symmetry: `lens show`, `lens trace` and films of a lens whose film is tilted.

use super::built::{ERRORS, tolerances};
use super::runs::{DesignJob, attributes};
use super::*;
use crate::common::camera::{frame, sensor};

/// The sample design with its film tilted about x by `degrees`.
fn with_tilted_film(job: &DesignJob, name: &str, degrees: f64) -> PathBuf {
    let (before, image) = DESIGN.rsplit_once("SURF ").unwrap();
    let (number, rest) = image.split_once('\n').unwrap();
    let number: u32 = number.trim().parse().unwrap();
    let tilt = format!("SURF {number}\n  TYPE COORDBRK\n  PARM 3 {degrees}\n  DISZ 0\n");
    let path = job.at(name);
    fs::write(&path, format!("{before}{tilt}SURF {}\n{rest}", number + 1)).unwrap();
    path
}

#[test]
fn a_film_through_a_tilted_film_is_that_of_its_pack_and_of_no_other_tilt() {
    let job = DesignJob::new();
    let [tilted, other] = [2.0, 1.0].map(|deg| with_tilted_film(&job, &format!("tilted-{deg}.zmx"), deg));
    let made = job.run("cache", "film", &["--lens", text(&tilted)]).ok();
    assert!(made.stderr.contains("no rotational symmetry"), "{}", made.stderr);
    let film = |name: &str| pixels(&job.at(name), "film").1;
    // Traced again by one thread: the same bits.
    job.run("other", "again", &["--lens", text(&tilted), "--threads", "1"]).ok();
    assert!(bits(&film("film")) == bits(&film("again")));
    let changed = job.run("cache", "film", &["--lens", text(&other)]);
    assert_error_line(&changed, OTHER_JOB, &["lens"]);
    // A pack of the same film, whose map and PSFs reach a little farther.
    let pack = job.at("tilted.lens.zarr");
    let trace = ["lens", "trace", text(&tilted), text(&pack), "--wavelengths", "450,500"];
    lenscube(&[&trace[..], &["--film-size", "48x40", "--film-pitch-um", "10"]].concat()).ok();
    assert!(attributes(&pack).to_string().contains("lenscube/lens-pack/4"));
    job.run("cache", "of-pack", &["--lens", text(&pack)]).ok();
    let (a, b) = (film("film"), film("of-pack"));
    let peak = a.iter().flatten().fold(0.0, |a: f32, v| a.max(*v));
    let worst = pairs(&a, &b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst < 0.02 * peak, "{worst} of {peak}");
    job.run("cache", "straight", &["--tails", "off"]).ok();
    let moved = pairs(&a, &film("straight")).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(moved > 0.02 * peak, "{moved} of {peak}: the tilt changes the film");
}

/// The middle of a raw of `film` without noise, above black, with the fields `angle` of the sensor's description.
fn middle_dn(job: &DesignJob, film: &Path, angle: &str) -> f64 {
    let (file, raw) = (job.at("sensor.toml"), job.at("raw.zarr"));
    let text_of = format!(
        "schema = \"lenscube/sensor/1\"\nname = \"s\"\ndescription = \"a test\"\n[pixel]\npitch_um = \"film\"\nfull_well_e = 1e9\n[adc]\nbits = 16\n\
         gain_dn_per_e = 1.0\nblack_dn = 0\n[spectral]\nconstant = 1.0\n[cfa]\npattern = [[\"Y\"]]\nY = {{}}\n{angle}\n[source]\n\"*\" = \"a test\"\n"
    );
    fs::write(&file, text_of).unwrap();
    sensor(film, &raw, &["--sensor", text(&file), "--exposure", "20us", "--noise", "none", "--overwrite"])
        .ok();
    let (size, pixels) = frame(&raw, "raw", 0);
    f64::from(pixels[(size.height / 2) * size.width + size.width / 2])
}

/// The mean response over the cone of sine `rim` in front of a film that is tilted about x, each ray turned into the film's frame; by its slope in a medium of index 1.5.
fn mean_behind_tilted_film(rim: f64, tilt: f64, response: impl Fn([f64; 2]) -> f64) -> f64 {
    let (mut sum, mut all) = (0.0, 0.0);
    for (i, k) in (0..200).flat_map(|i| (0..200).map(move |k| (i, k))) {
        let at = |i: u32| rim * ((f64::from(i) + 0.5) / 100.0 - 1.0);
        let (l, m) = (at(i), at(k));
        let square = l * l + m * m;
        if square > rim * rim {
            continue;
        }
        // m up; the film's +y leans towards +z, and its direction cosines are (right, down).
        let n = (1.0 - square).sqrt();
        let (down, along) = (-(m * tilt.cos() + n * tilt.sin()), n * tilt.cos() - m * tilt.sin());
        let scale = 1.0 / (1.5 * 1.5 - l * l - down * down).sqrt();
        // dl dm of the tilted frame.
        let weight = along / n;
        sum += weight * response([l * scale, down * scale]);
        all += weight;
    }
    sum / all
}

#[test]
fn a_sensor_that_is_tilted_sees_the_cone_turned() {
    let job = DesignJob::new();
    let chart = "gen:uniform?size=48&pitch_um=10&wavelengths=450,500";
    let half = 20_f64.to_radians().sin();
    let half = half / (2.25 - half * half).sqrt();
    fs::write(job.at("side.csv"), "angle_deg,horizontal,vertical\n-60,1,0.2\n-1,1,1\n0,1,1\n60,1,1\n")
        .unwrap();
    let slope_of = |deg: f64| deg.to_radians().sin() / (2.25 - deg.to_radians().sin().powi(2)).sqrt();
    let one_sided = |[_, down]: [f64; 2]| {
        1.0 + 0.8 * ((down + slope_of(1.0)) / (slope_of(60.0) - slope_of(1.0))).min(0.0)
    };
    let rim = 0.5 / 2.98;
    for degrees in [12.0, -12.0_f64] {
        let lens = with_tilted_film(&job, "tilted.zmx", degrees);
        let film = job.at("uniform.zarr");
        crate::common::run(chart, &film, text(&lens), &["--stages", "distortion", "--overwrite"]).ok();
        let flat = middle_dn(&job, &film, "");
        assert!(flat > 10_000.0 && flat < 65_000.0, "{flat}");
        let found = middle_dn(&job, &film, "[angle]\nstack_index = 1.5\nacceptance_deg = 20") / flat;
        let gaussian = |[right, down]: [f64; 2]| 0.5_f64.powf((right * right + down * down) / (half * half));
        let expected = mean_behind_tilted_film(rim, degrees.to_radians(), gaussian);
        assert!((found - expected).abs() < 1e-3, "{degrees}: {found} {expected}");
        let found = middle_dn(&job, &film, "[angle]\nstack_index = 1.5\nfile = \"side.csv\"") / flat;
        let expected = mean_behind_tilted_film(rim, degrees.to_radians(), one_sided);
        assert!((found - expected).abs() < 2e-3, "{degrees}: {found} {expected}");
        // Microlenses that are shifted for the lens undo the turn of the chief ray.
        let shifted = "[angle]\nstack_index = 1.5\nacceptance_deg = 20\nmicrolenses = \"lens\"";
        let found = middle_dn(&job, &film, shifted) / flat;
        let straight = mean_behind_tilted_film(rim, 0.0, gaussian);
        assert!((found - straight).abs() < 0.02, "{degrees}: {found} {straight}");
    }
}

#[test]
#[ignore = "long: films of packs and designs with chief rays"]
fn packs_with_cones_of_lenses_without_symmetry_are_as_good_as_their_designs() {
    let job = DesignJob::new();
    let lens = with_tilted_film(&job, "tilted.zmx", 12.0);
    let chart = "gen:uniform?size=48&pitch_um=10&wavelengths=450,500";
    let pack = job.at("tilted.lens.zarr");
    let trace = ["lens", "trace", text(&lens), text(&pack), "--wavelengths", "450,500"];
    let film_flags = ["--film-size", "48x48", "--film-pitch-um", "10"];
    lenscube(&[&trace[..], &film_flags, &["--cones"]].concat()).ok();
    assert_eq!(attributes(&pack)["extras"], serde_json::json!(["cones"]));
    let angle = "[angle]\nstack_index = 1.5\nacceptance_deg = 20";
    let dn = |name: &str, lens: &Path| {
        let film = job.at(name);
        crate::common::run(chart, &film, text(lens), &["--stages", "distortion"]).ok();
        middle_dn(&job, &film, angle)
    };
    let (of_design, of_pack) = (dn("a.zarr", &lens), dn("b.zarr", &pack));
    assert!((of_pack - of_design).abs() <= 2.0, "{of_pack} {of_design}");
    // A lens with drawn errors has them as well.
    let errors = tolerances(&job, "t.toml", ERRORS);
    let (nominal, drawn) = (job.at("my.zmx"), job.at("drawn.lens.zarr"));
    let trace = ["lens", "trace", text(&nominal), text(&drawn), "--wavelengths", "450,500"];
    let errors = ["--tolerances", text(&errors), "--lens-sample", "3", "--cones"];
    lenscube(&[&trace[..], &film_flags, &["--max-height-mm", "0.6"], &errors].concat()).ok();
    let (of_drawn, straight) = (dn("c.zarr", &drawn), dn("d.zarr", &nominal));
    assert!((of_drawn / straight - 1.0).abs() < 0.01, "{of_drawn} {straight}");
}

#[test]
fn lens_show_prints_the_places_of_the_surfaces() {
    let job = DesignJob::new();
    let tilted = with_tilted_film(&job, "tilted.zmx", 30.0);
    let shown = lenscube(&["lens", "show", text(&tilted), "--json"]).ok();
    let shown: serde_json::Value = serde_json::from_str(&shown.stdout).unwrap();
    let film = shown["surfaces"].as_array().unwrap().last().unwrap();
    assert_eq!(film["kind"], "film");
    // Right-handed about x: +y towards +z, so that the normal leans to −y.
    let normal = |i: usize| film["normal"][i].as_f64().unwrap();
    assert!((normal(1) + 0.5).abs() < 1e-12 && (normal(2) - 0.75_f64.sqrt()).abs() < 1e-12, "{film}");
    // Chief rays at the centre of the tilted film: f² = f_D²/cos of the tilt.
    let focal = shown["distortion_focal_length_mm"].as_f64().unwrap();
    let straight: serde_json::Value =
        serde_json::from_str(&lenscube(&["lens", "show", text(&job.at("my.zmx")), "--json"]).ok().stdout)
            .unwrap();
    let expected = straight["design"]["distortion_focal_length_mm"].as_f64().unwrap() / 0.75_f64.powf(0.25);
    assert!((focal / expected - 1.0).abs() < 1e-6, "{focal} {expected}");
    let text_of = lenscube(&["lens", "show", text(&tilted)]).ok().stdout;
    assert!(text_of.contains("coordinate break") && text_of.contains("no rotational symmetry"), "{text_of}");
}

#[test]
fn what_designs_without_symmetry_do_not_have_is_an_error_of_one_line() {
    let job = DesignJob::new();
    let tilted = with_tilted_film(&job, "tilted.zmx", 2.0);
    let flags: [(&[&str], &str); 9] = [
        (&["--depth", "2"], "rotational symmetry"),
        (&["--device", "cuda"], "computed on the CPU"),
        (&["--coatings", "mgf2"], "--coatings ideal"),
        (&["--veiling-glare", "1%"], "veiling glare"),
        (&["--band-samples", "2"], "--band-samples"),
        (&["--focus-m", "2"], "--focus-m: expected a design with rotational symmetry"),
        (&["--image-plane", "rms"], "--image-plane: expected"),
        (&["--aiming", "paraxial"], "--aiming paraxial: expected"),
        (&["--tolerances", "t.toml"], "--tolerances: expected a design with rotational symmetry"),
    ];
    for (flags, named) in flags {
        let refused = job.run("cache", "film", &[&["--lens", text(&tilted)], flags].concat());
        assert_exit(&refused, USAGE, &[named]);
    }
    assert!(!job.at("film").exists());
    let commands: [(&[&str], &str); 6] = [
        (&["lens", "diff", text(&tilted), "double-gauss-28"], "rotational symmetry"),
        (&["lens", "light", text(&tilted)], "rotational symmetry"),
        (
            &["lens", "export", text(&tilted), "--as", "opencv"],
            "lens export: expected a lens with rotational symmetry",
        ),
        (&["lens", "show", text(&tilted), "--plot", "pictures"], "--plot: expected"),
        (&["lens", "trace", text(&tilted), "p.lens.zarr", "--wavelengths", "550"], "--film-size"),
        (&["lens", "convert", text(&tilted), "p.csv"], "no rotational symmetry"),
    ];
    for (words, named) in commands {
        let refused = lenscube(words);
        assert!(refused.code != 0 && refused.stderr.contains(named), "{words:?} {}", refused.stderr);
    }
}
