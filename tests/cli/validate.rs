//! `lenscube validate` and `lenscube measure`: files, output, exit codes.

use crate::common::{CommandResult, assert_exit, lenscube, text};
use serde_json::Value;
use std::fs;
use std::path::Path;

const WRONG: i32 = 4;
const USAGE: i32 = 2;

fn json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

/// Rotating the samples of a pack integrated over 2 µm blurs the edges in the corner, so the limit of the edge spread function is
/// missed and no other.
#[test]
fn report_files_are_complete_and_missed_limit_exits_4() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("report");
    let CommandResult { code, stderr, .. } = lenscube(&[
        "validate",
        "--lens",
        "double-gauss-28-npz",
        "--wavelengths",
        "550",
        "--threads",
        "2",
        "--out",
        text(&out),
        "--require",
        "ri=0.9999,distortion=0.01,esf=0.99999",
    ]);
    assert_eq!(code, WRONG, "{stderr}");
    let last = stderr.lines().last().unwrap();
    assert!(last.starts_with("lenscube: --require is not met: esf: IoU 0."), "{last}");
    assert!(!last.contains("ri:") && !last.contains("distortion:"), "{last}");

    let summary = json(&out.join("summary.json"));
    let worst = |key: &str| summary["worst"][key]["value"].as_f64().unwrap();
    assert!(worst("ri_iou") > 0.9999 && worst("distortion_mean_px") < 0.01, "{summary}");
    assert!(worst("esf_iou") > 0.98 && worst("esf_iou") < 0.99999, "{summary}");
    assert_eq!(summary["missed"].as_array().unwrap().len(), 1);
    // Films alone: a pack has no surfaces.
    assert_eq!(light_checks(&summary).len(), 4);
    assert!(worst("light") <= 1.0, "{summary}");
    assert!(summary["times"].is_null());
    let edges = summary["bands"][0]["esf"].as_array().unwrap();
    assert_eq!(edges.len(), 6);
    for e in edges {
        let mtf50 = |side: &str| e["mtf50_cy_px"][side].as_f64().unwrap();
        assert!((mtf50("film") / mtf50("lens") - 1.0).abs() < 0.05, "{e}");
    }

    let report = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(
        !report.contains("http://")
            || report.matches("http://").count() == report.matches("http://www.w3.org/2000/svg").count()
    );
    assert!(!report.contains("NaN") && !report.contains("inf "), "a figure is NaN or infinite");
    for words in [
        "column (px)",
        "row from the bottom (px)",
        "No full run recorded",
        "exaggerated",
        "Nyquist",
        "Not met:",
    ] {
        assert!(report.contains(words), "{words}");
    }
    // One band is not the film of the paper.
    assert!(!report.contains("98.7 %") && summary["paper"].is_null(), "{summary}");
    // Progress has as many lines as the run takes time.
    let told = stderr.lines().filter(|line| !line.starts_with("validating: ")).count();
    assert!(stderr.contains("worst of 1 band:") && told <= 6, "{stderr}");
    assert_eq!(report.matches("<svg").count(), report.matches("</svg>").count());
    for name in ["ri", "departure", "distortion", "esf", "mtf"] {
        let csv = fs::read_to_string(out.join(format!("curves/{name}.csv"))).unwrap();
        let columns = csv.lines().next().unwrap().split(',').count();
        assert!(
            csv.lines().count() > 5
                && csv.lines().all(|l| l.replace(", ", " ").split(',').count() == columns),
            "{name}"
        );
    }
    let left: Vec<_> = fs::read_dir(&out).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(left.len(), 3, "films are removed: {left:?}");
}

/// Differences over their limits of the section Light, by name.
fn light_checks(summary: &Value) -> Vec<(String, f64)> {
    let one = |check: &Value| {
        let number = |key: &str| check[key].as_f64().unwrap();
        (check["name"].as_str().unwrap().to_owned(), number("difference") / number("limit"))
    };
    summary["light"].as_array().unwrap().iter().map(one).collect()
}

#[test]
fn light_of_a_design_is_checked_with_its_transmission_and_ghosts() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("report");
    for (coatings, with) in [(&[][..], "MgF2"), (&["--coatings", "none"], "--coatings none")] {
        let flags = [
            "validate",
            "--wavelengths",
            "550",
            "--film-size",
            "4096",
            "--threads",
            "2",
            "--out",
            text(&out),
        ];
        let met = lenscube(&[&flags[..], coatings, &["--require", "light=1,ri=0.9999"]].concat());
        assert_eq!(met.code, 0, "{}", met.stderr);
        let checks = light_checks(&json(&out.join("summary.json")));
        let (names, of_limit): (Vec<String>, Vec<f64>) = checks.into_iter().unzip();
        assert_eq!(names.len(), 10, "{names:?}");
        assert!(names[4].starts_with(&format!("transmission with {with} at 587.6 nm")), "{names:?}");
        assert!(names[5..].iter().all(|name| name.starts_with("ghost ")), "{names:?}");
        // Within the limits, and not for want of a difference.
        assert!(
            of_limit.iter().all(|v| *v <= 1.0) && of_limit.iter().filter(|v| **v > 0.0).count() > 5,
            "{of_limit:?}"
        );
    }
    let report = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(report.contains("<h2>Light</h2>") && report.contains("energy of the scatter of a lamp"));
}

#[test]
fn invalid_validate_flags_exit_2_with_one_line() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("report");
    let cases: [(&[&str], &str); 5] = [
        (&["--require", "psf=1"], "ri=IOU"),
        (&["--lens", "double-gauss-28-npz", "--coatings", "mgf2"], "--coatings is for designs"),
        (&["--bands", "7", "--wavelengths", "550"], "--bands 7"),
        (&["--lens", "no-such-lens"], "no-such-lens"),
        (&["--against", "double-gauss-28-npz", "--wavelengths", "555"], "no band at 555 nm to compare with"),
    ];
    for (flags, word) in cases {
        let ran = lenscube(&[&["validate", "--out", text(&out)], flags].concat());
        assert_eq!(ran.code, USAGE, "{}", ran.stderr);
        assert!(ran.stderr.contains(word) && !ran.stderr.contains("panicked"), "{}", ran.stderr);
    }
}

#[test]
fn measure_reports_edges_points_and_profiles_of_a_chart() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    // An edge through the middle of the chart (overscan 67 px), exact pixel means: a box of 1 px, MTF50 at 0.6 cycles/px.
    let chart = "gen:slanted-edge?size=301&angle_deg=5&overscan=67&wavelengths=500,600";
    let (csv, all, svg) = (at("edge.csv"), at("edge.json"), at("edge.svg"));
    lenscube(&[
        "measure",
        chart,
        "--edge",
        "222,157,212,277",
        "--band",
        "600",
        "--csv",
        text(&csv),
        "--json",
        text(&all),
        "--plot",
        text(&svg),
    ])
    .ok();
    let found = json(&all);
    let figures = &found["bands"][0]["figures"];
    assert!((figures["normal_deg"].as_f64().unwrap() - 5.0).abs() < 0.02, "{figures}");
    assert!((figures["mtf50_cy_px"].as_f64().unwrap() - 0.6034).abs() < 0.02, "{figures}");
    assert!((figures["rise_10_90_px"].as_f64().unwrap() - 0.8).abs() < 0.1, "{figures}");
    assert_eq!(found["bands"].as_array().unwrap().len(), 1);
    assert_eq!(figures["remarks"], serde_json::json!([]));
    assert!(figures["mtf50_lp_mm"].as_f64().unwrap() > 100.0, "{figures}");
    let upright = "gen:slanted-edge?size=301&angle_deg=1&overscan=67&wavelengths=500";
    let ran = lenscube(&["measure", upright, "--edge", "218.05,157,215.95,277"]).ok();
    assert!(ran.stdout.contains("DOUBTFUL: the edge is slanted by 1.0"), "{}", ran.stdout);
    assert!(fs::read_to_string(&csv).unwrap().lines().count() > 100);
    let svg = fs::read_to_string(&svg).unwrap();
    for word in ["600 nm", "distance from the edge (px)", "(µm)", "spatial frequency (lp/mm)", "(cycles/px)"]
    {
        assert!(svg.contains(word), "{word}");
    }

    // Another file is not replaced, and nothing is measured before that is known.
    let written = fs::read_to_string(&csv).unwrap();
    let again = ["measure", chart, "--edge", "222,157,212,277", "--csv", text(&csv)];
    let ran = lenscube(&again);
    assert_exit(&ran, 3, &["edge.csv already exists", "--overwrite"]);
    assert_eq!((ran.stdout.as_str(), fs::read_to_string(&csv).unwrap()), ("", written));
    lenscube(&[&again[..], &["--overwrite"]].concat()).ok();

    let points = "gen:points?size=301&count=3&overscan=10&wavelengths=550";
    let ran = lenscube(&["measure", points, "--points", "161,159;16.5,17", "--half-px", "8"]).ok();
    assert!(ran.stdout.contains("160.0000,160.0000; 16.0000,16.0000"), "{}", ran.stdout);

    let ran =
        lenscube(&["measure", "gen:uniform?size=50&value=3&wavelengths=550", "--profile", "1,2,40,30"]).ok();
    assert!(ran.stdout.contains("3.000000 to 3.000000"), "{}", ran.stdout);
    let outside = ["measure", "gen:uniform?size=50&wavelengths=550", "--profile", "1,2,40,900"];
    let ran = lenscube(&outside);
    assert_exit(&ran, USAGE, &["is not inside the image", "; give other positions"]);
    assert!(!ran.stderr.contains("--half-px"), "{}", ran.stderr);

    // As `| head -0`.
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let mut measure = std::process::Command::new(env!("CARGO_BIN_EXE_lenscube"));
    let ran =
        measure.args(["measure", points, "--points", "161,159", "--half-px", "8"]).stdout(writer).status();
    assert_eq!(ran.unwrap().code(), Some(0));

    for (words, word) in [
        (["measure", chart, "--edge", "2,157,3,277"], "is not inside the image"),
        (["measure", chart, "--edge", "222,157,221,163"], "at least 10 px"),
        (["measure", chart, "--edge", "238,157,228,277"], "not on the edge"),
        (["measure", chart, "--edge", "222,157,222"], "four numbers"),
        (["measure", points, "--points", "100,100"], "no point near"),
    ] {
        let ran = lenscube(&words);
        assert!(
            ran.code != 0 && ran.stderr.contains(word) && !ran.stderr.contains("panicked"),
            "{}",
            ran.stderr
        );
    }
}
