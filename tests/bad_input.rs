//! Bad input, bad disks, bad words: one clear line, the documented exit code, nothing left that looks finished.

mod common;

use common::{
    Picture, Ran, delta, files, identity_band, lens, lenscube, pixels, run, scattered, shards, text,
    write_pack,
};
use formats::chart::{ChartOptions, ChartStore};
use formats::lens::{LensPackError, PackAttributes};
use pipeline::geometry::Size;
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

const FAILED: i32 = 1;
const USAGE: i32 = 2;
const OTHER_JOB: i32 = 3;

/// A chart of three bands of 90 x 100 px and a lens that fits it; both may then be spoilt.
struct Place {
    dir: tempfile::TempDir,
    chart: PathBuf,
    pack: PathBuf,
    film: PathBuf,
}

impl Place {
    fn new() -> Self {
        Self::with(Picture::noise(5, Size::new(90, 100), 3))
    }

    fn with(picture: Picture) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        let place = Self { chart: at("chart.zarr"), pack: at("pack.lens.zarr"), film: at("film.zarr"), dir };
        picture.write(&place.chart);
        let lens = lens([450.0, 500.0, 550.0].map(|nm| identity_band(nm, 0.2, 5)).into());
        let stacks = lens.bands.iter().zip(1..).map(|(b, seed)| scattered(seed, b)).collect();
        write_pack(&place.pack, &lens, stacks);
        place
    }

    fn run(&self, flags: &[&str]) -> Ran {
        run(text(&self.chart), &self.film, text(&self.pack), flags)
    }

    /// The run must be refused before there is a film, and leave the directory as it was.
    fn refused(&self, flags: &[&str], code: i32, words: &[&str]) {
        let before = files(self.dir.path());
        check(&self.run(flags), code, words);
        assert!(files(self.dir.path()) == before, "{flags:?} left something behind");
    }

    /// The run must fail on the way, with a film that nobody takes for finished.
    fn fails(&self, flags: &[&str], words: &[&str]) {
        check(&self.run(flags), FAILED, words);
        let store = ChartStore::open(text(&self.film), ChartOptions::default()).unwrap();
        let mut out = vec![0.0; store.size().pixels()];
        let missing = (0..store.bands()).any(|b| store.read_rect(b, store.size().rect(), &mut out).is_err());
        assert!(missing, "a film without a hole after a run that failed");
        let stray = files(&self.film).into_keys().find(|p| text(p).contains("tmp"));
        assert_eq!(stray, None, "a temp file is left");
    }
}

/// One line for the user, at the end, with all `words` in it and nothing said twice.
fn check(ran: &Ran, code: i32, words: &[&str]) {
    let Ran { stderr, .. } = ran;
    assert_eq!(ran.code, code, "{stderr}");
    let lines: Vec<&str> = stderr.lines().filter(|l| l.starts_with("lenscube: ")).collect();
    assert!(lines.len() == 1 && stderr.trim_end().ends_with(lines[0]), "not one line at the end: {stderr}");
    for word in words {
        assert_eq!(lines[0].matches(word).count().min(1), 1, "`{word}` is not in: {}", lines[0]);
    }
    let parts: Vec<&str> = lines[0].split(": ").filter(|p| p.len() > 12).collect();
    let twice = parts.iter().enumerate().find(|(i, p)| parts[..*i].contains(p));
    assert!(twice.is_none(), "said twice: {}", lines[0]);
    assert!(!stderr.contains("panicked"), "{stderr}");
}

/// What clap says: `error: …`, exit code 2.
fn misspelt(words: &[&str], expected: &[&str]) {
    let ran = lenscube(words);
    assert_eq!(ran.code, USAGE, "{words:?}: {}", ran.stderr);
    for word in expected {
        assert!(ran.stderr.contains(word), "{words:?}: `{word}` is not in: {}", ran.stderr);
    }
}

fn edit(path: &Path, change: impl FnOnce(&mut Value)) {
    let mut json: Value = serde_json::from_slice(&fs::read(path).unwrap()).unwrap();
    change(&mut json);
    fs::write(path, json.to_string()).unwrap();
}

fn flip_a_bit(path: &Path) {
    let mut bytes = fs::read(path).unwrap();
    let middle = bytes.len() / 3;
    bytes[middle] ^= 0x40;
    fs::write(path, bytes).unwrap();
}

/// Puts a plain f64 array in the place of a pack's table.
fn replace_table(pack: &Path, name: &str, shape: [usize; 2], values: &[f64]) {
    let array = pack.join(name);
    fs::remove_dir_all(&array).unwrap();
    fs::create_dir_all(array.join("c/0")).unwrap();
    let metadata = json!({
        "zarr_format": 3, "node_type": "array", "shape": shape, "data_type": "float64", "fill_value": 0.0,
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": shape}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
        "codecs": [{"name": "bytes", "configuration": {"endian": "little"}}], "attributes": {},
    });
    fs::write(array.join("zarr.json"), metadata.to_string()).unwrap();
    fs::write(array.join("c/0/0"), values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>()).unwrap();
}

#[test]
fn charts_that_are_none() {
    let place = Place::new();
    let is = |chart: &Path, words: &[&str]| {
        check(&run(text(chart), &place.film, text(&place.pack), &[]), FAILED, words);
        assert!(!place.film.exists());
    };
    let at = |name: &str| place.dir.path().join(name);
    is(&at("nowhere.zarr"), &["nowhere.zarr", "nothing there"]);
    fs::create_dir(at("empty")).unwrap();
    is(&at("empty"), &["empty", "no Zarr metadata", "Zarr v2 or v3"]);
    fs::write(at("file.tif"), "II*").unwrap();
    is(&at("file.tif"), &["file.tif", "a file"]);
    is(&place.pack, &["no array", "chart", "wavelength"]);
    fs::write(at("empty/zarr.json"), "{\"zarr_format\": 3,").unwrap();
    is(&at("empty"), &["empty", "JSON"]);
}

#[test]
fn charts_of_the_wrong_kind() {
    let array = |place: &Place| place.chart.join("chart/zarr.json");
    let place = Place::new();
    edit(&array(&place), |j| j["dimension_names"] = json!(["y", "x", "wavelength"]));
    place.refused(&[], FAILED, &["(wavelength, y, x)", "(y, x, wavelength)", "transpose"]);
    let place = Place::new();
    edit(&array(&place), |j| (j["data_type"], j["fill_value"]) = (json!("int64"), json!(0)));
    place.refused(&[], FAILED, &["sample type", "float32", "int64"]);
    let place = Place::new();
    edit(&place.chart.join("zarr.json"), |j| j["attributes"] = json!({}));
    place.refused(&[], USAGE, &["pitch_um", "--film-pitch-um"]);
    place.run(&["--film-pitch-um", "2"]).ok();
    let place = Place::new();
    fs::remove_dir_all(place.chart.join("wavelength")).unwrap();
    place.refused(&[], USAGE, &["wavelengths", "3 bands", "--wavelengths"]);
    place.refused(&["--wavelengths", "450,500"], FAILED, &["3 bands", "found 2"]);
    place.run(&["--wavelengths", "450:550:50"]).ok();
}

#[test]
fn what_the_lens_does_not_cover() {
    let place = Place::new();
    place.refused(&["--wavelengths", "450,500,560"], FAILED, &["560 nm", "outside", "450..550 nm"]);
    let between = ["--wavelengths", "450,500,520"];
    place.refused(&between, FAILED, &["520 nm", "500 and 550 nm", "--interpolate-psf"]);
    let axis = ["--axis", "0,0", "--film-size", "90x100"];
    // hypot(89 + 2, 99 + 2) px of 2 µm: the far corner and half a window.
    place.refused(&axis, FAILED, &["0.2718", "0.2000", "450 nm", "--outside clamp"]);
    place.run(&[&axis[..], &["--outside", "clamp"]].concat()).ok();
}

/// A place whose chart holds `picture` as another program would write it: one file a band, not compressed; this program writes
/// numbers only. `attributes` are the array's.
fn written_elsewhere(picture: Picture, attributes: Value) -> Place {
    let finite = |v: &f32| if v.is_finite() { *v } else { 0.0 };
    let numbers = picture.bands.iter().map(|b| b.iter().map(finite).collect()).collect();
    let place = Place::with(Picture { size: picture.size, bands: numbers });
    let array = place.chart.join("chart");
    let mut metadata: Value = serde_json::from_slice(&fs::read(array.join("zarr.json")).unwrap()).unwrap();
    metadata["chunk_grid"]["configuration"]["chunk_shape"] =
        json!([1, picture.size.height, picture.size.width]);
    metadata["codecs"] = json!([{"name": "bytes", "configuration": {"endian": "little"}}]);
    metadata["attributes"] = attributes;
    fs::write(array.join("zarr.json"), metadata.to_string()).unwrap();
    fs::remove_dir_all(array.join("c")).unwrap();
    for (band, values) in picture.bands.iter().enumerate() {
        let directory = array.join(format!("c/{band}/0"));
        fs::create_dir_all(&directory).unwrap();
        fs::write(directory.join("0"), values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>())
            .unwrap();
    }
    place
}

#[test]
fn finite_values_too_large_to_compute_with_are_named_and_leave_no_bad_shard() {
    for huge in [9.969_21e36, -3.4e38] {
        let mut picture = Picture::noise(5, Size::new(90, 100), 3);
        picture.bands[1][7 * 100 + 13] = huge;
        let place = written_elsewhere(picture, json!({}));
        place.fails(&[], &["band 1, row 7, column 13", "at most 1e30", "_FillValue"]);
        // Nor is it a zero for being large.
        place.fails(&["--nan", "zero", "--overwrite"], &["band 1, row 7, column 13"]);
        place.fails(&["--dtype", "f16", "--overwrite"], &["band 1, row 7, column 13"]);
    }
}

#[test]
fn declared_fill_values_are_errors_or_counted_zeros() {
    let clean = Picture::noise(5, Size::new(90, 100), 3);
    let mut holed = Picture { size: clean.size, bands: clean.bands.clone() };
    let mut zeros = clean;
    for k in [7 * 100 + 13, 89 * 100 + 99] {
        (holed.bands[1][k], zeros.bands[1][k]) = (9.969_21e36, 0.0);
    }
    let place = written_elsewhere(holed, json!({"_FillValue": 9.969_209_968_386_869e36}));
    place.fails(&[], &["no data", "band 1, row 7, column 13", "--nan zero"]);
    let ran = place.run(&["--nan", "zero", "--overwrite"]).ok();
    assert!(ran.stderr.contains("2 NaN or infinite pixels or fill values"), "{}", ran.stderr);
    let other = Place::with(zeros);
    other.run(&[]).ok();
    assert_eq!(pixels(&place.film, "film"), pixels(&other.film, "film"));
}

#[test]
fn a_drawn_value_too_large_to_compute_with_is_refused() {
    let place = Place::new();
    let ran = run("gen:uniform?size=40&value=1e35&wavelengths=500", &place.film, text(&place.pack), &[]);
    check(&ran, USAGE, &["value=1e35", "at most 1e30"]);
}

#[test]
fn nan_and_infinity_are_named_with_their_place() {
    let clean = || Picture::noise(5, Size::new(90, 100), 3);
    // One bad pixel in each: of several, any may be met first.
    for (band, row, column, value) in [(1, 7, 13, f32::NAN), (2, 89, 99, f32::NEG_INFINITY)] {
        let mut picture = clean();
        picture.bands[band][row * 100 + column] = value;
        let at = format!("{value} at band {band}, row {row}, column {column}");
        written_elsewhere(picture, json!({})).fails(&[], &[&at, "--nan zero"]);
    }
    let (mut picture, mut zeros) = (clean(), clean());
    for (band, pixel, value) in [(1, 7 * 100 + 13, f32::NAN), (2, 89 * 100 + 99, f32::NEG_INFINITY)] {
        (picture.bands[band][pixel], zeros.bands[band][pixel]) = (value, 0.0);
    }
    let place = written_elsewhere(picture, json!({}));
    place.fails(&[], &["--nan zero"]);
    let film = place.film.clone();
    let place = Place { film: place.dir.path().join("zero.zarr"), ..place };
    let ran = place.run(&["--nan", "zero"]).ok();
    assert!(ran.stderr.contains("2 NaN or infinite pixels"), "{}", ran.stderr);
    let other = Place::with(zeros);
    other.run(&[]).ok();
    assert_eq!(pixels(&place.film, "film"), pixels(&other.film, "film"));
    let again = run(text(&place.chart), &film, text(&place.pack), &["--nan", "zero"]);
    check(&again, OTHER_JOB, &["another job", "nan", "--overwrite"]);
}

#[test]
fn a_damaged_chunk_of_the_chart() {
    let place = Place::new();
    let chunk = place.chart.join("chart/c/1/0/0");
    let good = fs::read(&chunk).unwrap();
    flip_a_bit(&chunk);
    place.fails(&[], &["chart/c/1/0/0", "damaged", "checksum"]);
    fs::write(&chunk, &good[..good.len() / 2]).unwrap();
    fs::remove_dir_all(&place.film).unwrap();
    place.fails(&[], &["chart/c/1/0/0", "damaged"]);
    // The good file of another time is another chart to the job.
    fs::write(&chunk, good).unwrap();
    check(&place.run(&[]), OTHER_JOB, &["another job", "chart"]);
    place.run(&["--overwrite"]).ok();
}

#[test]
fn lens_packs_that_are_none() {
    let spoilt = |spoil: &dyn Fn(&Path), words: &[&str]| {
        let place = Place::new();
        spoil(&place.pack);
        place.refused(&[], FAILED, words);
    };
    spoilt(
        &|p| edit(&p.join("zarr.json"), |j| j["attributes"]["schema"] = json!("lenscube/lens-pack/9")),
        &["schema", "lens-pack/9", "lens-pack/1"],
    );
    spoilt(&|p| fs::remove_dir_all(p.join("psf_energy")).unwrap(), &["psf_energy", "missing"]);
    spoilt(&|p| fs::remove_file(p.join("psf/1/c/2/0/0")).unwrap(), &["psf/1", "missing"]);
    spoilt(&|p| flip_a_bit(&p.join("psf/1/c/2/0/0")), &["psf/1/c/2/0/0", "damaged"]);
    let cut = |p: &Path| {
        let file = p.join("psf/2/c/3/0/0");
        fs::write(&file, &fs::read(&file).unwrap()[..20]).unwrap();
    };
    spoilt(&cut, &["psf/2/c/3/0/0", "damaged"]);
    let heights = [[0.0, 0.1, 0.05, 0.2]; 3].concat();
    spoilt(&|p| replace_table(p, "psf_height", [3, 4], &heights), &["psf_height", "ascend"]);
    let place = Place::new();
    for (lens, code, words) in [
        ("nowhere.lens.zarr", FAILED, vec!["nowhere.lens.zarr", "no lens pack"]),
        ("triplet", USAGE, vec!["triplet", "double-gauss-28"]),
        (text(&place.chart), FAILED, vec!["schema"]),
    ] {
        check(&run(text(&place.chart), &place.film, lens, &[]), code, &words);
        assert!(!place.film.exists());
    }
    // A pack as one file, cut short on its way.
    let zip = place.dir.path().join("pack.lens.zip");
    let tables = lens(vec![identity_band(450.0, 0.2, 5)]);
    let stacks = tables.bands.iter().map(|b| Ok::<_, LensPackError>(delta(b)));
    formats::lens::write(&zip, &tables, &PackAttributes::default(), stacks).unwrap();
    let bytes = fs::read(&zip).unwrap();
    fs::write(&zip, &bytes[..bytes.len() / 2]).unwrap();
    check(&run(text(&place.chart), &place.film, text(&zip), &[]), FAILED, &["pack.lens.zip", "cut short"]);
    assert!(!place.film.exists());
}

#[test]
fn outputs_that_belong_to_another_job() {
    let place = Place::new();
    place.run(&[]).ok();
    let film = files(&place.film);
    for (flags, words) in [
        (["--interp", "bilinear"], ["interp", "bicubic", "bilinear"]),
        (["--codec", "lz4"], ["codec", "Zstd", "Lz4"]),
        (["--dtype", "f16"], ["dtype", "F32", "F16"]),
        (["--axis", "45,44"], ["axis", "45.0", "44.0"]),
        (["--bands", "1:3"], ["chart_bands", "[0,1,2]", "[1,2]"]),
    ] {
        check(&place.run(&flags), OTHER_JOB, &[&words[..], &["--overwrite"]].concat());
        assert!(files(&place.film) == film, "{flags:?} changed the film");
    }
    place.run(&["--interp", "bilinear", "--overwrite"]).ok();
    assert!(files(&place.film) != film);
}

#[test]
fn overwrite_removes_films_of_this_program_only() {
    let place = Place::new();
    let at = |name: &str| place.dir.path().join(name);
    fs::create_dir(at("thesis")).unwrap();
    fs::write(at("thesis/chapter-1.tex"), "It was a dark and stormy night").unwrap();
    fs::write(at("notes.txt"), "buy milk").unwrap();
    Picture::noise(6, Size::new(8, 9), 1).write(&at("other.zarr"));
    for output in [at("thesis"), at("notes.txt"), place.pack.clone(), at("other.zarr")] {
        let before = files(place.dir.path());
        for flags in [&["--overwrite"][..], &[]] {
            let ran = run(text(&place.chart), &output, text(&place.pack), flags);
            check(&ran, OTHER_JOB, &[text(&output), "nothing was changed"]);
        }
        let chart =
            ["chart", "checker", text(&output), "--size", "64", "--overwrite", "--wavelengths", "500"];
        if output != at("other.zarr") {
            check(&lenscube(&chart), OTHER_JOB, &[text(&output), "nothing was changed"]);
        }
        assert!(files(place.dir.path()) == before, "{}", output.display());
    }
    check(&lenscube(&["chart", "checker", text(&place.chart), "--size", "64"]), OTHER_JOB, &["--overwrite"]);
    // A film may be the chart of the next one, but not of itself.
    place.run(&[]).ok();
    let before = files(&place.film);
    let array = format!("{}//film", text(&place.film));
    for chart in [text(&place.film), &array] {
        let ran = run(chart, &place.film, text(&place.pack), &["--overwrite"]);
        check(&ran, USAGE, &["film.zarr", "own chart"]);
        assert!(files(&place.film) == before, "the chart was removed to make room for its film");
    }
}

/// `ulimit -f` makes a write fail as on a full disk, without root: the shard does not fit, all else does.
#[test]
fn a_full_disk_leaves_a_film_to_resume() {
    let place = Place::with(Picture::noise(5, Size::new(300, 301), 3));
    let words =
        ["run", text(&place.chart), text(&place.film), "--lens", text(&place.pack), "--outside", "clamp"];
    let script = "trap '' XFSZ; ulimit -f 64; exec \"$0\" \"$@\"";
    let limited =
        Command::new("sh").args(["-c", script, env!("CARGO_BIN_EXE_lenscube")]).args(words).output().unwrap();
    let ran = Ran::of(&limited);
    check(&ran, FAILED, &["film/c/", "too large", "resumes"]);
    assert_eq!(shards(&place.film).iter().filter(|p| p.starts_with("film")).count(), 0);
    assert!(!files(&place.film).into_keys().any(|p| text(&p).contains("tmp")), "a temp file is left");
    place.run(&["--outside", "clamp"]).ok();
    let (resumed, whole) = (files(&place.film), place.dir.path().join("whole"));
    run(text(&place.chart), &whole, text(&place.pack), &["--outside", "clamp"]).ok();
    assert!(resumed == files(&whole));
    // A chart is written whole or not at all.
    let chart = place.dir.path().join("drawn.zarr");
    let words =
        ["chart", "composite", text(&chart), "--size", "300", "--codec", "none", "--wavelengths", "500"];
    let limited =
        Command::new("sh").args(["-c", script, env!("CARGO_BIN_EXE_lenscube")]).args(words).output().unwrap();
    check(&Ran::of(&limited), FAILED, &["too large"]);
    let left: Vec<_> = fs::read_dir(place.dir.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(left.len(), 4, "{left:?}");
}

#[test]
fn values_that_f16_cannot_hold() {
    let mut picture = Picture::noise(5, Size::new(90, 100), 3);
    picture.bands[2].iter_mut().for_each(|v| *v += 7e4);
    let place = Place::with(picture);
    place.fails(&["--dtype", "f16"], &["band 2", "row 0, column 0", "float16", "65504"]);
}

#[test]
fn words_that_cannot_be() {
    let place = Place::new();
    place.refused(&["--memory", "1MiB"], USAGE, &["--memory 1MiB", "at least", "--threads"]);
    place.refused(&["--device", "cuda"], USAGE, &["--device cuda", "--device cpu"]);
    place.refused(&["--bands", "3"], USAGE, &["--bands 3", "beyond the last of 3 bands"]);
    place.refused(&["--bands", "1:7"], USAGE, &["--bands 1:7", "3 bands"]);
    place.refused(&["--bands", "red"], USAGE, &["`red`", "band index"]);
    place.refused(&["--bands", "2:1"], USAGE, &["selects no band"]);
    place.refused(&["--roi", "90,80,20,20"], USAGE, &["--roi 90,80,20,20", "90x100"]);
    place.refused(&["--chunk", "100", "--shard", "256"], USAGE, &["--shard 256", "--chunk 100"]);
    place.refused(&["--wavelengths", "450:400:10"], USAGE, &["--wavelengths"]);
    for (chart, words) in [
        ("gen:composit?size=100", vec!["composit", "did you mean 'composite'"]),
        ("gen:composite?sise=100", vec!["sise", "did you mean 'size'"]),
        ("gen:composite?size=wide", vec!["size=wide", "HxW"]),
        ("gen:composite?size", vec!["key=value"]),
    ] {
        check(&run(chart, &place.film, text(&place.pack), &[]), USAGE, &words);
        assert!(!place.film.exists());
    }
    check(&lenscube(&["chart", "siemans", "c.zarr"]), USAGE, &["siemans", "did you mean 'siemens'"]);
    check(&lenscube(&["chart", "siemens", "c.zarr", "--size", "wide"]), USAGE, &["--size", "wide"]);
    check(&lenscube(&["lens", "show", "triplet"]), USAGE, &["triplet", "double-gauss-28"]);
    let of_run = |words: &[&str], expected: &[&str]| {
        misspelt(&[&["run", "c.zarr", "f.zarr"], words].concat(), expected)
    };
    of_run(&["--memroy", "1GiB"], &["--memroy", "--memory"]);
    of_run(&["--overwite"], &["--overwite", "--overwrite"]);
    of_run(&["--roi", "1,2,3"], &["--roi", "X,Y,W,H"]);
    of_run(&["--roi", "1,2,0,3"], &["--roi", "`0`"]);
    of_run(&["--film-size", "12by13"], &["--film-size", "12by13"]);
    of_run(&["--memory", "much"], &["--memory", "unit of bytes"]);
    of_run(&["--azimuths", "6"], &["--azimuths", "multiple of 4"]);
    of_run(&["--psf-window", "8"], &["--psf-window", "odd"]);
    of_run(&["--threads", "0"], &["--threads", "1 to 1024"]);
    of_run(&["--scale", "0"], &["--scale", "0"]);
    of_run(&["--axis", "7"], &["--axis", "X,Y"]);
    of_run(&["--axis", "1e300,0"], &["--axis", "1e7"]);
    of_run(&["--center", "0,-1e8"], &["--center", "1e7"]);
    of_run(&["--film-pitch-um", "1e300"], &["--film-pitch-um", "1e6"]);
    of_run(&["--shard", "1000000000", "--chunk", "1000000000"], &["--shard", "16384"]);
    of_run(&["--surround", "egde"], &["egde", "edge"]);
    of_run(&["--stages", "ri,distorsion"], &["distorsion", "distortion"]);
    misspelt(&["chart", "siemens", "c.zarr", "--spikes", "3"], &["--spikes", "--spokes"]);
    misspelt(&["exprot", "f.zarr"], &["exprot"]);
}
