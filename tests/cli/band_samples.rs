//! `--band-samples`: a band of some width against the mean of narrow ones; without it, and with one wavelength, films of before.

use crate::common::{Picture, assert_error_line, files, lens, pairs, pixels, run, text};
use crate::common::{delta, identity_band, write_pack};
use formats::chart::{ChartMeta, Codec, write_chart};
use pipeline::geometry::Size;
use std::path::{Path, PathBuf};

/// A lens that is quick to trace.
const LENS: &str = "triplet";
/// The film of the long test, 12 mm from the axis of the lens, where chief rays of a band land at different places.
const PLACE: [&str; 8] =
    ["--film-size", "64", "--film-pitch-um", "2", "--axis", "-5968,31.5", "--center", "12,0"];

/// A chart with the same bands of stripes at `nm`.
fn chart(path: &Path, nm: &[f64]) -> PathBuf {
    let size = Size::new(256, 256);
    let stripes =
        |i: usize| if (i % size.width / 6 + i / size.width / 9).is_multiple_of(2) { 1.0 } else { 0.1 };
    let band: Vec<f32> = (0..size.pixels()).map(stripes).collect();
    let picture = Picture { size, bands: vec![band; nm.len()] };
    let meta = ChartMeta { wavelengths_nm: nm.to_vec(), pitch_um: Some(2.0), ..ChartMeta::default() };
    write_chart(path, &picture, &meta, Codec::Zstd, 1, &|_, _| ()).unwrap();
    path.into()
}

/// Largest differences of the films of a band of 10 nm at 410 nm, for each of `samples`, from the mean of its ten bands of 1 nm; `flags` place the film.
fn differences(dir: &Path, lens: &str, flags: &[&str], samples: &[&str]) -> Vec<f64> {
    let film = |name: &str, chart: &Path, more: &[&str]| {
        let film = dir.join(name);
        run(text(chart), &film, lens, &[flags, more].concat()).ok();
        pixels(&film, "film").1
    };
    let nm: Vec<f64> = (0..10).map(|i| 405.5 + f64::from(i)).collect();
    let narrow = film("narrow", &chart(&dir.join("narrow.zarr"), &nm), &[]);
    let mean = |i: usize| narrow.iter().map(|band| band[i]).sum::<f32>() / 10.0;
    let mean = [(0..narrow[0].len()).map(mean).collect()];
    let wide = chart(&dir.join("wide.zarr"), &[400.0, 410.0, 420.0]);
    let difference = |n: &&str| {
        let found = film(n, &wide, &["--bands", "410", "--band-samples", n]);
        pairs(&found, &mean).map(|(a, b)| f64::from((a - b).abs())).fold(0.0, f64::max)
    };
    samples.iter().map(difference).collect()
}

/// The triplet on its axis, where the focus moves within the band.
#[test]
fn a_band_of_10_nm_is_the_mean_of_its_wavelengths() {
    let dir = tempfile::tempdir().unwrap();
    let film = ["--film-size", "64", "--film-pitch-um", "2"];
    let found = differences(dir.path(), "triplet", &film, &["1", "2", "4"]);
    println!("largest difference from the mean of ten bands of 1 nm, of white: {found:?}");
    assert!(found[0] > 0.01 && found[1] < found[0] / 3.0 && found[2] < found[0] / 20.0, "{found:?}");
    // One wavelength is the film without the flag; another number another film.
    let (wide, plain) = (dir.path().join("wide.zarr"), dir.path().join("plain"));
    run(text(&wide), &plain, "triplet", &[&film[..], &["--bands", "410"]].concat()).ok();
    assert_eq!(files(&plain), files(&dir.path().join("1")));
    let other = run(
        text(&wide),
        &plain,
        "triplet",
        &[&film[..], &["--bands", "410", "--band-samples", "2"]].concat(),
    );
    assert_error_line(&other, 3, &["--band-samples (film nothing", "\"count\":2"]);
}

/// A Double Gauss off its axis, where wavelengths also land at different places; 20 core seconds of tracing.
#[test]
#[ignore = "long: scripts/check-long"]
fn a_band_off_the_axis_is_the_mean_of_its_wavelengths() {
    let dir = tempfile::tempdir().unwrap();
    let found = differences(dir.path(), "double-gauss-28", &PLACE, &["1", "2", "8"]);
    println!("largest difference from the mean of ten bands of 1 nm, of white: {found:?}");
    assert!(found[0] > 5e-3 && found[1] < found[0] / 3.0 && found[2] < found[0] / 50.0, "{found:?}");
}

#[test]
fn bands_without_a_width_packs_and_distances_are_usage_errors() {
    let dir = tempfile::tempdir().unwrap();
    let single = chart(&dir.path().join("single.zarr"), &[550.0]);
    let pack = dir.path().join("pack.lens.zarr");
    let lens = lens(vec![identity_band(550.0, 1.0, 9)]);
    write_pack(&pack, &lens, vec![delta(&lens.bands[0])]);
    let film = dir.path().join("film");
    for (lens, flags, words) in [
        (LENS, &["--band-samples", "4"][..], "`--band-samples 4,width=10`"),
        (LENS, &["--band-samples", "17"], "N from 1 to 16"),
        (LENS, &["--band-samples", "0"], "N from 1 to 16"),
        (LENS, &["--band-samples", "4,wide=10"], "expected N[,width=NM]"),
        (LENS, &["--band-samples", "4,width=-10"], "the width of a band"),
        (LENS, &["--band-samples", "4,width=1e4"], "narrower width=NM"),
        (LENS, &["--band-samples", "4,width=10", "--depth", "2", "--focus-m", "2"], "--depth none"),
        (text(&pack), &["--band-samples", "4,width=10"], "--band-samples: expected a design"),
    ] {
        let found = run(text(&single), &film, lens, flags);
        assert_eq!(found.code, 2, "{flags:?}: {}", found.stderr);
        assert!(found.stderr.contains(words), "{flags:?}: {}", found.stderr);
        assert!(!film.exists(), "{flags:?}");
    }
    run(text(&single), &film, text(&pack), &["--film-size", "64", "--band-samples", "1"]).ok();
}
