//! Workers: locks, progress as JSON lines, the end of the parent.

use super::*;

#[test]
fn two_workers_of_one_unit_write_the_same_bytes() {
    let planned = Planned::new(place(), &["--unit-rows", "4"]);
    let expected = planned.single_run(&[]);
    let mut first = StoppedRun(planned.worker_with_fault("0", "rename:9:stop").spawn().unwrap());
    assert!(first.wait_stopped());
    let pid = first.0.id().to_string();
    crate::common::assert_exit(
        &lenscube(&["status", "--plan", text(&planned.job)]),
        0,
        &["units   0 of 4; missing 0-3", &pid],
    );
    crate::common::assert_exit(
        &planned.run("0", &[]),
        0,
        &[&format!("process {pid}"), "both write the same bytes"],
    );
    assert_eq!(planned.missing(), "1-3");
    crate::common::assert_exit(&first.run_to_end(), 0, &[]);
    // Complete units do not open the chart.
    let aside = planned.place.at("aside.zarr");
    fs::rename(&planned.place.chart, &aside).unwrap();
    crate::common::assert_exit(&planned.run("0", &[]), 0, &["units 0 of", "are complete: 32 shards"]);
    fs::rename(&aside, &planned.place.chart).unwrap();
    crate::common::assert_exit(&planned.run("1-3", &[]), 0, &[]);
    assert!(files(&planned.place.film) == expected && planned.place.leftover_files().is_empty());
}

#[test]
fn lock_of_another_host_does_not_block_a_worker() {
    let planned = Planned::new(place(), &["--unit-rows", "4"]);
    assert_eq!(planned.worker_with_fault("2", "rename:5:kill").status().unwrap().code(), None);
    let runs = planned.place.film.join("runs");
    let lock =
        fs::read_dir(&runs).unwrap().map(|e| e.unwrap().path()).find(|p| text(p).ends_with(".lock")).unwrap();
    let owner = fs::read_to_string(&lock).unwrap();
    let mut owner: Value = serde_json::from_str(&owner).unwrap();
    owner["host"] = "elsewhere".into();
    fs::write(&lock, owner.to_string()).unwrap();
    crate::common::assert_exit(&planned.run("2", &[]), 0, &["resuming units 2 of"]);
    assert!(!lock.exists());
    assert_eq!(planned.missing(), "0-1,3");
}

#[test]
fn jsonl_progress_has_start_progress_shard_and_done_events() {
    let planned = Planned::new(place(), &["--unit-rows", "2"]);
    let lines = |ran: &CommandResult| -> Vec<Value> {
        ran.stdout.lines().map(|l| serde_json::from_str(l).unwrap()).collect()
    };
    let ran = planned.run("1-2", &["--progress", "jsonl"]).ok();
    let events = lines(&ran);
    let of = |event: &str| events.iter().filter(|l| l["event"] == event).collect::<Vec<_>>();
    let digest = &planned.plan["digest"].as_str().unwrap()[..12];
    assert!(events.iter().all(|l| l["plan"] == digest && l["units"] == "1-2" && l["elapsed_s"].is_number()));
    assert_eq!((of("start").len(), of("shard").len(), of("done").len()), (1, 32, 1));
    assert_eq!((&events[0]["event"], &events[events.len() - 1]["event"]), (&"start".into(), &"done".into()));
    assert_eq!((&events[0]["shards"], &events[0]["shards_done"]), (&32.into(), &0.into()));
    let progress = of("progress");
    assert!(
        !progress.is_empty()
            && progress.iter().all(|l| l["tiles_total"] == events[0]["tiles"] && l["mpx_per_s"].is_number())
    );
    let bytes = of("shard").iter().map(|l| l["bytes"].as_u64().unwrap()).sum::<u64>();
    assert_eq!(of("done")[0]["bytes_written"], bytes);
    assert_eq!(of("done")[0]["shards"], 32);
    let keys: std::collections::BTreeSet<&str> =
        of("shard").iter().filter_map(|l| l["key"].as_str()).collect();
    assert!(keys.len() == 32 && keys.iter().all(|k| planned.place.film.join(k).is_file()), "{keys:?}");
    // Nothing to do, interrupted work, errors.
    let again = lines(&planned.run("1-2", &["--progress", "jsonl"]).ok());
    assert_eq!((again.len(), &again[1]["event"], &again[1]["shards"]), (2, &"done".into(), &0.into()));
    let full =
        planned.worker("0", &["--progress", "jsonl"]).env("LENSCUBE_FAULT", "write:2+:28").output().unwrap();
    let full = CommandResult::new(&full);
    let last = lines(&full).pop().unwrap();
    assert_eq!(
        (full.code, &last["event"], &last["code"], &last["retry"]),
        (RETRY, &"error".into(), &RETRY.into(), &true.into())
    );
    assert!(last["message"].as_str().unwrap().contains("no space left"), "{last}");
    let other = lines(&planned.run("0", &["--progress", "jsonl", "--interp", "bilinear"])).pop().unwrap();
    assert_eq!(
        (&other["event"], &other["code"], &other["retry"]),
        (&"error".into(), &OTHER_JOB.into(), &false.into())
    );
    // A run without a plan writes the same events without plan fields.
    let film = planned.place.at("plain.zarr");
    let plain =
        CommandResult::new(&planned.place.command(&film, "", &["--progress", "jsonl"]).output().unwrap())
            .ok();
    let events = lines(&plain);
    assert!(events.iter().all(|l| l.get("plan").is_none()));
    assert_eq!(
        (&events[events.len() - 1]["event"], &events[events.len() - 1]["shards"]),
        (&"done".into(), &128.into())
    );
}

/// State letter of a process; `None` if there is no such process.
fn state(pid: &str) -> Option<char> {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    stat.rsplit_once(") ")?.1.chars().next()
}

#[cfg(target_os = "linux")]
#[test]
fn worker_ends_with_its_parent_only_with_die_with_parent() {
    use std::io::{BufRead, BufReader};
    use std::time::{Duration, Instant};
    let wait = |pid: &str, wanted: &[Option<char>]| {
        let start = Instant::now();
        while start.elapsed() < Duration::from_secs(300) {
            if wanted.contains(&state(pid)) {
                return true;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        false
    };
    for with_flag in [true, false] {
        let planned = Planned::new(place(), &["--unit-rows", "8"]);
        let flag = if with_flag { "--die-with-parent" } else { "--keep-going" };
        let words = [env!("CARGO_BIN_EXE_lenscube"), "run", "--plan", text(&planned.job), flag];
        let mut parent = Command::new("sh")
            .args(["-c", "\"$@\" & echo $!; wait", "sh"])
            .args(words)
            .env("LENSCUBE_FAULT", "rename:9:stop")
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut pid = String::new();
        BufReader::new(parent.stdout.take().unwrap()).read_line(&mut pid).unwrap();
        let pid = pid.trim();
        assert!(wait(pid, &[Some('T')]), "the worker did not stop at its ninth shard");
        parent.kill().unwrap();
        parent.wait().unwrap();
        // Ended: absent, or a zombie.
        let dead = [None, Some('Z'), Some('X')];
        match with_flag {
            true => assert!(wait(pid, &dead), "the worker outlived its parent"),
            false => {
                std::thread::sleep(Duration::from_millis(200));
                assert_eq!(state(pid), Some('T'), "the worker ended without --die-with-parent");
                Command::new("kill").args(["-s", "KILL", pid]).status().unwrap();
                assert!(wait(pid, &dead));
            }
        }
        assert_eq!(planned.missing(), "0-1");
        crate::common::assert_exit(&planned.run("0-1", &[]), 0, &["resuming"]);
    }
}
