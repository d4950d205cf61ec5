//! `lenscube pyramid` of films and raws: killed and resumed, on incomplete films, as part of `run`, in `status` and `verify`.

use crate::common::camera::{Place, sensor};
use crate::common::test_job::TestJob;
use crate::common::{CommandResult, assert_exit, files, lenscube, text};
use pipeline::geometry::Size;
use std::path::Path;
use std::process::Command;

fn pyramid(film: &Path, fault: &str) -> CommandResult {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
    command.args(["pyramid", text(film), "--threads", "2"]);
    if !fault.is_empty() {
        command.env("LENSCUBE_FAULT", fault);
    }
    CommandResult::new(&command.output().unwrap())
}

#[test]
fn killed_pyramid_is_resumed_to_the_same_files() {
    let job = TestJob::large();
    job.run("", &["--no-fsync"]).ok();
    let film = files(&job.film);
    let copy = job.at("copy.zarr");
    let copied = Command::new("cp").arg("-r").args([&job.film, &copy]).status().unwrap();
    assert!(copied.success());
    pyramid(&copy, "").ok();
    let expected = files(&copy);
    for (path, bytes) in film.iter().filter(|(p, _)| text(p) != "zarr.json") {
        assert_eq!(expected.get(path), Some(bytes), "{path:?}");
    }
    // Files 1 to 8 are metadata, then the shards of two levels, then the metadata of the group.
    let mut killed = 0;
    for fault in [
        "rename:2:kill",
        "create:6:kill",
        "write:3:torn",
        "rename:4:kill",
        "sync-directory:9:kill",
        "write:30:kill",
        "any:1:kill",
    ] {
        let ran = pyramid(&job.film, fault);
        if ran.code == 0 {
            break;
        }
        assert_eq!(ran.code, -1, "{fault}: {}", ran.stderr);
        killed += 1;
    }
    assert!(killed >= 5, "{killed}");
    pyramid(&job.film, "").ok();
    assert_eq!(files(&job.film), expected);
    assert!(job.leftover_files().is_empty(), "{:?}", job.leftover_files());
    let again = pyramid(&job.film, "").ok();
    assert!(again.stderr.contains("nothing to do"), "{}", again.stderr);
}

#[test]
fn status_verify_and_run_support_films_with_a_pyramid() {
    let job = TestJob::large();
    let ran = job.run("", &["--no-fsync", "--pyramid"]).ok();
    assert!(ran.stderr.contains("film in 3 levels down to 177x158 px"), "{}", ran.stderr);
    let expected = files(&job.film);
    let status = lenscube(&["status", text(&job.film), "--check"]).ok();
    assert!(status.stdout.contains("pyramid complete"), "{}", status.stdout);
    lenscube(&["verify", text(&job.film)]).ok();
    job.run("", &["--no-fsync"]).ok();
    assert_eq!(files(&job.film), expected);
    // A bad shard of a level is found, removed and computed again.
    std::fs::write(job.film.join("pyramid/film/1/c/0/1/1"), b"no shard").unwrap();
    let found = lenscube(&["verify", text(&job.film), "--repair"]);
    assert!(found.code == 4 && found.stdout.contains("bad: pyramid/film/1/c/0/1/1"), "{}", found.stdout);
    let status = lenscube(&["status", text(&job.film)]).ok();
    assert!(status.stdout.contains("pyramid unfinished"), "{}", status.stdout);
    pyramid(&job.film, "").ok();
    assert_eq!(files(&job.film), expected);
    // Overwriting a film removes its pyramid.
    job.run("", &["--no-fsync", "--overwrite", "--stages", "ri"]).ok();
    assert!(!job.film.join("pyramid").exists());
    let status = lenscube(&["status", text(&job.film), "--json"]).ok();
    assert!(status.stdout.contains("\"pyramid\": \"none\""), "{}", status.stdout);
}

#[test]
fn incomplete_film_exits_4_and_a_stale_pyramid_is_replaced() {
    let job = TestJob::large();
    job.run("", &["--no-fsync", "--pyramid"]).ok();
    let expected = files(&job.film);
    let shard = job.film.join("film/c/1/2/3");
    let bytes = std::fs::read(&shard).unwrap();
    std::fs::remove_file(&shard).unwrap();
    let ran = pyramid(&job.film, "");
    assert!(
        ran.code == 4 && ran.stderr.contains("1 of 60") && ran.stderr.contains("film/c/1/2/3"),
        "{}",
        ran.stderr
    );
    // A changed shard makes the pyramid stale.
    std::fs::copy(job.film.join("film/c/0/2/3"), &shard).unwrap();
    let status = lenscube(&["status", text(&job.film)]).ok();
    assert!(status.stdout.contains("pyramid of an earlier version"), "{}", status.stdout);
    let ran = pyramid(&job.film, "").ok();
    assert!(ran.stderr.contains("replacing it"), "{}", ran.stderr);
    assert_ne!(files(&job.film), expected);
    std::fs::write(&shard, bytes).unwrap();
    pyramid(&job.film, "").ok();
    assert_eq!(files(&job.film), expected);
}

#[test]
fn pyramid_of_a_chart_or_missing_path_exits_1() {
    let job = TestJob::small();
    let ran = pyramid(&job.chart, "");
    assert!(ran.code == 1 && ran.stderr.contains("expected a film"), "{}", ran.stderr);
    assert_eq!(pyramid(&job.at("nothing"), "").code, 1);
}

/// Levels of a raw: made, killed, resumed; the raw itself is as before for whoever exposes or develops it.
#[test]
fn raw_gets_levels_and_stays_the_same_raw() {
    let place = Place::new();
    let film = place.noise(Size::new(600, 700));
    let flags = ["--sensor", "example-2um", "--exposure", "1ms,2ms", "--keep-signal"];
    let raw = place.raw("raw.zarr", &film, &flags);
    let before = files(&raw);
    for fault in ["rename:2:kill", "write:5:torn", "any:1:kill"] {
        assert_eq!(pyramid(&raw, fault).code, -1, "{fault}");
    }
    let made = pyramid(&raw, "").ok();
    assert!(made.stderr.contains("raw in 3 levels down to 175x150 px"), "{}", made.stderr);
    let other = place.raw("other.zarr", &film, &flags);
    pyramid(&other, "").ok();
    let with_levels = files(&raw);
    assert!(with_levels == files(&other));
    for (path, bytes) in before.iter().filter(|(path, _)| text(path) != "zarr.json") {
        assert!(with_levels.get(path) == Some(bytes), "{path:?}");
    }
    assert_exit(&pyramid(&raw, ""), 0, &["nothing to do"]);
    assert_exit(&lenscube(&["status", text(&raw), "--check"]), 0, &["pyramid complete"]);
    assert_exit(&lenscube(&["verify", text(&raw)]), 0, &["0 defects"]);
    assert_exit(&sensor(&film, &raw, &flags), 0, &["nothing to do"]);
    sensor(&raw, &place.at("again.zarr"), &["--exposure", "3ms"]).ok();
    // A bad shard of a level is removed and made again.
    std::fs::write(raw.join("pyramid/raw/1/c/1/0/0"), b"no shard").unwrap();
    let found = lenscube(&["verify", text(&raw), "--repair"]);
    assert_exit(&found, 4, &["bad pyramid/raw/1/c/1/0/0", "1 bad shards removed"]);
    assert_exit(&pyramid(&raw, ""), 0, &["resuming: 1 of"]);
    assert!(files(&raw) == with_levels);
    // Without a shard of the raw there are no levels; a new raw has none.
    std::fs::remove_file(raw.join("raw/c/1/0/0")).unwrap();
    assert_exit(&pyramid(&raw, ""), 4, &["1 of 2 shards of the raw are missing", "raw/c/1/0/0"]);
    sensor(&film, &raw, &[&flags[..], &["--seed", "3", "--overwrite"]].concat()).ok();
    assert!(!raw.join("pyramid").exists());
}
