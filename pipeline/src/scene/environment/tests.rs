//! Maps against their directions and integrals.

use super::*;
use crate::scene::horizon::UpAxis;
use crate::scene::light::{LightRequest, Lighting, Site};
use crate::scene::test_mesh::POSE;

fn horizon() -> Horizon {
    Horizon::new(&POSE, UpAxis::Y)
}

/// A map of the colours of (row, column).
fn map((height, width): (usize, usize), colour: impl Fn(usize, usize) -> [f32; 3]) -> Environment {
    let values = (0..height * width).flat_map(|i| colour(i / width, i % width)).collect();
    Environment::of_colours((height, width), values, 1.0, horizon()).unwrap()
}

fn background(map: &Environment, direction: [f64; 3]) -> Vec<f64> {
    let mut sums = vec![0.0; map.channels()];
    map.add_background(direction, &mut sums);
    sums
}

/// Light on a place of this normal in units of 1000 lx.
fn light(map: Environment, normal: [f64; 3]) -> Vec<f64> {
    let request = LightRequest {
        illuminance_lx: 1000.0,
        sun: None,
        sky_lx: None,
        lights: &[],
        unit_m: 1.0,
        environment: Some(map),
        sky_samples: 64,
    };
    let lighting = Lighting::new(request, &POSE, &horizon()).unwrap();
    let site = Site { start: [0.0; 3], geometric: normal, shading: normal };
    let mut sums = vec![0.0; lighting.spectra().len()];
    lighting.add(&site, |_| false, &mut sums);
    sums
}

#[test]
fn columns_are_bearings_and_rows_elevations() {
    // Red: row, green: column.
    let map = map((8, 16), |r, c| [r as f32, c as f32, 0.0]);
    for (row, column) in [(0, 0), (3, 4), (4, 7), (7, 15)] {
        let azimuth = 360.0 * (column as f64 + 0.5) / 16.0;
        let elevation = 90.0 - 180.0 * (row as f64 + 0.5) / 8.0;
        let found = background(&map, horizon().direction(azimuth, elevation));
        assert!(
            (found[0] - row as f64).abs() < 1e-12 && (found[1] - column as f64).abs() < 1e-12,
            "{found:?}"
        );
    }
    // The middle is +Z, a quarter +X, the first row up, the seam at −Z between the last and the first column.
    for (direction, expected) in [
        ([0.0, 0.0, 2.0], [3.5, 7.5]),
        ([0.5, 0.0, 0.0], [3.5, 3.5]),
        ([0.0, 1.0, 1e-9], [0.0, 7.5]),
        ([0.0, 0.0, -1.0], [3.5, 7.5]),
    ] {
        let found = background(&map, direction);
        assert!((found[0] - expected[0]).abs() < 1e-6 && (found[1] - expected[1]).abs() < 1e-6, "{found:?}");
    }
}

#[test]
fn an_even_map_lights_as_an_open_sky() {
    let even = map((200, 399), |_, _| [500.0, 250.0, 0.0]);
    let found = light(even, [0.6, 0.0, -0.8]);
    // π·500 cd/m² are 1571 lx.
    let expected = [0.0, PI * 0.5, PI * 0.25, 0.0];
    assert!(found.iter().zip(expected).all(|(f, e)| (f - e).abs() < 1e-12), "{found:?}");
}

#[test]
fn the_luminance_of_colours_is_a_factor() {
    let map = Environment::of_colours((1, 1), vec![1.0, 2.0, 3.0], 10.0, horizon()).unwrap();
    assert_eq!(background(&map, [0.0, 0.0, 1.0]), [10.0, 20.0, 30.0]);
}

#[test]
fn half_a_map_lights_half() {
    // The upper half: straight up all of it, a wall half of it.
    let half = || map((256, 512), |r, _| [if r < 128 { 1000.0 } else { 0.0 }; 3]);
    let of = |normal| light(half(), normal)[1] / PI;
    // The bilinear step at the horizon is 5.6° wide; cos is small there for a surface that faces up.
    assert!((of([0.0, 1.0, 0.0]) - 1.0).abs() < 0.01, "{}", of([0.0, 1.0, 0.0]));
    assert!((of([0.0, 0.0, 1.0]) - 0.5).abs() < 0.03, "{}", of([0.0, 0.0, 1.0]));
    assert!(of([0.0, -1.0, 0.0]) < 0.01);
}

#[test]
fn means_have_the_power_of_the_map() {
    // Luminance times solid angle of a pixel of 0.35°, and of the cells of its means.
    for ((height, width), row) in [((512, 1024), 100), ((512, 1024), 256), ((311, 777), 4), ((20, 50), 7)] {
        let source = map((height, width), |r, c| [if (r, c) == (row, 30) { 1e6 } else { 0.0 }; 3]);
        let solid_angle = |row: usize, (height, width): (usize, usize)| {
            let edge = |r: usize| (PI * (0.5 - r as f64 / height as f64)).sin();
            (edge(row) - edge(row + 1)) * 2.0 * PI / width as f64
        };
        let size = (source.means.height, source.means.width);
        assert_eq!(size, (height.min(32), width.min(64)));
        let cells = source.means.values.chunks_exact(3).enumerate();
        let found: f64 = cells.map(|(i, v)| f64::from(v[1]) * solid_angle(i / size.1, size)).sum();
        let expected = 1e6 * solid_angle(row, (height, width));
        // Rows at the pole that two cells share are divided by angle.
        assert!((found / expected - 1.0).abs() < 0.01, "{height}, row {row}: {found}, expected {expected}");
    }
}

#[test]
fn bands_are_radiances() {
    let map =
        Environment::of_bands((2, 3), vec![450.0, 550.0], (0..12).map(|v| v as f32).collect(), horizon())
            .unwrap();
    assert!(map.is_spectral() && map.channels() == 2);
    assert_eq!(map.light_spectra().len(), 2);
    let even = Environment::of_bands((1, 1), vec![450.0, 550.0], vec![0.25, 4.0], horizon()).unwrap();
    assert_eq!(light(even, [0.0, 1.0, 0.0]), [0.0, 0.25, 4.0]);
}

#[test]
fn maps_that_are_none_are_errors() {
    let colours = |size, values: Vec<f32>| {
        Environment::of_colours(size, values, 1.0, horizon()).err().unwrap().to_string()
    };
    assert!(
        colours((2, 2), vec![0.0; 11]).contains("has 11 values; expected 2 rows of 2 pixels of 3 channels")
    );
    assert!(colours((0, 2), vec![]).contains("0 values"));
    assert!(colours((usize::MAX, 2), vec![0.0; 3]).contains("3 values"));
    let bad = vec![0.0, 0.0, 0.0, 0.0, f32::NAN, 0.0];
    assert_eq!(
        colours((1, 2), bad),
        "the environment is NaN at row 0, column 1, channel 1; radiances are finite and 0 or more"
    );
    assert!(colours((1, 1), vec![-1.0; 3]).contains("is -1 at row 0"));
    let bands = Environment::of_bands((1, 1), vec![550.0, 450.0], vec![0.0; 2], horizon()).err().unwrap();
    assert_eq!(
        bands.to_string(),
        "the bands of the environment at 550 and 450 nm are not in order of wavelength"
    );
}
