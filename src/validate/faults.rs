//! That each check can fail: a lens made up here makes films, and one fault at a time is put between film and lens.

use super::{Setup, distortion, esf, ri};
use crate::args::{Cli, Command, ValidateArgs};
use clap::Parser;
use formats::lens::{LensPackError, PackAttributes};
use pipeline::geometry::Rect;
use pipeline::lens::{Lens, LensBand, PsfSample, PsfStack};
use std::path::Path;

const FILM_PITCH_UM: f64 = 2.0;
/// Ten samples an axis and film pixel of 0.5 µm.
const STEP_PX: f64 = 0.25;

/// What a made-up lens can differ in.
#[derive(Clone, Copy)]
struct Recipe {
    /// Distortion at 20 mm, and the scale that lateral colour gives.
    distortion: f64,
    scale: f64,
    /// Field points by which the illumination table is shifted.
    illumination_shift: usize,
    /// Turn of the PSFs, degrees.
    turned_deg: f64,
    /// Samples are means over the film pixel already, though they say they are points.
    integrated: bool,
}

const TRUE: Recipe =
    Recipe { distortion: -0.01, scale: 1.0, illumination_shift: 0, turned_deg: 0.0, integrated: false };

/// A Gaussian of 2.4 × 1.2 px, moved outwards with the field, and its window of 21 film pixels.
fn psf(height_mm: f64, recipe: Recipe) -> Vec<f32> {
    let n = 83usize;
    let (sin, cos) = recipe.turned_deg.to_radians().sin_cos();
    let value = |y: f64, x: f64| {
        let (u, v) = (x * cos + y * sin - 0.02 * height_mm, y * cos - x * sin);
        (-0.5 * ((u / 2.4).powi(2) + (v / 1.2).powi(2))).exp()
    };
    let mean = |y: f64, x: f64| {
        let at = |i: usize| (i as f64 + 0.5) / 8.0 - 0.5;
        (0..64).map(|i| value(y + at(i / 8), x + at(i % 8))).sum::<f64>()
    };
    let place = |i: usize| (i as f64 - (n / 2) as f64) * STEP_PX;
    let one = |i: usize| {
        let (y, x) = (place(i / n), place(i % n));
        if recipe.integrated { mean(y, x) } else { value(y, x) }
    };
    let all: Vec<f64> = (0..n * n).map(one).collect();
    let sum: f64 = all.iter().sum();
    all.iter().map(|v| (v / sum) as f32).collect()
}

fn write(path: &Path, recipe: Recipe) {
    let ideal: Vec<f64> = (0..=1000).map(|i| 0.021 * f64::from(i)).collect();
    let real = |h: &f64| h * recipe.scale * (1.0 + recipe.distortion * (h / 20.0).powi(2));
    let illumination = |i: usize| {
        let h = ideal[i.saturating_sub(recipe.illumination_shift)];
        1.0 - 0.15 * (h / 20.0).powi(2)
    };
    let heights: Vec<f64> = (0..=8).map(|k| 2.59 * f64::from(k)).collect();
    let band = LensBand {
        wavelength_nm: 550.0,
        image_height_mm: ideal.iter().map(real).collect(),
        relative_illumination: (0..ideal.len()).map(illumination).collect(),
        ideal_height_mm: ideal.clone(),
        azimuth_count: (0..heights.len()).map(|k| if k == 0 { 1 } else { 72 }).collect(),
        psf_size: 83,
        psf_pitch_um: STEP_PX * FILM_PITCH_UM,
        psf_energy: vec![1.0; heights.len()],
        psf_height_mm: heights.clone(),
        solid_angle_sr: 0.1,
        transmission: 1.0,
    };
    let samples = heights.iter().flat_map(|h| psf(*h, recipe)).collect();
    let stack = PsfStack { size: 83, pitch_um: band.psf_pitch_um, sample: PsfSample::Point, samples };
    let lens = Lens {
        name: "made up".into(),
        distortion_focal_length_mm: 50.0,
        effective_focal_length_mm: 50.0,
        f_number: 2.0,
        primary_wavelength_nm: 550.0,
        object_distance_mm: None,
        magnification: 0.0,
        psf_sample: PsfSample::Point,
        bands: vec![band],
    };
    formats::lens::write(path, &lens, &PackAttributes::default(), [Ok::<_, LensPackError>(stack)]).unwrap();
}

/// Films by `film`, compared with `against`.
fn setup(dir: &Path, film: Recipe, against: Recipe) -> Setup {
    let at = |name: &str| dir.join(name).to_str().unwrap().to_owned();
    write(Path::new(&at("film.lens.zarr")), film);
    write(Path::new(&at("against.lens.zarr")), against);
    let (lens, against) = (at("film.lens.zarr"), at("against.lens.zarr"));
    let words = ["lenscube", "validate", "--wavelengths", "550", "--threads", "2", "--lens", &lens];
    let words = words.into_iter().map(String::from).chain(["--against".into(), against]);
    let Command::Validate(args) = Cli::parse_from(words.chain(["--out".into(), at("out")])).command else {
        panic!("`validate` is typed above")
    };
    let args: ValidateArgs = *args;
    Setup::new(&args).unwrap()
}

fn place(name: &str, direction: &str) -> Vec<esf::Place> {
    let all = esf::places(14141).into_iter();
    all.filter(|p| p.name == name && p.direction == direction).collect()
}

/// IoU and largest difference of one edge.
fn edge(setup: &Setup, shot: &esf::Shot) -> (f64, f64) {
    let truth = setup.truth.band(550.0).unwrap();
    let run = super::blame::RunPsfs::new(setup, 0).unwrap();
    let a = esf::compare(setup, &truth, &run, 0, shot).unwrap().agreement;
    (a.iou, a.max_difference)
}

fn good((iou, most): (f64, f64)) -> bool {
    iou >= 0.999 && most <= 5e-3
}

#[test]
fn an_illumination_table_shifted_by_one_node() {
    let dir = tempfile::tempdir().unwrap();
    let setup = setup(dir.path(), TRUE, TRUE);
    let shots = ri::shoot(&setup).unwrap();
    let of = |setup: &Setup| {
        let truth = setup.truth.band(550.0).unwrap();
        ri::compare(setup, &truth, 0, &shots).unwrap()
    };
    let right = of(&setup);
    assert!(right.agreement.iou > 0.99999, "{:?}", right.agreement);
    for d in &right.departures {
        assert!((d.film - d.lens).abs() < 3e-5, "{d:?}");
    }
    let other = tempfile::tempdir().unwrap();
    let shifted = self::setup(other.path(), TRUE, Recipe { illumination_shift: 1, ..TRUE });
    let wrong = of(&shifted).agreement.iou;
    assert!(wrong < 0.9999, "{wrong}");
}

#[test]
fn the_distortion_of_another_band_and_half_a_pixel() {
    let dir = tempfile::tempdir().unwrap();
    let mut setup = setup(dir.path(), TRUE, TRUE);
    let shots = distortion::shoot(&setup, false).unwrap();
    let of = |setup: &Setup| {
        let truth = setup.truth.band(550.0).unwrap();
        distortion::mean_max(&distortion::compare(setup, &truth, 0, &shots).unwrap())
    };
    let (mean, most) = of(&setup);
    assert!(mean <= 0.01 && most <= 0.03, "{mean} {most}");
    let other = tempfile::tempdir().unwrap();
    // Lateral colour of the built-in lens between neighbouring bands: about 0.2 px in the corner.
    let colour = self::setup(other.path(), TRUE, Recipe { scale: 1.0 + 2e-5, ..TRUE });
    assert!(of(&colour).0 > 0.01, "{:?}", of(&colour));
    setup.axis_px.1 += 0.5;
    assert!(of(&setup).0 > 0.4, "{:?}", of(&setup));
}

#[test]
fn a_psf_turned_by_ten_degrees() {
    let dir = tempfile::tempdir().unwrap();
    let setup = setup(dir.path(), TRUE, TRUE);
    let both = [place("mid-field", "radial"), place("mid-field", "tangential")].concat();
    let shots = esf::shoot(&setup, &both).unwrap();
    assert!(shots.iter().all(|s| good(edge(&setup, s))));
    for turned_deg in [10.0, -10.0] {
        let other = tempfile::tempdir().unwrap();
        let turned = self::setup(other.path(), TRUE, Recipe { turned_deg, ..TRUE });
        let found: Vec<_> = shots.iter().map(|s| edge(&turned, s)).collect();
        assert!(found.iter().any(|f| !good(*f)), "{turned_deg}: {found:?}");
    }
}

#[test]
fn the_pixel_aperture_applied_twice() {
    let dir = tempfile::tempdir().unwrap();
    let twice = setup(dir.path(), Recipe { integrated: true, ..TRUE }, TRUE);
    let shots = esf::shoot(&twice, &place("mid-field", "tangential")).unwrap();
    assert!(!good(edge(&twice, &shots[0])), "{:?}", edge(&twice, &shots[0]));
}

#[test]
fn an_azimuth_mirrored() {
    let dir = tempfile::tempdir().unwrap();
    // Without distortion a mirrored place differs in its PSF's azimuth alone.
    let flat = Recipe { distortion: 0.0, ..TRUE };
    let setup = setup(dir.path(), flat, flat);
    let shots = esf::shoot(&setup, &place("corner", "radial")).unwrap();
    let right = &shots[0];
    assert!(good(edge(&setup, right)), "{:?}", edge(&setup, right));
    let rows = setup.size as f64 - 1.0;
    let mirrored = esf::Shot {
        place: esf::Place {
            centre_px: (rows - right.place.centre_px.0, right.place.centre_px.1),
            ..right.place.clone()
        },
        rect: Rect { y: setup.size as i64 - right.rect.bottom(), ..right.rect },
        pixels: right.pixels.clone(),
    };
    assert!(!good(edge(&setup, &mirrored)), "{:?}", edge(&setup, &mirrored));
}
