//! One run at a time, signals, what resuming costs; status and verify.

mod common;

use common::place::Place;
use common::{Ran, files, lenscube, shards, text};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

const RETRY: i32 = 75;
const INTERRUPTED: i32 = 130;
const WRONG: i32 = 4;

fn read_json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

/// The records of a film's runs, oldest first.
fn records(film: &Path) -> Vec<Value> {
    let entries = fs::read_dir(film.join("runs")).unwrap().map(|e| e.unwrap().path());
    let mut paths: Vec<_> = entries.filter(|p| text(p).ends_with(".json")).collect();
    paths.sort_by_key(|p| fs::metadata(p).unwrap().modified().unwrap());
    paths.iter().map(|p| read_json(p)).collect()
}

fn says(ran: &Ran, code: i32, words: &[&str]) {
    assert_eq!(ran.code, code, "{}{}", ran.stdout, ran.stderr);
    for word in words {
        let said = ran.stdout.contains(word) || ran.stderr.contains(word);
        assert!(said, "`{word}` is not in: {}{}", ran.stdout, ran.stderr);
    }
}

#[test]
fn a_second_run_of_the_same_film_is_refused() {
    let place = Place::large();
    let whole = place.whole();
    let mut first = place.stopped("write:14", &[]);
    let pid = first.0.id().to_string();
    for flags in [&[][..], &["--take-over"], &["--overwrite"]] {
        says(&place.run("", flags), RETRY, &["locked by process", &pid, "wait for it"]);
    }
    says(&lenscube(&["status", text(&place.film)]), 0, &["incomplete", &format!("process {pid}"), "runs"]);
    says(&lenscube(&["verify", text(&place.film), "--repair"]), RETRY, &[&pid]);
    // Killed, it is followed without a word from anybody.
    first.signal("KILL");
    first.0.wait().unwrap();
    says(&lenscube(&["status", text(&place.film)]), 0, &["is dead"]);
    says(&place.run("", &[]), 0, &["resuming"]);
    assert!(files(&place.film) == whole);
    assert!(place.leavings().is_empty(), "{:?}", place.leavings());
}

#[test]
fn the_lock_of_another_host_needs_a_persons_word() {
    let place = Place::large();
    let whole = place.whole();
    assert_eq!(place.run("rename:20:kill", &[]).code, -1);
    let lock = place.film.join("runs/whole.lock");
    let mut owner = read_json(&lock);
    owner["host"] = json!("elsewhere");
    fs::write(&lock, owner.to_string()).unwrap();
    says(&place.run("", &[]), RETRY, &["host elsewhere", "--take-over"]);
    says(&place.run("", &["--overwrite"]), RETRY, &["host elsewhere"]);
    says(&place.run("", &["--take-over"]), 0, &["resuming"]);
    assert!(files(&place.film) == whole && !lock.exists());
}

#[test]
fn a_signal_ends_the_run_in_order_and_a_second_at_once() {
    let place = Place::large();
    let whole = place.whole();
    for signal in ["TERM", "INT"] {
        let run = place.stopped("write:14", &[]);
        run.signal(signal);
        says(&run.go_on(), INTERRUPTED, &["finishing the tiles in flight", "interrupted: ", "resumes"]);
        assert!(place.leavings().is_empty(), "{:?}", place.leavings());
        assert_eq!(records(&place.film)[0]["outcome"], "interrupted");
        assert!(!shards(&place.film).is_empty());
        place.run("", &[]).ok();
        assert!(files(&place.film) == whole, "after SIG{signal}");
        fs::remove_dir_all(&place.film).unwrap();
    }
    // It stops at every write, so that it is at work when the second signal comes: a tile alone holds sixteen shards.
    let place = Place::drawn(&["--shard", "128", "--chunk", "64", "--outside", "clamp"]);
    let whole = place.whole();
    let mut run = place.stopped("write:12+", &[]);
    run.signal("INT");
    for _ in 0..3 {
        run.signal("CONT");
        std::thread::sleep(std::time::Duration::from_millis(100));
        assert!(run.wait_stopped());
    }
    run.signal("INT");
    says(&run.go_on(), INTERRUPTED, &["again to stop at once", "stopped; the same command resumes"]);
    assert!(!place.film.join("runs/whole.lock").exists());
    place.run("", &[]).ok();
    assert!(files(&place.film) == whole && place.leavings().is_empty());
}

/// Tiles of all bands, the tiles of one row of tiles, and a tile's side: from the film's own attributes.
fn tiles(film: &Path) -> (u64, u64, u64) {
    let attributes = &read_json(&film.join("zarr.json"))["attributes"];
    let size = |k: usize| attributes["film_size"][k].as_u64().unwrap();
    let bands = attributes["provenance"]["bands"].as_array().unwrap();
    let (tile, window) = (bands[0]["tile_px"].as_u64().unwrap(), bands[0]["psf_window_px"].as_u64().unwrap());
    assert!(bands.iter().all(|b| b["tile_px"] == tile), "bands of one cut");
    let count = |k: usize| (size(k) + window - 1).div_ceil(tile);
    (bands.len() as u64 * count(0) * count(1), count(1), tile)
}

#[test]
fn resuming_costs_what_was_not_committed_and_one_row_of_tiles() {
    let place = Place::drawn(&["--shard", "256", "--chunk", "128", "--outside", "clamp"]);
    says(&place.run("", &[]), 0, &["162 shards"]);
    let (all, row, tile) = tiles(&place.film);
    let record = &records(&place.film)[0];
    assert_eq!((record["tiles"].as_u64(), record["shards"].as_u64()), (Some(all), Some(162)));
    assert!(all / 2 >= 4 * row, "{all} tiles in rows of {row}: too few to see a difference");
    // Of band 1 the last rows of shards: their tiles, and the row above them whose light reaches them.
    for first in [8u64, 5, 0] {
        for row in first..9 {
            fs::remove_dir_all(place.film.join(format!("film/c/1/{row}"))).unwrap();
        }
        fs::remove_dir_all(place.film.join("runs")).unwrap();
        says(&place.run("", &[]), 0, &["resuming"]);
        let record = &records(&place.film)[0];
        assert_eq!(record["shards"], json!(9 * (9 - first)));
        let uncommitted = (2300 - 256 * first).div_ceil(tile) * row;
        let made = record["tiles"].as_u64().unwrap();
        assert!(made <= uncommitted + row, "{made} tiles in rows of {row} for {uncommitted} not committed");
    }
    // A finished job makes nothing, and leaves no record of it.
    fs::remove_dir_all(place.film.join("runs")).unwrap();
    says(&place.run("", &[]), 0, &["is complete: 162 shards, nothing to do"]);
    assert_eq!(fs::read_dir(place.film.join("runs")).map_or(0, Iterator::count), 0);
}

#[test]
fn the_film_tells_which_job_it_is() {
    let place = Place::small();
    place.run("", &[]).ok();
    let told = &read_json(&place.film.join("zarr.json"))["attributes"]["provenance"];
    for (digest, words) in [("job_digest", "job"), ("layout_digest", "layout")] {
        let own = blake3::hash(told[words].to_string().as_bytes()).to_hex();
        assert_eq!(told[digest], own.as_str(), "{words}");
    }
    assert_eq!(told["layout"], json!({"dtype": "float32", "shard": 64, "chunk": 32, "codec": "zstd"}));
    let keys = [
        "chart",
        "chart_mtimes",
        "chart_bands",
        "lens_digest",
        "stages",
        "film_size",
        "film_pitch_um",
        "axis_px",
        "scale",
        "center_mm",
        "interp",
        "surround",
        "outside",
        "nan",
        "azimuths",
        "psf_window",
        "interpolate_psf",
        "film_units",
        "rois",
        "numeric_version",
    ];
    keys.iter().for_each(|key| assert!(told["job"].get(key).is_some(), "{key}"));
    // A copy of the chart that keeps the times is the same chart; touched, only --trust-input goes on.
    says(&place.run("", &[]), 0, &["is complete"]);
    let chunk = fs::File::open(place.chart.join("chart/c/0/0/0")).unwrap();
    chunk.set_modified(std::time::UNIX_EPOCH).unwrap();
    says(&place.run("", &[]), 3, &["another job", "chart_mtimes", "--trust-input"]);
    says(&place.run("", &["--trust-input"]), 0, &["is complete"]);
    says(&place.run("", &["--trust-input", "--interp", "bilinear"]), 3, &["interp", "--overwrite"]);
    says(&place.run("", &["--overwrite"]), 0, &["8 shards"]);
}

#[test]
fn a_film_does_not_lie_in_its_chart() {
    let place = Place::small();
    let before = files(&place.chart);
    for inside in ["film.zarr", "chart/film.zarr", "new/../film.zarr"] {
        let film = place.chart.join(inside);
        let ran = Ran::of(&place.command(&film, "", &[]).output().unwrap());
        says(&ran, 2, &["lies inside its own chart"]);
    }
    assert!(files(&place.chart) == before);
}

#[test]
fn status_tells_what_is_done() {
    let place = Place::large();
    says(&lenscube(&["status", text(&place.film)]), 1, &["found nothing"]);
    assert_eq!(place.run("write:30:28", &[]).code, RETRY);
    let told = lenscube(&["status", text(&place.film), "--json"]).ok();
    let status: Value = serde_json::from_str(&told.stdout).unwrap();
    let done = shards(&place.film).iter().filter(|p| p.starts_with("film")).count();
    assert_eq!((&status["shards"], &status["shards_done"]), (&json!(60), &json!(done)));
    assert_eq!(status["missing"].as_array().unwrap().len(), 60 - done);
    assert_eq!((&status["complete"], &status["runs"]["failed"]), (&json!(false), &json!(1)));
    assert!(status["last_run"]["error"].as_str().unwrap().contains("no space left"), "{status}");
    says(
        &lenscube(&["status", text(&place.film), "--check"]),
        WRONG,
        &["incomplete", "missing film/c/", "1 failed"],
    );
    place.run("", &[]).ok();
    says(
        &lenscube(&["status", text(&place.film), "--check"]),
        0,
        &["complete", "60 of 60", "2 complete, 0 in part"],
    );
}

#[test]
fn verify_names_what_is_wrong_and_repair_lets_run_make_it_again() {
    let place = Place::large();
    let whole = place.whole();
    place.run("", &[]).ok();
    let film = text(&place.film);
    says(&lenscube(&["verify", film]), 0, &["is sound: 60 shards"]);
    let at = |key: &str| place.film.join(key);
    let mut bytes = fs::read(at("film/c/1/2/3")).unwrap();
    bytes[1000] ^= 1;
    fs::write(at("film/c/1/2/3"), &bytes).unwrap();
    fs::write(at("film/c/0/4/4"), &bytes[..100]).unwrap();
    fs::remove_file(at("film/c/0/0/1")).unwrap();
    fs::write(at("film/c/0/.tmp-elsewhere-0-0-1-1-0"), "half").unwrap();
    let found = ["bad: film/c/1/2/3: ", "bad: film/c/0/4/4: ", "missing: film/c/0/0/1: "];
    says(&lenscube(&["verify", film]), WRONG, &found);
    let json: Value = serde_json::from_str(&lenscube(&["verify", film, "--json"]).stdout).unwrap();
    assert_eq!((json["findings"].as_array().unwrap().len(), &json["sound"]), (3, &json!(false)));
    // A run takes shards for done that are there; only verify looks inside.
    says(&place.run("", &[]), 0, &["resuming", "1 of 60"]);
    says(&lenscube(&["verify", film, "--repair"]), WRONG, &["removed 2 bad shards and 1 temp files"]);
    says(&place.run("", &[]), 0, &["resuming", "2 of 60"]);
    assert!(files(&place.film) == whole && place.leavings().is_empty());
    says(&lenscube(&["verify", film]), 0, &["is sound"]);
    // Metadata.
    let group = at("zarr.json");
    let good = fs::read_to_string(&group).unwrap();
    fs::write(&group, good.replace("\"interp\": \"bicubic\"", "\"interp\": \"bilinear\"")).unwrap();
    says(&lenscube(&["verify", film]), WRONG, &["metadata: zarr.json: job_digest"]);
    fs::write(&group, good.replace("\"chunk\": 64", "\"chunk\": 32")).unwrap();
    says(&lenscube(&["verify", film]), WRONG, &["film/zarr.json"]);
    fs::write(&group, &good[..good.len() / 2]).unwrap();
    assert_ne!(lenscube(&["verify", film]).code, 0);
    fs::write(&group, good).unwrap();
    fs::write(at("y/c/0"), [0; 12]).unwrap();
    says(&lenscube(&["verify", film]), WRONG, &["metadata: y/c/0: "]);
}

#[test]
fn a_misspelt_command_gets_a_suggestion() {
    for (word, meant) in [("exprot", "export"), ("stauts", "status"), ("verfy", "verify"), ("rum", "run")] {
        says(&lenscube(&[word, "film.zarr"]), 2, &[word, &format!("'{meant}'")]);
    }
    says(&lenscube(&["lens", "shw"]), 2, &["'show'"]);
}
