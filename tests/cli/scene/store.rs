//! The files of a scene: bytes for any threads and memory, kills, replacement, other commands.

use super::*;

/// Threads, memory and the shape of the tiles in flight change no byte, nor do kills.
#[test]
fn bytes_do_not_depend_on_threads_memory_or_kills() {
    let place = Place::new();
    let (mesh, whole) = (place.mesh(), place.at("whole.zarr"));
    let flags = ["--samples-per-px", "1", "--quiet"];
    let size = "700x600";
    scene(&mesh, &whole, size, &[&flags[..], &["--threads", "2", "--memory", "1GiB"]].concat()).ok();
    let expected = files(&whole);
    let small = place.at("small.zarr");
    scene(&mesh, &small, size, &[&flags[..], &["--threads", "1", "--memory", "140MiB"]].concat()).ok();
    assert!(files(&small) == expected);
    let killed = place.at("killed.zarr");
    for fault in ["commit:2:kill", "write:3:kill", "scene-shard:4:kill", "locked:1:kill"] {
        let mut command = command(&mesh, &killed, size, &flags);
        assert!(!command.env("LENSCUBE_FAULT", fault).output().unwrap().status.success(), "{fault}");
    }
    assert_exit(&scene(&mesh, &killed, size, &["--samples-per-px", "1"]), 0, &["resuming"]);
    assert!(files(&killed) == expected);
    assert_exit(&scene(&mesh, &killed, size, &["--samples-per-px", "1"]), 0, &["nothing to do"]);
    let other = scene(&mesh, &killed, size, &["--samples-per-px", "4"]);
    assert_exit(&other, OTHER_JOB, &["another job", "samples_per_px", "--overwrite"]);
    assert_exit(&lenscube(&["verify", text(&killed)]), 0, &["scene", "0 defects"]);
    std::fs::remove_file(killed.join("depth/c/0/0")).unwrap();
    let mut bytes = std::fs::read(killed.join("weights/c/1/1/0")).unwrap();
    bytes[9] ^= 4;
    std::fs::write(killed.join("weights/c/1/1/0"), bytes).unwrap();
    let found = lenscube(&["verify", text(&killed), "--repair"]);
    assert_exit(
        &found,
        WRONG,
        &["missing depth/c/0/0", "bad weights/c/1/1/0", "1 bad shards removed", "lenscube scene"],
    );
    let run = lenscube(&[
        "run",
        text(&killed),
        text(&place.at("f.zarr")),
        "--lens",
        "phone",
        "--focus-m",
        "1",
        "--wavelengths",
        "550",
    ]);
    assert_error_line(&run, USAGE, &["2 of its files are missing", "not complete"]);
    scene(&mesh, &killed, size, &flags).ok();
    assert!(files(&killed) == expected);
}

/// `status` and `verify` name a scene; one that is made is no mesh; a sun below the horizon has a note.
#[test]
fn other_commands_name_a_scene() {
    let place = Place::new();
    let (mesh, out) = (place.mesh(), place.at("scene.zarr"));
    let made = scene(&mesh, &out, "60x40", &["--samples-per-px", "1", "--sun", "10,-5"]);
    assert_exit(&made, 0, &["5 deg below the horizon"]);
    assert_exit(
        &lenscube(&["status", text(&out), "--check"]),
        0,
        &["scene, complete: 15 of 15 shards; 3 surfaces of 3 weights"],
    );
    std::fs::remove_file(out.join("hidden/2/depth/c/0/0")).unwrap();
    let found = lenscube(&["status", text(&out), "--check"]);
    assert_exit(&found, WRONG, &["incomplete: 14 of 15 shards", "missing hidden/2/depth/c/0/0"]);
    let json: serde_json::Value =
        serde_json::from_str(&lenscube(&["status", text(&out), "--json"]).ok().stdout).unwrap();
    assert_eq!(
        (&json["complete"], &json["shards_done"], &json["weights"]),
        (&false.into(), &14.into(), &3.into())
    );
    assert_error_line(
        &scene(&out, &place.at("b.zarr"), "60x40", &[]),
        USAGE,
        &["is a scene already", "lenscube run"],
    );
}

/// Of two commands that replace a scene at once, each makes it or ends with one line that says to wait or to repeat.
#[test]
fn two_commands_that_replace_a_scene_lose_nothing() {
    let place = Place::new();
    let (mesh, out) = (place.mesh(), place.at("scene.zarr"));
    let flags = ["--samples-per-px", "1", "--quiet", "--overwrite"];
    scene(&mesh, &out, "60x40", &flags).ok();
    let expected = files(&out);
    for _ in 0..12 {
        let start = || {
            let mut command = command(&mesh, &out, "60x40", &flags);
            command.stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped()).spawn().unwrap()
        };
        let results = [start(), start()].map(|child| CommandResult::new(&child.wait_with_output().unwrap()));
        assert!(results.iter().any(|result| result.code == 0), "{} {}", results[0].stderr, results[1].stderr);
        for result in results.iter().filter(|result| result.code != 0) {
            assert_eq!((result.code, result.stderr.lines().count()), (RETRY, 1), "{}", result.stderr);
            let is_clear = ["is locked by process", "run the same command again"]
                .iter()
                .any(|t| result.stderr.contains(t));
            assert!(is_clear, "{}", result.stderr);
        }
        assert!(files(&out) == expected);
    }
}
