//! Shading by the angle of incidence, undone.

use super::linear;
use crate::common::camera::{Place, develop, sensor};
use formats::chart::image::Transfer;
use std::path::{Path, PathBuf};

/// A sensor whose red filter accepts a narrower cone, without noise.
const SENSOR: [&str; 18] = [
    "--sensor",
    "example-2um",
    "--set",
    "pixel.pitch_um=film",
    "--set",
    "adc.bits=16",
    "--set",
    "adc.gain_dn_per_e=4",
    "--set",
    "angle.stack_index=1.5",
    "--set",
    "angle.acceptance_deg=30",
    "--set",
    "angle.filters.R.acceptance_deg=22",
    "--exposure",
    "auto:0.5",
    "--noise",
    "none",
];
const SIDE: usize = 80;

/// A film of even light by the phone lens, with its relative illumination.
fn film(place: &Place) -> PathBuf {
    let film = place.at("film.zarr");
    let chart = format!("gen:uniform?size={SIDE}&pitch_um=35&wavelengths=450,550,650");
    crate::common::run(&chart, &film, "phone", &["--stages", "ri,distortion"]).ok();
    film
}

fn developed(place: &Place, raw: &Path, name: &str, more: &[&str]) -> Vec<Vec<f32>> {
    let out = place.at(name);
    let flags = ["--matrix", "none", "--white", "1,1,1", "--demosaic", "superpixel"];
    develop(raw, &out, &[&flags[..], more].concat()).ok();
    linear(&out, Transfer::Linear).1
}

#[test]
fn lens_shading_undoes_the_response_of_each_filter_over_the_sensor() {
    let place = Place::new();
    let film = film(&place);
    let raw = place.raw("raw.zarr", &film, &SENSOR);
    let plain = developed(&place, &raw, "plain.exr", &[]);
    let even = developed(&place, &raw, "even.exr", &["--shading", "phone"]);
    let side = SIDE / 2;
    let middle = side * side / 2 + side / 2;
    for (channel, (plain, even)) in plain.iter().zip(&even).enumerate() {
        // The corner has less light of every colour, least red.
        let corner = plain[0] / plain[middle];
        assert!(corner < if channel == 0 { 0.35 } else { 0.5 }, "{channel}: {corner}");
        for v in even {
            assert!((v / even[middle] - 1.0).abs() < 3e-3, "{channel}: {v} {}", even[middle]);
        }
    }
    // A window, and one of other phases of the mosaic, are shaded as the whole.
    let other = place.raw("signal.zarr", &film, &[&SENSOR[..], &["--keep-signal"]].concat());
    let exposure = crate::common::camera::attributes(&raw)["provenance"]["job"].clone();
    assert!(exposure.is_object());
    let again = place.at("again.zarr");
    sensor(&other, &again, &["--exposure", "auto:0.5", "--noise", "none"]).ok();
    assert_eq!(developed(&place, &again, "again.exr", &["--shading", "phone"]), even);
}

#[test]
fn negatives_have_gain_maps_of_that_response() {
    let place = Place::new();
    let film = film(&place);
    let (dng, plain) = (place.at("a.dng"), place.at("plain.dng"));
    sensor(&film, &dng, &SENSOR).ok();
    let file = std::fs::read(&dng).unwrap();
    // Four maps, each of opcode 9, version 1.3, optional.
    let head = [0, 0, 0, 4, 0, 0, 0, 9, 1, 3, 0, 0, 0, 0, 0, 1];
    let at = file.windows(head.len()).position(|w| w == head).expect("a list of opcodes");
    let whole = |offset: usize| u32::from_be_bytes(file[at + offset..][..4].try_into().unwrap()) as usize;
    let points = (whole(20 + 32), whole(20 + 36));
    assert_eq!(points, (33, 33));
    let gain = |map: usize, k: usize| f32::from_bits(whole(20 + map * (16 + whole(16)) + 76 + 4 * k) as u32);
    let (corner, middle) = (0, points.0 * points.1 / 2);
    // RGGB: red is first.
    for map in 0..4 {
        assert!((1.0..1.1).contains(&gain(map, middle)), "{map}: {}", gain(map, middle));
        let corner = gain(map, corner);
        let expected = if map == 0 { 2.3..4.0 } else { 1.6..2.2 };
        assert!(expected.contains(&corner), "{map}: {corner}");
    }
    let without: Vec<&str> =
        SENSOR.chunks(2).filter(|flag| !flag[1].starts_with("angle.")).flatten().copied().collect();
    sensor(&film, &plain, &without).ok();
    let file = std::fs::read(&plain).unwrap();
    assert!(!file.windows(head.len()).any(|w| w == head));
}
