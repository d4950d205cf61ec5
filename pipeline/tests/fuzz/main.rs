//! Fuzz targets of the pipeline: chart specifications and wavelength lists.

#[path = "../../../tests/fuzz_support/mod.rs"]
mod fuzz_support;

use fuzz_support::extreme::magnitude;
use fuzz_support::{Random, cases, print_row};
use lenscube_pipeline::chart::{ChartSpec, Generator};
use lenscube_pipeline::wavelengths;
use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};
use std::time::Instant;

/// A runner with a fixed seed that shrinks what it finds.
fn runner(few: usize) -> TestRunner {
    let config = Config { cases: cases(few) as u32, failure_persistence: None, ..Config::default() };
    TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha))
}

fn number() -> impl Strategy<Value = String> {
    prop_oneof![
        any::<f64>().prop_map(|v| v.to_string()),
        any::<u64>().prop_map(|seed| format!("{:e}", magnitude(&mut Random(seed)))),
        any::<u64>().prop_map(|seed| magnitude(&mut Random(seed)).to_string()),
        (-1000i32..1_000_000).prop_map(|v| v.to_string()),
        (0u32..2000).prop_map(|v| format!("{}", f64::from(v) / 4.0)),
        prop::sample::select(vec![
            "",
            "nan",
            "1e999",
            "18446744073709551616",
            "-0",
            "µ",
            " 7 ",
            "+3",
            "1e-320"
        ])
        .prop_map(String::from),
    ]
}

#[test]
fn chart_specifications_round_trip() {
    let value = prop_oneof![
        4 => number(),
        1 => (number(), number()).prop_map(|(a, b)| format!("{a}x{b}")),
        1 => (number(), number(), number()).prop_map(|(a, b, c)| format!("{a}:{b}:{c}")),
        1 => (number(), number()).prop_map(|(a, b)| format!("{a},{b};{b},{a}")),
        1 => prop::sample::select(vec!["D65", "A", "disc", "gaussian"]).prop_map(String::from),
    ];
    let key = prop::sample::select(vec![
        "size",
        "wavelengths",
        "pitch_um",
        "overscan",
        "illuminant",
        "value",
        "count",
        "blob",
        "width_px",
        "angle_deg",
        "contrast",
        "grid",
        "centers",
        "patch_px",
        "spokes",
        "sizé",
        "",
    ]);
    let kind = prop::sample::select(vec![
        "uniform",
        "points",
        "slanted-edge",
        "siemens",
        "checker",
        "composite",
        "x",
    ]);
    let setting = (key, value, prop::sample::select(vec!["=", "=", "=", "=", ""]))
        .prop_map(|(k, v, e)| format!("{k}{e}{v}"));
    let specs =
        (kind, prop::collection::vec(setting, 0..4)).prop_map(|(k, s)| format!("{k}?{}", s.join("&")));
    let (start, used) = (Instant::now(), std::cell::Cell::new(0));
    let result = runner(300).run(&specs, |text| {
        let Ok(spec) = text.parse::<ChartSpec>() else { return Ok(()) };
        used.set(used.get() + 1);
        // The written form is canonical.
        let written = spec.to_string();
        let again: ChartSpec = written.parse().map_err(|e| TestCaseError::fail(format!("{written}: {e}")))?;
        prop_assert_eq!(again.to_string(), written);
        // Generating a large chart is slow, and the target are specifications.
        if spec.film.height.max(spec.film.width) <= 256 && spec.wavelengths_nm.len() <= 31 {
            let _ = Generator::new(spec);
        }
        Ok(())
    });
    print_row(
        "gen: specifications",
        cases(300),
        start.elapsed().as_secs_f64(),
        usize::from(result.is_err()),
        used.get(),
    );
    result.unwrap();
    assert!(used.get() > 0);
}

#[test]
fn wavelength_lists_round_trip() {
    let range = prop::collection::vec(number(), 1..5).prop_map(|n| n.join(":"));
    let list = prop::collection::vec(range, 0..4).prop_map(|n| n.join(","));
    let (start, used) = (Instant::now(), std::cell::Cell::new(0));
    let result = runner(500).run(&list, |list| {
        let Ok(nm) = wavelengths::parse(&list) else { return Ok(()) };
        used.set(used.get() + 1);
        prop_assert!(nm.len() <= wavelengths::MAX_BANDS);
        prop_assert_eq!(&wavelengths::parse(&wavelengths::format(&nm)).unwrap(), &nm);
        Ok(())
    });
    print_row(
        "wavelength lists",
        cases(500),
        start.elapsed().as_secs_f64(),
        usize::from(result.is_err()),
        used.get(),
    );
    result.unwrap();
    assert!(used.get() > 0);
}
