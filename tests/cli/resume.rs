//! Locks, signals, cost of resuming; `status` and `verify`.

use crate::common::test_job::TestJob;
use crate::common::{CommandResult, assert_exit, files, lenscube, shards, text};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

const RETRY: i32 = 75;
const INTERRUPTED: i32 = 130;
const WRONG: i32 = 4;

fn read_json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

/// Records of the runs of a film, oldest first.
fn records(film: &Path) -> Vec<Value> {
    let entries = fs::read_dir(film.join("runs")).unwrap().map(|e| e.unwrap().path());
    let mut paths: Vec<_> = entries.filter(|p| text(p).ends_with(".json")).collect();
    paths.sort_by_key(|p| fs::metadata(p).unwrap().modified().unwrap());
    paths.iter().map(|p| read_json(p)).collect()
}

#[test]
fn second_run_of_a_film_exits_75_while_the_first_runs() {
    let job = TestJob::large();
    let expected = job.expected_files();
    // Eight renames create the film; it is stopped among those of its shards.
    let mut first = job.stopped("rename:14", &[]);
    let pid = first.0.id().to_string();
    for flags in [&[][..], &["--take-over"], &["--overwrite"]] {
        assert_exit(&job.run("", flags), RETRY, &["locked by process", &pid, "wait for it"]);
    }
    assert_exit(
        &lenscube(&["status", text(&job.film)]),
        0,
        &["incomplete", &format!("process {pid}"), "runs"],
    );
    assert_exit(&lenscube(&["verify", text(&job.film), "--repair"]), RETRY, &[&pid]);
    // After SIGKILL the lock is taken over without a flag.
    first.signal("KILL");
    first.0.wait().unwrap();
    assert_exit(&lenscube(&["status", text(&job.film)]), 0, &["has ended"]);
    assert_exit(&job.run("", &[]), 0, &["resuming"]);
    assert!(files(&job.film) == expected);
    assert!(job.leftover_files().is_empty(), "{:?}", job.leftover_files());
}

#[test]
fn lock_of_another_host_requires_take_over() {
    let job = TestJob::large();
    let expected = job.expected_files();
    assert_eq!(job.run("rename:20:kill", &[]).code, -1);
    let lock = job.film.join("runs/whole.lock");
    let mut owner = read_json(&lock);
    owner["host"] = json!("elsewhere");
    fs::write(&lock, owner.to_string()).unwrap();
    assert_exit(&job.run("", &[]), RETRY, &["host elsewhere", "--take-over"]);
    assert_exit(&job.run("", &["--overwrite"]), RETRY, &["host elsewhere"]);
    assert_exit(&job.run("", &["--take-over"]), 0, &["resuming"]);
    assert!(files(&job.film) == expected && !lock.exists());
}

#[test]
fn first_signal_finishes_tiles_in_flight_second_stops_at_once() {
    let job = TestJob::large();
    let expected = job.expected_files();
    // All writes wait until the signal is handled: of sixty shards most are not computed then.
    for signal in ["terminate", "interrupt"] {
        assert_exit(
            &job.run(&format!("write:14+:{signal}"), &[]),
            INTERRUPTED,
            &["stopping after the tiles in progress", "interrupted: ", "resumes"],
        );
        assert!(job.leftover_files().is_empty(), "{:?}", job.leftover_files());
        assert_eq!(records(&job.film)[0]["outcome"], "interrupted");
        assert!(!shards(&job.film).is_empty());
        job.run("", &[]).ok();
        assert!(files(&job.film) == expected, "after {signal}");
        fs::remove_dir_all(&job.film).unwrap();
    }
    // The tile in progress at the first signal covers sixteen shards: the second is sent at a write of one of them.
    let job = TestJob::drawn(&["--shard", "128", "--chunk", "64", "--outside", "clamp"]);
    let expected = job.expected_files();
    assert_exit(
        &job.run("write:12:interrupt,write:14+:interrupt", &[]),
        INTERRUPTED,
        &["press Ctrl-C again to stop at once", "stopped; the same command resumes"],
    );
    assert!(!job.film.join("runs/whole.lock").exists());
    job.run("", &[]).ok();
    assert!(files(&job.film) == expected && job.leftover_files().is_empty());
}

#[test]
fn signal_ends_a_run_whose_tiles_wait_for_others_of_the_next_shards() {
    // Five rows of five tiles a band, three rows of three shards.
    let job = TestJob::drawn(&["--shard", "1024", "--chunk", "512", "--outside", "clamp"]);
    let expected = job.expected_files();
    for step in ["commit:1+", "commit:2+", "commit:4+"] {
        assert_exit(
            &job.run(&format!("{step}:interrupt"), &[]),
            INTERRUPTED,
            &["stopping after the tiles in progress", "interrupted: "],
        );
        job.run("", &[]).ok();
        assert!(files(&job.film) == expected, "after SIGINT at {step}");
        fs::remove_dir_all(&job.film).unwrap();
    }
}

/// Number of tiles of all bands, number of tiles in a row, and side of a tile in px, from the film's attributes.
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
fn resume_computes_missing_shards_and_at_most_one_more_tile_row() {
    let job = TestJob::drawn(&["--shard", "256", "--chunk", "128", "--outside", "clamp"]);
    assert_exit(&job.run("", &[]), 0, &["162 shards"]);
    let (all, row, tile) = tiles(&job.film);
    let record = &records(&job.film)[0];
    assert_eq!((record["tiles"].as_u64(), record["shards"].as_u64()), (Some(all), Some(162)));
    assert!(all / 2 >= 4 * row, "{all} tiles in rows of {row}: too few to see a difference");
    // The last rows of shards of band 1 are removed: their tiles, and the tile row above, whose tails reach them, are computed.
    for first in [8u64, 5, 0] {
        for row in first..9 {
            fs::remove_dir_all(job.film.join(format!("film/c/1/{row}"))).unwrap();
        }
        fs::remove_dir_all(job.film.join("runs")).unwrap();
        assert_exit(&job.run("", &[]), 0, &["resuming"]);
        let record = &records(&job.film)[0];
        assert_eq!(record["shards"], json!(9 * (9 - first)));
        let uncommitted = (2300 - 256 * first).div_ceil(tile) * row;
        let made = record["tiles"].as_u64().unwrap();
        assert!(made <= uncommitted + row, "{made} tiles in rows of {row} for {uncommitted} not committed");
    }
    // A complete job computes nothing and writes no record.
    fs::remove_dir_all(job.film.join("runs")).unwrap();
    assert_exit(&job.run("", &[]), 0, &["is complete: 162 shards, nothing to do"]);
    assert_eq!(fs::read_dir(job.film.join("runs")).map_or(0, Iterator::count), 0);
}

#[test]
fn film_keeps_the_codec_that_it_was_begun_with() {
    let job = TestJob::small();
    job.run("", &["--codec", "zstd"]).ok();
    let expected = files(&job.film);
    let first = shards(&job.film).remove(0);
    fs::remove_file(job.film.join(first)).unwrap();
    assert_exit(&job.run("", &[]), 0, &["resuming"]);
    assert!(files(&job.film) == expected);
    assert_exit(&job.run("", &[]), 0, &["nothing to do"]);
    // A new film has the default.
    job.run("", &["--overwrite"]).ok();
    assert_eq!(read_json(&job.film.join("zarr.json"))["attributes"]["codec"], "lz4");
}

#[test]
fn film_attributes_record_the_job_and_a_changed_chart_exits_3() {
    let job = TestJob::small();
    job.run("", &[]).ok();
    let provenance = &read_json(&job.film.join("zarr.json"))["attributes"]["provenance"];
    for (digest, words) in [("job_digest", "job"), ("layout_digest", "layout")] {
        let own = blake3::hash(provenance[words].to_string().as_bytes()).to_hex();
        assert_eq!(provenance[digest], own.as_str(), "{words}");
    }
    assert_eq!(provenance["layout"], json!({"dtype": "float32", "shard": 64, "chunk": 32, "codec": "lz4"}));
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
    keys.iter().for_each(|key| assert!(provenance["job"].get(key).is_some(), "{key}"));
    // A chart with another modification time is another chart unless --trust-input is given.
    assert_exit(&job.run("", &[]), 0, &["is complete"]);
    let chunk = fs::File::open(job.chart.join("chart/c/0/0/0")).unwrap();
    chunk.set_modified(std::time::UNIX_EPOCH).unwrap();
    assert_exit(&job.run("", &[]), 3, &["another job", "modification times of the chart", "--trust-input"]);
    assert_exit(&job.run("", &["--trust-input"]), 0, &["is complete"]);
    assert_exit(&job.run("", &["--trust-input", "--interp", "bilinear"]), 3, &["interp", "--overwrite"]);
    assert_exit(&job.run("", &["--overwrite"]), 0, &["8 shards"]);
}

#[test]
fn film_inside_its_chart_exits_2() {
    let job = TestJob::small();
    let before = files(&job.chart);
    for inside in ["film.zarr", "chart/film.zarr", "new/../film.zarr"] {
        let film = job.chart.join(inside);
        let ran = CommandResult::new(&job.command(&film, "", &[]).output().unwrap());
        assert_exit(&ran, 2, &["lies in the chart"]);
    }
    assert!(files(&job.chart) == before);
}

#[test]
fn status_lists_missing_shards_and_failed_runs() {
    let job = TestJob::large();
    assert_exit(&lenscube(&["status", text(&job.film)]), 1, &["found nothing"]);
    assert_eq!(job.run("write:30:28", &[]).code, RETRY);
    let output = lenscube(&["status", text(&job.film), "--json"]).ok();
    let status: Value = serde_json::from_str(&output.stdout).unwrap();
    let done = shards(&job.film).iter().filter(|p| p.starts_with("film")).count();
    assert_eq!((&status["shards"], &status["shards_done"]), (&json!(60), &json!(done)));
    assert_eq!(status["missing"].as_array().unwrap().len(), 60 - done);
    assert_eq!((&status["complete"], &status["runs"]["failed"]), (&json!(false), &json!(1)));
    assert!(status["last_run"]["error"].as_str().unwrap().contains("no space left"), "{status}");
    assert_exit(
        &lenscube(&["status", text(&job.film), "--check"]),
        WRONG,
        &["incomplete", "missing film/c/", "1 failed"],
    );
    job.run("", &[]).ok();
    assert_exit(
        &lenscube(&["status", text(&job.film), "--check"]),
        0,
        &["complete", "60 of 60", "2 complete, 0 partly done"],
    );
}

#[test]
fn verify_names_bad_files_and_repair_allows_a_run_to_replace_them() {
    let job = TestJob::large();
    let expected = job.expected_files();
    job.run("", &[]).ok();
    let film = text(&job.film);
    assert_exit(&lenscube(&["verify", film]), 0, &["is correct: no defect in 60 shards"]);
    let at = |key: &str| job.film.join(key);
    let mut bytes = fs::read(at("film/c/1/2/3")).unwrap();
    bytes[1000] ^= 1;
    fs::write(at("film/c/1/2/3"), &bytes).unwrap();
    fs::write(at("film/c/0/4/4"), &bytes[..100]).unwrap();
    fs::remove_file(at("film/c/0/0/1")).unwrap();
    fs::write(at("film/c/0/.tmp-elsewhere-0-0-1-1-0"), "half").unwrap();
    let found = ["bad: film/c/1/2/3: ", "bad: film/c/0/4/4: ", "missing: film/c/0/0/1: "];
    assert_exit(&lenscube(&["verify", film]), WRONG, &found);
    let json: Value = serde_json::from_str(&lenscube(&["verify", film, "--json"]).stdout).unwrap();
    assert_eq!((json["findings"].as_array().unwrap().len(), &json["sound"]), (3, &json!(false)));
    // A run counts existing shards as complete; only `verify` reads them.
    assert_exit(&job.run("", &[]), 0, &["resuming", "1 of 60"]);
    assert_exit(
        &lenscube(&["verify", film, "--repair"]),
        WRONG,
        &["removed 2 damaged shards and 1 temporary files"],
    );
    assert_exit(&job.run("", &[]), 0, &["resuming", "2 of 60"]);
    assert!(files(&job.film) == expected && job.leftover_files().is_empty());
    assert_exit(&lenscube(&["verify", film]), 0, &["is correct"]);
    // Metadata.
    let group = at("zarr.json");
    let good = fs::read_to_string(&group).unwrap();
    fs::write(&group, good.replace("\"interp\": \"bicubic\"", "\"interp\": \"bilinear\"")).unwrap();
    assert_exit(&lenscube(&["verify", film]), WRONG, &["metadata: zarr.json: job_digest"]);
    fs::write(&group, good.replace("\"chunk\": 64", "\"chunk\": 32")).unwrap();
    assert_exit(&lenscube(&["verify", film]), WRONG, &["film/zarr.json"]);
    fs::write(&group, &good[..good.len() / 2]).unwrap();
    assert_ne!(lenscube(&["verify", film]).code, 0);
    // Nothing is restored from attributes that do not match their digest.
    fs::write(&group, good.replace("\"pitch_um\": ", "\"pitch_um\": 1")).unwrap();
    let found = ["the attributes do not match their digest", "metadata: y/c/0", "cannot be repaired"];
    assert_exit(&lenscube(&["verify", film, "--repair"]), WRONG, &found);
    fs::write(&group, good).unwrap();
    assert!(files(&job.film) == expected);
    for key in ["y/zarr.json", "film/zarr.json"] {
        fs::remove_file(at(key)).unwrap();
    }
    assert_exit(&lenscube(&["status", film]), WRONG, &["film/zarr.json is missing", "verify", "--repair"]);
    let found = ["metadata: y/zarr.json: no such file", "metadata: film/zarr.json: no such file"];
    assert_exit(&lenscube(&["verify", film]), WRONG, &found);
    assert_exit(&lenscube(&["verify", film, "--repair"]), WRONG, &["wrote 2 damaged metadata files again"]);
    assert_exit(&lenscube(&["verify", film]), 0, &["is correct"]);
    fs::write(at("y/c/0"), [0; 12]).unwrap();
    fs::remove_file(at("wavelength/c/0")).unwrap();
    let found = ["metadata: y/c/0: ", "metadata: wavelength/c/0: "];
    assert_exit(&lenscube(&["verify", film]), WRONG, &found);
    assert_exit(&lenscube(&["verify", film, "--repair"]), WRONG, &["wrote 2 damaged coordinates again"]);
    assert_exit(&lenscube(&["verify", film]), 0, &["is correct"]);
    assert!(files(&job.film) == expected);
}

#[test]
fn unknown_command_suggests_the_nearest() {
    for (word, meant) in [("exprot", "export"), ("stauts", "status"), ("verfy", "verify"), ("rum", "run")] {
        assert_exit(&lenscube(&[word, "film.zarr"]), 2, &[word, &format!("'{meant}'")]);
    }
    assert_exit(&lenscube(&["lens", "shw"]), 2, &["'show'"]);
}
