//! Absurd numbers, and jobs that need more memory than allowed, are rejected in one line before anything is allocated; other jobs stay
//! within their memory limit and near their memory plan.

use crate::common::{CommandResult, Noise, Picture, identity_band, lens, scattered, text, write_pack};
use pipeline::geometry::Size;
use pipeline::lens::LensBand;
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

const FAILED: i32 = 1;
const USAGE: i32 = 2;
const OTHER_JOB: i32 = 3;
const WRONG: i32 = 4;

/// Address space of every command here, KiB: an allocation for an absurd number fails.
const ADDRESS_KIB: u64 = 6 << 20;

fn lenscube(arguments: &[&str]) -> CommandResult {
    let script = format!("ulimit -v {ADDRESS_KIB}; exec \"$0\" \"$@\"");
    let mut command = Command::new("sh");
    command.args(["-c", &script, env!("CARGO_BIN_EXE_lenscube")]).args(arguments);
    CommandResult::new(&command.env("XDG_CACHE_HOME", env!("CARGO_TARGET_TMPDIR")).output().unwrap())
}

/// Checks the exit code, and that the last line of stderr is the only error message and contains all `words`.
fn check(ran: &CommandResult, code: i32, words: &[&str]) {
    assert_eq!(ran.code, code, "{}", ran.stderr);
    assert!(!ran.stderr.contains("panicked"), "{}", ran.stderr);
    let lines: Vec<&str> = ran.stderr.lines().filter(|l| l.starts_with("lenscube: ")).collect();
    assert!(
        lines.len() == 1 && ran.stderr.trim_end().ends_with(lines[0]),
        "not one line at the end: {}",
        ran.stderr
    );
    for word in words {
        assert!(lines[0].contains(word), "`{word}` is not in: {}", lines[0]);
    }
}

struct Place {
    dir: tempfile::TempDir,
}

impl Place {
    fn new() -> Self {
        Self { dir: tempfile::tempdir().unwrap() }
    }

    fn at(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// A chart of two bands at 450 and 500 nm and a pack for it, whose bands `change` modifies.
    fn job(&self, size: Size, change: impl Fn(&mut LensBand)) -> (PathBuf, PathBuf) {
        let (chart, pack) = (self.at("chart.zarr"), self.at("pack.lens.zarr"));
        Picture::noise(5, size, 2).write(&chart);
        self.pack(&pack, 5, change);
        (chart, pack)
    }

    fn pack(&self, pack: &Path, window: usize, change: impl Fn(&mut LensBand)) {
        let mut lens = lens([450.0, 500.0].map(|nm| identity_band(nm, 8.0, window)).into());
        lens.bands.iter_mut().for_each(change);
        let stacks = lens.bands.iter().zip(1..).map(|(b, seed)| scattered(seed, b)).collect();
        write_pack(pack, &lens, stacks);
    }

    fn run(&self, chart: &str, pack: &Path, flags: &[&str]) -> CommandResult {
        let film = self.at("film.zarr");
        let words = ["run", chart, text(&film), "--lens", text(pack), "--no-fsync", "--threads", "2"];
        lenscube(&[&words[..], flags].concat())
    }
}

/// Modifies a JSON file.
fn edit(path: &Path, change: impl FnOnce(&mut Value)) {
    let mut json: Value = serde_json::from_slice(&fs::read(path).unwrap()).unwrap();
    change(&mut json);
    fs::write(path, json.to_string()).unwrap();
}

/// Writes the metadata of an uncompressed array; the caller writes its chunks.
fn plain_array(path: &Path, shape: &[usize], chunk: &[usize], data_type: &str) {
    fs::create_dir_all(path).unwrap();
    let metadata = json!({
        "zarr_format": 3, "node_type": "array", "shape": shape, "data_type": data_type, "fill_value": 0.0,
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": chunk}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
        "codecs": [{"name": "bytes", "configuration": {"endian": "little"}}], "attributes": {"pitch_um": 2.0},
    });
    fs::write(path.join("zarr.json"), metadata.to_string()).unwrap();
}

/// Replaces a pack's (bands, values) table.
fn replace_table(pack: &Path, name: &str, shape: &[usize], values: &[f64]) {
    fs::remove_dir_all(pack.join(name)).unwrap();
    plain_array(&pack.join(name), shape, shape, "float64");
    let chunk = shape.iter().fold(pack.join(name).join("c"), |at, _| at.join("0"));
    fs::create_dir_all(chunk.parent().unwrap()).unwrap();
    fs::write(chunk, values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>()).unwrap();
}

fn scaled(factor: f64) -> impl Fn(&mut LensBand) {
    move |band| band.ideal_height_mm.iter_mut().for_each(|h| *h *= factor)
}

#[test]
fn ideal_heights_in_um_exceed_the_memory_and_the_error_names_the_unit() {
    for (factor, word) in [(1000.0, "µm"), (100.0, "ideal_height")] {
        let place = Place::new();
        let (chart, pack) = place.job(Size::new(90, 100), scaled(factor));
        let ran = place.run(text(&chart), &pack, &["--memory", "300MiB"]);
        check(&ran, USAGE, &["--memory 300MiB", "450 nm", "ideal heights", word]);
        assert!(!place.at("film.zarr").exists());
    }
    let place = Place::new();
    let (chart, pack) = place.job(Size::new(90, 100), scaled(6.0));
    let ran = place.run(text(&chart), &pack, &[]).ok();
    assert!(ran.stderr.contains("note: at 450 nm the ideal heights of the lens table"), "{}", ran.stderr);
    let place = Place::new();
    let (chart, pack) = place.job(Size::new(90, 100), scaled(1e-3));
    let ran = place.run(text(&chart), &pack, &[]).ok();
    assert!(ran.stderr.contains("ideal_height is probably in m or image_height in µm"), "{}", ran.stderr);
    let place = Place::new();
    let (chart, pack) = place.job(Size::new(90, 100), |_| ());
    assert!(!place.run(text(&chart), &pack, &[]).ok().stderr.contains("warning"));
}

/// Peak and planned memory of the film's only run, MiB.
fn peak_and_plan(film: &Path) -> (u64, u64) {
    let mut runs = fs::read_dir(film.join("runs")).unwrap().map(|e| e.unwrap().path());
    let run: Value = serde_json::from_slice(&fs::read(runs.next().unwrap()).unwrap()).unwrap();
    let mib = |key: &str| run[key].as_u64().unwrap() >> 20;
    (mib("peak_resident_bytes"), mib("memory_planned_bytes"))
}

#[test]
#[ignore = "long: 120 s"]
fn peak_memory_stays_within_the_limit_for_unusual_remaps_chunks_and_psfs() {
    let within = |name: &str, chart: &str, place: &Place, flags: &[&str], mib: u64| {
        let memory = format!("{mib}MiB");
        let pack = place.at("pack.lens.zarr");
        place.run(chart, &pack, &[flags, &["--memory", &memory]].concat()).ok();
        let (peak, _) = peak_and_plan(&place.at("film.zarr"));
        println!("{name}: {peak} MiB of {mib}");
        assert!(peak <= mib, "{name}: {peak} MiB of {mib}");
    };
    let drawn = "gen:composite?size=1500&wavelengths=450,500&pitch_um=2";
    let place = Place::new();
    place.pack(&place.at("pack.lens.zarr"), 31, |_| ());
    within("a usual film", drawn, &place, &[], 260);
    // Strips of one film pixel, each 100 chart pixels wide, far off the axis, mirrored at the border.
    let place = Place::new();
    place.pack(&place.at("pack.lens.zarr"), 5, scaled(1.1));
    let off = ["--scale", "0.05", "--axis", "40,-30", "--center", "0.2,-0.3", "--surround", "mirror"];
    within("a small film of a large chart", "gen:siemens?size=6000&wavelengths=450,500", &place, &off, 260);
    // Every strip of the film is computed from 15 times its height and width of chart.
    let place = Place::new();
    place.pack(&place.at("pack.lens.zarr"), 5, scaled(15.0));
    within("a remap that stretches", drawn, &place, &[], 300);
    // Charts of one chunk a band, and of one chunk for all bands.
    for (name, chunk) in [("one chunk a band", [1, 2400, 2400]), ("chunks of all bands", [2, 2400, 2400])] {
        let place = Place::new();
        place.pack(&place.at("pack.lens.zarr"), 5, |_| ());
        let chart = place.at("chart.zarr");
        plain_array(&chart, &[2, 2400, 2400], &chunk, "float32");
        let mut noise = Noise(3);
        let values: Vec<u8> =
            (0..chunk.iter().product()).flat_map(|_: usize| noise.next().to_le_bytes()).collect();
        for band in 0..2 / chunk[0] {
            fs::create_dir_all(chart.join(format!("c/{band}/0"))).unwrap();
            fs::write(chart.join(format!("c/{band}/0/0")), &values).unwrap();
        }
        within(
            name,
            text(&chart),
            &place,
            &["--wavelengths", "450,500", "--shard", "512", "--chunk", "256"],
            260,
        );
        let refused = place.run(
            text(&chart),
            &place.at("pack.lens.zarr"),
            &[
                "--wavelengths",
                "450,500",
                "--memory",
                "130MiB",
                "--overwrite",
                "--shard",
                "256",
                "--chunk",
                "256",
            ],
        );
        check(&refused, USAGE, &["--memory 130MiB", "chunk"]);
    }
    // PSFs sampled ten times as coarse as the film: a window of 11 samples has 111 film pixels.
    let place = Place::new();
    place.pack(&place.at("pack.lens.zarr"), 11, |b| b.psf_pitch_um = 20.0);
    within("coarse PSFs", "gen:composite?size=500&wavelengths=450,500&pitch_um=2", &place, &[], 300);
}

#[test]
#[ignore = "long: films of several hundred MiB, up to four times each"]
fn memory_plan_is_close_above_the_peak_for_five_shapes_of_job() {
    let pack = "double-gauss-28-npz";
    // Jobs of several hundred MiB, so that the 30 MiB of the process itself do not dominate.
    let check = |name: &str, chart: &str, lens: &str, flags: &str| {
        // The peak depends on what the threads decode and compute at the same time: the largest of up to four runs.
        let close = (0..4).any(|_| {
            let place = Place::new();
            let film = place.at("film.zarr");
            let arguments = ["run", chart, text(&film), "--lens", lens, "--no-fsync", "--shard", "512"];
            let flags: Vec<&str> = flags.split_whitespace().collect();
            lenscube(&[&arguments[..], &flags].concat()).ok();
            let (peak, plan) = peak_and_plan(&film);
            println!("{name}: peak {peak} MiB, plan {plan} MiB");
            assert!(peak <= plan, "{name}: peak {peak} MiB, plan {plan} MiB");
            10 * peak >= 7 * plan
        });
        assert!(close, "{name}: the peak of every run is below 0.7 of the plan");
    };
    let drawn = |size: usize, pitch_um: f64, wavelengths: &str| {
        format!("gen:composite?size={size}&pitch_um={pitch_um}&wavelengths={wavelengths}")
    };
    let flags = "--threads 2 --memory 1GiB --azimuths 240";
    check("small film, large PSF", &drawn(600, 0.5, "450,500"), pack, flags);
    let flags = "--threads 2 --memory 1GiB --azimuths 288";
    check("traced lens", &drawn(2500, 2.0, "430,440"), "double-gauss-28", flags);
    let flags = "--threads 8 --memory 1GiB --azimuths 96";
    check("many bands, many threads", &drawn(2048, 2.0, "450:540:10"), pack, flags);
    let flags = "--threads 2 --memory 300MiB --azimuths 720";
    check("caches smaller than useful", &drawn(3000, 2.0, "450,500"), pack, flags);
    let place = Place::new();
    let chart = place.at("chart.zarr");
    plain_array(&chart, &[2, 4800, 2400], &[1, 2400, 2400], "float32");
    let values = 1f32.to_le_bytes().repeat(2400 * 2400);
    for chunk in ["0/0", "0/1", "1/0", "1/1"] {
        fs::create_dir_all(chart.join("c").join(chunk)).unwrap();
        fs::write(chart.join("c").join(chunk).join("0"), &values).unwrap();
    }
    let flags = "--threads 2 --memory 1GiB --wavelengths 450,500 --azimuths 720";
    check("large chunks", text(&chart), pack, flags);
}

#[test]
fn absurd_film_attributes_are_reported_as_damage() {
    let place = Place::new();
    let (chart, pack) = place.job(Size::new(90, 100), |_| ());
    place.run(text(&chart), &pack, &[]).ok();
    let film = place.at("film.zarr");
    let sound = fs::read(film.join("zarr.json")).unwrap();
    let changes: [(&str, Value, &str); 8] = [
        ("film_size", json!([1u64 << 40, 1u64 << 40]), "1099511627776 px"),
        ("pitch_um", json!(1e-300), "1e-300 µm"),
        ("pitch_um", json!(1e12), "1e12 µm"),
        ("axis_px", json!([1e300, 0.0]), "1e300 px"),
        ("wavelengths_nm", json!([450.0, 0.1]), "0.1 nm"),
        ("shard", json!(1u64 << 40), "px"),
        ("outputs", json!([{"name": "film", "row": i64::MAX, "column": 0, "size": [90, 100]}]), "output"),
        ("outputs", json!([{"name": "film", "row": 0, "column": 0, "size": [1u64 << 40, 1u64 << 40]}]), "px"),
    ];
    for (key, value, word) in changes {
        fs::write(film.join("zarr.json"), &sound).unwrap();
        edit(&film.join("zarr.json"), |j| j["attributes"][key] = value);
        for (command, code) in [("status", WRONG), ("verify", WRONG), ("pyramid", WRONG)] {
            check(&lenscube(&[command, text(&film)]), code, &["film.zarr", word]);
        }
        check(&place.run(text(&chart), &pack, &[]), FAILED, &["film.zarr", word]);
    }
    // A damaged film can be removed.
    place.run(text(&chart), &pack, &["--overwrite"]).ok();
}

#[test]
fn absurd_chart_attributes_are_an_error_with_key_and_value() {
    let place = Place::new();
    let (chart, pack) = place.job(Size::new(90, 100), |_| ());
    let sound = fs::read(chart.join("zarr.json")).unwrap();
    for (key, value, word) in [
        ("film_size", json!([1u64 << 40, 1u64 << 40]), "1099511627776"),
        ("film_size", json!([0, 5]), "[0,5]"),
        ("pitch_um", json!(1e-300), "1e-300"),
        ("pitch_um", json!(1e12), "1000000000000"),
    ] {
        fs::write(chart.join("zarr.json"), &sound).unwrap();
        edit(&chart.join("zarr.json"), |j| j["attributes"][key] = value);
        check(&place.run(text(&chart), &pack, &[]), FAILED, &[key, word]);
    }
    fs::write(chart.join("zarr.json"), sound).unwrap();
    for (shape, chunk) in [([1usize, 1 << 40, 1 << 40], [1, 512, 512]), ([1, 1 << 20, 1 << 20], [1, 1, 1])] {
        let array = place.at("absurd.zarr");
        plain_array(&array, &shape, &chunk, "float32");
        check(&place.run(text(&array), &pack, &["--wavelengths", "450"]), FAILED, &["absurd.zarr"]);
    }
}

#[test]
fn absurd_lens_tables_are_an_error_with_bounds_and_unit() {
    let refused = |name: &str, shape: &[usize], values: &[f64], words: &[&str]| {
        let place = Place::new();
        let (chart, pack) = place.job(Size::new(90, 100), |_| ());
        replace_table(&pack, name, shape, values);
        check(&place.run(text(&chart), &pack, &[]), FAILED, &[&["pack.lens.zarr", name], words].concat());
    };
    let row = |at: usize, v: f64| {
        [0, 1].map(|_| (0..50).map(|i| if i == at { v } else { 1.0 }).collect::<Vec<_>>()).concat()
    };
    refused("relative_illumination", &[2, 50], &row(7, 1e308), &["1e308", "0 to 100"]);
    refused("psf_pitch", &[2], &[2.0, 1e-300], &["1e-300 µm"]);
    refused("psf_pitch", &[2], &[2.0, 1e12], &["1e12 µm"]);
    refused("solid_angle", &[2], &[0.1, 1e300], &["1e300 sr"]);
    refused("transmission", &[2], &[0.5, 7.0], &["7"]);
    refused("wavelength", &[2], &[450.0, 1e9], &["1e9 nm"]);
    let heights: Vec<f64> =
        [0, 1].map(|_| (0..50).map(|i| f64::from(i) * 1e300).collect::<Vec<_>>()).concat();
    refused("ideal_height", &[2, 50], &heights, &["mm"]);
    for (key, value) in [("f_number", json!(1e-300)), ("distortion_focal_length_mm", json!(1e300))] {
        let place = Place::new();
        let (chart, pack) = place.job(Size::new(90, 100), |_| ());
        edit(&pack.join("zarr.json"), |j| j["attributes"][key] = value);
        check(&place.run(text(&chart), &pack, &[]), FAILED, &["pack.lens.zarr", key, "expected"]);
    }
}

#[test]
fn films_with_too_many_shards_or_chunks_are_usage_errors() {
    let place = Place::new();
    let (chart, pack) = place.job(Size::new(90, 100), |_| ());
    let run = |flags: &[&str], words: &[&str]| {
        check(&place.run(text(&chart), &pack, &[flags, &["--outside", "clamp"]].concat()), USAGE, words);
        assert!(!place.at("film.zarr").exists());
    };
    run(&["--film-size", "1000000", "--shard", "1", "--chunk", "1"], &["shards", "4194304"]);
    run(&["--film-size", "100000", "--shard", "16384", "--chunk", "1"], &["chunks in a shard"]);
    check(
        &place.run(
            "gen:uniform?size=900000&wavelengths=450&pitch_um=2",
            &pack,
            &["--scale", "100", "--outside", "clamp"],
        ),
        USAGE,
        &["side of the film", "px"],
    );
}

#[test]
fn values_beyond_float32_are_a_usage_error() {
    let place = Place::new();
    let (_, pack) = place.job(Size::new(90, 100), |_| ());
    let ran = place.run(
        "gen:uniform?size=64&value=3e38&wavelengths=450&pitch_um=2",
        &pack,
        &["--film-units", "photons"],
    );
    check(&ran, USAGE, &["value=3e38", "32-bit"]);
    assert!(!place.at("film.zarr").exists());
}

#[test]
fn charts_of_other_known_units_are_no_radiance() {
    let place = Place::new();
    let (_, pack) = place.job(Size::new(90, 100), |_| ());
    for (units, words) in
        [("W m-2 sr-1 um-1", "--chart-scale 0.001"), ("W m-2 nm-1", "make a chart of radiance")]
    {
        let flags = ["--film-units", "irradiance", "--chart-units", units];
        let ran = place.run("gen:uniform?size=64&wavelengths=450&pitch_um=2", &pack, &flags);
        check(&ran, USAGE, &[units, words]);
        assert!(!place.at("film.zarr").exists());
    }
}

#[test]
fn lens_name_of_64_bytes_is_not_shortened_like_a_digest() {
    let place = Place::new();
    let (chart, pack) = place.job(Size::new(90, 100), |_| ());
    place.run(text(&chart), &pack, &[]).ok();
    let name = format!("a{}b", "µ".repeat(31));
    edit(&pack.join("zarr.json"), |j| j["attributes"]["name"] = json!(name));
    check(&place.run(text(&chart), &pack, &[]), OTHER_JOB, &["--lens (name)", &name]);
}

#[test]
fn memory_is_planned_within_the_limit_of_the_address_space() {
    let place = Place::new();
    let limited = |limit_kib: u64, words: &[&str]| {
        let script = format!("ulimit -v {limit_kib}; exec \"$0\" \"$@\"");
        let mut command = Command::new("sh");
        command.args(["-c", &script, env!("CARGO_BIN_EXE_lenscube"), "run"]).args(words);
        CommandResult::new(&command.output().unwrap())
    };
    let lens = ["--lens", "double-gauss-28-npz", "--threads", "2"];
    let film = place.at("film.zarr");
    // At most half of what is left is the default, and that suffices.
    let words = [&["gen:composite?size=500&wavelengths=550", text(&film), "--verbose"], &lens[..]].concat();
    let ran = limited(1_500_000, &words).ok();
    let limit = ran.stderr.lines().find_map(|line| line.strip_prefix("memory limit ")?.split_once("MiB"));
    let limit: u64 = limit.unwrap_or_else(|| panic!("{}", ran.stderr)).0.parse().unwrap();
    assert!((300..=1_500_000 / 2048).contains(&limit), "{}", ran.stderr);
    assert!(!ran.stderr.contains("ulimit"), "{}", ran.stderr);
    // A larger one is reported where the job would use it.
    let (large, out) = ("gen:composite?size=14141&wavelengths=400:700:10", place.at("large.zarr"));
    let words =
        [&[large, text(&out), "--dry-run", "--memory", "8GiB"], &lens[..2], &["--threads", "64"]].concat();
    let ran = limited(1_500_000, &words).ok();
    assert!(ran.stdout.contains("left of the address space (ulimit -v)"), "{}", ran.stdout);
    // Too little for the job is one error, and nothing is written.
    let words = [&[large, text(&out)], &lens[..]].concat();
    // Without a limit the message is about the default.
    let default = ["the default of --memory, ", "is too small", "raise the limit"];
    check(&limited(400_000, &words), USAGE, &default);
    let given = [&words[..], &["--memory", "105MiB"]].concat();
    check(&limited(400_000, &given), USAGE, &["--memory 105MiB is too small", "raise the limit"]);
    assert!(!out.exists());
}

/// Too little for the film with any lens is refused before its lens is traced.
#[test]
fn a_limit_below_the_film_itself_is_refused_before_the_trace() {
    let place = Place::new();
    let (cache, film) = (place.at("cache"), place.at("film.zarr"));
    let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
    command.args(["run", "gen:uniform?size=64&wavelengths=500", text(&film), "--lens", "double-gauss-28"]);
    command.args(["--memory", "20MiB"]).env("XDG_CACHE_HOME", &cache);
    let refused = CommandResult::new(&command.output().unwrap());
    check(&refused, USAGE, &["--memory 20MiB is too small", "of its lens more"]);
    assert!(!refused.stderr.contains("tracing") && !cache.exists() && !film.exists(), "{}", refused.stderr);
}
