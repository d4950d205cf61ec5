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
