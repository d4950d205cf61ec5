//! Pyramids from outside: killed and resumed, asked for too early, made by `run`, seen by `status` and `verify`.
#![allow(missing_docs)]

mod common;

use common::place::Place;
use common::{Ran, files, lenscube, text};
use std::path::Path;
use std::process::Command;

fn pyramid(film: &Path, fault: &str) -> Ran {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
    command.args(["pyramid", text(film), "--threads", "2"]);
    if !fault.is_empty() {
        command.env("LENSCUBE_FAULT", fault);
    }
    Ran::of(&command.output().unwrap())
}

#[test]
fn a_killed_pyramid_goes_on_to_the_same_bytes() {
    let place = Place::large();
    place.run("", &["--no-fsync"]).ok();
    let film = files(&place.film);
    let copy = place.at("copy.zarr");
    let copied = Command::new("cp").arg("-r").args([&place.film, &copy]).status().unwrap();
    assert!(copied.success());
    pyramid(&copy, "").ok();
    let whole = files(&copy);
    for (path, bytes) in film.iter().filter(|(p, _)| text(p) != "zarr.json") {
        assert_eq!(whole.get(path), Some(bytes), "{path:?}");
    }
    // Metadata are files 1 to 8, the shards of two levels those after, the group's own the last.
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
        let ran = pyramid(&place.film, fault);
        if ran.code == 0 {
            break;
        }
        assert_eq!(ran.code, -1, "{fault}: {}", ran.stderr);
        killed += 1;
    }
    assert!(killed >= 5, "{killed}");
    pyramid(&place.film, "").ok();
    assert_eq!(files(&place.film), whole);
    assert!(place.leavings().is_empty(), "{:?}", place.leavings());
    let again = pyramid(&place.film, "").ok();
    assert!(again.stderr.contains("nothing to do"), "{}", again.stderr);
}

#[test]
fn status_verify_and_run_live_with_a_pyramid() {
    let place = Place::large();
    let ran = place.run("", &["--no-fsync", "--pyramid"]).ok();
    assert!(ran.stderr.contains("film in 3 levels down to 158x177 px"), "{}", ran.stderr);
    let whole = files(&place.film);
    let status = lenscube(&["status", text(&place.film), "--check"]).ok();
    assert!(status.stdout.contains("pyramid complete"), "{}", status.stdout);
    lenscube(&["verify", text(&place.film)]).ok();
    place.run("", &["--no-fsync"]).ok();
    assert_eq!(files(&place.film), whole);
    // A bad shard of a level is found, removed and made again.
    std::fs::write(place.film.join("pyramid/film/1/c/0/1/1"), b"no shard").unwrap();
    let found = lenscube(&["verify", text(&place.film), "--repair"]);
    assert!(found.code == 4 && found.stdout.contains("bad: pyramid/film/1/c/0/1/1"), "{}", found.stdout);
    let status = lenscube(&["status", text(&place.film)]).ok();
    assert!(status.stdout.contains("pyramid unfinished"), "{}", status.stdout);
    pyramid(&place.film, "").ok();
    assert_eq!(files(&place.film), whole);
    // An overwritten film has no pyramid any more.
    place.run("", &["--no-fsync", "--overwrite", "--stages", "ri"]).ok();
    assert!(!place.film.join("pyramid").exists());
    let status = lenscube(&["status", text(&place.film), "--json"]).ok();
    assert!(status.stdout.contains("\"pyramid\": \"none\""), "{}", status.stdout);
}

#[test]
fn a_film_with_holes_is_refused_and_another_pyramid_replaced() {
    let place = Place::large();
    place.run("", &["--no-fsync", "--pyramid"]).ok();
    let whole = files(&place.film);
    let shard = place.film.join("film/c/1/2/3");
    let bytes = std::fs::read(&shard).unwrap();
    std::fs::remove_file(&shard).unwrap();
    let ran = pyramid(&place.film, "");
    assert!(
        ran.code == 4 && ran.stderr.contains("1 of 60") && ran.stderr.contains("film/c/1/2/3"),
        "{}",
        ran.stderr
    );
    // Other pixels in a shard: the pyramid is of another film.
    std::fs::copy(place.film.join("film/c/0/2/3"), &shard).unwrap();
    let status = lenscube(&["status", text(&place.film)]).ok();
    assert!(status.stdout.contains("pyramid of other pixels"), "{}", status.stdout);
    let ran = pyramid(&place.film, "").ok();
    assert!(ran.stderr.contains("making it anew"), "{}", ran.stderr);
    assert_ne!(files(&place.film), whole);
    std::fs::write(&shard, bytes).unwrap();
    pyramid(&place.film, "").ok();
    assert_eq!(files(&place.film), whole);
}

#[test]
fn what_is_no_film_has_no_pyramid() {
    let place = Place::small();
    let ran = pyramid(&place.chart, "");
    assert!(ran.code == 1 && ran.stderr.contains("expected a film"), "{}", ran.stderr);
    assert_eq!(pyramid(&place.at("nothing"), "").code, 1);
}
