//! The stored layer: the same bytes however a film is made, kills, damage.

use super::*;
use crate::common::{bits, shards};

#[test]
fn shares_of_zero_are_no_veil() {
    let job = TestJob::small();
    let expected = job.expected_files();
    job.run("", &["--veiling-glare", "0", "--scatter", "0,slope=2", "--veil-bin", "auto"]).ok();
    assert!(files(&job.film) == expected);
}

#[test]
fn film_bytes_do_not_depend_on_threads_or_memory() {
    let job = TestJob::large();
    let run = |name: &str, flags: &[&str]| {
        let film = job.at(name);
        let flags = [&VEIL[..], flags].concat();
        CommandResult::new(&job.command(&film, "", &flags).output().unwrap()).ok();
        files(&film)
    };
    let first = run("first", &[]);
    assert!(first.contains_key(Path::new("veil/c/1/0/0")), "{:?}", first.keys());
    for (threads, memory) in [("1", "512MiB"), ("7", "4GiB"), ("2", "4GiB")] {
        let flags = [&VEIL[..], &["--memory", memory]].concat();
        let mut command = job.command_on(threads, &job.at(threads), &flags);
        CommandResult::new(&command.output().unwrap()).ok();
        assert!(files(&job.at(threads)) == first, "{threads} threads, {memory}");
    }
}

#[test]
fn regions_have_the_pixels_of_the_whole_film() {
    let job = TestJob::large();
    job.run("", &VEIL).ok();
    let (size, whole) = pixels(&job.film, "film");
    let whole = bits(&whole);
    let film = job.at("regions.zarr");
    let flags = [&VEIL[..], &["--roi", "300,411,320,200", "--roi", "5,600,690,31"]].concat();
    CommandResult::new(&job.command(&film, "", &flags).output().unwrap()).ok();
    for (i, (x, y, w, h)) in [(300, 411, 320, 200), (5, 600, 690, 31)].into_iter().enumerate() {
        let part = |band: &Vec<u32>| -> Vec<u32> {
            (y..y + h).flat_map(|row| band[row * size.width + x..][..w].to_vec()).collect()
        };
        let expected: Vec<_> = whole.iter().map(part).collect();
        assert!(bits(&pixels(&film, &format!("roi_{i}")).1) == expected, "region {i}");
    }
    assert!(fs::read(film.join("veil/c/0/0/0")).unwrap() == fs::read(job.film.join("veil/c/0/0/0")).unwrap());
}

#[test]
fn killed_runs_leave_the_bytes_of_an_undisturbed_one() {
    let job = TestJob::small();
    let whole = job.at("whole.zarr");
    CommandResult::new(&job.command(&whole, "", &VEIL).output().unwrap()).ok();
    let expected = files(&whole);
    let (mut kills, mut of_layers) = (0, 0);
    // Nine renames create the film, two are those of the layers.
    let faults: Vec<String> = (1..=13)
        .flat_map(|n| [format!("rename:{n}:kill"), format!("write:{n}:kill")])
        .chain(["layer-made:1", "layer-made:2", "layer-committed:1"].map(|point| format!("{point}:kill")))
        .collect();
    for fault in faults {
        let ran = job.run(&fault, &VEIL);
        kills += usize::from(ran.code == KILLED);
        let layers = |band: usize| job.film.join(format!("veil/c/{band}/0/0")).exists();
        let all = if job.film.exists() { shards(&job.film) } else { Vec::new() };
        let is_shard = |p: &PathBuf| !text(p).contains(".tmp-");
        let shards = |band: usize| {
            let of_band = Path::new("film/c").join(band.to_string());
            all.iter().filter(|p| is_shard(p)).any(|p| p.starts_with(&of_band))
        };
        // No shard is there without the layer of its band.
        assert!((0..2).all(|band| layers(band) || !shards(band)), "{fault}");
        of_layers += usize::from(ran.code == KILLED && layers(0) != layers(1));
        let again = job.run("", &VEIL);
        assert_eq!(again.code, 0, "{fault}: {}", again.stderr);
        assert!(files(&job.film) == expected, "{fault}");
        assert_eq!(job.leftover_files(), Vec::<PathBuf>::new(), "{fault}");
        fs::remove_dir_all(&job.film).unwrap();
    }
    assert!(kills >= 20 && of_layers > 0, "{kills} kills, {of_layers} between the layers");
}

#[test]
fn damaged_layer_is_found_and_repaired_with_the_shards_of_its_band() {
    let job = TestJob::small();
    job.run("", &VEIL).ok();
    let intact = files(&job.film);
    assert_exit(&lenscube(&["verify", text(&job.film)]), 0, &["is correct"]);
    let status = lenscube(&["status", text(&job.film)]).ok().stdout;
    assert!(status.contains("veil    light beside the image of 2 of 2 bands"), "{status}");
    let layer = job.film.join("veil/c/1/0/0");
    let mut bytes = fs::read(&layer).unwrap();
    bytes[100] ^= 1;
    fs::write(&layer, &bytes).unwrap();
    fs::remove_file(job.film.join("film/c/1/0/0")).unwrap();
    // A run that needs it does not use it.
    assert_error_line(&job.run("", &VEIL), 1, &["veil/c/1/0/0", "checksum", "--repair"]);
    assert_exit(
        &lenscube(&["verify", text(&job.film)]),
        4,
        &["bad: veil/c/1/0/0: its checksum does not match"],
    );
    assert_eq!(lenscube(&["verify", text(&job.film), "--repair"]).code, 4);
    assert!(
        !layer.exists() && !job.film.join("film/c/1/1/1").exists() && job.film.join("film/c/0/1/1").exists()
    );
    let status = lenscube(&["status", text(&job.film), "--json"]).ok().stdout;
    let status: serde_json::Value = serde_json::from_str(&status).unwrap();
    assert_eq!(status["layers"], serde_json::json!([{"name": "veil", "bands": 2, "bands_done": 1}]));
    job.run("", &VEIL).ok();
    assert!(files(&job.film) == intact);
    // Shards have their light already: a layer that is lost is made again alone.
    fs::remove_file(&layer).unwrap();
    assert_exit(&lenscube(&["status", text(&job.film), "--check"]), 4, &[]);
    let restored = job.run("", &VEIL);
    assert_exit(&restored, 0, &["band 1 (", "lost, computed again", "nothing to do"]);
    assert!(files(&job.film) == intact);
    assert_exit(&lenscube(&["status", text(&job.film), "--check"]), 0, &[]);
    // With --overwrite of another job the array is removed, too.
    job.run("", &["--overwrite"]).ok();
    assert!(!job.film.join("veil").exists());
}
