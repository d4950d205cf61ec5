//! Options of `lenscube develop`, its threads and crops, and what it refuses.

use super::{CHECKER, OTHER_JOB, USAGE, linear};
use crate::common::camera::{LENS, Place, develop};
use crate::common::{assert_exit, text};
use formats::chart::image::{ImageFile, Transfer};
use pipeline::geometry::Size;
use std::path::{Path, PathBuf};

#[test]
fn threads_memory_and_crops_give_the_same_pixels() {
    let place = Place::new();
    let raw = place.raw("raw.zarr", &place.run(CHECKER), &["--sensor", "example-2um", "--exposure", "auto"]);
    for format in ["png", "tif", "exr"] {
        let (one, other) = (place.at(&format!("one.{format}")), place.at(&format!("other.{format}")));
        develop(&raw, &one, &["--threads", "1"]).ok();
        develop(&raw, &other, &["--threads", "3", "--memory", "128MiB"]).ok();
        assert!(std::fs::read(&one).unwrap() == std::fs::read(&other).unwrap(), "{format}");
        let crop = place.at(&format!("crop.{format}"));
        develop(&raw, &crop, &["--crop", "31,17,200,101"]).ok();
        let ((size, all), (_, part)) = (linear(&one, Transfer::Linear), linear(&crop, Transfer::Linear));
        for c in 0..3 {
            for (k, v) in part[c].iter().enumerate() {
                assert_eq!(*v, all[c][(17 + k / 200) * size.width + 31 + k % 200], "{format} {c} {k}");
            }
        }
    }
    // A window of the sensor is that part of the whole, but for its border.
    let window = place.raw(
        "window.zarr",
        &place.at("film.zarr"),
        &["--sensor", "example-2um", "--exposure", "3ms", "--roi", "31,17,60,50"],
    );
    let whole =
        place.raw("whole.zarr", &place.at("film.zarr"), &["--sensor", "example-2um", "--exposure", "3ms"]);
    let (a, b) = (place.at("a.exr"), place.at("b.exr"));
    develop(&window, &a, &[]).ok();
    develop(&whole, &b, &["--crop", "31,17,60,50"]).ok();
    let ((_, a), (_, b)) = (linear(&a, Transfer::Linear), linear(&b, Transfer::Linear));
    let inner = |k: usize| (2..48).contains(&(k / 60)) && (2..58).contains(&(k % 60));
    assert!((0..3).all(|c| (0..3000).filter(|k| inner(*k)).all(|k| a[c][k] == b[c][k])));
}

#[test]
fn options_change_what_they_say() {
    let place = Place::new();
    let film = place.run(CHECKER);
    let raw = place.raw(
        "raw.zarr",
        &film,
        &["--sensor", "example-2um", "--exposure", "auto:0.4", "--noise", "none"],
    );
    let at = |name: &str, flags: &[&str]| {
        let out = place.at(name);
        develop(&raw, &out, flags).ok();
        linear(&out, Transfer::Linear)
    };
    let (size, plain) = at("plain.exr", &[]);
    assert_eq!(size, Size::new(300, 450));
    let (_, brighter) = at("brighter.exr", &["--exposure", "1"]);
    let near = |a: f32, b: f32| (a - b).abs() <= 1e-6 * b.abs().max(1.0);
    assert!(std::iter::zip(&brighter[0], &plain[0]).all(|(a, b)| near(*a, 2.0 * b)));
    let (small, _) = at("superpixel.exr", &["--demosaic", "superpixel"]);
    assert_eq!(small, Size::new(150, 225));
    let (_, warm) = at("warm.exr", &["--white", "1,2,1", "--matrix", "none"]);
    let (_, cool) = at("cool.exr", &["--white", "1,1,1", "--matrix", "none"]);
    let mean = |v: &[f32]| v.iter().map(|v| f64::from(*v)).sum::<f64>() / v.len() as f64;
    assert!((mean(&warm[1]) / mean(&cool[1]) - 2.0).abs() < 0.05);
    let matrix = place.at("matrix.txt");
    std::fs::write(&matrix, "# rows\n0 1 0\n0, 1, 0\n0;1;0\n").unwrap();
    let (_, grey) = at("grey.exr", &["--matrix", text(&matrix)]);
    assert!(grey[0] == grey[1] && grey[1] == grey[2]);
    let (_, auto) = at("auto.exr", &["--white", "auto", "--matrix", "none", "--demosaic", "superpixel"]);
    let means: Vec<f64> = auto.iter().map(|v| mean(v)).collect();
    assert!(means.iter().all(|m| (m / means[0] - 1.0).abs() < 0.02), "{means:?}");
    // A flat divides itself to an even picture.
    let flat_film = place.at("flat.film");
    crate::common::run(
        "gen:uniform?size=450x300&pitch_um=2&wavelengths=450,550,650",
        &flat_film,
        LENS,
        &["--stages", "ri"],
    )
    .ok();
    let flat = place.raw(
        "flat.zarr",
        &flat_film,
        &["--sensor", "example-2um", "--exposure", "auto:0.5", "--noise", "none"],
    );
    develop(&flat, &place.at("even.exr"), &["--shading", text(&flat)]).ok();
    let (_, even) = linear(&place.at("even.exr"), Transfer::Linear);
    assert!(even[1].iter().all(|v| (v / even[1][0] - 1.0).abs() < 1e-3));
    // Quad to Bayer, and monochrome to grey.
    let quad = [
        "--sensor",
        "example-2um",
        "--exposure",
        "auto",
        "--set",
        r#"cfa.pattern=[["R","R","G","G"],["R","R","G","G"],["G","G","B","B"],["G","G","B","B"]]"#,
    ];
    let quad = place.raw("quad.zarr", &film, &quad);
    let binned = develop(&quad, &place.at("quad.exr"), &["--bin", "2"]).ok();
    assert!(binned.stderr.contains("demosaic malvar, bin 2"), "{}", binned.stderr);
    assert_eq!(linear(&place.at("quad.exr"), Transfer::Linear).0, Size::new(150, 225));
    let mono = place.raw("mono.zarr", &film, &["--sensor", "ideal-mono", "--exposure", "auto"]);
    develop(&mono, &place.at("mono.png"), &[]).ok();
    assert!(ImageFile::open(&place.at("mono.png")).unwrap().is_grey());
}

#[test]
fn developments_that_are_not_possible_are_one_clear_error() {
    let place = Place::new();
    let film = place.run("checker?size=90x60&pitch_um=2");
    let raw = place.raw(
        "raw.zarr",
        &film,
        &["--sensor", "example-2um", "--exposure", "1ms,2ms", "--roi", "0,0,20,20", "--roi", "4,4,20,20"],
    );
    let (array, out) = (PathBuf::from(format!("{}//roi_1", text(&raw))), place.at("out.png"));
    let bad = |raw: &Path, out: &str, flags: &[&str], words: &[&str]| {
        let out = place.at(out);
        assert_exit(&develop(raw, &out, flags), USAGE, words);
        assert!(!out.exists());
    };
    bad(&raw, "out.png", &[], &["roi_0, roi_1", "name one"]);
    bad(&array, "out.jpg", &[], &["expected a picture"]);
    bad(&array, "out.png", &["--frame", "2"], &["2 frames"]);
    bad(&array, "out.png", &["--crop", "10,10,20,20"], &["not inside"]);
    bad(&array, "out.png", &["--white", "D50"], &["D65, A, E, auto"]);
    bad(&array, "out.png", &["--white", "1,2"], &["3 gains"]);
    bad(&array, "out.png", &["--bin", "2"], &["one filter"]);
    bad(&array, "out.png", &["--memory", "10MiB"], &["--memory"]);
    bad(&array, "out.exr", &["--depth", "16"], &["--depth"]);
    bad(&array, "out.exr", &["--tone", "srgb"], &["linear"]);
    bad(&array, "out.png", &["--exposure", "99"], &["20 EV"]);
    bad(&film, "out.png", &[], &["expected a raw of this program"]);
    std::fs::write(place.at("matrix"), "1 0 0\n0 x 0\n0 0 1\n").unwrap();
    bad(&array, "out.png", &["--matrix", text(&place.at("matrix"))], &["line 2", "3 numbers"]);
    bad(&array, "out.png", &["--matrix", "/dev/zero"], &["/dev/zero", "more than 65536 bytes"]);
    let quad = [
        "--sensor",
        "example-2um",
        "--exposure",
        "1ms",
        "--set",
        r#"cfa.pattern=[["R","R","G","G"],["R","R","G","G"],["G","G","B","B"],["G","G","B","B"]]"#,
    ];
    let quad = place.raw("quad.zarr", &film, &quad);
    bad(&quad, "out.png", &["--demosaic", "malvar"], &["bilinear"]);
    develop(&array, &out, &["--frame", "1"]).ok();
    assert_exit(&develop(&array, &out, &[]), OTHER_JOB, &["--overwrite"]);
    std::fs::remove_file(raw.join("roi_1/c/1/0/0")).unwrap();
    assert_exit(
        &develop(&array, &place.at("new.png"), &["--frame", "1"]),
        1,
        &["1 of 1 shards", "lenscube sensor"],
    );
}
