//! `lenscube lens export`.

use super::*;

/// What `lens export` reports.
fn report(words: &[&str]) -> Value {
    json(lenscube(&[&["lens", "export"], words, &["--json"]].concat()))
}

/// Rows of numbers of a CSV.
fn rows(csv: &str) -> Vec<Vec<f64>> {
    let row = |line: &str| line.split(',').map(|cell| cell.parse().unwrap()).collect();
    csv.lines().skip(1).map(row).collect()
}

#[test]
fn opencv_puts_traced_chief_rays_where_they_land() {
    let film = ["--film-size", "1200x900", "--film-pitch-um", "3", "--band", "550"];
    let table = lenscube(&[&["lens", "export", "phone", "--as", "lut"], &film[..]].concat()).ok();
    assert!(
        table.stdout.starts_with("field_angle_deg,ideal_height_mm,image_height_mm,relative_illumination\n")
    );
    let rows = rows(&table.stdout);
    let corner = 1e-3 * 3.0 * 599.5_f64.hypot(449.5);
    assert!((rows.last().unwrap()[2] - corner).abs() < 1e-9 && rows[0] == [0.0, 0.0, 0.0, 1.0]);
    for terms in ["5", "8"] {
        let report = report(&[&["phone", "--as", "opencv", "--terms", terms], &film[..]].concat());
        assert_eq!(report["principal_point_px"], serde_json::json!([599.5, 449.5]));
        let k = |name: &str| report["coefficients"][name].as_f64().unwrap_or(0.0);
        let f = report["focal_length_px"].as_f64().unwrap();
        let f_mm = report["focal_length_mm"].as_f64().unwrap();
        let mut worst = 0.0_f64;
        for row in &rows {
            let t = row[0].to_radians().tan();
            // The focal length is that of 550 nm, ideal heights have that of the primary wavelength.
            assert!((row[1] - f_mm * t).abs() < 2e-3 * f_mm * t + 1e-12, "{row:?}");
            let s = t * t;
            let numerator = 1.0 + s * (k("k1") + s * (k("k2") + s * k("k3")));
            let denominator = 1.0 + s * (k("k4") + s * (k("k5") + s * k("k6")));
            worst = worst.max((f * t * numerator / denominator - row[2] / 3e-3).abs());
        }
        let max = report["residuals"]["distortion"]["max_px"].as_f64().unwrap();
        assert!(worst <= max + 1e-6 && worst > 0.9 * max, "{terms} terms: {worst} px, residual {max} px");
    }
}

#[test]
fn models_of_the_angle_describe_a_fisheye_and_opencv_refuses_it() {
    let film = ["--film-pitch-um", "4"];
    assert_exit(
        &lenscube(&[&["lens", "export", "fisheye-170", "--as", "opencv"], &film[..]].concat()),
        FAILED,
        &["fisheye-170 as opencv", "85.00 degrees", "opencv-fisheye, ftheta"],
    );
    for model in ["opencv-fisheye", "ftheta"] {
        let report = report(&[&["fisheye-170", "--as", model], &film[..]].concat());
        let deg = report["fitted_to_deg"].as_f64().unwrap();
        let max = report["residuals"]["distortion"]["max_px"].as_f64().unwrap();
        assert!((deg - 85.0).abs() < 0.1 && max < 3.0, "{model}: {deg} degrees, {max} px");
    }
    let printed = lenscube(&[&["lens", "export", "fisheye-170", "--as", "lensfun"], &film[..]].concat()).ok();
    assert!(printed.stdout.contains("<type>fisheye</type>"), "{}", printed.stdout);
    assert!(printed.stderr.contains("residual of red: max"), "{}", printed.stderr);
}

#[test]
fn files_are_written_whole_and_only_within_the_residual() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("phone.yml");
    let export = |flags: &[&str]| {
        let words = ["lens", "export", "phone", text(&out), "--as", "opencv", "--film-size", "1200x900"];
        lenscube(&[&words[..], &["--film-pitch-um", "3"], flags].concat())
    };
    assert_exit(
        &export(&["--max-residual", "1e-9"]),
        4,
        &["phone as opencv", "--max-residual", "nothing is written"],
    );
    assert!(files(dir.path()).is_empty());
    let first = export(&[]).ok();
    assert!(first.stdout.contains("residual of distortion: max") && first.stderr.contains("phone.yml"));
    let before = fs::read_to_string(&out).unwrap();
    assert!(before.starts_with("%YAML:1.0\n---\nlens: \"Phone"), "{before}");
    assert_exit(&export(&[]), OTHER_JOB, &["phone.yml", "--overwrite"]);
    export(&["--overwrite", "--terms", "8"]).ok();
    let after = fs::read_to_string(&out).unwrap();
    assert!(before.contains("cols: 5") && after.contains("cols: 8"));
    assert_exit(
        &lenscube(&["lens", "export", text(&out), text(&out), "--as", "lut", "--overwrite"]),
        USAGE,
        &["phone.yml"],
    );
    assert_eq!(fs::read_to_string(&out).unwrap(), after);
}

#[test]
fn packs_are_exported_by_their_tables() {
    let packs = |flags: &[&str]| {
        lenscube(&[&["lens", "export", "double-gauss-28-npz", "--film-size", "1000"], flags].concat())
    };
    let max_px = |name: &str, flags: &[&str]| {
        let film = ["--film-size", "1000", "--film-pitch-um", "24", "--as", "opencv", "--band", "550"];
        let report = report(&[&[name], &film[..], flags].concat());
        let k1 = report["coefficients"]["k1"].as_f64().unwrap();
        (k1, report["focal_length_mm"].as_f64().unwrap())
    };
    // The same lens, traced here and by other software.
    let (design, pack) = (max_px("double-gauss-28", &[]), max_px("double-gauss-28-npz", &[]));
    assert!((design.0 - pack.0).abs() < 1e-3 && (design.1 - pack.1).abs() < 1e-2, "{design:?} {pack:?}");
    assert_exit(&packs(&["--as", "lut", "--band", "551"]), USAGE, &["no band at 551 nm", "its bands are"]);
    assert_exit(&packs(&["--as", "lut", "--focus-m", "1"]), USAGE, &["lens pack", "designs only"]);
    packs(&["--as", "lensfun"]).ok();
}

#[test]
fn what_a_model_does_not_have_is_refused() {
    let refused = |flags: &[&str], words: &[&str]| {
        assert_exit(&lenscube(&[&["lens", "export", "phone"], flags].concat()), USAGE, words);
    };
    refused(&["--as", "lensfun", "--band", "550"], &["--band", "--bands R,G,B"]);
    refused(&["--as", "opencv", "--bands", "620,540,460"], &["--bands", "one wavelength"]);
    refused(&["--as", "lensfun", "--bands", "460,540,620"], &["the longest first"]);
    refused(&["--as", "brown"], &["brown", "opencv-fisheye"]);
    refused(&["--as", "lut", "--film-pitch-um", "0.001"], &["--film-size"]);
}

#[test]
fn film_beyond_the_field_is_fitted_within_it() {
    let ran = lenscube(&[
        "lens",
        "export",
        "phone",
        "--as",
        "colmap",
        "--film-size",
        "20000",
        "--film-pitch-um",
        "3",
    ]);
    // Whether the fit is monotone or not, the field that is fitted is named.
    assert!(ran.stderr.contains("beyond the field of the lens, which ends at"), "{}", ran.stderr);
}

#[test]
fn finite_object_distance_is_that_of_the_pinhole() {
    let near = report(&[
        "macro-100",
        "--as",
        "opencv",
        "--focus-m",
        "0.5",
        "--film-size",
        "900x600",
        "--film-pitch-um",
        "40",
    ]);
    let camera = json(lenscube(&[
        "lens",
        "camera",
        "macro-100",
        "--focus-m",
        "0.5",
        "--film-size",
        "900x600",
        "--film-pitch-um",
        "40",
        "--json",
    ]));
    let [a, b] = [&near, &camera].map(|v| v["focal_length_mm"].as_f64().unwrap());
    assert!((a - b).abs() < 1e-6 * b, "{a} mm, pinhole {b} mm");
}
