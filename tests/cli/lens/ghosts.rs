//! `lenscube lens light`: the table of ghosts.

use super::*;

#[test]
fn ghosts_of_a_design_are_listed_with_their_shares() {
    let words = ["lens", "light", "double-gauss-28", "--coatings", "none", "--sensor-reflectance", "10%"];
    let found = lenscube(&[&words[..], &["--json"]].concat()).ok();
    let json: Value = serde_json::from_str(&found.stdout).unwrap();
    let paths = json["ghosts"]["paths"].as_array().unwrap();
    // Ten surfaces and the film: 11 * 10 / 2.
    assert_eq!(paths.len(), 55);
    let share =
        |name: &str| paths.iter().find(|p| p["path"] == name).unwrap()["share_on_axis"].as_f64().unwrap();
    // Of a NumPy tracer without the absorption of the glasses, which takes up to 3 %.
    for (path, expected) in [("11-9", 2.83e-3), ("7-5", 2.94e-3), ("film-10", 5.02e-3)] {
        assert!((share(path) / expected - 1.0).abs() < 0.05, "{path}: {}", share(path));
    }
    let shares: Vec<f64> = paths.iter().map(|p| p["share_on_axis"].as_f64().unwrap()).collect();
    assert!(shares.windows(2).all(|w| w[0] >= w[1]));
    let text = lenscube(&words).ok();
    assert!(text.stdout.contains("film-10") && text.stdout.contains("55 paths"), "{}", text.stdout);
    let without_film = lenscube(&["lens", "light", "double-gauss-28", "--coatings", "mgf2", "--json"]).ok();
    let json: Value = serde_json::from_str(&without_film.stdout).unwrap();
    assert_eq!(json["ghosts"]["paths"].as_array().unwrap().len(), 45);
}

#[test]
fn film_that_reflects_needs_a_lens_that_does_and_a_table_of_its_wavelengths() {
    let dir = tempfile::tempdir().unwrap();
    let table = dir.path().join("film.csv");
    std::fs::write(&table, "wavelength_nm,reflectance\n400,0.1\n450,0.2\n").unwrap();
    let light = |coatings: &str, film: &str| {
        lenscube(&["lens", "light", "double-gauss-28", "--coatings", coatings, "--sensor-reflectance", film])
    };
    assert_exit(&light("ideal", "0.1"), 2, &["--coatings none"]);
    assert_exit(&light("mgf2", table.to_str().unwrap()), 1, &["400..450 nm"]);
    for wrong in ["1.0", "120%", "grey"] {
        assert_exit(&light("mgf2", wrong), 2, &["--sensor-reflectance"]);
    }
}

#[test]
fn ghosts_of_a_pack_are_listed_unless_it_is_sealed() {
    let dir = tempfile::tempdir().unwrap();
    let traced = |name: &str, flags: &[&str]| {
        let pack = dir.path().join(name).to_str().unwrap().to_owned();
        let words = ["lens", "trace", "triplet", &pack, "--wavelengths", "450,550", "--max-height-mm", "2"];
        let given = [
            "--film-pitch-um",
            "100",
            "--tails",
            "off",
            "--coatings",
            "mgf2",
            "--ghosts",
            "on",
            "--ghost-rings",
            "16",
        ];
        lenscube(&[&words[..], &given, &["--sensor-reflectance", "5%"], flags].concat()).ok();
        pack
    };
    let pack = traced("ghosts.lens.zarr", &[]);
    let light = |flags: &[&str]| lenscube(&[&["lens", "light", &pack], flags].concat());
    let json: Value = serde_json::from_str(&light(&["--json"]).ok().stdout).unwrap();
    assert_eq!((json["coatings"].as_str(), json["bands"].as_array().unwrap().len()), (Some("mgf2"), 2));
    let ghosts = &json["ghosts"];
    // The band nearest to the primary wavelength.
    assert_eq!(ghosts["wavelength_nm"], 550.0);
    let paths = ghosts["paths"].as_array().unwrap();
    // Six surfaces and the film.
    assert_eq!(paths.len(), 21);
    assert!(paths.iter().any(|path| path["path"] == "film-6"), "{ghosts}");
    let shares: Vec<f64> = paths.iter().map(|path| path["share_on_axis"].as_f64().unwrap()).collect();
    assert!((shares.iter().sum::<f64>() / ghosts["share_on_axis"].as_f64().unwrap() - 1.0).abs() < 1e-12);
    // Those of the design at its primary wavelength, 588 nm, have about the same light.
    let design = ["lens", "light", "triplet", "--coatings", "mgf2", "--sensor-reflectance", "5%", "--json"];
    let of_design: Value = serde_json::from_str(&lenscube(&design).ok().stdout).unwrap();
    let share_of_design = of_design["ghosts"]["share_on_axis"].as_f64().unwrap();
    assert!((ghosts["share_on_axis"].as_f64().unwrap() / share_of_design - 1.0).abs() < 0.5);
    let text = light(&["--wavelengths", "450"]).ok().stdout;
    assert!(text.contains("ghosts at 450.0 nm: 21 paths") && text.contains("film-6"), "{text}");
    assert_exit(&light(&["--wavelengths", "500"]), 2, &["no band at 500 nm", "450 nm"]);
    for flags in [["--sensor-reflectance", "5%"], ["--ghost-rings", "32"], ["--coatings", "none"]] {
        assert_exit(&light(&flags), 2, &["was traced before"]);
    }
    let sealed = traced("sealed.lens.zarr", &["--sealed"]);
    let found = lenscube(&["lens", "light", &sealed]).ok();
    assert!(found.stderr.contains("does not list their paths"), "{}", found.stderr);
    assert!(!found.stdout.contains("film-6"));
}
