//! `run --depth`: a flat film where the depth is constant, the same files however the film is computed, and bad input.

use crate::common::{
    CommandResult, Noise, Picture, assert_exit, bits, files, lenscube, pixels, run, shards, text, write_npy,
    write_pack,
};
use formats::lens::LensPack;
use pipeline::geometry::Size;
use pipeline::lens::Lens;
use std::path::{Path, PathBuf};

const SIZE: Size = Size::new(560, 530);
const CHART: &str = "gen:composite?size=530x560&overscan=0";

fn golden_pack() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/depth/packs/six-slabs.lens.zip")
}

struct Scene {
    dir: tempfile::TempDir,
    depth: PathBuf,
}

impl Scene {
    /// A near disc with a noisy rim before a tilted floor and infinity: a film of several tiles with all slabs of the pack.
    fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        let depth = dir.path().join("depth.npy");
        let mut noise = Noise(11);
        let values: Vec<f32> = (0..SIZE.pixels())
            .map(|i| {
                let (y, x) = ((i / SIZE.width) as f32, (i % SIZE.width) as f32);
                let disc = (y - 250.0).hypot(x - 300.0) < 60.0 + 8.0 * noise.next();
                let floor = 0.6 / (1e-3 * y + 0.1);
                if disc {
                    0.55
                } else if y < 120.0 {
                    f32::INFINITY
                } else {
                    floor
                }
            })
            .collect();
        write_npy(&depth, SIZE, &values);
        Self { dir, depth }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn flags<'a>(depth: &'a str, more: &[&'a str]) -> Vec<&'a str> {
        let always = ["--wavelengths", "500", "--outside", "clamp", "--shard", "256", "--chunk", "128"];
        [&["--depth", depth][..], &always, more].concat()
    }

    fn try_run(&self, film: &str, depth: &str, flags: &[&str]) -> CommandResult {
        run(CHART, &self.path(film), text(&golden_pack()), &Self::flags(depth, flags))
    }

    fn run(&self, film: &str, flags: &[&str]) -> PathBuf {
        self.try_run(film, text(&self.depth), flags).ok();
        self.path(film)
    }
}

#[test]
fn threads_memory_interruption_and_regions_do_not_change_the_film() {
    let scene = Scene::new();
    let film = scene.run("first", &["--threads", "1"]);
    let first = files(&film);
    assert!(first.len() > 9, "several shards: {:?}", first.keys());
    let again = scene.run("again", &["--threads", "3", "--memory", "700MiB"]);
    assert!(files(&again) == first, "threads and memory");
    for shard in shards(&again).into_iter().filter(|s| s.starts_with("film")).step_by(2) {
        std::fs::remove_file(again.join(shard)).unwrap();
    }
    assert_exit(&scene.try_run("again", text(&scene.depth), &[]), 0, &["resuming"]);
    assert!(files(&again) == first, "resumed");
    assert_exit(&scene.try_run("again", text(&scene.depth), &[]), 0, &["nothing to do"]);
    let region = scene.run("region", &["--roi", "250,260,200,190"]);
    let (_, whole) = pixels(&film, "film");
    let (size, part) = pixels(&region, "roi_0");
    let row = |y: usize| &whole[0][(260 + y) * SIZE.width + 250..][..200];
    let cut: Vec<f32> = (0..190).flat_map(row).copied().collect();
    assert_eq!((size, bits(&part)), (Size::new(190, 200), bits(&[cut])));
}

#[test]
fn units_give_the_bytes_of_a_single_run() {
    let scene = Scene::new();
    let expected = files(&scene.run("film", &[]));
    let (film, plan) = (scene.path("planned"), scene.path("plan.json"));
    let words = ["plan", CHART, text(&film), "--output", text(&plan)];
    let unit_rows = ["--unit-rows", "1", "--lens"];
    let flags = Scene::flags(text(&scene.depth), &[]);
    let pack = golden_pack();
    lenscube(&[&words[..], &unit_rows, &[text(&pack)], &flags].concat()).ok();
    for unit in ["2", "0-1"] {
        lenscube(&["run", "--plan", text(&plan), "--unit", unit, "--no-fsync"]).ok();
    }
    assert!(files(&film) == expected);
}

#[test]
fn constant_depth_at_a_node_is_the_film_of_that_node_alone() {
    let scene = Scene::new();
    let pack = LensPack::open(golden_pack()).unwrap();
    let depth = pack.lens().depth.clone().unwrap();
    // The node in focus.
    let node = depth.bands[0].nearest(depth.focus());
    assert_eq!(depth.bands[0].vergence[node], 0.5);
    let band = depth.bands[0].at_node(&pack.lens().bands[0], node);
    let flat = Lens { bands: vec![band], depth: None, ..pack.lens().clone() };
    let flat_pack = scene.path("flat.lens.zarr");
    write_pack(&flat_pack, &flat, vec![pack.psf_of_node(0, node).unwrap()]);
    let flags = ["--wavelengths", "500", "--outside", "clamp", "--shard", "256", "--chunk", "128"];
    run(CHART, &scene.path("flat"), text(&flat_pack), &flags).ok();
    let (_, expected) = pixels(&scene.path("flat"), "film");
    for (name, unit, number, value) in [("number", "m", "2", None), ("array", "cm", "", Some(200.0))] {
        let array = scene.path("constant.npy");
        let spec = match value {
            None => number,
            Some(cm) => {
                write_npy(&array, SIZE, &vec![cm; SIZE.pixels()]);
                text(&array)
            }
        };
        scene.try_run(name, spec, &["--depth-unit", unit]).ok();
        assert_eq!(bits(&pixels(&scene.path(name), "film").1), bits(&expected), "{name}");
    }
}

#[test]
fn uniform_surfaces_with_complete_hidden_ones_stay_uniform() {
    let scene = Scene::new();
    let values: Vec<f32> = (0..SIZE.pixels())
        .map(|i| {
            let (y, x) = ((i / SIZE.width) as f32, (i % SIZE.width) as f32);
            if (y - 250.0).hypot(x - 300.0) < 70.0 { 0.55 } else { 1.0 }
        })
        .collect();
    let depth = scene.path("disc.npy");
    write_npy(&depth, SIZE, &values);
    // A wall of radiance 1 at 1 m, also behind the disc.
    let wall = scene.path("wall.zarr");
    Picture { size: SIZE, bands: vec![vec![1.0; SIZE.pixels()]] }.write(&wall);
    for (path, bytes) in files(&wall.join("chart")) {
        let to = wall.join("depth").join(path);
        std::fs::create_dir_all(to.parent().unwrap()).unwrap();
        std::fs::write(to, bytes).unwrap();
    }
    let flags = Scene::flags(text(&depth), &["--stages", "svpsf", "--hidden", text(&wall)]);
    let film = scene.path("film");
    run("gen:uniform?size=530x560&overscan=0&value=1", &film, text(&golden_pack()), &flags).ok();
    let (_, found) = pixels(&film, "film");
    assert_within_e(&scene, &found[0], &[0.93, 1.3, 1.6, 2.0]);
}

#[test]
fn a_uniform_surface_of_several_distances_in_one_slab_stays_uniform() {
    let scene = Scene::new();
    // Stripes at both ends of the slab between the nodes at 0.93 and 1.3 1/m.
    let depth = scene.path("stripes.npy");
    let distance =
        |i: usize| if (i / SIZE.width / 16).is_multiple_of(2) { 1.0 / 0.9301 } else { 1.0 / 1.2999 };
    write_npy(&depth, SIZE, &(0..SIZE.pixels()).map(distance).collect::<Vec<f32>>());
    let film = scene.path("film");
    let flags = Scene::flags(text(&depth), &["--stages", "svpsf", "--hidden", "none"]);
    run("gen:uniform?size=530x560&overscan=0&value=1", &film, text(&golden_pack()), &flags).ok();
    assert_within_e(&scene, &pixels(&film, "film").1[0], &[0.93, 1.3]);
}

/// Every pixel of a film of radiance 1 is within the range of e = 1 - div(centroid) of the nodes; their PSFs are not symmetric.
fn assert_within_e(scene: &Scene, found: &[f32], vergences: &[f64]) {
    let alone = vergences.iter().map(|vergence| {
        let (film, distance) = (scene.path(&format!("{vergence}")), (1.0 / vergence).to_string());
        let flags = Scene::flags(&distance, &["--stages", "svpsf"]);
        run("gen:uniform?size=530x560&overscan=0&value=1", &film, text(&golden_pack()), &flags).ok();
        pixels(&film, "film").1.remove(0)
    });
    let alone: Vec<Vec<f32>> = alone.collect();
    for (i, v) in found.iter().enumerate() {
        let range = alone.iter().fold((f32::MAX, f32::MIN), |(a, b), e| (a.min(e[i]), b.max(e[i])));
        assert!(range.0 - 2e-6 < *v && *v < range.1 + 2e-6, "pixel {i}: {v}, expected {range:?}");
    }
}

#[test]
fn bad_depths_are_errors_that_say_where() {
    let scene = Scene::new();
    let with = |at: usize, value: f32| {
        let mut values = vec![1.5f32; SIZE.pixels()];
        values[at] = value;
        let path = scene.path("bad.npy");
        write_npy(&path, SIZE, &values);
        path
    };
    let at = 3 * SIZE.width + 7;
    for value in [f32::NAN, 0.0, -2.0] {
        let result = scene.try_run("film", text(&with(at, value)), &[]);
        assert_exit(&result, 2, &["row 3, column 7", "expected a distance above 0", "--depth-miss far"]);
    }
    let far = scene.try_run("far", text(&with(at, 0.0)), &["--depth-miss", "far"]);
    assert_exit(&far, 0, &["1 pixels of the depth arrays are NaN, 0 or negative"]);
    let small = scene.path("small.npy");
    write_npy(&small, Size::new(5, 4), &[1.0; 20]);
    assert_exit(&scene.try_run("film", text(&small), &[]), 2, &["4x5 px, the chart has 530x560"]);
    assert_exit(&scene.try_run("film", "nowhere.npy", &[]), 1, &["--depth nowhere.npy"]);
    assert_exit(&scene.try_run("film", "0", &[]), 2, &["--depth 0: expected a distance above 0"]);
    let depth = text(&scene.depth);
    assert_exit(
        &scene.try_run("film", depth, &["--stages", "ri,distortion"]),
        2,
        &["requires the stage svpsf"],
    );
    assert_exit(&scene.try_run("film", depth, &["--device", "cuda"]), 2, &["on the CPU"]);
    let near =
        run(CHART, &scene.path("film"), text(&golden_pack()), &["--depth", "0.1", "--wavelengths", "500"]);
    assert_exit(&near, 1, &["0.100000 to 0.100000 m", "from 0.500000 to inf m", "--outside clamp"]);
}

#[test]
fn lens_and_depth_must_fit() {
    let scene = Scene::new();
    let film = scene.path("film");
    let without = run(CHART, &film, text(&golden_pack()), &["--wavelengths", "500"]);
    assert_exit(&without, 2, &["has depth nodes", "--depth 2"]);
    let flat = run(CHART, &film, "double-gauss-28-npz", &["--depth", "2"]);
    assert_exit(&flat, 2, &["PSFs of one object distance"]);
    let other = scene.run("other", &[]);
    let changed = scene.try_run("other", "0.7", &[]);
    assert_exit(&changed, 3, &["belongs to another job", "--depth"]);
    assert!(other.exists());
}

#[test]
fn coverage_outside_0_to_1_is_an_error() {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/depth/charts/three-planes.zarr");
    let dir = tempfile::tempdir().unwrap();
    let chart = dir.path().join("chart.zarr");
    for (path, bytes) in files(&golden) {
        let to = chart.join(path);
        std::fs::create_dir_all(to.parent().unwrap()).unwrap();
        std::fs::write(to, bytes).unwrap();
    }
    // Distances in place of the coverage.
    std::fs::remove_dir_all(chart.join("coverage")).unwrap();
    let copy = |from: &str| {
        std::fs::copy(chart.join("hidden/2/depth").join(from), chart.join("coverage").join(from)).unwrap()
    };
    std::fs::create_dir_all(chart.join("coverage/c/0")).unwrap();
    copy("zarr.json");
    copy("c/0/0");
    let depth = format!("{}//depth", text(&chart));
    let flags = ["--depth", &*depth, "--outside", "clamp"];
    let result = run(text(&chart), &dir.path().join("film"), text(&golden_pack()), &flags);
    assert_exit(&result, 1, &["the coverage at row", "expected 0 to 1"]);
}

/// Distances of a disc at 0.55 m before a wall at 2 m, in focus.
fn disc_before_wall() -> Vec<f32> {
    let at = |i: usize| ((i / SIZE.width) as f32 - 250.0).hypot((i % SIZE.width) as f32 - 300.0);
    (0..SIZE.pixels()).map(|i| if at(i) < 70.0 { 0.55 } else { 2.0 }).collect()
}

#[test]
fn what_is_hidden_behind_an_edge_is_invented_there_alone() {
    let scene = Scene::new();
    let depth = scene.path("disc.npy");
    write_npy(&depth, SIZE, &disc_before_wall());
    let film = |name: &str, flags: &[&str]| {
        scene.try_run(name, text(&depth), flags).ok();
        pixels(&scene.path(name), "film").1.remove(0)
    };
    let (invented, none) = (film("invented", &[]), film("none", &["--hidden", "none"]));
    // Sums over FFT blocks have their rounding everywhere in a tile.
    let differs = |i: usize| (invented[i] - none[i]).abs() > 2e-6;
    let distance = |i: usize| ((i / SIZE.width) as f32 - 250.0).hypot((i % SIZE.width) as f32 - 300.0);
    assert!((0..SIZE.pixels()).any(|i| differs(i) && (distance(i) - 70.0).abs() < 8.0));
    assert!((0..SIZE.pixels()).all(|i| !differs(i) || (distance(i) - 70.0).abs() < 30.0));
    // Tiles of 512 px: those below have no edge in reach.
    let below = 512 * SIZE.width;
    assert_eq!(bits(&[invented[below..].to_vec()]), bits(&[none[below..].to_vec()]));
    let (size, shares) = pixels(&scene.path("invented"), "invented");
    assert_eq!(size, Size::new(9, 9));
    // The disc reaches from block row 2 to 4 and column 3 to 5.
    for (i, share) in shares[0].iter().enumerate() {
        let around = (2..=5).contains(&(i / 9)) && (3..=5).contains(&(i % 9));
        assert!((0.0..0.5).contains(share) && (around || *share == 0.0), "block {i}: {share}");
    }
    assert!(shares[0].iter().any(|share| *share > 1e-3));
    assert!(!scene.path("none").join("invented").exists());
    let other = scene.try_run("none", text(&depth), &[]);
    assert_exit(&other, 3, &["belongs to another job", "--depth"]);
    let both = scene.try_run("both", text(&depth), &["--hidden", "none", "--hidden", "a.zarr"]);
    assert_exit(&both, 2, &["expected one or the other"]);
}

#[test]
fn an_invented_wall_is_the_one_that_is_given_where_it_is_uniform() {
    let scene = Scene::new();
    let depth = scene.path("disc.npy");
    let distances = disc_before_wall();
    write_npy(&depth, SIZE, &distances);
    // A black disc before a wall of radiance 1.
    let picture = |name: &str, value: &dyn Fn(usize) -> f32| {
        let path = scene.path(name);
        Picture { size: SIZE, bands: vec![(0..SIZE.pixels()).map(value).collect()] }.write(&path);
        path
    };
    let chart = picture("chart.zarr", &|i| if distances[i] < 0.6 { 0.0 } else { 1.0 });
    let wall = picture("wall.zarr", &|_| 1.0);
    for (path, bytes) in files(&picture("distance.zarr", &|_| 2.0).join("chart")) {
        let to = wall.join("depth").join(path);
        std::fs::create_dir_all(to.parent().unwrap()).unwrap();
        std::fs::write(to, bytes).unwrap();
    }
    let film = |name: &str, flags: &[&str]| {
        let flags = Scene::flags(text(&depth), flags);
        run(text(&chart), &scene.path(name), text(&golden_pack()), &flags).ok();
        pixels(&scene.path(name), "film").1.remove(0)
    };
    let given = film("given", &["--stages", "svpsf", "--hidden", text(&wall)]);
    let invented = film("invented", &["--stages", "svpsf"]);
    let (mut worst, mut least) = (0f32, f32::MAX);
    for (i, (a, b)) in std::iter::zip(&invented, &given).enumerate() {
        worst = worst.max((a - b).abs());
        if distances[i] == 2.0 {
            least = least.min(*a);
        }
    }
    assert!(worst < 1e-5, "{worst}");
    // No fringe darker than the disc's own blur: half of it at a straight edge.
    assert!(least > 0.4, "{least}");
}

#[test]
fn a_slab_costs_what_the_model_says() {
    let scene = Scene::new();
    let result = scene.try_run("film", text(&scene.depth), &["-v"]);
    assert_exit(&result, 0, &["slabs a tile"]);
    let line = result.stderr.lines().find(|line| line.contains("of the model")).unwrap();
    let share: f64 = line.split(' ').rev().nth(3).unwrap().parse().unwrap();
    assert!(share <= 1.1, "{line}");
}

#[test]
fn verify_reads_the_invented_shares_and_repair_has_them_computed_again() {
    let scene = Scene::new();
    let depth = scene.path("disc.npy");
    write_npy(&depth, SIZE, &disc_before_wall());
    let film = scene.path("film");
    scene.try_run("film", text(&depth), &[]).ok();
    let verify = |flags: &[&str]| lenscube(&[&["verify", text(&film)], flags].concat());
    assert_exit(&verify(&[]), 0, &["no defect"]);
    let before = files(&film);
    let (damaged, lost) = (film.join("invented/c/0/0/0"), film.join("invented/c/0/1/1"));
    let mut bytes = std::fs::read(&damaged).unwrap();
    bytes[0] ^= 1;
    std::fs::write(&damaged, bytes).unwrap();
    std::fs::remove_file(&lost).unwrap();
    let lines = ["bad: invented/c/0/0/0: its checksum", "bad: invented/c/0/1/1: no such file", "2 defects"];
    assert_exit(&verify(&[]), 4, &lines);
    assert_exit(&verify(&["--repair"]), 4, &["removed 2 damaged shards"]);
    scene.try_run("film", text(&depth), &[]).ok();
    assert!(files(&film) == before);
    assert_exit(&verify(&[]), 0, &["no defect"]);
}
