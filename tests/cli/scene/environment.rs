//! Light by a map of all directions: on surfaces, and behind them.

use super::{OTHER_JOB, Obj, Place, USAGE, plane, scene};
use crate::common::{assert_error_line, assert_exit, text};
use formats::picture::image::Image;
use pipeline::geometry::Size;
use std::path::PathBuf;

/// A picture of 360 x 180 degrees, 8 bits, of grey levels by column.
fn picture(place: &Place, name: &str, size: Size, level: impl Fn(usize) -> u8) -> PathBuf {
    let mut image = Image::new(size, [0; 3]);
    for y in 0..size.height {
        for (x, pixel) in image.row_mut(y).iter_mut().enumerate() {
            *pixel = [level(x); 3];
        }
    }
    let path = place.at(name);
    image.write_png(&path, "").unwrap();
    path
}

fn ball(place: &Place) -> PathBuf {
    let mut obj = Obj::default();
    obj.ball([0.0, 0.0, -3.0], 0.2);
    let path = place.at("ball.obj");
    std::fs::write(&path, obj.text).unwrap();
    path
}

const SIZE: Size = Size::new(32, 64);
const QUICK: [&str; 4] = ["--quiet", "--samples-per-px", "4", "--environment"];

/// White of 3000 lx on the ground has it on every open surface: three times the reflectance, for an illuminance of 1000 lx, in the light of each primary.
#[test]
fn a_white_map_lights_all_sides() {
    let place = Place::new();
    let (mesh, out) = (place.mesh(), place.at("scene.zarr"));
    let white = picture(&place, "white.png", SIZE, |_| 255);
    let given = format!("{},3000", text(&white));
    scene(&mesh, &out, "120x90", &[&QUICK[..], &[&given]].concat()).ok();
    let (height, width, depth) = plane(&out, "depth", 0);
    let at = height / 2 * width + 2;
    assert_eq!(depth[at], 3.0);
    for basis in 0..12 {
        let weight = plane(&out, "weights", basis).2[at];
        // The wall reflects a half; the ball before it hides some of the directions.
        let expected = if basis < 3 { 0.0 } else { 1.5 };
        assert!((weight - expected).abs() <= 0.1 * expected, "{basis}: {weight}");
    }
    let dark = picture(&place, "dark.png", SIZE, |_| 128);
    let given = format!("{},3000", text(&dark));
    assert_exit(&scene(&mesh, &out, "120x90", &[&QUICK[..], &[&given]].concat()), OTHER_JOB, &[]);
    // Of the same illuminance by default, with --illuminance.
    let same = ["--illuminance", "3000", "--overwrite"];
    scene(&mesh, &out, "120x90", &[&QUICK[..], &[text(&white)], &same].concat()).ok();
    assert!((plane(&out, "weights", 3).2[at] - 0.5).abs() < 0.05);
}

/// Behind all surfaces the map is seen: a camera that looks north sees the east on its right, and turned by half a turn on its left.
#[test]
fn a_map_is_seen_behind_surfaces() {
    let place = Place::new();
    let (mesh, out) = (ball(&place), place.at("scene.zarr"));
    let east = picture(&place, "east.png", SIZE, |x| if x >= 32 { 255 } else { 0 });
    for (turn, is_right) in [("0", true), ("180", false)] {
        let flags =
            [text(&east), "--environment-azimuth", turn, "--background", "environment", "--overwrite"];
        scene(&mesh, &out, "120x90", &[&QUICK[..], &flags].concat()).ok();
        let (_, width, depth) = plane(&out, "depth", 0);
        let (.., red) = plane(&out, "weights", 0);
        let (left, right) = (5 * width + 5, 5 * width + width - 5);
        assert!(depth[left] >= 1e6 && depth[right] >= 1e6);
        // 1000 lx on the ground of half a sky: twice 1000/π cd/m², of which 1000/π has the weight 1.
        let (lit, dark) = if is_right { (right, left) } else { (left, right) };
        assert!((red[lit] - 2.0).abs() < 1e-3 && red[dark] == 0.0, "{turn}: {} {}", red[lit], red[dark]);
    }
}

#[test]
fn what_is_no_map_is_refused_before_work() {
    let place = Place::new();
    let (mesh, out) = (ball(&place), place.at("scene.zarr"));
    let square = picture(&place, "square.png", Size::new(32, 32), |_| 255);
    let black = picture(&place, "black.png", SIZE, |_| 0);
    let refused = |flags: &[&str], expected: &[&str]| {
        assert_error_line(&scene(&mesh, &out, "60x40", flags), USAGE, expected);
        assert!(!out.exists());
    };
    refused(&["--environment", text(&square)], &["32 x 32 pixels", "twice as many columns as rows"]);
    refused(&["--environment", text(&black)], &["dark above the horizon"]);
    let negative = format!("{},-3", text(&black));
    let negative = scene(&mesh, &out, "60x40", &["--environment", &negative]);
    assert_exit(&negative, USAGE, &["illuminance in lx above 0"]);
    refused(&["--background", "environment"], &["--environment"]);
    assert_exit(&scene(&mesh, &out, "60x40", &["--environment-azimuth", "30"]), USAGE, &["--environment <"]);
    let missing = scene(&mesh, &out, "60x40", &["--environment", "none.exr"]);
    assert!(missing.code != 0 && missing.stderr.contains("none.exr"), "{}", missing.stderr);
    assert!(!out.exists());
}
