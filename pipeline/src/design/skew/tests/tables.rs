//! The tables of built lenses: kernels of the film against direct traces, azimuths, energies, determinism.

use std::f64::consts::TAU;

use super::lenses::{ARCMIN, double_gauss, film, lens_0, moved};
use crate::design::prescription::system::{RayAiming, System};
use crate::design::psf::film_pixel::FilmPixels;
use crate::design::psf::{PsfGrid, PsfScratch};
use crate::design::pupil::test_lenses;
use crate::design::skew::deviation::Deviation;
use crate::design::skew::map::FilmRange;
use crate::design::skew::pupil::pupil_function;
use crate::design::skew::system::BuiltLens;
use crate::design::skew::tables::{NominalNodes, SkewTrace};
use crate::design::skew::trace::SkewTracer;
use crate::design::tables::trace::{Azimuths, PsfHeights, TraceOptions, TracedBand, with_threads};
use crate::lens::planar::PsfPlaces;
use crate::psf::grid::{Node, NodeGrid};
use crate::psf::kernel::{KernelScratch, NodeKernels};
use crate::real;
use crate::simd::Simd;

fn traced(lens: &BuiltLens, options: &TraceOptions) -> TracedBand {
    let half = options.max_height_mm / 1.6;
    let trace = SkewTrace::new(lens, options, FilmRange::centred([half; 2])).unwrap();
    trace.band(0, &mut NominalNodes::default(), &mut |_| ()).unwrap()
}

fn azimuth_samples(band: &TracedBand) -> &[usize] {
    match &band.tables.planar.as_ref().unwrap().psfs {
        PsfPlaces::Polar { azimuth_samples } => azimuth_samples,
        PsfPlaces::Cartesian { .. } => panic!("polar"),
    }
}

/// The film's kernel at a place: linear in height and azimuth between nodes.
fn film_kernel(kernels: &NodeKernels, grid: &NodeGrid, band: &TracedBand, r: f64, azimuth: f64) -> Vec<f64> {
    let (heights, counts) = (&band.tables.psf_height_mm, &band.tables.azimuth_count);
    let k = heights.partition_point(|h| *h <= r).clamp(1, heights.len() - 1);
    let up = (r - heights[k - 1]) / (heights[k] - heights[k - 1]);
    let n = kernels.size();
    let (mut sum, mut out, mut scratch) = (vec![0.0; n * n], vec![0.0_f32; n * n], KernelScratch::default());
    for (k, share) in [(k - 1, 1.0 - up), (k, up)] {
        let at = azimuth.rem_euclid(TAU) / TAU * counts[k] as f64;
        for (j, weight) in [(at.floor(), 1.0 - at.fract()), (at.floor() + 1.0, at.fract())] {
            let node = Node { k, j: j as usize % counts[k] };
            kernels.kernel(grid, node, &mut scratch, &mut out);
            sum.iter_mut().zip(&out).for_each(|(s, v)| *s += share * weight * f64::from(*v));
        }
    }
    sum
}

/// L1 errors of the film's kernels at `places` (height as a share of the largest, azimuth).
fn errors(lens: &BuiltLens, options: &TraceOptions, places: &[(f64, f64)]) -> (TracedBand, Vec<f64>) {
    let band = traced(lens, options);
    band.tables.check().unwrap();
    let film_um = options.film_pitch_um;
    let kernels = NodeKernels::new(&band.psf, film_um, None, Simd::detect());
    let (heights, counts) = (&band.tables.psf_height_mm, &band.tables.azimuth_count);
    let grid = NodeGrid::polar(heights, counts, azimuth_samples(&band), 1e-3 * film_um);
    let tracer = SkewTracer::new(lens, options.wavelengths_nm[0] / 1e3).unwrap();
    let half = options.max_height_mm;
    let psfs = PsfGrid::new(band.tables.psf_size / 2, band.tables.psf_pitch_um);
    let pixels = FilmPixels::new(psfs.size(), psfs.pitch_um(), kernels.size(), film_um);
    let error = |(share, azimuth): &(f64, f64)| {
        let (s, c) = real::sin_cos(*azimuth);
        let f = pupil_function(&tracer, [share * half * c, share * half * s], None).unwrap();
        let truth = pixels.integrate(&psfs.psf(&f, 0.0, &mut PsfScratch::default()));
        let sum: f64 = truth.iter().sum();
        let found = film_kernel(&kernels, &grid, &band, share * half, *azimuth);
        found.iter().zip(&truth).map(|(f, t)| (f - t / sum).abs()).sum()
    };
    let errors = places.iter().map(error).collect();
    (band, errors)
}

/// Quasi-random places of the disc.
fn places(count: usize) -> Vec<(f64, f64)> {
    let at = |k: usize, step: f64| (k as f64 * step).fract();
    (1..=count).map(|k| (at(k, 0.754_877_666_2).sqrt(), TAU * at(k, 0.569_840_291))).collect()
}

fn check(name: &str, lens: &BuiltLens, options: &TraceOptions, (count, most_median): (usize, f64)) {
    let (band, mut errors) = errors(lens, options, &places(count));
    errors.sort_by(f64::total_cmp);
    let (median, worst) = (errors[errors.len() / 2], errors[errors.len() - 1]);
    println!(
        "{name}: {} PSFs, A {:?}, {:?}, L1 {worst:.4}, median {median:.4}",
        band.psf.heights(),
        azimuth_samples(&band),
        band.report
    );
    assert!(worst <= 0.015 && median <= most_median, "{name}: {worst} {median}");
}

fn phone_errors() -> Vec<Deviation> {
    let element = |surfaces: [usize; 2], dx: f64, dy: f64, tx: f64, ty: f64| {
        moved(surfaces, [1e-3 * dx, 1e-3 * dy], [tx * ARCMIN, ty * ARCMIN])
    };
    vec![
        element([1, 2], 2.0, -1.5, 0.7, -0.5),
        element([3, 4], -1.0, 2.0, -0.4, 0.9),
        film([ARCMIN, -2.0 * ARCMIN]),
    ]
}

/// The Double Gauss with two rims beside the stop's.
fn clipped() -> System {
    let mut clipped = double_gauss(RayAiming::Real);
    clipped.surfaces[0].aperture_mm = Some(26.0);
    clipped.surfaces[10].aperture_mm = Some(16.0);
    clipped
}

#[test]
fn film_kernels_of_a_built_lens_are_those_of_direct_traces() {
    let built = BuiltLens::new(&double_gauss(RayAiming::Real), &lens_0()).unwrap();
    check("Double Gauss", &built, &TraceOptions::new(vec![550.0], 4.0), (3, 0.006));
}

#[test]
#[ignore = "long: 40 s"]
fn film_kernels_of_built_lenses_are_those_of_direct_traces() {
    let built = BuiltLens::new(&double_gauss(RayAiming::Real), &lens_0()).unwrap();
    check("Double Gauss", &built, &TraceOptions::new(vec![550.0], 19.0), (50, 0.006));
    let built = BuiltLens::new(&test_lenses::lens("phone"), &phone_errors()).unwrap();
    let options = TraceOptions { film_pitch_um: 1.12, ..TraceOptions::new(vec![550.0], 2.2) };
    // The nominal phone lens has 0.0081 at these places.
    check("phone", &built, &options, (50, 0.009));
    let built = BuiltLens::new(&clipped(), &lens_0()).unwrap();
    check("vignetted", &built, &TraceOptions::new(vec![550.0], 19.0), (50, 0.006));
}

#[test]
fn a_lens_without_deviations_has_one_azimuth_a_height_and_the_nodes_of_its_nominal_lens() {
    let system = double_gauss(RayAiming::Real);
    let built = BuiltLens::new(&system, &[]).unwrap();
    let options = TraceOptions::new(vec![550.0], 4.0);
    let band = traced(&built, &options);
    assert!(azimuth_samples(&band).iter().all(|a| *a == 1), "{:?}", azimuth_samples(&band));
    let nominal = crate::design::trace::LensTrace::new(&system, &options).unwrap().with_base_nodes();
    let nominal = nominal.band(0, &mut |_| ()).unwrap();
    assert_eq!(band.tables.psf_height_mm, nominal.tables.psf_height_mm);
    assert_eq!(band.tables.azimuth_count, nominal.tables.azimuth_count);
    assert!((band.tables.solid_angle_sr / nominal.tables.solid_angle_sr - 1.0).abs() < 1e-9);
    assert_eq!(band.psf.size, nominal.psf.size);
    for k in 0..nominal.psf.heights() {
        let l1: f32 = band.psf.window(k).iter().zip(nominal.psf.window(k)).map(|(a, b)| (a - b).abs()).sum();
        let energy = (band.tables.psf_energy[k] - nominal.tables.psf_energy[k]).abs();
        assert!(l1 < 5e-5 && energy < 1e-6, "{k}: {l1:e} {energy:e}");
    }
}

#[test]
fn the_bits_of_a_band_do_not_depend_on_threads() {
    let built = BuiltLens::new(&double_gauss(RayAiming::Real), &lens_0()).unwrap();
    let options = TraceOptions {
        heights: PsfHeights::Given(vec![0.0, 5.0, 10.0]),
        azimuths: Azimuths::Given(24),
        ..TraceOptions::new(vec![550.0], 10.0)
    };
    let [one, three] = [1, 3].map(|threads| with_threads(threads, || traced(&built, &options)));
    assert_eq!(one, three);
    assert_eq!(one.pupils.psfs(2).unwrap(), one.psf, "pupil functions give the PSFs of the stack");
    let samples = azimuth_samples(&one);
    assert!(samples[0] == 1 && samples[1] >= 8, "{samples:?}");
}
