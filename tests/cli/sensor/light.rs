//! What the numbers of a film mean, and automatic exposure.

use super::USAGE;
use crate::common::assert_exit;
use crate::common::camera::{IRRADIANCE, Place, attributes, frame, sensor, write_film};
use pipeline::geometry::Size;
use pipeline::sensor::HC_J_M;

#[test]
fn uniform_film_through_ideal_mono_counts_photons() {
    let place = Place::new();
    let film = place.film(Size::new(70, 90), &[540.0, 550.0, 560.0], IRRADIANCE, |_, _, _| 2e-2);
    let raw = place.at("raw.zarr");
    sensor(&film, &raw, &["--sensor", "ideal-mono", "--exposure", "1/50s", "--noise", "none"]).ok();
    let (size, pixels) = frame(&raw, "raw", 0);
    assert_eq!(size, Size::new(70, 90));
    // ∫ λ/(hc) dλ from 535 to 565 nm, on (2 µm)², for 20 ms.
    let photons = 2e-2 * (565e-9f64.powi(2) - 535e-9f64.powi(2)) / 2.0 / HC_J_M * 1e9 * 4e-12 * 0.02;
    let mean = pixels.iter().map(|v| f64::from(*v)).sum::<f64>() / size.pixels() as f64;
    assert!((mean - 1024.0 - 0.0625 * photons).abs() <= 0.5, "{mean}, {photons} photons");
}

/// Units of the film: the same light as irradiance, photons and radiance.
#[test]
fn films_of_every_unit_give_the_same_signal() {
    let nm = [500.0, 600.0];
    let place = Place::new();
    let raw_of = |name: &str, units: &str, factor: &dyn Fn(usize) -> f64, flags: &[&str]| {
        let (film, raw) = (place.at(&format!("{name}.film")), place.at(&format!("{name}.raw")));
        write_film(&film, Size::new(20, 20), &nm, (2.0, units), |b, y, x| {
            ((1 + y + x) as f64 * 1e-3 * factor(b)) as f32
        });
        let all = [&["--sensor", "example-2um", "--exposure", "10ms", "--noise", "none"][..], flags].concat();
        sensor(&film, &raw, &all).ok();
        frame(&raw, "raw", 0).1
    };
    let irradiance = raw_of("irradiance", IRRADIANCE, &|_| 1.0, &[]);
    let near = |other: Vec<u16>| std::iter::zip(&irradiance, other).all(|(a, b)| a.abs_diff(b) <= 1);
    assert!(near(raw_of("photons", "s-1 nm-1", &|b| nm[b] * 1e-9 / HC_J_M * 4e-12, &[])));
    let omega = 0.8 * std::f64::consts::PI / (4.0 * 2.8 * 2.8);
    let lens = ["--f-number", "2.8", "--transmission", "0.8"];
    assert!(near(raw_of("radiance", "W m-2 sr-1 nm-1", &|_| 1.0 / omega, &lens)));
    assert!(near(raw_of("relative", "relative", &|_| 10.0, &["--film-scale", "0.1"])));
    let film = place.at("radiance.film");
    assert_exit(
        &sensor(&film, &place.at("no"), &["--sensor", "example-2um", "--exposure", "1"]),
        USAGE,
        &["--f-number"],
    );
    let film = place.at("relative.film");
    let plain = sensor(&film, &place.at("no"), &["--sensor", "example-2um", "--exposure", "1"]);
    assert_exit(&plain, USAGE, &["--film-lux", "--film-scale", "--exposure auto"]);
    // 100 lx on the mean of the sensor: two films of other scales give one raw.
    let lux = ["--film-lux", "100"];
    let one = raw_of("lux-1", "relative", &|_| 1.0, &lux);
    let ten = raw_of("lux-10", "relative", &|_| 8.0, &lux);
    assert!(one == ten && one.iter().any(|v| *v > 300));
}

/// A film of the built-in charts needs nothing but a time.
#[test]
fn a_chart_of_radiance_is_exposed_without_another_word() {
    let place = Place::new();
    let (film, raw) = (place.at("film.zarr"), place.at("raw.zarr"));
    let chart = "gen:uniform?size=64&pitch_um=2&wavelengths=500,600";
    crate::common::run(chart, &film, "double-gauss-28-npz", &["--stages", "ri"]).ok();
    let film_attributes = attributes(&film);
    let band = &film_attributes["provenance"]["bands"][0];
    assert!(band["solid_angle_sr"].as_f64().unwrap() > 0.0 && band["transmission"].as_f64().unwrap() > 0.0);
    sensor(&film, &raw, &["--sensor", "example-2um", "--exposure", "40ms"]).ok();
    assert!(frame(&raw, "raw", 0).1.iter().all(|v| *v > 300));
}

/// 99.9 % of the pixels stay below 0.9 of saturation, and not by much.
#[test]
fn automatic_exposure_fills_the_well() {
    let place = Place::new();
    let film = place.noise(Size::new(300, 300));
    let raw = place.at("raw");
    assert_exit(
        &sensor(&film, &raw, &["--sensor", "example-2um", "--exposure", "auto", "--noise", "none"]),
        0,
        &["exposure "],
    );
    let a = attributes(&raw);
    let (black, white) = (a["black_dn"].as_f64().unwrap(), a["white_dn"].as_f64().unwrap());
    let mut pixels = frame(&raw, "raw", 0).1;
    pixels.sort_unstable();
    let at = f64::from(pixels[(0.999 * pixels.len() as f64) as usize - 1]);
    let filled = (at - black) / (white - black);
    assert!(filled <= 0.9005 && filled > 0.899, "{filled}");
    let faint = place.film_named("faint.film", Size::new(30, 30), |_, _, _| 1e-14);
    let flags = ["--sensor", "example-2um", "--exposure", "auto"];
    assert_exit(&sensor(&faint, &place.at("no"), &flags), USAGE, &["at most 3600 s"]);
    let ran = sensor(&film, &place.at("low"), &[&flags[..3], &["auto:0.05"]].concat()).ok();
    assert!(
        ran.stderr.contains("no pixel is above 10 %") && ran.stderr.contains("auto:FILL"),
        "{}",
        ran.stderr
    );
    let dark = place.at("dark.film");
    write_film(&dark, Size::new(30, 30), &[500.0], (2.0, IRRADIANCE), |_, _, _| 0.0);
    assert_exit(
        &sensor(&dark, &place.at("no"), &["--sensor", "example-2um", "--exposure", "auto"]),
        USAGE,
        &["dark"],
    );
}
