//! What `run` prints before and after a film: amount of output, size of the chart on the film, forecast; and `--fit`.

use crate::common::{
    CommandResult, assert_error_line, assert_exit, bits, identity_band, lens, pixels, run, scattered, text,
    write_pack,
};
use std::path::PathBuf;

const CHART: &str = "gen:checker?size=64&wavelengths=450&pitch_um=2&overscan=0";

struct Job {
    dir: tempfile::TempDir,
    pack: PathBuf,
}

impl Job {
    /// With a lens to 0.5 mm whose PSF windows hold `energy` of the light.
    fn new(energy: f64) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let pack = dir.path().join("pack.lens.zarr");
        let mut lens = lens(vec![identity_band(450.0, 0.5, 5)]);
        lens.bands[0].psf_energy.fill(energy);
        let stack = scattered(1, &lens.bands[0]);
        write_pack(&pack, &lens, vec![stack]);
        Self { dir, pack }
    }

    fn film(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn run(&self, film: &str, flags: &[&str]) -> CommandResult {
        run(CHART, &self.film(film), text(&self.pack), &[&["--device", "cpu"], flags].concat())
    }
}

#[test]
fn default_output_is_three_lines_and_quiet_none() {
    let job = Job::new(1.0);
    let ran = job.run("default.zarr", &[]).ok();
    let lines: Vec<&str> = ran.stderr.lines().filter(|l| !l.starts_with("--no-fsync")).collect();
    assert_eq!(lines.len(), 3, "{}", ran.stderr);
    assert!(lines[0].starts_with("test: 1 band, film 64x64 px of 2 µm"), "{}", ran.stderr);
    assert!(
        lines[1].starts_with("chart of 64x64 px: 0.128 x 0.128 mm, 0.147 x 0.147 degrees; "),
        "{}",
        ran.stderr
    );
    assert!(lines[1].ends_with("of the lens's field of 1.00 mm diameter"), "{}", ran.stderr);
    assert!(lines[2].starts_with("1 shard in ") && lines[2].contains(" kB written"), "{}", ran.stderr);
    assert_eq!(job.run("quiet.zarr", &["-q", "--progress", "bar"]).ok().stderr, "");
    let error = job.run("default.zarr", &["-q", "--gain"]);
    assert_exit(&error, 2, &["--gain"]);
    let ran = job.run("verbose.zarr", &["--verbose", "--progress", "plain"]).ok();
    assert!(
        ["memory limit", "core seconds", "peak memory"].iter().all(|w| ran.stderr.contains(w)),
        "{}",
        ran.stderr
    );
    assert_exit(&job.run("both.zarr", &["-q", "-v"]), 2, &["cannot be used with"]);
}

#[test]
fn film_beyond_the_chart_is_noted_with_its_share() {
    let job = Job::new(1.0);
    let ran = job.run("film.zarr", &["--film-size", "128x128"]).ok();
    let note = "75 % of the film lies beyond the chart and shows the chart's edge pixels";
    assert!(ran.stderr.contains(note) && ran.stderr.contains("--fit contain"), "{}", ran.stderr);
    let ran = job.run("roi.zarr", &["--film-size", "128x128", "--roi", "40,40,48,48"]).ok();
    assert!(!ran.stderr.contains("beyond the chart"), "{}", ran.stderr);
}

#[test]
fn fit_scales_the_chart_to_the_film_or_the_field() {
    let job = Job::new(1.0);
    let bits_of = |film: &str| bits(&pixels(&job.film(film), "film").1);
    let size = ["--film-size", "128x96"];
    for (fit, scale) in
        [("width", "2"), ("height", "1.5"), ("contain", "1.5"), ("diagonal", "1.7677669529663689")]
    {
        job.run(fit, &[&size[..], &["--fit", fit]].concat()).ok();
        let given = format!("{fit}-given");
        job.run(&given, &[&size[..], &["--scale", scale]].concat()).ok();
        assert!(bits_of(fit) == bits_of(&given), "{fit}");
    }
    // The field has 0.25 mm radius: 0.5 mm / (64 √2 · 2 µm) = 2.762.
    let ran = job.run("field", &["--fit", "diagonal"]).ok();
    assert!(ran.stderr.contains("film 177x177 px") && ran.stderr.contains("at 50 % of"), "{}", ran.stderr);
    assert_error_line(&job.run("no", &["--fit", "width"]), 2, &["--fit width", "--film-size"]);
    assert_exit(&job.run("no", &["--fit", "width", "--scale", "2"]), 2, &["cannot be used with"]);
}

#[test]
fn pitch_given_in_mm_is_a_usage_error_with_the_likely_unit() {
    let wide = Job::new(1.0);
    let flags = ["--film-pitch-um", "0.005"];
    let words = ["window covers", "meant in mm", "--film-pitch-um 5"];
    assert_error_line(&wide.run("film.zarr", &flags), 2, &words);
    let dark = Job::new(0.02);
    let words = ["450 nm", "only 2.0 % of the light", "--film-pitch-um 5"];
    let flags = ["--film-pitch-um", "0.005", "--psf-window", "5"];
    assert_error_line(&dark.run("film.zarr", &flags), 2, &words);
    assert!(!dark.film("film.zarr").exists());
    assert_error_line(&dark.run("film.zarr", &[]), 2, &["only 2.0 %", "wider windows"]);
    dark.run("film.zarr", &["--stages", "ri"]).ok();
}

#[test]
fn dry_run_prints_the_forecast_and_writes_nothing() {
    let job = Job::new(1.0);
    let ran = job.run("film.zarr", &["--dry-run"]).ok();
    for words in
        ["lens    test: 1 band", "1 of 1 shards, film of 64x64 px", "disk  ", "core with AVX-512", "memory  "]
    {
        assert!(ran.stdout.contains(words), "{words}: {}", ran.stdout);
    }
    assert!(!job.film("film.zarr").exists());
    job.run("film.zarr", &[]).ok();
    assert!(job.run("film.zarr", &["--dry-run"]).ok().stdout.contains(" 0 of 1 shards"));
    assert_error_line(&job.run("film.zarr", &["--dry-run", "--scale", "0.5"]), 3, &["another job"]);
}

#[test]
fn film_larger_than_the_disk_is_refused_before_it_is_created_unless_forced() {
    let job = Job::new(1.0);
    // 1.4 TB.
    let huge = ["--film-size", "600000x600000", "--outside", "clamp", "--codec", "none", "--shard", "512"];
    let words = ["the disk is too small: the film has 1440.00 GB", "--force"];
    assert_error_line(&job.run("film.zarr", &[&huge[..], &["--dry-run"]].concat()), 75, &words);
    assert_error_line(&job.run("film.zarr", &huge), 75, &words);
    job.run("film.zarr", &[&huge[..], &["--dry-run", "--force"]].concat()).ok();
}

#[test]
fn film_and_status_name_chart_and_lens_and_the_record_has_the_command_line() {
    let job = Job::new(1.0);
    job.run("film.zarr", &[]).ok();
    let film = job.film("film.zarr");
    let metadata: serde_json::Value =
        serde_json::from_slice(&std::fs::read(film.join("zarr.json")).unwrap()).unwrap();
    let found = metadata.pointer("/attributes/provenance/source").expect("provenance");
    assert_eq!((&found["chart"], &found["chart_px"]["x"]), (&CHART.into(), &64.into()));
    let status = crate::common::lenscube(&["status", text(&film)]).ok();
    let line = format!("source  chart {CHART} of 64x64 px");
    assert!(status.stdout.contains(&line) && status.stdout.contains("pack.lens.zarr"), "{}", status.stdout);
    let record = std::fs::read_dir(film.join("runs")).unwrap().map(|e| e.unwrap().path());
    let record = record.into_iter().find(|p| p.extension().is_some_and(|e| e == "json")).expect("a record");
    let text = std::fs::read_to_string(record).unwrap();
    assert!(text.contains("command_line") && text.contains("gen:checker"), "{text}");
}

#[test]
fn cache_of_traced_lenses_is_shown_trimmed_and_cleared() {
    let dir = tempfile::tempdir().unwrap();
    let lenses = dir.path().join("lenscube/lenses");
    let cache = |words: &[&str]| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_lenscube"));
        CommandResult::new(
            &command.arg("cache").args(words).env("XDG_CACHE_HOME", dir.path()).output().unwrap(),
        )
        .ok()
        .stdout
    };
    assert!(cache(&[]).contains("0 traced bands, 0.0 MB"));
    std::fs::create_dir_all(&lenses).unwrap();
    let old = std::time::SystemTime::now() - std::time::Duration::from_secs(1000);
    for name in ["a.lens.zip", "b.lens.zip", "b.nodes.json", "other.txt"] {
        let path = lenses.join(name);
        std::fs::write(&path, vec![0; 1_000_000]).unwrap();
        if name == "a.lens.zip" {
            let times = std::fs::FileTimes::new().set_accessed(old).set_modified(old);
            std::fs::File::options().write(true).open(&path).unwrap().set_times(times).unwrap();
        }
    }
    assert!(cache(&["show"]).contains("2 traced bands, depth nodes of 1 band, 3.0 MB"));
    assert!(cache(&["trim"]).contains("removed: 0 traced bands, 0.0 MB"));
    assert!(
        cache(&["trim", "--limit", "2500kB"])
            .contains("1 traced band, depth nodes of 1 band, 2.0 MB\nremoved: 1 traced band, 1.0 MB")
    );
    assert!(lenses.join("b.lens.zip").exists() && !lenses.join("a.lens.zip").exists());
    assert!(
        cache(&["clear"])
            .contains("0 traced bands, 0.0 MB\nremoved: 1 traced band, depth nodes of 1 band, 2.0 MB")
    );
    assert!(!lenses.join("b.nodes.json").exists());
    assert!(lenses.join("other.txt").exists());
}
