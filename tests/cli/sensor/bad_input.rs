//! Bad input: one clear error, or a warning with figures and ways out.

use super::{OTHER_JOB, USAGE, WRONG};
use crate::common::camera::{IRRADIANCE, Place, develop, sensor, write_film};
use crate::common::{assert_exit, files, lenscube, text};
use formats::film::{Codec, FilmSpec, FilmStore};
use pipeline::geometry::Size;
use serde_json::{Value, json};
use std::path::PathBuf;

#[test]
fn bad_input_is_one_clear_error() {
    let place = Place::new();
    let film = place.noise(Size::new(60, 60));
    let bad = |flags: &[&str], words: &[&str]| {
        let raw = place.at("never");
        assert_exit(&sensor(&film, &raw, flags), USAGE, words);
        assert!(!raw.exists(), "{flags:?}");
    };
    bad(&["--exposure", "1ms"], &["--sensor", "cmv12000-rgb"]);
    bad(&["--sensor", "cmv12000-rbg", "--exposure", "1ms"], &["did you mean `cmv12000-rgb`"]);
    let with = |name: &'static str, flags: &[&'static str]| [&["--sensor", name][..], flags].concat();
    bad(&with("example-2um", &[]), &["--exposure"]);
    for time in ["0", "-1", "3601", "soon", "auto:2"] {
        bad(
            &with("example-2um", &[&*Box::leak(format!("--exposure={time}").into_boxed_str())]),
            &["--exposure"],
        );
    }
    bad(&with("cmv12000-rgb", &["--exposure", "1ms", "--gain", "1.5"]), &["gains 1, 2, 3, 4"]);
    bad(&with("cmv12000-rgb", &["--exposure", "1ms", "--iso", "400"]), &["base_iso"]);
    bad(&with("example-2um", &["--exposure", "1ms", "--iso", "50"]), &["gains 1 to 64"]);
    bad(&with("example-2um", &["--exposure", "1ms", "--gain", "1e300"]), &["gain 1e300: ", "gains 1 to 64"]);
    bad(&with("example-2um", &["--exposure", "auto", "--roi", "0,0,5,5"]), &["--roi", "whole sensor"]);
    bad(&with("example-2um", &["--exposure", "1ms", "--roi", "0,0,61,5"]), &["is not inside the sensor"]);
    bad(&with("example-2um", &["--exposure", "1ms", "--size", "61"]), &["reaches beyond the film", "mm"]);
    bad(
        &with("example-2um", &["--exposure", "1ms", "--center", "0.01,0", "--size", "60"]),
        &["reaches beyond"],
    );
    bad(&with("cmv12000-rgb", &["--exposure", "1ms", "--size", "native"]), &["reaches beyond the film"]);
    bad(&with("ideal-mono", &["--exposure", "1ms", "--size", "native"]), &["no size of its own"]);
    bad(
        &with("example-2um", &["--exposure", "1ms", "--set", "pixel.pitch_um=1.0"]),
        &["--coarse-film", "--film-pitch-um 1"],
    );
    bad(&with("example-2um", &["--exposure", "1ms,2ms", "--frames", "9000"]), &["18000 frames"]);
    bad(&with("example-2um", &["--exposure", "1ms", "--noise", "loud"]), &["unknown noise source"]);
    bad(&with("example-2um", &["--exposure", "1ms", "--film-lux", "100"]), &["relative films"]);
    let white_is_black =
        ["--set", "adc.bits=8", "--set", "adc.black_dn=254", "--set", "adc.gain_dn_per_e=1e-6"];
    bad(
        &with("example-2um", &[&["--exposure", "1ms"], &white_is_black[..]].concat()),
        &["adc.gain_dn_per_e", "1 DN above the black of 254 DN"],
    );
    bad(&with("example-2um", &["--exposure", "1ms", "--memory", "50MiB"]), &["too small", "at least"]);
    let kept = place.at("kept.zarr");
    sensor(&film, &kept, &with("example-2um", &["--exposure", "1ms", "--keep-signal"])).ok();
    let again = sensor(&kept, &place.at("no"), &["--exposure", "1ms", "--film-scale", "2"]);
    assert_exit(&again, USAGE, &["--film-scale is for relative films"]);
    let raw = place.at("raw.exr");
    assert_exit(
        &sensor(&film, &raw, &with("example-2um", &["--exposure", "1ms"])),
        USAGE,
        &["lenscube develop"],
    );
    let inside = film.join("raw");
    assert_exit(
        &sensor(&film, &inside, &with("example-2um", &["--exposure", "1ms"])),
        USAGE,
        &["lies in the film"],
    );
    let other = sensor(&film, &film, &with("example-2um", &["--exposure", "1ms"]));
    assert_exit(&other, USAGE, &["is the film"]);
    std::fs::create_dir(place.at("mine")).unwrap();
    std::fs::write(place.at("mine/notes.txt"), "mine").unwrap();
    assert_exit(
        &sensor(&film, &place.at("mine"), &with("example-2um", &["--exposure", "1ms"])),
        OTHER_JOB,
        &["nothing was changed"],
    );
    assert_exit(
        &sensor(&place.at("nowhere"), &place.at("no"), &with("example-2um", &["--exposure", "1ms"])),
        1,
        &["nowhere"],
    );
    let infrared = place.at("infrared.film");
    write_film(&infrared, Size::new(9, 9), &[900.0, 1000.0], (2.0, IRRADIANCE), |_, _, _| 1.0);
    assert_exit(
        &sensor(&infrared, &place.at("no"), &with("example-2um", &["--exposure", "1ms"])),
        USAGE,
        &["900 nm", "outside all curves"],
    );
    // A film that is not complete, and one with NaN, are failures.
    let shard = film.join("film/c/1/0/0");
    std::fs::remove_file(&shard).unwrap();
    assert_exit(
        &sensor(&film, &place.at("no"), &with("example-2um", &["--exposure", "1ms"])),
        1,
        &["1 of 3 shards are missing", "lenscube run"],
    );
}

/// A shard without compression whose sample is replaced by NaN, its checksum made again.
fn film_with_nan(place: &Place, (row, column): (usize, usize)) -> PathBuf {
    let path = place.at("nan.film");
    let spec = FilmSpec {
        units: IRRADIANCE.into(),
        shard: 64,
        chunk: 64,
        codec: Codec::None,
        ..FilmSpec::full_film(Size::new(64, 64), vec![450.0, 550.0, 650.0], 2.0)
    };
    let Value::Object(provenance) = json!({"job_digest": "a", "layout_digest": "b"}) else { unreachable!() };
    let film = FilmStore::create(&path, spec, provenance, false).unwrap();
    for (output, band, shard) in film.all_shards().collect::<Vec<_>>() {
        film.commit(&film.encode_shard(output, band, shard, &[1e-3; 64 * 64]).unwrap()).unwrap();
    }
    let shard = path.join("film/c/1/0/0");
    let mut bytes = std::fs::read(&shard).unwrap();
    let (samples, at) = (64 * 64 * 4, (row * 64 + column) * 4);
    bytes[at..at + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    let crc32c = !bytes[..samples].iter().fold(!0, |crc: u32, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |c, _| if c & 1 == 1 { c >> 1 ^ 0x82f6_3b78 } else { c >> 1 })
    });
    bytes[samples..samples + 4].copy_from_slice(&crc32c.to_le_bytes());
    std::fs::write(&shard, bytes).unwrap();
    path
}

#[test]
fn nan_in_a_film_is_named_by_its_place() {
    let place = Place::new();
    let film = film_with_nan(&place, (31, 17));
    let raw = place.at("raw");
    let ran = sensor(&film, &raw, &["--sensor", "example-2um", "--exposure", "1ms"]);
    assert_exit(&ran, 1, &["NaN", "band 1", "row 31", "column 17", "lenscube verify"]);
    // The raw that was begun stays incomplete.
    assert_exit(&lenscube(&["status", text(&raw), "--check"]), WRONG, &["incomplete"]);
}

/// A sensor that responds beyond the film's bands only; a raw in place of a chart, and one that has lost its sensor.
#[test]
fn blind_sensors_and_raws_without_sensor_are_refused() {
    let place = Place::new();
    let film = place.noise(Size::new(20, 20));
    let toml = place.at("blind.toml");
    std::fs::write(place.at("blind.csv"), "wavelength_nm,Y\n300,0\n800,0\n900,0.5\n").unwrap();
    let description = "schema = \"lenscube/sensor/1\"\nname = \"blind\"\ndescription = \"infrared\"\n\
        [pixel]\npitch_um = 2.0\nfull_well_e = 1000\n[noise]\n[adc]\nbits = 10\ngain_dn_per_e = 0.5\nblack_dn = 64\n\
        [spectral]\nfile = \"blind.csv\"\nquantity = \"quantum_efficiency\"\n[cfa]\npattern = [[\"Y\"]]\n\
        Y = { column = \"Y\", plane = \"Y\" }\n[source]\n\"*\" = \"assumed\"\n";
    std::fs::write(&toml, description).unwrap();
    let flags = ["--sensor", text(&toml), "--exposure", "1ms"];
    assert_exit(&sensor(&film, &place.at("never"), &flags), USAGE, &["blind", "no response in its bands"]);
    std::fs::write(place.at("blind.csv"), "wavelength_nm,Y\n300,0\n800,10\n900,50\n").unwrap();
    assert_exit(&sensor(&film, &place.at("never"), &flags), USAGE, &["blind.csv", "did you mean percent"]);
    assert!(!place.at("never").exists());
    let raw = place.raw("raw.zarr", &film, &["--sensor", "example-2um", "--exposure", "1ms"]);
    let export = lenscube(&["export", text(&raw), text(&place.at("no.png"))]);
    assert_exit(&export, USAGE, &["is a raw of a sensor", "lenscube develop"]);
    let group = raw.join("zarr.json");
    let mut metadata: Value = serde_json::from_slice(&std::fs::read(&group).unwrap()).unwrap();
    metadata["attributes"].as_object_mut().unwrap().remove("sensor");
    std::fs::write(&group, metadata.to_string()).unwrap();
    assert_exit(&develop(&raw, &place.at("no.png"), &[]), USAGE, &["does not describe its sensor"]);
}

#[test]
fn warnings_name_figures_and_ways_out() {
    let place = Place::new();
    let film = place.film(Size::new(60, 60), &[450.0, 550.0, 650.0], IRRADIANCE, |_, _, _| 1.0);
    let bright = sensor(
        &film,
        &place.at("bright"),
        &["--sensor", "cmv12000-mono", "--set", "pixel.pitch_um=2.5", "--exposure", "1s"],
    );
    assert_exit(&bright, 0, &["warning: share of each filter's response", "not aligned", "clipped at white"]);
    let flags = ["--sensor", "cmv12000-mono", "--set", "adc.black_dn=2", "--exposure", "1e-9"];
    assert_exit(&sensor(&film, &place.at("dim"), &flags), 0, &["black is 2 DN", "no pixel is above 10 %"]);
    // Light below 0, as interpolation may leave it, and a sensor whose dark current exceeds the light.
    let negative =
        place.film_named("negative", Size::new(60, 60), |_, y, _| if y < 30 { -1e-3 } else { 1e-3 });
    let flags = ["--sensor", "example-2um", "--exposure", "1ms"];
    let ran = sensor(&negative, &place.at("negative.raw"), &flags);
    assert_exit(&ran, 0, &["warning: 1800 pixels (50.000 %) of negative light count as 0"]);
    let dark = place.film_named("dark", Size::new(60, 60), |_, _, _| 1e-9);
    let flags = ["--sensor", "example-2um", "--exposure", "1s", "--temperature", "80"];
    assert_exit(
        &sensor(&dark, &place.at("dark.raw"), &flags),
        0,
        &["warning: dark current of", "exceeds the signal's median"],
    );
}

/// What fails before the first pixel leaves a raw that was to be replaced.
#[test]
fn a_failed_overwrite_keeps_the_raw() {
    let place = Place::new();
    let film = place.noise(Size::new(40, 40));
    let raw = place.raw("raw.zarr", &film, &["--sensor", "example-2um", "--exposure", "1ms"]);
    let before = files(&raw);
    let dark = place.film_named("dark.film", Size::new(40, 40), |_, _, _| 0.0);
    let relative = place.at("relative.film");
    write_film(&relative, Size::new(40, 40), &[550.0], (2.0, "relative"), |_, _, _| 0.0);
    let nan = film_with_nan(&place, (3, 4));
    let own = ["--sensor", "example-2um", "--overwrite"];
    for (film, flags, code) in [
        (&film, &["--exposure", "1ms,2ms", "--frames", "9000"][..], USAGE),
        (&dark, &["--exposure", "auto"], USAGE),
        (&relative, &["--exposure", "1ms", "--film-lux", "10"], USAGE),
        (&nan, &["--exposure", "auto"], 1),
    ] {
        assert_eq!(sensor(film, &raw, &[&own[..], flags].concat()).code, code, "{flags:?}");
        assert!(files(&raw) == before, "{flags:?}");
    }
    sensor(&film, &raw, &[&own[..], &["--exposure", "2ms"]].concat()).ok();
    assert!(files(&raw) != before);
}
