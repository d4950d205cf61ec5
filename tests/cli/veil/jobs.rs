//! Flags of the veil: another job, errors before work, memory, plans, and `lenscube shoot`.

use super::*;

#[test]
fn other_light_is_another_job() {
    let job = TestJob::small();
    job.run("", &VEIL).ok();
    let with = |flags: &[&str]| job.run("", flags);
    assert_error_line(
        &with(&[]),
        3,
        &["--veiling-glare (film 0.02, requested nothing)", "--scatter (film {"],
    );
    assert_error_line(&with(&["--veiling-glare", "2%"]), 3, &["--scatter (film {"]);
    let scatter = ["--veiling-glare", "2%", "--scatter", "3%,r0=5,slope=2.3"];
    assert_error_line(&with(&scatter), 3, &["--scatter (film {", "2.2", "2.3"]);
    assert_error_line(
        &with(&[&VEIL[..], &["--veil-bin", "16"]].concat()),
        3,
        &["--veil-bin (film nothing, requested 16)"],
    );
    // The bin of the film's size may be named.
    with(&[&VEIL[..], &["--veil-bin", "8"]].concat()).ok();
}

#[test]
fn light_that_does_not_fit_is_an_error_before_work() {
    let job = TestJob::small();
    for (flags, texts) in [
        (&["--veiling-glare", "50%"][..], &["50%", "share"][..]),
        (&["--scatter", "3%,slope=1"], &["slope", "1.000001 to 4"]),
        (&["--scatter", "3%,r0=0.5"], &["r0", "1 to"]),
        (&["--scatter", "3%,reach=0.01"], &["--scatter", "reach", "4 bins of 8 film pixels"]),
        (&["--scatter", "3%,reach=5"], &["--scatter", "reach"]),
        (&["--scatter", "3%,blur=5"], &["blur", "SHARE|roughness=NM[,r0=UM][,slope=S][,reach=MM]"]),
        (&["--veiling-glare", "49%", "--scatter", "45%"], &["--veiling-glare", "--scatter", "0.9"]),
        (&["--scatter", "roughness=-1"], &["roughness", "0 to 1e3 nm"]),
        (&["--scatter", "roughness=1"], &["roughness", "lens pack", "--scatter SHARE"]),
        (&["--veil-bin", "16"], &["--veil-bin", "--veiling-glare"]),
        (&["--veiling-glare", "1%", "--veil-bin", "12"], &["8, 16, 32, 64 or auto"]),
        (&["--stages", "ri,veil"], &["veil"]),
    ] {
        let rejected = job.run("", flags);
        assert_exit(&rejected, 2, texts);
        assert!(!job.film.exists(), "{flags:?}");
    }
    let bin = TestJob::new(Size::new(40, 50), &["--shard", "64", "--chunk", "32"]);
    assert_error_line(
        &bin.run("", &["--veiling-glare", "1%", "--veil-bin", "64"]),
        2,
        &["--veil-bin 64", "50x40"],
    );
}

/// The limit that a job needs at least is named; one that suffices for the job without the veil is too small for that with it.
#[test]
fn memory_that_the_veil_lacks_is_an_error_that_names_larger_bins() {
    let scene = Scene::new(Size::new(8, 8), |_, _| 1.0);
    let film = scene.dir.path().join("film");
    let with = |limit: &str, flags: &[&str]| {
        let always = ["--outside", "clamp", "--stages", "ri,distortion", "--memory", limit, "--dry-run"];
        let chart = "gen:checker?size=4096&wavelengths=450&pitch_um=2";
        run(chart, &film, text(&scene.pack), &[&always[..], flags].concat())
    };
    let refused = with("20MiB", &[]);
    let words: Vec<&str> = refused.stderr.split_whitespace().collect();
    let at = words.iter().position(|word| *word == "least").unwrap();
    let enough = words[at + 1].trim_end_matches(';');
    with(enough, &[]).ok();
    assert_error_line(&with(enough, &VEIL), 2, &["light that spreads over the film", "--veil-bin 64"]);
}

#[test]
fn forecast_and_plan_name_the_reading_before_the_tiles() {
    let job = TestJob::large();
    let forecast = job.run("", &[&VEIL[..], &["--dry-run"]].concat()).ok().stdout;
    assert!(
        forecast.contains("before the tiles, of 2 bands, for light that spreads far (veil)"),
        "{forecast}"
    );
    let plan = |flags: &[&str]| {
        let path = job.at("plan.json");
        let film = job.at("planned.zarr");
        let made = job.plan(&film, flags).args(["-o", text(&path)]).output().unwrap();
        let made = CommandResult::new(&made).ok();
        let plan: serde_json::Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
        fs::remove_file(path).unwrap();
        fs::remove_dir_all(film).unwrap();
        (plan["totals"]["bytes_read"].as_u64().unwrap(), made.stderr)
    };
    let ((without, _), (with, note)) =
        (plan(&["--unit-rows", "1"]), plan(&[&VEIL[..], &["--unit-rows", "1"]].concat()));
    // Two bands of a chart of 631 x 705 px of f32 are read once more.
    assert_eq!(with - without, 2 * 631 * 705 * 4);
    assert!(note.contains("each compute it, with the same result"), "{note}");
}

#[test]
fn shot_has_the_veil_of_its_flags() {
    let dir = tempfile::tempdir().unwrap();
    let (keep, out) = (dir.path().join("shot"), dir.path().join("shot.png"));
    let words = [
        "shoot",
        "gen:checker?size=300&wavelengths=450,550,650",
        text(&out),
        "--lens",
        "double-gauss-28-npz",
    ];
    let flags =
        ["--sensor", "example-2um", "--keep", text(&keep), "--veiling-glare", "1%", "--memory", "1GiB"];
    lenscube(&[&words[..], &flags].concat()).ok();
    assert!(keep.join("film.zarr/veil/c/2/0/0").exists());
}
