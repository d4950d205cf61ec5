//! The same bits in windows, from a kept signal, on any number of threads; and those of the float64 model.

use super::USAGE;
use crate::common::camera::{IRRADIANCE, Place, frame, sensor, window, write_film};
use crate::common::{Noise, assert_exit, files};
use formats::chart::{ChartOptions, ChartStore};
use formats::sensor::SensorFile;
use pipeline::geometry::{Rect, Size};
use pipeline::sensor::noise::Exposer;
use pipeline::sensor::{Exposure, NoiseSet};
use serde_json::Value;
use std::path::Path;

/// CRC-32 as of zip.
pub fn crc32(bytes: impl Iterator<Item = u8>) -> u32 {
    !bytes.fold(!0, |crc: u32, byte| {
        (0..8).fold(crc ^ u32::from(byte), |c, _| if c & 1 == 1 { c >> 1 ^ 0xedb8_8320 } else { c >> 1 })
    })
}

#[test]
fn windows_threads_and_memory_give_the_same_bits() {
    let place = Place::new();
    let film = place.noise(Size::new(300, 400));
    for (name, pitch) in [("cmv12000-rgb", "4.7"), ("example-2um", "2.0")] {
        let whole = place.at(&format!("{name}-whole"));
        let pitch = format!("pixel.pitch_um={pitch}");
        let flags = |more: &[&'static str]| -> Vec<String> {
            let own =
                ["--sensor", name, "--set", &pitch, "--exposure", "10ms,20ms", "--seed", "9", "--threads"];
            own.iter().chain(more).map(|w| (*w).to_string()).collect()
        };
        let run = |raw: &Path, more: &[&'static str]| {
            let flags = flags(more);
            sensor(&film, raw, &flags.iter().map(String::as_str).collect::<Vec<_>>()).ok()
        };
        run(&whole, &["2"]);
        let part = place.at(&format!("{name}-part"));
        run(&part, &["1", "--memory", "200MiB", "--roi", "31,17,60,50", "--roi", "0,0,5,7"]);
        for f in 0..2 {
            let (size, pixels) = frame(&whole, "raw", f);
            for (array, rect) in [("roi_0", Rect::new(17, 31, 50, 60)), ("roi_1", Rect::new(0, 0, 7, 5))] {
                assert!(frame(&part, array, f).1 == window(size, &pixels, rect), "{name} {array} frame {f}");
            }
        }
        let other = place.at(&format!("{name}-other"));
        run(&other, &["7"]);
        assert!(files(&other) == files(&whole));
    }
}

#[test]
fn a_kept_signal_gives_the_raw_of_the_film() {
    let place = Place::new();
    let film = place.noise(Size::new(200, 300));
    let (kept, direct, again) = (place.at("kept"), place.at("direct"), place.at("again"));
    let own = ["--sensor", "cmv12000-rgb"];
    sensor(&film, &kept, &[&own[..], &["--exposure", "10ms", "--keep-signal"]].concat()).ok();
    let second = ["--exposure", "3ms", "--gain", "2", "--seed", "4", "--frames", "2"];
    sensor(&film, &direct, &[&own[..], &second].concat()).ok();
    sensor(&kept, &again, &second).ok();
    assert!(files(&again) == files(&direct));
    let auto = place.at("auto");
    sensor(&kept, &auto, &["--exposure", "auto"]).ok();
    let from_film = place.at("auto-film");
    sensor(&film, &from_film, &[&own[..], &["--exposure", "auto"]].concat()).ok();
    assert!(files(&auto) == files(&from_film));
    assert_exit(
        &sensor(&kept, &place.at("no"), &["--exposure", "1", "--sensor", "sony-a7r2"]),
        USAGE,
        &["another sensor"],
    );
    assert_exit(&sensor(&direct, &place.at("no"), &["--exposure", "1"]), USAGE, &["--keep-signal"]);
}

/// The float64 model's signals within one unit in the last place of f32, and the bits of its raws.
#[test]
fn signals_and_raws_equal_those_of_the_float64_model() {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/sensor");
    let file: Value = serde_json::from_slice(&std::fs::read(golden.join("cases.json")).unwrap()).unwrap();
    let bytes = std::fs::read(golden.join("signal.bin")).unwrap();
    let mut signals = bytes.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b));
    let nm: Vec<f64> = serde_json::from_value(file["bands_nm"].clone()).unwrap();
    let place = Place::new();
    for (k, case) in file["cases"].as_array().unwrap().iter().enumerate() {
        let pair =
            |key: &str| (case[key][0].as_u64().unwrap() as usize, case[key][1].as_u64().unwrap() as usize);
        let (film_size, size) = (pair("film"), pair("size"));
        let number = |v: &Value| v.as_f64().unwrap();
        let expected: Vec<f32> = signals.by_ref().take(size.0 * size.1).collect();
        let (film, raw) = (place.at(&format!("film-{k}")), place.at(&format!("raw-{k}")));
        let mut noise = Noise(case["seed"].as_u64().unwrap());
        let pitch_um = number(&case["film_pitch_um"]);
        write_film(&film, Size::new(film_size.0, film_size.1), &nm, (pitch_um, IRRADIANCE), |_, _, _| {
            noise.next() * 1e-3f32
        });
        let name = case["sensor"].as_str().unwrap();
        let centre =
            format!("{},{}", number(&case["centre_um"][1]) * 1e-3, number(&case["centre_um"][0]) * 1e-3);
        let flags = [
            "--sensor",
            name,
            "--exposure",
            "1ms",
            "--keep-signal",
            "--center",
            &centre,
            "--size",
            &format!("{}x{}", size.1, size.0),
            "--resample",
            case["resample"].as_str().unwrap(),
        ];
        sensor(&film, &raw, &flags).ok();
        let store = ChartStore::open_at(&raw, "signal", ChartOptions::default()).unwrap();
        let mut got = vec![0.0; expected.len()];
        store.read_rect(0, Rect::new(0, 0, size.0, size.1), &mut got).unwrap();
        let ulp = |(a, b): (&f32, &f32)| (i64::from(a.to_bits()) - i64::from(b.to_bits())).unsigned_abs();
        let worst = std::iter::zip(&got, &expected).map(ulp).max().unwrap();
        assert!(worst <= 1, "case {k}, {name}: {worst} units in the last place");
        let own = SensorFile::open(name, &[]).unwrap().sensor(pitch_um);
        let exposure = Exposure {
            seconds: number(&case["seconds"]),
            gain: number(&case["gain"]),
            scale: 1.0,
            seed: case["noise_seed"].as_u64().unwrap(),
            die: case["die"].as_u64().unwrap(),
            frame: case["frame"].as_u64().unwrap() as u32,
            noise: NoiseSet::ALL,
            temperature_c: None,
            flicker: None,
        };
        let mut numbers = vec![0; expected.len()];
        Exposer::new(&own, &exposure).expose(&expected, Rect::new(0, 0, size.0, size.1), &mut numbers);
        let crc = crc32(numbers.iter().flat_map(|v| v.to_le_bytes()));
        assert_eq!(format!("{crc:08x}"), case["raw_crc32"].as_str().unwrap(), "case {k}, {name}");
    }
}
