//! `validate` detects each perturbation of the lens data: films of a synthetic lens are compared with perturbed tables.

mod synthetic_lens;

use super::edge::{self, EdgeFilm};
use super::edge_places::{EdgePlace, places};
use super::error_budget::RunPsfs;
use super::setup::Setup;
use super::{distortion, illumination};
use crate::args::{Cli, Command};
use clap::Parser;
use pipeline::geometry::Rect;
use std::path::Path;
use synthetic_lens::{SyntheticLens, UNPERTURBED, write};

/// Setup with films of the lens `film`, compared with the lens `reference`.
fn setup(dir: &Path, film: SyntheticLens, reference: SyntheticLens) -> Setup {
    let at = |name: &str| dir.join(name).to_str().unwrap().to_owned();
    let (lens, against) = (at("film.lens.zarr"), at("reference.lens.zarr"));
    write(Path::new(&lens), film);
    write(Path::new(&against), reference);
    let arguments = ["lenscube", "validate", "--wavelengths", "550", "--threads", "2", "--lens", &lens];
    let arguments = arguments.into_iter().map(String::from).chain(["--against".into(), against]);
    let Command::Validate(args) = Cli::parse_from(arguments.chain(["--out".into(), at("out")])).command
    else {
        panic!("the command line starts with `validate`")
    };
    Setup::new(&args).unwrap()
}

fn place(name: &str, direction: &str) -> Vec<EdgePlace> {
    let all = places(14141).into_iter();
    all.filter(|p| p.name == name && p.direction == direction).collect()
}

/// IoU and maximum difference of one edge.
fn edge_agreement(setup: &Setup, film: &EdgeFilm) -> (f64, f64) {
    let reference = setup.reference.band(550.0).unwrap();
    let run = RunPsfs::new(setup, 0).unwrap();
    let a = edge::compare(setup, &reference, &run, 0, film).unwrap().agreement;
    (a.iou, a.max_difference)
}

fn agrees((iou, max_difference): (f64, f64)) -> bool {
    iou >= 0.999 && max_difference <= 5e-3
}

#[test]
fn illumination_table_shifted_by_one_node_is_detected() {
    let dir = tempfile::tempdir().unwrap();
    let correct = setup(dir.path(), UNPERTURBED, UNPERTURBED);
    let films = illumination::simulate(&correct).unwrap();
    let compare = |setup: &Setup| {
        let reference = setup.reference.band(550.0).unwrap();
        illumination::compare(setup, &reference, 0, &films).unwrap()
    };
    let result = compare(&correct);
    assert!(result.agreement.iou > 0.99999, "{:?}", result.agreement);
    for d in &result.departures {
        assert!((d.film - d.lens).abs() < 3e-5, "{d:?}");
    }
    let dir = tempfile::tempdir().unwrap();
    let shifted = setup(dir.path(), UNPERTURBED, SyntheticLens { illumination_shift: 1, ..UNPERTURBED });
    let iou = compare(&shifted).agreement.iou;
    assert!(iou < 0.9999, "{iou}");
}

#[test]
fn distortion_of_neighbouring_band_and_half_pixel_shift_are_detected() {
    let dir = tempfile::tempdir().unwrap();
    let mut correct = setup(dir.path(), UNPERTURBED, UNPERTURBED);
    let film = distortion::simulate(&correct, false).unwrap();
    let mean_max = |setup: &Setup| {
        let reference = setup.reference.band(550.0).unwrap();
        distortion::mean_max(&distortion::compare(setup, &reference, 0, &film).unwrap())
    };
    let (mean, max) = mean_max(&correct);
    assert!(mean <= 0.01 && max <= 0.03, "{mean} {max}");
    let dir = tempfile::tempdir().unwrap();
    // Lateral colour of the built-in lens between neighbouring bands: about 0.2 px in the corner.
    let other_band = setup(dir.path(), UNPERTURBED, SyntheticLens { scale: 1.0 + 2e-5, ..UNPERTURBED });
    assert!(mean_max(&other_band).0 > 0.01, "{:?}", mean_max(&other_band));
    correct.axis_px.1 += 0.5;
    assert!(mean_max(&correct).0 > 0.4, "{:?}", mean_max(&correct));
}

#[test]
fn psf_rotated_by_10_degrees_is_detected() {
    let dir = tempfile::tempdir().unwrap();
    let correct = setup(dir.path(), UNPERTURBED, UNPERTURBED);
    let both = [place("mid-field", "radial"), place("mid-field", "tangential")].concat();
    let films = edge::simulate(&correct, &both).unwrap();
    assert!(films.iter().all(|film| agrees(edge_agreement(&correct, film))));
    for psf_rotation_deg in [10.0, -10.0] {
        let dir = tempfile::tempdir().unwrap();
        let rotated = setup(dir.path(), UNPERTURBED, SyntheticLens { psf_rotation_deg, ..UNPERTURBED });
        let found: Vec<_> = films.iter().map(|film| edge_agreement(&rotated, film)).collect();
        assert!(found.iter().any(|f| !agrees(*f)), "{psf_rotation_deg}: {found:?}");
    }
}

#[test]
fn pixel_aperture_applied_twice_is_detected() {
    let dir = tempfile::tempdir().unwrap();
    let twice = setup(dir.path(), SyntheticLens { integrated: true, ..UNPERTURBED }, UNPERTURBED);
    let films = edge::simulate(&twice, &place("mid-field", "tangential")).unwrap();
    let found = edge_agreement(&twice, &films[0]);
    assert!(!agrees(found), "{found:?}");
}

#[test]
fn mirrored_azimuth_is_detected() {
    let dir = tempfile::tempdir().unwrap();
    // Without distortion a mirrored position differs in the azimuth of its PSF only.
    let lens = SyntheticLens { distortion: 0.0, ..UNPERTURBED };
    let correct = setup(dir.path(), lens, lens);
    let films = edge::simulate(&correct, &place("corner", "radial")).unwrap();
    let film = &films[0];
    assert!(agrees(edge_agreement(&correct, film)), "{:?}", edge_agreement(&correct, film));
    let (row, column) = film.place.centre_px;
    let mirrored = EdgeFilm {
        place: EdgePlace { centre_px: (correct.size as f64 - 1.0 - row, column), ..film.place.clone() },
        rect: Rect { y: correct.size as i64 - film.rect.bottom(), ..film.rect },
        pixels: film.pixels.clone(),
    };
    assert!(!agrees(edge_agreement(&correct, &mirrored)), "{:?}", edge_agreement(&correct, &mirrored));
}
