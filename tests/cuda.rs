//! Whole runs on GPUs: the binary on an emulated driver, which runs the program's own kernels on the CPU, orders streams as it
//! likes and fails as told. The same films as without, the same bits however they are made, and nothing lost by any fault.

extern crate pipeline as lenscube_pipeline;

mod common;
#[path = "../pipeline/tests/emulated_cuda/mod.rs"]
mod emulated_cuda;

use common::place::Place;
use common::{Ran, bits, files, pairs, pixels, text};
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
/// Devices differ from the processor by their roundings, of the peak.
const TOLERANCE: f32 = 2e-6;

type Settings<'a> = &'a [(&'a str, &'a str)];
type Bytes = BTreeMap<PathBuf, Vec<u8>>;

/// `lenscube run` of a place on an emulated driver with `settings`.
fn command(place: &Place, film: &Path, device: &str, settings: Settings<'_>, fault: &str) -> Command {
    let mut command = place.command(film, fault, &["--device", device, "--no-fsync"]);
    command.envs(emulated_cuda::environment(PLAIN).unwrap()).envs(emulated_cuda::own(settings));
    command
}

fn run(place: &Place, device: &str, settings: Settings<'_>) -> Ran {
    Ran::of(&command(place, &place.film, device, settings, "").output().unwrap())
}

fn says(ran: &Ran, code: i32, words: &[&str]) {
    assert_eq!(ran.code, code, "{}", ran.stderr);
    assert!(!ran.stderr.contains("panicked"), "{}", ran.stderr);
    for word in words {
        assert!(ran.stderr.contains(word), "`{word}` is not in: {}", ran.stderr);
    }
}

/// The film that one undisturbed device makes; `place.film` is free again.
fn whole(place: &Place) -> Bytes {
    run(place, "cuda:0", &[]).ok();
    taken(place)
}

/// The film's files, and the film gone.
fn taken(place: &Place) -> Bytes {
    let found = files(&place.film);
    std::fs::remove_dir_all(&place.film).unwrap();
    found
}

/// The last run's record.
fn record(film: &Path) -> Value {
    let entries = std::fs::read_dir(film.join("runs")).unwrap().map(|e| e.unwrap().path());
    let newest = entries
        .filter(|p| text(p).ends_with(".json"))
        .max_by_key(|p| p.metadata().unwrap().modified().unwrap());
    serde_json::from_slice(&std::fs::read(newest.unwrap()).unwrap()).unwrap()
}

fn a_device_makes_the_processors_film() {
    let place = Place::wide();
    for stages in ["ri,distortion,svpsf", "ri,distortion"] {
        let on = |film: &Path, device: &str| {
            let mut command = command(&place, film, device, &[], "");
            Ran::of(&command.args(["--stages", stages]).output().unwrap()).ok()
        };
        let (here, there) = (place.at("cpu.zarr"), place.at("gpu.zarr"));
        on(&here, "cpu");
        let ran = on(&there, "cuda");
        says(&ran, 0, &["GPU 0 (", "compute"]);
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
            std::fs::remove_dir_all(place.at(film)).unwrap();
        }
    }
}

fn queues_order_and_memory_change_no_bit() {
    let place = Place::wide();
    let one = whole(&place);
    let small = least_memory(&place);
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
        run(&place, device, settings).ok();
        assert!(record(&place.film)["devices"].as_array().is_some_and(|d| !d.is_empty()));
        assert!(taken(&place) == one, "other bits on {device} {settings:?}");
    }
}

/// The memory of a device that holds a tile at a time: what the error asks for, and the tenth that is left free.
fn least_memory(place: &Place) -> String {
    let ran = run(place, "cuda:0", &[("MEMORY", "1e4")]);
    says(&ran, FAILED, &["a tile at a time needs"]);
    let (_, rest) = ran.stderr.split_once("a tile at a time needs ").unwrap();
    let mib: f64 = rest.split(' ').next().unwrap().parse().unwrap();
    format!("{}", (mib * 1_048_576.0 / 0.9).ceil() + 16.0)
}

fn a_small_device_takes_small_batches() {
    let place = Place::wide();
    let small = least_memory(&place);
    run(&place, "cuda:0", &[("MEMORY", &small)]).ok();
    let did = record(&place.film)["devices"][0]["did"].clone();
    assert!(did["batches"].as_u64() > Some(2), "{did}");
}

fn begun_on_one_and_resumed_on_another() {
    let place = Place::wide();
    let one = whole(&place);
    let killed = Ran::of(&command(&place, &place.film, "cuda:0", &[], "rename:20:kill").output().unwrap());
    assert_eq!(killed.code, KILLED, "{}", killed.stderr);
    says(&run(&place, "cuda:0,0", &[]), 0, &["resuming"]);
    assert!(taken(&place) == one, "other bits after SIGKILL");
    // The processor's shards differ in their last bits: only both engines together, when that is asked for.
    let killed = Ran::of(&command(&place, &place.film, "cpu", &[], "rename:20:kill").output().unwrap());
    assert_eq!(killed.code, KILLED, "{}", killed.stderr);
    says(&run(&place, "cuda", &[]), OTHER_JOB, &["begun with engine", "cuda-sm_80", "--mixed-engines"]);
    let mut mixed = command(&place, &place.film, "cuda", &[], "");
    says(&Ran::of(&mixed.arg("--mixed-engines").output().unwrap()), 0, &["resuming", "cuda-sm_80"]);
    assert_eq!(record(&place.film)["device"], "cuda:0");
    let (_, mixed) = pixels(&place.film, "film");
    std::fs::remove_dir_all(&place.film).unwrap();
    run(&place, "cpu", &[]).ok();
    let (_, here) = pixels(&place.film, "film");
    assert!(pairs(&mixed, &here).all(|(a, b)| (a - b).abs() <= TOLERANCE));
    assert!(bits(&mixed) != bits(&here), "nothing of it was made on the device");
}

fn auto_goes_on_with_the_films_engine() {
    let place = Place::wide();
    run(&place, "cpu", &[]).ok();
    let of_cpu = taken(&place);
    let killed = Ran::of(&command(&place, &place.film, "cpu", &[], "rename:20:kill").output().unwrap());
    assert_eq!(killed.code, KILLED, "{}", killed.stderr);
    says(&run(&place, "auto", &[]), 0, &["device: cpu (", "the film was begun with it", "GPUs are not used"]);
    assert!(taken(&place) == of_cpu, "other bits beside a GPU");
    // GPUs of two engines: those of the film's.
    let two: Settings<'_> = &[("DEVICES", "2"), ("CAPABILITY", "9.0,8.0")];
    let of_gpu = whole(&place);
    let killed = Ran::of(&command(&place, &place.film, "cuda", &[], "rename:20:kill").output().unwrap());
    assert_eq!(killed.code, KILLED, "{}", killed.stderr);
    says(&run(&place, "auto", two), 0, &["device: GPU 1", "not used", "cuda-sm_90"]);
    assert!(taken(&place) == of_gpu, "other bits beside another GPU");
    says(&run(&place, "cuda:0,1", two), USAGE, &["GPUs of one engine", "cuda-sm_90"]);
}

fn codes_that_a_driver_may_return_end_the_run_in_order() {
    let place = Place::wide();
    for (code, exit, words) in
        [("226", RETRY, "is lost"), ("721", RETRY, "is lost"), ("4242", FAILED, "4242")]
    {
        let fault = format!("error-{code}:0:3");
        says(
            &run(&place, "cuda:0", &[("FAULTS", &fault), ("STREAMS", "deferred")]),
            exit,
            &[words, code, "resumes"],
        );
        std::fs::remove_dir_all(&place.film).unwrap();
    }
}

fn a_device_in_exclusive_use_is_worth_a_retry() {
    let place = Place::wide();
    says(&run(&place, "cuda", &[("OPEN", "46")]), RETRY, &["in use by another process"]);
    assert!(!place.film.exists());
    says(&run(&place, "auto", &[("OPEN", "46")]), 0, &["device: cpu (", "in use by another process"]);
}

fn out_of_page_locked_memory_is_no_lack_of_the_devices() {
    let place = Place::wide();
    let one = whole(&place);
    let ran = run(&place, "cuda:0", &[("FAULTS", "host-memory:0:2")]);
    says(&ran, RETRY, &["out of page-locked host memory", "same command resumes"]);
    assert!(!ran.stderr.contains("half of the memory"), "{}", ran.stderr);
    says(&run(&place, "cuda", &[("DEVICES", "2"), ("FAULTS", "host-memory:1:1")]), 0, &[]);
    assert!(taken(&place) == one);
}

fn a_lost_device_leaves_its_tiles_to_the_others() {
    let place = Place::wide();
    let one = whole(&place);
    for streams in ["eager", "deferred"] {
        for n in ["1", "4"] {
            let fault = format!("lost:1:{n}");
            let settings =
                [("DEVICES", "2"), ("DELAY_US", "2000,0"), ("FAULTS", &fault), ("STREAMS", streams)];
            says(&run(&place, "cuda", &settings), 0, &["GPU 1", "takes part no longer", "is lost"]);
            assert!(record(&place.film)["devices"][1]["did"]["left"].is_string());
            assert!(taken(&place) == one, "other bits after {settings:?}");
        }
    }
}

fn with_no_device_left_the_run_is_worth_a_retry() {
    let place = Place::wide();
    let one = whole(&place);
    let faults: [(&str, Settings<'_>); 3] = [
        ("cuda:0", &[("FAULTS", "lost:0:1")]),
        ("cuda:0,0", &[("FAULTS", "lost:0:5"), ("STREAMS", "deferred")]),
        ("cuda", &[("DEVICES", "2"), ("FAULTS", "lost:0:3,lost:1:2")]),
    ];
    for (device, settings) in faults {
        says(&run(&place, device, settings), RETRY, &["none is left", "is lost", "same command resumes"]);
        run(&place, device, &[]).ok();
        assert!(taken(&place) == one, "other bits after {device} {settings:?}");
    }
}

fn a_kernels_fault_ends_the_run() {
    let place = Place::wide();
    let one = whole(&place);
    says(&run(&place, "cuda:0", &[("FAULTS", "kernel:0:3")]), FAILED, &["GPU 0", "kernel failed", "resumes"]);
    run(&place, "cuda:0", &[]).ok();
    assert!(taken(&place) == one);
}

fn out_of_memory_it_makes_do_with_less() {
    let place = Place::wide();
    let one = whole(&place);
    // Of a band's tables, its slots, its work, and of the band after it.
    for n in ["memory:0:2", "memory:0:9", "memory:0:20", "memory:0:30,memory:0:37"] {
        let ran = run(&place, "cuda:0", &[("FAULTS", n)]);
        says(&ran, 0, &["half of the memory it had", "out of memory for"]);
        assert!(taken(&place) == one, "other bits after {n}");
    }
}

fn what_does_not_fit_is_said() {
    let place = Place::wide();
    says(&run(&place, "cuda:0", &[("MEMORY", "1e6")]), FAILED, &["GPU 0", "needs", "MiB", "--device cpu"]);
    says(&run(&place, "auto", &[("MEMORY", "1e6")]), 0, &["device: cpu (", "needs"]);
    std::fs::remove_dir_all(&place.film).unwrap();
    let mut command = command(&place, &place.film, "cuda:0", &[], "");
    says(&Ran::of(&command.args(["--memory", "64MiB"]).output().unwrap()), USAGE, &["--memory", "at least"]);
}

fn what_is_not_there_is_said() {
    let place = Place::wide();
    let cases: [(&str, Settings<'_>, &[&str]); 4] = [
        ("cuda", &[("DRIVER", "12010")], &["12.1", "12.2"]),
        ("cuda", &[("DEVICES", "0")], &["no GPU"]),
        ("cuda:0,3", &[("DEVICES", "2")], &["GPU 3", "sees 2", "0 to 1"]),
        ("cuda", &[("CAPABILITY", "7.5")], &["7.5", "8.0"]),
    ];
    for (device, settings, words) in cases {
        says(&run(&place, device, settings), USAGE, words);
        assert!(!place.film.exists(), "{settings:?}");
    }
    says(&run(&place, "auto", &[("DRIVER", "12010")]), 0, &["device: cpu (", "12.1"]);
    std::fs::remove_dir_all(&place.film).unwrap();
    says(&run(&place, "auto", &[]), 0, &["device: GPU 0"]);
    assert_eq!(record(&place.film)["device"], "cuda:0");
}

fn without_a_driver_nothing_computes_elsewhere_unasked() {
    let place = Place::wide();
    for device in ["cuda", "cuda:0"] {
        let ran = place.run("", &["--device", device]);
        says(&ran, USAGE, &["no NVIDIA driver", "--device cpu"]);
        assert!(!place.film.exists());
    }
    says(&place.run("", &["--device", "auto"]), 0, &["device: cpu (", "no NVIDIA driver"]);
    assert_eq!(record(&place.film)["device"], "cpu");
}

fn a_signal_lets_what_is_on_the_device_come_down() {
    let place = Place::wide();
    let one = whole(&place);
    let small = least_memory(&place);
    let settings = [("DELAY_US", "20000"), ("MEMORY", &small)];
    let mut command = command(&place, &place.film, "cuda:0", &settings, "write:9:stop");
    let child =
        command.stdout(std::process::Stdio::null()).stderr(std::process::Stdio::piped()).spawn().unwrap();
    let mut stopped = common::place::Stopped(child);
    assert!(stopped.wait_stopped(), "the run ended before it was stopped");
    stopped.signal("TERM");
    says(&stopped.go_on(), 130, &["finishing the tiles in flight", "resumes"]);
    run(&place, "cuda:0", &[]).ok();
    assert!(taken(&place) == one);
}

fn main() -> ExitCode {
    let emulated: [(&str, fn()); 15] = [
        ("a_device_makes_the_processors_film", a_device_makes_the_processors_film),
        ("queues_order_and_memory_change_no_bit", queues_order_and_memory_change_no_bit),
        ("a_small_device_takes_small_batches", a_small_device_takes_small_batches),
        ("begun_on_one_and_resumed_on_another", begun_on_one_and_resumed_on_another),
        ("auto_goes_on_with_the_films_engine", auto_goes_on_with_the_films_engine),
        (
            "codes_that_a_driver_may_return_end_the_run_in_order",
            codes_that_a_driver_may_return_end_the_run_in_order,
        ),
        ("a_device_in_exclusive_use_is_worth_a_retry", a_device_in_exclusive_use_is_worth_a_retry),
        (
            "out_of_page_locked_memory_is_no_lack_of_the_devices",
            out_of_page_locked_memory_is_no_lack_of_the_devices,
        ),
        ("a_lost_device_leaves_its_tiles_to_the_others", a_lost_device_leaves_its_tiles_to_the_others),
        ("with_no_device_left_the_run_is_worth_a_retry", with_no_device_left_the_run_is_worth_a_retry),
        ("a_kernels_fault_ends_the_run", a_kernels_fault_ends_the_run),
        ("out_of_memory_it_makes_do_with_less", out_of_memory_it_makes_do_with_less),
        ("what_does_not_fit_is_said", what_does_not_fit_is_said),
        ("what_is_not_there_is_said", what_is_not_there_is_said),
        ("a_signal_lets_what_is_on_the_device_come_down", a_signal_lets_what_is_on_the_device_come_down),
    ];
    let trial = |name: &str, run: fn(), ignored: Option<&'static str>| {
        let run = move || {
            run();
            Ok(())
        };
        emulated_cuda::trial(name.to_owned(), ignored, run)
    };
    let no_compiler = (!emulated_cuda::compiler()).then_some(NO_COMPILER);
    let mut trials: Vec<Trial> = emulated.iter().map(|&(name, run)| trial(name, run, no_compiler)).collect();
    trials.push(trial(
        "without_a_driver_nothing_computes_elsewhere_unasked",
        without_a_driver_nothing_computes_elsewhere_unasked,
        emulated_cuda::driver().then_some(A_DRIVER),
    ));
    libtest_mimic::run(&Arguments::from_args(), trials).exit_code()
}
