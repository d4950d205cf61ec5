//! Flags of tracing, and what is said before and after it.

use super::*;

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
