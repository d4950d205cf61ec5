//! Plans: the same film from any units, in any order, repeated or killed; and rejection of inputs that differ from the plan.

mod files;
mod workers;

use crate::common::test_job::{StoppedRun, TestJob};
use crate::common::{CommandResult, Noise, files, lenscube, text};
use pipeline::geometry::Size;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

const RETRY: i32 = 75;
const OTHER_JOB: i32 = 3;
const USAGE: i32 = 2;
const WRONG: i32 = 4;

/// A directory with a plan for its film.
struct Planned {
    place: TestJob,
    job: PathBuf,
    plan: Value,
}

impl Planned {
    fn new(place: TestJob, flags: &[&str]) -> Self {
        let job = place.at("job.json");
        let ran =
            CommandResult::new(&place.plan(&place.film, flags).args(["-o", text(&job)]).output().unwrap())
                .ok();
        assert_eq!(ran.stdout.trim(), text(&job), "{}", ran.stderr);
        let plan = serde_json::from_slice(&fs::read(&job).unwrap()).unwrap();
        Self { place, job, plan }
    }

    fn units(&self) -> usize {
        self.plan["units"].as_array().unwrap().len()
    }

    fn worker(&self, unit: &str, flags: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        command.args(["run", "--plan", text(&self.job), "--unit", unit, "--no-fsync"]).args(flags);
        command
    }

    fn run(&self, unit: &str, flags: &[&str]) -> CommandResult {
        CommandResult::new(&self.worker(unit, flags).output().unwrap())
    }

    /// A worker with the injected fault `fault`.
    fn worker_with_fault(&self, unit: &str, fault: &str) -> Command {
        let mut command = self.worker(unit, &[]);
        command.env("LENSCUBE_FAULT", fault).stdout(Stdio::null()).stderr(Stdio::piped());
        command
    }

    fn missing(&self) -> String {
        lenscube(&["status", "--plan", text(&self.job), "--missing"]).ok().stdout.trim().to_owned()
    }

    /// The files of the film that one process computes without a plan.
    fn single_run(&self, flags: &[&str]) -> std::collections::BTreeMap<PathBuf, Vec<u8>> {
        let film = self.place.at("whole.zarr");
        CommandResult::new(&self.place.command(&film, "", flags).output().unwrap()).ok();
        files(&film)
    }
}

/// Eight rows of eight shards, two bands.
fn place() -> TestJob {
    TestJob::new(Size::new(631, 637), &["--shard", "80", "--chunk", "40"])
}

/// A permutation of `0..n` given by `seed`.
fn shuffled(n: usize, seed: u64) -> Vec<usize> {
    let mut noise = Noise(seed);
    let mut keys: Vec<(u32, usize)> = (0..n).map(|i| (noise.next().to_bits(), i)).collect();
    keys.sort_unstable();
    keys.into_iter().map(|k| k.1).collect()
}

/// Computes all units of a plan, three processes at a time, some units twice, one process killed half-way.
fn compute_units(planned: &Planned, seed: u64) {
    let order = shuffled(planned.units(), seed);
    let killed = planned.worker_with_fault(&order[0].to_string(), "rename:2:kill").output().unwrap();
    assert_eq!(killed.status.code(), None, "killed: {}", String::from_utf8_lossy(&killed.stderr));
    let twice = order.iter().take(4).chain(&order);
    let all: Vec<String> = twice.map(usize::to_string).collect();
    for some in all.chunks(3) {
        let running: Vec<_> = some
            .iter()
            .map(|unit| {
                planned.worker(unit, &[]).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
            })
            .collect();
        for child in running {
            CommandResult::new(&child.wait_with_output().unwrap()).ok();
        }
    }
}

#[test]
fn plan_without_codec_flag_keeps_the_codec_of_its_film() {
    // As written by a version whose default was zstd.
    let planned = Planned::new(TestJob::small(), &["--codec", "zstd"]);
    let plan = fs::read_to_string(&planned.job).unwrap();
    let kept = |line: &&str| !line.contains("--codec=zstd") && !line.starts_with("  \"digest\"");
    let lines: Vec<&str> = plan.lines().filter(kept).collect();
    assert_eq!(lines.len(), plan.lines().count() - 2);
    let plan = format!("{}\n", lines.join("\n"));
    let digest = format!("{{\n  \"digest\": \"{}\",\n", blake3::hash(plan.as_bytes()).to_hex());
    fs::write(&planned.job, plan.replacen("{\n", &digest, 1)).unwrap();
    let all = format!("0-{}", planned.units() - 1);
    planned.run(&all, &[]).ok();
    assert_eq!(planned.missing(), "");
    lenscube(&["verify", text(&planned.place.film)]).ok();
}

#[test]
fn units_of_any_size_in_any_order_give_the_bytes_of_a_single_run() {
    for (flags, units) in [
        (&["--unit-rows", "8"][..], 2),
        (&["--unit-rows", "2", "--bands", "1"], 4),
        (&["--unit-rows", "3"], 6),
        (&["--unit-rows", "1"], 16),
        (&["--units", "3"], 4),
        (&["--unit-rows", "1", "--scatter", "3%,r0=5", "--veiling-glare", "1%"], 16),
        (&[], 2),
    ] {
        let planned = Planned::new(place(), flags);
        assert_eq!(planned.units(), units, "{flags:?}");
        let expected = planned.single_run(
            flags
                .iter()
                .position(|f| ["--bands", "--scatter"].contains(f))
                .map_or(&[][..], |at| &flags[at..]),
        );
        compute_units(&planned, 7 + units as u64);
        assert!(files(&planned.place.film) == expected, "{flags:?}");
        assert_eq!(planned.missing(), "");
        assert!(planned.place.leftover_files().is_empty(), "{:?}", planned.place.leftover_files());
        crate::common::assert_exit(&lenscube(&["verify", text(&planned.place.film)]), 0, &["is correct"]);
    }
}

#[test]
fn units_that_race_for_the_tails_of_a_band_give_the_bytes_of_a_single_run() {
    let planned = Planned::new(place().with_tails(), &["--unit-rows", "1", "--veiling-glare", "1%"]);
    assert_eq!(planned.plan["tail_bins_px"], serde_json::json!([4, 4]));
    let expected = planned.single_run(&["--veiling-glare", "1%"]);
    compute_units(&planned, 23);
    assert!(files(&planned.place.film) == expected);
    assert!(planned.place.film.join("veil_tail/c/1/0/0").exists());
}

#[test]
fn units_of_regions_and_bands_give_the_bytes_of_a_single_run() {
    let flags = ["--roi", "5,600,400,31", "--roi", "100,100,200,200", "--roi", "0,0,637,80"];
    let planned = Planned::new(place(), &[&flags[..], &["--unit-rows", "2"]].concat());
    // One, three and one shard rows, in units of two rows, in each of two bands.
    let rows: Vec<String> =
        planned.plan["units"].as_array().unwrap().iter().map(|u| u["rows"].to_string()).collect();
    let band = [r#"{"roi_0":[0,1],"roi_1":[0,1]}"#, r#"{"roi_1":[1,3]}"#, r#"{"roi_2":[0,1]}"#];
    assert_eq!(rows, [band, band].concat());
    let expected = planned.single_run(&flags);
    compute_units(&planned, 3);
    assert!(files(&planned.place.film) == expected);
}

#[test]
fn units_are_given_by_list_or_environment_variable() {
    let planned = Planned::new(place(), &["--unit-rows", "1"]);
    assert_eq!(planned.missing(), "0-15");
    crate::common::assert_exit(&planned.run("3-5,12", &[]), 0, &["32 shards"]);
    assert_eq!(planned.missing(), "0-2,6-11,13-15");
    for (name, value) in [("SLURM_ARRAY_TASK_ID", "0"), ("JOB_COMPLETION_INDEX", "15"), ("MINE", "1-2,6")] {
        let ran = planned.worker(&format!("env:{name}"), &[]).env(name, value).output().unwrap();
        crate::common::assert_exit(&CommandResult::new(&ran), 0, &[]);
    }
    let missing = planned.missing();
    assert_eq!(missing, "7-11,13-14");
    for (unit, words) in [
        ("16", &["no unit 16", "units 0 to 15"][..]),
        ("3-99", &["there is no unit 99"]),
        ("5-3", &["must not exceed the last"]),
        ("seven", &["`seven` is not a unit"]),
        ("env:NOT_SET_HERE", &["NOT_SET_HERE is not set"]),
    ] {
        crate::common::assert_exit(&planned.run(unit, &[]), USAGE, words);
    }
    let ran = planned.worker("env:MINE", &[]).env("MINE", "40").output().unwrap();
    crate::common::assert_exit(
        &CommandResult::new(&ran),
        USAGE,
        &["env:MINE, which is `40`", "there is no unit 40"],
    );
    crate::common::assert_exit(&lenscube(&["run", "--unit", "3", "a", "b"]), USAGE, &["--plan"]);
    crate::common::assert_exit(&planned.run("3", &["--overwrite"]), USAGE, &["--overwrite", "--plan"]);
    let status_with = |flags: &[&str]| lenscube(&[&["status", "--plan", text(&planned.job)], flags].concat());
    crate::common::assert_exit(&status_with(&["--missing", "--check"]), WRONG, &[&missing]);
    crate::common::assert_exit(&status_with(&["--check"]), WRONG, &["units   9 of 16; missing 7-11,13-14"]);
    let status: Value = serde_json::from_str(&status_with(&["--json"]).ok().stdout).unwrap();
    assert_eq!(status["units"], serde_json::json!({ "all": 16, "done": 9, "missing": missing }));
    // The printed list is a valid argument.
    crate::common::assert_exit(&planned.run(&missing, &[]), 0, &[]);
    let done = status_with(&["--missing", "--check"]).ok();
    assert_eq!(done.stdout, "");
    crate::common::assert_exit(&planned.run(&done.stdout, &[]), 0, &["--unit names no unit: nothing to do"]);
    crate::common::assert_exit(&status_with(&["--check"]), 0, &["units   16 of 16"]);
}

#[test]
fn job_of_the_paper_has_31_units_and_more_with_unit_rows() {
    let dir = tempfile::tempdir().unwrap();
    let plan = |name: &str, flags: &[&str]| -> Value {
        let (film, job) = (dir.path().join(format!("{name}.zarr")), dir.path().join(name));
        let words = [
            "plan",
            "gen:composite?size=14141",
            text(&film),
            "--lens",
            "double-gauss-28-npz",
            "-o",
            text(&job),
        ];
        let ran = lenscube(&[&words[..], flags].concat()).ok();
        assert!(ran.stderr.contains("start-up of a worker, measured here"), "{}", ran.stderr);
        serde_json::from_slice(&fs::read(&job).unwrap()).unwrap()
    };
    let whole = plan("whole.json", &[]);
    assert_eq!((whole["units"].as_array().unwrap().len(), &whole["totals"]["tiles_again"]), (31, &0.into()));
    let rows = plan("rows.json", &["--unit-rows", "1"]);
    let [again, tiles] = ["tiles_again", "tiles"].map(|key| rows["totals"][key].as_f64().unwrap());
    assert_eq!(rows["units"].as_array().unwrap().len(), 31 * 7);
    assert!(again / tiles > 0.1 && again / tiles < 0.3, "{again} of {tiles}");
    // One band is divided as long as at most a tenth of its tiles are computed twice.
    let one = plan("one.json", &["--bands", "15"]);
    let [again, tiles] = ["tiles_again", "tiles"].map(|key| one["totals"][key].as_f64().unwrap());
    assert!(
        one["units"].as_array().unwrap().len() == 1 || (again > 0.0 && again / tiles <= 0.1),
        "{again} of {tiles}"
    );
}

/// Traced bands from the plan's cache, from another cache, or from the pack written by the plan give the same film.
#[test]
fn design_gives_the_same_film_from_shared_cache_separate_cache_or_lens_pack() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    fs::write(at("my.zmx"), include_str!("../../formats/data/lenses/double-gauss-28.zmx")).unwrap();
    crate::common::Picture::noise(3, Size::new(48, 40), 2).write(&at("chart"));
    let with = |cache: &str, words: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        command.args(words).env("XDG_CACHE_HOME", at(cache)).current_dir(dir.path());
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    };
    let run = |cache: &str, words: &[&str]| CommandResult::new(&with(cache, words).output().unwrap());
    let job = ["--lens", "my.zmx", "--film-pitch-um", "10", "--no-fsync", "--shard", "32", "--chunk", "32"];
    let of = |words: &[&'static str]| [words, &job].concat();
    run("home", &of(&["run", "chart", "whole"])).ok();
    run("home", &of(&["plan", "chart", "film", "-o", "job.json", "--unit-rows", "2"])).ok();
    let entries = |cache: &str| fs::read_dir(at(cache).join("lenscube/lenses")).map_or(0, Iterator::count);
    assert_eq!(entries("home"), 2);
    let shared = run("home", &["run", "--plan", "job.json", "--unit", "0", "-v"]).ok();
    assert!(!shared.stderr.contains("traced"), "{}", shared.stderr);
    // Two workers trace the same band into one cache, which then contains that band alone.
    let unit_1 = ["run", "--plan", "job.json", "--unit", "1"];
    let both = [0, 1].map(|_| with("other", &unit_1).spawn().unwrap());
    for child in both {
        CommandResult::new(&child.wait_with_output().unwrap()).ok();
    }
    assert_eq!(entries("other"), 1);
    assert!(files(&at("film")) == files(&at("whole")));
    // With a pack no cache is used.
    let packed = of(&["plan", "chart", "packed", "-o", "packed.json", "--lens-pack", "my.lens.zip"]);
    run("home", &packed).ok();
    run("home", &packed).ok();
    fs::remove_file(at("my.zmx")).unwrap();
    let ran = run("none", &["run", "--plan", "packed.json"]).ok();
    assert!(!ran.stderr.contains("trac") && entries("none") == 0, "{}", ran.stderr);
    let pixels = |film: &str| crate::common::bits(&crate::common::pixels(&at(film), "film").1);
    assert!(pixels("packed") == pixels("whole"));
    // Another design of the same name.
    let design = include_str!("../../formats/data/lenses/double-gauss-28.zmx").replacen(
        "8.746657850000",
        "8.756657850000",
        1,
    );
    fs::write(at("my.zmx"), design).unwrap();
    fs::remove_dir_all(at("film/film/c/0")).unwrap();
    crate::common::assert_exit(
        &run("home", &["run", "--plan", "job.json", "--unit", "0"]),
        OTHER_JOB,
        &["lens_digest"],
    );
}
