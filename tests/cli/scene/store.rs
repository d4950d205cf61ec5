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

/// A wavy net of 2·`side`² triangles before a camera at the origin, as glTF.
fn net(path: &Path, side: u32) {
    let across = side + 1;
    let vertices: Vec<f32> = (0..across * across)
        .flat_map(|k| {
            let at = |n: u32| 6.0 * (n as f32 / side as f32 - 0.5);
            let (x, y) = (at(k % across), at(k / across));
            [x, y, -2.0 + 0.2 * (5.0 * x).sin() * (7.0 * y).cos()]
        })
        .collect();
    let corners = (0..side * side).flat_map(|k| {
        let a = k / side * across + k % side;
        [a, a + 1, a + across + 1, a, a + across + 1, a + across]
    });
    let mut binary: Vec<u8> = vertices.iter().flat_map(|v| v.to_le_bytes()).collect();
    let split = binary.len();
    binary.extend(corners.flat_map(u32::to_le_bytes));
    let mut json = serde_json::json!({
        "asset": {"version": "2.0"}, "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": binary.len()}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": split},
            {"buffer": 0, "byteOffset": split, "byteLength": binary.len() - split}
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": across * across},
            {"bufferView": 1, "componentType": 5125, "type": "SCALAR", "count": 6 * side * side}
        ]
    })
    .to_string();
    json.push_str(&" ".repeat(3 - (json.len() + 3) % 4));
    let chunk =
        |kind: &[u8; 4], bytes: &[u8]| [&(bytes.len() as u32).to_le_bytes(), &kind[..], bytes].concat();
    let chunks = [chunk(b"JSON", json.as_bytes()), chunk(b"BIN\0", &binary)].concat();
    let header = [&b"glTF"[..], &2u32.to_le_bytes(), &(12 + chunks.len() as u32).to_le_bytes()].concat();
    std::fs::write(path, [header, chunks].concat()).unwrap();
}

/// Lists of a mesh that do not fit into half of the memory are in a scratch file, of which nothing remains, and change no byte.
#[test]
fn a_mesh_beyond_memory_is_in_a_scratch_file() {
    let place = Place::new();
    let mesh = place.at("net.glb");
    net(&mesh, 600);
    let view = ["--lens", "phone", "--focus-m", "1", "--film-pitch-um", "40", "--film-size", "90x60"];
    let camera = ["--eye", "0,0,0", "--target", "0,0,-1", "--threads", "1", "--quiet"];
    let make = |name: &str, memory: &str| {
        let out = place.at(name);
        let paths = ["scene", text(&mesh), text(&out)];
        lenscube(&[&paths[..], &view, &camera, &["--memory", memory]].concat()).ok();
        files(&out)
    };
    let expected = make("whole.zarr", "1GiB");
    assert!(make("small.zarr", "100MiB") == expected);
    assert_eq!(std::fs::read_dir(place.0.path()).unwrap().count(), 3);
    let info = |memory: &str| {
        let flags = ["scene", text(&mesh), "--info", "--memory", memory];
        lenscube(&[&flags[..], &view, &camera[..6]].concat()).ok().stdout
    };
    assert!(info("100MiB").contains("; a scratch file of "));
    assert!(!info("1GiB").contains("scratch"));
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
