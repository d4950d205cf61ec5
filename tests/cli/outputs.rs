//! Outputs of commands that end early: the files of an export appear together or not at all, old files are kept until then, temporary
//! files are removed, and problems with temporary files and locks are reported.

use crate::common::test_job::TestJob;
use crate::common::{CommandResult, Picture, files, text};
use pipeline::geometry::Size;
use std::collections::BTreeMap;
use std::os::unix::fs::symlink;
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

const KILLED: i32 = -1;

fn lenscube(fault: &str, words: &[&str]) -> CommandResult {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
    if !fault.is_empty() {
        command.env("LENSCUBE_FAULT", fault);
    }
    CommandResult::new(&command.args(words).output().unwrap())
}

/// Files of a directory without temporary names.
fn named(dir: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    files(dir).into_iter().filter(|(p, _)| !text(p).contains(".tmp-")).collect()
}

fn temporary(dir: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(dir).unwrap().map(|e| e.unwrap().path());
    entries.filter(|p| text(p).contains("tmp-") || text(p).contains(".part")).collect()
}

/// Injects `fault` at the first, second, … occurrence of each of `steps` until a command ends without one, and calls `check` after
/// each command; the number of faults.
fn inject_at_every(
    steps: &[&str],
    fault: &str,
    command: &dyn Fn(&str) -> CommandResult,
    check: &mut dyn FnMut(&str, &CommandResult),
) -> usize {
    let mut faults = 0;
    for step in steps {
        for n in 1.. {
            let fault = format!("{step}:{n}:{fault}");
            let ran = command(&fault);
            check(&fault, &ran);
            if !ran.stderr.contains("fault injected by") {
                assert_eq!(ran.code, 0, "{fault}: {}", ran.stderr);
                break;
            }
            faults += 1;
        }
    }
    faults
}

#[test]
fn killed_envi_export_leaves_the_old_or_the_new_pair_of_files() {
    let dir = tempfile::tempdir().unwrap();
    let (chart, out) = (dir.path().join("chart.zarr"), dir.path().join("out"));
    Picture::noise(3, Size::new(40, 50), 2).write(&chart);
    std::fs::create_dir(&out).unwrap();
    let header = out.join("x.hdr");
    let export = |fault: &str, bands: &str| {
        lenscube(fault, &["export", text(&chart), text(&header), "--overwrite", "--bands", bands])
    };
    export("", "0").ok();
    let old = files(&out);
    export("", "0:1").ok();
    let new = files(&out);
    assert_eq!((old.len(), new.len()), (2, 2));
    let (data, head) = (PathBuf::from("x.bsq"), PathBuf::from("x.hdr"));
    let steps = ["sync", "rename", "sync-directory"];
    let mut without_header = 0;
    let start = |fault: &str| {
        export("", "0").ok();
        assert_eq!(files(&out), old);
        export(fault, "0:1")
    };
    let faults = inject_at_every(&steps, "kill", &start, &mut |fault, ran| {
        let found = named(&out);
        match found.contains_key(&head) {
            true => assert!(found == old || found == new, "{fault}"),
            false => {
                without_header += 1;
                assert!(found.get(&data).is_none_or(|d| *d == old[&data] || *d == new[&data]), "{fault}");
                let export = lenscube("", &["export", text(&header), text(&dir.path().join("y.npy"))]);
                assert_eq!(export.code, 1, "{fault}: {}", export.stderr);
            }
        }
        assert!(ran.code == 0 || ran.code == KILLED, "{fault}: {}", ran.stderr);
        export("", "0:1").ok();
        assert_eq!(files(&out), new, "{fault}: not completed by the same command");
    });
    assert!(
        faults >= 8 && without_header <= 4,
        "{faults} kills, {without_header} of them between the renames"
    );
    // After an error, unlike a kill, the old state is restored.
    inject_at_every(&steps, "28", &start, &mut |fault, ran| {
        let found = files(&out);
        assert!(found == old || found == new, "{fault}: {:?}", found.keys());
        assert!(ran.code == 0 || ran.code == 75 && ran.stderr.contains("no space left"), "{}", ran.stderr);
    });
}

#[test]
fn killed_chart_overwrite_leaves_the_old_or_the_new_chart() {
    let dir = tempfile::tempdir().unwrap();
    let chart = dir.path().join("chart.zarr");
    let draw = |fault: &str, value: &str| {
        let words = ["chart", "uniform", text(&chart), "--size", "40", "--wavelengths", "500", "--overwrite"];
        lenscube(fault, &[&words[..], &["--value", value]].concat())
    };
    draw("", "1").ok();
    let old = files(&chart);
    draw("", "2").ok();
    let new = files(&chart);
    assert_ne!(old, new);
    let start = |fault: &str| {
        draw("", "1").ok();
        draw(fault, "2")
    };
    for (fault, code) in [("kill", KILLED), ("28", 75)] {
        let faults =
            inject_at_every(&["write", "rename", "publish", "sweep"], fault, &start, &mut |fault, ran| {
                let found = files(&chart);
                assert!(found == old || found == new, "{fault}: {:?}", found.keys());
                assert!(ran.code == 0 || ran.code == code, "{fault}: {}", ran.stderr);
            });
        assert!(faults >= 5, "{faults}");
    }
    draw("", "2").ok();
    assert_eq!((files(&chart), temporary(dir.path())), (new, Vec::new()));
}

#[test]
fn temporary_file_of_a_killed_trace_is_removed_by_the_next() {
    for name in ["a.lens.zarr", "a.lens.zip"] {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join(name);
        let trace = |wavelengths: &str| {
            let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
            command.args(["lens", "trace", "double-gauss-28", text(&out), "--wavelengths", wavelengths]);
            command.args(["--max-height-mm", "3"]).stderr(Stdio::null());
            command
        };
        let mut child = trace("400:700:10").spawn().unwrap();
        let start = Instant::now();
        while temporary(dir.path()).is_empty() && start.elapsed() < Duration::from_secs(60) {
            std::thread::sleep(Duration::from_millis(2));
        }
        child.kill().unwrap();
        child.wait().unwrap();
        assert_eq!(temporary(dir.path()).len(), 1, "{name}");
        assert!(trace("500").status().unwrap().success());
        let left: Vec<_> = std::fs::read_dir(dir.path()).unwrap().map(|e| e.unwrap().path()).collect();
        assert_eq!(left, [out]);
    }
}

#[test]
fn temporary_file_that_cannot_be_removed_is_a_note() {
    let job = TestJob::small();
    assert_eq!(job.run("rename:12:kill", &[]).code, KILLED);
    let left = |job: &TestJob| job.leftover_files().iter().filter(|p| text(p).contains(".tmp-")).count();
    let dead = left(&job);
    assert!(dead > 0);
    // Not permitted (another user's file in a sticky directory), permission denied, read-only file system.
    for errno in ["1", "13", "30"] {
        let ran = job.run(&format!("sweep:1+:{errno}"), &[]);
        assert!(ran.stderr.contains("fault injected by"), "{errno}: {}", ran.stderr);
        if errno == "1" {
            let note = format!("note: {dead} temporary files of ended processes could not be removed");
            assert!(ran.stderr.contains(&note), "{}", ran.stderr);
        }
        assert_eq!(ran.code, 0, "{errno}: {}", ran.stderr);
        assert_eq!(left(&job), dead);
    }
    // The same for an export: one is killed, the next may not remove files.
    let (film, out) = (job.film.clone(), job.at("out"));
    std::fs::create_dir(&out).unwrap();
    let export =
        |fault: &str| lenscube(fault, &["export", text(&film), text(&out.join("x.npy")), "--overwrite"]);
    assert_eq!(export("rename:1:kill").code, KILLED);
    assert_eq!(temporary(&out).len(), 1);
    export("sweep:1+:1").ok();
    assert_eq!(temporary(&out).len(), 1);
    export("").ok();
    assert_eq!(temporary(&out), Vec::<PathBuf>::new());
}

#[test]
fn fifo_as_lock_file_is_an_error_without_blocking() {
    let job = TestJob::small();
    assert_eq!(job.run("rename:12:kill", &[]).code, KILLED);
    let lock = job.film.join("runs/whole.lock");
    std::fs::remove_file(&lock).unwrap();
    assert!(Command::new("mkfifo").arg(&lock).status().unwrap().success());
    let start = Instant::now();
    let ran = job.run("", &[]);
    assert_eq!(ran.code, 1, "{}", ran.stderr);
    assert!(ran.stderr.contains("whole.lock is a FIFO, expected a lock file"), "{}", ran.stderr);
    let status = lenscube("", &["status", text(&job.film)]).ok();
    assert!(status.stdout.contains("may be running; if it is not, use --take-over"), "{}", status.stdout);
    assert!(start.elapsed() < Duration::from_secs(60));
    std::fs::remove_file(&lock).unwrap();
    job.run("", &[]).ok();
}

#[test]
fn devices_fifos_and_sockets_are_not_replaced() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    lenscube("", &["chart", "uniform", text(&at("chart.zarr")), "--size", "8"]).ok();
    assert!(Command::new("mkfifo").arg(at("fifo.npy")).status().unwrap().success());
    let _listener = UnixListener::bind(at("socket.npy")).unwrap();
    let mut kinds = vec![("fifo.npy", "a FIFO or pipe"), ("socket.npy", "a socket")];
    // A node of its own with the numbers of /dev/null, which only root can make.
    if Command::new("mknod").arg(at("device.npy")).args(["c", "1", "3"]).output().unwrap().status.success() {
        kinds.push(("device.npy", "a device"));
    }
    for (name, kind) in kinds {
        let before = at(name).metadata().unwrap().file_type();
        symlink(at(name), at("link.npy")).unwrap();
        for path in [at(name), at("link.npy")] {
            let ran = lenscube("", &["export", text(&at("chart.zarr")), text(&path), "--overwrite"]);
            assert_eq!(ran.code, 2, "{}", ran.stderr);
            let expected = format!("OUT {} is {kind}, which would be replaced by a file", path.display());
            assert!(ran.stderr.contains(&expected), "{}", ran.stderr);
        }
        std::fs::remove_file(at("link.npy")).unwrap();
        assert_eq!(at(name).metadata().unwrap().file_type(), before);
    }
}

/// Each command line ends at once, though nothing writes into the FIFO; a text may come through one.
#[test]
fn files_that_an_input_names_or_that_lie_beside_it_are_not_replaced() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    std::fs::write(at("sensor.toml"), "[spectral]\nfile = \"qe.csv\"\n").unwrap();
    lenscube("", &["lens", "convert", "phone", text(&at("lens.zmx"))]).ok();
    for (name, link) in [("qe.csv", "qe.png"), ("g.agf", "g.npy")] {
        std::fs::write(at(name), "mine").unwrap();
        symlink(at(name), at(link)).unwrap();
    }
    let (sensor, set) = (at("sensor.toml"), "crosstalk.file=\"qe.csv\"");
    let (design, table, glass) = (at("lens.zmx"), at("qe.png"), at("g.npy"));
    let [sensor, design, table, glass] = [&sensor, &design, &table, &glass].map(|path| text(path));
    let chart = "gen:composite?size=64";
    for words in [
        &["sensor", chart, table, "--sensor", sensor, "--exposure", "1ms", "--overwrite"][..],
        &["sensor", chart, table, "--sensor", sensor, "--set", set, "--exposure", "1ms", "--overwrite"],
        &["shoot", chart, table, "--lens", "phone", "--sensor", sensor, "--overwrite"],
        &["lens", "psf", design, glass, "--overwrite"],
        &["shoot", chart, glass, "--lens", design, "--sensor", "example-2um", "--overwrite"],
        &["develop", "raw.zarr", glass, "--shading", design, "--overwrite"],
    ] {
        let ran = lenscube("", words);
        assert!(
            ran.code == 2 && ran.stderr.contains("which this command reads"),
            "{words:?}: {}",
            ran.stderr
        );
    }
    for name in ["qe.csv", "g.agf"] {
        assert_eq!(std::fs::read(at(name)).unwrap(), b"mine");
    }
}

#[test]
fn fifos_are_no_inputs_but_texts() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    lenscube("", &["chart", "uniform", text(&at("chart.zarr")), "--size", "8"]).ok();
    let fifos =
        ["chart.npy", "lens.zmx", "lens.lens.zip", "film.zarr", "picture.png", "depth.npy", "plain.toml"]
            .map(at);
    let made = Command::new("mkfifo").args(&fifos).status().unwrap();
    assert!(made.success());
    let [npy, zmx, pack, film, png, depth, plain] = fifos.each_ref().map(|path| text(path));
    let (chart, out) = (at("chart.zarr"), at("out"));
    let (chart, out) = (text(&chart), text(&out));
    for (words, what) in [
        (&["run", npy, out][..], "chart"),
        (&["run", chart, out, "--lens", zmx], "lens"),
        (&["run", chart, out, "--lens", pack], "lens"),
        (&["run", chart, out, "--lens", "phone", "--depth", depth], "depth array"),
        (&["shoot", npy, "out.png", "--lens", "phone", "--sensor", "cmv12000-mono"], "chart"),
        (&["sensor", film, out, "--sensor", "cmv12000-mono", "--exposure", "1s"], "film"),
        (&["export", film, "out.npy"], "film"),
        (&["measure", film, "--points", "1,1"], "film"),
        (&["chart", "image", png, "out.zarr"], "picture"),
        (&["lens", "show", zmx], "lens"),
        (&["lens", "light", zmx], "lens"),
        (&["lens", "convert", zmx, "out.csv"], "lens"),
        (&["bench", "--lens", zmx], "lens"),
        (&["lens", "camera", zmx, "--film-size", "9", "--film-pitch-um", "2"], "lens"),
        (&["lens", "diff", "phone", pack], "lens"),
        (&["status", film], "film"),
        (&["verify", film], "film"),
        (&["pyramid", plain], "film"),
        (&["view", film], "film"),
        (&["sensor", "show", plain], "sensor description"),
        (&["run", "--plan", plain, "--unit", "0"], "plan"),
        (&["status", chart, "--plan", plain], "plan"),
    ] {
        let ran = lenscube("", words);
        assert_eq!(ran.code, 2, "{words:?}: {}", ran.stderr);
        assert!(ran.stderr.contains(&format!("the {what} ")), "{words:?}: {}", ran.stderr);
        assert!(
            ran.stderr.contains("is a FIFO or pipe, not a regular file or a directory"),
            "{words:?}: {}",
            ran.stderr
        );
    }
    assert!(!at("out").exists());
    let reader = std::thread::spawn({
        let plain = at("plain.toml");
        move || std::fs::write(plain, "default = \"x\"\n[coating.x]\nreflectance = 0.5\n")
    });
    let light = lenscube("", &["lens", "light", "triplet", "--coatings", plain]).ok();
    reader.join().unwrap().unwrap();
    assert!(light.stdout.contains("0.5"), "{}", light.stdout);
}

#[test]
fn full_disk_is_a_temporary_error_of_every_writer() {
    let dir = tempfile::tempdir().unwrap();
    let (chart, out) = (dir.path().join("chart.zarr"), dir.path().join("out"));
    Picture::noise(3, Size::new(40, 50), 3).write(&chart);
    std::fs::create_dir(&out).unwrap();
    let measure = ["measure", text(&chart), "--profile", "0,0,30,30"];
    let export = ["export", text(&chart)];
    let at = |name: &str| text(&out.join(name)).to_owned();
    for words in [
        &[&export[..], &[&at("a.png")]].concat()[..],
        &[&export[..], &[&at("a.png"), "--band", "450"]].concat(),
        &[&export[..], &[&at("a.tif")]].concat(),
        &[&export[..], &[&at("a.tif"), "--format", "tiff-bands"]].concat(),
        &[&export[..], &[&at("a.exr")]].concat(),
        &[&export[..], &[&at("a.npy")]].concat(),
        &[&export[..], &[&at("a.hdr")]].concat(),
        &[&measure[..], &["--plot", &at("a.png")]].concat(),
        &[&measure[..], &["--plot", &at("a.svg"), "--csv", &at("a.csv"), "--json", &at("a.json")]].concat(),
        &["lens", "convert", "double-gauss-28", &at("a.zmx")],
    ] {
        let faults = inject_at_every(&["write"], "28", &|fault| lenscube(fault, words), &mut |fault, ran| {
            let end = if ran.stderr.contains("fault injected by") { 75 } else { 0 };
            assert_eq!(ran.code, end, "{words:?}, {fault}: {}", ran.stderr);
            assert_eq!(end == 75, ran.stderr.contains("no space left"), "{words:?}, {fault}: {}", ran.stderr);
            assert_eq!(end == 75, files(&out).is_empty(), "{words:?}, {fault}");
            files(&out).into_keys().for_each(|name| std::fs::remove_file(out.join(name)).unwrap());
        });
        assert!(faults >= 1, "{words:?}");
    }
}

#[test]
fn limit_of_file_sizes_is_an_error_that_names_limit_and_file() {
    let dir = tempfile::tempdir().unwrap();
    let (chart, out) = (dir.path().join("chart.zarr"), dir.path().join("out"));
    Picture::noise(3, Size::new(200, 200), 3).write(&chart);
    std::fs::create_dir(&out).unwrap();
    for (name, flags) in [
        ("a.png", &[][..]),
        ("a.tif", &[]),
        ("b.tif", &["--format", "tiff-bands"]),
        ("a.exr", &[]),
        ("a.npy", &[]),
        ("a.hdr", &[]),
    ] {
        let file = out.join(name);
        let script = "ulimit -f 8; exec \"$0\" \"$@\"";
        let mut command = Command::new("sh");
        command.args(["-c", script, env!("CARGO_BIN_EXE_lenscube"), "export", text(&chart), text(&file)]);
        let ran = CommandResult::new(&command.args(flags).output().unwrap());
        let named = if name == "a.hdr" { out.join("a.bsq") } else { file };
        crate::common::assert_error_line(&ran, 1, &[text(&named), "(ulimit -f) of ", " bytes is reached"]);
        assert!(files(&out).is_empty(), "{name}");
    }
}

#[test]
#[cfg_attr(not(target_os = "linux"), ignore = "unavailable: no /dev/full")]
fn full_disk_behind_standard_output_is_a_temporary_error() {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
    let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
    let ran = CommandResult::new(&command.args(["lens", "list"]).stdout(full).output().unwrap());
    crate::common::assert_error_line(&ran, 75, &["writing the result", "No space left"]);
}
