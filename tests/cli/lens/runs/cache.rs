//! The cache of traced bands.

use super::*;

#[test]
fn traced_bands_are_equal_in_one_run_in_two_runs_and_from_the_cache() {
    let job = DesignJob::new();
    let fresh = job.run("cache", "fresh", &["-v"]).ok();
    assert!(fresh.stderr.contains("2 of 2 bands traced"), "{}", fresh.stderr);
    assert_eq!(job.entries("cache").len(), 2, "two bands, nothing else");
    let kept = job.run("cache", "kept", &["-v"]).ok();
    assert!(!kept.stderr.contains("traced"), "{}", kept.stderr);
    assert!(files(&job.at("fresh")) == files(&job.at("kept")));
    // In two runs with another cache, one of them on one thread.
    job.run("other", "first", &["--bands", "0"]).ok();
    assert_eq!(job.entries("other").len(), 1, "only the bands of the chart are traced");
    job.run("other", "second", &["--bands", "1", "--threads", "1"]).ok();
    let both = pixels(&job.at("fresh"), "film").1;
    let (first, second) = (pixels(&job.at("first"), "film").1, pixels(&job.at("second"), "film").1);
    assert!(bits(&both) == bits(&[first, second].concat()));
    let names =
        |cache| job.entries(cache).iter().map(|p| p.file_name().unwrap().to_owned()).collect::<Vec<_>>();
    assert_eq!(names("cache"), names("other"));
}

#[test]
#[ignore = "long: traces wide PSFs twice"]
fn wide_psfs_are_cached_as_pupil_functions_and_give_the_same_film() {
    let job = DesignJob::new();
    let run = |film: &str| {
        let flags = ["-v", "--bands", "0", "--lens", "cine-petzval", "--film-pitch-um", "2"];
        job.run("cache", film, &flags).ok()
    };
    assert!(run("fresh").stderr.contains("1 of 1 bands traced"));
    let entries = job.entries("cache");
    let sizes: Vec<u64> = entries.iter().map(|path| fs::metadata(path).unwrap().len()).collect();
    assert!(sizes.len() == 1 && sizes[0] < 1_000_000, "{sizes:?}");
    let cached = LensPack::open(&entries[0]).unwrap();
    let psfs = cached.psf(0).unwrap();
    assert!(cached.has_pupils() && 4 * psfs.samples.len() > 32_000_000, "{} samples", psfs.samples.len());
    assert!(!run("kept").stderr.contains("traced"));
    assert!(files(&job.at("fresh")) == files(&job.at("kept")));
}

#[test]
fn damaged_cache_entry_is_traced_again_and_unwritable_cache_is_a_note() {
    let job = DesignJob::new();
    job.run("cache", "fresh", &[]).ok();
    let entry = job.entries("cache")[0].clone();
    let sound = fs::read(&entry).unwrap();
    let mut edited = sound.clone();
    let middle = edited.len() / 2;
    edited[middle] ^= 1;
    for (i, damage) in [&sound[..sound.len() / 2], &edited[..], b""].into_iter().enumerate() {
        fs::write(&entry, damage).unwrap();
        let film = format!("again-{i}");
        let ran = job.run("cache", &film, &["-v"]).ok();
        assert!(
            ran.stderr.contains("damaged") && ran.stderr.contains("1 of 2 bands traced"),
            "{}",
            ran.stderr
        );
        assert!(files(&job.at("fresh")) == files(&job.at(&film)));
        assert!(fs::read(&entry).unwrap() == sound && job.entries("cache").len() == 2);
    }
    // A file at the path of the cache directory.
    fs::write(job.at("file"), "").unwrap();
    let ran = job.run("file", "without", &[]).ok();
    assert!(ran.stderr.contains("cannot be stored in the cache"), "{}", ran.stderr);
    assert!(files(&job.at("fresh")) == files(&job.at("without")));
}

#[test]
fn cache_entry_of_another_band_is_traced_again() {
    let job = DesignJob::new();
    // Two concurrent processes with an empty cache.
    let start = |film: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        let (chart, film) = (job.at("chart"), job.at(film));
        command.args([
            "run",
            text(&chart),
            text(&film),
            "--lens",
            text(&job.design),
            "--film-pitch-um",
            "10",
        ]);
        command.args(["--no-fsync", "--threads", "1"]).env("XDG_CACHE_HOME", job.at("cache")).spawn().unwrap()
    };
    let both = [start("one"), start("two")];
    both.into_iter().for_each(|mut run| assert!(run.wait().unwrap().success()));
    assert!(files(&job.at("one")) == files(&job.at("two")));
    let entries = job.entries("cache");
    assert_eq!(entries.len(), 2, "{entries:?}");
    let name = |i: usize| entries[i].file_name().unwrap().to_str().unwrap().to_owned();
    let (first, second) = (name(0), name(1));
    // A valid entry of another band under the name of this band.
    let foreign = entries[0].with_file_name(format!("{}{}", &first[..33], &second[33..]));
    fs::rename(&entries[0], job.at("aside")).unwrap();
    fs::copy(&entries[1], &foreign).unwrap();
    let ran = job.run("cache", "again", &["-v"]).ok();
    assert!(
        ran.stderr.contains("not traced for this band") && ran.stderr.contains("1 of 2"),
        "{}",
        ran.stderr
    );
    assert!(files(&job.at("one")) == files(&job.at("again")));
    assert_eq!(job.entries("cache"), entries);
    // A directory instead of an entry.
    fs::remove_file(&entries[0]).unwrap();
    fs::create_dir(&entries[0]).unwrap();
    let ran = job.run("cache", "aside-dir", &[]).ok();
    assert!(ran.stderr.contains("not a regular file"), "{}", ran.stderr);
}
