//! Films compared with those of an independent reference model in f64 Python (`golden/make_golden.py`), on every instruction set of
//! this machine. Tolerances: 2e-6 of the film's peak for each pixel and 1e-6 in relative L2 (f32 sums over FFT blocks; the expected
//! values are stored in f32, 6e-8).

mod common;

use common::{CommandResult, pixels, run_on, text};
use libtest_mimic::{Arguments, Trial};
use pipeline::simd::Isa;
use serde_json::Value;
use std::path::Path;
use std::process::ExitCode;

const MAX_OF_PEAK: f64 = 2e-6;
const RELATIVE_L2: f64 = 1e-6;

fn number(v: &Value, key: &str) -> usize {
    v[key].as_u64().unwrap() as usize
}

/// Flags of the surfaces of a case with depth: those of the chart's store.
fn surfaces(about: &Value, chart: &Path) -> Vec<String> {
    let Some(hidden) = about["hidden"].as_str() else { return Vec::new() };
    let chart = text(chart);
    let mut flags = vec![format!("--depth={chart}//depth")];
    if hidden == "none" {
        flags.push("--hidden=none".into());
    }
    if hidden == "given" {
        let groups = (1..).take_while(|i| Path::new(chart).join(format!("hidden/{i}")).exists());
        flags.extend(groups.map(|i| format!("--hidden={chart}//hidden/{i}")));
    }
    flags
}

/// Compares the film of a case with the expected one.
fn check(isa: Isa, case: &Path) -> Result<(), String> {
    let about: Value = serde_json::from_slice(&std::fs::read(case.join("case.json")).unwrap()).unwrap();
    let scratch = tempfile::tempdir().unwrap();
    let film = scratch.path().join("film.zarr");
    let there = |key: &str| case.join(about[key].as_str().unwrap());
    let flags: Vec<&str> = about["flags"].as_array().unwrap().iter().map(|v| v.as_str().unwrap()).collect();
    let chart = there("chart");
    let surfaces = surfaces(&about, &chart);
    let flags: Vec<&str> = flags.into_iter().chain(surfaces.iter().map(String::as_str)).collect();
    let CommandResult { code, stderr, .. } = run_on(isa, text(&chart), &film, text(&there("lens")), &flags);
    if code != 0 {
        return Err(format!("exit {code}: {stderr}"));
    }
    if about["hidden"] == "invented" {
        check_shares(&film, &case.join("expected.zarr"))?;
    }
    for part in about["compared"].as_array().unwrap() {
        let (size, got) = pixels(&film, part["array"].as_str().unwrap());
        let (expected_size, expected) =
            pixels(&case.join("expected.zarr"), part["expected"].as_str().unwrap());
        // Where little is known of what is behind a depth edge, rounding is amplified.
        let mask = format!("{}_compared", part["expected"].as_str().unwrap());
        let compared = match about["hidden"].is_string() {
            true => Some(pixels(&case.join("expected.zarr"), &mask).1),
            false => None,
        };
        let rows =
            (number(part, "y")..number(part, "y") + number(part, "height")).step_by(number(part, "step_y"));
        let columns =
            (number(part, "x")..number(part, "x") + number(part, "width")).step_by(number(part, "step_x"));
        assert_eq!((rows.len(), columns.len()), (expected_size.height, expected_size.width));
        assert_eq!(got.len(), expected.len());
        for (band, (got, expected)) in got.iter().zip(&expected).enumerate() {
            let places = rows.clone().flat_map(|y| columns.clone().map(move |x| (y, x)));
            let peak = about["peak"][band].as_f64().unwrap();
            // NaN is not possible: reading it is an error.
            let (mut worst, mut at, mut off, mut all) = (0.0, (0, 0), 0.0, 0.0);
            for (i, ((y, x), &e)) in places.zip(expected).enumerate() {
                if compared.as_ref().is_some_and(|mask| mask[band][i] == 0.0) {
                    continue;
                }
                let difference = f64::from(got[y * size.width + x]) - f64::from(e);
                if difference.abs() > worst {
                    (worst, at) = (difference.abs(), (y, x));
                }
                off += difference * difference;
                all += f64::from(e) * f64::from(e);
            }
            let (worst, l2) = (worst / peak, if all > 0.0 { (off / all).sqrt() } else { off });
            if worst > MAX_OF_PEAK || l2 > RELATIVE_L2 {
                let array = &part["array"];
                return Err(format!(
                    "{array} band {band}: max {worst:.1e} of the peak at row, column {at:?}; L2 {l2:.1e}"
                ));
            }
        }
    }
    Ok(())
}

/// Compares the shares of invented light with those of the model; the film has them in f16.
fn check_shares(film: &Path, expected: &Path) -> Result<(), String> {
    let (size, found) = pixels(film, "invented");
    let (expected_size, expected) = pixels(expected, "invented_0");
    assert_eq!(size, expected_size);
    assert!(expected[0].iter().any(|share| *share > 0.01), "nothing is invented");
    let differs = |(a, b): (&f32, &f32)| (a - b).abs() > 1e-3 * b.abs() + 1e-6;
    match std::iter::zip(&found[0], &expected[0]).find(|pair| differs(*pair)) {
        Some((found, expected)) => Err(format!("a block's invented share is {found}, expected {expected}")),
        None => Ok(()),
    }
}

/// Runs the cases of `folder` whose name starts with one of `prefixes`.
fn cases(isa: Isa, folder: &str, prefixes: &[&str], expected: usize) {
    let all = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
    let mut names: Vec<_> =
        std::fs::read_dir(&all).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names.retain(|n| prefixes.iter().any(|p| n.starts_with(p)));
    assert_eq!(names.len(), expected, "{names:?}");
    let wrong: Vec<_> =
        names.iter().filter_map(|n| Some(format!("{n}: {}", check(isa, &all.join(n)).err()?))).collect();
    assert!(wrong.is_empty(), "{} of {} cases are wrong:\n{}", wrong.len(), names.len(), wrong.join("\n"));
}

/// Test name, folder, prefixes of its cases, number of cases.
type Group = (&'static str, &'static str, &'static [&'static str], usize);

const FLAT: &str = "tests/golden/cases";
const DEPTH: &str = "tests/golden/depth/cases";
const FIELDS: &str = "tests/golden/fields/cases";

fn main() -> ExitCode {
    let groups: [Group; 7] = [
        ("all_stages_with_charts_and_packs_of_all_shapes", FLAT, &["chain-"], 8),
        ("each_surround_with_each_interpolation", FLAT, &["surround-"], 6),
        ("films_of_several_tiles_and_film_regions", FLAT, &["tiles-"], 2),
        ("charts_written_by_other_programs", FLAT, &["chart-"], 2),
        ("single_stages_cropped_windows_and_units", FLAT, &["stages-", "window-", "units-"], 8),
        (
            "surfaces_at_several_distances",
            DEPTH,
            &["hidden-given", "slanted-", "sheet-0-", "scale-below-one", "invented"],
            6,
        ),
        ("lenses_without_rotational_symmetry", FIELDS, &["grid-", "polar-"], 7),
    ];
    let mut trials = Vec::new();
    for isa in Isa::ALL {
        for (name, folder, prefixes, expected) in groups {
            let run = move || {
                cases(isa, folder, prefixes, expected);
                Ok(())
            };
            let trial = Trial::test(format!("{}::{name}", isa.name()), run);
            trials.push(trial.with_ignored_flag(!isa.is_available()));
        }
    }
    libtest_mimic::run(&Arguments::from_args(), trials).exit_code()
}
