//! Ghosts on films: where they lie and how bright they are, the same bytes however a film is made, off means off, errors.

use crate::common::{CommandResult, Picture, assert_exit, bits, files, lenscube, pixels, text};
use pipeline::geometry::Size;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A chart with a lamp in the dark, in one band.
struct Lamp {
    dir: tempfile::TempDir,
    chart: PathBuf,
    size: Size,
}

/// Film pixels, µm.
const PITCH_UM: f64 = 100.0;

impl Lamp {
    /// `size` px with a lamp of `side` px, whose centre is `at` px (rows, columns) from that of the chart.
    fn new(size: Size, side: usize, at: (f64, f64)) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let chart = dir.path().join("chart.zarr");
        let half = side as f64 / 2.0;
        let is_lit = |k: usize, n: usize, at: f64| (k as f64 + 0.5 - n as f64 / 2.0 - at).abs() < half;
        let value = |i: usize| {
            let lit = is_lit(i / size.width, size.height, at.0) && is_lit(i % size.width, size.width, at.1);
            if lit { 1000.0 } else { 0.0 }
        };
        Picture { size, bands: vec![(0..size.pixels()).map(value).collect()] }.write(&chart);
        Self { dir, chart, size }
    }

    fn run(&self, name: &str, lens: &str, flags: &[&str]) -> crate::common::CommandResult {
        let film = self.dir.path().join(name);
        let pitch = PITCH_UM.to_string();
        let job = ["--lens", lens, "--film-pitch-um", &pitch, "--stages", "ri,distortion"];
        lenscube(&[&["run", text(&self.chart), text(&film)], &job[..], flags].concat())
    }

    /// [`Lamp::run`] with a cache of its own.
    fn run_with_cache(&self, cache: &str, name: &str, flags: &[&str]) -> CommandResult {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        command.args(["run", text(&self.chart), text(&self.dir.path().join(name))]).args(TRIPLET).args(flags);
        CommandResult::new(&command.env("XDG_CACHE_HOME", self.dir.path().join(cache)).output().unwrap())
    }

    /// The ghosts in a cache.
    fn cached(&self, cache: &str) -> Vec<PathBuf> {
        let entries = fs::read_dir(self.dir.path().join(cache).join("lenscube/lenses")).unwrap();
        let entries = entries.map(|entry| entry.unwrap().path());
        entries.filter(|path| path.extension().is_some_and(|e| e == "ghosts")).collect()
    }

    /// The pixels of the film `name`.
    fn film(&self, name: &str) -> Vec<f32> {
        pixels(&self.dir.path().join(name), "film").1.remove(0)
    }

    fn files(&self, name: &str) -> std::collections::BTreeMap<PathBuf, Vec<u8>> {
        files(&self.dir.path().join(name))
    }
}

/// A coated triplet with few rings, for films whose bytes are compared.
const TRIPLET: [&str; 14] = [
    "--lens",
    "triplet",
    "--film-pitch-um",
    "100",
    "--stages",
    "ri,distortion",
    "--coatings",
    "mgf2",
    "--ghosts",
    "on",
    "--ghost-rings",
    "16",
    "--sensor-reflectance",
    "5%",
];

/// The film and the rear group of the Double Gauss image a lamp through the axis, 1.06 times as far from it, with half a percent of its light where the film reflects a tenth.
#[test]
fn lamp_has_its_inverted_ghost_of_the_film() {
    let (row, column) = (-30.0, 50.0);
    let scene = Lamp::new(Size::new(240, 320), 12, (row, column));
    let coated = ["--coatings", "none"];
    scene.run("off", "double-gauss-28", &coated).ok();
    let ghosts = ["--ghosts", "on", "--sensor-reflectance", "10%"];
    scene.run("on", "double-gauss-28", &[&coated[..], &ghosts].concat()).ok();
    let (off, on) = (scene.film("off"), scene.film("on"));
    let ghost: Vec<f64> = on.iter().zip(&off).map(|(on, off)| f64::from(*on) - f64::from(*off)).collect();
    let lamp: f64 = off.iter().map(|v| f64::from(*v)).sum();
    // Nowhere less light than without, to the rounding of f32.
    assert!(ghost.iter().all(|v| *v > -1e-3), "{:?}", ghost.iter().copied().fold(0.0, f64::min));
    let within = |row: f64, column: f64, radius: f64| -> f64 {
        let place = |k: usize, n: usize, at: f64| k as f64 + 0.5 - n as f64 / 2.0 - at;
        let near = |i: usize| {
            let y = place(i / scene.size.width, scene.size.height, row);
            let x = place(i % scene.size.width, scene.size.width, column);
            y * y + x * x < radius * radius
        };
        ghost.iter().enumerate().filter(|(i, _)| near(*i)).map(|(_, v)| v).sum::<f64>() / lamp
    };
    let found = within(-1.06 * row, -1.06 * column, 25.0);
    assert!((2e-3..7e-3).contains(&found), "{found}");
    for elsewhere in [(-1.06 * row, 1.06 * column), (1.06 * row, -1.06 * column)] {
        assert!(within(elsewhere.0, elsewhere.1, 25.0) < 0.3 * found);
    }
}

#[test]
fn bytes_of_a_film_with_ghosts_do_not_depend_on_threads_and_off_is_off() {
    let scene = Lamp::new(Size::new(60, 80), 6, (10.0, -15.0));
    let coated = ["--coatings", "mgf2"];
    for threads in ["1", "3"] {
        // Each traces its ghosts.
        scene.run_with_cache(&format!("cache {threads}"), threads, &["--threads", threads]).ok();
    }
    assert!(scene.files("1") == scene.files("3"));
    scene.run("plain", "triplet", &coated).ok();
    scene.run("off", "triplet", &[&coated[..], &["--ghosts", "off"]].concat()).ok();
    assert!(scene.files("plain") == scene.files("off"));
    assert!(!scene.dir.path().join("off/veil").exists() && scene.dir.path().join("1/veil").exists());
    // Resumed with other ghosts it is another film.
    let other = [&coated[..], &["--ghosts", "on", "--ghost-rings", "32"]].concat();
    assert_exit(&scene.run("1", "triplet", &other), 3, &["--ghost-rings (film 16, requested 32)"]);
    let without = scene.run("1", "triplet", &["--coatings", "none"]);
    assert_exit(&without, 3, &["--ghosts (film"]);
    assert!(!without.stderr.contains("--stages"), "{}", without.stderr);
    assert_exit(&lenscube(&["verify", text(&scene.dir.path().join("1"))]), 0, &[]);
}

#[test]
fn ghosts_need_a_design_that_reflects_light() {
    let scene = Lamp::new(Size::new(30, 40), 4, (0.0, 0.0));
    assert_exit(&scene.run("film", "triplet", &["--ghosts", "on"]), 2, &["--coatings none"]);
    assert_exit(&scene.run("film", "double-gauss-28-npz", &["--ghosts", "on"]), 2, &["lens pack"]);
    for flag in [["--sensor-reflectance", "0.1"], ["--ghost-rings", "32"]] {
        assert_exit(&scene.run("film", "triplet", &flag), 2, &["--ghosts on"]);
    }
    assert_exit(&scene.run("film", "triplet", &["--ghosts", "on", "--ghost-rings", "8"]), 2, &["16 to 256"]);
}

/// Rings of the pack and of the film are the same to a thousandth.
#[test]
#[ignore = "long: traces the ghosts of a lens twice"]
fn ghosts_of_a_pack_are_those_of_its_design() {
    let scene = Lamp::new(Size::new(60, 80), 6, (10.0, -15.0));
    let packed = |name: &str, flags: &[&str]| {
        let pack = scene.dir.path().join(name);
        let given = ["--wavelengths", "450", "--max-height-mm", "4.98", "--film-pitch-um", "100"];
        (
            lenscube(
                &[&["lens", "trace", "triplet", text(&pack), "--tails", "off"], &given[..], flags].concat(),
            ),
            pack,
        )
    };
    let ghosts =
        ["--coatings", "mgf2", "--ghosts", "on", "--ghost-rings", "16", "--sensor-reflectance", "5%"];
    let (traced, pack) = packed("ghosts.lens.zarr", &ghosts);
    traced.ok();
    let shown = lenscube(&["lens", "show", text(&pack)]).ok().stdout;
    assert!(shown.contains("ghosts         16 rings to 4.9800 mm; the film reflects 5 %"), "{shown}");
    scene.run_with_cache("cache", "design", &[]).ok();
    let on = ["--ghosts", "on"];
    scene.run("pack", text(&pack), &on).ok();
    scene.run("plain", text(&pack), &[]).ok();
    // Beside the lamp, where the rounding of its light is not seen.
    let (plain, of_design, of_pack) = (scene.film("plain"), scene.film("design"), scene.film("pack"));
    let beside = || (0..plain.len()).filter(|i| plain[*i] == 0.0);
    let peak = beside().map(|i| of_design[i]).fold(0.0, f32::max);
    let worst = beside().map(|i| (of_design[i] - of_pack[i]).abs()).fold(0.0, f32::max);
    assert!(beside().count() > 4000 && peak > 1e-3 && worst < 0.01 * peak, "{worst} of {peak}");
    assert_exit(&lenscube(&["verify", text(&scene.dir.path().join("pack"))]), 0, &[]);
    assert_exit(&scene.run("pack", text(&pack), &[]), 3, &["--ghosts (film \"on\", requested nothing)"]);

    // Refused, each with its way out.
    for flag in [["--sensor-reflectance", "0.1"], ["--ghost-rings", "32"]] {
        let refused = scene.run("film", text(&pack), &[&on[..], &flag].concat());
        assert_exit(&refused, 2, &[flag[0], "`lens trace`"]);
    }
    let (_, plain) = packed("plain.lens.zarr", &[]);
    assert_exit(&scene.run("film", text(&plain), &on), 2, &["has no ghosts", "`lens trace --ghosts on`"]);
    let cases: [(&[&str], &str); 4] = [
        (&["--ghosts", "on"], "--coatings none"),
        (&["--ghost-rings", "32"], "requires --ghosts on"),
        (&["--coatings", "mgf2", "--ghosts", "on", "--depths-m", "1:inf"], "--ghosts on with --depths-m"),
        (&["--coatings", "mgf2", "--ghosts", "on", "--tolerances", "none.toml"], "--tolerances"),
    ];
    for (flags, part) in cases {
        let (refused, out) = packed("refused.lens.zarr", flags);
        assert_exit(&refused, 2, &[part]);
        assert!(!out.exists());
    }
}

#[test]
fn ghosts_of_the_cache_give_the_same_film_and_damaged_ones_are_traced_again() {
    let scene = Lamp::new(Size::new(60, 80), 6, (10.0, -15.0));
    scene.run_with_cache("cache", "traced", &[]).ok();
    let entry = scene.cached("cache");
    assert_eq!(entry.len(), 1);
    let intact = fs::read(&entry[0]).unwrap();
    scene.run_with_cache("cache", "cached", &[]).ok();
    assert!(scene.files("cached") == scene.files("traced"));
    let mut damaged = intact.clone();
    let last = damaged.len() - 2;
    damaged[last] ^= 1;
    fs::write(&entry[0], damaged).unwrap();
    let again = scene.run_with_cache("cache", "again", &[]).ok();
    assert!(again.stderr.contains("its ghosts are traced again"), "{}", again.stderr);
    assert!(scene.files("again") == scene.files("traced"));
    assert!(fs::read(&entry[0]).unwrap() == intact);
    // Other ghosts have an entry of their own.
    scene.run_with_cache("cache", "larger", &["--overwrite", "--film-size", "70x60"]).ok();
    assert_eq!(scene.cached("cache").len(), 2);
}

#[test]
fn ghosts_do_not_depend_on_memory_regions_or_units() {
    let scene = Lamp::new(Size::new(300, 260), 20, (40.0, -55.0));
    let layout = ["--shard", "64", "--chunk", "32"];
    let run = |name: &str, flags: &[&str]| {
        let film = scene.dir.path().join(name);
        lenscube(&[&["run", text(&scene.chart), text(&film)], &TRIPLET[..], &layout, flags].concat())
    };
    run("whole", &["--memory", "4GiB"]).ok();
    let whole = scene.files("whole");
    run("small", &["--memory", "512MiB"]).ok();
    assert!(scene.files("small") == whole);
    // Regions: their pixels, and the layer of the whole film.
    let (x, y, w, h) = (70, 100, 130, 90);
    run("regions", &["--roi", "70,100,130,90"]).ok();
    let (size, film) = pixels(&scene.dir.path().join("whole"), "film");
    let rows = |band: &Vec<u32>| -> Vec<u32> {
        (y..y + h).flat_map(|row| band[row * size.width + x..][..w].to_vec()).collect()
    };
    let expected: Vec<_> = bits(&film).iter().map(rows).collect();
    assert!(bits(&pixels(&scene.dir.path().join("regions"), "roi_0").1) == expected);
    let layer = Path::new("veil/c/0/0/0");
    assert!(scene.files("regions")[layer] == whole[layer]);
    // Units in an order of no order.
    let (job, film) = (scene.dir.path().join("job.json"), scene.dir.path().join("units"));
    let plan = ["plan", text(&scene.chart), text(&film), "-o", text(&job), "--unit-rows", "1"];
    lenscube(&[&plan[..], &TRIPLET, &layout].concat()).ok();
    for unit in ["3", "0", "4", "1", "2"] {
        lenscube(&["run", "--plan", text(&job), "--unit", unit]).ok();
    }
    assert!(scene.files("units") == whole);
    // A plan with its ghosts in a lens pack, whose workers trace none.
    let (job, packed, pack) = (
        scene.dir.path().join("packed.json"),
        scene.dir.path().join("packed"),
        scene.dir.path().join("lens.zip"),
    );
    let plan = ["plan", text(&scene.chart), text(&packed), "-o", text(&job), "--lens-pack", text(&pack)];
    lenscube(&[&plan[..], &TRIPLET, &layout].concat()).ok();
    lenscube(&["run", "--plan", text(&job), "--unit", "0"]).ok();
    assert!(fs::read(packed.join(layer)).unwrap() == fs::read(film.join(layer)).unwrap());
    // A flipped byte of the layer.
    let path = film.join(layer);
    let mut bytes = fs::read(&path).unwrap();
    bytes[100] ^= 1;
    fs::write(&path, bytes).unwrap();
    assert_exit(&lenscube(&["verify", text(&film)]), 4, &["bad: veil/c/0/0/0: its checksum does not match"]);
}
