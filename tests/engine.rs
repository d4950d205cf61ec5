//! The engine of a film: kept when the film is resumed, changed only with `--mixed-engines`.
//! Tests of two engines are reported as ignored where the CPU has only one.

mod common;

use common::test_job::TestJob;
use common::{CommandResult, files, lenscube, text};
use libtest_mimic::{Arguments, Trial};
use pipeline::simd::{Isa, Simd};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

const USAGE: i32 = 2;
const OTHER_JOB: i32 = 3;
const KILLED: i32 = -1;
/// Fault after some shards.
const MIDWAY: &str = "rename:20:kill";

/// The fastest engine here.
fn fastest() -> &'static str {
    Simd::detect().isa().name()
}

fn run(place: &TestJob, fault: &str, flags: &[&str]) -> CommandResult {
    place.run(fault, &[&["--device", "cpu", "--no-fsync"], flags].concat())
}

/// The files of a film computed by one engine; the film is removed.
fn film_files(place: &TestJob, engine: &str) -> BTreeMap<PathBuf, Vec<u8>> {
    run(place, "", &["--engine", engine]).ok();
    take_files(place)
}

fn take_files(place: &TestJob) -> BTreeMap<PathBuf, Vec<u8>> {
    let found = files(&place.film);
    std::fs::remove_dir_all(&place.film).unwrap();
    found
}

/// Begins a film with the portable engine and kills the run.
fn begin_film(place: &TestJob) {
    let killed = run(place, MIDWAY, &["--engine", "portable"]);
    assert_eq!(killed.code, KILLED, "{}", killed.stderr);
}

fn status(film: &Path) -> Value {
    serde_json::from_str(&lenscube(&["status", text(film), "--json"]).ok().stdout).unwrap()
}

fn resume_uses_the_films_engine_and_logs_it() {
    let place = TestJob::wide();
    let portable = film_files(&place, "portable");
    begin_film(&place);
    let resumed = run(&place, "", &[]);
    common::assert_exit(&resumed, 0, &["resuming", "engine: portable", fastest()]);
    assert_eq!(status(&place.film)["engines"], serde_json::json!(["portable"]));
    assert!(take_files(&place) == portable, "other bits after resuming");
    assert!(
        film_files(&place, fastest()) != portable,
        "the engines do not differ, so the test shows nothing"
    );
}

fn another_engine_exits_3_and_names_both() {
    let place = TestJob::wide();
    begin_film(&place);
    let before = files(&place.film);
    let other = run(&place, "", &["--engine", fastest()]);
    common::assert_exit(
        &other,
        OTHER_JOB,
        &["created with engine portable", fastest(), "--mixed-engines", "--overwrite"],
    );
    assert!(files(&place.film) == before, "a rejected run has changed the film");
    run(&place, "", &["--engine", fastest(), "--overwrite"]).ok();
    assert_eq!(status(&place.film)["engine"], fastest());
    // All shards are present, but of another engine than requested.
    common::assert_exit(&run(&place, "", &["--engine", "portable"]), OTHER_JOB, &[fastest(), "portable"]);
    common::assert_exit(&run(&place, "", &[]), 0, &["nothing to do"]);
}

fn mixed_engines_are_recorded_before_the_first_shard() {
    let place = TestJob::wide();
    begin_film(&place);
    let mixed = ["--engine", fastest(), "--mixed-engines"];
    let killed = run(&place, "rename:3:kill", &mixed);
    assert_eq!(killed.code, KILLED, "{}", killed.stderr);
    let both = serde_json::json!(["portable", fastest()]);
    assert_eq!(status(&place.film)["engines"], both);
    common::assert_exit(&run(&place, "", &mixed), 0, &["created with engine portable", "--mixed-engines"]);
    assert_eq!(status(&place.film)["engines"], both);
    let verified = lenscube(&["verify", text(&place.film)]);
    common::assert_exit(&verified, 0, &["several engines", "portable", fastest()]);
    assert!(lenscube(&["status", text(&place.film)]).stdout.contains("engines portable,"));
}

fn film_of_mixed_engines_is_overwritten() {
    let place = TestJob::wide();
    let expected = film_files(&place, fastest());
    begin_film(&place);
    run(&place, "", &["--engine", fastest(), "--mixed-engines"]).ok();
    let mark = place.film.join(format!("runs/{}.engine", fastest()));
    assert!(mark.exists(), "no mark of the second engine");
    run(&place, "", &["--engine", fastest(), "--overwrite"]).ok();
    assert!(!mark.exists() && status(&place.film)["engines"] == serde_json::json!([fastest()]));
    assert!(take_files(&place) == expected, "other files than those of a new film");
}

fn film_without_recorded_engine_exits_3_unless_mixed() {
    let place = TestJob::wide();
    begin_film(&place);
    let metadata = place.film.join("zarr.json");
    let mut group: Value = serde_json::from_slice(&std::fs::read(&metadata).unwrap()).unwrap();
    let removed = group["attributes"]["provenance"].as_object_mut().unwrap().remove("engine");
    assert_eq!(removed, Some("portable".into()));
    std::fs::write(&metadata, serde_json::to_vec(&group).unwrap()).unwrap();
    common::assert_exit(&run(&place, "", &[]), OTHER_JOB, &["does not record the engine", "--mixed-engines"]);
    run(&place, "", &["--mixed-engines"]).ok();
    assert_eq!(status(&place.film)["engines"], serde_json::json!(["unknown", fastest()]));
}

fn workers_use_the_plans_engine() {
    let place = TestJob::wide();
    let portable = film_files(&place, "portable");
    let plan = place.at("job.json");
    let flags = ["--device", "cpu", "--no-fsync", "--engine", "portable", "-o", text(&plan)];
    CommandResult::new(&place.plan(&place.film, &flags).output().unwrap()).ok();
    let planned: Value = serde_json::from_slice(&std::fs::read(&plan).unwrap()).unwrap();
    assert_eq!(planned["engine"], "portable");
    let unit = |flags: &[&str]| lenscube(&[&["run", "--plan", text(&plan)], flags].concat());
    common::assert_exit(
        &unit(&["--engine", fastest()]),
        OTHER_JOB,
        &["created with engine portable", fastest()],
    );
    unit(&[]).ok();
    assert!(take_files(&place) == portable, "other bits by workers");
}

/// A plan for GPUs can be made without one; its workers need one.
fn worker_without_gpu_rejects_a_plan_for_gpus() {
    let place = TestJob::wide();
    let plan = place.at("job.json");
    let flags = ["--no-fsync", "--engine", "cuda-sm_90", "-o", text(&plan)];
    CommandResult::new(&place.plan(&place.film, &flags).output().unwrap()).ok();
    assert_eq!(status(&place.film)["engine"], "cuda-sm_90");
    let worker = lenscube(&["run", "--plan", text(&plan)]);
    common::assert_exit(&worker, USAGE, &["--engine cuda-sm_90", "no NVIDIA driver"]);
}

fn contradicting_or_unknown_engine_exits_2() {
    let place = TestJob::wide();
    common::assert_exit(&run(&place, "", &["--engine", "cuda-sm_90"]), USAGE, &["contradict"]);
    common::assert_exit(
        &run(&place, "", &["--engine", "sse"]),
        USAGE,
        &["expected auto, avx512, avx2, portable"],
    );
    let cuda = place.run("", &["--device", "cuda", "--engine", "portable"]);
    common::assert_exit(&cuda, USAGE, &["contradict"]);
    assert!(!place.film.exists());
}

fn engine_not_supported_by_the_cpu_exits_2_and_names_the_fastest() {
    let lacking = Isa::ALL.into_iter().find(|isa| !isa.is_available()).unwrap().name();
    let place = TestJob::wide();
    common::assert_exit(&run(&place, "", &["--engine", lacking]), USAGE, &[lacking, "the fastest it has is"]);
    assert!(!place.film.exists());
}

/// Name, test, and reason if it cannot run here.
type Check = (&'static str, fn(), Option<&'static str>);

fn main() -> ExitCode {
    // The reasons are those that scripts/check_summary.py accepts.
    let when = |lacking: bool, why: &'static str| lacking.then_some(why);
    let one = when(Simd::detect() == Simd::PORTABLE, "one instruction set");
    let all = when(Isa::ALL.into_iter().all(Isa::is_available), "every instruction set is there");
    let no_driver = matches!(pipeline::cuda::devices(), Err(pipeline::cuda::CudaError::NoDriver));
    let driver = when(!no_driver, "a CUDA driver is installed");
    let checks: [Check; 9] = [
        ("resume_uses_the_films_engine_and_logs_it", resume_uses_the_films_engine_and_logs_it, one),
        ("another_engine_exits_3_and_names_both", another_engine_exits_3_and_names_both, one),
        (
            "mixed_engines_are_recorded_before_the_first_shard",
            mixed_engines_are_recorded_before_the_first_shard,
            one,
        ),
        ("film_of_mixed_engines_is_overwritten", film_of_mixed_engines_is_overwritten, one),
        (
            "film_without_recorded_engine_exits_3_unless_mixed",
            film_without_recorded_engine_exits_3_unless_mixed,
            None,
        ),
        ("workers_use_the_plans_engine", workers_use_the_plans_engine, one),
        ("worker_without_gpu_rejects_a_plan_for_gpus", worker_without_gpu_rejects_a_plan_for_gpus, driver),
        ("contradicting_or_unknown_engine_exits_2", contradicting_or_unknown_engine_exits_2, None),
        (
            "engine_not_supported_by_the_cpu_exits_2_and_names_the_fastest",
            engine_not_supported_by_the_cpu_exits_2_and_names_the_fastest,
            all,
        ),
    ];
    let trials = checks.map(|(name, check, ignored)| {
        let run = move || {
            check();
            Ok(())
        };
        Trial::test(name, run).with_ignored_flag(ignored.is_some()).with_kind(ignored.unwrap_or_default())
    });
    libtest_mimic::run(&Arguments::from_args(), trials.into()).exit_code()
}
