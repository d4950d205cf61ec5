//! Outputs of other jobs, overwriting, full disk, float16 overflow.

use super::*;

#[test]
fn output_of_another_job_exits_3_and_names_the_difference() {
    let job = SmallJob::new();
    job.run(&[]).ok();
    let film = files(&job.film);
    for (flags, words) in [
        (["--interp", "bilinear"], ["interp", "bicubic", "bilinear"]),
        (["--codec", "zstd"], ["--codec", "lz4", "zstd"]),
        (["--keep-bits", "12"], ["--keep-bits", "nothing", "12"]),
        (["--dtype", "f16"], ["--dtype", "f32", "f16"]),
        (["--axis", "45,44"], ["axis", "45.0", "44.0"]),
        (["--bands", "1:3"], ["--bands", "[0,1,2]", "[1,2]"]),
    ] {
        assert_error_line(&job.run(&flags), OTHER_JOB, &[&words[..], &["--overwrite"]].concat());
        assert!(files(&job.film) == film, "{flags:?} changed the film");
    }
    job.run(&["--interp", "bilinear", "--overwrite"]).ok();
    assert!(files(&job.film) != film);
}

#[test]
fn overwrite_replaces_films_and_charts_only() {
    let job = SmallJob::new();
    let at = |name: &str| job.dir.path().join(name);
    fs::create_dir(at("thesis")).unwrap();
    fs::write(at("thesis/chapter-1.tex"), "It was a dark and stormy night").unwrap();
    fs::write(at("notes.txt"), "buy milk").unwrap();
    Picture::noise(6, Size::new(8, 9), 1).write(&at("other.zarr"));
    fs::create_dir(at("packs")).unwrap();
    let other = at("packs/other.lens.zarr");
    assert!(Command::new("cp").arg("-r").args([&job.pack, &other]).status().unwrap().success());
    for output in [at("thesis"), at("notes.txt"), other, at("other.zarr")] {
        let before = files(job.dir.path());
        for flags in [&["--overwrite"][..], &[]] {
            let ran = run(text(&job.chart), &output, text(&job.pack), flags);
            assert_error_line(&ran, OTHER_JOB, &[text(&output), "nothing was changed"]);
        }
        let chart =
            ["chart", "checker", text(&output), "--size", "64", "--overwrite", "--wavelengths", "500"];
        if output != at("other.zarr") {
            assert_error_line(&lenscube(&chart), OTHER_JOB, &[text(&output), "nothing was changed"]);
        }
        assert!(files(job.dir.path()) == before, "{}", output.display());
    }
    assert_error_line(
        &lenscube(&["chart", "checker", text(&job.chart), "--size", "64"]),
        OTHER_JOB,
        &["--overwrite"],
    );
    // A film may be the chart of another film, but not of itself.
    job.run(&[]).ok();
    let before = files(&job.film);
    let array = format!("{}//film", text(&job.film));
    for chart in [text(&job.film), &array] {
        let ran = run(chart, &job.film, text(&job.pack), &["--overwrite"]);
        assert_error_line(&ran, USAGE, &["film.zarr", "the chart"]);
        assert!(files(&job.film) == before, "the film changed although it was its own chart");
    }
}

/// `ulimit -f` makes writes of large files fail as on a full disk, without root: shards do not fit, all other files do.
#[test]
fn run_on_a_full_disk_can_be_resumed() {
    let job = SmallJob::with(Picture::noise(5, Size::new(300, 301), 3));
    let words = ["run", text(&job.chart), text(&job.film), "--lens", text(&job.pack), "--outside", "clamp"];
    let script = "ulimit -f 64; exec \"$0\" \"$@\"";
    let limited =
        Command::new("sh").args(["-c", script, env!("CARGO_BIN_EXE_lenscube")]).args(words).output().unwrap();
    let ran = CommandResult::new(&limited);
    assert_error_line(&ran, FAILED, &["film/c/", "too large", "resumes", "(ulimit -f) of "]);
    assert_eq!(shards(&job.film).iter().filter(|p| p.starts_with("film")).count(), 0);
    assert!(!files(&job.film).into_keys().any(|p| text(&p).contains("tmp")), "leftover temporary file");
    job.run(&["--outside", "clamp"]).ok();
    let (resumed, whole) = (files(&job.film), job.dir.path().join("whole"));
    run(text(&job.chart), &whole, text(&job.pack), &["--outside", "clamp"]).ok();
    assert!(resumed == files(&whole));
    // A chart is written completely or not at all.
    let chart = job.dir.path().join("drawn.zarr");
    let words =
        ["chart", "composite", text(&chart), "--size", "300", "--codec", "none", "--wavelengths", "500"];
    let limited =
        Command::new("sh").args(["-c", script, env!("CARGO_BIN_EXE_lenscube")]).args(words).output().unwrap();
    assert_error_line(&CommandResult::new(&limited), FAILED, &["too large", "(ulimit -f) of "]);
    let left: Vec<_> = fs::read_dir(job.dir.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(left.len(), 4, "{left:?}");
}

#[test]
fn f16_overflow_is_an_error_with_band_row_column() {
    let mut picture = Picture::noise(5, Size::new(90, 100), 3);
    picture.bands[2].iter_mut().for_each(|v| *v += 7e4);
    let job = SmallJob::with(picture);
    job.assert_fails(&["--dtype", "f16"], &["band 2", "row 0, column 0", "float16", "65504"]);
}
