//! Designs and packs that change during the run.

use super::*;

/// Stops a run after its first shards, calls `change`, and continues the run to its end.
fn run_with_change_after_first_shards(
    film: &Path,
    command: &mut Command,
    change: impl FnOnce(),
) -> CommandResult {
    let child = command.env("LENSCUBE_FAULT", "write:12:stop").stderr(std::process::Stdio::piped());
    let mut run =
        crate::common::test_job::StoppedRun(child.stdout(std::process::Stdio::null()).spawn().unwrap());
    assert!(run.wait_stopped(), "the run ended before its first shards");
    assert!(film.exists());
    change();
    run.run_to_end()
}

#[test]
fn design_changed_during_the_run_exits_1() {
    let job = DesignJob::new();
    let film = job.at("film");
    let chart = job.at("chart");
    let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
    command.args(["run", text(&chart), text(&film), "--lens", text(&job.design), "--film-pitch-um", "10"]);
    command.args(["--threads", "2", "--shard", "16", "--chunk", "16"]).env("XDG_CACHE_HOME", job.at("cache"));
    let ran = run_with_change_after_first_shards(&film, &mut command, || {
        fs::write(&job.design, format!("{DESIGN}\nNOTE 0 another focus\n")).unwrap();
    });
    assert_eq!(ran.code, FAILED, "{}", ran.stderr);
    assert!(ran.stderr.contains("my.zmx: the design changed"), "{}", ran.stderr);
}

#[test]
fn pack_changed_during_the_run_exits_1_without_mixed_shards() {
    use crate::common::{identity_band, lens, scattered, write_pack};
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    Picture::noise(11, Size::new(90, 100), 2).write(&at("chart"));
    let tables = lens([450.0, 500.0].map(|nm| identity_band(nm, 1.0, 5)).into());
    let pack = |path: &Path, seed: u64| {
        write_pack(path, &tables, tables.bands.iter().zip(seed..).map(|(b, s)| scattered(s, b)).collect());
    };
    for ending in ["lens.zarr", "lens.zip"] {
        let (used, other, film) =
            (at(&format!("a.{ending}")), at(&format!("b.{ending}")), at(&format!("film.{ending}")));
        pack(&used, 1);
        pack(&other, 7);
        let chart = at("chart");
        let command = || {
            let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
            command.args(["run", text(&chart), text(&film), "--lens", text(&used), "--no-fsync"]);
            command.args(["--threads", "1", "--shard", "32", "--chunk", "32"]);
            command
        };
        let ran = run_with_change_after_first_shards(&film, &mut command(), || {
            fs::rename(&used, at("old")).unwrap();
            fs::rename(&other, &used).unwrap();
        });
        assert_eq!(ran.code, FAILED, "{ending}: {}", ran.stderr);
        assert!(ran.stderr.contains("the lens pack changed"), "{ending}: {}", ran.stderr);
        // The shards written are those of the original pack.
        let mixed = files(&film);
        let whole = at("whole");
        let old = at("old");
        let words = ["run", text(&chart), text(&whole), "--lens", text(&old), "--no-fsync"];
        lenscube(&[&words[..], &["--shard", "32", "--chunk", "32"]].concat()).ok();
        let sound = files(&whole);
        let shards = |p: &&PathBuf| p.starts_with("film/c");
        assert!(
            mixed.keys().any(|p| shards(&p))
                && mixed.iter().filter(|(p, _)| shards(p)).all(|(p, b)| sound[p] == *b)
        );
        // A file rewritten with the same content is not an error.
        fs::remove_dir_all(&film).unwrap();
        let ran = run_with_change_after_first_shards(&film, &mut command(), || {
            let file = if used.is_dir() { used.join("psf/1/zarr.json") } else { used.clone() };
            fs::write(&file, fs::read(&file).unwrap()).unwrap();
        });
        assert_eq!(ran.code, 0, "{ending}: {}", ran.stderr);
        for path in [film, whole] {
            fs::remove_dir_all(path).unwrap();
        }
        let _ = fs::remove_dir_all(at("old")).or_else(|_| fs::remove_file(at("old")));
    }
}
