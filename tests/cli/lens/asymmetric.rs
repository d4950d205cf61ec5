//! Designs without rotational symmetry: `lens show`, `lens trace` and films of a lens whose film is tilted.

use super::runs::{DesignJob, attributes};
use super::*;

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
