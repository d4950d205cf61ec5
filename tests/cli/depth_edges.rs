//! Edges of surfaces: pixels that are not covered or covered in part, and what is invented behind edges.

use crate::common::{
    CommandResult, Noise, Picture, assert_exit, bits, exr, files, lenscube, pixels, run, text, write_npy,
};
use pipeline::geometry::Size;
use std::path::{Path, PathBuf};

const SIDE: usize = 96;
const SIZE: Size = Size::new(SIDE, SIDE);

fn pack() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/depth/packs/six-slabs.lens.zip")
}

/// Values of all pixels of a square of `side` px.
fn values(side: usize, mut at: impl FnMut(usize, usize) -> f32) -> Vec<f32> {
    (0..side * side).map(|i| at(i / side, i % side)).collect()
}

/// Share of a pixel that a disc of radius 25 px covers, about.
fn disc(row: usize, column: usize) -> f32 {
    (25.5 - (row as f32 - 47.0).hypot(column as f32 - 49.0)).clamp(0.0, 1.0)
}

/// A file with a group of the arrays chart (one band), depth in m and coverage; the array chart in it.
fn write_group(file: &Path, light: &[f32], depth: &[f32], coverage: &[f32]) -> PathBuf {
    let mut writer = hdf5_pure::FileBuilder::new();
    let mut group = writer.create_group("scene");
    let side = SIDE as u64;
    let unit = || hdf5_pure::AttrValue::String("nm".into());
    group.create_dataset("wavelength").with_f64_data(&[500.0]).with_shape(&[1]).set_attr("units", unit());
    group.create_dataset("chart").with_f32_data(light).with_shape(&[1, side, side]);
    for (name, values) in [("depth", depth), ("coverage", coverage)] {
        let array = group.create_dataset(name).with_f32_data(values);
        array.with_shape(&[side, side]).with_chunks(&[32, 32]);
    }
    writer.add_group(group.finish());
    writer.write(file).unwrap();
    PathBuf::from(format!("{}//scene/chart", text(file)))
}

/// A store of a chart at 2 m.
fn write_wall(wall: &Path, light: Vec<f32>) {
    Picture { size: SIZE, bands: vec![light] }.write(wall);
    let other = wall.with_extension("depth");
    Picture { size: SIZE, bands: vec![vec![2.0; SIZE.pixels()]] }.write(&other);
    for (path, bytes) in files(&other.join("chart")) {
        let to = wall.join("depth").join(path);
        std::fs::create_dir_all(to.parent().unwrap()).unwrap();
        std::fs::write(to, bytes).unwrap();
    }
}

/// A noisy disc at 0.55 m, whose rim is covered in part, before a noisy wall at 2 m that is complete.
struct Scene {
    dir: tempfile::TempDir,
    wall: PathBuf,
    light: Vec<f32>,
}

impl Scene {
    fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        let wall = dir.path().join("wall.zarr");
        let mut noise = Noise(5);
        let mut values = || values(SIDE, |_, _| 0.2 + 0.8 * noise.next());
        let light = values();
        write_wall(&wall, values());
        Self { dir, wall, light }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// Writes the disc with `light` and `distance` of each pixel, by its index and coverage; its chart.
    fn write(
        &self,
        name: &str,
        light: impl Fn(usize, f32) -> f32,
        distance: impl Fn(usize, f32) -> f32,
    ) -> PathBuf {
        let coverage = values(SIDE, disc);
        let of = |value: &dyn Fn(usize, f32) -> f32| {
            coverage.iter().enumerate().map(|(i, c)| value(i, *c)).collect::<Vec<f32>>()
        };
        write_group(&self.path(name), &of(&light), &of(&distance), &coverage)
    }

    fn try_run(&self, film: &str, chart: &Path, flags: &[&str]) -> CommandResult {
        let always = ["--wavelengths", "500", "--outside", "clamp", "--film-pitch-um", "2"];
        let always = [&always[..], &["--hidden", text(&self.wall)]].concat();
        run(text(chart), &self.path(film), text(&pack()), &[&always, flags].concat())
    }

    fn film(&self, film: &str, chart: &Path, flags: &[&str]) -> Vec<f32> {
        self.try_run(film, chart, flags).ok();
        pixels(&self.path(film), "film").1.remove(0)
    }
}

/// Largest difference of two films.
fn difference(a: &[f32], b: &[f32]) -> f32 {
    std::iter::zip(a, b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[test]
fn light_and_distances_of_pixels_that_are_not_covered_change_nothing() {
    let scene = Scene::new();
    let plain = scene.write("plain.h5", |i, _| scene.light[i], |_, _| 0.55);
    let other = [0.0, f32::INFINITY, f32::NAN, -1.0, 0.5, 90.0];
    let changed = scene.write(
        "changed.h5",
        |i, c| if c > 0.0 { scene.light[i] } else { 1e6 },
        |i, c| if c > 0.0 { 0.55 } else { other[i % other.len()] },
    );
    for (i, flags) in [
        &["--axis", "47.1,46.8"][..],
        &["--axis", "47.1,46.8", "--interp", "bilinear"],
        &["--scale", "0.7,0.7", "--film-size", "60x60"],
        &["--depth-edges", "snap"],
    ]
    .into_iter()
    .enumerate()
    {
        let film = |name: &str, chart| scene.film(&format!("{name}-{i}"), chart, flags);
        let (expected, found) = (film("plain", &plain), film("changed", &changed));
        assert_eq!(bits(&[found]), bits(&[expected]), "{flags:?}");
    }
    // Nor do they need depth nodes.
    let report = |group: &Path| -> serde_json::Value {
        let pack = pack();
        let place = ["--film-pitch-um", "2", "--outside", "clamp"];
        let words = [&["depth", text(group), "--lens", text(&pack), "--json"][..], &place].concat();
        let report = lenscube(&words).ok().stdout;
        let mut report: serde_json::Value = serde_json::from_str(&report).unwrap();
        report["surfaces"] = serde_json::Value::Null;
        report
    };
    assert_eq!(report(&changed), report(&plain));
}

#[test]
fn a_surface_that_covers_nothing_is_an_error() {
    let scene = Scene::new();
    let zeros = vec![0.0; SIZE.pixels()];
    let nothing = write_group(&scene.path("nothing.h5"), &scene.light, &zeros, &zeros);
    let flags = ["--wavelengths", "500", "--outside", "clamp", "--film-pitch-um", "2"];
    let result = run(text(&nothing), &scene.path("film"), text(&pack()), &flags);
    assert_exit(&result, 2, &["nothing.h5", "the coverage of all pixels is 0"]);
}

#[test]
fn a_uniform_surface_has_no_rim_of_another_colour() {
    // A disc and a wall of radiance 1, both complete; 0 where the disc is not.
    let scene = Scene::new();
    let chart = scene.write("disc.h5", |_, c| if c > 0.0 { 1.0 } else { 0.0 }, |_, _| 0.55);
    write_wall(&scene.path("white.zarr"), vec![1.0; SIZE.pixels()]);
    let white = Scene { wall: scene.path("white.zarr"), ..scene };
    let whole = white.write("whole.h5", |_, _| 1.0, |_, _| 0.55);
    let flags = ["--axis", "47,47", "--stages", "svpsf"];
    let (found, expected) = (white.film("found", &chart, &flags), white.film("expected", &whole, &flags));
    assert_eq!(bits(&[found]), bits(&[expected]));
}

#[test]
fn light_multiplied_by_the_coverage_is_divided_by_it() {
    let scene = Scene::new();
    let straight = scene.write("straight.h5", |i, _| scene.light[i], |_, _| 0.55);
    let multiplied = scene.write("multiplied.h5", |i, c| c * scene.light[i], |_, _| 0.55);
    let axis = ["--axis", "47.1,46.8"];
    let expected = scene.film("straight", &straight, &axis);
    let premultiplied = [&axis[..], &["--coverage-light", "premultiplied"]].concat();
    let divided = scene.film("divided", &multiplied, &premultiplied);
    assert!(difference(&divided, &expected) < 1e-6, "{}", difference(&divided, &expected));
    let silent = scene.try_run("named", &straight, &[&axis[..], &["--coverage-light", "straight"]].concat());
    assert!(silent.code == 0 && !silent.stderr.contains("covered in part"), "{}", silent.stderr);
    let noted = scene.try_run("noted", &multiplied, &axis);
    assert_exit(&noted, 0, &["pixels, e.g. row", "are covered in part", "--coverage-light premultiplied"]);
    assert!(difference(&pixels(&scene.path("noted"), "film").1[0], &expected) > 0.02);
    let other = scene.try_run("noted", &multiplied, &premultiplied);
    assert_exit(&other, 3, &["belongs to another job", "--depth"]);
    // Colours of OpenEXR are multiplied by alpha.
    let exr = scene.path("disc.exr");
    let (alpha, light) = (values(SIDE, disc), values(SIDE, |y, x| disc(y, x) * scene.light[y * SIDE + x]));
    exr::write(&exr, SIZE, &[("A", &alpha), ("S0.500,000000nm", &light)]);
    let depth = format!("{}//scene/depth", text(&scene.path("straight.h5")));
    let of_exr = ["--depth", &*depth, "--axis", "47.1,46.8"];
    let refused = scene.try_run("exr", &exr, &of_exr);
    assert_exit(
        &refused,
        2,
        &["disc.exr: alpha at row", "premultiplied", "add `--coverage-light premultiplied`"],
    );
    let flags = [&of_exr[..], &["--coverage-light", "premultiplied"]].concat();
    let found = scene.film("exr", &exr, &flags);
    assert!(difference(&found, &expected) < 1e-6, "{}", difference(&found, &expected));
    let flat = run("gen:uniform?size=20", &scene.path("flat"), "phone", &["--coverage-light", "straight"]);
    assert_exit(&flat, 2, &["--coverage-light requires the distance of every chart pixel"]);
}

#[test]
fn what_is_invented_does_not_depend_on_where_the_film_begins_and_ends() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    const CHART: usize = 200;
    let (mut noise, chart, depth) = (Noise(7), path("chart.zarr"), path("depth.npy"));
    let light = values(CHART, |_, _| noise.next());
    Picture { size: Size::new(CHART, CHART), bands: vec![light] }.write(&chart);
    // Near discs in the film and across its corner, before a wall in focus.
    let is_near = |y: usize, x: usize| {
        [(100.0, 104.0, 22.0), (58.0, 55.0, 18.0)]
            .iter()
            .any(|(cy, cx, r)| (y as f32 - cy).hypot(x as f32 - cx) < *r)
    };
    write_npy(&depth, Size::new(CHART, CHART), &values(CHART, |y, x| if is_near(y, x) { 0.55 } else { 2.0 }));
    let film = |name: &str, size: &str, axis: &str| {
        let place = ["--film-size", size, "--axis", axis, "--film-pitch-um", "2", "--scale", "1,1"];
        let always = ["--depth", text(&depth), "--wavelengths", "500", "--outside", "clamp"];
        let flags = [&always[..], &["--stages", "svpsf"], &place].concat();
        run(text(&chart), &path(name), text(&pack()), &flags).ok();
        let (size, mut bands) = pixels(&path(name), "film");
        (size, bands.remove(0))
    };
    let (small_size, small) = film("small", "90x90", "44.5,44.5");
    let (shares, invented) = pixels(&path("small"), "invented");
    assert!(shares == Size::new(2, 2) && invented[0][0] > 0.01, "{invented:?}");
    for (name, size, axis, (dy, dx)) in
        [("large", "121x117", "57.5,53.5", (9, 13)), ("shifted", "91x90", "45.5,44.5", (0, 1))]
    {
        let (large_size, large) = film(name, size, axis);
        let part: Vec<f32> = (0..small_size.height)
            .flat_map(|y| large[(y + dy) * large_size.width + dx..][..small_size.width].to_vec())
            .collect();
        let difference = difference(&small, &part);
        assert!(difference < 2e-6, "{name}: {difference}");
    }
}
