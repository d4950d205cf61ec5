//! Invalid command lines.

use super::*;

/// Asserts exit code 2 and the texts of the command line parser's message.
fn assert_usage_error(words: &[&str], expected: &[&str]) {
    assert_exit(&lenscube(words), USAGE, expected);
}

#[test]
fn invalid_flag_values_exit_2_and_unknown_flags_suggest_the_nearest() {
    let job = SmallJob::new();
    job.assert_rejected(&["--memory", "1MiB"], USAGE, &["--memory 1MiB", "at least", "--threads"]);
    job.assert_rejected(&["--device", "cuda"], USAGE, &["--device cuda", "--device cpu"]);
    job.assert_rejected(&["--bands", "3"], USAGE, &["--bands 3", "beyond the last of 3 bands"]);
    job.assert_rejected(&["--film-units", "photons", "--chart-units", "W m-2 sr-1 um-1"], USAGE, &["0.001"]);
    job.assert_rejected(&["--bands", "1:7"], USAGE, &["--bands 1:7", "3 bands"]);
    job.assert_rejected(&["--bands", "red"], USAGE, &["`red`", "band index"]);
    job.assert_rejected(&["--bands", "2:1"], USAGE, &["selects no band"]);
    job.assert_rejected(&["--roi", "90,80,20,20"], USAGE, &["--roi 90,80,20,20", "100x90"]);
    job.assert_rejected(&["--chunk", "100", "--shard", "256"], USAGE, &["--shard 256", "--chunk 100"]);
    job.assert_rejected(&["--wavelengths", "450:400:10"], USAGE, &["--wavelengths"]);
    for (chart, words) in [
        ("gen:composit?size=100", vec!["composit", "did you mean 'composite'"]),
        ("gen:composite?sise=100", vec!["sise", "did you mean 'size'"]),
        ("gen:composite?size=wide", vec!["size=wide", "WxH"]),
        ("gen:composite?size", vec!["key=value"]),
    ] {
        assert_error_line(&run(chart, &job.film, text(&job.pack), &[]), USAGE, &words);
        assert!(!job.film.exists());
    }
    // As of a variable of a script that is not set.
    for (words, what) in [
        (&["run", "", "f.zarr"][..], "chart"),
        (&["run", "c.zarr", "f.zarr", "--lens", ""], "lens"),
        (&["export", "", "p.png"], "film"),
        (&["measure", "", "--points", "9,9"], "film"),
    ] {
        assert_error_line(
            &lenscube(words),
            USAGE,
            &[&format!("the name of the {what} is empty; give its path")],
        );
    }
    assert_error_line(
        &lenscube(&["chart", "siemans", "c.zarr"]),
        USAGE,
        &["siemans", "did you mean 'siemens'"],
    );
    assert_error_line(
        &lenscube(&["chart", "siemens", "c.zarr", "--size", "wide"]),
        USAGE,
        &["--size", "wide"],
    );
    assert_error_line(
        &lenscube(&["lens", "show", "no-such-lens"]),
        USAGE,
        &["no-such-lens", "double-gauss-28"],
    );
    let bad_run = |words: &[&str], expected: &[&str]| {
        assert_usage_error(&[&["run", "c.zarr", "f.zarr"], words].concat(), expected)
    };
    bad_run(&["--memroy", "1GiB"], &["--memroy", "--memory"]);
    bad_run(&["--overwite"], &["--overwite", "--overwrite"]);
    bad_run(&["--roi", "1,2,3"], &["--roi", "X,Y,W,H"]);
    bad_run(&["--roi", "1,2,0,3"], &["--roi", "`0`"]);
    bad_run(&["--film-size", "12by13"], &["--film-size", "12by13"]);
    bad_run(&["--memory", "much"], &["--memory", "unit of bytes"]);
    bad_run(&["--azimuths", "6"], &["--azimuths", "multiple of 4"]);
    bad_run(&["--psf-window", "8"], &["--psf-window", "odd"]);
    bad_run(&["--threads", "0"], &["--threads", "1 to 1024"]);
    bad_run(&["--scale", "0"], &["--scale", "0"]);
    bad_run(&["--axis", "7"], &["--axis", "X,Y"]);
    bad_run(&["--axis", "1e300,0"], &["--axis", "1e7"]);
    bad_run(&["--center", "0,-1e8"], &["--center", "1e7"]);
    bad_run(&["--film-pitch-um", "1e300"], &["--film-pitch-um", "1e6"]);
    bad_run(&["--shard", "1000000000", "--chunk", "1000000000"], &["--shard", "16384"]);
    bad_run(&["--surround", "egde"], &["egde", "edge"]);
    bad_run(&["--stages", "ri,distorsion"], &["distorsion", "distortion"]);
    assert_usage_error(&["chart", "siemens", "c.zarr", "--spikes", "3"], &["--spikes", "--spokes"]);
    assert_usage_error(&["exprot", "f.zarr"], &["exprot"]);
}
