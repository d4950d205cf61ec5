//! Scenes of meshes: values, bytes for any threads and memory, kills, refusals, the film of a scene.

mod environment;
mod projection;
mod refusals;
mod run;
mod store;
mod values;

use crate::common::{CommandResult, assert_error_line, assert_exit, bits, files, lenscube, pixels, text};
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
