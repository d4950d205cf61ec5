//! PSFs by FFT against the sum without it.

use std::f64::consts::PI;

use rustfft::num_complex::Complex;

use super::{PsfGrid, PsfScratch, PupilFunction, Wavelet};
use crate::design::prescription::system::System;
use crate::design::rays::ray::Tracer;

/// The wavelets of the whole pupil of `f`, rotated by `azimuth_rad`.
fn rotated(f: &PupilFunction, reach_um: f64, azimuth_rad: f64) -> Vec<Wavelet> {
    let mut part = Vec::new();
    f.wavelets_into(reach_um, f.wavelength_um, &mut part);
    let (sin, cos) = crate::real::sin_cos(azimuth_rad);
    let signs: &[f64] = if f.is_whole { &[1.0] } else { &[1.0, -1.0] };
    let turned = |w: &Wavelet, m: f64| Wavelet { l: w.l * cos - m * sin, m: w.l * sin + m * cos, ..*w };
    part.iter().flat_map(|w| signs.iter().map(move |sign| turned(w, sign * w.m))).collect()
}

/// The Huygens sum without FFT: the same wavelets, summed for every sample.
pub(in crate::design) fn direct_sum(
    f: &PupilFunction,
    half: usize,
    pitch_um: f64,
    azimuth_rad: f64,
) -> Vec<f64> {
    let wavelets = rotated(f, pitch_um * half as f64, azimuth_rad);
    let k = 2.0 * PI / f.wavelength_um;
    let n = 2 * half + 1;
    let at = |i: usize| (i as f64 - half as f64) * pitch_um;
    let mut out = Vec::with_capacity(n * n);
    for y in 0..n {
        for x in 0..n {
            let u: Complex<f64> = wavelets
                .iter()
                .map(|w| w.c * Complex::from_polar(1.0, k * (w.l * at(x) + w.m * at(y))))
                .sum();
            out.push(u.norm_sqr() * f.share(pitch_um));
        }
    }
    out
}

#[test]
fn nufft_psf_equals_the_direct_sum() {
    let system = System::double_gauss_28();
    for (um, tan, azimuth, pitch) in [(0.4, 0.0, 0.0, 0.5), (0.4, 0.2, 0.7, 0.5), (0.6, 0.1, -2.0, 0.66)] {
        let tracer = Tracer::new(&system, um).unwrap();
        let f = PupilFunction::trace(&tracer, tan).unwrap();
        let slow = direct_sum(&f, 12, pitch, azimuth);
        let fast = PsfGrid::new(12, pitch).psf(&f, azimuth, &mut PsfScratch::default());
        let peak = slow.iter().fold(0.0_f64, |a, v| a.max(*v));
        assert_eq!(slow.len(), fast.len());
        assert!(fast.iter().all(|v| v.is_finite()));
        let worst = slow.iter().zip(&fast).map(|(a, b)| (a - b).abs() / peak).fold(0.0, f64::max);
        let l1 = slow.iter().zip(&fast).map(|(a, b)| (a - b).abs()).sum::<f64>() / slow.iter().sum::<f64>();
        println!("{um} µm, tan {tan}: {worst:.1e} of the peak, L1 {l1:.1e}");
        // The transform is in f32: 2e-6 to 1e-5 of the peak by the density of its points.
        assert!(worst < 1e-5 && l1 < 1e-5, "{um} µm: {worst:.2e} of the peak, L1 {l1:.2e}");
    }
}

#[test]
fn shift_by_whole_samples_moves_the_psf_towards_x() {
    let system = System::double_gauss_28();
    let tracer = Tracer::new(&system, 0.41).unwrap();
    let f = PupilFunction::trace(&tracer, 0.18).unwrap();
    let (half, pitch_um, steps) = (14, 0.5, 3);
    let (n, grid) = (2 * half + 1, PsfGrid::new(half, pitch_um));
    let (mut scratch, mut plain, mut shifted) = (PsfScratch::default(), Vec::new(), Vec::new());
    grid.psf_into(&f, 0.0, &mut scratch, &mut plain);
    grid.shifted_into(&f, steps as f64 * pitch_um, &mut scratch, &mut shifted);
    let peak = plain.iter().fold(0.0_f32, |a, v| a.max(*v));
    for y in 0..n {
        for x in steps..n {
            let difference = (shifted[y * n + x] - plain[y * n + x - steps]).abs();
            assert!(difference < 2e-5 * peak, "{y}, {x}: {difference:e} of {peak:e}");
        }
    }
}

#[test]
fn the_extent_holds_all_directions_along_and_across_the_meridian() {
    let system = System::double_gauss_28();
    let tracer = Tracer::new(&system, 0.55).unwrap();
    for tan in [0.0, 0.15, 0.249] {
        let f = PupilFunction::trace(&tracer, tan).unwrap();
        let half = f.extent.map(|(least, most)| 0.5 * (most - least));
        let wavelets = rotated(&f, 50.0, 0.0);
        let most = wavelets.iter().fold([0.0_f64; 2], |[l, m], w| [l.max(w.l.abs()), m.max(w.m.abs())]);
        for (half, most) in half.into_iter().zip(most) {
            // The tables' points lie inside the rim.
            assert!(most > 0.9 * half && most < 1.03 * half, "tan {tan}: {most}, extent ± {half}");
        }
        // Vignetting limits the pupil along the meridian more than across.
        assert!(tan < 0.2 || half[1] > 1.02 * half[0], "{half:?}");
    }
}
