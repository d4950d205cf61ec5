//! Files that `--overwrite`, `plan`, `demo` and `validate` must not replace.

use super::*;

#[test]
fn overwrite_of_a_film_with_foreign_files_exits_3() {
    let job = TestJob::small();
    job.run("", &[]).ok();
    let film = text(&job.film);
    let pack = job.film.join("pack.lens.zip");
    for (name, bytes) in [("cube.npy", b"\x93NUMPY"), ("image.exr", b"v/1\x01.."), ("job.json", b"{....}")] {
        fs::write(job.film.join(name), bytes).unwrap();
    }
    fs::copy(&job.pack, &pack).unwrap();
    let before = files(&job.film);
    let overwrite = |lens: &Path| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        command.args(["run", text(&job.chart), film, "--lens", text(lens), "--overwrite"]);
        CommandResult::new(&command.args(JOB_B).args(["--shard", "64", "--chunk", "32"]).output().unwrap())
    };
    let others = ["cube.npy", "image.exr", "job.json", "pack.lens.zip", "nothing was removed"];
    for (lens, code, names) in [(&pack, USAGE, &["contains the lens"][..]), (&job.pack, OTHER_JOB, &others)] {
        let ran = overwrite(lens);
        assert_eq!(ran.code, code, "{}", ran.stderr);
        for name in names {
            assert!(ran.stderr.contains(name), "{name}: {}", ran.stderr);
        }
        assert!(files(&job.film) == before);
    }
    for name in ["cube.npy", "image.exr", "job.json", "pack.lens.zip"] {
        fs::remove_file(job.film.join(name)).unwrap();
    }
    // The same for a chart.
    let (chart, note) = (job.at("drawn.zarr"), job.at("drawn.zarr/note.txt"));
    let draw = ["chart", "uniform", text(&chart), "--size", "32", "--wavelengths", "500", "--overwrite"];
    lenscube(&draw).ok();
    fs::write(&note, "mine").unwrap();
    let ran = lenscube(&draw);
    assert!(ran.code == OTHER_JOB && ran.stderr.contains("note.txt"), "{}", ran.stderr);
    fs::remove_file(&note).unwrap();
    lenscube(&draw).ok();
    overwrite(&job.pack).ok();
}

#[test]
fn overwrite_keeps_symbolic_links() {
    let job = TestJob::small();
    let disk = job.at("disk");
    fs::create_dir(&disk).unwrap();
    let link = |name: &str| {
        let link = job.at(name);
        std::os::unix::fs::symlink(disk.join(name), &link).unwrap();
        link
    };
    let film = link("link.zarr");
    for flags in [&[][..], &["--overwrite"]] {
        CommandResult::new(&job.command(&film, "", flags).output().unwrap()).ok();
        assert!(film.is_symlink() && disk.join("link.zarr/zarr.json").is_file());
        assert!(!fs::symlink_metadata(disk.join("link.zarr")).unwrap().is_symlink());
    }
    let slash = job.at("link.zarr/");
    CommandResult::new(&job.command(&slash, "", &["--overwrite"]).output().unwrap()).ok();
    assert!(film.is_symlink());
    let (chart, picture) = (link("chart2.zarr"), link("film.png"));
    for _ in 0..2 {
        let size = ["--size", "32", "--wavelengths", "500", "--overwrite"];
        lenscube(&[&["chart", "uniform", text(&chart)], &size[..]].concat()).ok();
        lenscube(&["export", text(&film), text(&picture), "--overwrite"]).ok();
        assert!(chart.is_symlink() && picture.is_symlink() && disk.join("film.png").is_file());
    }
    // Without --overwrite a dangling link counts as an existing file.
    fs::remove_file(disk.join("film.png")).unwrap();
    assert_eq!(lenscube(&["export", text(&film), text(&picture)]).code, OTHER_JOB);
}

#[test]
fn plan_with_invalid_output_leaves_the_film_unchanged() {
    let job = TestJob::small();
    job.run("", &[]).ok();
    let before = files(&job.film);
    let notes = job.at("notes.json");
    fs::write(&notes, "mine").unwrap();
    let of = |flags: &[&str]| {
        CommandResult::new(
            &job.plan(&job.film, &[&["--overwrite"], &JOB_B[..], flags].concat()).output().unwrap(),
        )
    };
    plan(&job, "a.json", &[]).ok();
    for (flags, code, word) in [
        (&["-o", text(&notes)][..], OTHER_JOB, "another file exists"),
        (&["-o", text(&job.at("a.json"))], OTHER_JOB, "another file exists"),
        (&["-o", text(&job.at("no/such/directory/job.json"))], USAGE, "no/such/directory"),
        (&["-o", text(&job.film)], USAGE, "lies in FILM"),
        (&["-o", text(&job.film.join("job.json"))], USAGE, "lies in FILM"),
    ] {
        let ran = of(flags);
        assert_eq!(ran.code, code, "{flags:?}: {}", ran.stderr);
        assert!(ran.stderr.contains(word), "{flags:?}: {}", ran.stderr);
        assert!(files(&job.film) == before, "{flags:?}");
    }
    assert_eq!(fs::read_to_string(&notes).unwrap(), "mine");
    // A file that cannot be read is not reported as another file.
    let looped = job.at("loop.json");
    std::os::unix::fs::symlink("loop.json", &looped).unwrap();
    let ran = of(&["-o", text(&looped)]);
    assert!(!ran.stderr.contains("another file exists") && ran.code != 0, "{}", ran.stderr);
    // No film is created for a rejected plan.
    let new = job.at("new.zarr");
    let ran = CommandResult::new(&job.plan(&new, &["-o", text(&notes)]).output().unwrap());
    assert!(ran.code == OTHER_JOB && !new.exists(), "{}", ran.stderr);
}

#[test]
fn lens_pack_path_inside_another_output_exits_2() {
    let job = TestJob::small();
    let design = job.at("design.zmx");
    fs::write(&design, include_str!("../../../formats/data/lenses/double-gauss-28.zmx")).unwrap();
    let of = |pack: &Path| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        command.args(["plan", text(&job.chart), text(&job.film), "--lens", text(&design)]);
        command.args(["--lens-pack", text(pack), "-o", text(&job.at("job.json"))]);
        CommandResult::new(&command.output().unwrap())
    };
    for pack in [&job.film, &job.film.join("pack.lens.zarr"), &job.at("job.json"), &job.chart] {
        let ran = of(pack);
        assert_eq!(ran.code, USAGE, "{}: {}", pack.display(), ran.stderr);
        assert!(!job.film.exists() && !job.at("job.json").exists());
    }
}

#[test]
fn builtin_lens_name_takes_precedence_over_a_local_file() {
    let job = TestJob::small();
    let dir = job.at("here");
    fs::create_dir(&dir).unwrap();
    fs::copy(&job.pack, dir.join("double-gauss-28-npz")).unwrap();
    let lens = |lens: &str, film: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        command.args(["plan", text(&job.chart), text(&job.at(film)), "--lens", lens, "-o"]);
        command.arg(job.at(&format!("{film}.json"))).current_dir(&dir);
        CommandResult::new(&command.output().unwrap()).ok()
    };
    let planned = |film: &str| -> Value {
        serde_json::from_slice(&fs::read(job.at(&format!("{film}.json"))).unwrap()).unwrap()
    };
    let builtin = lens("double-gauss-28-npz", "builtin.zarr");
    assert!(builtin.stderr.contains("./double-gauss-28-npz"), "{}", builtin.stderr);
    assert_eq!(planned("builtin.zarr")["command"]["flags"][0], "--lens=double-gauss-28-npz");
    lens("./double-gauss-28-npz", "own.zarr");
    let own = format!("--lens={}/./double-gauss-28-npz", text(&dir));
    assert_eq!(planned("own.zarr")["command"]["flags"][0], own.as_str());
    assert_ne!(planned("builtin.zarr")["job"]["lens_digest"], planned("own.zarr")["job"]["lens_digest"]);
    for film in ["builtin.zarr", "own.zarr"] {
        CommandResult::new(&worker(&job.at(&format!("{film}.json")), "0").current_dir("/").output().unwrap())
            .ok();
    }
}

/// A small demo in `dir`.
fn demo(dir: &Path) -> CommandResult {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
    command.args(["demo", "--size", "64", "--dir", "."]).current_dir(dir);
    // The bands of the lens are traced by the first run of the test on a machine.
    CommandResult::new(&command.env("XDG_CACHE_HOME", env!("CARGO_TARGET_TMPDIR")).output().unwrap())
}

#[test]
fn demo_exits_3_on_files_it_did_not_make() {
    let dir = tempfile::tempdir().unwrap();
    for name in ["chart.zarr", "film.zarr", "film.png"] {
        let path = dir.path().join(name);
        if name.ends_with("png") {
            fs::write(&path, "mine").unwrap();
        } else {
            fs::create_dir(&path).unwrap();
            fs::write(path.join("zarr.json"), "mine").unwrap();
        }
        let before = files(dir.path());
        let ran = demo(dir.path());
        assert_eq!(ran.code, OTHER_JOB, "{}", ran.stderr);
        assert!(ran.stderr.contains(name) && ran.stderr.contains("--dir"), "{}", ran.stderr);
        assert!(files(dir.path()) == before);
        match path.is_dir() {
            true => fs::remove_dir_all(path).unwrap(),
            false => fs::remove_file(path).unwrap(),
        }
    }
}

#[test]
#[ignore = "long: 50 s"]
fn demo_replaces_its_own_files_alone() {
    let dir = tempfile::tempdir().unwrap();
    demo(dir.path()).ok();
    demo(dir.path()).ok();
    fs::write(dir.path().join("film.png"), "mine").unwrap();
    let ran = demo(dir.path());
    assert!(ran.code == OTHER_JOB && ran.stderr.contains("film.png"), "{}", ran.stderr);
}

#[test]
fn validate_exits_3_on_foreign_files() {
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
fn film_inside_its_lens_pack_exits_2() {
    let job = TestJob::small();
    let pack = job.at("pack.lens.zarr");
    let lens = crate::common::lens([450.0, 500.0].map(|nm| crate::common::identity_band(nm, 1.0, 5)).into());
    let stacks = lens.bands.iter().map(crate::common::delta).collect();
    crate::common::write_pack(&pack, &lens, stacks);
    let before = files(&pack);
    let film = pack.join("psf/film.zarr");
    let ran = crate::common::run(text(&job.chart), &film, text(&pack), &[]);
    assert!(ran.code == USAGE && ran.stderr.contains("lies in the lens"), "{}", ran.stderr);
    assert!(files(&pack) == before);
}
