//! Runs whose lens is a design: cache of traced bands, scale, changes during the run.

use super::*;

/// Design file, chart and caches of traced bands.
pub(super) struct DesignJob {
    dir: tempfile::TempDir,
    design: PathBuf,
}

impl DesignJob {
    pub(super) fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        let design = dir.path().join("my.zmx");
        fs::write(&design, DESIGN).unwrap();
        Picture::noise(3, Size::new(48, 40), 2).write(&dir.path().join("chart"));
        Self { dir, design }
    }

    pub(super) fn at(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// Runs with a film half a millimetre wide, so that few PSFs are traced.
    pub(super) fn run(&self, cache: &str, film: &str, flags: &[&str]) -> CommandResult {
        let (chart, film) = (self.at("chart"), self.at(film));
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        command.args(["run", text(&chart), text(&film), "--no-fsync"]);
        if !flags.contains(&"--lens") {
            command.args(["--lens", text(&self.design)]);
        }
        if !flags.contains(&"--threads") {
            command.args(["--threads", "2"]);
        }
        if !flags.contains(&"--film-pitch-um") {
            command.args(["--film-pitch-um", "10"]);
        }
        command.args(flags);
        CommandResult::new(&command.env("XDG_CACHE_HOME", self.at(cache)).output().unwrap())
    }

    fn entries(&self, cache: &str) -> Vec<PathBuf> {
        let dir = self.at(cache).join("lenscube/lenses");
        let mut entries: Vec<_> = fs::read_dir(dir).unwrap().map(|e| e.unwrap().path()).collect();
        entries.sort();
        entries
    }
}

#[test]
fn traced_bands_are_equal_in_one_run_in_two_runs_and_from_the_cache() {
    let job = DesignJob::new();
    let fresh = job.run("cache", "fresh", &["-v"]).ok();
    assert!(fresh.stderr.contains("2 of 2 bands traced"), "{}", fresh.stderr);
    assert_eq!(job.entries("cache").len(), 2, "two bands, nothing else");
    let kept = job.run("cache", "kept", &["-v"]).ok();
    assert!(!kept.stderr.contains("traced"), "{}", kept.stderr);
    assert!(files(&job.at("fresh")) == files(&job.at("kept")));
    // In two runs with another cache, one of them on one thread.
    job.run("other", "first", &["--bands", "0"]).ok();
    assert_eq!(job.entries("other").len(), 1, "only the bands of the chart are traced");
    job.run("other", "second", &["--bands", "1", "--threads", "1"]).ok();
    let both = pixels(&job.at("fresh"), "film").1;
    let (first, second) = (pixels(&job.at("first"), "film").1, pixels(&job.at("second"), "film").1);
    assert!(bits(&both) == bits(&[first, second].concat()));
    let names =
        |cache| job.entries(cache).iter().map(|p| p.file_name().unwrap().to_owned()).collect::<Vec<_>>();
    assert_eq!(names("cache"), names("other"));
}

/// Attributes of a film.
pub(super) fn attributes(film: &Path) -> Value {
    let text = fs::read_to_string(film.join("zarr.json")).unwrap();
    serde_json::from_str::<Value>(&text).unwrap()["attributes"].clone()
}

#[test]
fn film_beside_another_has_its_lens_and_its_pixels() {
    let job = DesignJob::new();
    // The chart lies about the axis, which is 6 px farther to the right and 5 px farther down on the second film.
    let film = |name: &str, flags: &[&str]| {
        job.run("cache", name, &[&["--bands", "0", "--surround", "black"], flags].concat()).ok();
        let digest = attributes(&job.at(name))["provenance"]["job"]["lens_digest"].clone();
        assert!(digest.is_string(), "{}", attributes(&job.at(name)));
        (digest, pixels(&job.at(name), "film"))
    };
    let (lens, (size, whole)) = film("whole", &[]);
    let (moved_lens, (moved_size, moved)) = film("moved", &["--film-size", "50x46", "--axis", "25.5,28.5"]);
    assert_eq!(lens, moved_lens);
    assert_eq!(job.entries("cache").len(), 1, "both films have the bands of the lens");
    let peak = whole[0].iter().fold(0f32, |a, v| a.max(*v));
    for y in 0..size.height.min(moved_size.height - 5) {
        for x in 0..size.width {
            let (a, b) = (whole[0][y * size.width + x], moved[0][(y + 5) * moved_size.width + x + 6]);
            // Bins of tails begin at the corner of the film.
            assert!((a - b).abs() <= 4e-6 * peak, "({x}, {y}): {a} and {b} of {peak}");
        }
    }
}

#[test]
fn bands_of_coarse_pixels_are_traced_for_them() {
    let job = DesignJob::new();
    // Out of focus at 2.3 µm: no window of 401 pixels of 2 µm holds the light.
    let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
    command.args(["run", "gen:uniform?size=24&wavelengths=2300", text(&job.at("film")), "--no-fsync"]);
    command.args(["--threads", "2", "--lens", "double-gauss-28", "--film-pitch-um", "20"]);
    CommandResult::new(&command.env("XDG_CACHE_HOME", job.at("cache")).output().unwrap()).ok();
    // Uniform but for relative illumination.
    let film = pixels(&job.at("film"), "film").1.concat();
    let (least, most) = film.iter().fold((f32::MAX, 0f32), |(a, z), v| (a.min(*v), z.max(*v)));
    assert!(least > 0.0 && most < 1.001 * least, "{least} to {most}");
    let packs: Vec<LensPack> =
        job.entries("cache").iter().map(|path| LensPack::open(path).unwrap()).collect();
    for pack in &packs {
        let source = pack.attributes().source.clone().unwrap();
        assert_eq!(source["film_pitch_um"], 20.0, "{source}");
    }
    // Traced again where its window, which has to be clear of the blur, needs more of the lens.
    assert!((1..=2).contains(&packs.len()), "{}", packs.len());
}

#[test]
fn wide_psfs_are_cached_as_pupil_functions_and_give_the_same_film() {
    let job = DesignJob::new();
    let run = |film: &str| {
        let flags = ["-v", "--bands", "0", "--lens", "cine-petzval", "--film-pitch-um", "2"];
        job.run("cache", film, &flags).ok()
    };
    assert!(run("fresh").stderr.contains("1 of 1 bands traced"));
    let entries = job.entries("cache");
    let sizes: Vec<u64> = entries.iter().map(|path| fs::metadata(path).unwrap().len()).collect();
    assert!(sizes.len() == 1 && sizes[0] < 1_000_000, "{sizes:?}");
    let cached = LensPack::open(&entries[0]).unwrap();
    let psfs = cached.psf(0).unwrap();
    assert!(cached.has_pupils() && 4 * psfs.samples.len() > 32_000_000, "{} samples", psfs.samples.len());
    assert!(!run("kept").stderr.contains("traced"));
    assert!(files(&job.at("fresh")) == files(&job.at("kept")));
}

#[test]
fn film_of_a_pack_with_pupil_functions_is_that_of_the_pack_with_their_psfs() {
    let job = DesignJob::new();
    let film = |lens: &str, film: &str| {
        let words = ["run", text(&job.at("chart")), text(&job.at(film)), "--lens", text(&job.at(lens))]
            .map(str::to_owned);
        let words: Vec<&str> = words.iter().map(String::as_str).collect();
        lenscube(&[&words[..], &["--film-pitch-um", "10", "--no-fsync", "--bands", "1"]].concat())
    };
    for store in ["psfs", "pupils"] {
        trace(text(&job.design), &job.at(&format!("{store}.lens.zarr")), &["--store", store]).ok();
        film(&format!("{store}.lens.zarr"), store).ok();
    }
    assert!(bits(&pixels(&job.at("psfs"), "film").1) == bits(&pixels(&job.at("pupils"), "film").1));
    let size =
        |store: &str| files(&job.at(&format!("{store}.lens.zarr"))).values().map(Vec::len).sum::<usize>();
    assert!(size("pupils") < size("psfs") / 2, "{} and {}", size("pupils"), size("psfs"));
    // The digest of the pack is part of the job.
    film("pupils.lens.zarr", "pupils").ok();
    assert_exit(&film("psfs.lens.zarr", "pupils"), OTHER_JOB, &["belongs to another job", "lens"]);
    let shown = lenscube(&["lens", "show", text(&job.at("pupils.lens.zarr")), "--json"]).ok();
    assert!(shown.stdout.contains("\"stored\": \"pupil functions\""), "{}", shown.stdout);
    let out = job.at("depth.lens.zarr");
    let depth = ["--focus-m", "2", "--depths-m", "1:inf", "--store", "pupils"];
    assert_exit(&trace(text(&job.design), &out, &depth), USAGE, &["--store", "--depths-m"]);
}

#[test]
fn damaged_cache_entry_is_traced_again_and_unwritable_cache_is_a_note() {
    let job = DesignJob::new();
    job.run("cache", "fresh", &[]).ok();
    let entry = job.entries("cache")[0].clone();
    let sound = fs::read(&entry).unwrap();
    let mut edited = sound.clone();
    let middle = edited.len() / 2;
    edited[middle] ^= 1;
    for (i, damage) in [&sound[..sound.len() / 2], &edited[..], b""].into_iter().enumerate() {
        fs::write(&entry, damage).unwrap();
        let film = format!("again-{i}");
        let ran = job.run("cache", &film, &["-v"]).ok();
        assert!(
            ran.stderr.contains("damaged") && ran.stderr.contains("1 of 2 bands traced"),
            "{}",
            ran.stderr
        );
        assert!(files(&job.at("fresh")) == files(&job.at(&film)));
        assert!(fs::read(&entry).unwrap() == sound && job.entries("cache").len() == 2);
    }
    // A file at the path of the cache directory.
    fs::write(job.at("file"), "").unwrap();
    let ran = job.run("file", "without", &[]).ok();
    assert!(ran.stderr.contains("cannot be stored in the cache"), "{}", ran.stderr);
    assert!(files(&job.at("fresh")) == files(&job.at("without")));
}

#[test]
fn chart_pitch_in_mm_sets_the_scale_by_the_magnification() {
    let job = DesignJob::new();
    let pack = job.at("near.lens.zarr");
    trace(text(&job.design), &pack, &["--object-distance-mm", "100000"]).ok();
    let magnification = LensPack::open(&pack).unwrap().lens().magnification;
    let chart = job.at("chart");
    let run = |lens: &str, film: &str, flags: &[&str]| {
        let words = ["run", text(&chart), film, "--lens", lens, "--no-fsync", "--bands", "1"];
        lenscube(&[&words[..], &["--film-pitch-um", "10"], flags].concat())
    };
    let film = job.at("film");
    run(text(&pack), text(&film), &["--chart-pitch-mm", "20"]).ok();
    let metadata: Value = serde_json::from_slice(&fs::read(film.join("zarr.json")).unwrap()).unwrap();
    let scale = -magnification * 20.0 / 0.010;
    let text_of = metadata.to_string();
    assert!(text_of.contains(&format!("\"scale\":{{\"x\":{scale},\"y\":{scale}}}")), "{scale}: {text_of}");
    let rows = |n: f64| (n * scale).round() as usize;
    assert_eq!(pixels(&film, "film").0, Size::new(rows(48.0), rows(40.0)));
    let other = job.at("other");
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
fn cache_entry_of_another_band_is_traced_again() {
    let job = DesignJob::new();
    // Two concurrent processes with an empty cache.
    let start = |film: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        let (chart, film) = (job.at("chart"), job.at(film));
        command.args([
            "run",
            text(&chart),
            text(&film),
            "--lens",
            text(&job.design),
            "--film-pitch-um",
            "10",
        ]);
        command.args(["--no-fsync", "--threads", "1"]).env("XDG_CACHE_HOME", job.at("cache")).spawn().unwrap()
    };
    let both = [start("one"), start("two")];
    both.into_iter().for_each(|mut run| assert!(run.wait().unwrap().success()));
    assert!(files(&job.at("one")) == files(&job.at("two")));
    let entries = job.entries("cache");
    assert_eq!(entries.len(), 2, "{entries:?}");
    let name = |i: usize| entries[i].file_name().unwrap().to_str().unwrap().to_owned();
    let (first, second) = (name(0), name(1));
    // A valid entry of another band under the name of this band.
    let foreign = entries[0].with_file_name(format!("{}{}", &first[..33], &second[33..]));
    fs::rename(&entries[0], job.at("aside")).unwrap();
    fs::copy(&entries[1], &foreign).unwrap();
    let ran = job.run("cache", "again", &["-v"]).ok();
    assert!(
        ran.stderr.contains("not traced for this band") && ran.stderr.contains("1 of 2"),
        "{}",
        ran.stderr
    );
    assert!(files(&job.at("one")) == files(&job.at("again")));
    assert_eq!(job.entries("cache"), entries);
    // A directory instead of an entry.
    fs::remove_file(&entries[0]).unwrap();
    fs::create_dir(&entries[0]).unwrap();
    let ran = job.run("cache", "aside-dir", &[]).ok();
    assert!(ran.stderr.contains("not a regular file"), "{}", ran.stderr);
}

/// Stops a run after its first shards, calls `change`, and continues the run to its end.
fn run_with_change_after_first_shards(
    film: &Path,
    command: &mut Command,
    change: impl FnOnce(),
) -> CommandResult {
    let child = command.env("LENSCUBE_FAULT", "write:12:stop").stderr(std::process::Stdio::piped());
    let mut run =
        crate::common::test_job::StoppedRun(child.stdout(std::process::Stdio::null()).spawn().unwrap());
    assert!(run.wait_stopped(), "the run ended before its first shards");
    assert!(film.exists());
    change();
    run.run_to_end()
}

#[test]
fn design_changed_during_the_run_exits_1() {
    let job = DesignJob::new();
    let film = job.at("film");
    let chart = job.at("chart");
    let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
    command.args(["run", text(&chart), text(&film), "--lens", text(&job.design), "--film-pitch-um", "10"]);
    command.args(["--threads", "2", "--shard", "16", "--chunk", "16"]).env("XDG_CACHE_HOME", job.at("cache"));
    let ran = run_with_change_after_first_shards(&film, &mut command, || {
        fs::write(&job.design, format!("{DESIGN}\nNOTE 0 another focus\n")).unwrap();
    });
    assert_eq!(ran.code, FAILED, "{}", ran.stderr);
    assert!(ran.stderr.contains("my.zmx: the design changed"), "{}", ran.stderr);
}

#[test]
fn pack_changed_during_the_run_exits_1_without_mixed_shards() {
    use crate::common::{identity_band, lens, scattered, write_pack};
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
        let ran = run_with_change_after_first_shards(&film, &mut command(), || {
            fs::rename(&used, at("old")).unwrap();
            fs::rename(&other, &used).unwrap();
        });
        assert_eq!(ran.code, FAILED, "{ending}: {}", ran.stderr);
        assert!(ran.stderr.contains("the lens pack changed"), "{ending}: {}", ran.stderr);
        // The shards written are those of the original pack.
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
        // A file rewritten with the same content is not an error.
        fs::remove_dir_all(&film).unwrap();
        let ran = run_with_change_after_first_shards(&film, &mut command(), || {
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

#[test]
fn runs_trace_designs_with_the_flags_of_lens_trace() {
    let job = DesignJob::new();
    let run = |film: &str, flags: &[&str]| job.run("cache", film, &[&["--bands", "0"], flags].concat());
    let digest = |film: &str| attributes(&job.at(film))["provenance"]["job"]["lens_digest"].clone();
    run("standard", &[]).ok();
    run("named", &["--image-plane", "design", "--energy", "0.99"]).ok();
    assert_eq!(digest("standard"), digest("named"), "the defaults, as flags");
    assert_eq!(job.entries("cache").len(), 1);
    run("bright", &["--energy", "0.95"]).ok();
    run("moved", &["--image-plane", "rms"]).ok();
    let other = [digest("standard"), digest("bright"), digest("moved")];
    assert!(other[0] != other[1] && other[1] != other[2] && other[0] != other[2], "{other:?}");
    // A glass of its own, in a catalogue that is not beside the design.
    let own = DESIGN.replace("GLAS N-SK2 ", "GLAS OWN24 ");
    fs::write(job.at("own.zmx"), own).unwrap();
    fs::create_dir(job.at("glasses")).unwrap();
    fs::write(job.at("glasses/mine.agf"), "NM OWN24 2 0 1.6 60\nCD 1.55 0.01\nLD 0.3 2.5\n").unwrap();
    let (design, catalogue) = (job.at("own.zmx"), job.at("glasses/mine.agf"));
    assert_exit(&run("own", &["--lens", text(&design)]), FAILED, &["OWN24", "`--glass-catalog FILE.agf`"]);
    run("own", &["--lens", text(&design), "--glass-catalog", text(&catalogue)]).ok();
    let kept = fs::read(&catalogue).unwrap();
    let over = job.run(
        "cache",
        "glasses",
        &["--lens", text(&design), "--glass-catalog", text(&catalogue), "--overwrite"],
    );
    assert_exit(&over, USAGE, &["glass catalogue"]);
    assert_eq!(fs::read(&catalogue).unwrap(), kept);
    let of_pack = run("pack", &["--lens", "double-gauss-28-npz", "--energy", "0.9", "--image-plane", "rms"]);
    assert_exit(&of_pack, USAGE, &["--image-plane and --energy: expected a design", "is a lens pack"]);
}

#[test]
fn errors_of_tracing_name_flags_that_the_command_has() {
    let dir = tempfile::tempdir().unwrap();
    let (film, cache) = (dir.path().join("film"), dir.path().join("cache"));
    // A film 8 mm behind its focus, whose PSFs are wider than any window.
    let out_of_focus = dir.path().join("out.zmx");
    fs::write(&out_of_focus, DESIGN.replace("DISZ 57.314537905000", "DISZ 65.3")).unwrap();
    let chart = "gen:uniform?size=24&wavelengths=550";
    let run = |words: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        CommandResult::new(&command.args(words).env("XDG_CACHE_HOME", &cache).output().unwrap())
    };
    let failed = run(&["run", chart, text(&film), "--lens", text(&out_of_focus), "--film-pitch-um", "2"]);
    assert_exit(&failed, FAILED, &["`--image-plane rms`", "`--energy`", "`--max-window-px`"]);
    let help = run(&["run", "--help"]).stdout;
    let line = failed.stderr.lines().last().unwrap();
    for flag in line.split(|c: char| c.is_whitespace() || "`,();".contains(c)).filter(|w| w.starts_with("--"))
    {
        assert!(help.contains(flag), "run has no {flag}: {line}");
    }
    let report = dir.path().join("report");
    let words = ["validate", "--lens", text(&out_of_focus), "--out", text(&report), "--wavelengths", "550"];
    let failed = run(&[&words[..], &["--size", "4096", "--film-pitch-um", "2"]].concat());
    assert_exit(&failed, FAILED, &["this command has no --", "`lenscube lens trace", "has it"]);
}

#[test]
fn energy_that_windows_miss_is_part_of_the_result() {
    let dir = tempfile::tempdir().unwrap();
    let flags = ["--energy", "0.9999", "--max-window-px", "101"];
    let traced = trace("double-gauss-28", &dir.path().join("p.zarr"), &flags).ok();
    assert!(traced.stderr.contains("(requested 99.99 %, limited by --max-window-px)"), "{}", traced.stderr);
    let kept = trace("double-gauss-28", &dir.path().join("q.zarr"), &[]).ok();
    assert!(kept.stderr.contains("of the light") && !kept.stderr.contains("limited by"), "{}", kept.stderr);
    let job = DesignJob::new();
    let film =
        job.run("cache", "film", &["--bands", "0", "--energy", "0.9999", "--max-window-px", "21"]).ok();
    assert!(film.stderr.contains("of the light (at 450 nm) instead of 99.99 %"), "{}", film.stderr);
}

#[test]
fn what_is_known_before_tracing_is_said_before_it() {
    let job = DesignJob::new();
    job.run("first", "film", &["--bands", "0"]).ok();
    let untouched = |result: &CommandResult, cache: &str| {
        assert!(!result.stderr.contains("tracing the bands"), "{}", result.stderr);
        assert!(!job.at(cache).join("lenscube/lenses").exists(), "{}", result.stderr);
    };
    let other = job.run("second", "film", &["--bands", "0", "--film-pitch-um", "12"]);
    assert_exit(&other, OTHER_JOB, &["belongs to another job: --film-pitch-um (film 10.0, requested 12.0)"]);
    assert!(!other.stderr.contains("outputs"), "{}", other.stderr);
    untouched(&other, "second");
    // Another focus, accuracy, or prescription.
    for (flags, difference) in [
        (&["--focus-m", "2"][..], "--focus-m (film nothing, requested 2)"),
        (&["--energy", "0.95"], "--energy (film nothing, requested 0.95)"),
        (&["--lens", "phone"], "--lens (another prescription)"),
    ] {
        let other = job.run("second", "film", &[&["--bands", "0"], flags].concat());
        assert_exit(
            &other,
            OTHER_JOB,
            &["belongs to another job, with another lens", difference, "--overwrite"],
        );
        untouched(&other, "second");
    }
    let plan = job.at("plan.json");
    let chart = job.at("chart");
    let words = ["plan", text(&chart), text(&job.at("film")), "--film-pitch-um", "12", "-o", text(&plan)]
        .map(str::to_owned);
    let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
    command.args(words).args(["--lens", text(&job.design), "--bands", "0"]);
    let planned = CommandResult::new(&command.env("XDG_CACHE_HOME", job.at("third")).output().unwrap());
    assert_exit(&planned, OTHER_JOB, &["belongs to another job"]);
    untouched(&planned, "third");
    std::fs::write(job.at("file"), "").unwrap();
    let inside = job.run("fourth", "file/film", &["--bands", "0"]);
    assert_exit(&inside, USAGE, &["file is not a directory"]);
    untouched(&inside, "fourth");
    // 7 x 7 km of 10 µm pixels, of which no disk holds a band.
    let wide = ["--film-size", "1000000x1000000", "--dry-run"];
    let full = job.run("fourth", "wide", &wide);
    assert_exit(&full, 75, &["the disk is too small"]);
    untouched(&full, "fourth");
    for (pitch, words) in
        [("0.002", "in mm? Then give `--film-pitch-um 2`"), ("5000", "in nm? Then give `--film-pitch-um 5`")]
    {
        let unit = job.run("fifth", "unit", &["--film-pitch-um", pitch, "--lens", "phone"]);
        assert_exit(&unit, USAGE, &[words]);
        assert!(!job.at("fifth/lenscube/lenses").exists() || job.entries("fifth").is_empty());
    }
    let picture = job.at("picture.png");
    let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
    command.args([
        "shoot",
        text(&chart),
        text(&picture),
        "--lens",
        "phone",
        "--sensor",
        "example-2um",
        "--film-pitch-um",
        "5",
    ]);
    let shot = CommandResult::new(&command.env("XDG_CACHE_HOME", job.at("sixth")).output().unwrap());
    assert_exit(
        &shot,
        USAGE,
        &["sensor pixels of 2 µm on a film of 5 µm", "give `--film-pitch-um 2` or less"],
    );
    untouched(&shot, "sixth");
    assert!(!job.at("picture.png.shot").exists());
}

/// Up to 99.7 % of the field of a lens whose rays are totally reflected a little beyond it: the margin of a band is what the lens passes.
#[test]
fn films_near_the_end_of_the_field_are_traced() {
    let dir = tempfile::tempdir().unwrap();
    for (nm, size) in [(450, "1300x30"), (550, "2110x40")] {
        let (chart, film) =
            (format!("gen:uniform?size={size}&wavelengths={nm}&pitch_um=2"), dir.path().join(size));
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        command.args(["run", &chart, text(&film), "--lens", "phone", "--no-fsync"]);
        let ran =
            CommandResult::new(&command.env("XDG_CACHE_HOME", dir.path().join("cache")).output().unwrap());
        assert_exit(&ran, 0, &[]);
        assert!(!ran.stderr.contains("cannot be stored"), "{}", ran.stderr);
        let (_, bands) = pixels(&film, "film");
        // Relative illumination of the lens: 1 on the axis, 0.6 to 0.8 at 1.3 mm.
        assert!(bands[0].iter().all(|v| (0.3..=1.001).contains(v)));
    }
    let beyond = "gen:uniform?size=1900&wavelengths=550&pitch_um=2";
    let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
    command.args(["run", beyond, text(&dir.path().join("beyond")), "--lens", "phone"]);
    let ran = CommandResult::new(&command.env("XDG_CACHE_HOME", dir.path().join("cache")).output().unwrap());
    assert_exit(&ran, FAILED, &["--film-size", "--outside clamp"]);
}
