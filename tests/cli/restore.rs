//! `lenscube restore`.

use crate::common::{
    CommandResult, Noise, assert_error_line, assert_exit, lenscube, pairs, pixels, run, shards, text,
};
use formats::film::FilmStore;
use formats::raw::RawStore;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A pack of PSFs at 450, 500, 550 … 650 nm.
const LENS: &str = "double-gauss-28-npz";
/// RMS noise of films, whose white is 0.0038.
const NOISE: f32 = 1e-5;

/// A folder with a chart, its film away from the axis, and that film with noise; flags of such films.
struct Folder(tempfile::TempDir, Vec<String>);

impl Folder {
    fn new(size: usize) -> Self {
        Self::of("composite", size)
    }

    fn of(kind: &str, size: usize) -> Self {
        let size = size.to_string();
        let center = |axis: f64| ((size.parse::<f64>().unwrap() - 1.0) / 2.0 - axis) * 2e-3;
        let center = format!("--center={:.4},{:.4}", center(1500.0), center(1000.0));
        let flags = vec!["--axis=1500,1000".into(), center, format!("--film-size={size}")];
        let folder = Self(tempfile::tempdir().unwrap(), flags);
        let chart = folder.at("chart.zarr");
        lenscube(&[
            "chart",
            kind,
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
        folder.run("chart.zarr", "clean.zarr");
        add_noise(&folder.at("clean.zarr"), &folder.at("film.zarr"), 11);
        folder
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// The film of a chart 2.8 mm left of the axis and 1.8 mm above it, where PSFs are not round; chart pixels are those of the film's grid.
    fn run(&self, chart: &str, film: &str) {
        let flags: Vec<&str> = self.1.iter().map(String::as_str).collect();
        run(text(&self.at(chart)), &self.at(film), LENS, &flags).ok();
    }

    fn restore(&self, film: &str, out: &str, flags: &[&str]) -> CommandResult {
        lenscube(&[&["restore", text(&self.at(film)), text(&self.at(out))], flags].concat())
    }
}

/// Copies a film, with noise on its pixels.
fn add_noise(from: &Path, to: &Path, seed: u64) {
    let clean = FilmStore::open(from, false).unwrap();
    let (_, mut bands) = pixels(from, "film");
    let mut noise = Noise(seed);
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
        assert!((0.0..0.2).contains(&figure(place, "edge_overshoot")), "{report}");
    }
    let [film, restored] = [("film.zarr", "film"), ("one.zarr", "chart")]
        .map(|(name, array)| rms(&folder.at(name), &reference, [array, "chart"], 0));
    assert!(restored < 0.8 * film, "film {film}, restored {restored}");

    // Beside a film of the same light with noise that it has not seen, the film of the restored chart differs by that noise and its own error, independently: nothing of the second noise is in it.
    add_noise(&folder.at("clean.zarr"), &folder.at("held-out.zarr"), 29);
    folder.run("one.zarr", "again.zarr");
    let [fitted, held_out, error] = ["film.zarr", "held-out.zarr", "clean.zarr"]
        .map(|name| rms(&folder.at("again.zarr"), &folder.at(name), ["film", "film"], 40) / f64::from(NOISE));
    assert!((fitted - 1.0).abs() < 0.1 && error < 1.2, "{fitted} {error}");
    assert!((held_out * held_out - error * error - 1.0).abs() < 0.1, "{held_out} {error}");

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
    folder.restore("film.zarr", "many-rl.zarr", &[&flags[..], &["--tile", "64"]].concat()).ok();
    let [(_, whole), (_, tiled)] = ["rl.zarr", "many-rl.zarr"].map(|name| pixels(&folder.at(name), "chart"));
    let largest = pairs(&whole, &tiled).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(largest < 1e-4 * peak, "{} of the peak", largest / peak);
    assert!(pixels(&folder.at("rl.zarr"), "chart").1[0].iter().all(|v| *v >= 0.0));
    let by_steps = rms(&folder.at("rl.zarr"), &reference, ["chart", "chart"], 0);
    assert!(by_steps < 0.95 * film, "film {film}, restored {by_steps}");
}

/// Its distortion moves pixels by more than one here; its film has the layer of tails.
#[test]
fn the_film_of_a_design_is_restored_with_the_lens_that_it_records() {
    let folder = Folder(tempfile::tempdir().unwrap(), Vec::new());
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

/// Closer to the chart than differences of neighbours; the residual is that of the noise; other tiles change a pixel by less than 1e-4 of the peak.
#[test]
#[ignore = "long: 80 s"]
fn total_variation_restores_plateaus() {
    let folder = Folder::of("dead-leaves", 112);
    let (reference, noise) = (folder.at("chart.zarr"), NOISE.to_string());
    let restored = |out: &str, flags: &[&str]| {
        let flags = [&["--noise", &noise, "--json"], flags].concat();
        let report = report(&folder.restore("film.zarr", out, &flags).ok());
        (report, rms(&folder.at(out), &reference, ["chart", "chart"], 8))
    };
    let (_, smooth) = restored("smooth.zarr", &[]);
    let method = ["--method", "total-variation"];
    let (report, plateaus) = restored("one.zarr", &method);
    assert!(plateaus < 0.85 * smooth, "{smooth}, total variation {plateaus}");
    let residual = report["bands"][0]["mean_square_residual_of_noise"].as_f64().unwrap();
    assert!((residual - 1.0).abs() < 0.1 && report["unconverged_tiles"] == 0, "{report}");
    assert!(report["bands"][0]["mu"].as_f64().unwrap() > 0.0, "{report}");
    let of_tiles = ["--noise", &noise, "--tile", "64", "--roi", "24,0,64,112"];
    folder.restore("film.zarr", "many.zarr", &[&method[..], &of_tiles].concat()).ok();
    let [(size, one), (_, many)] = ["one.zarr", "many.zarr"].map(|name| pixels(&folder.at(name), "chart"));
    let peak = one[0].iter().fold(0.0f32, |m, v| m.max(*v));
    let part: Vec<f32> = one[0].chunks(size.width).flat_map(|row| &row[24..88]).copied().collect();
    let largest = part.iter().zip(&many[0]).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(largest < 1e-4 * peak, "{} of the peak", largest / peak);
}

/// A raw of the film of `chart` by a sensor with pixels of 2 um.
fn expose(film: &Path, raw: &Path, sensor: &str, flags: &[&str]) {
    let words = ["sensor", text(film), text(raw), "--sensor", sensor, "--set", "pixel.pitch_um=2"];
    lenscube(&[&words[..], flags].concat()).ok();
}

fn report(result: &CommandResult) -> Value {
    serde_json::from_str(&result.stdout).unwrap()
}

/// Of a sensor without a mosaic, and of a Bayer sensor: the residual is the noise that the sensor has by its description, and the chart the mean of the bands.
#[test]
fn raws_are_restored_by_the_noise_of_their_sensor() {
    let folder = Folder(tempfile::tempdir().unwrap(), Vec::new());
    let (chart, film) = (folder.at("chart.zarr"), folder.at("film.zarr"));
    let words = ["chart", "composite", text(&chart), "--size=128", "--overscan=0", "--pitch-um=2"];
    lenscube(&[&words[..], &["--wavelengths=500:600:100"]].concat()).ok();
    run(text(&chart), &film, LENS, &["--axis=1500,1000", "--center=-2.873,-1.873", "--film-size=128"]).ok();
    let (size, bands) = pixels(&chart, "chart");
    let inside = |i: usize| [i / size.width, i % size.width].iter().all(|k| (8..120).contains(k));
    let rms = |a: &[f32], b: &[f32]| {
        let (sum, count) = (0..a.len())
            .filter(|i| inside(*i))
            .fold((0.0, 0), |(sum, n), i| (sum + f64::from(a[i] - b[i]).powi(2), n + 1));
        (sum / f64::from(count)).sqrt()
    };
    let (_, film_bands) = pixels(&film, "film");
    // (sensor, exposure, planes, greatest rms over that of the film)
    for (sensor, exposure, planes, share) in
        [("ideal-mono", "auto:0.9", 1, 0.6), ("example-2um", "auto:0.9", 3, 0.97)]
    {
        let raw = folder.at(&format!("{sensor}.zarr"));
        expose(&film, &raw, sensor, &["--exposure", exposure, "--size=128", "--center=-2.873,-1.873"]);
        let out = format!("of-{sensor}.zarr");
        let flags = ["--film", text(&film), "--json"];
        let report = report(&folder.restore(&format!("{sensor}.zarr"), &out, &flags).ok());
        let restored = pixels(&folder.at(&out), "chart").1;
        assert_eq!(restored.len(), planes);
        for (plane, values) in report["bands"].as_array().unwrap().iter().zip(&restored) {
            let residual = plane["mean_square_residual_of_noise"].as_f64().unwrap();
            assert!((residual - 1.0).abs() < 0.1 && plane["noise_is_estimated"] == false, "{plane}");
            let shares: Vec<f64> =
                plane["film_bands"].as_array().unwrap().iter().map(|b| b[1].as_f64().unwrap()).collect();
            assert!((shares.iter().sum::<f64>() - 1.0).abs() < 1e-9 && shares.len() <= 2, "{plane}");
            let of = |bands: &[Vec<f32>]| -> Vec<f32> {
                let at = |nm: f64| ((nm - 500.0) / 100.0) as usize;
                let share = |i: usize| -> f64 {
                    let all = plane["film_bands"].as_array().unwrap().iter();
                    all.map(|b| b[1].as_f64().unwrap() * f64::from(bands[at(b[0].as_f64().unwrap())][i]))
                        .sum()
                };
                (0..bands[0].len()).map(|i| share(i) as f32).collect()
            };
            let (expected, film) = (of(&bands), of(&film_bands));
            let (before, after) = (rms(&film, &expected), rms(values, &expected));
            assert!(after < share * before, "{sensor} {plane}: film {before}, restored {after}");
            let mean = |v: &[f32]| v.iter().map(|v| f64::from(*v)).sum::<f64>() / v.len() as f64;
            assert!((mean(values) / mean(&expected) - 1.0).abs() < 0.02, "{sensor} {plane}");
        }
    }
    // Sixteen tiles differ by less than 1e-4 of the peak; steps of photons are not negative.
    let flags = ["--film", text(&film), "--bands", "#0"];
    let many = [&flags[..], &["--tile", "64"]].concat();
    folder.restore("ideal-mono.zarr", "many.zarr", &many).ok();
    let [(_, one), (_, many)] =
        ["of-ideal-mono.zarr", "many.zarr"].map(|name| pixels(&folder.at(name), "chart"));
    let peak = one[0].iter().fold(0.0f32, |m, v| m.max(*v));
    let largest = pairs(&one, &many).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(largest < 1e-4 * peak, "{} of the peak", largest / peak);
    let steps = [&flags[..], &["--method", "richardson-lucy", "--iterations", "10"]].concat();
    folder.restore("example-2um.zarr", "steps.zarr", &steps).ok();
    assert!(pixels(&folder.at("steps.zarr"), "chart").1[0].iter().all(|v| *v >= 0.0));
}

/// Of pixels that are twice the film's, every 23rd at white.
#[test]
#[ignore = "long: 55 s"]
fn saturated_pixels_of_a_raw_are_left_out() {
    let folder = Folder(tempfile::tempdir().unwrap(), Vec::new());
    let (chart, film) = (folder.at("chart.zarr"), folder.at("film.zarr"));
    let words = ["chart", "composite", text(&chart), "--size=256", "--overscan=0", "--pitch-um=1"];
    lenscube(&[&words[..], &["--wavelengths=550"]].concat()).ok();
    let place = ["--axis=127.5,127.5", "--center=0,0", "--film-size=256", "--film-pitch-um=1"];
    run(text(&chart), &film, LENS, &place).ok();
    expose(&film, &folder.at("raw.zarr"), "ideal-mono", &["--exposure=auto:0.8"]);
    let raw = RawStore::open(&folder.at("raw.zarr"), false).unwrap();
    let white = raw.attributes()["white_dn"].as_f64().unwrap() as u16;
    let (size, frames) = pixels(&folder.at("raw.zarr"), "raw");
    let mut numbers: Vec<u16> = frames[0].iter().map(|v| *v as u16).collect();
    numbers.iter_mut().step_by(23).for_each(|dn| *dn = white);
    let damaged =
        RawStore::create(&folder.at("white.zarr"), raw.spec().clone(), raw.attributes().clone(), false)
            .unwrap();
    let shards = raw.spec().all_shards();
    assert_eq!((shards.len(), size.pixels()), (1, 128 * 128));
    damaged.commit_counts(shards[0], &numbers).unwrap();
    let [(_, all), (_, without)] = ["raw.zarr", "white.zarr"].map(|raw| {
        let out = format!("of-{raw}");
        let flags = ["--film", text(&film), "--json"];
        let report = report(&folder.restore(raw, &out, &flags).ok());
        let residual = report["bands"][0]["mean_square_residual_of_noise"].as_f64().unwrap();
        assert!((residual - 1.0).abs() < 0.1, "{report}");
        pixels(&folder.at(&out), "chart")
    });
    let peak = all[0].iter().fold(0.0f32, |m, v| m.max(*v));
    let square: f32 = pairs(&all, &without).map(|(a, b)| (a - b) * (a - b)).sum();
    let rms = (square / all[0].len() as f32).sqrt();
    assert!(rms < 0.03 * peak, "{rms} of {peak}");
}

#[test]
fn raws_that_cannot_be_restored_are_refused() {
    let folder = Folder::new(64);
    let film = folder.at("film.zarr");
    expose(
        &folder.at("clean.zarr"),
        &folder.at("raw.zarr"),
        "ideal-mono",
        &["--exposure=auto", "--size=64", "--center=-2.937,-1.937"],
    );
    expose(
        &folder.at("clean.zarr"),
        &folder.at("roi.zarr"),
        "ideal-mono",
        &["--exposure=1s", "--roi=0,0,32,32", "--size=64", "--center=-2.937,-1.937"],
    );
    let refused = |raw: &str, flags: &[&str], texts: &[&str]| {
        assert_error_line(&folder.restore(raw, "out.zarr", flags), 2, texts);
        assert!(!folder.at("out.zarr").exists());
    };
    let clean = folder.at("clean.zarr");
    refused("raw.zarr", &[], &["is a raw", "--film"]);
    refused("film.zarr", &["--film", text(&film)], &["--film", "raws"]);
    refused("film.zarr", &["--frame", "1"], &["--frame", "raws"]);
    refused("raw.zarr", &["--film", text(&clean), "--noise", "1"], &["--noise", "sensor"]);
    refused("raw.zarr", &["--film", text(&clean), "--frame", "3"], &["--frame 3", "1 frame"]);
    refused("roi.zarr", &["--film", text(&clean)], &["region", "--roi"]);
    let other = folder.at("other.zarr");
    run(text(&folder.at("chart.zarr")), &other, LENS, &["--film-size=64"]).ok();
    refused("raw.zarr", &["--film", text(&other)], &["not made of film", "--film"]);
    assert_error_line(
        &folder.restore("raw.zarr", "raw.zarr", &["--film", text(&clean), "--overwrite"]),
        2,
        &["raw.zarr"],
    );
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
