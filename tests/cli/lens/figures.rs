//! Tables of `lens show --json` and `--csv`, `lens psf`.

use super::*;

const ALL: [&str; 16] = [
    "first-order",
    "cardinal-points",
    "paraxial-rays",
    "seidel",
    "real-rays",
    "fields",
    "field-curvature",
    "spots",
    "wavefront",
    "zernike-standard",
    "zernike-fringe",
    "wavefront-map",
    "mtf",
    "mtf-polychromatic",
    "mtf-through-focus",
    "encircled-energy",
];

#[test]
fn tables_are_json_and_files_with_units() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("tables");
    let flags = ["lens", "show", "double-gauss-28", "--heights", "0,10", "--focus-mm=-0.1,0"];
    let small = [&flags[..], &["--csv", text(&out), "--wavefront-samples", "32", "--lp-mm", "20"]].concat();
    let shown = json(lenscube(&[&small[..], &["--json"]].concat()));
    let rows = |key: &str| shown[key].as_array().unwrap_or_else(|| panic!("no {key}")).len();
    // Three wavelengths, two heights, twelve surfaces and the film.
    for (key, count) in [
        ("cardinal_points", 6),
        ("paraxial_rays", 12),
        ("seidel", 12),
        ("real_rays", 2 * 3 * 12),
        ("field_curvature", 6),
        ("spots", 8),
        ("wavefront", 6),
        ("zernike_standard", 6 * 37),
        ("zernike_fringe", 6 * 37),
        ("mtf", 6),
        ("mtf_polychromatic", 2),
        ("mtf_through_focus", 4),
    ] {
        assert_eq!(rows(key), count, "{key}");
    }
    assert!(rows("encircled_energy") > 60 && shown.get("wavefront_map").is_none());
    assert_eq!(fs::read_dir(&out).unwrap().count(), ALL.len() - 1);
    for name in ALL.iter().filter(|n| **n != "wavefront-map") {
        let csv = fs::read_to_string(out.join(format!("{name}.csv"))).unwrap();
        let columns = csv.lines().next().unwrap().split(',').count();
        assert!(columns > 3 && csv.lines().all(|l| l.split(',').count() == columns), "{name}: {csv}");
    }
    let mtf = fs::read_to_string(out.join("mtf.csv")).unwrap();
    assert!(
        mtf.starts_with(
            "wavelength_nm,image_height_mm,frequency_lp_mm,tangential,sagittal,light_in_window\n"
        )
    );
    // Values are those of JSON.
    let first = &shown["mtf"][0];
    let tangential: f64 = mtf.lines().nth(1).unwrap().split(',').nth(3).unwrap().parse().unwrap();
    assert!((tangential / first["tangential"].as_f64().unwrap() - 1.0).abs() < 1e-11, "{mtf}");
    // The film as designed is one of the positions; polychromatic MTF is below that of a wavelength in best focus.
    let at = |k: usize| shown["mtf_through_focus"][k].clone();
    let poly = &shown["mtf_polychromatic"][1];
    assert!(
        (at(3)["tangential_polychromatic"].as_f64().unwrap() - poly["tangential"].as_f64().unwrap()).abs()
            < 1e-9
    );
    // Nothing is replaced without --overwrite; tables are chosen.
    assert_exit(&lenscube(&small), OTHER_JOB, &["first-order.csv already exists"]);
    let map = ["--overwrite", "--tables", "wavefront-map,seidel"];
    lenscube(&[&small[..], &map].concat()).ok();
    let map = fs::read_to_string(out.join("wavefront-map.csv")).unwrap();
    assert!(map.lines().count() > 6 * 600, "{}", map.lines().count());
}

#[test]
fn flags_of_tables_are_checked() {
    let bad = |flags: &[&str], words: &[&str]| {
        assert_exit(&lenscube(&[&["lens", "show", "double-gauss-28"], flags].concat()), USAGE, words);
    };
    bad(&["--tables", "mtf"], &["--tables", "--json"]);
    bad(&["--overwrite"], &["--overwrite", "--csv"]);
    bad(&["--json", "--tables", "mft"], &["mft", "mtf"]);
    bad(&["--json", "--wavefront-samples", "33"], &["even number from 8 to 1024"]);
    bad(&["--json", "--tables", "mtf-through-focus", "--focus-mm", "1:0:1"], &["--focus-mm 1:0:1"]);
    let pack = ["lens", "show", "double-gauss-28-npz", "--json"];
    assert_exit(&lenscube(&[&pack[..], &["--tables", "seidel"]].concat()), USAGE, &["lens pack", "seidel"]);
    let shown = json(lenscube(&[&pack[..], &["--wavelengths", "550", "--heights", "0,10"]].concat()));
    assert_eq!(shown["mtf"].as_array().unwrap().len(), 6);
    assert!(shown["encircled_energy"].as_array().unwrap().len() > 10 && shown.get("seidel").is_none());
}

/// The marginal ray of the biconvex lens is 2.0416 µm from the axis (OpticStudio); the outermost ray of the quadrature 2.017 µm.
#[test]
fn maximum_radius_of_a_spot_is_that_of_the_rim() {
    let lens = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cli/lens/opticstudio/simple.zmx");
    let shown = json(lenscube(&["lens", "show", text(&lens), "--json", "--tables", "first-order"]));
    assert_eq!(shown["design"]["name"], "simple", "the name of the file of a design that has none");
    let field = &shown["fields"][0];
    assert!((field["geo_um"].as_f64().unwrap() - 2.041_609_942_697_864).abs() < 1e-9, "{field}");
    for key in ["working_f_number_tangential", "working_f_number_sagittal"] {
        assert!((field[key].as_f64().unwrap() - 10.05939).abs() < 5e-6, "{field}");
    }
}

#[test]
fn design_with_field_points_on_the_axis_alone_has_the_figures_of_the_axis() {
    let dir = tempfile::tempdir().unwrap();
    let lens = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cli/lens/opticstudio/simple.zmx");
    let plots = dir.path().join("plots");
    lenscube(&["lens", "show", text(&lens), "--plot", text(&plots)]).ok();
    let mut names: Vec<String> = fs::read_dir(&plots)
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .filter_map(|n| n.strip_suffix(".png").map(str::to_owned))
        .collect();
    names.sort();
    assert_eq!(
        names,
        ["encircled-energy", "layout", "mtf-focus", "mtf-frequency", "opd-fans", "psf", "ray-fans", "spots"]
    );
}

#[test]
fn psf_prints_the_notes_of_its_design_and_names_the_ending_of_sections() {
    let dir = tempfile::tempdir().unwrap();
    let design = dir.path().join("my.zmx");
    fs::write(&design, format!("QQQQ 1\n{DESIGN}")).unwrap();
    let words = ["lens", "psf", text(&design), "--size", "9"];
    let ran = lenscube(&words).ok();
    assert!(ran.stderr.contains("note: ") && ran.stderr.contains("QQQQ"), "{}", ran.stderr);
    let wrong = lenscube(&[&words[..], &["--sections", "GLASS.AGF"]].concat());
    assert_exit(&wrong, USAGE, &["--sections must end in .csv"]);
}

#[test]
fn psf_of_a_field_point_is_rotated_normalised_and_integrated() {
    let dir = tempfile::tempdir().unwrap();
    let psf = |name: &str, flags: &[&str]| {
        let out = dir.path().join(name);
        let words = ["lens", "psf", "double-gauss-28", text(&out), "--wavelength", "550", "--json"];
        let shown = json(lenscube(&[&words[..], flags].concat()));
        let values = crate::common::read_npy(&out).into_iter().map(f64::from);
        (shown, values.collect::<Vec<_>>())
    };
    let number = |v: &Value, key: &str| v[key].as_f64().unwrap();
    let size = ["--size", "65", "--pitch-um", "1"];
    let (along_x, a) = psf("x.npy", &[&size[..], &["--at", "14,0"]].concat());
    let (along_y, b) = psf("y.npy", &[&size[..], &["--at", "0,14"]].concat());
    assert_eq!(a.len(), 65 * 65);
    // A quarter turn: rows become columns.
    let largest = a.iter().fold(0.0f64, |m, v| m.max(*v));
    assert!((0..65 * 65).all(|i| (a[i] - b[i % 65 * 65 + i / 65]).abs() < 1e-4 * largest));
    assert!((number(&along_x, "centroid_x_um") - number(&along_y, "centroid_y_um")).abs() < 1e-3);
    // Shares: the sum is the light in the window.
    assert!((a.iter().sum::<f64>() - number(&along_x, "light_in_window")).abs() < 1e-5);
    let (_, peak) = psf("peak.npy", &[&size[..], &["--at", "14,0", "--normalise", "peak"]].concat());
    assert!(a.iter().zip(&peak).all(|(a, p)| (a / largest - p).abs() < 1e-6));
    let (strehl, s) = psf("strehl.npy", &[&size[..], &["--at", "14,0", "--normalise", "strehl"]].concat());
    assert!((s[32 * 65 + 32] - number(&strehl, "strehl")).abs() < 1e-6);
    // Pixels of 4 µm have the light of their sixteen samples of 1 µm, which are dense enough here.
    let pixels = ["--size", "15", "--pitch-um", "4", "--at", "14,0", "--integrate"];
    let (whole, p) = psf("pixels.npy", &pixels);
    assert_eq!(whole["value_is"], "integrated over the pixel");
    let fine = ["--size", "61", "--pitch-um", "1", "--at", "14,0", "--integrate"];
    let (_, f) = psf("fine.npy", &fine);
    // Pixel 7 of 15 is centred on the chief ray as pixel 30 of 61 is: half a fine pixel at each end.
    let share = |k: usize| if k == 0 || k == 4 { 0.5 } else { 1.0 };
    let sum: f64 = (0..25).map(|i| share(i / 5) * share(i % 5) * f[(28 + i / 5) * 61 + 28 + i % 5]).sum();
    assert!((p[7 * 15 + 7] / sum - 1.0).abs() < 0.1, "{} {sum}", p[7 * 15 + 7]);
    // A pitch above the Nyquist pitch has the same values where both have samples; the Strehl ratio does not depend on it.
    let (coarse, c) = psf("coarse.npy", &["--size", "13", "--pitch-um", "5", "--at", "14,0"]);
    assert!((number(&coarse, "strehl") - number(&strehl, "strehl")).abs() < 1e-5, "{coarse}");
    for (i, found) in c.iter().enumerate() {
        let (y, x) = (i / 13, i % 13);
        let fine = 25.0 * a[(2 + 5 * y) * 65 + 2 + 5 * x];
        assert!((found - fine).abs() < 1e-4 * 25.0 * largest, "{y} {x}: {found} {fine}");
    }
    // Sections and errors.
    let (out, sections) = (dir.path().join("out.csv"), dir.path().join("sections.csv"));
    let words = ["lens", "psf", "double-gauss-28", text(&out), "--size", "5", "--sections", text(&sections)];
    let ran = lenscube(&words).ok();
    assert!(
        ran.stdout.contains("Strehl ratio") && ran.stdout.contains("normalised by light"),
        "{}",
        ran.stdout
    );
    assert_eq!(fs::read_to_string(&out).unwrap().lines().count(), 26);
    assert!(fs::read_to_string(&sections).unwrap().starts_with("position_um,section_along_x,"));
    assert_exit(&lenscube(&words), OTHER_JOB, &["out.csv already exists"]);
    assert_exit(&lenscube(&["lens", "psf", "double-gauss-28", "a.txt"]), USAGE, &[".npy or .csv"]);
    assert_exit(&lenscube(&["lens", "psf", "double-gauss-28", "--size", "4"]), USAGE, &["odd number"]);
    assert_exit(&lenscube(&["lens", "psf", "double-gauss-28-npz"]), USAGE, &["not a design"]);
    assert_exit(&lenscube(&["lens", "psf", "double-gauss-28", "--at", "0,400"]), FAILED, &["400"]);
}

/// Third order of the real wavefront of a catadioptric lens, from its Fringe coefficients: 6 Z9 − 30 Z16 + 90 Z25 − 210 Z36 + 420 Z37.
#[test]
fn seidel_sum_of_a_mirror_lens_is_the_third_order_of_its_wavefront() {
    let flags = ["--json", "--heights", "0,1", "--wavelengths", "587.6", "--tables", "seidel,zernike-fringe"];
    let shown = json(lenscube(&[&["lens", "show", "mirror-500"], &flags[..]].concat()));
    let total = shown["seidel"].as_array().unwrap().last().unwrap()["w040_waves"].as_f64().unwrap();
    let fringe = |j: usize| shown["zernike_fringe"][j - 1]["coefficient_waves"].as_f64().unwrap();
    let real =
        6.0 * fringe(9) - 30.0 * fringe(16) + 90.0 * fringe(25) - 210.0 * fringe(36) + 420.0 * fringe(37);
    let um = shown["design"]["primary_wavelength_nm"].as_f64().unwrap() / 587.6;
    assert!((real / (um * total) - 1.0).abs() < 0.02, "{real} {total}");
}
