//! `lenscube sensor` from outside: films to raws.

mod common;

use common::{CommandResult, Noise, assert_exit, files, lenscube, text};
use formats::chart::{ChartOptions, ChartStore};
use formats::film::{FilmSpec, FilmStore};
use formats::sensor::SensorFile;
use pipeline::geometry::{Rect, Size};
use pipeline::sensor::noise::Exposer;
use pipeline::sensor::{Exposure, HC_J_M, NoiseSet};
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};
use std::process::Command;

const USAGE: i32 = 2;
const OTHER_JOB: i32 = 3;
const WRONG: i32 = 4;
const IRRADIANCE: &str = "W m-2 nm-1";

struct Place(tempfile::TempDir);

impl Place {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// A film of pixels `value(band, row, column)`.
    fn film(
        &self,
        size: Size,
        nm: &[f64],
        units: &str,
        value: impl FnMut(usize, usize, usize) -> f32,
    ) -> PathBuf {
        let path = self.at("film.zarr");
        write_film(&path, size, nm, (2.0, units), value);
        path
    }

    /// Noise in three bands, W m⁻² nm⁻¹.
    fn noise(&self, size: Size) -> PathBuf {
        let mut noise = Noise(5);
        self.film(size, &[450.0, 550.0, 650.0], IRRADIANCE, |_, _, _| 1e-3 * noise.next())
    }
}

fn write_film(
    path: &Path,
    size: Size,
    nm: &[f64],
    (pitch_um, units): (f64, &str),
    mut value: impl FnMut(usize, usize, usize) -> f32,
) {
    let spec = FilmSpec {
        units: units.into(),
        shard: 512,
        chunk: 64,
        ..FilmSpec::full_film(size, nm.to_vec(), pitch_um)
    };
    let Value::Object(provenance) = json!({"job_digest": "a", "layout_digest": "b", "engine": "portable"})
    else {
        unreachable!()
    };
    let film = FilmStore::create(path, spec, provenance, false).unwrap();
    let all: Vec<Vec<f32>> = (0..nm.len())
        .map(|b| (0..size.pixels()).map(|k| value(b, k / size.width, k % size.width)).collect())
        .collect();
    for (output, band, shard) in film.all_shards().collect::<Vec<_>>() {
        let rect = film.shard_rect(output, shard);
        let rows = rect.y as usize..rect.bottom() as usize;
        let pixels: Vec<f32> =
            rows.flat_map(|y| all[band][y * size.width + rect.x as usize..][..rect.width].to_vec()).collect();
        film.commit(&film.encode_shard(output, band, shard, &pixels).unwrap()).unwrap();
    }
}

fn command(film: &Path, raw: &Path, flags: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
    command.args(["sensor", text(film), text(raw), "--no-fsync"]).args(flags);
    command
}

fn sensor(film: &Path, raw: &Path, flags: &[&str]) -> CommandResult {
    CommandResult::new(&command(film, raw, flags).output().unwrap())
}

/// Frame `frame` of array `array`.
fn frame(raw: &Path, array: &str, frame: usize) -> (Size, Vec<u16>) {
    let group: Value =
        serde_json::from_slice(&std::fs::read(raw.join(array).join("zarr.json")).unwrap()).unwrap();
    let frames = group["shape"][0].as_u64().unwrap();
    let options = ChartOptions {
        wavelengths_nm: Some((1..=frames).map(|f| f as f64).collect()),
        ..ChartOptions::default()
    };
    let store = ChartStore::open_at(raw, array, options).unwrap();
    let size = store.size();
    let mut pixels = vec![0.0; size.pixels()];
    store.read_rect(frame, size.rect(), &mut pixels).unwrap();
    (size, pixels.iter().map(|v| *v as u16).collect())
}

fn attributes(raw: &Path) -> Map<String, Value> {
    let group: Value = serde_json::from_slice(&std::fs::read(raw.join("zarr.json")).unwrap()).unwrap();
    group["attributes"].as_object().unwrap().clone()
}

fn window(size: Size, pixels: &[u16], w: Rect) -> Vec<u16> {
    (w.y as usize..w.bottom() as usize)
        .flat_map(|y| pixels[y * size.width + w.x as usize..][..w.width].to_vec())
        .collect()
}

#[test]
fn uniform_film_through_ideal_mono_counts_photons() {
    let place = Place::new();
    let film = place.film(Size::new(70, 90), &[540.0, 550.0, 560.0], IRRADIANCE, |_, _, _| 2e-2);
    let raw = place.at("raw.zarr");
    sensor(&film, &raw, &["--sensor", "ideal-mono", "--exposure", "1/50s", "--noise", "none"]).ok();
    let (size, pixels) = frame(&raw, "raw", 0);
    assert_eq!(size, Size::new(70, 90));
    // ∫ λ/(hc) dλ from 535 to 565 nm, on (2 µm)², for 20 ms.
    let photons = 2e-2 * (565e-9f64.powi(2) - 535e-9f64.powi(2)) / 2.0 / HC_J_M * 1e9 * 4e-12 * 0.02;
    let mean = pixels.iter().map(|v| f64::from(*v)).sum::<f64>() / size.pixels() as f64;
    assert!((mean - 1024.0 - 0.0625 * photons).abs() <= 0.5, "{mean}, {photons} photons");
}

/// Units of the film: the same light as irradiance, photons and radiance.
#[test]
fn units_of_the_film_stand_for_the_same_light() {
    let nm = [500.0, 600.0];
    let place = Place::new();
    let raw_of = |name: &str, units: &str, factor: &dyn Fn(usize) -> f64, flags: &[&str]| {
        let (film, raw) = (place.at(&format!("{name}.film")), place.at(&format!("{name}.raw")));
        write_film(&film, Size::new(20, 20), &nm, (2.0, units), |b, y, x| {
            ((1 + y + x) as f64 * 1e-3 * factor(b)) as f32
        });
        let all = [&["--sensor", "example-2um", "--exposure", "10ms", "--noise", "none"][..], flags].concat();
        sensor(&film, &raw, &all).ok();
        frame(&raw, "raw", 0).1
    };
    let irradiance = raw_of("irradiance", IRRADIANCE, &|_| 1.0, &[]);
    let near = |other: Vec<u16>| std::iter::zip(&irradiance, other).all(|(a, b)| a.abs_diff(b) <= 1);
    assert!(near(raw_of("photons", "s-1 nm-1", &|b| nm[b] * 1e-9 / HC_J_M * 4e-12, &[])));
    let omega = 0.8 * std::f64::consts::PI / (4.0 * 2.8 * 2.8);
    let lens = ["--f-number", "2.8", "--transmission", "0.8"];
    assert!(near(raw_of("radiance", "W m-2 sr-1 nm-1", &|_| 1.0 / omega, &lens)));
    assert!(near(raw_of("relative", "relative", &|_| 10.0, &["--film-scale", "0.1"])));
    let film = place.at("radiance.film");
    assert_exit(
        &sensor(&film, &place.at("no"), &["--sensor", "example-2um", "--exposure", "1"]),
        USAGE,
        &["--f-number"],
    );
    let film = place.at("relative.film");
    let plain = sensor(&film, &place.at("no"), &["--sensor", "example-2um", "--exposure", "1"]);
    assert_exit(&plain, USAGE, &["--film-lux", "--film-scale", "--exposure auto"]);
    // 100 lx on the mean of the sensor: two films of other scales give one raw.
    let lux = ["--film-lux", "100"];
    let one = raw_of("lux-1", "relative", &|_| 1.0, &lux);
    let ten = raw_of("lux-10", "relative", &|_| 8.0, &lux);
    assert!(one == ten && one.iter().any(|v| *v > 300));
}

/// A film of the built-in charts needs nothing but a time.
#[test]
fn a_chart_of_radiance_is_exposed_without_another_word() {
    let place = Place::new();
    let (film, raw) = (place.at("film.zarr"), place.at("raw.zarr"));
    let chart = "gen:uniform?size=64&pitch_um=2&wavelengths=500,600";
    common::run(chart, &film, "double-gauss-28-npz", &["--stages", "ri"]).ok();
    let film_attributes = attributes(&film);
    let band = &film_attributes["provenance"]["bands"][0];
    assert!(band["solid_angle_sr"].as_f64().unwrap() > 0.0 && band["transmission"].as_f64().unwrap() > 0.0);
    sensor(&film, &raw, &["--sensor", "example-2um", "--exposure", "40ms"]).ok();
    assert!(frame(&raw, "raw", 0).1.iter().all(|v| *v > 300));
}

#[test]
fn windows_threads_and_memory_give_the_same_bits() {
    let place = Place::new();
    let film = place.noise(Size::new(300, 400));
    for (name, pitch) in [("cmv12000-rgb", "4.7"), ("example-2um", "2.0")] {
        let whole = place.at(&format!("{name}-whole"));
        let pitch = format!("pixel.pitch_um={pitch}");
        let flags = |more: &[&'static str]| -> Vec<String> {
            let own =
                ["--sensor", name, "--set", &pitch, "--exposure", "10ms,20ms", "--seed", "9", "--threads"];
            own.iter().chain(more).map(|w| (*w).to_string()).collect()
        };
        let run = |raw: &Path, more: &[&'static str]| {
            let flags = flags(more);
            sensor(&film, raw, &flags.iter().map(String::as_str).collect::<Vec<_>>()).ok()
        };
        run(&whole, &["2"]);
        let part = place.at(&format!("{name}-part"));
        run(&part, &["1", "--memory", "200MiB", "--roi", "31,17,60,50", "--roi", "0,0,5,7"]);
        for f in 0..2 {
            let (size, pixels) = frame(&whole, "raw", f);
            for (array, rect) in [("roi_0", Rect::new(17, 31, 50, 60)), ("roi_1", Rect::new(0, 0, 7, 5))] {
                assert!(frame(&part, array, f).1 == window(size, &pixels, rect), "{name} {array} frame {f}");
            }
        }
        let other = place.at(&format!("{name}-other"));
        run(&other, &["3"]);
        assert!(files(&other) == files(&whole));
    }
}

/// Killed at several places and resumed, with exposures that were given and found.
#[test]
fn a_killed_run_is_resumed_with_the_same_bytes() {
    let place = Place::new();
    let film = place.noise(Size::new(2200, 2100));
    for exposure in [&["--exposure", "5ms,50ms"][..], &["--exposure", "auto", "--keep-signal"]] {
        let flags = [&["--sensor", "example-2um"][..], exposure].concat();
        let whole = place.at("whole");
        sensor(&film, &whole, &flags).ok();
        let expected = files(&whole);
        std::fs::remove_dir_all(&whole).unwrap();
        let raw = place.at("raw");
        for fault in ["commit:2:kill", "write:2:kill", "commit:3:kill"] {
            let mut command = command(&film, &raw, &flags);
            assert!(!command.env("LENSCUBE_FAULT", fault).output().unwrap().status.success(), "{fault}");
        }
        assert_exit(&sensor(&film, &raw, &flags), 0, &["resuming"]);
        assert!(files(&raw) == expected);
        assert_exit(&sensor(&film, &raw, &flags), 0, &["nothing to do"]);
        assert_exit(
            &sensor(&film, &raw, &[&flags[..], &["--seed", "2"]].concat()),
            OTHER_JOB,
            &["another job", "seed"],
        );
        sensor(&film, &raw, &[&flags[..], &["--seed", "2", "--overwrite"]].concat()).ok();
        std::fs::remove_dir_all(&raw).unwrap();
    }
}

/// A damaged shard is found, removed and made again with the same bytes.
#[test]
fn status_and_verify_find_what_a_raw_lacks() {
    let place = Place::new();
    let film = place.noise(Size::new(100, 120));
    let raw = place.at("raw");
    let flags = ["--sensor", "example-2um", "--exposure", "1ms,2ms", "--keep-signal"];
    sensor(&film, &raw, &flags).ok();
    let whole = files(&raw);
    assert_exit(&lenscube(&["status", text(&raw), "--check"]), 0, &["complete", "3 of 3 shards", "2 frames"]);
    assert_exit(&lenscube(&["verify", text(&raw)]), 0, &["3 shards", "0 defects"]);
    std::fs::remove_file(raw.join("raw/c/0/0/0")).unwrap();
    let bad = raw.join("raw/c/1/0/0");
    let mut bytes = std::fs::read(&bad).unwrap();
    bytes[20] ^= 1;
    std::fs::write(&bad, bytes).unwrap();
    assert_exit(&lenscube(&["status", text(&raw), "--check"]), WRONG, &["incomplete", "missing raw/c/0/0/0"]);
    assert_exit(
        &lenscube(&["verify", text(&raw), "--repair"]),
        WRONG,
        &["missing raw/c/0/0/0", "bad raw/c/1/0/0", "1 bad shards removed"],
    );
    sensor(&film, &raw, &flags).ok();
    assert!(files(&raw) == whole);
}

#[test]
fn a_full_disk_is_worth_a_retry() {
    let place = Place::new();
    let film = place.noise(Size::new(100, 100));
    let raw = place.at("raw");
    let mut command = command(&film, &raw, &["--sensor", "example-2um", "--exposure", "1ms"]);
    let ran = CommandResult::new(&command.env("LENSCUBE_FAULT", "write:11+:28").output().unwrap());
    assert_exit(&ran, 75, &["No space left"]);
}

#[test]
fn a_kept_signal_gives_the_raw_of_the_film() {
    let place = Place::new();
    let film = place.noise(Size::new(200, 300));
    let (kept, direct, again) = (place.at("kept"), place.at("direct"), place.at("again"));
    let own = ["--sensor", "cmv12000-rgb"];
    sensor(&film, &kept, &[&own[..], &["--exposure", "10ms", "--keep-signal"]].concat()).ok();
    let second = ["--exposure", "3ms", "--gain", "2", "--seed", "4", "--frames", "2"];
    sensor(&film, &direct, &[&own[..], &second].concat()).ok();
    sensor(&kept, &again, &second).ok();
    assert!(files(&again) == files(&direct));
    let auto = place.at("auto");
    sensor(&kept, &auto, &["--exposure", "auto"]).ok();
    let from_film = place.at("auto-film");
    sensor(&film, &from_film, &[&own[..], &["--exposure", "auto"]].concat()).ok();
    assert!(files(&auto) == files(&from_film));
    assert_exit(
        &sensor(&kept, &place.at("no"), &["--exposure", "1", "--sensor", "sony-a7r2"]),
        USAGE,
        &["another sensor"],
    );
    assert_exit(&sensor(&direct, &place.at("no"), &["--exposure", "1"]), USAGE, &["--keep-signal"]);
}

/// 99.9 % of the pixels stay below 0.9 of saturation, and not by much.
#[test]
fn automatic_exposure_fills_the_well() {
    let place = Place::new();
    let film = place.noise(Size::new(300, 300));
    let raw = place.at("raw");
    assert_exit(
        &sensor(&film, &raw, &["--sensor", "example-2um", "--exposure", "auto", "--noise", "none"]),
        0,
        &["exposure "],
    );
    let a = attributes(&raw);
    let (black, white) = (a["black_dn"].as_f64().unwrap(), a["white_dn"].as_f64().unwrap());
    let mut pixels = frame(&raw, "raw", 0).1;
    pixels.sort_unstable();
    let at = f64::from(pixels[(0.999 * pixels.len() as f64) as usize - 1]);
    let filled = (at - black) / (white - black);
    assert!(filled <= 0.9005 && filled > 0.899, "{filled}");
    let dark = place.at("dark.film");
    write_film(&dark, Size::new(30, 30), &[500.0], (2.0, IRRADIANCE), |_, _, _| 0.0);
    assert_exit(
        &sensor(&dark, &place.at("no"), &["--sensor", "example-2um", "--exposure", "auto"]),
        USAGE,
        &["dark"],
    );
}

#[test]
fn bad_input_is_one_clear_error() {
    let place = Place::new();
    let film = place.noise(Size::new(60, 60));
    let bad = |flags: &[&str], words: &[&str]| {
        let raw = place.at("never");
        assert_exit(&sensor(&film, &raw, flags), USAGE, words);
        assert!(!raw.exists(), "{flags:?}");
    };
    bad(&["--exposure", "1ms"], &["--sensor", "cmv12000-rgb"]);
    bad(&["--sensor", "cmv12000-rbg", "--exposure", "1ms"], &["did you mean `cmv12000-rgb`"]);
    let with = |name: &'static str, flags: &[&'static str]| [&["--sensor", name][..], flags].concat();
    bad(&with("example-2um", &[]), &["--exposure"]);
    for time in ["0", "-1", "3601", "soon", "auto:2"] {
        bad(
            &with("example-2um", &[&*Box::leak(format!("--exposure={time}").into_boxed_str())]),
            &["--exposure"],
        );
    }
    bad(&with("cmv12000-rgb", &["--exposure", "1ms", "--gain", "1.5"]), &["gains 1, 2, 3, 4"]);
    bad(&with("cmv12000-rgb", &["--exposure", "1ms", "--iso", "400"]), &["base_iso"]);
    bad(&with("example-2um", &["--exposure", "1ms", "--iso", "50"]), &["gains 1 to 64"]);
    bad(&with("example-2um", &["--exposure", "auto", "--roi", "0,0,5,5"]), &["--roi", "whole sensor"]);
    bad(&with("example-2um", &["--exposure", "1ms", "--roi", "0,0,61,5"]), &["leaves the sensor"]);
    bad(&with("example-2um", &["--exposure", "1ms", "--size", "61"]), &["reaches beyond the film", "mm"]);
    bad(
        &with("example-2um", &["--exposure", "1ms", "--center", "0.01,0", "--size", "60"]),
        &["reaches beyond"],
    );
    bad(&with("cmv12000-rgb", &["--exposure", "1ms", "--size", "native"]), &["reaches beyond the film"]);
    bad(&with("ideal-mono", &["--exposure", "1ms", "--size", "native"]), &["no size of its own"]);
    bad(
        &with("example-2um", &["--exposure", "1ms", "--set", "pixel.pitch_um=1.0"]),
        &["--coarse-film", "--film-pitch-um 1"],
    );
    bad(&with("example-2um", &["--exposure", "1ms,2ms", "--frames", "9000"]), &["18000 frames"]);
    bad(&with("example-2um", &["--exposure", "1ms", "--noise", "loud"]), &["is no noise"]);
    bad(&with("example-2um", &["--exposure", "1ms", "--film-lux", "100"]), &["relative films"]);
    bad(&with("example-2um", &["--exposure", "1ms", "--memory", "50MiB"]), &["too small", "at least"]);
    let raw = place.at("raw.exr");
    assert_exit(
        &sensor(&film, &raw, &with("example-2um", &["--exposure", "1ms"])),
        USAGE,
        &["lenscube develop"],
    );
    let inside = film.join("raw");
    assert_exit(
        &sensor(&film, &inside, &with("example-2um", &["--exposure", "1ms"])),
        USAGE,
        &["lie in each other"],
    );
    let other = sensor(&film, &film, &with("example-2um", &["--exposure", "1ms"]));
    assert_exit(&other, USAGE, &["lie in each other"]);
    std::fs::create_dir(place.at("mine")).unwrap();
    std::fs::write(place.at("mine/notes.txt"), "mine").unwrap();
    assert_exit(
        &sensor(&film, &place.at("mine"), &with("example-2um", &["--exposure", "1ms"])),
        OTHER_JOB,
        &["nothing was changed"],
    );
    assert_exit(
        &sensor(&place.at("nowhere"), &place.at("no"), &with("example-2um", &["--exposure", "1ms"])),
        1,
        &["nowhere"],
    );
    let infrared = place.at("infrared.film");
    write_film(&infrared, Size::new(9, 9), &[900.0, 1000.0], (2.0, IRRADIANCE), |_, _, _| 1.0);
    assert_exit(
        &sensor(&infrared, &place.at("no"), &with("example-2um", &["--exposure", "1ms"])),
        USAGE,
        &["900 nm", "outside all curves"],
    );
    // A film that is not complete, and one with NaN, are failures.
    let shard = film.join("film/c/1/0/0");
    std::fs::remove_file(&shard).unwrap();
    assert_exit(
        &sensor(&film, &place.at("no"), &with("example-2um", &["--exposure", "1ms"])),
        1,
        &["1 of 3 shards are missing", "lenscube run"],
    );
}

/// Interrupted at a shard: exit code 130, and the same command resumes with the same bytes.
#[test]
fn interrupted_run_ends_with_130_and_resumes() {
    let place = Place::new();
    let film = place.noise(Size::new(2200, 2100));
    let flags = ["--sensor", "example-2um", "--exposure", "5ms,50ms", "--threads", "1"];
    let whole = place.at("whole");
    sensor(&film, &whole, &flags).ok();
    let raw = place.at("raw");
    let mut child = command(&film, &raw, &flags)
        .env("LENSCUBE_FAULT", "commit:2:stop")
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let stat = format!("/proc/{}/stat", child.id());
    let is_stopped =
        || std::fs::read_to_string(&stat).unwrap().rsplit(')').next().unwrap().trim_start().starts_with('T');
    for _ in 0..6000 {
        if is_stopped() {
            break;
        }
        assert!(child.try_wait().unwrap().is_none(), "ended before it stopped");
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    let signal = |name: &str| {
        let id = child.id().to_string();
        assert!(Command::new("kill").args([name, &id]).status().unwrap().success());
    };
    signal("-INT");
    signal("-CONT");
    let ran = CommandResult::new(&child.wait_with_output().unwrap());
    assert_exit(&ran, 130, &["interrupted: ", "the same command resumes"]);
    assert_exit(&sensor(&film, &raw, &flags), 0, &["resuming"]);
    assert!(files(&raw) == files(&whole));
}

#[test]
fn warnings_name_figures_and_ways_out() {
    let place = Place::new();
    let film = place.film(Size::new(60, 60), &[450.0, 550.0, 650.0], IRRADIANCE, |_, _, _| 1.0);
    let bright = sensor(
        &film,
        &place.at("bright"),
        &["--sensor", "cmv12000-mono", "--set", "pixel.pitch_um=2.5", "--exposure", "1s"],
    );
    assert_exit(&bright, 0, &["warning: share of each filter's response", "not aligned", "clipped at white"]);
    let flags = ["--sensor", "cmv12000-mono", "--set", "adc.black_dn=2", "--exposure", "1e-9"];
    assert_exit(&sensor(&film, &place.at("dim"), &flags), 0, &["black is 2 DN", "no pixel is above 10 %"]);
}

#[test]
fn sensors_are_listed_shown_and_validated() {
    let list = lenscube(&["sensor", "list"]).ok();
    assert_eq!(list.stdout.lines().count(), 7);
    let place = Place::new();
    let plots = place.at("plots");
    let shown = lenscube(&["sensor", "show", "sony-a7r2", "--plot", text(&plots)]).ok();
    for word in ["50384", "80.", "assumed", "Claff"] {
        assert!(shown.stdout.contains(word), "{word}: {}", shown.stdout);
    }
    assert!(plots.join("quantum-efficiency.png").exists() && plots.join("signal-to-noise.png").exists());
    let out = place.at("report");
    let ran = lenscube(&["sensor", "validate", "example-2um", "--require", "--out", text(&out)]).ok();
    assert!(!ran.stdout.contains("OUTSIDE"), "{}", ran.stdout);
    assert!(out.join("photon-transfer.png").exists() && out.join("figures.csv").exists());
    assert_exit(&lenscube(&["sensor", "show", "no-such"]), USAGE, &["built in are"]);
}

/// The float64 model's signals within one unit in the last place of f32, and the bits of its raws.
#[test]
fn golden_signals_and_raws_of_the_float64_model() {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/sensor");
    let file: Value = serde_json::from_slice(&std::fs::read(golden.join("cases.json")).unwrap()).unwrap();
    let bytes = std::fs::read(golden.join("signal.bin")).unwrap();
    let mut signals = bytes.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b));
    let nm: Vec<f64> = serde_json::from_value(file["bands_nm"].clone()).unwrap();
    let place = Place::new();
    for (k, case) in file["cases"].as_array().unwrap().iter().enumerate() {
        let pair =
            |key: &str| (case[key][0].as_u64().unwrap() as usize, case[key][1].as_u64().unwrap() as usize);
        let (film_size, size) = (pair("film"), pair("size"));
        let number = |v: &Value| v.as_f64().unwrap();
        let expected: Vec<f32> = signals.by_ref().take(size.0 * size.1).collect();
        let (film, raw) = (place.at(&format!("film-{k}")), place.at(&format!("raw-{k}")));
        let mut noise = Noise(case["seed"].as_u64().unwrap());
        let pitch_um = number(&case["film_pitch_um"]);
        write_film(&film, Size::new(film_size.0, film_size.1), &nm, (pitch_um, IRRADIANCE), |_, _, _| {
            noise.next() * 1e-3f32
        });
        let name = case["sensor"].as_str().unwrap();
        let centre =
            format!("{},{}", number(&case["centre_um"][1]) * 1e-3, number(&case["centre_um"][0]) * 1e-3);
        let flags = [
            "--sensor",
            name,
            "--exposure",
            "1ms",
            "--keep-signal",
            "--center",
            &centre,
            "--size",
            &format!("{}x{}", size.1, size.0),
            "--resample",
            case["resample"].as_str().unwrap(),
        ];
        sensor(&film, &raw, &flags).ok();
        let store = ChartStore::open_at(&raw, "signal", ChartOptions::default()).unwrap();
        let mut got = vec![0.0; expected.len()];
        store.read_rect(0, Rect::new(0, 0, size.0, size.1), &mut got).unwrap();
        let ulp = |(a, b): (&f32, &f32)| (i64::from(a.to_bits()) - i64::from(b.to_bits())).unsigned_abs();
        let worst = std::iter::zip(&got, &expected).map(ulp).max().unwrap();
        assert!(worst <= 1, "case {k}, {name}: {worst} units in the last place");
        let own = SensorFile::open(name, &[]).unwrap().sensor(pitch_um);
        let exposure = Exposure {
            seconds: number(&case["seconds"]),
            gain: number(&case["gain"]),
            scale: 1.0,
            seed: case["noise_seed"].as_u64().unwrap(),
            die: case["die"].as_u64().unwrap(),
            frame: case["frame"].as_u64().unwrap() as u32,
            noise: NoiseSet::ALL,
            temperature_c: None,
        };
        let mut numbers = vec![0; expected.len()];
        Exposer::new(&own, &exposure).expose(&expected, Rect::new(0, 0, size.0, size.1), &mut numbers);
        let crc = !numbers.iter().flat_map(|v| v.to_le_bytes()).fold(!0, |crc: u32, byte| {
            (0..8).fold(crc ^ u32::from(byte), |c, _| if c & 1 == 1 { c >> 1 ^ 0xedb8_8320 } else { c >> 1 })
        });
        assert_eq!(format!("{crc:08x}"), case["raw_crc32"].as_str().unwrap(), "case {k}, {name}");
    }
}
