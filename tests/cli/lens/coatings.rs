//! Light lost at surfaces and in glass: `--coatings`.

use super::runs::{DesignJob, attributes};
use super::*;

const ABSOLUTE: [&str; 6] =
    ["--film-units", "irradiance", "--chart-units", "W m-2 sr-1 nm-1", "--stages", "ri,distortion"];

fn with<'a>(flags: &[&'a str], more: &[&'a str]) -> Vec<&'a str> {
    [flags, more].concat()
}

#[test]
fn ideal_coatings_are_the_film_of_before() {
    let job = DesignJob::new();
    job.run("cache", "plain", &[]).ok();
    job.run("cache", "ideal", &["--coatings", "ideal"]).ok();
    assert!(files(&job.at("plain")) == files(&job.at("ideal")));
    // Other coatings are another lens.
    let other = job.run("cache", "plain", &["--coatings", "none"]);
    assert_exit(&other, 3, &["lens"]);
}

#[test]
fn film_in_physical_units_has_the_transmission_of_the_coatings() {
    let job = DesignJob::new();
    let ideal = job.run("cache", "ideal", &ABSOLUTE).ok();
    assert!(ideal.stderr.contains("--coatings mgf2 would leave 0."), "{}", ideal.stderr);
    let coated = job.run("cache", "coated", &with(&ABSOLUTE, &["--coatings", "mgf2"])).ok();
    assert!(!coated.stderr.contains("would leave"), "{}", coated.stderr);
    let bare = job.run("cache", "bare", &with(&ABSOLUTE, &["--coatings", "none"])).ok();
    assert!(!bare.stderr.contains("would leave"), "{}", bare.stderr);
    let film = |name: &str| pixels(&job.at(name), "film").1;
    let (all, after) = (film("ideal"), [film("coated"), film("bare")]);
    for (name, after) in std::iter::zip(["coated", "bare"], after) {
        let bands = attributes(&job.at(name))["provenance"]["bands"].clone();
        for (b, (all, after)) in std::iter::zip(&all, &after).enumerate() {
            let transmission = bands[b]["transmission"].as_f64().unwrap();
            let range = if name == "bare" { 0.5..0.95 } else { 0.8..0.99 };
            assert!(range.contains(&transmission), "{name}: {transmission}");
            // The field is half a millimetre: the losses change by less than 1e-3 over it.
            let worst = std::iter::zip(all, after)
                .map(|(a, b)| (f64::from(*b) / f64::from(*a) / transmission - 1.0).abs())
                .fold(0.0, f64::max);
            assert!(worst < 1e-3, "{name}, band {b}: {worst}");
        }
    }
}

#[test]
fn coatings_of_a_file_are_those_of_the_flag() {
    let job = DesignJob::new();
    let quarter_um = 550.0 / (4.0 * 1.38);
    let toml = format!(
        "default = \"quarter\"\n[coating.quarter]\nlayers = [[\"M\", {quarter_um}]]\n[material.M]\nn = 1.38\n"
    );
    fs::write(job.at("lens.toml"), &toml).unwrap();
    job.run("cache", "flag", &with(&ABSOLUTE, &["--coatings", "mgf2"])).ok();
    job.run("cache", "file", &with(&ABSOLUTE, &["--coatings", text(&job.at("lens.toml"))])).ok();
    let (flag, file) = (pixels(&job.at("flag"), "film").1, pixels(&job.at("file"), "film").1);
    let worst = pairs(&flag, &file).map(|(a, b)| (a / b - 1.0).abs()).fold(0.0, f32::max);
    assert!(worst < 1e-6, "{worst}");
    // A file that changed since is named, not the lens.
    fs::write(job.at("lens.toml"), toml.replace("n = 1.38", "n = 1.4")).unwrap();
    let changed = job.run("cache", "file", &with(&ABSOLUTE, &["--coatings", text(&job.at("lens.toml"))]));
    assert_error_line(
        &changed,
        3,
        &["--coatings", "lens.toml (its file, or a table that it names, has changed"],
    );
    // Wrong files and flags end before anything is traced.
    fs::write(job.at("wrong.toml"), "default = \"x\"\n").unwrap();
    let wrong = job.run("cache", "wrong", &["--coatings", text(&job.at("wrong.toml"))]);
    assert_error_line(&wrong, 1, &["wrong.toml", "no coating `x`", "mgf2"]);
    fs::write(job.at("row.toml"), "default = \"x\"\n[coating.x]\nreflectance = [[550, 0.1]]\n").unwrap();
    let row = job.run("cache", "wrong", &["--coatings", text(&job.at("row.toml"))]);
    assert_error_line(&row, 1, &["row.toml", "a table of one row"]);
    for no_surface in ["", "[coating.x]\nreflectance = 0.5\n"] {
        fs::write(job.at("empty.toml"), no_surface).unwrap();
        let empty = job.run("cache", "wrong", &["--coatings", text(&job.at("empty.toml"))]);
        assert_error_line(&empty, 1, &["empty.toml", "no surface a coating", "--coatings none"]);
    }
    assert_exit(&job.run("cache", "wrong", &["--coatings", "mfg2"]), 2, &["ideal, none, mgf2"]);
    let pack = job.run("cache", "wrong", &["--lens", "double-gauss-28-npz", "--coatings", "mgf2"]);
    assert_exit(&pack, 2, &["--coatings", "lens pack"]);
    assert!(!job.at("wrong").exists());
}

#[test]
fn coatings_that_a_design_names_are_found_beside_it() {
    let job = DesignJob::new();
    let named = DESIGN.replacen("  DISZ 8.7", "  COAT SPECIAL 0 0\n  DISZ 8.7", 1);
    assert_ne!(named, DESIGN);
    fs::write(job.at("my.zmx"), format!("COFN QF \"MY.DAT\" \"A\" \"B\" \"C\"\n{named}")).unwrap();
    let missing = job.run("cache", "film", &["--coatings", "design"]);
    assert_error_line(&missing, 1, &["SPECIAL", "--coatings FILE"]);
    fs::write(job.at("my.dat"), "IDEAL SPECIAL 0.5 0.5\n").unwrap();
    job.run("cache", "film", &with(&ABSOLUTE, &["--coatings", "design"])).ok();
    let bare = job.run("cache", "bare", &with(&ABSOLUTE, &["--coatings", "none"])).ok();
    drop(bare);
    let transmission =
        |name: &str| attributes(&job.at(name))["provenance"]["bands"][0]["transmission"].as_f64().unwrap();
    // One bare surface of about 4 % became one of 50 %.
    let ratio = transmission("film") / transmission("bare");
    assert!((ratio - 0.5 / 0.957).abs() < 0.01, "{ratio}");
}

#[test]
fn coating_files_that_differ_in_case_alone_are_ambiguous() {
    let job = DesignJob::new();
    let named = DESIGN.replacen("  DISZ 8.7", "  COAT SPECIAL 0 0\n  DISZ 8.7", 1);
    fs::write(job.at("my.zmx"), format!("COFN QF \"MY.DAT\" \"A\" \"B\" \"C\"\n{named}")).unwrap();
    for (name, share) in [("my.dat", 0.5), ("My.dat", 0.9)] {
        fs::write(job.at(name), format!("IDEAL SPECIAL {share} {}\n", 1.0 - share)).unwrap();
    }
    let light = || lenscube(&["lens", "light", text(&job.at("my.zmx")), "--coatings", "design", "--json"]);
    assert_error_line(&light(), USAGE, &["MY.DAT", "My.dat", "my.dat", "letters' case alone", "--coatings"]);
    // The name as the design has it is not.
    fs::write(job.at("MY.DAT"), "IDEAL SPECIAL 0.25 0.75\n").unwrap();
    let json: Value = serde_json::from_str(&light().ok().stdout).unwrap();
    assert!(json["bands"][0]["transmission"].as_f64().unwrap() < 0.25);
}

#[test]
fn light_of_a_lens_is_printed() {
    let words = ["lens", "light", "double-gauss-28", "--coatings", "mgf2", "--wavelengths", "400,550"];
    let found = lenscube(&[&words[..], &["--json"]].concat()).ok();
    let json: Value = serde_json::from_str(&found.stdout).unwrap();
    // The same means over the pupil by a NumPy tracer; see pipeline/tests/light_budget.rs.
    for (b, expected) in [0.841_766, 0.946_699].iter().enumerate() {
        let band = &json["bands"][b];
        let figure = |key: &str| band[key].as_f64().unwrap();
        assert!((figure("transmission_of_surfaces") - expected).abs() < 1e-5);
        let product = figure("transmission_of_surfaces") * figure("transmission_of_glass");
        assert!((figure("transmission") - product).abs() < 1e-12 && product < *expected);
    }
    // One film on the first surface, at normal incidence.
    let first = &json["surfaces"][0];
    let n = first["index_behind"].as_f64().unwrap();
    let phase = std::f64::consts::FRAC_PI_2 * 550.0 / 587.5618;
    let (c, s) = (phase.cos().powi(2), phase.sin().powi(2));
    let part = |sign: f64| (1.0 + sign * n).powi(2) * c + (n / 1.38 + sign * 1.38).powi(2) * s;
    let reflectance = first["reflectance"].as_f64().unwrap();
    assert!((reflectance - part(-1.0) / part(1.0)).abs() < 1e-6, "{reflectance}");
    assert_eq!(json["surfaces"].as_array().unwrap().len(), 10);
    let plain = lenscube(&["lens", "light", "double-gauss-28"]).ok();
    assert!(plain.stdout.contains("nothing is lost in an ideal lens"), "{}", plain.stdout);
}

/// A metal of 100 µm and a reflectance of 1: no figures of NaN, and nothing is traced.
#[test]
fn lens_that_passes_no_light_is_an_error_and_has_no_figures_of_nan() {
    let job = DesignJob::new();
    let metal = "[coating.x]\nlayers = [[\"M\", 100000]]\n[material.M]\nn = [[550, 0.8, 6.0]]\n";
    for (name, coating) in [("metal.toml", metal), ("mirror.toml", "[coating.x]\nreflectance = 1\n")] {
        fs::write(job.at(name), format!("default = \"x\"\n{coating}")).unwrap();
        let path = job.at(name);
        let coatings = ["--coatings", text(&path)];
        let light = ["lens", "light", "double-gauss-28", "--wavelengths", "550"];
        let found = lenscube(&[&light[..], &coatings].concat()).ok();
        assert!(
            found.stdout.contains(" 550.0  0.0000    0.0000       -                -"),
            "{}",
            found.stdout
        );
        assert!(!found.stdout.contains("NaN"), "{}", found.stdout);
        let psf = lenscube(&[&["lens", "psf", "double-gauss-28", "--size", "9"], &coatings[..]].concat());
        assert_error_line(&psf, FAILED, &["pass no light at 0.5876 µm", "coatings"]);
        let show = lenscube(&[&["lens", "show", "double-gauss-28"], &coatings[..]].concat());
        assert_error_line(&show, FAILED, &["pass no light at 0.", "coatings"]);
        assert_error_line(&job.run("cache", "dark", &coatings), FAILED, &["pass no light at 0.", "µm"]);
    }
    // Less light than a lens pack may have, more than rounding: an error of the lens, not of its pack.
    fs::write(job.at("dim.toml"), "default = \"x\"\n[coating.x]\nreflectance = 0.9999999\n").unwrap();
    let dim = job.run("cache", "dark", &["--coatings", text(&job.at("dim.toml"))]);
    assert_error_line(&dim, FAILED, &["pass no light at 0.", "µm"]);
    assert!(!job.at("dark").exists());
}

#[test]
fn surface_with_a_coating_between_equal_media_is_listed() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("stop.toml");
    fs::write(&path, "[surface]\n6 = \"half\"\n[coating.half]\nreflectance = 0.5\n").unwrap();
    let words = ["lens", "light", "double-gauss-28", "--json", "--coatings", text(&path)];
    let found = json(lenscube(&words));
    let stop = &found["surfaces"][5];
    let transmittance = stop["transmittance"].as_f64().unwrap();
    assert!(stop["surface"] == 6 && (transmittance - 0.5).abs() < 1e-12, "{stop}");
}

#[test]
fn glass_catalogue_of_a_builtin_design_is_an_error() {
    for command in [&["lens", "light", "phone"][..], &["lens", "psf", "phone"]] {
        let ran = lenscube(&[command, &["--glass-catalog", "no.agf"]].concat());
        assert_exit(&ran, USAGE, &["--glass-catalog no.agf", "phone is built in"]);
    }
}

#[test]
fn coatings_that_a_converted_design_would_lose_are_an_error() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out.zmx");
    let ran = lenscube(&["lens", "convert", "phone", text(&out), "--coatings", "mgf2"]);
    assert_exit(&ran, USAGE, &["--coatings mgf2", "a design file names coatings"]);
    assert!(!out.exists());
}
