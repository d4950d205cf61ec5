//! The engine of a film from outside: kept by whoever goes on with it, and never changed unasked.
//! A test of two engines is reported as ignored where the processor has only one.

mod common;

use common::place::Place;
use common::{Ran, files, lenscube, text};
use libtest_mimic::{Arguments, Trial};
use pipeline::simd::{Isa, Simd};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

const USAGE: i32 = 2;
const OTHER_JOB: i32 = 3;
const KILLED: i32 = -1;
/// After some shards.
const MIDWAY: &str = "rename:20:kill";

fn says(ran: &Ran, code: i32, words: &[&str]) {
    assert_eq!(ran.code, code, "{}", ran.stderr);
    for word in words {
        assert!(ran.stderr.contains(word), "`{word}` is not in: {}", ran.stderr);
    }
}

/// The fastest engine here.
fn fastest() -> &'static str {
    Simd::detect().isa().name()
}

fn run(place: &Place, fault: &str, flags: &[&str]) -> Ran {
    place.run(fault, &[&["--device", "cpu", "--no-fsync"], flags].concat())
}

/// The film that one engine makes; `place.film` is free again.
fn whole(place: &Place, engine: &str) -> BTreeMap<PathBuf, Vec<u8>> {
    run(place, "", &["--engine", engine]).ok();
    taken(place)
}

fn taken(place: &Place) -> BTreeMap<PathBuf, Vec<u8>> {
    let found = files(&place.film);
    std::fs::remove_dir_all(&place.film).unwrap();
    found
}

/// A film that the portable engine has begun.
fn begun(place: &Place) {
    let killed = run(place, MIDWAY, &["--engine", "portable"]);
    assert_eq!(killed.code, KILLED, "{}", killed.stderr);
}

fn status(film: &Path) -> Value {
    serde_json::from_str(&lenscube(&["status", text(film), "--json"]).ok().stdout).unwrap()
}

fn resume_uses_the_films_engine_and_logs_it() {
    let place = Place::wide();
    let portable = whole(&place, "portable");
    begun(&place);
    let resumed = run(&place, "", &[]);
    says(&resumed, 0, &["resuming", "engine: portable", fastest()]);
    assert_eq!(status(&place.film)["engines"], serde_json::json!(["portable"]));
    assert!(taken(&place) == portable, "other bits after a resume");
    assert!(whole(&place, fastest()) != portable, "the engines do not differ, so nothing is shown");
}

fn another_engine_exits_3_and_names_both() {
    let place = Place::wide();
    begun(&place);
    let before = files(&place.film);
    let other = run(&place, "", &["--engine", fastest()]);
    says(&other, OTHER_JOB, &["begun with engine portable", fastest(), "--mixed-engines", "--overwrite"]);
    assert!(files(&place.film) == before, "a refused run has changed the film");
    run(&place, "", &["--engine", fastest(), "--overwrite"]).ok();
    assert_eq!(status(&place.film)["engine"], fastest());
    // Nothing is left to do, but not by the engine that is asked for.
    says(&run(&place, "", &["--engine", "portable"]), OTHER_JOB, &[fastest(), "portable"]);
    says(&run(&place, "", &[]), 0, &["nothing to do"]);
}

fn mixed_engines_are_recorded_whatever_ends_the_run() {
    let place = Place::wide();
    begun(&place);
    let mixed = ["--engine", fastest(), "--mixed-engines"];
    let killed = run(&place, "rename:3:kill", &mixed);
    assert_eq!(killed.code, KILLED, "{}", killed.stderr);
    let both = serde_json::json!(["portable", fastest()]);
    assert_eq!(status(&place.film)["engines"], both);
    says(&run(&place, "", &mixed), 0, &["begun with engine portable", "--mixed-engines"]);
    assert_eq!(status(&place.film)["engines"], both);
    let verified = lenscube(&["verify", text(&place.film)]);
    says(&verified, 0, &["several engines", "portable", fastest()]);
    assert!(lenscube(&["status", text(&place.film)]).stdout.contains("engines portable,"));
}

fn a_film_without_a_record_is_not_continued() {
    let place = Place::wide();
    begun(&place);
    let metadata = place.film.join("zarr.json");
    let mut group: Value = serde_json::from_slice(&std::fs::read(&metadata).unwrap()).unwrap();
    let removed = group["attributes"]["provenance"].as_object_mut().unwrap().remove("engine");
    assert_eq!(removed, Some("portable".into()));
    std::fs::write(&metadata, serde_json::to_vec(&group).unwrap()).unwrap();
    says(&run(&place, "", &[]), OTHER_JOB, &["does not say which engine", "--mixed-engines"]);
    run(&place, "", &["--mixed-engines"]).ok();
    assert_eq!(status(&place.film)["engines"], serde_json::json!(["unknown", fastest()]));
}

fn workers_use_the_plans_engine() {
    let place = Place::wide();
    let portable = whole(&place, "portable");
    let plan = place.at("job.json");
    let flags = ["--device", "cpu", "--no-fsync", "--engine", "portable", "-o", text(&plan)];
    Ran::of(&place.plan(&place.film, &flags).output().unwrap()).ok();
    let planned: Value = serde_json::from_slice(&std::fs::read(&plan).unwrap()).unwrap();
    assert_eq!(planned["engine"], "portable");
    let unit = |flags: &[&str]| lenscube(&[&["run", "--plan", text(&plan)], flags].concat());
    says(&unit(&["--engine", fastest()]), OTHER_JOB, &["begun with engine portable", fastest()]);
    unit(&[]).ok();
    assert!(taken(&place) == portable, "other bits by workers");
}

/// Planned where there is no such GPU; this machine's workers have none either.
fn a_plan_for_gpus_is_not_done_by_the_processor() {
    let place = Place::wide();
    let plan = place.at("job.json");
    let flags = ["--no-fsync", "--engine", "cuda-sm_90", "-o", text(&plan)];
    Ran::of(&place.plan(&place.film, &flags).output().unwrap()).ok();
    assert_eq!(status(&place.film)["engine"], "cuda-sm_90");
    let worker = lenscube(&["run", "--plan", text(&plan)]);
    says(&worker, USAGE, &["--engine cuda-sm_90", "no NVIDIA driver"]);
}

fn engines_that_cannot_be_exit_2() {
    let place = Place::wide();
    says(&run(&place, "", &["--engine", "cuda-sm_90"]), USAGE, &["contradict"]);
    says(&run(&place, "", &["--engine", "sse"]), USAGE, &["expected auto, avx512, avx2, portable"]);
    let cuda = place.run("", &["--device", "cuda", "--engine", "portable"]);
    says(&cuda, USAGE, &["contradict"]);
    assert!(!place.film.exists());
}

fn an_engine_that_the_processor_lacks_exits_2() {
    let lacking = Isa::ALL.into_iter().find(|isa| !isa.is_available()).unwrap().name();
    let place = Place::wide();
    says(&run(&place, "", &["--engine", lacking]), USAGE, &[lacking, "the fastest it has is"]);
    assert!(!place.film.exists());
}

/// Name of a case, the case, and why it cannot run here.
type Check = (&'static str, fn(), Option<&'static str>);

fn main() -> ExitCode {
    // Why a case cannot run here, as scripts/check_summary.py knows it.
    let when = |lacking: bool, why: &'static str| lacking.then_some(why);
    let one = when(Simd::detect() == Simd::PORTABLE, "one instruction set");
    let all = when(Isa::ALL.into_iter().all(Isa::is_available), "every instruction set is there");
    let no_driver = matches!(pipeline::cuda::devices(), Err(pipeline::cuda::CudaError::NoDriver));
    let driver = when(!no_driver, "a CUDA driver is installed");
    let checks: [Check; 8] = [
        ("resume_uses_the_films_engine_and_logs_it", resume_uses_the_films_engine_and_logs_it, one),
        ("another_engine_exits_3_and_names_both", another_engine_exits_3_and_names_both, one),
        (
            "mixed_engines_are_recorded_whatever_ends_the_run",
            mixed_engines_are_recorded_whatever_ends_the_run,
            one,
        ),
        ("a_film_without_a_record_is_not_continued", a_film_without_a_record_is_not_continued, None),
        ("workers_use_the_plans_engine", workers_use_the_plans_engine, one),
        (
            "a_plan_for_gpus_is_not_done_by_the_processor",
            a_plan_for_gpus_is_not_done_by_the_processor,
            driver,
        ),
        ("engines_that_cannot_be_exit_2", engines_that_cannot_be_exit_2, None),
        ("an_engine_that_the_processor_lacks_exits_2", an_engine_that_the_processor_lacks_exits_2, all),
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
