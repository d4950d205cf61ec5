//! PSFs of built lenses against those of the symmetric tracer, plain sums over rays, and the model.

use std::f64::consts::{FRAC_PI_2, TAU};

use rustfft::num_complex::Complex;

use super::lenses::{ARCMIN, REAR, UM, double_gauss, film, lens_0, moved};
use crate::design::prescription::system::{RayAiming, System};
use crate::design::psf::huygens::tests::direct_sum;
use crate::design::psf::pupil_stack::PupilStack;
use crate::design::psf::{PsfGrid, PsfScratch, PupilFunction};
use crate::design::pupil::test_lenses;
use crate::design::rays::ray::Tracer;
use crate::design::skew::deviation::Deviation;
use crate::design::skew::opening::Opening;
use crate::design::skew::pupil::pupil_function;
use crate::design::skew::system::BuiltLens;
use crate::design::skew::trace::SkewTracer;
use crate::real;

/// L1 difference of PSFs, each of sum 1.
fn difference(a: &[f64], b: &[f64]) -> f64 {
    let [a_sum, b_sum] = [a, b].map(|v| v.iter().sum::<f64>());
    a.iter().zip(b).map(|(a, b)| (a / a_sum - b / b_sum).abs()).sum()
}

fn function(system: &System, deviations: &[Deviation], um: f64, film_mm: [f64; 2]) -> PupilFunction {
    let built = BuiltLens::new(system, deviations).unwrap();
    pupil_function(&SkewTracer::new(&built, um).unwrap(), film_mm, None).unwrap()
}

/// Lenses without rims, with one to four, with an obscuration.
#[test]
fn a_lens_without_deviations_has_the_psfs_of_its_nominal_lens_in_turned_frames() {
    let mut clipped = double_gauss(RayAiming::Real);
    clipped.surfaces[0].aperture_mm = Some(26.0);
    clipped.surfaces[10].aperture_mm = Some(16.0);
    let lenses = [
        (double_gauss(RayAiming::Real), 19.0, 1e-6),
        (double_gauss(RayAiming::Paraxial), 12.0, 1e-6),
        (test_lenses::lens("phone"), 2.0, 1e-6),
        // J becomes 0 within the pupil, where √J has a kink that polynomials do not follow.
        (test_lenses::lens("phone"), 2.4, 1e-3),
        (clipped, 19.0, 1e-4),
        (test_lenses::lens("mirrorless-50"), 18.0, 1e-4),
        (test_lenses::lens("macro-70"), 19.0, 1e-4),
        (test_lenses::lens("mirror-500"), 15.0, 1e-4),
    ];
    for (system, r_mm, tolerance) in lenses {
        let tracer = Tracer::new(&system, 0.55).unwrap();
        for (share, azimuth) in [(0.0, 0.0), (0.5, 0.7), (1.0, -2.0), (1.0, 0.5 * FRAC_PI_2)] {
            let r_mm = share * r_mm;
            let expected = PupilFunction::trace(&tracer, tracer.field_of_height(r_mm).unwrap()).unwrap();
            let (s, c) = real::sin_cos(azimuth);
            let found = function(&system, &[], 0.55, [r_mm * c, r_mm * s]);
            let (half, pitch_um) = (10, 0.9 * expected.nyquist_um());
            let (slow, plain) =
                (direct_sum(&found, half, pitch_um, -azimuth), direct_sum(&expected, half, pitch_um, 0.0));
            let l1 = difference(&slow, &plain);
            let light = slow.iter().sum::<f64>() / plain.iter().sum::<f64>() - 1.0;
            println!("{} {r_mm} mm {azimuth}: L1 {l1:.1e}, light {light:.1e}", system.name);
            assert!(l1 < tolerance && light.abs() < tolerance, "{} {r_mm} mm: {l1:e} {light:e}", system.name);
            let fast = PsfGrid::new(half, pitch_um).psf(&found, -azimuth, &mut PsfScratch::default());
            let l1 = difference(&fast, &slow);
            // The transform is in f32.
            assert!(l1 < 2e-5, "{} {r_mm} mm: {l1:e}", system.name);
        }
    }
}

/// |Σ w √(Φ J / N) e^{ik(W + L X + M Y)}|² over rays alone, of sum 1.
fn sum_of_rays(tracer: &SkewTracer<'_>, film_mm: [f64; 2], half: usize, pitch_um: f64) -> Vec<f64> {
    let t = tracer.field_of(film_mm).unwrap();
    let chief = tracer.ray(t, 0.0, 0.0).unwrap();
    let k = TAU / tracer.wavelength_um;
    let rays: Vec<(f64, f64, Complex<f64>)> = Opening::new(tracer, t)
        .unwrap()
        .nodes(tracer, t, 40, 120)
        .iter()
        .map(|n| {
            let r = tracer.ray(t, n.p, n.q).unwrap();
            let (dx, dy) = (r.x.v - chief.x.v, r.y.v - chief.y.v);
            let w_um = 1e3 * (r.path.v - chief.path.v - r.l.v * dx - r.m.v * dy);
            let jacobian = (r.l.d[0] * r.m.d[1] - r.l.d[1] * r.m.d[0]).abs();
            let amplitude = n.weight * (r.flux * jacobian / r.n).sqrt();
            (r.l.v, r.m.v, Complex::from_polar(1.0, k * w_um) * amplitude)
        })
        .collect();
    let at = |i: usize| (i as f64 - half as f64) * pitch_um;
    let n = 2 * half + 1;
    let power = |i: usize| {
        let (x, y) = (at(i % n), at(i / n));
        rays.iter()
            .map(|(l, m, c)| c * Complex::from_polar(1.0, k * (l * x + m * y)))
            .sum::<Complex<f64>>()
            .norm_sqr()
    };
    let psf: Vec<f64> = (0..n * n).map(power).collect();
    let sum: f64 = psf.iter().sum();
    psf.into_iter().map(|v| v / sum).collect()
}

#[test]
fn psfs_of_built_lenses_are_sums_over_rays() {
    let mut clipped = double_gauss(RayAiming::Real);
    clipped.surfaces[0].aperture_mm = Some(24.0);
    clipped.surfaces[10].aperture_mm = Some(15.0);
    let phone = [moved([1, 2], [0.004, -0.003], [ARCMIN, -ARCMIN]), film([3.0 * ARCMIN, ARCMIN])];
    let lenses = [
        (double_gauss(RayAiming::Real), lens_0(), [-11.0, 14.0]),
        (clipped, vec![moved([0, 1], [0.6, 0.9], [0.0; 2])], [10.0, -15.0]),
        (test_lenses::lens("phone"), phone.to_vec(), [-1.5, 1.8]),
        (test_lenses::lens("mirror-500"), vec![moved([0, 0], [0.2, -0.1], [0.0, ARCMIN])], [9.0, 5.0]),
    ];
    for (system, deviations, film_mm) in lenses {
        let built = BuiltLens::new(&system, &deviations).unwrap();
        let tracer = SkewTracer::new(&built, UM).unwrap();
        let f = pupil_function(&tracer, film_mm, None).unwrap();
        let (half, pitch_um) = (6, 1.1 * f.nyquist_um());
        let l1 =
            difference(&direct_sum(&f, half, pitch_um, 0.0), &sum_of_rays(&tracer, film_mm, half, pitch_um));
        println!("{}: L1 {l1:.1e}", system.name);
        assert!(l1 < 2e-5, "{}: {l1:e}", system.name);
    }
}

/// `psf(lens0()[0], field_of(lens0()[0], X, Y, UM), UM, 5, 1.1, True, 34, 100)` of the model for built lens 0, row down = +Y.
#[test]
fn psfs_of_built_lens_0() {
    let golden: [([f64; 2], [f64; 25]); 3] = [
        (
            [0.0, 0.0],
            [
                0.063086939,
                0.011348394,
                0.000173504,
                0.005580332,
                0.043894801,
                0.027617047,
                0.018265253,
                0.080122806,
                0.028950901,
                0.008096585,
                0.020851498,
                0.044843670,
                0.156816960,
                0.070131400,
                0.002704184,
                0.055889964,
                0.000464204,
                0.031083058,
                0.005990401,
                0.027943767,
                0.073705891,
                0.062376323,
                0.035599104,
                0.049123682,
                0.075339331,
            ],
        ),
        (
            [9.0, -4.0],
            [
                0.006437536,
                0.024132173,
                0.008834212,
                0.015688215,
                0.029102461,
                0.014542978,
                0.051267830,
                0.056469733,
                0.049505813,
                0.085131493,
                0.035635633,
                0.072523483,
                0.105989696,
                0.050038050,
                0.032453548,
                0.052923670,
                0.044681867,
                0.071584952,
                0.034744651,
                0.011937908,
                0.044634575,
                0.024965058,
                0.014569526,
                0.016578405,
                0.045626535,
            ],
        ),
        (
            [-11.0, 14.0],
            [
                0.002848520,
                0.010063156,
                0.017398445,
                0.019348672,
                0.012597401,
                0.020053351,
                0.020306859,
                0.029090910,
                0.031187769,
                0.018967175,
                0.066349843,
                0.044938925,
                0.034645999,
                0.030226748,
                0.018429445,
                0.119211860,
                0.095796375,
                0.049923608,
                0.021243311,
                0.007298843,
                0.080696523,
                0.129668034,
                0.086550978,
                0.028724537,
                0.004432715,
            ],
        ),
    ];
    for (film_mm, expected) in golden {
        let found =
            direct_sum(&function(&double_gauss(RayAiming::Real), &lens_0(), UM, film_mm), 2, 1.1, 0.0);
        let l1 = difference(&found, &expected);
        println!("{film_mm:?}: {l1:.1e}");
        assert!(l1 < 2e-6, "{film_mm:?}: {l1:e}");
    }
}

/// `azimuth_psf(lens0()[0], 15.0, 2.2, UM, 5, 1.1, rings=34, spokes=100)` of the model: the lens is turned there, the wavelets here.
#[test]
fn the_psf_in_a_turned_frame_is_that_of_the_turned_lens() {
    let expected: [f64; 25] = [
        0.002100591,
        0.005794151,
        0.026972041,
        0.028748195,
        0.030896432,
        0.012465513,
        0.021791822,
        0.068414556,
        0.077556074,
        0.043489712,
        0.024274003,
        0.040507641,
        0.106393569,
        0.120157710,
        0.063131450,
        0.011262039,
        0.024483567,
        0.074789165,
        0.080475921,
        0.042725881,
        0.001649193,
        0.006886646,
        0.028811012,
        0.028122840,
        0.028100273,
    ];
    let (s, c) = real::sin_cos(2.2);
    let f = function(&double_gauss(RayAiming::Real), &lens_0(), UM, [15.0 * c, 15.0 * s]);
    let l1 = difference(&direct_sum(&f, 2, 1.1, -2.2), &expected);
    println!("{l1:.1e}");
    assert!(l1 < 2e-6, "{l1:e}");
    let l1 = difference(&direct_sum(&f.turned(-2.2), 2, 1.1, 0.0), &expected);
    assert!(l1 < 2e-6, "{l1:e}");
}

/// Deviations turned by +90 degrees about z, +x to +y, which is UP the film.
#[test]
fn turned_deviations_turn_the_psf() {
    let system = double_gauss(RayAiming::Real);
    let original = [
        moved(REAR, [0.05, 0.02], [0.0, 2.0 * ARCMIN]),
        moved([4, 4], [0.0; 2], [ARCMIN, 0.0]),
        film([0.0, 5.0 * ARCMIN]),
    ];
    let turned = [
        moved(REAR, [-0.02, 0.05], [-2.0 * ARCMIN, 0.0]),
        moved([4, 4], [0.0; 2], [0.0, ARCMIN]),
        film([-5.0 * ARCMIN, 0.0]),
    ];
    let [x, y] = [9.0, -4.0];
    let (half, n) = (8, 17);
    let [a, b] = [(&original, [x, y]), (&turned, [y, -x])]
        .map(|(deviations, at)| direct_sum(&function(&system, deviations, UM, at), half, 0.9, 0.0));
    // (X, Y) of the film turns to (Y, −X).
    let expected: Vec<f64> = (0..n * n).map(|i| a[(i % n) * n + n - 1 - i / n]).collect();
    let l1 = difference(&b, &expected);
    println!("{l1:.1e}");
    assert!(l1 < 2e-6, "{l1:e}");
    assert!(difference(&b, &a) > 0.1, "the PSF itself has no such symmetry");
}

#[test]
fn stacks_of_whole_pupils_are_kept() {
    let mut clipped = double_gauss(RayAiming::Real);
    clipped.surfaces[0].aperture_mm = Some(24.0);
    clipped.surfaces[10].aperture_mm = Some(15.0);
    let errors = [moved([0, 1], [0.6, 0.9], [0.0; 2])];
    let places = [[0.0, 0.0], [10.0, -15.0]];
    let functions: Vec<PupilFunction> =
        places.iter().map(|at| function(&clipped, &errors, UM, *at).turned(-0.4)).collect();
    let grid = PsfGrid::new(20, 0.8);
    let stack = PupilStack::new(&grid, functions.clone());
    let psfs = stack.psfs(1).unwrap();
    for (k, f) in functions.iter().enumerate() {
        let psf = grid.psf(f, 0.0, &mut PsfScratch::default());
        let kept: Vec<f64> = psfs.window(k).iter().map(|v| f64::from(*v)).collect();
        assert!(difference(&psf, &kept) < 1e-5);
    }
    let (numbers, values) = stack.whole_parts();
    assert!(stack.is_whole() && numbers.iter().any(|n| n[6] != 0.0 && n[7] != 0.0 && n[3] < 0.0));
    let heights: Vec<f64> = functions.iter().map(|f| f.height_mm).collect();
    let samples = (stack.size(), stack.pitch_um());
    let back = PupilStack::from_whole_parts(1e3 * UM, &heights, samples, &numbers, &values).unwrap();
    assert_eq!(back.psfs(3).unwrap(), psfs);
    let mut wrong = numbers;
    wrong[0][7] = f64::NAN;
    let error = PupilStack::from_whole_parts(1e3 * UM, &heights, samples, &wrong, &values).unwrap_err();
    assert_eq!(error.to_string(), "segment 0 has the centre NaN across the meridian, expected -1 to 1");
}
