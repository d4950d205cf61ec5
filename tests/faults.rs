//! Faults at every step of a run: the right words and exit code, nothing half, and the same command ends with the same bytes.

mod common;

use common::place::Place;
use common::{Picture, Ran, files, shards, text};
use pipeline::geometry::Size;
use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

const RETRY: i32 = 75;
const KILLED: i32 = -1;

/// Strikes every step of a small job with the faults that `fault` names for it, two at a time, until a run meets none.
fn at_every_step(step: &str, fault: impl Fn(usize) -> (&'static str, i32) + Sync) -> usize {
    let (next, steps) = (AtomicUsize::new(1), AtomicUsize::new(usize::MAX));
    let work = || {
        let place = Place::small();
        let whole = place.whole();
        loop {
            let n = next.fetch_add(1, Ordering::SeqCst);
            if n > steps.load(Ordering::SeqCst) {
                return;
            }
            let (what, code) = fault(n);
            let ran = place.run(&format!("{step}:{n}:{what}"), &[]);
            let context = format!("{step} {n}, {what}: {}", ran.stderr);
            if !ran.stderr.contains("struck by") {
                assert_eq!(ran.code, 0, "{context}");
                steps.fetch_min(n - 1, Ordering::SeqCst);
            } else if ran.code == 0 {
                // Struck where it does no harm: in the run's record.
                assert!(ran.stderr.contains("note: the run's record"), "{context}");
            } else {
                assert_eq!(ran.code, code, "{context}");
                let lines = ran.stderr.lines().filter(|l| l.starts_with("lenscube: ")).count();
                assert!(code == KILLED || lines == 1, "not one line: {context}");
                assert!(!ran.stderr.contains("panicked"), "{context}");
            }
            let again = place.run("", &[]);
            assert_eq!(again.code, 0, "{context}; then {}", again.stderr);
            assert!(files(&place.film) == whole, "other bytes after {context}");
            assert_eq!(place.leavings(), Vec::<std::path::PathBuf>::new(), "{context}");
            fs::remove_dir_all(&place.film).unwrap();
        }
    };
    std::thread::scope(|s| [s.spawn(work), s.spawn(work)].into_iter().for_each(|t| t.join().unwrap()));
    steps.into_inner()
}

#[test]
fn an_error_at_any_step_is_told_and_the_same_command_completes() {
    // No space left, device error, stale file handle; permission denied, read-only file system, file too large.
    let errors = [("28", RETRY), ("13", 1), ("5", RETRY), ("30", 1), ("116", RETRY), ("27", 1)];
    let steps = at_every_step("any", |n| errors[n % errors.len()]);
    assert!(steps > 100, "a job of {steps} steps");
}

#[test]
fn a_kill_at_any_step_leaves_a_film_to_resume() {
    assert!(at_every_step("any", |_| ("kill", KILLED)) > 100);
}

#[test]
fn torn_and_short_writes_are_never_taken_for_files() {
    let writes = at_every_step("write", |n| [("torn", KILLED), ("short", 1)][n % 2]);
    // Seven files of metadata and coordinates, the group's own, eight shards, a record.
    assert!(writes > 16, "{writes} writes");
}

/// Spoils one inner chunk of the chart's band 1: the last, of rows and columns from 512 on.
fn spoil(place: &Place) -> (std::path::PathBuf, Vec<u8>) {
    let chunk = place.chart.join("chart/c/1/0/0");
    let good = fs::read(&chunk).unwrap();
    let mut bad = good.clone();
    let near_the_end = bad.len() - 200;
    bad[near_the_end] ^= 0x40;
    fs::write(&chunk, bad).unwrap();
    (chunk, good)
}

#[test]
fn a_damaged_chunk_stops_the_run_and_names_band_and_shard() {
    let place = Place::large();
    let whole = place.whole();
    let (chunk, good) = spoil(&place);
    let ran = place.run("", &[]);
    assert_eq!(ran.code, 1, "{}", ran.stderr);
    for word in ["band 1 (500 nm)", "shard film/c/1/", "chart/c/1/0/0", "damaged", "resumes"] {
        assert!(ran.stderr.contains(word), "{word}: {}", ran.stderr);
    }
    fs::write(&chunk, good).unwrap();
    let touched = place.run("", &[]);
    assert!(touched.code == 3 && touched.stderr.contains("--trust-input"), "{}", touched.stderr);
    place.run("", &["--trust-input"]).ok();
    same_pixels(&place.film, &whole);
}

/// The bytes of all arrays; the attributes hold the times of the chart's files.
fn same_pixels(film: &Path, whole: &std::collections::BTreeMap<std::path::PathBuf, Vec<u8>>) {
    let found = files(film);
    assert_eq!(found.len(), whole.len());
    for (path, bytes) in &found {
        assert!(path == Path::new("zarr.json") || whole[path] == *bytes, "{}", path.display());
    }
}

#[test]
fn keep_going_makes_all_that_does_not_depend_on_the_fault() {
    let place = Place::large();
    let whole = place.whole();
    let (chunk, good) = spoil(&place);
    let ran = place.run("", &["--keep-going"]);
    assert_eq!(ran.code, 1, "{}", ran.stderr);
    for word in ["left out: band 1 (500 nm), shard film/c/1/", "damaged", "could not be made", "resumes"] {
        assert!(ran.stderr.contains(word), "{word}: {}", ran.stderr);
    }
    let made = shards(&place.film);
    let of = |band: &str| made.iter().filter(|p| p.starts_with(Path::new("film/c").join(band))).count();
    assert_eq!(of("0"), 30, "the sound band is whole");
    assert!((10..30).contains(&of("1")), "{} shards of the damaged band", of("1"));
    let status = common::lenscube(&["status", text(&place.film), "--check"]);
    assert!(status.code == 4 && status.stdout.contains("1 in part (500 nm"), "{}", status.stdout);
    fs::write(&chunk, good).unwrap();
    place.run("", &["--trust-input"]).ok();
    same_pixels(&place.film, &whole);
}

#[test]
fn keep_going_believes_a_full_disk_at_once_and_a_forbidden_one_soon() {
    let place = Place::large();
    let whole = place.whole();
    // From the first shard on: seven files of the new film come before it.
    let full = place.run("write:9+:28", &["--keep-going"]);
    assert_eq!(full.code, RETRY, "{}", full.stderr);
    for word in ["no space left", "band 0 (450 nm), shard film/c/0/"] {
        assert!(full.stderr.contains(word), "{word}: {}", full.stderr);
    }
    let forbidden = place.run("create:2+:13", &["--keep-going"]);
    assert_eq!(forbidden.code, 1, "{}", forbidden.stderr);
    assert!(forbidden.stderr.contains("not allowed"), "{}", forbidden.stderr);
    // One that passes costs one shard.
    let once = place.run("create:9:13", &["--keep-going"]);
    assert_eq!(once.code, 1, "{}", once.stderr);
    assert!(once.stderr.contains("lenscube: 1 of "), "{}", once.stderr);
    place.run("", &[]).ok();
    assert!(files(&place.film) == whole);
}

/// Takes a store away while the run stands still, and brings it back after the run has ended.
fn vanish(place: &Place, store: &Path, step: &str) -> Ran {
    let run = place.stopped(step, &["--keep-going"]);
    let away = place.at("away");
    fs::rename(store, &away).unwrap();
    let ran = run.go_on();
    assert!(!store.exists(), "{} was made again in parts", store.display());
    fs::rename(&away, store).unwrap();
    ran
}

#[test]
fn a_store_that_vanishes_is_worth_a_retry() {
    let place = Place::large();
    let whole = place.whole();
    for (store, step) in [(&place.film, "write:12"), (&place.chart, "create:2")] {
        let ran = vanish(&place, store, step);
        assert_eq!(ran.code, RETRY, "{}", ran.stderr);
        assert!(ran.stderr.contains("is gone") && ran.stderr.contains(text(store)), "{}", ran.stderr);
        let status = common::lenscube(&["status", text(&place.film), "--check"]);
        assert_eq!(status.code, 4, "{}", status.stdout);
    }
    place.run("", &[]).ok();
    assert!(files(&place.film) == whole);
}

#[test]
fn a_chart_that_changes_meanwhile_spoils_the_film() {
    let place = Place::large();
    let run = place.stopped("write:12", &[]);
    let chunk = fs::File::open(place.chart.join("chart/c/0/0/0")).unwrap();
    chunk.set_modified(std::time::UNIX_EPOCH).unwrap();
    let ran = run.go_on();
    assert!(ran.code == 1 && ran.stderr.contains("changed while it was read"), "{}", ran.stderr);
    assert_eq!(place.run("", &[]).code, 3);
}

/// Changes `file` of the chart while a run is stopped at its first shards, restores it after the run, and resumes.
fn change_and_restore(place: &Place, file: &Path, changed: &[u8]) {
    let whole = place.whole();
    let original = fs::read(file).unwrap();
    let modified = fs::metadata(file).unwrap().modified().unwrap();
    assert_ne!(original, changed);
    let run = place.stopped("write:10", &[]);
    fs::write(file, changed).unwrap();
    let ran = run.go_on();
    assert_eq!(ran.code, 1, "{}", ran.stderr);
    fs::write(file, original).unwrap();
    fs::File::options().write(true).open(file).unwrap().set_modified(modified).unwrap();
    place.run("", &[]).ok();
    assert!(files(&place.film) == whole, "pixels of the changed chart are in the film");
}

#[test]
fn a_film_of_a_chart_changed_while_it_was_read_is_resumed_with_the_restored_chart() {
    let place = Place::large();
    let other = place.at("other.zarr");
    Picture::noise(12, Size::new(631, 705), 2).write(&other);
    let chunk = Path::new("chart/c/1/0/0");
    change_and_restore(&place, &place.chart.join(chunk), &fs::read(other.join(chunk)).unwrap());
}

#[test]
fn a_film_of_a_flat_chart_changed_while_it_was_read_is_resumed_with_the_restored_chart() {
    let size = Size::new(631, 705);
    let layout = &["--shard", "128", "--chunk", "64", "--wavelengths", "450,500", "--film-pitch-um", "2"];
    let mut place = Place::new(size, layout);
    let npy = |seed: u64| {
        let header = format!(
            "{{'descr': '<f4', 'fortran_order': False, 'shape': (2, {}, {}), }}",
            size.height, size.width
        );
        let header = format!("{header:<117}\n");
        let pixels = Picture::noise(seed, size, 2).bands.concat();
        let samples = pixels.iter().flat_map(|v| v.to_le_bytes());
        let head = [&b"\x93NUMPY\x01\x00\x76\x00"[..], header.as_bytes()].concat();
        head.into_iter().chain(samples).collect::<Vec<u8>>()
    };
    place.chart = place.at("chart.npy");
    fs::write(&place.chart, npy(11)).unwrap();
    change_and_restore(&place, &place.chart, &npy(12));
}
