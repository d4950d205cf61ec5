//! Sensors whose response depends on the angle of incidence.

use super::USAGE;
use crate::common::camera::{IRRADIANCE, Place, frame, sensor, window, write_film};
use crate::common::{assert_exit, lenscube};
use pipeline::geometry::{Rect, Size};
use std::fs;
use std::path::{Path, PathBuf};

/// Black of the sensor, DN.
const BLACK: f64 = 1000.0;
/// Pixels of the film of the phone lens, and its pitch: chief rays of 26.8 degrees in the corners.
const SIDE: usize = 40;
const PITCH_UM: f64 = 70.0;

/// A sensor without noise, of one filter, with more fields.
fn description(place: &Place, name: &str, more: &str) -> PathBuf {
    let path = place.at(&format!("{name}.toml"));
    let text = format!(
        "schema = \"lenscube/sensor/1\"\nname = \"{name}\"\ndescription = \"a test\"\n[pixel]\npitch_um = \"film\"\nfull_well_e = 1e9\n\
         [adc]\nbits = 16\ngain_dn_per_e = 1.0\nblack_dn = {BLACK}\n[spectral]\nconstant = 1.0\n[cfa]\npattern = [[\"Y\"]]\nY = {{}}\n\
         {more}\n[source]\n\"*\" = \"a test\"\n"
    );
    fs::write(&path, text).unwrap();
    path
}

/// A film of even light by the phone lens, without its relative illumination.
fn film_of_phone(place: &Place) -> PathBuf {
    let film = place.at("phone.zarr");
    let chart = format!("gen:uniform?size={SIDE}&pitch_um={PITCH_UM}&wavelengths=500,600");
    crate::common::run(&chart, &film, "phone", &["--stages", "distortion"]).ok();
    film
}

/// A raw of `film` without noise, of 40,000 to 50,000 DN in perpendicular light.
fn raw_of(place: &Place, film: &Path, sensor_file: &Path, flags: &[&str]) -> (Size, Vec<u16>) {
    let raw = place.at("raw.zarr");
    let _ = fs::remove_dir_all(&raw);
    let file = sensor_file.to_str().unwrap();
    let exposure = if film.ends_with("phone.zarr") { "0.2us" } else { "60us" };
    let all = [&["--sensor", file, "--exposure", exposure, "--noise", "none"][..], flags].concat();
    sensor(film, &raw, &all).ok();
    let array = if flags.contains(&"--roi") { "roi_0" } else { "raw" };
    frame(&raw, array, 0)
}

/// Light of a pixel over that of `flat`.
fn share(pixels: &[u16], flat: &[u16], row: usize, column: usize) -> f64 {
    let of = |pixels: &[u16]| f64::from(pixels[row * SIDE + column]) - BLACK;
    of(pixels) / of(flat)
}

#[test]
fn corners_are_dark_unless_microlenses_are_shifted_for_the_lens() {
    let place = Place::new();
    let film = film_of_phone(&place);
    let flat = raw_of(&place, &film, &description(&place, "flat", ""), &[]).1;
    assert!(flat.iter().all(|v| *v > 40_000 && *v < 60_000), "{:?}", flat[0]);
    let angle = |microlenses: &str| {
        let more =
            format!("[angle]\nstack_index = 1.5\nacceptance_deg = 30\nmicrolenses = \"{microlenses}\"");
        description(&place, microlenses, &more)
    };
    let (size, centred) = raw_of(&place, &film, &angle("centred"), &[]);
    let shifted = raw_of(&place, &film, &angle("lens"), &[]).1;
    let middle = SIDE / 2;
    // In the middle both see the same cone of f/3: some per cent less than perpendicular light.
    for pixels in [&centred, &shifted] {
        let found = share(pixels, &flat, middle, middle);
        assert!((0.94..0.99).contains(&found), "{found}");
    }
    let corners = [(0, 0), (0, SIDE - 1), (SIDE - 1, 0), (SIDE - 1, SIDE - 1)];
    let shares = |pixels: &[u16]| corners.map(|(y, x)| share(pixels, &flat, y, x));
    for (dark, even) in shares(&centred).into_iter().zip(shares(&shifted)) {
        // 2^−(u(26.8°)/u(30°))² is 0.58 for the chief ray, u the slope in the layers.
        assert!((0.55..0.59).contains(&dark), "{dark}");
        assert!((0.95..1.0).contains(&even), "{even}");
    }
    // A window has the pixels of the whole.
    let rect = Rect::new(3, 21, 17, 19);
    let roi = raw_of(&place, &film, &angle("centred"), &["--roi", "21,3,19,17"]).1;
    assert_eq!(roi, window(size, &centred, rect));
}

#[test]
fn a_table_of_chief_rays_takes_the_place_of_the_lens() {
    let place = Place::new();
    let film = place.film(Size::new(SIDE, SIDE), &[500.0, 600.0], IRRADIANCE, |_, _, _| 0.3);
    let flat = raw_of(&place, &film, &description(&place, "flat", ""), &[]).1;
    let table = place.at("cra.csv");
    fs::write(&table, "height_mm,cra_deg,f_number\n0,0,2\n1,0,2\n").unwrap();
    let more = "[angle]\nstack_index = 4\nacceptance_deg = 20\n";
    let flags = ["--chief-ray-angles", table.to_str().unwrap()];
    let found = raw_of(&place, &film, &description(&place, "cone", more), &flags).1;
    // Mean of 2^−(u/u_½)² over the cone of sine 1/4, by rings of even area; u is the slope in the layers.
    let square = |sine_square: f64| sine_square / (16.0 - sine_square);
    let half = square(20f64.to_radians().sin().powi(2));
    let ring =
        |k: u32| (-(std::f64::consts::LN_2) * square((f64::from(k) + 0.5) / 1000.0 / 16.0) / half).exp();
    let expected = (0..1000).map(ring).sum::<f64>() / 1000.0;
    for (row, column) in [(0, 0), (20, 20), (39, 3)] {
        let share = share(&found, &flat, row, column);
        assert!((share - expected).abs() < 1e-4, "{row} {column}: {share} {expected}");
    }
}

#[test]
fn a_pack_with_cones_is_as_good_as_its_design() {
    let place = Place::new();
    let film = film_of_phone(&place);
    let more = "[angle]\nstack_index = 1.5\nacceptance_deg = 30";
    let sensor_file = description(&place, "s", more);
    let expected = raw_of(&place, &film, &sensor_file, &[]).1;
    let pack = place.at("phone.lens.zarr");
    let trace =
        ["lens", "trace", "phone", pack.to_str().unwrap(), "--wavelengths", "500,600", "--heights", "0,2.2"];
    lenscube(&[&trace[..], &["--cones", "--tails", "off"]].concat()).ok();
    let others = |name: &str, pack: &Path| {
        let film = place.at(name).join("phone.zarr");
        fs::create_dir_all(place.at(name)).unwrap();
        let chart = format!("gen:uniform?size={SIDE}&pitch_um={PITCH_UM}&wavelengths=500,600");
        crate::common::run(&chart, &film, pack.to_str().unwrap(), &["--stages", "distortion"]).ok();
        film
    };
    let found = raw_of(&place, &others("with", &pack), &sensor_file, &[]).1;
    assert!(found.iter().zip(&expected).all(|(a, b)| a.abs_diff(*b) <= 2));
    // Without the group the pack has another digest, and no directions.
    let without = place.at("without.lens.zarr");
    let trace = [
        "lens",
        "trace",
        "phone",
        without.to_str().unwrap(),
        "--wavelengths",
        "500,600",
        "--heights",
        "0,2.2",
    ];
    lenscube(&[&trace[..], &["--tails", "off"]].concat()).ok();
    let film = others("without", &without);
    let flags = ["--sensor", sensor_file.to_str().unwrap(), "--exposure", "1ms"];
    assert_exit(
        &sensor(&film, &place.at("no"), &flags),
        USAGE,
        &["gives no directions", "lens trace --cones"],
    );
    let designs = ["--cones", "--depths-m", "1:2"];
    assert_exit(
        &lenscube(&[&trace[..3], &["out.lens.zarr"], &designs].concat()),
        USAGE,
        &["--cones", "--depths-m"],
    );
}

#[test]
fn an_edge_filter_lets_less_red_pass_from_the_side() {
    let place = Place::new();
    let film = film_of_phone(&place);
    fs::write(place.at("edge.csv"), "wavelength_nm,transmittance\n300,1\n590,1\n620,0\n1000,0\n").unwrap();
    let plate = |kind: &str| {
        let more = format!("[[plate]]\nfile = \"edge.csv\"\nkind = \"{kind}\"\nindex = 1.8\n");
        description(&place, kind, &more)
    };
    let (middle, last) = (SIDE / 2, SIDE - 1);
    let ratio = |pixels: &[u16]| {
        let at = |y: usize, x: usize| f64::from(pixels[y * SIDE + x]) - BLACK;
        at(last, last) / at(middle, middle)
    };
    let flat = ratio(&raw_of(&place, &film, &description(&place, "flat", ""), &[]).1);
    let interference = ratio(&raw_of(&place, &film, &plate("interference"), &[]).1) / flat;
    let absorbing = ratio(&raw_of(&place, &film, &plate("absorbing"), &[]).1) / flat;
    // At 26.8 degrees in air the edge moves by 3 %, 19 nm; an absorbing edge hardly.
    assert!((0.7..0.95).contains(&interference), "{interference}");
    assert!((0.97..1.0).contains(&absorbing), "{absorbing}");
}

#[test]
fn descriptions_and_lenses_that_are_not_possible_are_one_clear_error() {
    let place = Place::new();
    let film = place.film(Size::new(SIDE, SIDE), &[500.0, 600.0], IRRADIANCE, |_, _, _| 0.3);
    let fails = |sensor_file: &Path, flags: &[&str], texts: &[&str]| {
        let all = [&["--sensor", sensor_file.to_str().unwrap(), "--exposure", "1ms"][..], flags].concat();
        assert_exit(&sensor(&film, &place.at("no"), &all), USAGE, texts);
        assert!(!place.at("no").exists());
    };
    let table = |name: &str, text: &str| {
        fs::write(place.at(name), text).unwrap();
        place.at(name).to_str().unwrap().to_owned()
    };
    let plain = description(&place, "plain", "");
    let good = description(&place, "good", "[angle]\nstack_index = 1.5\nacceptance_deg = 20");
    let cra = table("cra.csv", "height_mm,cra_deg,f_number\n0,0,2\n1,20,2\n");
    fails(&plain, &["--chief-ray-angles", &cra], &["--chief-ray-angles", "plain", "neither"]);
    // What `shoot` cannot do is known before its film.
    let shot = [
        "shoot",
        "gen:uniform?size=40&pitch_um=2&wavelengths=500,600",
        "shot.png",
        "--lens",
        "double-gauss-28-npz",
    ];
    let shot = lenscube(&[&shot[..], &["--exposure", "1ms", "--sensor", good.to_str().unwrap()]].concat());
    assert_exit(&shot, USAGE, &["gives no directions", "good", "lens trace --cones"]);
    // A film that another program wrote has no lens.
    fails(&good, &[], &["does not record its lens", "--lens"]);
    fails(&good, &["--lens", "double-gauss-28-npz"], &["--chief-ray-angles", "height_mm"]);
    let short = table("short.csv", "height_mm,cra_deg,f_number\n0,0,2\n0.01,20,2\n");
    fails(&good, &["--chief-ray-angles", &short], &["short.csv", "0.01", "corner"]);
    let falls = table("falls.csv", "height_mm,cra_deg,f_number\n0,0,2\n0,20,2\n");
    fails(&good, &["--chief-ray-angles", &falls], &["falls.csv", "line 3", "above 0"]);
    fails(&good, &["--chief-ray-angles", "missing.csv"], &["missing.csv"]);
    let wide = table("wide.csv", "height_mm,cra_deg,f_number\n0,0,0.3\n1,80,0.3\n");
    fails(&good, &["--chief-ray-angles", &wide], &["wide.csv", "90 degrees"]);
    table("one-sided.csv", "angle_deg,horizontal,vertical\n0,1,1\n30,0.5,0.5\n");
    table("dark.csv", "angle_deg,response\n0,0\n30,0.5\n");
    for (name, more, texts) in [
        ("neither", "[angle]\nstack_index = 1.5", &["angle", "acceptance_deg or file", "neither"][..]),
        ("both", "[angle]\nstack_index = 1.5\nacceptance_deg = 20\nfile = \"x.csv\"", &["both"]),
        ("index", "[angle]\nstack_index = 0.5\nacceptance_deg = 20", &["angle.stack_index", "1 to 4", "0.5"]),
        ("wide", "[angle]\nstack_index = 1.5\nacceptance_deg = 95", &["angle.acceptance_deg", "95"]),
        (
            "odd",
            "[angle]\nstack_index = 1.5\nacceptance_deg = 20\nexponent = 3",
            &["angle.exponent", "2, 4, 6 or 8"],
        ),
        ("side", "[angle]\nstack_index = 1.5\nfile = \"one-sided.csv\"", &["below 0 to above 0"]),
        ("dark", "[angle]\nstack_index = 1.5\nfile = \"dark.csv\"", &["above 0 at 0 degrees"]),
        (
            "filter",
            "[angle]\nstack_index = 1.5\nacceptance_deg = 20\nfilters.R = { acceptance_deg = 3 }",
            &["angle.filters.R", "Y"],
        ),
        ("typo", "[angle]\nstack_indx = 1.5", &["stack_indx", "line"]),
        (
            "plate",
            "[[plate]]\nfile = \"dark.csv\"\nkind = \"mirror\"\nindex = 1.5",
            &["mirror", "interference"],
        ),
    ] {
        fails(&description(&place, name, more), &["--chief-ray-angles", &cra], texts);
    }
}

/// A plate of glass before the film, whose loss a film of coated surfaces has already.
#[test]
fn a_plate_counts_once_in_lens_and_sensor() {
    let place = Place::new();
    let design = place.at("cover.csv");
    let phone = include_str!("../../../formats/data/lenses/phone.csv");
    let (before, last) = phone.split_once("9,2.143,1.0292128").unwrap();
    let cover = format!("{before}9,2.143,0.5{}\n10,,0.3,1.517,64.2,2.2\n11,,0.331,,,2.2\n", last.trim_end());
    fs::write(&design, cover).unwrap();
    let film = |name: &str, coatings: &str| {
        let film = place.at(name);
        let chart = format!("gen:uniform?size={SIDE}&pitch_um={PITCH_UM}&wavelengths=500,600");
        crate::common::run(
            &chart,
            &film,
            design.to_str().unwrap(),
            &["--coatings", coatings, "--film-units", "irradiance"],
        )
        .ok();
        film
    };
    let (ideal, lossy) = (film("ideal.zarr", "ideal"), film("lossy.zarr", "none"));
    fs::write(place.at("glass.csv"), "wavelength_nm,transmittance\n400,0.9\n700,0.8\n").unwrap();
    let plate = "[[plate]]\nfile = \"glass.csv\"\nkind = \"absorbing\"\nindex = 1.52\n";
    let of_sensor = description(&place, "once", plate);
    let besides = description(&place, "besides", &format!("{plate}besides_lens = true\n"));
    let raw = place.at("raw.zarr");
    let expose = |film: &Path, file: &Path| {
        let _ = fs::remove_dir_all(&raw);
        sensor(film, &raw, &["--sensor", file.to_str().unwrap(), "--exposure", "60us"])
    };
    expose(&ideal, &of_sensor).ok();
    expose(&lossy, &besides).ok();
    let twice = expose(&lossy, &of_sensor);
    assert_exit(&twice, USAGE, &["the same plate would count twice", "besides_lens = true"]);
    assert!(!raw.exists());
    // Known before the film is made.
    let chart = format!("gen:uniform?size={SIDE}&pitch_um={PITCH_UM}&wavelengths=500,600");
    let (picture, lens) = (place.at("shot.png"), design.to_str().unwrap());
    let words = ["shoot", &chart, picture.to_str().unwrap(), "--lens", lens, "--coatings", "none"];
    let flags = ["--sensor", of_sensor.to_str().unwrap(), "--exposure", "auto"];
    assert_exit(&lenscube(&[&words[..], &flags].concat()), USAGE, &["would count twice"]);
    // In one description.
    let both = description(&place, "both", &plate.repeat(2));
    assert_exit(&expose(&ideal, &both), USAGE, &["each table once", "glass.csv twice"]);
}

/// Light beside the image has no cone of its own: it is told.
#[test]
fn light_of_the_veil_is_told_to_come_from_the_cone_of_the_image() {
    let place = Place::new();
    let film = place.at("veil.zarr");
    let chart = format!("gen:black-spots?size={SIDE}&pitch_um={PITCH_UM}&wavelengths=500,600");
    crate::common::run(&chart, &film, "phone", &["--veiling-glare", "2%"]).ok();
    let note = "the film's veil (scatter, glare or ghosts) is taken to come from the directions of the image";
    let raw = place.at("raw.zarr");
    for (more, is_told) in [("[angle]\nstack_index = 1.5\nacceptance_deg = 30\n", true), ("", false)] {
        let _ = fs::remove_dir_all(&raw);
        let file = description(&place, "s", more);
        let said = sensor(&film, &raw, &["--sensor", file.to_str().unwrap(), "--exposure", "auto"]).ok();
        assert_eq!(said.stderr.contains(note), is_told, "{}", said.stderr);
    }
}

/// Responses at two wavelengths: the film's bands see those linear between.
#[test]
fn a_response_by_wavelength_is_that_of_each_band() {
    let place = Place::new();
    let of_band = |nm: f64| {
        let film = place.at(&format!("{nm}.zarr"));
        write_film(&film, Size::new(SIDE, SIDE), &[nm], (2.0, IRRADIANCE), |_, _, _| 0.3);
        let table = place.at("cra.csv");
        fs::write(&table, "height_mm,cra_deg,f_number\n0,20,500\n1,20,500\n").unwrap();
        let flags = ["--chief-ray-angles", table.to_str().unwrap()];
        let flat = raw_of(&place, &film, &description(&place, "flat", ""), &[]).1;
        fs::write(
            place.at("response.csv"),
            "angle_deg,response_600,response_500\n0,2,1\n20,1,0.9\n40,0,0.8\n",
        )
        .unwrap();
        let more = "[angle]\nstack_index = 4\nfile = \"response.csv\"\n";
        let found = raw_of(&place, &film, &description(&place, "spectral", more), &flags).1;
        share(&found, &flat, 3, 5)
    };
    for (nm, expected) in [(450.0, 0.9), (500.0, 0.9), (525.0, 0.8), (580.0, 0.58), (620.0, 0.5)] {
        let found = of_band(nm);
        // A single band represents 10 nm.
        assert!((found - expected).abs() < 6e-3, "{nm} nm: {found} {expected}");
    }
}
