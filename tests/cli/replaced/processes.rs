//! Processes whose film is replaced by another command while they are stopped (SIGSTOP) at named points; see
//! `formats/src/durable/fault.rs`.

use super::*;

fn start_until_stopped(mut command: Command, fault: &str) -> StoppedRun {
    command.env("LENSCUBE_FAULT", fault).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut stopped = StoppedRun(command.spawn().unwrap());
    assert!(stopped.wait_stopped(), "the process ended before {fault}");
    stopped
}

/// Removes the locks of a film, as on a file system without locks.
fn remove_locks(film: &Path) {
    for entry in fs::read_dir(film.join("runs")).into_iter().flatten() {
        let path = entry.unwrap().path();
        if text(&path).ends_with(".lock") {
            fs::remove_file(path).unwrap();
        }
    }
}

/// Asserts that the stopped process ended with code 3 and reported that its film was replaced.
fn assert_replaced(ran: &CommandResult, context: &str) {
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

/// File names of a film, including `runs/`.
fn all_files(film: &Path) -> Vec<String> {
    let mut names: Vec<String> = files(film).keys().map(|p| text(p).to_owned()).collect();
    let runs = fs::read_dir(film.join("runs")).into_iter().flatten();
    names.extend(runs.map(|e| e.unwrap().path().to_string_lossy().into_owned()));
    names
}

#[test]
fn worker_of_a_replaced_film_exits_3_and_writes_nothing() {
    let job = TestJob::small();
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
        plan(&job, "a.json", &[]).ok();
        let first = start_until_stopped(worker(&job.at("a.json"), "0"), &format!("{point}:stop"));
        remove_locks(&job.film);
        plan(&job, "b.json", &[&["--overwrite"], &JOB_B[..]].concat()).ok();
        let fresh = (files(&job.film), all_files(&job.film));
        assert_replaced(&first.run_to_end(), point);
        assert!((files(&job.film), all_files(&job.film)) == fresh, "{point}: {:?}", all_files(&job.film));
        assert_eq!(job.leftover_files(), Vec::<std::path::PathBuf>::new(), "{point}");
        CommandResult::new(&worker(&job.at("b.json"), "0").output().unwrap()).ok();
        lenscube(&["verify", text(&job.film)]).ok();
        let all = lenscube(&["status", "--plan", text(&job.at("b.json")), "--check"]);
        assert_eq!(all.code, 0, "{point}: {}", all.stdout);
        let of_a = lenscube(&["status", "--plan", text(&job.at("a.json")), "--check"]);
        assert_eq!(of_a.code, OTHER_JOB, "{point}: {}", of_a.stdout);
        for name in ["a.json", "b.json"] {
            fs::remove_file(job.at(name)).unwrap();
        }
        fs::remove_dir_all(&job.film).unwrap();
    }
}

#[test]
fn second_worker_of_a_replaced_film_exits_3_and_writes_nothing() {
    let job = TestJob::small();
    plan(&job, "a.json", &[]).ok();
    let mut first = start_until_stopped(worker(&job.at("a.json"), "0"), "commit:2:stop");
    let second = start_until_stopped(worker(&job.at("a.json"), "0"), "commit-checked:2:stop");
    // The lock protects the film while its owner is alive.
    let refused = plan(&job, "b.json", &[&["--overwrite"], &JOB_B[..]].concat());
    assert_eq!(refused.code, RETRY, "{}", refused.stderr);
    first.signal("KILL");
    first.0.wait().unwrap();
    plan(&job, "b.json", &[&["--overwrite"], &JOB_B[..]].concat()).ok();
    let fresh = all_files(&job.film);
    assert_replaced(&second.run_to_end(), "second worker");
    assert_eq!(all_files(&job.film), fresh);
}

#[test]
fn run_of_a_replaced_film_exits_3_and_writes_nothing() {
    let job = TestJob::small();
    for point in ["film-opened:1", "locked:1", "commit-checked:2", "rename:12", "shards-made:1"] {
        let first = start_until_stopped(job.command(&job.film, "", &[]), &format!("{point}:stop"));
        remove_locks(&job.film);
        let other = job.command(&job.film, "", &[&["--overwrite"], &JOB_B[..]].concat()).output().unwrap();
        CommandResult::new(&other).ok();
        let fresh = (files(&job.film), all_files(&job.film));
        assert_replaced(&first.run_to_end(), point);
        assert!((files(&job.film), all_files(&job.film)) == fresh, "{point}");
        lenscube(&["verify", text(&job.film)]).ok();
        fs::remove_dir_all(&job.film).unwrap();
    }
    // Two commands with --overwrite at once: the later one is not told to use that flag.
    let first = start_until_stopped(job.command(&job.film, "", &["--overwrite"]), "film-removed:1:stop");
    job.run("", &JOB_B).ok();
    let ran = first.run_to_end();
    assert_eq!(ran.code, OTHER_JOB, "{}", ran.stderr);
    assert!(ran.stderr.contains("another process has made it since --overwrite"), "{}", ran.stderr);
    fs::remove_dir_all(&job.film).unwrap();
    // Replaced by a film of the same job: the command may be run again.
    let first = start_until_stopped(job.command(&job.film, "", &[]), "commit:1:stop");
    remove_locks(&job.film);
    CommandResult::new(&job.command(&job.film, "", &["--overwrite"]).output().unwrap()).ok();
    let ran = first.run_to_end();
    assert_eq!(ran.code, RETRY, "{}", ran.stderr);
    assert!(ran.stderr.contains("run the same command again"), "{}", ran.stderr);
    lenscube(&["verify", text(&job.film)]).ok();
}

#[test]
fn pyramid_and_repair_of_a_replaced_film_exit_3_and_write_nothing() {
    let job = TestJob::new(pipeline::geometry::Size::new(300, 290), &["--shard", "64", "--chunk", "32"]);
    let command = |words: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        command.args(words);
        command
    };
    let film = text(&job.film);
    for (words, fault) in [
        (&["pyramid", film][..], "commit:1:stop"),
        (&["pyramid", film], "rename:2:stop"),
        (&["verify", film, "--repair"], "locked:1:stop"),
        (&["verify", film, "--repair"], "shard-aside:1:stop"),
    ] {
        job.run("", &["--no-fsync"]).ok();
        fs::write(job.film.join("film/c/0/1/1"), "bad").unwrap();
        if words[0] == "pyramid" {
            fs::remove_file(job.film.join("film/c/0/1/1")).unwrap();
            job.run("", &["--no-fsync"]).ok();
        }
        let first = start_until_stopped(command(words), fault);
        remove_locks(&job.film);
        CommandResult::new(
            &job.command(&job.film, "", &[&["--overwrite"], &JOB_B[..]].concat()).output().unwrap(),
        )
        .ok();
        let fresh = all_files(&job.film);
        let ran = first.run_to_end();
        assert_eq!(ran.code, OTHER_JOB, "{words:?} {fault}: {}{}", ran.stdout, ran.stderr);
        assert_eq!(all_files(&job.film), fresh, "{words:?} {fault}");
        lenscube(&["verify", film]).ok();
        fs::remove_dir_all(&job.film).unwrap();
    }
}

#[test]
fn repair_keeps_a_valid_shard_written_during_the_repair() {
    let job = TestJob::small();
    plan(&job, "a.json", &[]).ok();
    let ran = CommandResult::new(&worker(&job.at("a.json"), "0").output().unwrap()).ok();
    assert!(ran.stdout.contains("\"done\""));
    let expected = files(&job.film);
    let key = job.film.join("film/c/0/1/0");
    let mut bytes = fs::read(&key).unwrap();
    bytes[100] ^= 1;
    fs::write(&key, &bytes).unwrap();
    // The shard is found to be bad; before the repair removes it, it is removed and written again by a worker.
    let mut repair = Command::new(env!("CARGO_BIN_EXE_lenscube"));
    repair.args(["verify", text(&job.film), "--repair"]);
    let first = start_until_stopped(repair, "verified:1:stop");
    fs::remove_file(&key).unwrap();
    CommandResult::new(&worker(&job.at("a.json"), "0").output().unwrap()).ok();
    assert!(files(&job.film) == expected);
    let ran = first.run_to_end();
    assert_eq!(ran.code, WRONG, "{}{}", ran.stdout, ran.stderr);
    assert!(ran.stderr.contains("removed 0 damaged shards"), "{}", ran.stderr);
    assert!(files(&job.film) == expected && job.leftover_files().is_empty());
}
