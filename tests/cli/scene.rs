//! Scenes of meshes: values, bytes for any threads and memory, kills, refusals, the film of a scene.

mod environment;
mod projection;

use crate::common::{CommandResult, assert_error_line, assert_exit, bits, files, lenscube, pixels, text};
use pipeline::colour::Illuminant;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use tempfile::TempDir;

const USAGE: i32 = 2;
const OTHER_JOB: i32 = 3;
const WRONG: i32 = 4;
const RETRY: i32 = 75;
const INTERRUPTED: i32 = 130;

/// A mesh as an OBJ file, in metres, before a camera at the origin that looks along −z.
#[derive(Default)]
struct Obj {
    text: String,
    vertices: usize,
}

impl Obj {
    fn vertex(&mut self, [x, y, z]: [f64; 3]) -> usize {
        writeln!(self.text, "v {x} {y} {z}").unwrap();
        self.vertices += 1;
        self.vertices
    }

    fn material(&mut self, name: &str) {
        writeln!(self.text, "usemtl {name}").unwrap();
    }

    /// A rectangle that faces the camera.
    fn wall(&mut self, z: f64, half: f64) {
        let corners = [[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]];
        let [a, b, c, d] = corners.map(|corner| self.vertex(corner));
        writeln!(self.text, "f {a} {b} {c} {d}").unwrap();
    }

    /// A closed ball of parallels and meridians, its corners counter-clockwise from outside.
    fn ball(&mut self, centre: [f64; 3], radius: f64) {
        let (rows, columns) = (12, 24);
        let at = |i: usize, j: usize| {
            let (theta, phi) = (
                std::f64::consts::PI * i as f64 / rows as f64,
                std::f64::consts::TAU * j as f64 / columns as f64,
            );
            let direction = [theta.sin() * phi.cos(), theta.cos(), -theta.sin() * phi.sin()];
            std::array::from_fn(|k| centre[k] + radius * direction[k])
        };
        let north = self.vertex(at(0, 0));
        let south = self.vertex(at(rows, 0));
        let first = self.vertices + 1;
        for i in 1..rows {
            (0..columns).for_each(|j| {
                self.vertex(at(i, j));
            });
        }
        let number = |i: usize, j: usize| first + (i - 1) * columns + j % columns;
        for j in 0..columns {
            writeln!(self.text, "f {north} {} {}", number(1, j), number(1, j + 1)).unwrap();
            writeln!(self.text, "f {south} {} {}", number(rows - 1, j + 1), number(rows - 1, j)).unwrap();
            for i in 1..rows - 1 {
                let corners = [number(i, j), number(i + 1, j), number(i + 1, j + 1), number(i, j + 1)];
                writeln!(self.text, "f {} {} {} {}", corners[0], corners[1], corners[2], corners[3]).unwrap();
            }
        }
    }
}

struct Place(TempDir);

impl Place {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// A red ball before a grey wall.
    fn mesh(&self) -> PathBuf {
        let mut obj = Obj { text: "mtllib room.mtl\no Wall\n".into(), ..Obj::default() };
        obj.material("grey");
        obj.wall(-3.0, 6.0);
        obj.text.push_str("o Ball\n");
        obj.material("red");
        obj.ball([0.2, 0.0, -1.0], 0.2);
        std::fs::write(self.at("room.mtl"), "newmtl grey\nKd 0.5 0.5 0.5\nnewmtl red\nKd 0.6 0 0\n").unwrap();
        let path = self.at("room.obj");
        std::fs::write(&path, obj.text).unwrap();
        path
    }
}

/// Flags of the lens, film and camera.
const VIEW: [&str; 13] = [
    "--lens",
    "phone",
    "--focus-m",
    "1",
    "--film-pitch-um",
    "6",
    "--mesh-unit",
    "m",
    "--eye",
    "0,0,0",
    "--target",
    "0,0,-1",
    "--film-size",
];

fn command(mesh: &Path, scene: &Path, size: &str, flags: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
    command.args(["scene", text(mesh), text(scene)]).args(VIEW).arg(size).args(flags);
    command
}

fn scene(mesh: &Path, scene: &Path, size: &str, flags: &[&str]) -> CommandResult {
    CommandResult::new(&command(mesh, scene, size, flags).output().unwrap())
}

/// A plane of a scene or film: rows and columns.
fn plane(store: &Path, array: &str, band: usize) -> (usize, usize, Vec<f32>) {
    let (size, mut bands) = pixels(store, array);
    (size.height, size.width, bands.swap_remove(band))
}

#[test]
fn values_are_those_of_the_mesh_and_the_light() {
    let place = Place::new();
    let (mesh, out, film) = (place.mesh(), place.at("scene.zarr"), place.at("film.zarr"));
    // The blur of the two differs by half a pixel.
    scene(&mesh, &out, "400x300", &["--quiet", "--gap-px", "0.1"]).ok();
    let (height, width, depth) = plane(&out, "depth", 0);
    let (.., coverage) = plane(&out, "coverage", 0);
    let (.., red) = plane(&out, "weights", 0);
    let (.., green) = plane(&out, "weights", 1);
    let (.., behind) = plane(&out, "hidden/1/depth", 0);
    let (.., behind_red) = plane(&out, "hidden/1/weights", 0);
    // The wall at the left edge; the ball where the axis of its centre, x/z = 0.2, meets the film.
    let middle = height / 2 * width;
    assert_eq!((depth[middle + 2], coverage[middle + 2]), (3.0, 1.0));
    assert!((red[middle + 2] - 0.5).abs() < 1e-6 && (green[middle + 2] - 0.5).abs() < 1e-6);
    let report: serde_json::Value = serde_json::from_str(
        &lenscube(&[
            "lens",
            "camera",
            "phone",
            "--focus-m",
            "1",
            "--film-size",
            "400x300",
            "--film-pitch-um",
            "6",
            "--json",
        ])
        .ok()
        .stdout,
    )
    .unwrap();
    let focal_mm = report["focal_length_mm"].as_f64().unwrap();
    let column = ((width as f64 - 1.0) / 2.0 + 0.2 * focal_mm / 6e-3).round() as usize;
    let ball = middle + column;
    assert!((depth[ball] - 0.8).abs() < 0.01, "{}", depth[ball]);
    assert!((red[ball] - 0.6).abs() < 1e-6 && green[ball] == 0.0);
    // Behind the ball the wall is seen, never the ball's back; far from edges nothing is stored.
    let hidden =
        (0..width).map(|x| middle + x).find(|&i| behind[i] > 0.0).expect("a hidden surface near the rim");
    assert!(
        (behind[hidden] - 3.0).abs() < 1e-6 && (behind_red[hidden] - 0.5).abs() < 1e-6,
        "{}",
        behind[hidden]
    );
    assert!(behind.iter().all(|z| *z == 0.0 || (z - 3.0).abs() < 1e-6));
    // The film: radiance ρE/π of the wall, D65 of 1000 lx, left of the axis, where the relative illumination is 1; the lens passes all light.
    let nm = "400:700:20";
    lenscube(&[
        "run",
        text(&out),
        text(&film),
        "--lens",
        "phone",
        "--focus-m",
        "1",
        "--wavelengths",
        nm,
        "--tails",
        "off",
        "--quiet",
    ])
    .ok();
    let (size, bands) = pixels(&film, "film");
    let expected = 0.5 * Illuminant::D65.irradiance_scale(1000.0) * Illuminant::D65.relative_power(560.0)
        / std::f64::consts::PI;
    let found = f64::from(bands[8][size.height / 2 * size.width + size.width / 2 - 25]);
    assert!((found / expected - 1.0).abs() < 0.01, "{found:e} {expected:e}");
}

/// Threads, memory and the shape of the tiles in flight change no byte, nor do kills.
#[test]
fn bytes_do_not_depend_on_threads_memory_or_kills() {
    let place = Place::new();
    let (mesh, whole) = (place.mesh(), place.at("whole.zarr"));
    let flags = ["--samples-per-px", "1", "--quiet"];
    let size = "700x600";
    scene(&mesh, &whole, size, &[&flags[..], &["--threads", "2", "--memory", "1GiB"]].concat()).ok();
    let expected = files(&whole);
    let small = place.at("small.zarr");
    scene(&mesh, &small, size, &[&flags[..], &["--threads", "1", "--memory", "140MiB"]].concat()).ok();
    assert!(files(&small) == expected);
    let killed = place.at("killed.zarr");
    for fault in ["commit:2:kill", "write:3:kill", "scene-shard:4:kill", "locked:1:kill"] {
        let mut command = command(&mesh, &killed, size, &flags);
        assert!(!command.env("LENSCUBE_FAULT", fault).output().unwrap().status.success(), "{fault}");
    }
    assert_exit(&scene(&mesh, &killed, size, &["--samples-per-px", "1"]), 0, &["resuming"]);
    assert!(files(&killed) == expected);
    assert_exit(&scene(&mesh, &killed, size, &["--samples-per-px", "1"]), 0, &["nothing to do"]);
    let other = scene(&mesh, &killed, size, &["--samples-per-px", "4"]);
    assert_exit(&other, OTHER_JOB, &["another job", "samples_per_px", "--overwrite"]);
    assert_exit(&lenscube(&["verify", text(&killed)]), 0, &["scene", "0 defects"]);
    std::fs::remove_file(killed.join("depth/c/0/0")).unwrap();
    let mut bytes = std::fs::read(killed.join("weights/c/1/1/0")).unwrap();
    bytes[9] ^= 4;
    std::fs::write(killed.join("weights/c/1/1/0"), bytes).unwrap();
    let found = lenscube(&["verify", text(&killed), "--repair"]);
    assert_exit(
        &found,
        WRONG,
        &["missing depth/c/0/0", "bad weights/c/1/1/0", "1 bad shards removed", "lenscube scene"],
    );
    let run = lenscube(&[
        "run",
        text(&killed),
        text(&place.at("f.zarr")),
        "--lens",
        "phone",
        "--focus-m",
        "1",
        "--wavelengths",
        "550",
    ]);
    assert_error_line(&run, USAGE, &["2 of its files are missing", "not complete"]);
    scene(&mesh, &killed, size, &flags).ok();
    assert!(files(&killed) == expected);
}

#[test]
fn what_cannot_be_is_refused_before_anything_is_written() {
    let place = Place::new();
    let mesh = place.mesh();
    let out = place.at("scene.zarr");
    let lens = ["--lens", "phone", "--focus-m", "1", "--film-pitch-um", "6", "--film-size", "60x40"];
    let unit = ["--mesh-unit", "m"];
    let looking = ["--eye", "0,0,0", "--target", "0,0,-1"];
    let run = |mesh: &Path, flags: &[&[&str]]| {
        lenscube(&[&["scene", text(mesh), text(&out)], &flags.concat()[..]].concat())
    };
    std::fs::write(place.at("notes.txt"), "v 0 0 0").unwrap();
    std::fs::write(place.at("empty.obj"), "v 0 0 0\nv 1 0 0\n").unwrap();
    std::fs::write(place.at("bad.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n").unwrap();
    std::fs::write(place.at("binary.obj"), b"glTF\x02\0\0\0").unwrap();
    std::fs::write(place.at("painted.mtl"), "newmtl a\nmap_Kd wood.png\n").unwrap();
    std::fs::write(place.at("wood.png"), "no picture").unwrap();
    let painted = "mtllib painted.mtl\nv 0 0 -1\nv 1 0 -1\nv 0 1 -1\nusemtl a\nf 1 2 3\n";
    std::fs::write(place.at("painted.obj"), painted).unwrap();
    std::fs::create_dir(place.at("folder.obj")).unwrap();
    std::fs::create_dir(place.at("store.zarr")).unwrap();
    std::fs::write(place.at("store.zarr/zarr.json"), "{}").unwrap();
    for (mesh, flags, texts) in [
        (&*mesh, &[&lens[..], &looking][..], &["--mesh-unit"][..]),
        (&mesh, &[&lens, &unit], &["no camera", "--eye"]),
        (&mesh, &[&lens, &unit, &["--eye", "0,0,0", "--target", "0,0,1"]], &["before the camera"]),
        (&mesh, &[&lens, &unit, &["--eye", "0,0,0", "--target", "0,1,0"]], &["--up"]),
        (
            &mesh,
            &[&lens, &unit, &["--eye", "0.2,0,-0.83", "--target", "0.2,0,0"]],
            &["stands inside or at", "Ball"],
        ),
        (
            &mesh,
            &[&lens, &unit, &looking, &["--material", "blue=x.csv"]],
            &["no material is called `blue`", "grey", "red"],
        ),
        (&mesh, &[&lens, &unit, &looking, &["--material", "red=none.csv"]], &["none.csv"]),
        (&mesh, &[&lens, &unit, &looking, &["--illuminant", "D66"]], &["--illuminant D66"]),
        (&mesh, &[&lens, &unit, &looking, &["--lights", "file"]], &["has no lights"]),
        (&mesh, &[&lens, &unit, &looking, &["--memory", "20MiB"]], &["too small"]),
        (
            &mesh,
            &[&lens, &unit, &looking, &["--allow-path", "/none/such"]],
            &["--allow-path /none/such", "no such folder"],
        ),
        (
            &mesh,
            &[&lens, &unit, &looking, &["--sky-samples", "4"]],
            &["--sky-samples", "--sky and --environment, of which none is given"],
        ),
        (&place.at("binary.obj"), &[&lens, &unit, &looking], &["binary.obj", "rename it to .glb"]),
        (
            &place.at("painted.obj"),
            &[&lens, &unit, &looking],
            &["reading texture", "wood.png", "convert it to PNG"],
        ),
        (&place.at("folder.obj"), &[&lens, &unit, &looking], &["folder.obj: it is a folder"]),
        (&place.at("store.zarr"), &[&lens, &unit, &looking], &["store.zarr: it is a Zarr store", ".obj"]),
        (Path::new("https://example.org/a.glb"), &[&lens], &["a.glb: it is a URL", "download it"]),
        (&place.at("notes.txt"), &[&lens, &unit, &looking], &["notes.txt", ".glb, .gltf, .obj or .ply"]),
        (&place.at("missing.obj"), &[&lens, &unit, &looking], &["missing.obj"]),
        (&place.at("empty.obj"), &[&lens, &unit, &looking], &["no triangles"]),
        (&place.at("bad.obj"), &[&lens, &unit, &looking], &["line 4"]),
    ] {
        let result = run(mesh, flags);
        // A file that cannot be read at all is a failure (1), all else usage.
        let expected = if matches!(texts, ["missing.obj" | "none.csv"]) { 1 } else { USAGE };
        assert_error_line(&result, expected, texts);
        assert!(!out.exists(), "{flags:?}");
    }
    // Outputs never touch an input.
    for output in [&mesh, &place.at("room.mtl")] {
        let before = std::fs::read(output).unwrap();
        let words =
            [&["scene", text(&mesh), text(output), "--overwrite"], &lens[..], &unit, &looking].concat();
        let result = lenscube(&words);
        assert_error_line(&result, USAGE, &["SCENE", "which this command reads"]);
        assert_eq!(std::fs::read(output).unwrap(), before);
    }
}

#[test]
fn a_scene_is_of_its_lens_and_notes_the_error_of_colours() {
    let place = Place::new();
    let (mesh, out, film) = (place.mesh(), place.at("scene.zarr"), place.at("film.zarr"));
    scene(&mesh, &out, "60x40", &["--quiet", "--sheets", "1", "--samples-per-px", "4"]).ok();
    let run =
        |flags: &[&str]| lenscube(&[&["run", text(&out), text(&film), "--lens", "phone"], flags].concat());
    let other = run(&["--focus-m", "0.5", "--wavelengths", "550"]);
    assert_error_line(&other, USAGE, &["was made for a lens of f_D", "--focus-m"]);
    assert!(!film.exists());
    // One band cannot represent colours: a note, and the nearest.
    assert_exit(
        &run(&["--focus-m", "1", "--wavelengths", "550", "--tails", "off"]),
        0,
        &["colours are in error"],
    );
    let info = lenscube(&[&["scene", text(&mesh), "--info"], &VIEW[..], &["60x40"]].concat()).ok();
    for expected in
        ["triangles               530 in 2 parts", "1 closed", "3 weights with spectra red, green, blue"]
    {
        assert!(info.stdout.contains(expected), "{expected}: {}", info.stdout);
    }
    let materials = lenscube(&[&["scene", text(&mesh), "--materials"], &VIEW[..], &["60x40"]].concat()).ok();
    assert!(
        materials.stdout.contains("grey") && materials.stdout.contains("0.600 0.000 0.000"),
        "{}",
        materials.stdout
    );
}

/// `run` of a mesh makes the scene, the film of it, and removes the scene; a killed one is resumed by the same command.
#[test]
fn a_film_is_made_of_a_mesh_in_one_command() {
    let place = Place::new();
    let (mesh, out, film) = (place.mesh(), place.at("scene.zarr"), place.at("film.zarr"));
    let bands = ["--wavelengths", "500,600", "--quiet"];
    scene(&mesh, &out, "120x90", &["--quiet", "--sun", "30,40"]).ok();
    let lens = ["--lens", "phone", "--focus-m", "1"];
    lenscube(&[&["run", text(&out), text(&film)], &lens[..], &bands].concat()).ok();
    let direct = place.at("direct.zarr");
    let run = |fault: &str, flags: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        command
            .args(["run", text(&mesh), text(&direct)])
            .args(VIEW)
            .args(["120x90", "--sun", "30,40"])
            .args(bands)
            .args(flags);
        CommandResult::new(&command.env("LENSCUBE_FAULT", fault).output().unwrap())
    };
    let beside = place.at("direct.zarr.scene");
    for fault in ["scene-shard:2:kill", "film-opened:1:kill", "commit:2:kill"] {
        assert!(run(fault, &[]).code != 0, "{fault}");
        assert!(beside.exists(), "{fault}");
    }
    run("", &["--keep-scene"]).ok();
    assert_eq!(bits(&pixels(&direct, "film").1), bits(&pixels(&film, "film").1));
    assert!(files(&beside) == files(&out));
    run("", &[]).ok();
    assert!(!beside.exists());
    // Of the complete film no shard of the scene is made.
    run("scene-shard:1:kill", &[]).ok();
    run("scene-shard:1:kill", &["--pyramid"]).ok();
    assert!(!beside.exists());
    let other =
        lenscube(&[&["run", text(&mesh), text(&direct)], &VIEW[..], &["120x90", "--center", "1,0"]].concat());
    assert_error_line(&other, USAGE, &["--center does not apply to a mesh"]);
    let chart = lenscube(&[
        "run",
        "gen:uniform?size=8",
        text(&place.at("c.zarr")),
        "--eye",
        "0,0,0",
        "--target",
        "0,0,1",
    ]);
    assert_error_line(&chart, USAGE, &["flags of meshes", "gen:uniform"]);
    let planned =
        lenscube(&["plan", text(&mesh), text(&place.at("p.zarr")), "-o", text(&place.at("job.json"))]);
    assert_error_line(&planned, USAGE, &["is a mesh", "lenscube scene"]);
}

/// A signal while the lens is traced, after the scene, ends the command at once.
#[test]
fn a_signal_while_the_lens_is_traced_ends_the_command() {
    let place = Place::new();
    let (mesh, film) = (place.mesh(), place.at("film.zarr"));
    let run = |fault: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        let flags = ["60x40", "--wavelengths", "551.5", "--tails", "off"];
        command.args(["run", text(&mesh), text(&film)]).args(VIEW).args(flags);
        command.env("XDG_CACHE_HOME", place.at("cache")).env("LENSCUBE_FAULT", fault);
        CommandResult::new(&command.output().unwrap())
    };
    for signal in ["terminate", "interrupt"] {
        let stopped = run(&format!("tracing:1:{signal}"));
        assert_exit(&stopped, INTERRUPTED, &["stopped; the same command resumes"]);
        assert!(!stopped.stderr.contains("after the tiles in progress"), "{}", stopped.stderr);
        assert!(!film.exists() && place.at("film.zarr.scene").exists());
    }
    run("").ok();
    assert!(film.exists() && !place.at("film.zarr.scene").exists());
}

/// A film is of the scene that it was made of: another light, or an edited mesh, is another job.
#[test]
fn a_film_of_another_mesh_or_light_is_another_job() {
    let place = Place::new();
    let (mesh, film) = (place.mesh(), place.at("film.zarr"));
    let run = |sun: &str, film: &str| {
        let words =
            [&["run", text(&mesh), film], &VIEW[..], &["60x40", "--wavelengths", "550", "--sun", sun]]
                .concat();
        lenscube(&words)
    };
    run("30,40,50000", text(&film)).ok();
    assert_exit(&run("30,40,50000", text(&film)), 0, &["nothing to do"]);
    // The weights are doubled: files of the same names and, compressed, perhaps of the same sizes.
    assert_exit(&run("30,40,100000", text(&film)), OTHER_JOB, &["belongs to another job"]);
    std::fs::remove_dir_all(place.at("film.zarr.scene")).unwrap();
    std::fs::write(place.at("room.mtl"), "newmtl grey\nKd 0.25 0.25 0.25\nnewmtl red\nKd 0.6 0 0\n").unwrap();
    let slash = format!("{}/", text(&film));
    assert_exit(&run("30,40,50000", &slash), OTHER_JOB, &["belongs to another job"]);
    assert!(place.at("film.zarr.scene").exists() && !film.join(".scene").exists());
    // Other bands are named, not all that differs with them.
    std::fs::remove_dir_all(place.at("film.zarr.scene")).unwrap();
    place.mesh();
    let words = [
        &["run", text(&mesh), text(&film)],
        &VIEW[..],
        &["60x40", "--wavelengths", "560", "--sun", "30,40,50000"],
    ];
    let bands = lenscube(&words.concat());
    assert_exit(&bands, OTHER_JOB, &["wavelengths (film [550.0], requested [560.0])"]);
    assert!(bands.stderr.lines().last().unwrap().len() < 600, "{}", bands.stderr);
    // A film that cannot be made is refused before the scene is.
    let other = place.at("other.zarr");
    std::fs::create_dir(&other).unwrap();
    std::fs::write(other.join("zarr.json"), "{\"zarr_format\": 3, \"node_type\": \"group\"}").unwrap();
    assert!(run("30,40,50000", text(&other)).code != 0);
    assert!(!place.at("other.zarr.scene").exists());
}

/// A floor whose corners are behind the camera and far before it is seen nearer than any corner: the chart has the margin of its blur.
#[test]
fn surfaces_between_corners_count_for_the_margin() {
    let place = Place::new();
    let mut obj = Obj::default();
    let corners = [[-20.0, -0.3, 2.0], [20.0, -0.3, 2.0], [20.0, -0.3, -30.0], [-20.0, -0.3, -30.0]];
    let [a, b, c, d] = corners.map(|corner| obj.vertex(corner));
    writeln!(obj.text, "f {a} {b} {c} {d}").unwrap();
    let floor = place.at("floor.obj");
    std::fs::write(&floor, obj.text).unwrap();
    let overscan = |flags: &[&str]| {
        let words = [&["scene", text(&floor), "--info"], &VIEW[..], &["600x600"], flags].concat();
        let info = lenscube(&words).ok().stdout;
        let line = info.lines().find(|line| line.contains("beyond the film")).unwrap().to_owned();
        line.split("px, ").nth(1).unwrap().split(' ').next().unwrap().parse::<usize>().unwrap()
    };
    // The nearest point seen is about 0.3 / tan 24° = 0.67 m away.
    assert!(overscan(&[]) >= overscan(&["--depths-m", "0.6:30"]) - 1, "{}", overscan(&[]));
    let wrong = [&["scene", text(&floor), "--info"], &VIEW[..], &["600x600", "--depths-m", "5:30"]].concat();
    assert_error_line(&lenscube(&wrong), USAGE, &["--depths-m", "is seen, nearer than 5.0000 m"]);
}

/// Weights of 16 bits are those of 32, rounded; both options belong to the job; the film of such a scene.
#[test]
fn weights_of_16_bits_and_numbers_of_objects_are_of_the_job() {
    let place = Place::new();
    let (mesh, whole, small) = (place.mesh(), place.at("whole.zarr"), place.at("small.zarr"));
    let flags = ["--samples-per-px", "4", "--quiet", "--sun", "150,40"];
    let both = [&flags[..], &["--half", "--ids"]].concat();
    scene(&mesh, &whole, "120x90", &flags).ok();
    for fault in ["scene-shard:3:kill", "commit:2:kill"] {
        let mut command = command(&mesh, &small, "120x90", &both);
        assert!(!command.env("LENSCUBE_FAULT", fault).output().unwrap().status.success(), "{fault}");
    }
    scene(&mesh, &small, "120x90", &[&both[..], &["--threads", "1"]].concat()).ok();
    let again = place.at("again.zarr");
    scene(&mesh, &again, "120x90", &[&both[..], &["--threads", "2"]].concat()).ok();
    assert!(files(&small) == files(&again));
    for array in ["weights", "hidden/1/weights"] {
        let (expected, found) = (pixels(&whole, array).1, pixels(&small, array).1);
        let mut lit = 0;
        for (a, b) in expected.iter().flatten().zip(found.iter().flatten()) {
            // Half a unit of the last of 11 bits; below 2^-14 the step is 2^-24.
            assert!((a - b).abs() <= (a.abs() / 2048.0).max(1.0 / (1 << 25) as f32), "{array}: {a} {b}");
            lit += usize::from(*b > 0.0);
        }
        assert!(lit > 1000 || array != "weights", "{lit}");
    }
    assert_eq!(bits(&pixels(&whole, "depth").1), bits(&pixels(&small, "depth").1));
    assert!(small.join("object/c/0/0").is_file() && !whole.join("object").exists());
    assert_exit(&lenscube(&["verify", text(&small)]), 0, &["16 shards", "0 defects"]);
    assert_exit(&scene(&mesh, &small, "120x90", &[&flags[..], &["--half"]].concat()), OTHER_JOB, &["ids"]);
    assert_exit(&scene(&mesh, &whole, "120x90", &both), OTHER_JOB, &["half", "ids"]);
    let film = |scene: &Path, film: &str| {
        let film = place.at(film);
        let lens = ["--lens", "phone", "--focus-m", "1", "--wavelengths", "500,600", "--quiet"];
        lenscube(&[&["run", text(scene), text(&film)], &lens[..]].concat()).ok();
        pixels(&film, "film").1
    };
    let (a, b) = (film(&whole, "a.zarr"), film(&small, "b.zarr"));
    let peak = a.iter().flatten().fold(0.0f32, |m, v| m.max(*v));
    // The absolute sum of the weights of the bicubic interpolation is below 1.3 of 2^-11.
    assert!(a.iter().flatten().zip(b.iter().flatten()).all(|(a, b)| (a - b).abs() <= peak / 1575.0));
    assert!(bits(&a) != bits(&b));
}

/// `status` and `verify` name a scene; one that is made is no mesh; a sun below the horizon has a note.
#[test]
fn other_commands_name_a_scene() {
    let place = Place::new();
    let (mesh, out) = (place.mesh(), place.at("scene.zarr"));
    let made = scene(&mesh, &out, "60x40", &["--samples-per-px", "1", "--sun", "10,-5"]);
    assert_exit(&made, 0, &["5 deg below the horizon"]);
    assert_exit(
        &lenscube(&["status", text(&out), "--check"]),
        0,
        &["scene, complete: 15 of 15 shards; 3 surfaces of 3 weights"],
    );
    std::fs::remove_file(out.join("hidden/2/depth/c/0/0")).unwrap();
    let found = lenscube(&["status", text(&out), "--check"]);
    assert_exit(&found, WRONG, &["incomplete: 14 of 15 shards", "missing hidden/2/depth/c/0/0"]);
    let json: serde_json::Value =
        serde_json::from_str(&lenscube(&["status", text(&out), "--json"]).ok().stdout).unwrap();
    assert_eq!(
        (&json["complete"], &json["shards_done"], &json["weights"]),
        (&false.into(), &14.into(), &3.into())
    );
    assert_error_line(
        &scene(&out, &place.at("b.zarr"), "60x40", &[]),
        USAGE,
        &["is a scene already", "lenscube run"],
    );
}

/// A film is complete only for the lens that it was made with: a file of a lens that was written again is read.
#[test]
fn a_lens_that_was_written_again_is_compared() {
    let place = Place::new();
    let (mesh, film, design) = (place.mesh(), place.at("film.zarr"), place.at("phone.csv"));
    lenscube(&["lens", "convert", "phone", text(&design)]).ok();
    let run = || {
        let words = ["run", text(&mesh), text(&film), "--wavelengths", "550"];
        let view = VIEW.map(|word| if word == "phone" { text(&design) } else { word });
        lenscube(&[&words[..], &view, &["60x40"]].concat())
    };
    run().ok();
    let found = run();
    assert_exit(&found, 0, &["nothing to do"]);
    assert!(!found.stderr.contains("scene of"), "{}", found.stderr);
    std::fs::write(&design, std::fs::read(&design).unwrap()).unwrap();
    assert_exit(&run(), 0, &["scene of", "nothing to do"]);
}

/// Of two commands that replace a scene at once, each makes it or ends with one line that says to wait or to repeat.
#[test]
fn two_commands_that_replace_a_scene_lose_nothing() {
    let place = Place::new();
    let (mesh, out) = (place.mesh(), place.at("scene.zarr"));
    let flags = ["--samples-per-px", "1", "--quiet", "--overwrite"];
    scene(&mesh, &out, "60x40", &flags).ok();
    let expected = files(&out);
    for _ in 0..12 {
        let start = || {
            let mut command = command(&mesh, &out, "60x40", &flags);
            command.stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped()).spawn().unwrap()
        };
        let results = [start(), start()].map(|child| CommandResult::new(&child.wait_with_output().unwrap()));
        assert!(results.iter().any(|result| result.code == 0), "{} {}", results[0].stderr, results[1].stderr);
        for result in results.iter().filter(|result| result.code != 0) {
            assert_eq!((result.code, result.stderr.lines().count()), (RETRY, 1), "{}", result.stderr);
            let is_clear = ["is locked by process", "run the same command again"]
                .iter()
                .any(|t| result.stderr.contains(t));
            assert!(is_clear, "{}", result.stderr);
        }
        assert!(files(&out) == expected);
    }
}
