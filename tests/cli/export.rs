//! `lenscube export` and `lenscube chart image`: round trips of samples and pictures.

use crate::common::{Noise, Picture, bits, files, lenscube, pairs, pixels, text};
use formats::chart::image::{ImageFile, Transfer};
use formats::chart::{NanPolicy, RasterChart};
use formats::picture::image::Image;
use pipeline::geometry::Size;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Chart of noise in a temporary directory.
fn chart(bands: usize) -> (tempfile::TempDir, PathBuf, Picture) {
    let dir = tempfile::tempdir().unwrap();
    let (path, picture) = (dir.path().join("chart.zarr"), Picture::noise(3, Size::new(301, 277), bands));
    picture.write(&path);
    (dir, path, picture)
}

fn flat(path: &Path) -> (Size, Vec<Vec<f32>>) {
    let chart = RasterChart::open(path, NanPolicy::Keep).unwrap();
    let size = pipeline::flow::ChartSource::size(&chart);
    let band = |b| {
        let mut out = vec![0.0; size.pixels()];
        chart.read_rect(b, size.rect(), &mut out).unwrap();
        out
    };
    (size, (0..chart.bands()).map(band).collect())
}

#[test]
fn sample_formats_preserve_all_bits() {
    let (dir, path, picture) = chart(3);
    let at = |name: &str| dir.path().join(name);
    for name in ["c.npy", "c.hdr", "c.exr", "b.tif"] {
        let mut words = vec!["export", text(&path)];
        let out = at(name);
        words.push(text(&out));
        if name == "b.tif" {
            words.extend(["--format", "tiff-bands"]);
        }
        let ran = lenscube(&words).ok();
        assert!(ran.stderr.contains("3 bands of 277x301 px"), "{}", ran.stderr);
    }
    for name in ["c.npy", "c.hdr"] {
        assert!(bits(&flat(&at(name)).1) == bits(&picture.bands), "{name}");
    }
    // An exported EXR is a chart that can be exported again.
    lenscube(&["export", text(&at("c.exr")), text(&at("again.npy"))]).ok();
    assert!(bits(&flat(&at("again.npy")).1) == bits(&picture.bands), "EXR");
    let exported = lenscube(&[
        "export",
        text(&at("c.exr")),
        text(&at("part.npy")),
        "--crop",
        "10,20,60,50",
        "--bands",
        "1:",
    ])
    .ok();
    assert!(exported.stderr.contains("decoding its bands once"), "{}", exported.stderr);
    let (size, part) = flat(&at("part.npy"));
    assert_eq!((size, part.len()), (Size::new(50, 60), 2));
    let want: Vec<f32> = (20..70).flat_map(|y| picture.bands[1][y * 277 + 10..][..60].to_vec()).collect();
    assert_eq!(part[0], want);
    let stray: Vec<_> = files(dir.path()).into_keys().filter(|p| text(p).contains("tmp")).collect();
    assert!(stray.is_empty(), "{stray:?}");
}

#[test]
fn invalid_export_flags_fail_and_write_nothing() {
    let (dir, path, _) = chart(3);
    let at = |name: &str| dir.path().join(name);
    std::fs::write(at("there.png"), b"mine").unwrap();
    std::fs::write(at("there.bsq"), b"mine").unwrap();
    let before = files(dir.path());
    for (out, flags, code, words) in [
        ("there.png", &[][..], 3, "--overwrite"),
        ("there.hdr", &[], 3, "there.bsq already exists"),
        ("x.jpeg", &[], 2, "no format has this extension"),
        ("x.npy", &["--half"], 2, "--half applies to EXR only"),
        ("x.exr", &["--exposure", "2"], 2, "--exposure applies to PNG and TIFF pictures only"),
        ("x.npy", &["--white", "E"], 2, "--white applies to PNG and TIFF pictures only"),
        ("x.npy", &["--crop", "270,0,10,10"], 2, "is not inside the image of"),
        ("x.npy", &["--crop", "0,0,0,10"], 2, "integer from 1"),
        ("x.npy", &["--bands", "7"], 2, "beyond the last of 3 bands"),
        ("x.exr", &["--memory", "49MiB"], 2, "need at least"),
        ("nowhere/x.npy", &[], 1, "nowhere/x.npy"),
    ] {
        let out = at(out);
        let ran = lenscube(&[&["export", text(&path), text(&out)], flags].concat());
        assert_eq!(ran.code, code, "{flags:?}: {}", ran.stderr);
        assert!(ran.stderr.contains(words) && !ran.stderr.contains("panicked"), "{words}: {}", ran.stderr);
        assert!(files(dir.path()) == before, "{words}");
    }
    lenscube(&["export", text(&path), text(&at("there.png")), "--overwrite"]).ok();
    lenscube(&["export", text(&path), text(&at("there.hdr")), "--overwrite"]).ok();
}

#[test]
fn interrupted_export_leaves_no_files() {
    let dir = tempfile::tempdir().unwrap();
    for name in ["x.npy", "x.exr", "x.tif"] {
        let out = dir.path().join(name);
        let chart = "gen:composite?size=1500&wavelengths=400:700:10";
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        command.args(["export", chart, text(&out), "--exposure", "auto"]);
        let ran = command.env("LENSCUBE_FAULT", "export-reads:3:interrupt").output().unwrap();
        assert_eq!(ran.status.code(), Some(130), "{name}");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0, "{name}");
    }
}

/// Display values of a PNG or TIFF, 0 to 1, in bands.
fn shown(path: &Path) -> Vec<Vec<f32>> {
    let file = ImageFile::open(path).unwrap();
    let (size, bands) = (file.size(), if file.is_grey() { 1 } else { 3 });
    let source = file.linear(Transfer::Linear, path.parent().unwrap(), 1, &|_, _| ()).unwrap();
    let band = |b| {
        let mut out = vec![0.0; size.pixels()];
        source.read(b, size.rect(), &mut out).unwrap();
        out
    };
    (0..bands).map(band).collect()
}

/// The RGB cube in steps of 15, faces, edges and corners included, and noise.
fn cube() -> Image {
    let steps: Vec<u8> = (0..18).map(|i| i * 15).collect();
    let mut colours = Vec::new();
    for r in &steps {
        for g in &steps {
            colours.extend(steps.iter().map(|b| [*r, *g, *b]));
        }
    }
    let mut noise = Noise(8);
    colours.extend((0..1224).map(|_| [0; 3].map(|_: u8| (noise.next() * 256.0) as u8)));
    let mut image = Image::new(Size::new(colours.len() / 84, 84), [0; 3]);
    for (i, colour) in colours[..colours.len() / 84 * 84].iter().enumerate() {
        image.row_mut(i / 84)[i % 84] = *colour;
    }
    image
}

#[test]
fn chart_made_from_a_picture_exports_to_the_same_picture() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let image = cube();
    image.write_png(&at("cube.png"), "").unwrap();
    let want = shown(&at("cube.png"));
    let mut worst = 0f32;
    for (light, nm, scale) in [
        ("D65", "400:700:10", None),
        ("E", "400:700:10", Some("250")),
        ("A", "400:700:20", None),
        ("D65", "380:780:5", Some("1000")),
    ] {
        let (chart, back) = (at(&format!("{light}-{nm}.zarr")), at("back.png"));
        let mut words = vec!["chart", "image"];
        let input = at("cube.png");
        words.extend([
            text(&input),
            text(&chart),
            "--illuminant",
            light,
            "--wavelengths",
            nm,
            "--pitch-um",
            "2",
        ]);
        words.extend(scale.iter().flat_map(|s| ["--scale-to", s]));
        let ran = lenscube(&words).ok();
        let exposure = ran.stderr.split("--exposure ").nth(1).unwrap().split_whitespace().next().unwrap();
        let show =
            ["export", text(&chart), text(&back), "--white", light, "--exposure", exposure, "--overwrite"];
        lenscube(&show).ok();
        for (got, want) in pairs(&shown(&back), &want) {
            worst = worst.max((got - want).abs() * 255.0);
        }
        assert!(worst <= 1.0001, "{light}, {nm}: off by {worst} of 255");
        // All values are nonnegative.
        let (_, bands) = pixels(&chart, "chart");
        assert!(bands.iter().flatten().all(|v| *v >= 0.0));
    }
    // 16-bit samples have a smaller error.
    let (chart, fine) = (at("D65-400:700:10.zarr"), at("fine.tif"));
    lenscube(&["export", text(&chart), text(&fine), "--exposure", "1"]).ok();
    for (got, want) in pairs(&shown(&fine), &want) {
        assert!((got - want).abs() < 0.2 / 255.0, "{got} {want}");
    }
    // The 16-bit picture can be converted to a chart.
    lenscube(&["chart", "image", text(&fine), text(&at("fine.zarr"))]).ok();
}

#[test]
fn invalid_pictures_and_flags_are_rejected() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    cube().write_png(&at("cube.png"), "").unwrap();
    std::fs::write(at("text.png"), "no picture").unwrap();
    std::fs::create_dir(at("there.zarr")).unwrap();
    for (file, out, flags, code, words) in [
        ("cube.png", "x.zarr", &["--wavelengths", "450,550,650"][..], 2, "cannot represent all sRGB colours"),
        ("cube.png", "x.zarr", &["--illuminant", "F2"], 2, "use D65, A or E"),
        ("cube.png", "x.zarr", &["--scale-to", "0"], 2, "not greater than 0"),
        ("cube.png", "there.zarr", &[], 3, "--overwrite"),
        ("text.png", "x.zarr", &[], 1, "TIFF or OpenEXR"),
        ("none.png", "x.zarr", &[], 1, "no such file"),
    ] {
        let (file, out) = (at(file), at(out));
        let ran = lenscube(&[&["chart", "image", text(&file), text(&out)], flags].concat());
        assert_eq!(ran.code, code, "{words}: {}", ran.stderr);
        assert!(ran.stderr.contains(words) && !ran.stderr.contains("panicked"), "{words}: {}", ran.stderr);
    }
    assert!(!at("x.zarr").exists());
    // Generated charts without `image`.
    let drawn = at("drawn.zarr");
    lenscube(&["chart", "uniform", text(&drawn), "--size", "40", "--value", "-1", "--wavelengths", "500"])
        .ok();
    assert_eq!(lenscube(&["chart"]).code, 2);
    assert!(lenscube(&["chart", "unifrom", text(&drawn)]).stderr.contains("uniform"));
}

/// Films in photons or W/m² have exposures far from 1: the printed flag makes the same picture.
#[test]
fn printed_exposure_makes_the_same_picture() {
    let (dir, path, _) = chart(3);
    let at = |name: &str| dir.path().join(name);
    let scaled = at("scaled.npy");
    lenscube(&["export", text(&path), text(&scaled)]).ok();
    let mut bytes = std::fs::read(&scaled).unwrap();
    // The samples follow the header, whose length is in its bytes 8 and 9.
    let first = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    for v in bytes[first..].as_chunks_mut::<4>().0 {
        *v = (f32::from_le_bytes(*v) * 1e16).to_le_bytes();
    }
    std::fs::write(&scaled, bytes).unwrap();
    let export = |name: &str, flags: &[&str]| {
        let out = at(name);
        let words =
            ["export", text(&scaled), text(&out), "--wavelengths", "450,550,650", "--axes", "wavelength,y,x"];
        lenscube(&[&words[..], flags].concat()).ok().stderr
    };
    let told = export("auto.png", &[]);
    let exposure = told.split("--exposure ").nth(1).and_then(|t| t.split('`').next()).unwrap();
    assert!(exposure.ends_with("e-16") || exposure.ends_with("e-17"), "{told}");
    export("given.png", &["--exposure", exposure]);
    // The comments differ, in the digits of the exposure.
    let pixels = |name: &str| {
        let png = std::fs::read(at(name)).unwrap();
        let data = png.windows(4).position(|w| w == b"IDAT").unwrap();
        png[data..].to_vec()
    };
    assert!(pixels("auto.png") == pixels("given.png"));
}

#[test]
fn dash_writes_the_bytes_of_the_file_to_standard_output() {
    let (dir, path, _) = chart(2);
    for (name, flags) in [
        ("c.npy", &["--format", "npy"][..]),
        ("c.png", &[]),
        ("b.tif", &["--format", "tiff-bands", "--bands", "500"]),
        ("b.npy", &["--format", "npy", "--band", "500"]),
    ] {
        let file = dir.path().join(name);
        lenscube(&[&["export", text(&path), text(&file)], flags].concat()).ok();
        let words = [&["export", text(&path), "-", "-q"], flags].concat();
        let output = Command::new(env!("CARGO_BIN_EXE_lenscube")).args(&words).output().unwrap();
        assert!(
            output.status.success() && output.stderr.is_empty(),
            "{}",
            String::from_utf8_lossy(&output.stderr)
        );
        assert!(output.stdout == std::fs::read(&file).unwrap(), "{name}");
    }
    // The temporary directory of a killed export is removed by the next one.
    let temp = tempfile::tempdir().unwrap();
    let export = |fault: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        command
            .args(["export", text(&path), "-", "-q"])
            .env("TMPDIR", temp.path())
            .env("LENSCUBE_FAULT", fault);
        (command.output().unwrap().status.success(), std::fs::read_dir(temp.path()).unwrap().count())
    };
    assert_eq!(export("sync:1:kill"), (false, 1));
    assert_eq!(export(""), (true, 0));
    let ran = lenscube(&["export", text(&path), "-", "--format", "envi"]);
    assert_eq!((ran.code, ran.stdout.as_str()), (2, ""), "{}", ran.stderr);
    let (size, bands) = flat(&dir.path().join("b.npy"));
    assert_eq!((size.pixels(), bands.len()), (301 * 277, 1));
}

#[test]
fn openexr_exports_of_one_film_are_the_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let film = dir.path().join("f.zarr");
    lenscube(&[
        "chart",
        "checker",
        text(&film),
        "--film-size",
        "40",
        "--film-pitch-um",
        "2",
        "--wavelengths",
        "500,550",
    ])
    .ok();
    let export = |k: usize| {
        let out = dir.path().join(format!("{k}.exr"));
        lenscube(&["export", text(&film), text(&out)]).ok();
        std::fs::read(out).unwrap()
    };
    let first = export(0);
    // Four attributes in random order are equal once in 24 times.
    assert!((1..5).all(|k| export(k) == first));
}

#[test]
fn figures_of_other_endings_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let film = dir.path().join("f.zarr");
    lenscube(&[
        "chart",
        "slanted-edge",
        text(&film),
        "--film-size",
        "100",
        "--film-pitch-um",
        "2",
        "--wavelengths",
        "550",
    ])
    .ok();
    for name in ["x.pdf", "x.npy", "x"] {
        let plot = dir.path().join(name);
        let words = ["measure", text(&film), "--profile", "10,10,90,90", "--plot", text(&plot)];
        crate::common::assert_exit(&lenscube(&words), 2, &[".png or .svg"]);
        let depth = [
            "depth",
            "gen:depth-scene?size=60",
            "--lens",
            "phone",
            "--film-pitch-um",
            "2",
            "--plot",
            text(&plot),
        ];
        crate::common::assert_exit(&lenscube(&depth), 2, &[".png or .svg"]);
        assert!(!plot.exists());
    }
    let plot = dir.path().join("x.pdf");
    for words in [["lens", "show", "phone"], ["sensor", "show", "example-2um"], ["lens", "list", "-q"]] {
        let refused = lenscube(&[&words[..], &["--plot", text(&plot)]].concat());
        crate::common::assert_exit(&refused, 2, &["expected a directory"]);
        assert!(!plot.exists());
    }
    let plot = dir.path().join("x.SVG");
    lenscube(&["measure", text(&film), "--profile", "10,10,90,90", "--plot", text(&plot)]).ok();
    assert!(plot.exists());
}
