//! A film that another command replaces while a process works on it: that process ends with exit code 3 and the new film is as if
//! it had never been. Processes are held (SIGSTOP) at named points; see `formats/src/durable/fault.rs`.

mod common;

use common::place::{Place, Stopped};
use common::{Ran, files, lenscube, text};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

const OTHER_JOB: i32 = 3;
const USAGE: i32 = 2;
const WRONG: i32 = 4;
const RETRY: i32 = 75;

/// The flag that makes job B of job A.
const B: [&str; 2] = ["--interp", "bilinear"];

fn held(mut command: Command, fault: &str) -> Stopped {
    command.env("LENSCUBE_FAULT", fault).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut stopped = Stopped(command.spawn().unwrap());
    assert!(stopped.wait_stopped(), "the process ended before {fault}");
    stopped
}

fn worker(plan: &Path, unit: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
    command.args(["run", "--plan", text(plan), "--unit", unit, "--no-fsync", "--progress", "jsonl"]);
    command
}

fn plan(place: &Place, name: &str, flags: &[&str]) -> Ran {
    let job = place.at(name);
    Ran::of(&place.plan(&place.film, flags).args(["-o", text(&job)]).output().unwrap())
}

/// Removes the locks of a film, as if its file system had none.
fn without_locks(film: &Path) {
    for entry in fs::read_dir(film.join("runs")).into_iter().flatten() {
        let path = entry.unwrap().path();
        if text(&path).ends_with(".lock") {
            fs::remove_file(path).unwrap();
        }
    }
}

/// The process that was held must end with code 3 and say so, and the film must be that of job B.
fn ends_as_replaced(ran: &Ran, context: &str) {
    assert_eq!(ran.code, OTHER_JOB, "{context}: {}{}", ran.stdout, ran.stderr);
    assert!(ran.stderr.contains("another job's film has replaced it"), "{context}: {}", ran.stderr);
    assert!(!ran.stderr.contains("resumes"), "{context}: {}", ran.stderr);
    let last = ran.stdout.lines().last().map(|line| serde_json::from_str::<Value>(line).unwrap());
    if let Some(last) = last {
        assert_eq!(
            (&last["event"], &last["code"], &last["retry"]),
            (&"error".into(), &3.into(), &false.into())
        );
    }
}

/// Files of a film with those of its runs.
fn all_files(film: &Path) -> Vec<String> {
    let mut names: Vec<String> = files(film).keys().map(|p| text(p).to_owned()).collect();
    let runs = fs::read_dir(film.join("runs")).into_iter().flatten();
    names.extend(runs.map(|e| e.unwrap().path().to_string_lossy().into_owned()));
    names
}

#[test]
fn a_worker_held_anywhere_writes_nothing_into_the_film_that_replaced_its_own() {
    let place = Place::small();
    for point in [
        "film-opened:1",
        "job-ready:1",
        "locked:1",
        "tiles-begin:1",
        "commit:1",
        "commit-checked:1",
        "commit-checked:4",
        "create:3",
        "write:4",
        "rename:3",
        "shards-made:1",
    ] {
        plan(&place, "a.json", &[]).ok();
        let first = held(worker(&place.at("a.json"), "0"), &format!("{point}:stop"));
        without_locks(&place.film);
        plan(&place, "b.json", &[&["--overwrite"], &B[..]].concat()).ok();
        let fresh = (files(&place.film), all_files(&place.film));
        ends_as_replaced(&first.go_on(), point);
        assert!(
            (files(&place.film), all_files(&place.film)) == fresh,
            "{point}: {:?}",
            all_files(&place.film)
        );
        assert_eq!(place.leavings(), Vec::<std::path::PathBuf>::new(), "{point}");
        Ran::of(&worker(&place.at("b.json"), "0").output().unwrap()).ok();
        lenscube(&["verify", text(&place.film)]).ok();
        let all = lenscube(&["status", "--plan", text(&place.at("b.json")), "--check"]);
        assert_eq!(all.code, 0, "{point}: {}", all.stdout);
        let of_a = lenscube(&["status", "--plan", text(&place.at("a.json")), "--check"]);
        assert_eq!(of_a.code, OTHER_JOB, "{point}: {}", of_a.stdout);
        for name in ["a.json", "b.json"] {
            fs::remove_file(place.at(name)).unwrap();
        }
        fs::remove_dir_all(&place.film).unwrap();
    }
}

#[test]
fn a_second_worker_without_the_lock_writes_nothing_into_the_film_that_replaced_its_own() {
    let place = Place::small();
    plan(&place, "a.json", &[]).ok();
    let mut first = held(worker(&place.at("a.json"), "0"), "commit:2:stop");
    let second = held(worker(&place.at("a.json"), "0"), "commit-checked:2:stop");
    // The lock protects the film while its owner lives.
    let refused = plan(&place, "b.json", &[&["--overwrite"], &B[..]].concat());
    assert_eq!(refused.code, RETRY, "{}", refused.stderr);
    first.signal("KILL");
    first.0.wait().unwrap();
    plan(&place, "b.json", &[&["--overwrite"], &B[..]].concat()).ok();
    let fresh = all_files(&place.film);
    ends_as_replaced(&second.go_on(), "second worker");
    assert_eq!(all_files(&place.film), fresh);
}

#[test]
fn a_run_without_a_plan_writes_nothing_into_the_film_that_replaced_its_own() {
    let place = Place::small();
    for point in ["film-opened:1", "locked:1", "commit-checked:2", "rename:12", "shards-made:1"] {
        let first = held(place.command(&place.film, "", &[]), &format!("{point}:stop"));
        without_locks(&place.film);
        let other = place.command(&place.film, "", &[&["--overwrite"], &B[..]].concat()).output().unwrap();
        Ran::of(&other).ok();
        let fresh = (files(&place.film), all_files(&place.film));
        ends_as_replaced(&first.go_on(), point);
        assert!((files(&place.film), all_files(&place.film)) == fresh, "{point}");
        lenscube(&["verify", text(&place.film)]).ok();
        fs::remove_dir_all(&place.film).unwrap();
    }
    // The same job begun anew: the command may be given again.
    let first = held(place.command(&place.film, "", &[]), "commit:1:stop");
    without_locks(&place.film);
    Ran::of(&place.command(&place.film, "", &["--overwrite"]).output().unwrap()).ok();
    let ran = first.go_on();
    assert_eq!(ran.code, RETRY, "{}", ran.stderr);
    assert!(ran.stderr.contains("run the same command again"), "{}", ran.stderr);
    lenscube(&["verify", text(&place.film)]).ok();
}

#[test]
fn pyramid_and_repair_change_nothing_in_the_film_that_replaced_theirs() {
    let place = Place::new(pipeline::geometry::Size::new(300, 290), &["--shard", "64", "--chunk", "32"]);
    let command = |words: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        command.args(words);
        command
    };
    let film = text(&place.film);
    for (words, fault) in [
        (&["pyramid", film][..], "commit:1:stop"),
        (&["pyramid", film], "rename:2:stop"),
        (&["verify", film, "--repair"], "locked:1:stop"),
        (&["verify", film, "--repair"], "shard-aside:1:stop"),
    ] {
        place.run("", &["--no-fsync"]).ok();
        fs::write(place.film.join("film/c/0/1/1"), "bad").unwrap();
        if words[0] == "pyramid" {
            fs::remove_file(place.film.join("film/c/0/1/1")).unwrap();
            place.run("", &["--no-fsync"]).ok();
        }
        let first = held(command(words), fault);
        without_locks(&place.film);
        Ran::of(&place.command(&place.film, "", &[&["--overwrite"], &B[..]].concat()).output().unwrap()).ok();
        let fresh = all_files(&place.film);
        let ran = first.go_on();
        assert_eq!(ran.code, OTHER_JOB, "{words:?} {fault}: {}{}", ran.stdout, ran.stderr);
        assert_eq!(all_files(&place.film), fresh, "{words:?} {fault}");
        lenscube(&["verify", film]).ok();
        fs::remove_dir_all(&place.film).unwrap();
    }
}

#[test]
fn repair_keeps_a_sound_shard_that_a_worker_has_just_made() {
    let place = Place::small();
    plan(&place, "a.json", &[]).ok();
    let ran = Ran::of(&worker(&place.at("a.json"), "0").output().unwrap()).ok();
    assert!(ran.stdout.contains("\"done\""));
    let whole = files(&place.film);
    let key = place.film.join("film/c/0/1/0");
    let mut bytes = fs::read(&key).unwrap();
    bytes[100] ^= 1;
    fs::write(&key, &bytes).unwrap();
    // Judged bad; before it is removed someone else removes it, and a worker makes it again.
    let mut repair = Command::new(env!("CARGO_BIN_EXE_lenscube"));
    repair.args(["verify", text(&place.film), "--repair"]);
    let first = held(repair, "verified:1:stop");
    fs::remove_file(&key).unwrap();
    Ran::of(&worker(&place.at("a.json"), "0").output().unwrap()).ok();
    assert!(files(&place.film) == whole);
    let ran = first.go_on();
    assert_eq!(ran.code, WRONG, "{}{}", ran.stdout, ran.stderr);
    assert!(ran.stderr.contains("removed 0 bad shards"), "{}", ran.stderr);
    assert!(files(&place.film) == whole && place.leavings().is_empty());
}

#[test]
fn overwrite_removes_nothing_that_the_film_did_not_make() {
    let place = Place::small();
    place.run("", &[]).ok();
    let film = text(&place.film);
    let pack = place.film.join("pack.lens.zip");
    for (name, bytes) in [("cube.npy", b"\x93NUMPY"), ("image.exr", b"v/1\x01.."), ("job.json", b"{....}")] {
        fs::write(place.film.join(name), bytes).unwrap();
    }
    fs::copy(&place.pack, &pack).unwrap();
    let before = files(&place.film);
    let overwrite = |lens: &Path| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        command.args(["run", text(&place.chart), film, "--lens", text(lens), "--overwrite"]);
        Ran::of(&command.args(B).args(["--shard", "64", "--chunk", "32"]).output().unwrap())
    };
    for lens in [&pack, &place.pack] {
        let ran = overwrite(lens);
        assert_eq!(ran.code, OTHER_JOB, "{}", ran.stderr);
        for name in ["cube.npy", "image.exr", "job.json", "pack.lens.zip", "nothing was removed"] {
            assert!(ran.stderr.contains(name), "{name}: {}", ran.stderr);
        }
        assert!(files(&place.film) == before);
    }
    for name in ["cube.npy", "image.exr", "job.json", "pack.lens.zip"] {
        fs::remove_file(place.film.join(name)).unwrap();
    }
    // A chart likewise.
    let (chart, note) = (place.at("drawn.zarr"), place.at("drawn.zarr/note.txt"));
    let draw = ["chart", "uniform", text(&chart), "--size", "32", "--wavelengths", "500", "--overwrite"];
    lenscube(&draw).ok();
    fs::write(&note, "mine").unwrap();
    let ran = lenscube(&draw);
    assert!(ran.code == OTHER_JOB && ran.stderr.contains("note.txt"), "{}", ran.stderr);
    fs::remove_file(&note).unwrap();
    lenscube(&draw).ok();
    overwrite(&place.pack).ok();
}

#[test]
fn overwrite_keeps_links_to_films_charts_and_exports() {
    let place = Place::small();
    let disk = place.at("disk");
    fs::create_dir(&disk).unwrap();
    let link = |name: &str| {
        let link = place.at(name);
        std::os::unix::fs::symlink(disk.join(name), &link).unwrap();
        link
    };
    let film = link("link.zarr");
    for flags in [&[][..], &["--overwrite"]] {
        Ran::of(&place.command(&film, "", flags).output().unwrap()).ok();
        assert!(film.is_symlink() && disk.join("link.zarr/zarr.json").is_file());
        assert!(!fs::symlink_metadata(disk.join("link.zarr")).unwrap().is_symlink());
    }
    let slash = place.at("link.zarr/");
    Ran::of(&place.command(&slash, "", &["--overwrite"]).output().unwrap()).ok();
    assert!(film.is_symlink());
    let (chart, picture) = (link("chart2.zarr"), link("film.png"));
    for _ in 0..2 {
        let size = ["--size", "32", "--wavelengths", "500", "--overwrite"];
        lenscube(&[&["chart", "uniform", text(&chart)], &size[..]].concat()).ok();
        lenscube(&["export", text(&film), text(&picture), "--overwrite"]).ok();
        assert!(chart.is_symlink() && picture.is_symlink() && disk.join("film.png").is_file());
    }
    // Without --overwrite a link that leads nowhere is not taken for an absent file.
    fs::remove_file(disk.join("film.png")).unwrap();
    assert_eq!(lenscube(&["export", text(&film), text(&picture)]).code, OTHER_JOB);
}

#[test]
fn a_plan_that_cannot_be_written_leaves_the_film_as_it_is() {
    let place = Place::small();
    place.run("", &[]).ok();
    let before = files(&place.film);
    let notes = place.at("notes.json");
    fs::write(&notes, "mine").unwrap();
    let of = |flags: &[&str]| {
        Ran::of(&place.plan(&place.film, &[&["--overwrite"], &B[..], flags].concat()).output().unwrap())
    };
    plan(&place, "a.json", &[]).ok();
    for (flags, code, word) in [
        (&["-o", text(&notes)][..], OTHER_JOB, "is not this plan"),
        (&["-o", text(&place.at("a.json"))], OTHER_JOB, "is not this plan"),
        (&["-o", text(&place.at("no/such/directory/job.json"))], USAGE, "no/such/directory"),
        (&["-o", text(&place.film)], USAGE, "lies inside the film"),
        (&["-o", text(&place.film.join("job.json"))], USAGE, "lies inside the film"),
    ] {
        let ran = of(flags);
        assert_eq!(ran.code, code, "{flags:?}: {}", ran.stderr);
        assert!(ran.stderr.contains(word), "{flags:?}: {}", ran.stderr);
        assert!(files(&place.film) == before, "{flags:?}");
    }
    assert_eq!(fs::read_to_string(&notes).unwrap(), "mine");
    // Nor is a film created for a plan that is refused.
    let new = place.at("new.zarr");
    let ran = Ran::of(&place.plan(&new, &["-o", text(&notes)]).output().unwrap());
    assert!(ran.code == OTHER_JOB && !new.exists(), "{}", ran.stderr);
}

#[test]
fn a_lens_pack_for_a_plan_is_no_other_output_of_it() {
    let place = Place::small();
    let design = place.at("design.zmx");
    fs::write(&design, include_str!("../pipeline/data/double-gauss-28.zmx")).unwrap();
    let of = |pack: &Path| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        command.args(["plan", text(&place.chart), text(&place.film), "--lens", text(&design)]);
        command.args(["--lens-pack", text(pack), "-o", text(&place.at("job.json"))]);
        Ran::of(&command.output().unwrap())
    };
    for pack in [&place.film, &place.film.join("pack.lens.zarr"), &place.at("job.json"), &place.chart] {
        let ran = of(pack);
        assert_eq!(ran.code, USAGE, "{}: {}", pack.display(), ran.stderr);
        assert!(!place.film.exists() && !place.at("job.json").exists());
    }
}

#[test]
fn a_builtin_lens_keeps_its_meaning_beside_a_directory_of_its_name() {
    let place = Place::small();
    let dir = place.at("here");
    fs::create_dir(&dir).unwrap();
    fs::copy(&place.pack, dir.join("double-gauss-28-npz")).unwrap();
    let lens = |lens: &str, film: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        command.args(["plan", text(&place.chart), text(&place.at(film)), "--lens", lens, "-o"]);
        command.arg(place.at(&format!("{film}.json"))).current_dir(&dir);
        Ran::of(&command.output().unwrap()).ok()
    };
    let planned = |film: &str| -> Value {
        serde_json::from_slice(&fs::read(place.at(&format!("{film}.json"))).unwrap()).unwrap()
    };
    let builtin = lens("double-gauss-28-npz", "builtin.zarr");
    assert!(builtin.stderr.contains("./double-gauss-28-npz"), "{}", builtin.stderr);
    assert_eq!(planned("builtin.zarr")["command"]["flags"][0], "--lens=double-gauss-28-npz");
    lens("./double-gauss-28-npz", "own.zarr");
    let own = format!("--lens={}/./double-gauss-28-npz", text(&dir));
    assert_eq!(planned("own.zarr")["command"]["flags"][0], own.as_str());
    assert_ne!(planned("builtin.zarr")["job"]["lens_digest"], planned("own.zarr")["job"]["lens_digest"]);
    for film in ["builtin.zarr", "own.zarr"] {
        Ran::of(&worker(&place.at(&format!("{film}.json")), "0").current_dir("/").output().unwrap()).ok();
    }
}

#[test]
fn demo_replaces_only_what_it_made() {
    let dir = tempfile::tempdir().unwrap();
    let demo = || {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        Ran::of(
            &command.args(["demo", "--size", "64", "--dir", "."]).current_dir(dir.path()).output().unwrap(),
        )
    };
    for name in ["chart.zarr", "film.zarr"] {
        fs::create_dir(dir.path().join(name)).unwrap();
        fs::write(dir.path().join(name).join("zarr.json"), "mine").unwrap();
    }
    let before = files(dir.path());
    let ran = demo();
    assert_eq!(ran.code, OTHER_JOB, "{}", ran.stderr);
    assert!(ran.stderr.contains("chart.zarr") && ran.stderr.contains("--dir"), "{}", ran.stderr);
    assert!(files(dir.path()) == before);
    for name in ["chart.zarr", "film.zarr"] {
        fs::remove_dir_all(dir.path().join(name)).unwrap();
    }
    // Its own directory it takes again.
    demo().ok();
    demo().ok();
    fs::write(dir.path().join("film.png"), "mine").unwrap();
    let ran = demo();
    assert!(ran.code == OTHER_JOB && ran.stderr.contains("film.png"), "{}", ran.stderr);
}

#[test]
fn validate_replaces_no_report_of_others() {
    let dir = tempfile::tempdir().unwrap();
    for name in ["report.html", "summary.json", "curves"] {
        let path = dir.path().join(name);
        fs::write(&path, "{}").unwrap();
        let ran = lenscube(&["validate", "--lens", "double-gauss-28-npz", "--out", text(dir.path())]);
        assert_eq!(ran.code, OTHER_JOB, "{}", ran.stderr);
        assert!(ran.stderr.contains(name), "{}", ran.stderr);
        fs::remove_file(path).unwrap();
    }
}

#[test]
fn a_film_lies_in_neither_its_chart_nor_its_lens_pack() {
    let place = Place::small();
    let pack = place.at("pack.lens.zarr");
    let lens = common::lens([450.0, 500.0].map(|nm| common::identity_band(nm, 1.0, 5)).into());
    let stacks = lens.bands.iter().map(common::delta).collect();
    common::write_pack(&pack, &lens, stacks);
    let before = files(&pack);
    let film = pack.join("psf/film.zarr");
    let ran = common::run(text(&place.chart), &film, text(&pack), &[]);
    assert!(ran.code == USAGE && ran.stderr.contains("lies inside its own lens pack"), "{}", ran.stderr);
    assert!(files(&pack) == before);
}
