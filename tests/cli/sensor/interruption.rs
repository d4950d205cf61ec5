//! Raws that were killed, interrupted or damaged, and disks that are full.

use super::{OTHER_JOB, WRONG};
use crate::common::camera::{Place, sensor, sensor_command};
use crate::common::test_job::StoppedRun;
use crate::common::{CommandResult, assert_exit, files, lenscube, text};
use pipeline::geometry::Size;
use std::process::{Command, Stdio};

/// Killed at several places and resumed, with exposures that were given and found.
#[test]
fn a_killed_run_is_resumed_with_the_same_bytes() {
    let place = Place::new();
    let film = place.noise(Size::new(2200, 2100));
    for exposure in [&["--exposure", "5ms,50ms"][..], &["--exposure", "auto", "--keep-signal"]] {
        let flags = [&["--sensor", "example-2um"][..], exposure].concat();
        let whole = place.at("whole");
        sensor(&film, &whole, &flags).ok();
        let expected = files(&whole);
        std::fs::remove_dir_all(&whole).unwrap();
        let raw = place.at("raw");
        for fault in ["commit:2:kill", "write:2:kill", "commit:3:kill"] {
            let mut command = sensor_command(&film, &raw, &flags);
            assert!(!command.env("LENSCUBE_FAULT", fault).output().unwrap().status.success(), "{fault}");
        }
        assert_exit(&sensor(&film, &raw, &flags), 0, &["resuming"]);
        assert!(files(&raw) == expected);
        assert_exit(&sensor(&film, &raw, &flags), 0, &["nothing to do"]);
        assert_exit(
            &sensor(&film, &raw, &[&flags[..], &["--seed", "2"]].concat()),
            OTHER_JOB,
            &["another job", "seed"],
        );
        sensor(&film, &raw, &[&flags[..], &["--seed", "2", "--overwrite"]].concat()).ok();
        std::fs::remove_dir_all(&raw).unwrap();
    }
}

/// A damaged shard is found, removed and made again with the same bytes.
#[test]
fn status_and_verify_find_what_a_raw_lacks() {
    let place = Place::new();
    let film = place.noise(Size::new(100, 120));
    let raw = place.at("raw");
    let flags = ["--sensor", "example-2um", "--exposure", "1ms,2ms", "--keep-signal"];
    sensor(&film, &raw, &flags).ok();
    let whole = files(&raw);
    assert_exit(&lenscube(&["status", text(&raw), "--check"]), 0, &["complete", "3 of 3 shards", "2 frames"]);
    assert_exit(&lenscube(&["verify", text(&raw)]), 0, &["3 shards", "0 defects"]);
    std::fs::remove_file(raw.join("raw/c/0/0/0")).unwrap();
    let bad = raw.join("raw/c/1/0/0");
    let mut bytes = std::fs::read(&bad).unwrap();
    bytes[20] ^= 1;
    std::fs::write(&bad, bytes).unwrap();
    assert_exit(&lenscube(&["status", text(&raw), "--check"]), WRONG, &["incomplete", "missing raw/c/0/0/0"]);
    assert_exit(
        &lenscube(&["verify", text(&raw), "--repair"]),
        WRONG,
        &["missing raw/c/0/0/0", "bad raw/c/1/0/0", "1 bad shards removed"],
    );
    let found = lenscube(&["verify", text(&raw), "--json"]);
    let report: serde_json::Value = serde_json::from_str(&found.stdout).unwrap();
    let bad = serde_json::json!([
        { "kind": "missing", "key": "raw/c/0/0/0", "reason": "no such file" },
        { "kind": "missing", "key": "raw/c/1/0/0", "reason": "no such file" },
    ]);
    assert_eq!((&report["findings"], &report["sound"]), (&bad, &false.into()), "{report}");
    assert_eq!((&report["temp_files"], &report["repaired"]), (&serde_json::json!([]), &().into()));
    sensor(&film, &raw, &flags).ok();
    assert!(files(&raw) == whole);
}

/// Coordinates and metadata of a raw follow from its attributes: found, and written again with the same bytes.
#[test]
fn verify_finds_and_restores_coordinates_and_metadata_of_a_raw() {
    let place = Place::new();
    let film = place.noise(Size::new(20, 30));
    let raw = place.at("raw");
    sensor(&film, &raw, &["--sensor", "example-2um", "--exposure", "1ms,2ms"]).ok();
    let whole = files(&raw);
    for name in ["exposure_s", "frame", "x", "y"] {
        let values = raw.join(name).join("c/0");
        let mut bytes = std::fs::read(&values).unwrap();
        bytes[3] ^= 1;
        std::fs::write(&values, bytes).unwrap();
    }
    std::fs::remove_dir_all(raw.join("frame")).unwrap();
    std::fs::remove_file(raw.join("raw/zarr.json")).unwrap();
    let found = ["6 defects", "metadata x/c/0", "metadata frame/zarr.json", "metadata raw/zarr.json"];
    assert_exit(&lenscube(&["verify", text(&raw)]), WRONG, &found);
    let repaired = ["wrote 4 damaged coordinates again", "wrote 2 damaged metadata files again"];
    assert_exit(&lenscube(&["verify", text(&raw), "--repair"]), WRONG, &repaired);
    assert_exit(&lenscube(&["verify", text(&raw)]), 0, &["0 defects"]);
    assert!(files(&raw) == whole);
    // Attributes follow from nothing.
    let group = raw.join("zarr.json");
    let text_of = std::fs::read_to_string(&group).unwrap();
    std::fs::write(&group, text_of.replacen("\"black_dn\": ", "\"black_dn\": 1", 1)).unwrap();
    let found =
        ["attributes do not match their digest", "cannot be repaired", "lenscube sensor … --overwrite"];
    assert_exit(&lenscube(&["verify", text(&raw), "--repair"]), WRONG, &found);
}

#[test]
fn a_full_disk_is_worth_a_retry() {
    let place = Place::new();
    let film = place.noise(Size::new(100, 100));
    let raw = place.at("raw");
    let mut command = sensor_command(&film, &raw, &["--sensor", "example-2um", "--exposure", "1ms"]);
    let ran = CommandResult::new(&command.env("LENSCUBE_FAULT", "write:11+:28").output().unwrap());
    assert_exit(&ran, 75, &["No space left"]);
}

/// Interrupted at a shard: exit code 130, and the same command resumes with the same bytes.
#[test]
fn interrupted_run_ends_with_130_and_resumes() {
    let place = Place::new();
    let film = place.noise(Size::new(2200, 2100));
    let flags = ["--sensor", "example-2um", "--exposure", "5ms,50ms", "--threads", "1"];
    let whole = place.at("whole");
    sensor(&film, &whole, &flags).ok();
    let raw = place.at("raw");
    let ran = interrupted_at(&mut sensor_command(&film, &raw, &flags), "commit:2");
    assert_exit(&ran, 130, &["interrupted: ", "; the same command resumes"]);
    assert_exit(&sensor(&film, &raw, &flags), 0, &["resuming"]);
    assert!(files(&raw) == files(&whole));
    // All frames of one row of shards.
    let small = place.film_named("small.film", Size::new(300, 300), |_, _, _| 1e-3);
    let frames = ["--sensor", "example-2um", "--exposure", "5ms", "--frames", "1000", "--threads", "1"];
    let ran = interrupted_at(&mut sensor_command(&small, &place.at("frames"), &frames), "commit:2");
    assert_exit(&ran, 130, &["interrupted: ", "; the same command resumes"]);
    // With --overwrite the same command would begin again.
    let over = [&flags[..], &["--overwrite"]].concat();
    let ran = interrupted_at(&mut sensor_command(&film, &raw, &over), "commit:2");
    assert_exit(&ran, 130, &["; without `--overwrite` the same command resumes"]);
    assert_exit(&sensor(&film, &raw, &flags), 0, &["resuming"]);
    assert!(files(&raw) == files(&whole));
}

/// Interrupted while the file is written from the complete raw: exit code 130, also with `--overwrite`, and the same command resumes.
#[test]
fn interrupted_file_ends_with_130_and_resumes() {
    let place = Place::new();
    let film = place.noise(Size::new(200, 160));
    let out = place.at("out.dng");
    let raw = place.at("out.dng.raw.zarr");
    let flags = ["--sensor", "example-2um", "--exposure", "5ms", "--seed", "3"];
    let ran = interrupted_at(&mut sensor_command(&film, &out, &flags), "file-begins:1");
    assert_exit(&ran, 130, &["interrupted: ", "out.dng was not written; the same command resumes"]);
    assert!(raw.exists() && !out.exists());
    assert_exit(&sensor(&film, &out, &flags), 0, &["nothing to do", "wrote"]);
    let first = std::fs::read(&out).unwrap();
    let other = ["--sensor", "example-2um", "--exposure", "5ms", "--seed", "4", "--overwrite"];
    let ran = interrupted_at(&mut sensor_command(&film, &out, &other), "file-begins:1");
    assert_exit(&ran, 130, &["the same command resumes"]);
    assert!(raw.exists() && std::fs::read(&out).unwrap() == first);
    assert_exit(&sensor(&film, &out, &other), 0, &["nothing to do", "wrote"]);
    assert!(!raw.exists() && std::fs::read(&out).unwrap() != first);
    // The raw of another job that an interrupted command left is replaced.
    interrupted_at(&mut sensor_command(&film, &out, &other), "file-begins:1");
    let over = [&flags[..], &["--overwrite"]].concat();
    assert_exit(&sensor(&film, &out, &over), 0, &["wrote"]);
    assert!(!raw.exists() && std::fs::read(&out).unwrap() == first);
}

/// Two commands with `--overwrite` at once: the later one is not told to use that flag.
#[test]
fn raw_that_another_process_made_meanwhile_is_said() {
    let place = Place::new();
    let film = place.noise(Size::new(100, 120));
    let raw = place.at("raw");
    let flags = ["--sensor", "example-2um", "--exposure", "5ms", "--overwrite"];
    let mut first = sensor_command(&film, &raw, &flags);
    first.env("LENSCUBE_FAULT", "raw-removed:1:stop").stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut first = StoppedRun(first.spawn().unwrap());
    assert!(first.wait_stopped(), "the process ended before it removed the raw");
    sensor(&film, &raw, &[&flags[..], &["--seed", "2"]].concat()).ok();
    let ran = first.run_to_end();
    assert_exit(
        &ran,
        OTHER_JOB,
        &["seed (raw 2, requested", "another process has made it since --overwrite"],
    );
    assert!(!ran.stderr.contains("replace it with"), "{}", ran.stderr);
}

/// The result of `command`, interrupted at the execution `at`, e.g. `commit:2`.
fn interrupted_at(command: &mut Command, at: &str) -> CommandResult {
    CommandResult::new(&command.env("LENSCUBE_FAULT", format!("{at}:interrupt")).output().unwrap())
}
