//! Complete runs on GPUs: the binary on an emulated driver, which executes the kernels on the CPU, varies the order of streams and
//! injects faults. Films equal those of the CPU within the tolerance, have the same bits on any GPU queue, and survive any fault.

extern crate pipeline as lenscube_pipeline;

#[path = "../common/mod.rs"]
mod common;
mod device_check;
#[path = "../../pipeline/tests/emulated_cuda/mod.rs"]
mod emulated_cuda;
mod failures;
mod gpu_check;

use common::test_job::TestJob;
use common::{CommandResult, assert_exit, bits, files, pairs, pixels, text};
use emulated_cuda::{A_DRIVER, LONG, NO_COMPILER, PLAIN};
use libtest_mimic::{Arguments, Trial};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

const FAILED: i32 = 1;
const USAGE: i32 = 2;
const OTHER_JOB: i32 = 3;
const WRONG: i32 = 4;
const RETRY: i32 = 75;
const KILLED: i32 = -1;
/// Maximum difference of GPU and CPU films, as a share of the peak.
const TOLERANCE: f32 = 2e-6;

type Settings<'a> = &'a [(&'a str, &'a str)];
type Bytes = BTreeMap<PathBuf, Vec<u8>>;

/// `lenscube run` of a job on an emulated driver with `settings`.
fn command(job: &TestJob, film: &Path, device: &str, settings: Settings<'_>, fault: &str) -> Command {
    let mut command = job.command(film, fault, &["--device", device, "--no-fsync", "-v"]);
    command.envs(emulated_cuda::environment(PLAIN).unwrap()).envs(emulated_cuda::settings(settings));
    command
}

fn run(job: &TestJob, device: &str, settings: Settings<'_>) -> CommandResult {
    CommandResult::new(&command(job, &job.film, device, settings, "").output().unwrap())
}

/// Files of the film of one device without faults; the film is removed.
fn single_device_film(job: &TestJob) -> Bytes {
    run(job, "cuda:0", &[]).ok();
    take_files(job)
}

/// Files of the film, which is removed.
fn take_files(job: &TestJob) -> Bytes {
    let found = files(&job.film);
    std::fs::remove_dir_all(&job.film).unwrap();
    found
}

/// Record of the last run.
fn record(film: &Path) -> Value {
    let entries = std::fs::read_dir(film.join("runs")).unwrap().map(|e| e.unwrap().path());
    let newest = entries
        .filter(|p| text(p).ends_with(".json"))
        .max_by_key(|p| p.metadata().unwrap().modified().unwrap());
    serde_json::from_slice(&std::fs::read(newest.unwrap()).unwrap()).unwrap()
}

fn gpu_film_equals_cpu_film_within_tolerance() {
    let job = TestJob::wide();
    for stages in ["ri,distortion,svpsf", "ri,distortion"] {
        let on = |film: &Path, device: &str| {
            let mut command = command(&job, film, device, &[], "");
            CommandResult::new(&command.args(["--stages", stages]).output().unwrap()).ok()
        };
        let (here, there) = (job.at("cpu.zarr"), job.at("gpu.zarr"));
        on(&here, "cpu");
        let ran = on(&there, "cuda");
        assert_exit(&ran, 0, &["GPU 0 (", "compute"]);
        let ((_, here), (_, of_device)) = (pixels(&here, "film"), pixels(&there, "film"));
        let peak = here.iter().flatten().fold(0f32, |m, v| m.max(v.abs()));
        for (a, b) in pairs(&here, &of_device) {
            assert!((a - b).abs() <= TOLERANCE * peak, "{a} here, {b} there, peak {peak}");
        }
        let record = record(&there);
        assert_eq!(record["device"], "cuda:0");
        assert_eq!(record["devices"][0]["did"]["tiles"], record["tiles"]);
        assert!(record["devices"][0]["name"].as_str().is_some_and(|n| !n.is_empty()), "{record}");
        for film in ["cpu.zarr", "gpu.zarr"] {
            std::fs::remove_dir_all(job.at(film)).unwrap();
        }
    }
}

fn queues_stream_order_and_memory_do_not_change_bits() {
    bits_do_not_depend_on_queues(&TestJob::wide());
    bits_do_not_depend_on_queues(&TestJob::tall());
}

fn bits_do_not_depend_on_queues(job: &TestJob) {
    let expected = single_device_film(job);
    let small = min_memory(job);
    let two: Settings<'_> = &[("DEVICES", "2"), ("DELAY_US", "0,3000")];
    let ways: [(&str, Settings<'_>); 6] = [
        ("cuda:0,0", &[]),
        ("cuda", two),
        ("cuda:0", &[("STREAMS", "deferred")]),
        ("cuda:0", &[("STREAMS", "hasty")]),
        ("cuda:0,0", &[("STREAMS", "hasty")]),
        ("cuda:0", &[("MEMORY", &small), ("STREAMS", "hasty")]),
    ];
    for (device, settings) in ways {
        run(job, device, settings).ok();
        assert!(record(&job.film)["devices"].as_array().is_some_and(|d| !d.is_empty()));
        assert!(take_files(job) == expected, "other bits on {device} {settings:?}");
    }
}

/// Minimum device memory, bytes, for one tile at a time: the size in the error message, plus the tenth that is kept free.
fn min_memory(job: &TestJob) -> String {
    let ran = run(job, "cuda:0", &[("MEMORY", "1e4")]);
    assert_exit(&ran, FAILED, &["one tile needs"]);
    let (_, rest) = ran.stderr.split_once("one tile needs ").unwrap();
    let mib: f64 = rest.split(' ').next().unwrap().parse().unwrap();
    format!("{}", (mib * 1_048_576.0 / 0.9).ceil() + 16.0)
}

fn small_device_memory_gives_small_batches() {
    let job = TestJob::wide();
    let small = min_memory(&job);
    run(&job, "cuda:0", &[("MEMORY", &small)]).ok();
    let did = record(&job.film)["devices"][0]["did"].clone();
    assert!(did["batches"].as_u64() > Some(2), "{did}");
}

fn film_is_resumed_on_another_device_or_with_mixed_engines() {
    let job = TestJob::wide();
    let expected = single_device_film(&job);
    let killed =
        CommandResult::new(&command(&job, &job.film, "cuda:0", &[], "rename:20:kill").output().unwrap());
    assert_eq!(killed.code, KILLED, "{}", killed.stderr);
    assert_exit(&run(&job, "cuda:0,0", &[]), 0, &["resuming"]);
    assert!(take_files(&job) == expected, "other bits after SIGKILL");
    // Shards of the CPU differ in their last bits, so mixing engines requires a flag.
    let killed =
        CommandResult::new(&command(&job, &job.film, "cpu", &[], "rename:20:kill").output().unwrap());
    assert_eq!(killed.code, KILLED, "{}", killed.stderr);
    assert_exit(
        &run(&job, "cuda", &[]),
        OTHER_JOB,
        &["created with engine", "cuda-sm_80", "--mixed-engines"],
    );
    let mut mixed = command(&job, &job.film, "cuda", &[], "");
    assert_exit(
        &CommandResult::new(&mixed.arg("--mixed-engines").output().unwrap()),
        0,
        &["resuming", "cuda-sm_80"],
    );
    assert_eq!(record(&job.film)["device"], "cuda:0");
    let (_, mixed) = pixels(&job.film, "film");
    std::fs::remove_dir_all(&job.film).unwrap();
    run(&job, "cpu", &[]).ok();
    let (_, here) = pixels(&job.film, "film");
    assert!(pairs(&mixed, &here).all(|(a, b)| (a - b).abs() <= TOLERANCE));
    assert!(bits(&mixed) != bits(&here), "nothing of it was made on the device");
}

fn auto_resumes_with_the_engine_of_the_film() {
    let job = TestJob::wide();
    run(&job, "cpu", &[]).ok();
    let of_cpu = take_files(&job);
    let killed =
        CommandResult::new(&command(&job, &job.film, "cpu", &[], "rename:20:kill").output().unwrap());
    assert_eq!(killed.code, KILLED, "{}", killed.stderr);
    assert_exit(
        &run(&job, "auto", &[]),
        0,
        &["device: cpu (", "the film was created with it", "GPUs are not used"],
    );
    assert!(take_files(&job) == of_cpu, "other bits beside a GPU");
    // With GPUs of two engines only those with the engine of the film are used.
    let two: Settings<'_> = &[("DEVICES", "2"), ("CAPABILITY", "9.0,8.0")];
    let of_gpu = single_device_film(&job);
    let killed =
        CommandResult::new(&command(&job, &job.film, "cuda", &[], "rename:20:kill").output().unwrap());
    assert_eq!(killed.code, KILLED, "{}", killed.stderr);
    assert_exit(&run(&job, "auto", two), 0, &["device: GPU 1", "not used", "cuda-sm_90"]);
    assert!(take_files(&job) == of_gpu, "other bits beside another GPU");
    assert_exit(&run(&job, "cuda:0,1", two), USAGE, &["the same compute capability", "cuda-sm_90"]);
}

fn driver_error_codes_map_to_exit_codes() {
    let job = TestJob::wide();
    for (code, exit, words) in
        [("226", RETRY, "is lost"), ("721", RETRY, "is lost"), ("4242", FAILED, "4242")]
    {
        let fault = format!("error-{code}:0:3");
        assert_exit(
            &run(&job, "cuda:0", &[("FAULTS", &fault), ("STREAMS", "deferred")]),
            exit,
            &[words, code, "resumes"],
        );
        std::fs::remove_dir_all(&job.film).unwrap();
    }
}

fn device_in_exclusive_use_exits_75() {
    let job = TestJob::wide();
    assert_exit(&run(&job, "cuda", &[("OPEN", "46")]), RETRY, &["in use by another process"]);
    assert!(!job.film.exists());
    assert_exit(&run(&job, "auto", &[("OPEN", "46")]), 0, &["device: cpu (", "in use by another process"]);
}

fn out_of_page_locked_memory_continues_with_half_and_exits_75_at_the_minimum() {
    let job = TestJob::wide();
    let expected = single_device_film(&job);
    let all: Vec<String> = (2..200).map(|n| format!("host-memory:0:{n}")).collect();
    let ran = run(&job, "cuda:0", &[("FAULTS", &all.join(","))]);
    assert_exit(
        &ran,
        RETRY,
        &["half of its memory", "last GPU failed", "out of page-locked", "same command resumes"],
    );
    let once = run(&job, "cuda:0", &[("FAULTS", "host-memory:0:2")]);
    assert_exit(&once, 0, &["out of page-locked host memory", "half of its memory"]);
    assert!(take_files(&job) == expected);
    assert_exit(&run(&job, "cuda", &[("DEVICES", "2"), ("FAULTS", "host-memory:1:1")]), 0, &[]);
    assert!(take_files(&job) == expected);
}

fn main() -> ExitCode {
    let emulated: [(&str, fn()); 16] = [
        ("gpu_film_equals_cpu_film_within_tolerance", gpu_film_equals_cpu_film_within_tolerance),
        (
            "queues_stream_order_and_memory_do_not_change_bits",
            queues_stream_order_and_memory_do_not_change_bits,
        ),
        ("small_device_memory_gives_small_batches", small_device_memory_gives_small_batches),
        (
            "film_is_resumed_on_another_device_or_with_mixed_engines",
            film_is_resumed_on_another_device_or_with_mixed_engines,
        ),
        ("auto_resumes_with_the_engine_of_the_film", auto_resumes_with_the_engine_of_the_film),
        ("driver_error_codes_map_to_exit_codes", driver_error_codes_map_to_exit_codes),
        ("device_in_exclusive_use_exits_75", device_in_exclusive_use_exits_75),
        (
            "out_of_page_locked_memory_continues_with_half_and_exits_75_at_the_minimum",
            out_of_page_locked_memory_continues_with_half_and_exits_75_at_the_minimum,
        ),
        (
            "verdict_of_a_card_does_not_hold_for_another_of_its_name",
            device_check::verdict_of_a_card_does_not_hold_for_another_of_its_name,
        ),
        (
            "tiles_of_a_lost_device_are_computed_by_the_others",
            failures::tiles_of_a_lost_device_are_computed_by_the_others,
        ),
        ("loss_of_the_last_device_exits_75", failures::loss_of_the_last_device_exits_75),
        ("kernel_error_exits_1", failures::kernel_error_exits_1),
        (
            "out_of_device_memory_continues_with_half_the_memory",
            failures::out_of_device_memory_continues_with_half_the_memory,
        ),
        (
            "too_small_device_memory_is_an_error_with_the_needed_size",
            failures::too_small_device_memory_is_an_error_with_the_needed_size,
        ),
        ("unsuitable_driver_or_device_exits_2", failures::unsuitable_driver_or_device_exits_2),
        (
            "signal_downloads_tiles_in_flight_and_exits_130",
            failures::signal_downloads_tiles_in_flight_and_exits_130,
        ),
    ];
    let trial = |name: &str, run: fn(), ignored: Option<&'static str>| {
        let run = move || {
            run();
            Ok(())
        };
        emulated_cuda::trial(name.to_owned(), ignored, run)
    };
    let no_compiler = (!emulated_cuda::has_compiler()).then_some(NO_COMPILER);
    let mut trials: Vec<Trial> = emulated.iter().map(|&(name, run)| trial(name, run, no_compiler)).collect();
    trials.push(trial(
        "missing_driver_exits_2_without_fallback_to_cpu",
        failures::missing_driver_exits_2_without_fallback_to_cpu,
        emulated_cuda::has_driver().then_some(A_DRIVER),
    ));
    let long: [(&str, fn()); 3] = [
        (
            "device_check_compares_films_and_auto_reports_unchecked_gpus",
            device_check::device_check_compares_films_and_auto_reports_unchecked_gpus,
        ),
        ("gpu_check_script_passes_its_steps", gpu_check::gpu_check_script_passes_its_steps),
        ("gpu_check_script_reports_failures", gpu_check::gpu_check_script_reports_failures),
    ];
    trials.extend(long.map(|(name, run)| trial(name, run, Some(no_compiler.unwrap_or(LONG)))));
    libtest_mimic::run(&Arguments::from_args(), trials).exit_code()
}
