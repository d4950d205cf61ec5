//! Injected errors at every step of a run: documented message and exit code, no partial files, and the repeated command gives the same
//! film.

use crate::common::test_job::TestJob;
use crate::common::{CommandResult, Picture, files, shards, text};
use pipeline::geometry::Size;
use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

const RETRY: i32 = 75;
const KILLED: i32 = -1;

/// Runs a small job once per step `step:n` with the fault that `fault(n)` names, on two threads, until a run ends without a fault;
/// the number of steps. `fault` returns the kind of fault and the expected exit code.
fn inject_at_every_step(step: &str, fault: impl Fn(usize) -> (&'static str, i32) + Sync) -> usize {
    let (next, steps) = (AtomicUsize::new(1), AtomicUsize::new(usize::MAX));
    let work = || {
        let job = TestJob::small();
        let expected = job.expected_files();
        loop {
            let n = next.fetch_add(1, Ordering::SeqCst);
            if n > steps.load(Ordering::SeqCst) {
                return;
            }
            let (what, code) = fault(n);
            let ran = job.run(&format!("{step}:{n}:{what}"), &[]);
            let context = format!("{step} {n}, {what}: {}", ran.stderr);
            if !ran.stderr.contains("fault injected by") {
                assert_eq!(ran.code, 0, "{context}");
                steps.fetch_min(n - 1, Ordering::SeqCst);
            } else if ran.code == 0 {
                // A fault in the record of the run does not fail the run.
                assert!(ran.stderr.contains("note: the run's record"), "{context}");
            } else {
                assert_eq!(ran.code, code, "{context}");
                let lines = ran.stderr.lines().filter(|l| l.starts_with("lenscube: ")).count();
                assert!(code == KILLED || lines == 1, "not one line: {context}");
                assert!(!ran.stderr.contains("panicked"), "{context}");
            }
            let again = job.run("", &[]);
            assert_eq!(again.code, 0, "{context}; then {}", again.stderr);
            assert!(files(&job.film) == expected, "other bytes after {context}");
            assert_eq!(job.leftover_files(), Vec::<std::path::PathBuf>::new(), "{context}");
            fs::remove_dir_all(&job.film).unwrap();
        }
    };
    std::thread::scope(|s| [s.spawn(work), s.spawn(work)].into_iter().for_each(|t| t.join().unwrap()));
    steps.into_inner()
}

#[test]
fn io_error_at_any_step_is_reported_and_the_same_command_completes() {
    // No space left, device error, stale file handle; permission denied, read-only file system, file too large.
    let errors = [("28", RETRY), ("13", 1), ("5", RETRY), ("30", 1), ("116", RETRY), ("27", 1)];
    let steps = inject_at_every_step("any", |n| errors[n % errors.len()]);
    assert!(steps > 100, "a job of {steps} steps");
}

#[test]
#[ignore = "long: a run for each step; scripts/crash-test kills at some of them"]
fn kill_at_any_step_can_be_resumed() {
    assert!(inject_at_every_step("any", |_| ("kill", KILLED)) > 100);
}

#[test]
fn torn_and_short_writes_are_not_accepted_as_complete() {
    let writes = inject_at_every_step("write", |n| [("torn", KILLED), ("short", 1)][n % 2]);
    // Seven files of metadata and coordinates, the metadata of the group, eight shards, a record.
    assert!(writes > 16, "{writes} writes");
}

/// Shards of the array `film`, without temporary files.
fn film_shards(job: &TestJob) -> Vec<std::path::PathBuf> {
    let is_shard = |p: &std::path::PathBuf| p.starts_with("film/c") && !text(p).contains(".tmp-");
    shards(&job.film).into_iter().filter(is_shard).collect()
}

#[test]
fn film_whose_batch_is_cut_off_is_incomplete_until_it_is_resumed() {
    let job = TestJob::small().with_tails();
    let expected = job.expected_files();
    // Nine renames create the film; two layers and eight shards follow.
    let renames = (10..=19).map(|n| format!("rename:{n}"));
    let points = ["batch-staged:1", "batch-flushed:1"].map(str::to_owned).into_iter().chain(renames);
    for (n, point) in points.enumerate() {
        assert_eq!(job.run(&format!("{point}:kill"), &[]).code, KILLED, "{point}");
        let made = film_shards(&job);
        assert!(made.len() <= n.saturating_sub(4), "{point}: {made:?}");
        for band in ["0", "1"] {
            let is_begun = made.iter().any(|p| p.starts_with(Path::new("film/c").join(band)));
            let layer = job.film.join("veil_tail/c").join(band).join("0/0");
            assert!(!is_begun || layer.is_file(), "{point}: {made:?}");
        }
        let status = crate::common::lenscube(&["status", text(&job.film), "--check"]);
        assert_eq!(status.code, 4, "{point}: {}", status.stdout);
        job.run("", &[]).ok();
        assert!(files(&job.film) == expected, "other bytes after {point}");
        assert_eq!(job.leftover_files(), Vec::<std::path::PathBuf>::new(), "{point}");
        fs::remove_dir_all(&job.film).unwrap();
    }
}

#[test]
fn batch_that_cannot_be_flushed_exits_75_and_the_same_command_completes() {
    let job = TestJob::small();
    let expected = job.expected_files();
    // Eight flushes create the film; the next ones are those of its shards.
    for (step, made) in [("sync:9:28", 0), ("sync:16:5", 0), ("rename:12:28", 3)] {
        let ran = job.run(step, &[]);
        assert_eq!(ran.code, RETRY, "{step}: {}", ran.stderr);
        for word in ["writing the last shards", "is incomplete", "the same command resumes it"] {
            assert!(ran.stderr.contains(word), "{step}, {word}: {}", ran.stderr);
        }
        assert_eq!(film_shards(&job).len(), made, "{step}");
        assert!(!files(&job.film).keys().any(|p| text(p).contains(".tmp-")), "{step}");
        job.run("", &[]).ok();
        assert!(files(&job.film) == expected, "other bytes after {step}");
        fs::remove_dir_all(&job.film).unwrap();
    }
}

/// Damages the last inner chunk of the chart's band 1 (rows and columns from 512); path and original bytes of the file.
fn damage_last_chunk(job: &TestJob) -> (std::path::PathBuf, Vec<u8>) {
    let chunk = job.chart.join("chart/c/1/0/0");
    let good = fs::read(&chunk).unwrap();
    let mut bad = good.clone();
    let near_the_end = bad.len() - 200;
    bad[near_the_end] ^= 0x40;
    fs::write(&chunk, bad).unwrap();
    (chunk, good)
}

#[test]
fn damaged_chart_chunk_exits_1_and_names_band_and_shard() {
    let job = TestJob::large();
    let expected = job.expected_files();
    let (chunk, good) = damage_last_chunk(&job);
    let ran = job.run("", &[]);
    assert_eq!(ran.code, 1, "{}", ran.stderr);
    for word in ["band 1 (500 nm)", "shard film/c/1/", "chart/c/1/0/0", "damaged", "resumes"] {
        assert!(ran.stderr.contains(word), "{word}: {}", ran.stderr);
    }
    fs::write(&chunk, good).unwrap();
    let touched = job.run("", &[]);
    assert!(touched.code == 3 && touched.stderr.contains("--trust-input"), "{}", touched.stderr);
    job.run("", &["--trust-input"]).ok();
    assert_same_arrays(&job.film, &expected);
}

/// Asserts equal files except `zarr.json`, whose attributes contain the modification times of the chart.
fn assert_same_arrays(film: &Path, expected: &std::collections::BTreeMap<std::path::PathBuf, Vec<u8>>) {
    let found = files(film);
    assert_eq!(found.len(), expected.len());
    for (path, bytes) in &found {
        assert!(path == Path::new("zarr.json") || expected[path] == *bytes, "{}", path.display());
    }
}

#[test]
fn keep_going_writes_all_shards_that_do_not_depend_on_the_damaged_chunk() {
    let job = TestJob::large();
    let expected = job.expected_files();
    let (chunk, good) = damage_last_chunk(&job);
    let ran = job.run("", &["--keep-going"]);
    assert_eq!(ran.code, 1, "{}", ran.stderr);
    for word in ["left out: band 1 (500 nm), shard film/c/1/", "damaged", "could not be computed", "resumes"]
    {
        assert!(ran.stderr.contains(word), "{word}: {}", ran.stderr);
    }
    let made = shards(&job.film);
    let of = |band: &str| made.iter().filter(|p| p.starts_with(Path::new("film/c").join(band))).count();
    assert_eq!(of("0"), 30, "the sound band is whole");
    assert!((10..30).contains(&of("1")), "{} shards of the damaged band", of("1"));
    let status = crate::common::lenscube(&["status", text(&job.film), "--check"]);
    assert!(status.code == 4 && status.stdout.contains("1 partly done (500 nm"), "{}", status.stdout);
    fs::write(&chunk, good).unwrap();
    job.run("", &["--trust-input"]).ok();
    assert_same_arrays(&job.film, &expected);
}

#[test]
fn keep_going_stops_at_a_full_disk_and_after_repeated_permission_errors() {
    let job = TestJob::large();
    let expected = job.expected_files();
    // Every write from the first shard on fails; seven files precede it.
    let full = job.run("write:9+:28", &["--keep-going"]);
    assert_eq!(full.code, RETRY, "{}", full.stderr);
    for word in ["no space left", "band 0 (450 nm), shard film/c/0/"] {
        assert!(full.stderr.contains(word), "{word}: {}", full.stderr);
    }
    let forbidden = job.run("create:2+:13", &["--keep-going"]);
    assert_eq!(forbidden.code, 1, "{}", forbidden.stderr);
    assert!(forbidden.stderr.contains("not permitted"), "{}", forbidden.stderr);
    // A single error costs one shard.
    let once = job.run("create:9:13", &["--keep-going"]);
    assert_eq!(once.code, 1, "{}", once.stderr);
    assert!(once.stderr.contains("lenscube: 1 of "), "{}", once.stderr);
    job.run("", &[]).ok();
    assert!(files(&job.film) == expected);
}

/// Moves a store away while the run is stopped, and back after the run has ended.
fn run_while_store_is_moved(job: &TestJob, store: &Path, step: &str) -> CommandResult {
    let run = job.stopped(step, &["--keep-going"]);
    let away = job.at("away");
    fs::rename(store, &away).unwrap();
    let ran = run.run_to_end();
    assert!(!store.exists(), "{} was made again in parts", store.display());
    fs::rename(&away, store).unwrap();
    ran
}

#[test]
fn removed_store_exits_75() {
    let job = TestJob::large();
    let expected = job.expected_files();
    for (store, step) in [(&job.film, "write:12"), (&job.chart, "create:2")] {
        let ran = run_while_store_is_moved(&job, store, step);
        assert_eq!(ran.code, RETRY, "{}", ran.stderr);
        assert!(
            ran.stderr.contains("has disappeared since the job started") && ran.stderr.contains(text(store)),
            "{}",
            ran.stderr
        );
        let status = crate::common::lenscube(&["status", text(&job.film), "--check"]);
        assert_eq!(status.code, 4, "{}", status.stdout);
    }
    job.run("", &[]).ok();
    assert!(files(&job.film) == expected);
}

#[test]
fn chart_changed_during_the_run_exits_1_and_resuming_exits_3() {
    let job = TestJob::large();
    let run = job.stopped("write:12", &[]);
    let chunk = fs::File::open(job.chart.join("chart/c/0/0/0")).unwrap();
    chunk.set_modified(std::time::UNIX_EPOCH).unwrap();
    let ran = run.run_to_end();
    // A shard that reads the chunk again finds the change first; where every chunk was cached, the check at the end does.
    let found = ["it was written to since the chart was opened", "changed during the run"];
    assert!(ran.code == 1 && found.iter().any(|m| ran.stderr.contains(m)), "{}", ran.stderr);
    assert_eq!(job.run("", &[]).code, 3);
}

/// Changes `file` of the chart while a run is stopped at its first shards, restores it after the run, and resumes.
fn change_and_restore(job: &TestJob, file: &Path, changed: &[u8]) {
    let expected = job.expected_files();
    let original = fs::read(file).unwrap();
    let modified = fs::metadata(file).unwrap().modified().unwrap();
    assert_ne!(original, changed);
    let run = job.stopped("write:10", &[]);
    fs::write(file, changed).unwrap();
    let ran = run.run_to_end();
    assert_eq!(ran.code, 1, "{}", ran.stderr);
    fs::write(file, original).unwrap();
    fs::File::options().write(true).open(file).unwrap().set_modified(modified).unwrap();
    job.run("", &[]).ok();
    assert!(files(&job.film) == expected, "pixels of the changed chart are in the film");
}

#[test]
fn film_is_resumed_after_a_changed_zarr_chart_is_restored() {
    let job = TestJob::large();
    let other = job.at("other.zarr");
    Picture::noise(12, Size::new(631, 705), 2).write(&other);
    let chunk = Path::new("chart/c/1/0/0");
    change_and_restore(&job, &job.chart.join(chunk), &fs::read(other.join(chunk)).unwrap());
}

#[test]
fn film_is_resumed_after_a_changed_npy_chart_is_restored() {
    let size = Size::new(631, 705);
    let layout = &["--shard", "128", "--chunk", "64", "--wavelengths", "450,500", "--film-pitch-um", "2"];
    let mut job = TestJob::new(size, layout);
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
    job.chart = job.at("chart.npy");
    fs::write(&job.chart, npy(11)).unwrap();
    change_and_restore(&job, &job.chart, &npy(12));
}
