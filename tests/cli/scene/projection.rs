//! Scenes in the projection of the film: fisheyes.

use super::{OTHER_JOB, Obj, Place, USAGE};
use crate::common::{CommandResult, assert_error_line, assert_exit, lenscube, pixels, text};
use formats::lens::LensPack;
use pipeline::lens::linear;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Flags of lens, film and camera; the film's corners are 50° from the axis.
const FISHEYE: [&str; 15] = [
    "--lens",
    "fisheye-170",
    "--focus-m",
    "inf",
    "--film-size",
    "300x200",
    "--film-pitch-um",
    "25",
    "--mesh-unit",
    "m",
    "--eye",
    "0,0,0",
    "--target",
    "0,0,-1",
    "--quiet",
];
const LENS: [&str; 9] =
    ["--lens", "fisheye-170", "--focus-m", "inf", "--wavelengths", "587.6", "--tails", "off", "--quiet"];

/// A film that is tilted.
const TOLERANCES: &str = "[[film]]\ntilt_arcmin = 5\n[criterion]\nkind = \"rms-spot\"\n";

/// Distance of the patches, m: in focus.
const FAR_M: f64 = 1e4;

/// A bright square patch of 1.5° at `angle_deg` to the right, its middle on the ray.
fn patch(obj: &mut Obj, angle_deg: f64) {
    let tan = angle_deg.to_radians().tan();
    let (half_x, half_y) = (0.013 * FAR_M * (1.0 + tan * tan), 0.013 * FAR_M * (1.0 + tan * tan).sqrt());
    let (x, z) = (tan * FAR_M, -FAR_M);
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    let [a, b, c, d] = corners.map(|[u, v]| obj.vertex([x + u * half_x, v * half_y, z]));
    writeln!(obj.text, "f {a} {b} {c} {d}").unwrap();
}

fn scene_of(place: &Place, name: &str, angles_deg: &[f64]) -> PathBuf {
    let mut obj = Obj::default();
    angles_deg.iter().for_each(|angle| patch(&mut obj, *angle));
    let path = place.at(name);
    std::fs::write(&path, obj.text).unwrap();
    path
}

fn make(mesh: &Path, out: &Path, flags: &[&str]) -> CommandResult {
    lenscube(&[&["scene", text(mesh), text(out), "--samples-per-px", "64"], &FISHEYE[..], flags].concat())
}

/// Centroid of the light of a film 300 px wide within 18 px of the column `middle_px`, px from its middle, and that light.
fn spot(film: &[f32], middle_px: f64) -> (f64, f64) {
    let (mut sum, mut moment) = (0.0, 0.0);
    for (i, v) in film.iter().enumerate() {
        let x = (i % 300) as f64 - 149.5;
        if (x - middle_px).abs() <= 18.0 {
            (sum, moment) = (sum + f64::from(*v), moment + x * f64::from(*v));
        }
    }
    (moment / sum, sum)
}

/// Patches land where the lens's own table puts their angles, as those of a planar chart do, and have the same light.
#[test]
fn patches_land_where_the_lens_puts_their_angles() {
    let place = Place::new();
    let pack = place.at("fisheye.lens.zarr");
    let trace =
        ["lens", "trace", "fisheye-170", text(&pack), "--wavelengths", "587.6", "--film-pitch-um", "25"];
    lenscube(&[&trace[..], &["--quiet"]].concat()).ok();
    let lens = LensPack::open(&pack).unwrap();
    let (focal_mm, band) = (lens.lens().distortion_focal_length_mm, &lens.lens().bands[0]);
    let angles = [0.0, 12.0, 24.0, 36.0];
    let mesh = scene_of(&place, "patches.obj", &angles);
    let mut films = Vec::new();
    for projection in ["film", "planar"] {
        let scene = place.at(&format!("{projection}.zarr"));
        // Before a faint wall, so that all pixels are covered and a partly lit one has the mean of its light.
        make(&mesh, &scene, &["--projection", projection, "--background", "0.001"]).ok();
        let (size, _) = pixels(&scene, "depth");
        assert_eq!(size.width < 300 + 2 * 16, projection == "film", "{}", size.width);
        let out = place.at(&format!("{projection}-film.zarr"));
        lenscube(&[&["run", text(&scene), text(&out)], &LENS[..]].concat()).ok();
        let (size, mut film) = pixels(&out, "film");
        assert_eq!((size.width, size.height), (300, 200));
        films.push(film.swap_remove(0));
    }
    for angle in angles {
        let h = focal_mm * angle.to_radians().tan();
        let expected = linear(&band.ideal_height_mm, &band.image_height_mm, h) / 25e-3;
        let [(at, light), (planar_at, planar_light)] = [0, 1].map(|k: usize| spot(&films[k], expected));
        assert!((at - expected).abs() < 0.05, "{angle}: {at} px, expected {expected}");
        assert!((at - planar_at).abs() < 0.08, "{angle}: {at} px, planar {planar_at}");
        assert!((light / planar_light - 1.0).abs() < 0.01, "{angle}: {light}, planar {planar_light}");
    }
}

/// A scene of 73° in the corners: refused as a planar chart many times the film, and made in the projection of the film.
#[test]
fn wide_fields_need_the_projection_of_the_film() {
    let place = Place::new();
    let (mesh, out) = (scene_of(&place, "patches.obj", &[0.0, 40.0]), place.at("scene.zarr"));
    let wide: Vec<&str> =
        FISHEYE.iter().map(|word| if *word == "300x200" { "320x320" } else { word }).collect();
    let run = |flags: &[&str]| lenscube(&[&["scene", text(&mesh), text(&out)], &wide[..], flags].concat());
    assert_error_line(&run(&[]), USAGE, &["times its pixels", "--projection film"]);
    assert!(!out.exists());
    run(&["--projection", "film"]).ok();
    assert_error_line(&run(&["--projection", "planar", "--samples-per-px", "1"]), OTHER_JOB, &["scene"]);
    let (size, depth) = pixels(&out, "depth");
    assert!(size.width < 320 + 2 * 16 && depth[0].iter().any(|z| *z > 9e3));
    lenscube(&["verify", text(&out), "--quiet"]).ok();
    let info = run(&["--projection", "film", "--info"]).ok().stdout;
    assert!(info.contains("projection of the film"), "{info}");
    // The film's corners see 85 degrees; with the margin they would see more than 90.
    let whole: Vec<&str> = wide
        .iter()
        .map(|w| if *w == "320x320" { "353x353" } else { w })
        .filter(|w| *w != "--quiet")
        .collect();
    let near = ["--projection", "film", "--depths-m", "1:inf"];
    let whole = lenscube(&[&["scene", text(&mesh), text(&place.at("w.zarr"))], &whole[..], &near].concat());
    assert_exit(&whole, 0, &["px beyond the film", "89.5 deg"]);
    // Beyond the field there is no projection.
    let beyond: Vec<&str> =
        wide.iter().map(|word| if *word == "320x320" { "400x400" } else { word }).collect();
    let beyond = lenscube(
        &[&["scene", text(&mesh), text(&place.at("b.zarr"))], &beyond[..], &["--projection", "film"]]
            .concat(),
    );
    assert_error_line(&beyond, 1, &["the film's border", "--film-size"]);
}

/// A film through drawn errors has a map of its own, which is of planar charts.
#[test]
fn lenses_without_symmetry_refuse_the_projection_of_the_film() {
    let place = Place::new();
    let (mesh, out) = (scene_of(&place, "patches.obj", &[0.0]), place.at("scene.zarr"));
    make(&mesh, &out, &["--projection", "film"]).ok();
    let tolerances = place.at("tol.toml");
    std::fs::write(&tolerances, TOLERANCES).unwrap();
    let film = place.at("film.zarr");
    let run = ["run", text(&out), text(&film), "--depth", "none", "--tolerances", text(&tolerances)];
    let run = lenscube(&[&run[..], &LENS[..8]].concat());
    assert_error_line(&run, USAGE, &["projection of the film", "rotational symmetry", "--projection planar"]);
    assert!(!film.exists());
}
