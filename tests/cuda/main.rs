//! Complete runs on GPUs: the binary on an emulated driver, which executes the kernels on the CPU, varies the order of streams and
//! injects faults. Films equal those of the CPU within the tolerance, have the same bits on any GPU queue, and survive any fault.

extern crate pipeline as lenscube_pipeline;

#[path = "../common/mod.rs"]
mod common;
#[path = "../../pipeline/tests/emulated_cuda/mod.rs"]
mod emulated_cuda;
mod failures;

use common::test_job::TestJob;
use common::{CommandResult, assert_exit, bits, files, pairs, pixels, text};
use emulated_cuda::{A_DRIVER, NO_COMPILER, PLAIN};
use libtest_mimic::{Arguments, Trial};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

const FAILED: i32 = 1;
const USAGE: i32 = 2;
const OTHER_JOB: i32 = 3;
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

fn device_check_compares_films_and_auto_reports_unchecked_gpus() {
    let dir = tempfile::tempdir().unwrap();
    let lenscube = |arguments: &[&str], settings: Settings<'_>| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        command.args(arguments).env("XDG_CACHE_HOME", dir.path());
        command.envs(emulated_cuda::environment(PLAIN).unwrap()).envs(emulated_cuda::settings(settings));
        CommandResult::new(&command.output().unwrap())
    };
    let list = || lenscube(&["device", "list"], &[]);
    assert!(list().stdout.contains("cuda:0   Emulated GPU 8.0") && list().stdout.contains("not compared"));
    let film = dir.path().join("film.zarr");
    let chart = "gen:siemens?size=256&wavelengths=550";
    let run = || lenscube(&["run", chart, text(&film), "--overwrite", "--stages", "ri", "--no-fsync"], &[]);
    assert_exit(&run(), 0, &["have not been compared with the CPU's", "lenscube device check"]);
    let checked = lenscube(&["device", "check"], &[]);
    assert_exit(&checked, 0, &[]);
    assert!(checked.stdout.contains("passed (tolerance 2e-6)"), "{}", checked.stdout);
    assert_eq!(checked.stdout.matches("largest difference").count(), 6, "{}", checked.stdout);
    assert!(list().stdout.contains("equal to the CPU"));
    let ran = run();
    assert!(ran.code == 0 && !ran.stderr.contains("device check"), "{}", ran.stderr);
    // A stored failure: the GPU is not used by `auto`.
    let results = dir.path().join("lenscube/device-checks.json");
    let failed = std::fs::read_to_string(&results).unwrap().replace("true", "false");
    std::fs::write(&results, failed).unwrap();
    assert_exit(&run(), 0, &["device: cpu (", "found other films"]);
    assert_exit(&lenscube(&["device", "check", "--device", "cuda:3"], &[]), USAGE, &["GPU 3"]);
    assert_exit(&lenscube(&["device", "check"], &[("FAULTS", "kernel:0:3")]), FAILED, &["a kernel failed"]);
}

/// All steps of `scripts/gpu-check`; the benchmark, too slow on an emulated GPU, with kernels and copies that do nothing.
fn gpu_check_script_passes_its_steps() {
    let dir = tempfile::tempdir().unwrap();
    let check = |steps: &str, emulated: Settings<'_>| {
        let out = dir.path().join("out");
        let mut command = Command::new(concat!(env!("CARGO_MANIFEST_DIR"), "/scripts/gpu-check"));
        command.arg(&out).env("LENSCUBE", env!("CARGO_BIN_EXE_lenscube")).env("TMPDIR", dir.path());
        command.envs(emulated_cuda::environment(PLAIN).unwrap()).envs(emulated_cuda::settings(emulated));
        let settings = [
            ("SIZE", "600"),
            // Shards are finished band by band: the run is killed after one of them.
            ("BANDS", "3"),
            ("ROI", "64"),
            ("LENS", "double-gauss-28-npz"),
            ("FLAGS", "--shard 128 --chunk 64"),
            ("STEPS", steps),
        ];
        command.envs(settings.map(|(name, value)| (format!("GPU_CHECK_{name}"), value)));
        let ran = CommandResult::new(&command.output().unwrap());
        assert_exit(&ran, 0, &[]);
        assert!(out.join("gpu-check.tar.gz").metadata().unwrap().len() > 500);
        ran.stdout
    };
    let table = check("1 2 3 4 5 7 8 9", &[]) + &check("6", &[("WORK", "none")]);
    for row in ["3 regions, scale 0.7", "4 full job, cuda:0,0", "5 SIGKILL at 40 % and resume", "6 bench"] {
        let line = table.lines().rev().find(|line| line.starts_with(row));
        assert!(line.is_some_and(|line| !line.contains("FAILED")), "{row}: {table}");
    }
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
            "device_check_compares_films_and_auto_reports_unchecked_gpus",
            device_check_compares_films_and_auto_reports_unchecked_gpus,
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
    trials.push(trial(
        "gpu_check_script_passes_its_steps",
        gpu_check_script_passes_its_steps,
        Some(no_compiler.unwrap_or("long: scripts/check --full")),
    ));
    libtest_mimic::run(&Arguments::from_args(), trials).exit_code()
}
