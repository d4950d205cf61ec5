//! Sensors of two conversion gains and of companding converters: their raws develop as those of linear numbers.

use super::USAGE;
use crate::common::assert_exit;
use crate::common::camera::{IRRADIANCE, Place, attributes, develop, frame, sensor, window};
use crate::common::{files, lenscube};
use formats::chart::image::{ImageFile, Transfer};
use pipeline::geometry::{Rect, Size};
use std::path::{Path, PathBuf};

const SENSOR: &str = "example-2um";
const SIZE: Size = Size::new(40, 400);
/// 12 bits in 10: 8 numbers of the light in one above 512.
const COMPANDED: [&str; 6] = [
    "--set",
    "adc.bits=10",
    "--set",
    "companding.linear_dn=[0, 512, 4096]",
    "--set",
    "companding.coded_dn=[0, 512, 960]",
];
/// Two readings of 12 bits, 2 and 0.25 DN/e-.
const DUAL: [&str; 12] = [
    "--set",
    "adc.bits=16",
    "--set",
    "adc.gain_dn_per_e=2",
    "--set",
    "dual_gain.ratio=8",
    "--set",
    "dual_gain.bits=12",
    "--set",
    "dual_gain.read_noise_e=6",
    "--set",
    "dual_gain.transition_dn=[3000, 3400]",
];

/// A film whose light rises along its rows by a factor of 10,000.
fn film(place: &Place) -> PathBuf {
    let level = |x: usize| 1e-5 * 10f32.powf(4.0 * x as f32 / 399.0);
    place.film(SIZE, &[450.0, 550.0, 650.0], IRRADIANCE, |_, _, x| level(x))
}

fn raw(place: &Place, name: &str, film: &Path, flags: &[&[&str]]) -> PathBuf {
    place.raw(name, film, &[&["--sensor", SENSOR][..], &flags.concat()].concat())
}

fn green(raw: &Path, flags: &[&str]) -> Vec<f64> {
    let picture = raw.with_extension("exr");
    let own = ["--matrix", "none", "--demosaic", "bilinear", "--white", "1,1,1", "--overwrite"];
    develop(raw, &picture, &[&own[..], flags].concat()).ok();
    let pixels = ImageFile::open(&picture).unwrap().linear_part(Transfer::Linear, SIZE.rect()).unwrap();
    pixels[SIZE.pixels()..2 * SIZE.pixels()].iter().map(|v| f64::from(*v)).collect()
}

#[test]
fn companded_raws_develop_as_linear_ones_within_half_a_step() {
    let place = Place::new();
    let film = film(&place);
    let still = ["--exposure", "2ms", "--noise", "none"];
    let linear = raw(&place, "linear.zarr", &film, &[&still]);
    let coded = raw(&place, "coded.zarr", &film, &[&still, &COMPANDED]);
    let numbers = frame(&coded, "raw", 0).1;
    assert!(numbers.iter().all(|v| *v <= 960) && numbers.iter().any(|v| *v < 270) && numbers.contains(&956));
    let of = attributes(&coded);
    let curve = &of["companding"];
    assert_eq!(
        (of["black_dn"].as_f64(), curve["black_coded_dn"].as_f64(), curve["white_coded_dn"].as_f64()),
        (Some(256.0), Some(256.0), Some(956.0))
    );
    // Shares of the range of 3808 DN: half a number of either, and half a step of the curve.
    for (a, b) in std::iter::zip(green(&linear, &[]), green(&coded, &[])) {
        let step = if 256.0 + a * 3808.0 < 500.0 { 1.0 } else { 8.0 };
        assert!((a - b).abs() * 3808.0 <= 0.5 + 0.5 * step + 1e-2, "{a} {b}");
    }
    // A window, a kept signal and other threads have the bits of the whole, noise included.
    let noisy = ["--exposure", "2ms,4ms"];
    let whole = raw(&place, "whole.zarr", &film, &[&noisy, &COMPANDED, &["--keep-signal"]]);
    let part =
        raw(&place, "part.zarr", &film, &[&noisy, &COMPANDED, &["--roi", "90,3,50,30", "--threads", "1"]]);
    let (size, pixels) = frame(&whole, "raw", 1);
    assert_eq!(frame(&part, "roi_0", 1).1, window(size, &pixels, Rect::new(3, 90, 30, 50)));
    let direct = raw(&place, "direct.zarr", &film, &[&["--exposure", "3ms"], &COMPANDED]);
    let again = place.at("again.zarr");
    sensor(&whole, &again, &["--exposure", "3ms"]).ok();
    assert!(files(&again) == files(&direct));
    assert_exit(&sensor(&film, &direct, &["--sensor", SENSOR, "--exposure", "3ms"]), 3, &["another job"]);
}

#[test]
fn brackets_of_two_gains_and_companding_merge_to_the_light() {
    let place = Place::new();
    let film = film(&place);
    for (name, flags) in [("companded", &COMPANDED[..]), ("dual", &DUAL[..])] {
        let out = raw(&place, &format!("{name}.zarr"), &film, &[&["--exposure", "64ms,8ms,0.5ms"], flags]);
        let merged = green(&out, &["--merge"]);
        let mean = |x: usize| (4..36).map(|y| merged[y * SIZE.width + x]).sum::<f64>() / 32.0;
        let light = |x: usize| 10f64.powf(4.0 * x as f64 / 399.0);
        let scale = mean(200) / light(200);
        for x in [80, 120, 160, 240, 280, 320, 340] {
            let ratio = mean(x) / (scale * light(x));
            assert!((ratio - 1.0).abs() < 0.04, "{name} {x}: {ratio}");
        }
    }
}

#[test]
fn descriptions_and_files_name_the_range() {
    let place = Place::new();
    let film = film(&place);
    let shown = lenscube(&[&["sensor", "show", SENSOR][..], &COMPANDED, &DUAL[4..]].concat()).ok();
    for words in [
        "dual gain         1:8 in two readings of 12 bits",
        "companding        0 -> 0, 512 -> 512, 4096 -> 960 DN",
    ] {
        assert!(shown.stdout.contains(words), "{}", shown.stdout);
    }
    let flags = |more: &[&'static str]| [&["--sensor", SENSOR, "--exposure", "2ms"], more].concat();
    // Coded numbers with their table, type SHORT, 1024 of them.
    let dng = place.at("coded.dng");
    sensor(&film, &dng, &flags(&COMPANDED)).ok();
    let file = std::fs::read(&dng).unwrap();
    let at = file.windows(8).position(|w| *w == [0x18, 0xc6, 3, 0, 0, 4, 0, 0]).expect("LinearizationTable");
    let first = u32::from_le_bytes(file[at + 8..at + 12].try_into().unwrap()) as usize;
    let entry = |k: usize| u16::from_le_bytes([file[first + 2 * k], file[first + 2 * k + 1]]);
    assert_eq!([0, 511, 513, 960, 1023].map(entry), [0, 511, 520, 4096, 4096]);
    let wide =
        ["--set", "companding.linear_dn=[0, 4096, 1048575]", "--set", "companding.coded_dn=[0, 2048, 4095]"];
    assert_exit(
        &sensor(&film, &place.at("no.dng"), &flags(&wide)),
        USAGE,
        &["LinearizationTable", "65535", ".zarr"],
    );
    for (set, expected) in [
        (
            &["companding.coded_dn=[0, 512, 4096]"][..],
            "linear_dn: expected as many numbers as coded_dn, 2 to 64, found 0 and 3",
        ),
        (&["companding.linear_dn=[0, 512]", "companding.coded_dn=[0, 512, 960]"], "as many numbers"),
        (&["companding.linear_dn=[0, 512, 512]", "companding.coded_dn=[0, 9, 960]"], "ascend from 0"),
        (&["companding.linear_dn=[0, 512, 9000]", "companding.coded_dn=[0, 9, 4096]"], "at most 4095"),
        (&["companding.linear_dn=[0, 512, 3e7]", "companding.coded_dn=[0, 9, 960]"], "at most 16777215"),
        (&["companding.linear_dn=[0, 512, 600]", "companding.coded_dn=[0, 9, 960]"], "951 for 88"),
        (&["dual_gain.ratio=8"], "dual_gain.bits: expected 1 to 16, found 0"),
        (&["dual_gain={ratio=0.5, bits=12, transition_dn=[300, 400]}"], "dual_gain.ratio"),
    ] {
        let sets: Vec<&str> = set.iter().flat_map(|set| ["--set", set]).collect();
        let no =
            sensor(&film, &place.at("no"), &[&["--sensor", SENSOR, "--exposure", "2ms"], &sets[..]].concat());
        assert_exit(&no, USAGE, &[expected]);
        assert!(!place.at("no").exists());
    }
    for (set, expected) in [
        ("dual_gain.ratio=0.5", "dual_gain.ratio: expected the high conversion gain over the low one"),
        ("dual_gain.bits=17", "dual_gain.bits: expected 1 to 16"),
        ("dual_gain.transition_dn=[3400, 3000]", "ascending, below its last of 4095 DN"),
        ("dual_gain.transition_dn=[3400, 4095]", "ascending, below its last of 4095 DN"),
        ("dual_gain.transition_dn=[200, 3000]", "numbers above the black of 256 DN"),
        ("adc.black_dn=4095", "adc.black_dn: expected 0 to 4094"),
    ] {
        let all = [&["--sensor", SENSOR, "--exposure", "2ms"], &DUAL[..], &["--set", set]].concat();
        assert_exit(&sensor(&film, &place.at("no"), &all), USAGE, &[expected]);
    }
}
