//! Files of distances: formats, interpolated edges, 16-bit floats.

use crate::common::{
    CommandResult, Picture, assert_exit, bits, exr, lenscube, pixels, run, text, write_npy, write_pack,
};
use pipeline::geometry::Size;
use std::path::{Path, PathBuf};

/// Rows and columns of the charts.
const SIDE: usize = 96;
const CHART: &str = "gen:checker?size=96&overscan=0&wavelengths=500";

struct Inputs {
    dir: tempfile::TempDir,
}

impl Inputs {
    fn new() -> Self {
        Self { dir: tempfile::tempdir().unwrap() }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// Writes raw samples.
    fn raw(&self, name: &str, values: impl Iterator<Item = Vec<u8>>) -> PathBuf {
        let path = self.path(name);
        std::fs::write(&path, values.flatten().collect::<Vec<u8>>()).unwrap();
        path
    }

    fn try_run(&self, film: &str, depth: &str, flags: &[&str]) -> CommandResult {
        let pack = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/depth/packs/six-slabs.lens.zip");
        let always = ["--outside", "clamp", "--depth", depth];
        run(CHART, &self.path(film), text(&pack), &[&always, flags].concat())
    }

    fn film(&self, name: &str, depth: &str, flags: &[&str]) -> Vec<Vec<u32>> {
        self.try_run(name, depth, flags).ok();
        bits(&pixels(&self.path(name), "film").1)
    }
}

/// A near square before a far wall.
fn square(row: usize, column: usize) -> f32 {
    if (30..70).contains(&row) && (20..60).contains(&column) { 0.55 } else { 4.0 }
}

/// Values of all pixels.
fn values(at: impl Fn(usize, usize) -> f32) -> Vec<f32> {
    (0..SIDE * SIDE).map(|i| at(i / SIDE, i % SIDE)).collect()
}

#[test]
fn raw_tiff_and_openexr_files_are_the_same_distances() {
    let inputs = Inputs::new();
    let f32s = inputs.raw("depth.raw", values(square).iter().map(|v| v.to_le_bytes().to_vec()));
    let expected = inputs.film("raw", text(&f32s), &["--depth-dtype", "f32"]);
    let big = inputs.raw("big.raw", values(square).iter().map(|v| f64::from(*v).to_be_bytes().to_vec()));
    assert!(expected == inputs.film("big", text(&big), &["--depth-dtype", ">f64"]), "big-endian doubles");
    let mm = inputs
        .raw("mm.raw", values(square).iter().map(|v| ((v * 1e3).round() as u16).to_le_bytes().to_vec()));
    let found = inputs.film("mm", text(&mm), &["--depth-dtype", "u16", "--depth-unit", "mm"]);
    // 0.55 is no number of 32 bits.
    let close = |(a, b): (&u32, &u32)| {
        let (a, b) = (f32::from_bits(*a), f32::from_bits(*b));
        (a - b).abs() <= 1e-5 * b.abs()
    };
    assert!(std::iter::zip(&found[0], &expected[0]).all(close), "millimetres");
    // The same values through the program's own exports.
    let npy = inputs.path("depth.npy");
    write_npy(&npy, Size::new(SIDE, SIDE), &values(square));
    for (name, format) in [("depth.exr", "exr"), ("depth.tif", "tiff-bands")] {
        let out = inputs.path(name);
        lenscube(&["export", text(&npy), text(&out), "--wavelengths", "550", "--format", format]).ok();
    }
    let exr = format!("{}//S0.550,000000nm", text(&inputs.path("depth.exr")));
    assert!(inputs.film("exr", &exr, &[]) == expected, "OpenEXR");
    assert!(inputs.film("tif", text(&inputs.path("depth.tif")), &[]) == expected, "TIFF");
    let missing = inputs.try_run("none", text(&inputs.path("depth.exr")), &[]);
    assert_exit(&missing, 1, &["depth.exr", "Z or depth.Z", "S0.550,000000nm"]);
    assert_exit(&inputs.try_run("none", text(&f32s), &["--depth-dtype", "f64"]), 1, &["depth.raw", "bytes"]);
}

#[test]
fn interpolated_edges_are_reported_or_snapped_to_the_nearer_surface() {
    let inputs = Inputs::new();
    let raw = |name: &str, at: &dyn Fn(usize, usize) -> f32| {
        inputs.raw(name, values(at).iter().map(|v| v.to_le_bytes().to_vec()))
    };
    let f32s = ["--depth-dtype", "f32"];
    // Columns 19 and 60, beside the square, are half-way.
    let blurred = |row: usize, column: usize| match (30..70).contains(&row) && [19, 60].contains(&column) {
        true => 1.0,
        false => square(row, column),
    };
    let wide = |row: usize, column: usize| match (30..70).contains(&row) && [19, 60].contains(&column) {
        true => 0.55,
        false => square(row, column),
    };
    let (blurred, wide) = (raw("blurred.raw", &blurred), raw("wide.raw", &wide));
    let noted = inputs.try_run("noted", text(&blurred), &f32s);
    assert_exit(&noted, 0, &["80 of ", "e.g. row 30, column 19", "anti-aliased", "--depth-edges snap"]);
    let clean = inputs.try_run("clean", text(&wide), &f32s);
    assert!(clean.code == 0 && !clean.stderr.contains("anti-aliased"), "{}", clean.stderr);
    let snapped = inputs.film("snapped", text(&blurred), &[&f32s[..], &["--depth-edges", "snap"]].concat());
    assert!(snapped == inputs.film("clean", text(&wide), &f32s));
    let resumed = inputs.try_run("snapped", text(&blurred), &f32s);
    assert_exit(&resumed, 3, &["belongs to another job"]);
}

#[test]
fn largest_f16_is_infinity() {
    let inputs = Inputs::new();
    // 65504 and infinity, 4 m elsewhere.
    let raw = |name: &str, far: u16| {
        inputs.raw(
            name,
            values(square)
                .into_iter()
                .map(move |v| if v < 1.0 { far } else { 0x4400 }.to_le_bytes().to_vec()),
        )
    };
    let f16 = ["--depth-dtype", "f16"];
    let largest = inputs.film("largest", text(&raw("largest.raw", 0x7bff)), &f16);
    let again = inputs.try_run("again", text(&raw("again.raw", 0x7bff)), &f16);
    assert_exit(
        &again,
        0,
        &["1600 pixels, e.g. row 30, column 20, are at infinity", "65504 in 16-bit floats"],
    );
    let infinite = inputs.film("infinite", text(&raw("infinite.raw", 0x7c00)), &f16);
    assert!(largest == infinite);
}

#[test]
fn steps_of_16_bit_floats_are_reported_where_they_are_visible() {
    let inputs = Inputs::new();
    // In focus at 0.5 m; the blur radius grows by 1250 px of 0.5 µm per dioptre.
    let band = crate::common::identity_band(500.0, 1.0, 3);
    let lens =
        pipeline::lens::Lens { object_distance_mm: Some(500.0), ..crate::common::lens(vec![band.clone()]) };
    let pack = inputs.path("near.lens.zarr");
    write_pack(&pack, &lens, vec![crate::common::delta(&band)]);
    let raw = inputs.raw("half.raw", (0..SIDE * SIDE).map(|_| 0x3800u16.to_le_bytes().to_vec()));
    let film = |name: &str, pitch: &str| {
        let flags = ["--depth", text(&raw), "--depth-dtype", "f16", "--film-pitch-um", pitch];
        run(CHART, &inputs.path(name), text(&pack), &flags)
    };
    assert_exit(
        &film("fine", "0.5"),
        0,
        &["16-bit floats, whose rounding changes the blur", "up to 1.22 px"],
    );
    let coarse = film("coarse", "5");
    assert!(coarse.code == 0 && !coarse.stderr.contains("16-bit"), "{}", coarse.stderr);
}

#[test]
fn an_hdf5_array_is_the_same_distances() {
    let inputs = Inputs::new();
    let npy = inputs.path("depth.npy");
    write_npy(&npy, Size::new(SIDE, SIDE), &values(square));
    let hdf5 = Path::new(env!("CARGO_MANIFEST_DIR")).join("formats/tests/data/hdf5/depth.h5");
    let found = inputs.film("hdf5", &format!("{}//scene/depth", text(&hdf5)), &[]);
    assert!(found == inputs.film("npy", text(&npy), &[]));
    let missing = inputs.try_run("none", &format!("{}//depth", text(&hdf5)), &[]);
    assert_exit(&missing, 1, &["depth.h5", "scene/depth"]);
}

#[test]
fn arrays_and_attributes_of_an_hdf5_group_are_those_of_a_surface() {
    let inputs = Inputs::new();
    let mm: Vec<f32> = values(square).iter().map(|v| v * 1e3).collect();
    let write = |name: &str, coverage: Option<f32>| {
        let path = inputs.path(name);
        let mut file = hdf5_pure::FileBuilder::new();
        let mut group = file.create_group("scene");
        let side = SIDE as u64;
        let chart = values(|row, column| if (row / 8 + column / 8) % 2 == 0 { 1.0 } else { 0.25 });
        group.create_dataset("chart").with_f32_data(&chart).with_shape(&[1, side, side]);
        let unit = hdf5_pure::AttrValue::String("nm".into());
        group.create_dataset("wavelength").with_f64_data(&[500.0]).with_shape(&[1]).set_attr("units", unit);
        let unit = hdf5_pure::AttrValue::String("mm".into());
        group
            .create_dataset("depth")
            .with_f32_data(&mm)
            .with_shape(&[side, side])
            .with_chunks(&[32, 32])
            .set_attr("units", unit);
        if let Some(opaque) = coverage {
            let values = values(|row, _| if row < 48 { opaque } else { 1.0 });
            group
                .create_dataset("coverage")
                .with_f32_data(&values)
                .with_shape(&[side, side])
                .with_chunks(&[32, 32]);
        }
        file.add_group(group.finish());
        file.write(&path).unwrap();
        path
    };
    let pack = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/depth/packs/six-slabs.lens.zip");
    let film = |name: &str, file: &Path, flags: &[&str]| {
        let chart = format!("{}//scene/chart", text(file));
        let flags = [&["--outside", "clamp", "--film-pitch-um", "2"], flags].concat();
        run(&chart, &inputs.path(name), text(&pack), &flags).ok();
        bits(&pixels(&inputs.path(name), "film").1)
    };
    let npy = inputs.path("depth.npy");
    write_npy(&npy, Size::new(SIDE, SIDE), &mm);
    let (opaque, half) = (write("opaque.h5", None), write("half.h5", Some(0.5)));
    let expected = film("npy", &opaque, &["--depth", text(&npy), "--depth-unit", "mm"]);
    let depth = format!("{}//scene/depth", text(&opaque));
    assert!(film("given", &opaque, &["--depth", &depth]) == expected, "unit of --depth");
    assert!(film("found", &opaque, &[]) == expected, "depth beside the chart");
    let covered = film("half", &half, &[]);
    assert!(covered != expected, "coverage beside the chart");
    let depth = format!("{}//scene/depth", text(&half));
    assert!(film("half-given", &opaque, &["--depth", &depth]) == covered, "coverage beside --depth");
}

#[test]
fn deep_openexr_files_are_refused_by_name() {
    let inputs = Inputs::new();
    let deep = inputs.path("deep.exr");
    exr::write_deep(&deep, Size::new(SIDE, SIDE));
    let result = inputs.try_run("film", text(&deep), &[]);
    assert_exit(&result, 1, &["deep.exr", "deep data", "flatten it"]);
}

#[test]
fn a_hidden_surface_in_an_openexr_file_is_that_of_a_store() {
    let inputs = Inputs::new();
    let (size, far) = (Size::new(SIDE, SIDE), vec![4.0; SIDE * SIDE]);
    let ramp = values(|row, column| (row + 2 * column) as f32 / 300.0);
    let depth = inputs.path("depth.npy");
    write_npy(&depth, size, &values(square));
    let file = inputs.path("behind.exr");
    exr::write(&file, size, &[("S0.500,000000nm", &ramp), ("Z", &far)]);
    let store = inputs.path("behind.zarr");
    write_scene(&store, size, ramp, far);
    let film = |name: &str, hidden: &Path| {
        inputs.film(name, text(&depth), &["--hidden", text(hidden), "--wavelengths", "500"])
    };
    let found = film("exr", &file);
    assert!(found == film("zarr", &store));
    assert!(found != inputs.film("invented", text(&depth), &[]));
    // The store has a band at 450 nm, the job's chart one at 500 nm.
    let result = inputs.try_run("other", text(&depth), &["--hidden", text(&store)]);
    assert_exit(&result, 2, &["bands at 450 nm, expected", "500 nm", "--wavelengths"]);
}

/// A store of a chart with one band at 450 nm, and its distances.
fn write_scene(store: &Path, size: Size, light: Vec<f32>, distances: Vec<f32>) {
    Picture { size, bands: vec![light] }.write(store);
    let other = store.with_extension("depth");
    Picture { size, bands: vec![distances] }.write(&other);
    for (path, bytes) in crate::common::files(&other.join("chart")) {
        let to = store.join("depth").join(path);
        std::fs::create_dir_all(to.parent().unwrap()).unwrap();
        std::fs::write(to, bytes).unwrap();
    }
}

#[test]
fn the_scale_of_the_chart_holds_for_hidden_surfaces_and_their_missing_chunks_are_told() {
    let inputs = Inputs::new();
    let size = Size::new(SIDE, SIDE);
    let pack = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/depth/packs/six-slabs.lens.zip");
    let film = |name: &str, gain: f32, flags: &[&str]| {
        let (chart, behind) =
            (inputs.path(&format!("{name}.zarr")), inputs.path(&format!("{name}-behind.zarr")));
        write_scene(&chart, size, values(|_, column| gain * column as f32), values(square));
        write_scene(&behind, size, values(|row, _| gain * row as f32), vec![4.0; SIDE * SIDE]);
        if name == "missing" {
            std::fs::remove_dir_all(behind.join("chart/c")).unwrap();
        }
        let always = ["--outside", "clamp", "--wavelengths", "500", "--hidden", text(&behind)];
        let result = run(text(&chart), &inputs.path(name), text(&pack), &[&always, flags].concat());
        assert_exit(&result, 0, &[]);
        (bits(&pixels(&inputs.path(name), "film").1), result.stderr)
    };
    let plain = film("plain", 1.0, &[]);
    assert!(plain.0 == film("scaled", 4.0, &["--chart-scale", "0.25"]).0);
    let missing = film("missing", 1.0, &["--nan", "zero"]);
    assert!(!plain.1.contains("missing") && missing.0 != plain.0);
    assert!(
        missing.1.contains("chunks are missing from distances, coverages or charts of hidden"),
        "{}",
        missing.1
    );
}

#[test]
fn premultiplied_colours_without_coverage_are_an_error() {
    let inputs = Inputs::new();
    let size = Size::new(SIDE, SIDE);
    let (light, depth) = (vec![0.5; SIDE * SIDE], inputs.path("depth.npy"));
    write_npy(&depth, size, &values(square));
    let film = |name: &str, alpha: &[f32], flags: &[&str]| {
        let chart = inputs.path(&format!("{name}.exr"));
        exr::write(&chart, size, &[("A", alpha), ("S0.500,000000nm", &light)]);
        let pack = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/depth/packs/six-slabs.lens.zip");
        let always = ["--outside", "clamp", "--film-pitch-um", "2"];
        run(text(&chart), &inputs.path(name), text(&pack), &[&always, flags].concat())
    };
    let array = ["--depth", text(&depth)];
    film("opaque", &vec![1.0; SIDE * SIDE], &array).ok();
    let holes = values(|row, column| if (row, column) == (5, 7) { 0.25 } else { 1.0 });
    let result = film("holes", &holes, &array);
    assert_exit(&result, 2, &["alpha at row 5, column 7 is 0.25", "premultiplied", "depth and coverage"]);
    assert_exit(&film("number", &holes, &["--depth", "0.7"]), 2, &["premultiplied"]);
}

#[test]
fn a_gpus_engine_is_refused_for_distances_by_run_and_plan() {
    let inputs = Inputs::new();
    let depth = inputs.raw("depth.raw", values(square).iter().map(|v| v.to_le_bytes().to_vec()));
    let pack = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/depth/packs/six-slabs.lens.zip");
    let flags =
        ["--lens", text(&pack), "--outside", "clamp", "--depth", text(&depth), "--depth-dtype", "f32"];
    let expected =
        ["a film of surfaces at several distances is computed on the CPU, not with --engine cuda-sm_90"];
    for (command, more) in [("run", vec![]), ("plan", vec!["--output", "plan.json"])] {
        let output = inputs.path("plan.json");
        let more: Vec<&str> =
            more.into_iter().map(|word| if word == "plan.json" { text(&output) } else { word }).collect();
        let film = inputs.path("refused.zarr");
        let line =
            [&[command, CHART, text(&film)][..], &flags[..], &more, &["--engine", "cuda-sm_90"]].concat();
        assert_exit(&lenscube(&line), 2, &expected);
        assert!(!film.exists() && !output.exists(), "{command}");
    }
}
