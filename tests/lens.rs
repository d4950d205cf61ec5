//! `lenscube lens trace | show | diff`, and runs whose lens is a design: through the command.

mod common;

use common::{Picture, Ran, bits, files, lenscube, pixels, text};
use formats::lens::LensPack;
use pipeline::geometry::Size;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

const FAILED: i32 = 1;
const USAGE: i32 = 2;
const OTHER_JOB: i32 = 3;
const DESIGN: &str = include_str!("../pipeline/data/double-gauss-28.zmx");

fn json(ran: Ran) -> Value {
    serde_json::from_str(&ran.ok().stdout).unwrap()
}

fn refused(words: &[&str], code: i32, expected: &[&str]) {
    let ran = lenscube(words);
    assert_eq!(ran.code, code, "{words:?}: {}", ran.stderr);
    for word in expected {
        assert!(ran.stderr.contains(word), "{words:?}: `{word}` is not in: {}", ran.stderr);
    }
    assert!(!ran.stderr.contains("panicked"), "{}", ran.stderr);
}

/// `lens trace DESIGN OUT` of two bands and three heights to 3 mm: a second of work.
fn trace(design: &str, out: &Path, flags: &[&str]) -> Ran {
    let words = ["lens", "trace", design, text(out), "--wavelengths", "600,500", "--max-height-mm", "3"];
    lenscube(&[&words[..], &["--heights", "0,1.5,3"], flags].concat())
}

#[test]
fn a_traced_pack_holds_what_was_asked() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("dg.lens.zarr");
    let ran = trace("double-gauss-28", &out, &[]).ok();
    for word in ["500 nm: window", "light held", "PSFs traced in", " MB", "lenscube run CHART FILM --lens"] {
        assert!(ran.stderr.contains(word), "`{word}` is not in: {}", ran.stderr);
    }
    let pack = LensPack::open(&out).unwrap();
    let bands = &pack.lens().bands;
    assert_eq!(bands.iter().map(|b| b.wavelength_nm).collect::<Vec<_>>(), [500.0, 600.0]);
    assert_eq!(bands[0].psf_height_mm, [0.0, 1.5, 3.0]);
    assert!((bands[1].image_height_mm.last().unwrap() - 3.0).abs() < 1e-9);
    assert!(bands.iter().flat_map(|b| &b.psf_energy).all(|e| *e >= 0.99));
    assert!(pack.lens().object_distance_mm.is_none() && pack.psf(1).unwrap().heights() == 3);
    // Again: refused, and nothing is lost.
    let before = files(&out);
    let again = trace("double-gauss-28", &out, &[]);
    assert_eq!(again.code, OTHER_JOB, "{}", again.stderr);
    assert!(again.stderr.contains("dg.lens.zarr") && files(&out) == before);
    // As one file.
    let zip = dir.path().join("dg.lens.zip");
    trace("double-gauss-28", &zip, &[]).ok();
    assert_eq!(LensPack::open(&zip).unwrap().digest().unwrap(), pack.digest().unwrap());
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 2, "something else is left");
}

#[test]
fn film_plane_and_object_go_where_they_are_put() {
    let dir = tempfile::tempdir().unwrap();
    let pack = |name: &str, flags: &[&str]| {
        let out = dir.path().join(name);
        trace("double-gauss-28", &out, flags).ok();
        LensPack::open(out).unwrap()
    };
    let (design, rms) = (pack("a", &[]), pack("b", &["--image-plane", "rms", "--focus-nm", "600"]));
    let far = pack("c", &["--image-plane", "rms", "--focus-nm", "600", "--defocus-mm", "0.2"]);
    let focal = |p: &LensPack| p.lens().distortion_focal_length_mm;
    // 0.2 mm further back the chief ray has gone on at its own slope, the angular magnification.
    assert!((focal(&far) - focal(&rms) - 0.2 * 0.919_234).abs() < 2e-5, "{} {}", focal(&far), focal(&rms));
    assert_ne!(design.digest().unwrap(), rms.digest().unwrap());
    let near = pack("d", &["--object-distance-mm", "100000"]);
    assert_eq!(near.lens().object_distance_mm, Some(100_000.0));
    // The chief ray from height y leaves at y/(100000 + entrance pupil 58.94) and lands at 99.332 times that, upside down.
    assert!(
        (near.lens().magnification + 99.332_063 / 100_058.939_762).abs() < 1e-10,
        "{}",
        near.lens().magnification
    );
}

#[test]
fn bad_designs_and_words_are_refused_in_one_line() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let out = at("out.lens.zarr");
    let bad = |design: &str, flags: &[&str], code: i32, words: &[&str]| {
        refused(&[&["lens", "trace", design, text(&out)], flags].concat(), code, words);
        assert!(
            !out.exists()
                && fs::read_dir(dir.path()).unwrap().all(|e| !text(&e.unwrap().path()).contains("part"))
        );
    };
    bad("triplet", &[], USAGE, &["triplet", "double-gauss-28"]);
    bad("double-gauss-28", &["--energy", "2"], FAILED, &["energy is 2", "between 0 and 1"]);
    bad("double-gauss-28", &["--heights", "0,3,1"], FAILED, &["heights", "ascending"]);
    bad("double-gauss-28", &["--heights", "0:x:1"], USAGE, &["--heights 0:x:1", "`x`"]);
    bad("double-gauss-28", &["--wavelengths", "700:400:10"], USAGE, &["--wavelengths 700:400:10"]);
    bad("double-gauss-28", &["--max-height-mm", "200"], FAILED, &["200", "reaches no further than"]);
    bad("double-gauss-28", &["--image-plane", "best"], USAGE, &["best", "strehl"]);
    bad(
        "double-gauss-28",
        &["--psf-pitch-um", "5", "--wavelengths", "500"],
        FAILED,
        &["psf pitch", "Nyquist"],
    );
    fs::write(at("glass.zmx"), DESIGN.replace("N-SK16", "N-SK160")).unwrap();
    bad(text(&at("glass.zmx")), &[], FAILED, &["N-SK160", "nearest", "N-SK16"]);
    fs::write(at("text.zmx"), "not a design").unwrap();
    bad(text(&at("text.zmx")), &[], FAILED, &["text.zmx"]);
    refused(&["lens", "show", "no.zmx"], USAGE, &["no.zmx", "double-gauss-28"]);
}

#[test]
fn a_design_is_shown_with_its_system_data() {
    let dir = tempfile::tempdir().unwrap();
    let shown = json(lenscube(&["lens", "show", "double-gauss-28", "--json"]));
    let design = |key: &str| shown["design"][key].as_f64().unwrap_or_else(|| panic!("{key} in {shown}"));
    // The design program's own figures of this lens.
    assert!((design("distortion_focal_length_mm") - 99.332_063).abs() < 1e-6);
    assert!((design("effective_focal_length_mm") - 99.500_679).abs() < 1e-6);
    for key in
        ["back_focal_length_mm", "total_track_mm", "working_f_number", "image_space_na", "stop_radius_mm"]
    {
        assert!(design(key) > 0.0, "{key}");
    }
    assert!(shown["design"]["object_distance_mm"].is_null());
    let fields = shown["fields"].as_array().unwrap();
    assert_eq!(fields.len(), 15, "three wavelengths, five heights");
    let edge =
        fields.iter().find(|f| f["wavelength_nm"] == 587.6 && f["image_height_mm"].as_f64() > Some(24.0));
    assert!((edge.unwrap()["distortion_percent"].as_f64().unwrap() + 0.8673).abs() < 3e-3, "{edge:?}");
    let words = lenscube(&["lens", "show", "double-gauss-28", "--heights", "0,5", "--wavelengths", "550"])
        .ok()
        .stdout;
    for word in ["effective focal length", "exit pupil position", "Strehl", "RMS", "GEO", "99.332063 mm"] {
        assert!(words.contains(word), "`{word}` is not in: {words}");
    }
    let plots = dir.path().join("plots");
    let small = ["--heights", "0,2", "--wavelengths", "550", "--lp-mm", "10,30", "--plot", text(&plots)];
    lenscube(&[&["lens", "show", "double-gauss-28"], &small[..]].concat()).ok();
    for (file, word) in [
        ("relative-illumination", "relative illumination"),
        ("distortion", "% of f tan θ"),
        ("lateral-colour", "µm"),
        ("mtf-field", "30 lp/mm"),
        ("mtf-frequency", "spatial frequency"),
        ("psf", "base64"),
        ("nodes", "kernels at"),
        ("layout", "z from the first surface (mm)"),
    ] {
        let svg = fs::read_to_string(plots.join(format!("{file}.svg"))).unwrap();
        assert!(svg.starts_with("<svg") && svg.ends_with("</svg>\n") && svg.contains(word), "{file}");
        let png = fs::read(plots.join(format!("{file}.png"))).unwrap();
        assert!(png.starts_with(b"\x89PNG"), "{file}");
    }
}

#[test]
fn a_pack_is_shown_by_its_tables() {
    let dir = tempfile::tempdir().unwrap();
    let pack = "double-gauss-28-npz";
    let shown = json(lenscube(&["lens", "show", pack, "--json", "--wavelengths", "550", "--heights", "10"]));
    let tables = formats::lens::builtin(pack).unwrap();
    let band = &tables.lens().bands[15];
    let field = &shown["fields"][0];
    assert_eq!(field["relative_illumination"].as_f64().unwrap(), band.illumination_of(10.0));
    assert!(field["strehl"].is_null() && field["geo_um"].is_null(), "integrated samples know neither");
    let plots = dir.path().join("plots");
    lenscube(&["lens", "show", pack, "--plot", text(&plots)]).ok();
    assert!(plots.join("mtf-field.svg").exists() && !plots.join("layout.svg").exists());
    refused(&["lens", "show", pack, "--image-plane", "rms"], USAGE, &["is a lens pack", "designs"]);
    refused(&["lens", "show", pack, "--wavelengths", "555"], USAGE, &["no band at 555 nm", "400:700:10"]);
    refused(&["lens", "show", pack, "--heights", "0,30"], USAGE, &["reaches 20.8", "30 mm"]);
}

/// Strehl from a pack's PSF (its peak against an even pupil) and from the design's rays: two ways to one number.
#[test]
fn pack_and_design_agree_on_strehl() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("a.lens.zarr");
    trace("double-gauss-28", &out, &[]).ok();
    let strehl = |lens: &str| {
        let shown = json(lenscube(&[
            "lens",
            "show",
            lens,
            "--json",
            "--wavelengths",
            "500,600",
            "--heights",
            "0,1.5,3",
        ]));
        let of = |f: &Value| f["strehl"].as_f64().unwrap();
        shown["fields"].as_array().unwrap().iter().map(of).collect::<Vec<_>>()
    };
    let (of_pack, of_rays) = (strehl(text(&out)), strehl("double-gauss-28"));
    assert_eq!((of_pack.len(), of_rays.len()), (6, 6));
    for (pack, rays) in of_pack.into_iter().zip(of_rays) {
        assert!((pack / rays - 1.0).abs() < 2e-3, "{pack} {rays}");
    }
}

#[test]
fn lenses_are_compared_place_by_place() {
    let same = ["lens", "diff", "double-gauss-28", "double-gauss-28", "--json", "--heights", "0,4"];
    let none = json(lenscube(&same));
    assert_eq!(none["largest_psf_l1"], 0.0);
    let largest = none["largest_difference"].as_object().unwrap();
    assert!(largest.len() == 7 && largest.values().all(|v| *v == 0.0), "{largest:?}");
    let words = ["lens", "diff", "double-gauss-28", "double-gauss-28-npz", "--wavelengths", "500,600"];
    // The same prescription through other software, whose PSFs are normalised in 102 µm.
    let other = json(lenscube(&[&words[..], &["--heights", "0,10", "--json"]].concat()));
    let differs = |key: &str| other["largest_difference"][key].as_f64().unwrap();
    assert!(differs("ideal_height_mm") < 1e-4 && differs("relative_illumination") < 1e-4, "{other}");
    assert!(other["largest_psf_l1"].as_f64().unwrap() < 0.02, "{other}");
    let defocused =
        json(lenscube(&[&words[..], &["--heights", "0,10", "--json", "--defocus-mm", "0.05"]].concat()));
    assert!(defocused["largest_psf_l1"].as_f64().unwrap() > 0.1);
    let text = lenscube(&[&words[..], &["--heights", "0,10"]].concat()).ok().stdout;
    assert!(text.contains("largest difference") && text.contains("PSF L1"), "{text}");
    refused(&["lens", "diff", "double-gauss-28-npz", "nowhere.lens.zarr"], FAILED, &["nowhere.lens.zarr"]);
}

/// A design beside a cache of its own.
struct Place {
    dir: tempfile::TempDir,
    design: PathBuf,
}

impl Place {
    fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        let design = dir.path().join("my.zmx");
        fs::write(&design, DESIGN).unwrap();
        Picture::noise(3, Size::new(48, 40), 2).write(&dir.path().join("chart"));
        Self { dir, design }
    }

    fn at(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// A film half a millimetre wide, so that little has to be traced.
    fn run(&self, cache: &str, film: &str, flags: &[&str]) -> Ran {
        let (chart, film) = (self.at("chart"), self.at(film));
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        command.args(["run", text(&chart), text(&film), "--lens", text(&self.design), "--no-fsync"]);
        if !flags.contains(&"--threads") {
            command.args(["--threads", "2"]);
        }
        command.args(["--film-pitch-um", "10"]).args(flags);
        Ran::of(&command.env("XDG_CACHE_HOME", self.at(cache)).output().unwrap())
    }

    fn entries(&self, cache: &str) -> Vec<PathBuf> {
        let dir = self.at(cache).join("lenscube/lenses");
        let mut entries: Vec<_> = fs::read_dir(dir).unwrap().map(|e| e.unwrap().path()).collect();
        entries.sort();
        entries
    }
}

#[test]
fn traced_bands_are_the_same_together_apart_and_kept() {
    let place = Place::new();
    let fresh = place.run("cache", "fresh", &[]).ok();
    assert!(fresh.stderr.contains("2 of 2 bands traced"), "{}", fresh.stderr);
    assert_eq!(place.entries("cache").len(), 2, "two bands, nothing else");
    let kept = place.run("cache", "kept", &[]).ok();
    assert!(!kept.stderr.contains("traced"), "{}", kept.stderr);
    assert!(files(&place.at("fresh")) == files(&place.at("kept")));
    // Apart, in another cache, on one thread: the same bits of the same bands.
    place.run("other", "first", &["--bands", "0"]).ok();
    assert_eq!(place.entries("other").len(), 1, "only what the chart asks for is traced");
    place.run("other", "second", &["--bands", "1", "--threads", "1"]).ok();
    let both = pixels(&place.at("fresh"), "film").1;
    let (first, second) = (pixels(&place.at("first"), "film").1, pixels(&place.at("second"), "film").1);
    assert!(bits(&both) == bits(&[first, second].concat()));
    let names =
        |cache| place.entries(cache).iter().map(|p| p.file_name().unwrap().to_owned()).collect::<Vec<_>>();
    assert_eq!(names("cache"), names("other"));
}

#[test]
fn damaged_entries_are_traced_again_and_no_cache_is_no_hindrance() {
    let place = Place::new();
    place.run("cache", "fresh", &[]).ok();
    let entry = place.entries("cache")[0].clone();
    let sound = fs::read(&entry).unwrap();
    let mut edited = sound.clone();
    let middle = edited.len() / 2;
    edited[middle] ^= 1;
    for (i, damage) in [&sound[..sound.len() / 2], &edited[..], b""].into_iter().enumerate() {
        fs::write(&entry, damage).unwrap();
        let film = format!("again-{i}");
        let ran = place.run("cache", &film, &[]).ok();
        assert!(
            ran.stderr.contains("damaged") && ran.stderr.contains("1 of 2 bands traced"),
            "{}",
            ran.stderr
        );
        assert!(files(&place.at("fresh")) == files(&place.at(&film)));
        assert!(fs::read(&entry).unwrap() == sound && place.entries("cache").len() == 2);
    }
    // A file lies where the cache should be.
    fs::write(place.at("file"), "").unwrap();
    let ran = place.run("file", "without", &[]).ok();
    assert!(ran.stderr.contains("cannot be kept"), "{}", ran.stderr);
    assert!(files(&place.at("fresh")) == files(&place.at("without")));
}

#[test]
fn a_finite_chart_gets_its_scale_from_the_magnification() {
    let place = Place::new();
    let pack = place.at("near.lens.zarr");
    trace(text(&place.design), &pack, &["--object-distance-mm", "100000"]).ok();
    let magnification = LensPack::open(&pack).unwrap().lens().magnification;
    let chart = place.at("chart");
    let run = |lens: &str, film: &str, flags: &[&str]| {
        let words = ["run", text(&chart), film, "--lens", lens, "--no-fsync", "--bands", "1"];
        lenscube(&[&words[..], &["--film-pitch-um", "10"], flags].concat())
    };
    let film = place.at("film");
    run(text(&pack), text(&film), &["--chart-pitch-mm", "20"]).ok();
    let metadata: Value = serde_json::from_slice(&fs::read(film.join("zarr.json")).unwrap()).unwrap();
    let scale = -magnification * 20.0 / 0.010;
    let text_of = metadata.to_string();
    assert!(text_of.contains(&format!("\"scale\":{{\"x\":{scale},\"y\":{scale}}}")), "{scale}: {text_of}");
    let rows = |n: f64| (n * scale).round() as usize;
    assert_eq!(pixels(&film, "film").0, Size::new(rows(48.0), rows(40.0)));
    let other = place.at("other");
    let bad = |lens: &str, flags: &[&str], words: &[&str]| {
        let ran = run(lens, text(&other), flags);
        assert_eq!(ran.code, USAGE, "{}", ran.stderr);
        assert!(words.iter().all(|w| ran.stderr.contains(w)) && !other.exists(), "{}", ran.stderr);
    };
    let way_out = ["--chart-pitch-mm 20", "infinity", "lenscube lens trace", "--object-distance-mm"];
    bad("double-gauss-28-npz", &["--chart-pitch-mm", "20"], &way_out);
    bad("double-gauss-28", &["--chart-pitch-mm", "20"], &way_out);
    bad(text(&pack), &["--chart-pitch-mm", "20", "--scale", "2"], &["--chart-pitch-mm", "--scale"]);
    bad(text(&pack), &["--chart-pitch-mm", "1e9"], &["magnification", "0.001 to 1000"]);
}

#[test]
fn an_entry_of_another_band_under_this_bands_name_is_traced_again() {
    let place = Place::new();
    // Two processes at once on an empty cache.
    let start = |film: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        let (chart, film) = (place.at("chart"), place.at(film));
        command.args([
            "run",
            text(&chart),
            text(&film),
            "--lens",
            text(&place.design),
            "--film-pitch-um",
            "10",
        ]);
        command
            .args(["--no-fsync", "--threads", "1"])
            .env("XDG_CACHE_HOME", place.at("cache"))
            .spawn()
            .unwrap()
    };
    let both = [start("one"), start("two")];
    both.into_iter().for_each(|mut run| assert!(run.wait().unwrap().success()));
    assert!(files(&place.at("one")) == files(&place.at("two")));
    let entries = place.entries("cache");
    assert_eq!(entries.len(), 2, "{entries:?}");
    let name = |i: usize| entries[i].file_name().unwrap().to_str().unwrap().to_owned();
    let (first, second) = (name(0), name(1));
    // Sound bytes, and a name that tells them, but of the other band.
    let foreign = entries[0].with_file_name(format!("{}{}", &first[..33], &second[33..]));
    fs::rename(&entries[0], place.at("aside")).unwrap();
    fs::copy(&entries[1], &foreign).unwrap();
    let ran = place.run("cache", "again", &[]).ok();
    assert!(
        ran.stderr.contains("not traced for this band") && ran.stderr.contains("1 of 2"),
        "{}",
        ran.stderr
    );
    assert!(files(&place.at("one")) == files(&place.at("again")));
    assert_eq!(place.entries("cache"), entries);
    // What is no file is no entry.
    fs::remove_file(&entries[0]).unwrap();
    fs::create_dir(&entries[0]).unwrap();
    let ran = place.run("cache", "aside-dir", &[]).ok();
    assert!(ran.stderr.contains("not a regular file"), "{}", ran.stderr);
}

/// Stops a run after its first shards, changes something, and lets it go on.
fn changed_meanwhile(film: &Path, command: &mut Command, change: impl FnOnce()) -> Ran {
    let child = command.env("LENSCUBE_FAULT", "write:12:stop").stderr(std::process::Stdio::piped());
    let mut run = common::place::Stopped(child.stdout(std::process::Stdio::null()).spawn().unwrap());
    assert!(run.wait_stopped(), "the run ended before its first shards");
    assert!(film.exists());
    change();
    run.go_on()
}

#[test]
fn a_design_that_changes_during_the_run_is_an_error() {
    let place = Place::new();
    let film = place.at("film");
    let chart = place.at("chart");
    let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
    command.args(["run", text(&chart), text(&film), "--lens", text(&place.design), "--film-pitch-um", "10"]);
    command
        .args(["--threads", "2", "--shard", "16", "--chunk", "16"])
        .env("XDG_CACHE_HOME", place.at("cache"));
    let ran = changed_meanwhile(&film, &mut command, || {
        fs::write(&place.design, format!("{DESIGN}\nNOTE 0 another focus\n")).unwrap();
    });
    assert_eq!(ran.code, FAILED, "{}", ran.stderr);
    assert!(ran.stderr.contains("my.zmx: the design changed"), "{}", ran.stderr);
}

#[test]
fn a_pack_that_changes_during_the_run_is_an_error_and_is_not_mixed() {
    use common::{identity_band, lens, scattered, write_pack};
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    Picture::noise(11, Size::new(90, 100), 2).write(&at("chart"));
    let tables = lens([450.0, 500.0].map(|nm| identity_band(nm, 1.0, 5)).into());
    let pack = |path: &Path, seed: u64| {
        write_pack(path, &tables, tables.bands.iter().zip(seed..).map(|(b, s)| scattered(s, b)).collect());
    };
    for ending in ["lens.zarr", "lens.zip"] {
        let (used, other, film) =
            (at(&format!("a.{ending}")), at(&format!("b.{ending}")), at(&format!("film.{ending}")));
        pack(&used, 1);
        pack(&other, 7);
        let chart = at("chart");
        let command = || {
            let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
            command.args(["run", text(&chart), text(&film), "--lens", text(&used), "--no-fsync"]);
            command.args(["--threads", "1", "--shard", "32", "--chunk", "32"]);
            command
        };
        let ran = changed_meanwhile(&film, &mut command(), || {
            fs::rename(&used, at("old")).unwrap();
            fs::rename(&other, &used).unwrap();
        });
        assert_eq!(ran.code, FAILED, "{ending}: {}", ran.stderr);
        assert!(ran.stderr.contains("the lens pack changed"), "{ending}: {}", ran.stderr);
        // What there is of the film is of the lens that the job began with.
        let mixed = files(&film);
        let whole = at("whole");
        let old = at("old");
        let words = ["run", text(&chart), text(&whole), "--lens", text(&old), "--no-fsync"];
        lenscube(&[&words[..], &["--shard", "32", "--chunk", "32"]].concat()).ok();
        let sound = files(&whole);
        let shards = |p: &&PathBuf| p.starts_with("film/c");
        assert!(
            mixed.keys().any(|p| shards(&p))
                && mixed.iter().filter(|(p, _)| shards(p)).all(|(p, b)| sound[p] == *b)
        );
        // Touched, and the same: no error.
        fs::remove_dir_all(&film).unwrap();
        let ran = changed_meanwhile(&film, &mut command(), || {
            let file = if used.is_dir() { used.join("psf/1/zarr.json") } else { used.clone() };
            fs::write(&file, fs::read(&file).unwrap()).unwrap();
        });
        assert_eq!(ran.code, 0, "{ending}: {}", ran.stderr);
        for path in [film, whole] {
            fs::remove_dir_all(path).unwrap();
        }
        let _ = fs::remove_dir_all(at("old")).or_else(|_| fs::remove_file(at("old")));
    }
}
