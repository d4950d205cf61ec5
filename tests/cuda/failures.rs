//! Faults of devices and drivers: lost devices, memory, kernels, missing and old drivers, signals.

use super::*;

/// Also in the middle of a band, whose film rows are on the device.
pub fn tiles_of_a_lost_device_are_computed_by_the_others() {
    let job = TestJob::tall();
    let expected = single_device_film(&job);
    for streams in ["eager", "deferred"] {
        for n in ["1", "4", "9", "15"] {
            let fault = format!("lost:1:{n}");
            let settings = [("DEVICES", "2"), ("UNTIL_LOST", "1"), ("FAULTS", &fault), ("STREAMS", streams)];
            assert_exit(
                &run(&job, "cuda", &settings),
                0,
                &["GPU 1", "was removed after a failure", "is lost"],
            );
            assert!(record(&job.film)["devices"][1]["did"]["left"].is_string());
            assert!(take_files(&job) == expected, "other bits after {settings:?}");
        }
    }
}

pub fn loss_of_the_last_device_exits_75() {
    let job = TestJob::wide();
    let expected = single_device_film(&job);
    let faults: [(&str, Settings<'_>); 3] = [
        ("cuda:0", &[("FAULTS", "lost:0:1")]),
        ("cuda:0,0", &[("FAULTS", "lost:0:5"), ("STREAMS", "deferred")]),
        ("cuda", &[("DEVICES", "2"), ("FAULTS", "lost:0:3,lost:1:2")]),
    ];
    for (device, settings) in faults {
        assert_exit(
            &run(&job, device, settings),
            RETRY,
            &["the last GPU failed", "is lost", "same command resumes"],
        );
        run(&job, device, &[]).ok();
        assert!(take_files(&job) == expected, "other bits after {device} {settings:?}");
    }
}

pub fn kernel_error_exits_1() {
    let job = TestJob::wide();
    let expected = single_device_film(&job);
    assert_exit(
        &run(&job, "cuda:0", &[("FAULTS", "kernel:0:3")]),
        FAILED,
        &["GPU 0", "kernel failed", "resumes"],
    );
    run(&job, "cuda:0", &[]).ok();
    assert!(take_files(&job) == expected);
}

pub fn out_of_device_memory_continues_with_half_the_memory() {
    let job = TestJob::wide();
    let expected = single_device_film(&job);
    // Allocation of buffers, of charts, of a band's tables, of the next band's, and again after that.
    for n in ["memory:0:2", "memory:0:7", "memory:0:9", "memory:0:14,memory:0:16"] {
        let ran = run(&job, "cuda:0", &[("FAULTS", n)]);
        assert_exit(&ran, 0, &["half of its memory", "out of memory for"]);
        assert!(take_files(&job) == expected, "other bits after {n}");
    }
}

pub fn too_small_device_memory_is_an_error_with_the_needed_size() {
    let job = TestJob::wide();
    assert_exit(
        &run(&job, "cuda:0", &[("MEMORY", "1e6")]),
        FAILED,
        &["GPU 0", "needs", "MiB", "--device cpu"],
    );
    assert_exit(&run(&job, "auto", &[("MEMORY", "1e6")]), 0, &["device: cpu (", "needs"]);
    std::fs::remove_dir_all(&job.film).unwrap();
    let mut command = command(&job, &job.film, "cuda:0", &[], "");
    assert_exit(
        &CommandResult::new(&command.args(["--memory", "64MiB"]).output().unwrap()),
        USAGE,
        &["--memory", "at least"],
    );
}

pub fn unsuitable_driver_or_device_exits_2() {
    let job = TestJob::wide();
    let cases: [(&str, Settings<'_>, &[&str]); 4] = [
        ("cuda", &[("DRIVER", "12010")], &["12.1", "12.2"]),
        ("cuda", &[("DEVICES", "0")], &["no GPU"]),
        ("cuda:0,3", &[("DEVICES", "2")], &["GPU 3", "2 GPUs are visible", "0 to 1"]),
        ("cuda", &[("CAPABILITY", "7.5")], &["7.5", "8.0"]),
    ];
    for (device, settings, words) in cases {
        assert_exit(&run(&job, device, settings), USAGE, words);
        assert!(!job.film.exists(), "{settings:?}");
    }
    assert_exit(&run(&job, "auto", &[("DRIVER", "12010")]), 0, &["device: cpu (", "12.1"]);
    std::fs::remove_dir_all(&job.film).unwrap();
    assert_exit(&run(&job, "auto", &[]), 0, &["device: GPU 0"]);
    assert_eq!(record(&job.film)["device"], "cuda:0");
}

pub fn missing_driver_exits_2_without_fallback_to_cpu() {
    let job = TestJob::wide();
    for device in ["cuda", "cuda:0"] {
        let ran = job.run("", &["--device", device]);
        assert_exit(&ran, USAGE, &["no NVIDIA driver", "--device cpu"]);
        assert!(!job.film.exists());
    }
    assert_exit(&job.run("", &["--device", "auto", "-v"]), 0, &["device: cpu (", "no NVIDIA driver"]);
    assert_eq!(record(&job.film)["device"], "cpu");
}

pub fn signal_downloads_tiles_in_flight_and_exits_130() {
    let job = TestJob::tall();
    let expected = single_device_film(&job);
    let small = min_memory(&job);
    let settings = [("DELAY_US", "20000"), ("MEMORY", &small)];
    let mut command = command(&job, &job.film, "cuda:0", &settings, "write:9+:terminate");
    let ran = CommandResult::new(&command.output().unwrap());
    assert_exit(&ran, 130, &["stopping after the tiles in progress", "resumes"]);
    run(&job, "cuda:0", &[]).ok();
    assert!(take_files(&job) == expected);
}
