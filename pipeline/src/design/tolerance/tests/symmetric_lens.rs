//! MTF without errors against that of the symmetric lens, from its PSFs.

use super::lens_figures::{criterion, mtf_at};
use crate::design::field_psf::field_psf;
use crate::design::pupil::test_lenses;
use crate::design::ray::Tracer;
use crate::design::skew::system::BuiltLens;
use crate::design::system::{RayAiming, System};
use crate::figures::{Direction, PsfWindow, polychromatic_mtf};

/// MTF of the symmetric lens as `lens show` and `lens table` have it, sagittal and tangential: the PSFs of all wavelengths in
/// windows of 99.8 % of the light, whose MTF is accurate to about 2e-4.
fn from_psfs(system: &System, height_mm: f64, lp_mm: f64) -> [f64; 2] {
    let primary = Tracer::new(system, system.primary_um()).unwrap();
    let tan = primary.field_of_height(height_mm).unwrap();
    let origin = primary.chief_height_mm(tan).unwrap();
    let psfs: Vec<(f64, f64, PsfWindow)> = system
        .wavelengths_um
        .iter()
        .map(|(um, weight)| {
            let tracer = Tracer::new(system, *um).unwrap();
            let at_um = 1e3 * (tracer.chief_height_mm(tan).unwrap() - origin);
            (*weight, at_um, field_psf(&tracer, tan).unwrap())
        })
        .collect();
    let all: Vec<_> = psfs.iter().map(|(w, at, psf)| (*w, *at, psf)).collect();
    [Direction::Sagittal, Direction::Tangential].map(|d| polychromatic_mtf(&all, lp_mm, d))
}

#[test]
fn mtf_without_errors_is_that_of_the_symmetric_lens() {
    let double_gauss = System { aiming: RayAiming::Real, ..System::double_gauss_28() };
    let cases: [(System, &[f64]); 4] = [
        (double_gauss, &[0.0, 7.0, 14.0, 19.0]),
        (test_lenses::lens("phone"), &[0.0, 1.0, 1.5]),
        (test_lenses::lens("macro-70"), &[0.0, 12.0, 20.0]),
        (test_lenses::lens("mirror-500"), &[0.0, 15.0]),
    ];
    for (system, heights) in cases {
        let built = BuiltLens::new(&system, &[]).unwrap();
        for height_mm in heights {
            for frequency in [10.0, 30.0, 60.0] {
                let expected = from_psfs(&system, *height_mm, frequency);
                // In another direction than x.
                let place = [-0.6 * height_mm, 0.8 * height_mm];
                let found = criterion(mtf_at(frequency), &[place]).figures(&built, 1.0).unwrap();
                for (a, b) in found.fields[0].mtf.unwrap().into_iter().zip(expected) {
                    assert!((a - b).abs() < 1e-3, "{} {height_mm} {frequency}: {a} {b}", system.name);
                }
            }
        }
    }
}
