//! Films of arrays in memory beside those of the command.

use crate::common::{Picture, bits, pixels, run, text};
use lenscube::{ArrayFilm, ArrayLens};
use pipeline::geometry::Size;
use std::sync::atomic::AtomicBool;

/// A pack of PSFs at 450 to 650 nm.
const LENS: &str = "double-gauss-28-npz";
const SIZE: Size = Size::new(70, 90);

fn words(text: &str) -> Vec<String> {
    text.split_whitespace().map(str::to_owned).collect()
}

fn lens(flags: &str) -> ArrayLens {
    ArrayLens::open(&words(&format!("--lens={LENS} --interpolate-psf {flags}")), Some(vec![450.0, 500.0]))
        .unwrap()
}

fn films(film: &ArrayFilm, arrays: &[&Picture]) -> Vec<f32> {
    let pixels: Vec<f32> = arrays.iter().flat_map(|array| array.bands.concat()).collect();
    let mut films = vec![f32::NAN; arrays.len() * film.shape().iter().product::<usize>()];
    film.compute(&pixels, &mut films, &AtomicBool::new(false)).unwrap();
    films
}

#[test]
fn films_of_arrays_have_the_bits_of_the_command() {
    let dir = tempfile::tempdir().unwrap();
    let (chart, film) = (dir.path().join("chart.zarr"), dir.path().join("film.zarr"));
    let picture = Picture::noise(3, SIZE, 2);
    picture.write(&chart);
    let lens = lens("--threads=2");
    for (place, array) in [
        ("--axis=-300,40.5 --center=1.25,0.1", "film"),
        ("--film-size=64 --scale=0.8 --roi=3,5,40,30", "roi_0"),
    ] {
        let flags = words(&format!("--film-pitch-um=2 {place}"));
        let of_command: Vec<&str> =
            flags.iter().map(String::as_str).chain(["--interpolate-psf", "--overwrite"]).collect();
        run(text(&chart), &film, LENS, &of_command).ok();
        let (_, expected) = pixels(&film, array);
        let ready = lens.film(SIZE, &flags).unwrap();
        // Alone, and as the second of two.
        let other = Picture::noise(4, SIZE, 2);
        let (alone, both) = (films(&ready, &[&picture]), films(&ready, &[&other, &picture]));
        assert_eq!(bits(std::slice::from_ref(&alone)), bits(&[expected.concat()]), "{place}");
        assert_eq!(both[alone.len()..], alone[..], "{place}");
    }
}

#[test]
fn what_does_not_apply_to_arrays_is_refused() {
    let refused = |flags: &str, nm: Option<Vec<f64>>| {
        let opened = ArrayLens::open(&words(flags), nm);
        lenscube::code_and_message(&opened.err().expect(flags))
    };
    let (code, message) = refused("--lens=phone --shard=512", Some(vec![550.0]));
    assert_eq!((code, message.as_str()), (2, "--shard does not apply to arrays in memory"));
    assert!(refused("--lens=phone", None).1.contains("give them in nm"));
    assert!(refused("--lens=phone --chunk", Some(vec![550.0])).1.contains("--chunk"));
    assert_eq!(refused("--lens=phone", Some(vec![f64::NAN])).0, 2);
    let lens = lens("");
    let two = words("--film-pitch-um=2 --roi=0,0,8,8 --roi=8,8,8,8");
    assert!(
        lenscube::code_and_message(&lens.film(SIZE, &two).err().unwrap()).1.contains("roi: expected one")
    );
    // A pack knows its wavelengths.
    let bands = ArrayLens::open(&words(&format!("--lens={LENS}")), None).unwrap().wavelengths_nm().len();
    assert!(bands > 2, "{bands}");
}

#[test]
fn points_of_the_chart_and_the_film_are_inverse() {
    let lens = lens("");
    let points = [[0.0, 0.0], [0.3, -0.4], [12.0, 9.0]];
    let film = lens.film_of_chart(&points, 500.0).unwrap();
    let chart = lens.chart_of_film(&film, 500.0).unwrap();
    for (point, back) in points.iter().zip(&chart) {
        assert!((0..2).all(|i| (point[i] - back[i]).abs() < 1e-9), "{point:?} {back:?}");
    }
    assert!((film[2][0] - 12.0).abs() > 0.01, "the lens has distortion: {film:?}");
    let light = lens.relative_illumination(&film, 500.0).unwrap();
    assert!(light[0] == 1.0 && light[2] < 0.97, "{light:?}");
    assert!(lens.film_of_chart(&[[1000.0, 0.0]], 500.0).is_err(), "beyond the field");
}

/// Of a design with `--reach-mm`; without it maps of several reaches agree to 10⁻⁴ px.
#[test]
fn points_do_not_depend_on_those_before_them() {
    let open = || {
        let flags = words("--lens=double-gauss-28 --reach-mm=3 --threads=1");
        ArrayLens::open(&flags, Some(vec![550.0])).unwrap()
    };
    let near = [[0.4, 0.3]];
    let alone = open().chart_of_film(&near, 550.0).unwrap();
    let lens = open();
    for before in [[2.9, 0.0], [0.1, 0.1], [0.0, 4.0]] {
        lens.chart_of_film(&[before], 550.0).unwrap();
        assert_eq!(lens.chart_of_film(&near, 550.0).unwrap(), alone, "after {before:?}");
    }
    assert!((alone[0][0] - near[0][0]).abs() < 1e-2 && alone != near, "{alone:?}");
}
