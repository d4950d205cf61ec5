//! `lenscube restore`.

use crate::common::{
    CommandResult, Noise, assert_error_line, assert_exit, lenscube, pairs, pixels, run, shards, text,
};
use formats::film::FilmStore;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A pack of PSFs at 450, 500, 550 … 650 nm.
const LENS: &str = "double-gauss-28-npz";
/// RMS noise of films, whose white is 0.0038.
const NOISE: f32 = 1e-5;

/// A folder with a chart, its film away from the axis, and that film with noise.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new(size: usize) -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        let size = size.to_string();
        let chart = folder.at("chart.zarr");
        lenscube(&[
            "chart",
            "composite",
            text(&chart),
            "--size",
            &size,
            "--overscan",
            "0",
            "--wavelengths",
            "550",
            "--pitch-um",
            "2",
        ])
        .ok();
        // 2.8 mm left of the axis and 1.8 mm above it, where PSFs are not round; chart pixels are those of the film's grid.
        run(
            text(&chart),
            &folder.at("clean.zarr"),
            LENS,
            &["--axis=1500,1000", "--center=-2.801,-1.801", "--film-size", &size],
        )
        .ok();
        add_noise(&folder.at("clean.zarr"), &folder.at("film.zarr"));
        folder
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn restore(&self, film: &str, out: &str, flags: &[&str]) -> CommandResult {
        lenscube(&[&["restore", text(&self.at(film)), text(&self.at(out))], flags].concat())
    }
}

/// Copies a film, with noise on its pixels.
fn add_noise(from: &Path, to: &Path) {
    let clean = FilmStore::open(from, false).unwrap();
    let (_, mut bands) = pixels(from, "film");
    let mut noise = Noise(11);
    for value in bands.iter_mut().flatten() {
        let sum: f32 = (0..12).map(|_| noise.next()).sum();
        *value += NOISE * (sum - 6.0);
    }
    let noisy = FilmStore::create(to, clean.spec().clone(), clean.provenance().clone(), false).unwrap();
    for (output, band, shard) in clean.all_shards() {
        let encoded = noisy.encode_shard(output, band, shard, &bands[band]).unwrap();
        noisy.commit(&encoded).unwrap();
    }
}

/// Root of the mean square difference over all bands, without `border` px at each side.
fn rms(a: &Path, b: &Path, arrays: [&str; 2], border: usize) -> f64 {
    let ((size, a), (_, b)) = (pixels(a, arrays[0]), pixels(b, arrays[1]));
    let inside = |n: usize, side: usize| (border..side - border).contains(&n);
    let (mut sum, mut count) = (0.0, 0);
    for (i, (a, b)) in pairs(&a, &b).enumerate() {
        let (y, x) = (i % size.pixels() / size.width, i % size.width);
        if inside(y, size.height) && inside(x, size.width) {
            sum += f64::from(a - b).powi(2);
            count += 1;
        }
    }
    (sum / f64::from(count)).sqrt()
}

#[test]
fn restored_films_are_closer_to_their_chart_and_do_not_depend_on_tiles() {
    let folder = Folder::new(200);
    let reference = folder.at("chart.zarr");
    let noise = NOISE.to_string();
    let report = folder.restore("film.zarr", "one.zarr", &["--noise", &noise, "--json"]).ok();
    let report: Value = serde_json::from_str(&report.stdout).unwrap();
    let band = &report["bands"][0];
    let figure = |place: &str, name: &str| band[place][name].as_f64().unwrap();
    let residual = band["mean_square_residual_of_noise"].as_f64().unwrap();
    assert!((residual - 1.0).abs() < 0.1 && report["unconverged_tiles"] == 0, "{report}");
    for place in ["center", "corner"] {
        assert!(figure(place, "mtf50_restored_cy_px") > 1.2 * figure(place, "mtf50_film_cy_px"), "{report}");
        assert!((0.3..20.0).contains(&figure(place, "noise_gain")), "{report}");
    }
    let [film, restored] = [("film.zarr", "film"), ("one.zarr", "chart")]
        .map(|(name, array)| rms(&folder.at(name), &reference, [array, "chart"], 0));
    assert!(restored < 0.8 * film, "film {film}, restored {restored}");

    // Sixteen tiles: seams below 1e-4 of the peak.
    folder.restore("film.zarr", "many.zarr", &["--noise", &noise, "--tile", "64"]).ok();
    let [(_, one), (_, many)] = ["one.zarr", "many.zarr"].map(|name| pixels(&folder.at(name), "chart"));
    let peak = one[0].iter().fold(0.0f32, |m, v| m.max(*v));
    let largest = pairs(&one, &many).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(largest < 1e-4 * peak, "{} of the peak", largest / peak);

    // A part has its size; the estimated noise includes some of the finest detail of this chart.
    let part = folder.restore("film.zarr", "part.zarr", &["--roi", "40,60,100,50", "--json"]).ok();
    let part: Value = serde_json::from_str(&part.stdout).unwrap();
    let estimated = part["bands"][0]["noise"].as_f64().unwrap();
    assert!((0.95..1.3).contains(&(estimated / f64::from(NOISE))), "{estimated}");
    assert_eq!(pixels(&folder.at("part.zarr"), "chart").0, pipeline::geometry::Size::new(50, 100));

    // Photons: not negative, and closer as well, if slowly: white surroundings need many steps.
    let flags = ["--method", "richardson-lucy", "--noise", &noise, "--iterations", "15"];
    folder.restore("film.zarr", "rl.zarr", &flags).ok();
    assert!(pixels(&folder.at("rl.zarr"), "chart").1[0].iter().all(|v| *v >= 0.0));
    let by_steps = rms(&folder.at("rl.zarr"), &reference, ["chart", "chart"], 0);
    assert!(by_steps < 0.95 * film, "film {film}, restored {by_steps}");
}

/// Its distortion moves pixels by more than one here; its film has the layer of tails.
#[test]
fn the_film_of_a_design_is_restored_with_the_lens_that_it_records() {
    let folder = Folder(tempfile::tempdir().unwrap());
    let (chart, film) = (folder.at("chart.zarr"), folder.at("phone.zarr"));
    let words = ["chart", "composite", text(&chart), "--size=96", "--overscan=0", "--pitch-um=2"];
    lenscube(&[&words[..], &["--wavelengths=550:600:50"]].concat()).ok();
    run(text(&chart), &film, "phone", &["--axis=-400,-300", "--center=0.895,0.695"]).ok();
    assert!(film.join("veil_tail").is_dir());
    folder.restore("phone.zarr", "out.zarr", &["--noise", "2e-6"]).ok();
    let before = rms(&film, &chart, ["film", "chart"], 8);
    let after = rms(&folder.at("out.zarr"), &chart, ["chart", "chart"], 8);
    assert!(after < 0.4 * before, "film {before}, restored {after}");
    // The noise gain does not depend on the film's unit.
    let irradiance = folder.at("irradiance.zarr");
    run(
        text(&chart),
        &irradiance,
        "phone",
        &["--axis=-400,-300", "--center=0.895,0.695", "--film-units=irradiance"],
    )
    .ok();
    let per_value = pixels(&irradiance, "film").1[0][0] / pixels(&film, "film").1[0][0];
    let gain = |name: &str, out: &str, noise: f32| -> f64 {
        let flags = ["--noise", &noise.to_string(), "--bands=550", "--json"];
        let report: Value = serde_json::from_str(&folder.restore(name, out, &flags).ok().stdout).unwrap();
        report["bands"][0]["center"]["noise_gain"].as_f64().unwrap()
    };
    let gains = [gain("phone.zarr", "a.zarr", 2e-5), gain("irradiance.zarr", "b.zarr", 2e-5 * per_value)];
    assert!(
        (gains[1] / gains[0] - 1.0).abs() < 0.01 && !(0.8..1.2).contains(&per_value),
        "{gains:?} {per_value}"
    );
    // A band alone has the pixels that it has among others.
    folder.restore("phone.zarr", "one.zarr", &["--noise", "2e-6", "--bands", "550"]).ok();
    let [(_, all), (_, one)] = ["out.zarr", "one.zarr"].map(|name| pixels(&folder.at(name), "chart"));
    assert!(all.len() == 2 && one[..] == all[..1]);
}

#[test]
fn films_that_cannot_be_restored_are_refused() {
    let folder = Folder::new(64);
    let refused = |film: &str, out: &str, flags: &[&str], code: i32, texts: &[&str]| {
        assert_error_line(&folder.restore(film, out, flags), code, texts);
        assert!(out != "out.zarr" || !folder.at(out).exists());
    };
    refused("film.zarr", "film.zarr", &[], 2, &["film"]);
    refused("no.zarr", "out.zarr", &[], 1, &["no.zarr"]);
    refused("film.zarr", "out.zarr", &["--iterations", "3"], 2, &["richardson-lucy"]);
    refused("film.zarr", "out.zarr", &["--bands", "700"], 2, &["--bands"]);
    refused("film.zarr", "out.zarr", &["--roi", "60,0,10,10"], 2, &["--roi", "64x64"]);
    refused("film.zarr", "out.zarr", &["--lens", "no.zmx"], 2, &["no.zmx"]);
    refused("film.zarr", "out.zarr", &["--lens", "double-gauss-28"], 2, &["not the one that made the film"]);
    fs::create_dir(folder.at("other")).unwrap();
    refused("film.zarr", "other", &[], 3, &["--overwrite"]);
    assert_exit(
        &folder.restore("film.zarr", "other", &["--overwrite"]),
        3,
        &["no Zarr group with an array `chart`"],
    );

    // Regions; veiling glare; a lens that is not recorded; a shard that is missing, and one that is damaged.
    let chart = folder.at("chart.zarr");
    run(text(&chart), &folder.at("roi.zarr"), LENS, &["--roi=3,5,40,30"]).ok();
    refused("roi.zarr", "out.zarr", &[], 2, &["regions only", "--roi"]);
    run(text(&chart), &folder.at("veil.zarr"), LENS, &["--veiling-glare=0.03"]).ok();
    refused("veil.zarr", "out.zarr", &[], 2, &["--veiling-glare"]);
    let film = folder.at("film.zarr");
    let shard = film.join(shards(&film).remove(0));
    let bytes = fs::read(&shard).unwrap();
    let mut damaged = bytes.clone();
    damaged[100] ^= 255;
    fs::write(&shard, damaged).unwrap();
    refused("film.zarr", "out.zarr", &[], 1, &["checksum"]);
    fs::remove_file(&shard).unwrap();
    refused("film.zarr", "out.zarr", &[], 4, &["1 of 1 shards are missing", "lenscube run"]);
}

#[test]
fn films_of_surfaces_at_several_distances_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (film, out) = (folder.path().join("film.zarr"), folder.path().join("out.zarr"));
    let scene = "gen:depth-scene?size=60x48&overscan=0&near_m=0.3&far_m=0.5&wavelengths=550";
    run(scene, &film, "phone", &["--focus-m=0.4", "--depth-tolerance=0.1"]).ok();
    let result = lenscube(&["restore", text(&film), text(&out)]);
    assert_error_line(&result, 2, &["several distances", "--depth none"]);
}

#[test]
fn a_killed_run_leaves_nothing_at_its_path_and_is_repeated() {
    let folder = Folder::new(64);
    let killed = Command::new(env!("CARGO_BIN_EXE_lenscube"))
        .args(["restore", text(&folder.at("film.zarr")), text(&folder.at("out.zarr"))])
        .env("LENSCUBE_FAULT", "rename:1:kill")
        .output()
        .unwrap();
    assert_eq!(CommandResult::new(&killed).code, -1, "{killed:?}");
    assert!(!folder.at("out.zarr").exists());
    folder.restore("film.zarr", "out.zarr", &[]).ok();
    folder.restore("film.zarr", "again.zarr", &["--threads", "1"]).ok();
    let files = |name: &str| crate::common::files(&folder.at(name));
    assert!(files("out.zarr") == files("again.zarr"), "the bytes do not depend on threads");
    assert_error_line(&folder.restore("film.zarr", "out.zarr", &[]), 3, &["--overwrite"]);
    folder.restore("film.zarr", "out.zarr", &["--overwrite"]).ok();
    let left: Vec<_> =
        fs::read_dir(folder.0.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(left.len(), 5, "{left:?}");
}
