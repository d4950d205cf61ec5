//! Fourteen kinds of lenses against an independent tracer: singlet, achromat, triplet, Double Gauss, Petzval f/1.4, inverse telephoto, 100° and
//! fisheye lenses to 80° off the axis, phone lens with aspheres, microscope objective, 1:1 system, telephoto, Ritchey-Chrétien telescope and
//! Mangin mirror lens with central obscurations; real ray aiming.
//!
//! Light left of single rays, bare and with a quarter wave on boundaries with air: `tests/data/transmission.txt`, by another method
//! (`scripts/lens_suite/transmission.py`).
//! Rays along ghost paths and their light: `tests/data/ghosts.txt`, by that method (`scripts/lens_suite/ghosts.py`).
//! Values: `tests/data/lens_suite.txt`, made by `scripts/lens_suite/make.py` (NumPy; compared there with Optiland).

use lenscube_pipeline::design::System;
use lenscube_pipeline::design::coating::Coating;
use lenscube_pipeline::design::coatings::Coatings;
use lenscube_pipeline::design::field_figures::field_figures;
use lenscube_pipeline::design::ghost::apertures::Apertures;
use lenscube_pipeline::design::ghost::light::GhostLight;
use lenscube_pipeline::design::ghost::{GhostLens, GhostPath};
use lenscube_pipeline::design::illumination::irradiance_sr;
use lenscube_pipeline::design::paraxial::Paraxial;
use lenscube_pipeline::design::psf::{PsfGrid, PsfScratch, PupilFunction};
use lenscube_pipeline::design::ray::Tracer;
use lenscube_pipeline::design::system::RayAiming;

mod suite;

use suite::{Entry, UM, suite};

#[test]
fn first_order_figures_equal_the_independent_ones() {
    for Entry { system, paraxial, .. } in suite() {
        let p = Paraxial::new(&system, UM[1]).unwrap();
        let found = [
            p.effective_focal_length_mm,
            p.back_focal_length_mm,
            p.image_f_number(),
            p.entrance_pupil_mm,
            p.exit_pupil_mm,
            p.exit_radius_mm,
        ];
        for (found, expected) in found.iter().zip(&paraxial) {
            let error = (found - expected).abs() / expected.abs().max(1.0);
            assert!(error < 1e-6, "{}: {found} against {expected}", system.name);
        }
    }
}

#[test]
fn chief_rays_and_illumination_equal_the_independent_ones() {
    for Entry { system, fields, .. } in suite() {
        let (mut height_error, mut ri_error) = (0.0_f64, 0.0_f64);
        for field in &fields {
            for (um, expected) in UM.iter().zip(&field[1..4]) {
                let tracer = Tracer::new(&system, *um).unwrap();
                let height = tracer.chief_height_mm(field[0]).unwrap();
                height_error = height_error.max((height - expected).abs());
                let tan = tracer.field_of_height(*expected).unwrap();
                assert!((tan / field[0] - 1.0).abs() < 1e-8, "{}: {tan} against {}", system.name, field[0]);
            }
            let tracer = Tracer::new(&system, UM[1]).unwrap();
            let ri = irradiance_sr(&tracer, field[0]).unwrap() / irradiance_sr(&tracer, 0.0).unwrap();
            ri_error = ri_error.max((ri - field[4]).abs());
        }
        println!("{}: height {height_error:.1e} mm, RI {ri_error:.1e}", system.name);
        assert!(height_error < 1e-7 && ri_error < 1e-5, "{}", system.name);
    }
}

#[test]
fn figures_of_every_lens_are_finite_and_its_light_falls_off_from_1() {
    for Entry { system, fields, .. } in suite() {
        let heights: Vec<f64> = std::iter::once(0.0).chain(fields.iter().map(|f| f[2])).collect();
        let figures = field_figures(&system, &UM, &heights, 0.99, 2.0).unwrap();
        assert_eq!(figures.len(), 3 * heights.len());
        for figures in figures {
            let f = figures.unwrap_or_else(|e| panic!("{}: {e}", system.name));
            let ri = f.light.irradiance_sr / f.axis.irradiance_sr;
            assert!(ri > 0.05 && ri < 1.5 && f.spot.rms_um.is_finite(), "{}: {f:?}", system.name);
            assert!(f.height_mm > 0.0 || ((ri - 1.0).abs() < 1e-6 && f.lateral_colour_um == 0.0), "{f:?}");
        }
    }
}

#[test]
fn psfs_equal_the_independent_ones() {
    let mut scratch = PsfScratch::default();
    for Entry { system, psf, .. } in suite() {
        let tracer = Tracer::new(&system, UM[1]).unwrap();
        let f = PupilFunction::trace(&tracer, psf.tan).unwrap();
        let half = psf.rows.len() - 1;
        let n = 2 * half + 1;
        let found = PsfGrid::new(half, psf.pitch_um).psf(&f, 0.0, &mut scratch);
        let expected: Vec<f64> = (0..n * n).map(|i| psf.rows[(i / n).abs_diff(half)][i % n]).collect();
        // Shares of the light in the window, and its centre, µm.
        let shares = |v: &[f64]| -> (Vec<f64>, f64) {
            let sum: f64 = v.iter().sum();
            let x = |i: usize| ((i % n) as f64 - half as f64) * psf.pitch_um;
            (v.iter().map(|v| v / sum).collect(), v.iter().enumerate().map(|(i, v)| x(i) * v / sum).sum())
        };
        let ((a, x), (b, y)) = (shares(&found), shares(&expected));
        let l1: f64 = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).sum();
        println!("{}: L1 {l1:.1e}, centroid {:.1e} µm", system.name, x - y);
        assert!(l1 < 5e-4 && (x - y).abs() < 1e-3, "{}: {l1} {}", system.name, x - y);
    }
}

/// Polarisation followed along each ray through bare and coated surfaces.
#[test]
fn light_left_of_single_rays_equals_the_independent_one() {
    let (mut checked, mut worst) = (0, 0.0_f64);
    let lenses = suite();
    for line in include_str!("../data/transmission.txt").lines().filter(|l| l.starts_with("ray ")) {
        let cells: Vec<&str> = line.split(' ').collect();
        let number = |i: usize| cells[i].parse::<f64>().unwrap();
        let system = &lenses.iter().find(|e| e.system.name.replace(' ', "_") == cells[1]).unwrap().system;
        let paraxial = System { aiming: RayAiming::Paraxial, ..system.clone() };
        let flux = |system: &System| {
            Tracer::new(system, UM[1]).unwrap().ray(number(2), number(3), number(4)).map(|r| r.flux)
        };
        let Ok(all) = flux(&paraxial) else { continue };
        for (coating, column) in [(Coating::Bare, 5), (Coating::quarter_wave("MgF2", 1.38, 0.55), 6)] {
            let coatings = Coatings { default: coating, surfaces: Vec::new() };
            let left = flux(&paraxial.clone().with_coatings(&coatings).unwrap()).unwrap() / all;
            worst = worst.max((left - number(column)).abs());
            checked += 1;
        }
    }
    assert!(checked > 280 && worst < 1e-9, "{checked} rays, {worst:e}");
}

#[test]
fn rays_along_ghost_paths_equal_the_independent_ones() {
    let (mut checked, mut place, mut light) = (0, 0.0_f64, 0.0_f64);
    let lenses = suite();
    for line in include_str!("../data/ghosts.txt").lines().filter(|l| l.starts_with("ghost ")) {
        let cells: Vec<&str> = line.split(' ').collect();
        let number = |i: usize| cells[i].parse::<f64>().unwrap();
        let system = &lenses.iter().find(|e| e.system.name.replace(' ', "_") == cells[1]).unwrap().system;
        let path = GhostPath { first: number(2) as usize, second: number(3) as usize };
        for (coating, column) in [(Coating::Bare, 9), (Coating::quarter_wave("MgF2", 1.38, 0.55), 10)] {
            let coatings = Coatings { default: coating, surfaces: Vec::new() };
            let coated = system.clone().with_coatings(&coatings).unwrap();
            let count = coated.surfaces.len();
            let open =
                Apertures { clear_mm: vec![1e6; count], hidden_mm: vec![None; count], of_rays: Vec::new() };
            let lens = GhostLens::new(&coated, UM[1], &open).unwrap();
            let of_film = GhostLight::new(&coated, UM[1], 0.1).unwrap();
            // The file has the field point on +x of the first light, whatever the sign of the image.
            let tan = lens.tracer().image_sign() * number(4);
            let ray = lens.ray(Some(path), &of_film, tan, (number(5), number(6))).unwrap();
            let size = number(7).abs().max(number(8).abs()).max(1.0);
            place =
                place.max((ray.landing.x - number(7)).abs().max((ray.landing.y - number(8)).abs()) / size);
            light = light.max((ray.weight / number(column) - 1.0).abs());
            checked += 1;
        }
    }
    assert!(checked == 350 && place < 1e-9 && light < 1e-9, "{checked} rays, {place:e}, {light:e}");
}
