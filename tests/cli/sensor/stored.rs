//! Raws of each part of the sensor model have the bits that are stored here: a change of them is one that `CHANGELOG.md` names.

use super::bits::crc32;
use crate::common::camera::{IRRADIANCE, Place, frame};
use crate::common::{Noise, text};
use pipeline::geometry::Size;
use std::fs;

const ANGLES: [&str; 2] = ["angle.stack_index=1.5", "angle.file=cmv12000-angular.csv"];
const DIFFUSION: [&str; 2] = ["crosstalk.diffusion_length_um=10", "crosstalk.depletion_um=3"];
/// Name, settings and the checksum of the pixels. `MOTION` and `CRA` stand for files.
const CASES: [(&str, &[&str], &[&str], &str); 13] = [
    ("plain", &[], &[], "972f22af"),
    ("angles by a half width", &["angle.stack_index=1.5", "angle.acceptance_deg=20"], &["CRA"], "a17a2ac4"),
    ("angles by a table", &ANGLES, &["CRA"], "590f0704"),
    ("diffusion", &DIFFUSION, &[], "ca771dcc"),
    ("diffusion and angles", &[ANGLES[0], ANGLES[1], DIFFUSION[0], DIFFUSION[1]], &["CRA"], "d03f6d57"),
    (
        "knee and blooming",
        &["pixel.knee=0.8", "pixel.blooming=0.9", "pixel.full_well_e=2000"],
        &[],
        "b66cbb19",
    ),
    ("hot pixels", &["defects.hot_pixels=0.01", "defects.hot_dark_e_per_s=1e5"], &[], "ff79912d"),
    ("telegraph noise", &["defects.telegraph_pixels=0.01", "defects.telegraph_e=300"], &[], "b0c9dcc0"),
    ("flicker along the rows", &["shutter.row_time_us=50"], &["--flicker", "60:0.5"], "c7bd84d3"),
    ("spectra of noise", &["noise.row_noise_e=20", "noise_spectrum.row_exponent=1"], &[], "42eecd14"),
    (
        "two gains",
        &["adc.bits=16", "dual_gain={ratio=8, bits=12, read_noise_e=6, transition_dn=[300, 700]}"],
        &[],
        "80d0d8f5",
    ),
    ("companding", &["companding={linear_dn=[0, 512, 4095], coded_dn=[0, 512, 960]}"], &[], "dcc54f11"),
    ("motion", &[], &["--size", "100x60", "MOTION"], "e6ed6d01"),
];

#[test]
fn raws_of_each_part_have_their_bits() {
    let place = Place::new();
    let mut noise = Noise(5);
    let film =
        place.film(Size::new(96, 131), &[450.0, 550.0, 650.0], IRRADIANCE, |_, _, _| 2e-3 * noise.next());
    let files = [
        ("MOTION", "--motion", "time_s,x_um,y_um,rotation_deg\n0,0,0,0\n0.01,9,-3,0.5\n"),
        ("CRA", "--chief-ray-angles", "height_mm,cra_deg,f_number\n0,0,2.8\n0.1,12,2.9\n0.2,30,3.1\n"),
    ];
    for (name, _, content) in files {
        fs::write(place.at(name), content).unwrap();
    }
    let mut found = Vec::new();
    for (name, settings, flags, _) in &CASES {
        let mut words: Vec<String> =
            ["--sensor=example-2um", "--exposure=10ms", "--seed=3"].map(String::from).to_vec();
        words.extend(settings.iter().map(|setting| format!("--set={setting}")));
        for flag in *flags {
            match files.iter().find(|file| file.0 == *flag) {
                Some((file, flag, _)) => words.push(format!("{flag}={}", text(&place.at(file)))),
                None => words.push((*flag).into()),
            }
        }
        let words: Vec<&str> = words.iter().map(String::as_str).collect();
        let raw = place.raw(&format!("{name}.zarr"), &film, &words);
        let crc = crc32(frame(&raw, "raw", 0).1.iter().flat_map(|dn| dn.to_le_bytes()));
        found.push((*name, format!("{crc:08x}")));
    }
    let expected = CASES.map(|(name, _, _, crc)| (name, crc.to_owned()));
    assert_eq!(found, expected);
    assert!((0..found.len()).all(|k| found[..k].iter().all(|other| other.1 != found[k].1)));
}
