//! The transpose of the film compared with the film, by dot products and entry by entry.

mod problem;

use crate::oracle::{Check, Noise};
use lenscube_pipeline::adjoint::AdjointError;
use lenscube_pipeline::design::{System, TraceOptions, trace_lens};
use lenscube_pipeline::geometry::{Frame, Rect, Size};
use lenscube_pipeline::layer::{BinGrid, Layer, Taps};
use lenscube_pipeline::lens::PsfSample;
use lenscube_pipeline::resample::{Interp, Surround};
use lenscube_pipeline::simd::Simd;
use lenscube_pipeline::stage::{Stage, Stages};
use problem::{Lenses, Problem};

/// All of them.
pub const CHECKS: [(&str, Check); 10] = [
    ("transpose_of_the_remap_stage", transpose_of_the_remap_stage),
    ("transpose_of_the_psf_stage", transpose_of_the_psf_stage),
    ("transpose_of_all_stages", transpose_of_all_stages),
    ("transpose_without_rotational_symmetry", transpose_without_rotational_symmetry),
    ("transpose_of_tails", transpose_of_tails),
    ("transpose_of_tails_entry_by_entry", transpose_of_tails_entry_by_entry),
    ("transpose_of_a_double_gauss", transpose_of_a_double_gauss),
    ("transpose_entry_by_entry", transpose_entry_by_entry),
    ("transpose_has_the_same_bits_for_threads_and_caches", same_bits_for_threads_and_caches),
    ("what_has_no_transpose_is_an_error", what_has_no_transpose_is_an_error),
];

const REMAP: Stages = Stages::of(&[Stage::Ri, Stage::Distortion]);
const PSF: Stages = Stages::of(&[Stage::Svpsf]);
const ALL: Stages = Stages::of(&[Stage::Ri, Stage::Distortion, Stage::Svpsf]);

/// The largest residual of dot products that is admitted, relative to |A x| |y|: the rounding of f32 transforms.
const TOLERANCE: f64 = 1e-6;

/// ⟨A x, y⟩ = ⟨x, Aᵀ y⟩ for charts and films of numbers of both signs, of positive numbers, and for films that are dark but for some pixels of their border and corners.
fn check_dot_products(problem: &Problem, noise: &mut Noise, name: &str) {
    let (chart, film) = (problem.frame.chart, problem.frame.film);
    for (low, high) in [(-1.0, 1.0), (0.0, 1.0)] {
        let mut numbers =
            |n: usize| -> Vec<f32> { (0..n).map(|_| noise.between(low, high) as f32).collect() };
        let x = numbers(chart.pixels());
        let image = problem.film(&x);
        let y = numbers(film.pixels());
        let corner = Rect::new(film.height as i64 - 3, -2, 5, 7);
        let is_at_corner =
            |i: usize| corner.contains(Rect::new((i / film.width) as i64, (i % film.width) as i64, 1, 1));
        let at_corner = y.iter().enumerate().map(|(i, v)| if is_at_corner(i) { *v } else { 0.0 }).collect();
        for y in [y, at_corner] {
            let residual = residual(&x, &image, &y, &problem.chart(&y, 2));
            assert!(residual <= TOLERANCE, "{name}, numbers from {low}: {residual:.1e}");
        }
    }
}

/// (⟨A x, y⟩ − ⟨x, Aᵀ y⟩)/(|A x| |y|).
fn residual(x: &[f32], ax: &[f32], y: &[f32], aty: &[f32]) -> f64 {
    let dot = |a: &[f32], b: &[f32]| -> f64 {
        assert_eq!(a.len(), b.len());
        a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
    };
    let difference = (dot(ax, y) - dot(x, aty)).abs();
    assert!(difference.is_finite());
    let scale = (dot(ax, ax) * dot(y, y)).sqrt();
    if scale == 0.0 { difference } else { difference / scale }
}

/// A frame whose axis and centre are off the middle.
fn frame(noise: &mut Noise, film: Size, chart: Size, scale: (f64, f64)) -> Frame {
    let mut frame = Frame { scale, ..Frame::centred(film, chart, 2.0) };
    frame.axis_px.0 += noise.between(-20.0, 20.0);
    frame.axis_px.1 += noise.between(-20.0, 20.0);
    frame.center_mm = (noise.between(-0.02, 0.02), noise.between(-0.02, 0.02));
    frame
}

fn transpose_of_the_remap_stage(simd: Simd) {
    let mut noise = Noise(41);
    let (small, wide) = (Size::new(61, 47), Size::new(90, 1300));
    for (film, chart, scale) in [
        (small, Size::new(64, 53), (1.0, 1.0)),
        (small, Size::new(20, 90), (1.7, 1.2)),
        (small, Size::new(97, 140), (0.7, 0.31)),
        (small, Size::new(50, 40), (0.8, 1.6)),
        (Size::new(1, 5), Size::new(3, 1), (1.0, 2.5)),
        (wide, Size::new(70, 1200), (1.0, 1.1)),
    ] {
        let frame = frame(&mut noise, film, chart, scale);
        for surround in [Surround::Edge, Surround::Black, Surround::Mirror] {
            for interp in [Interp::Bicubic, Interp::Bilinear] {
                let mut problem = Problem::new(Lenses::random(&mut noise, &frame, 1), frame, REMAP, simd);
                problem.options.interpolation.surround = surround;
                problem.options.interpolation.interp = interp;
                problem.gain = 3.7;
                let name = format!("film {film}, chart {chart}, scale {scale:?}, {surround:?}, {interp:?}");
                check_dot_products(&problem, &mut noise, &name);
            }
        }
    }
}

fn transpose_of_the_psf_stage(simd: Simd) {
    let mut noise = Noise(43);
    for (film, window, axis_px) in [
        (Size::new(150, 131), 9, (60.0, 70.25)),
        (Size::new(150, 131), 9, (-400.0, 30.0)),
        (Size::new(40, 333), 31, (19.5, 166.0)),
        (Size::new(3, 2), 15, (1.0, 0.5)),
        (Size::new(33, 45), 1, (16.0, 22.0)),
        (Size::new(700, 560), 21, (350.0, 280.0)),
    ] {
        // The chart lies on the film, whose surroundings are dark.
        let mut frame = Frame { axis_px, ..Frame::centred(film, film, 2.0) };
        let from_middle = |n: usize, axis: f64| ((n as f64 - 1.0) / 2.0 - axis) * frame.pitch_mm();
        frame.center_mm = (from_middle(film.height, axis_px.0), from_middle(film.width, axis_px.1));
        let mut problem = Problem::new(Lenses::random(&mut noise, &frame, window), frame, PSF, simd);
        problem.options.interpolation.surround = Surround::Black;
        check_dot_products(&problem, &mut noise, &format!("film {film}, window {window}, axis {axis_px:?}"));
    }
}

fn transpose_of_all_stages(simd: Simd) {
    let mut noise = Noise(47);
    for (film, chart, scale, window, surround) in [
        (Size::new(301, 277), Size::new(310, 290), (1.0, 1.0), 21, Surround::Edge),
        (Size::new(37, 700), Size::new(30, 650), (1.3, 1.07), 15, Surround::Mirror),
        (Size::new(120, 90), Size::new(150, 160), (0.8, 0.6), 9, Surround::Edge),
        (Size::new(3, 2), Size::new(50, 60), (1.0, 1.0), 31, Surround::Black),
    ] {
        let frame = frame(&mut noise, film, chart, scale);
        let mut problem = Problem::new(Lenses::random(&mut noise, &frame, window), frame, ALL, simd);
        problem.options.interpolation.surround = surround;
        problem.gain = 0.3;
        check_dot_products(&problem, &mut noise, &format!("film {film}, chart {chart}, window {window}"));
    }
}

/// PSFs at several azimuths and on columns and rows, in memory and read on demand; a map that is not symmetric.
fn transpose_without_rotational_symmetry(simd: Simd) {
    let mut noise = Noise(53);
    for (film, chart, scale) in [
        (Size::new(190, 160), Size::new(170, 190), (1.0, 1.1)),
        (Size::new(60, 70), Size::new(80, 75), (0.7, 1.0)),
    ] {
        let frame = frame(&mut noise, film, chart, scale);
        for lenses in [Lenses::with_azimuths, Lenses::cartesian] {
            let mut problem = Problem::new(lenses(&mut noise, &frame), frame, ALL, simd);
            check_dot_products(&problem, &mut noise, &format!("film {film}, in memory"));
            problem.on_demand = true;
            check_dot_products(&problem, &mut noise, &format!("film {film}, on demand"));
        }
    }
}

fn transpose_of_a_double_gauss(simd: Simd) {
    let mut stacks = Vec::new();
    let traced = trace_lens(
        &System::double_gauss_28(),
        &TraceOptions::new(vec![550.0], 0.3),
        &mut |_| (),
        |_, band| {
            stacks.push(band.psf);
            Ok::<(), String>(())
        },
    );
    let lens = traced.unwrap();
    assert_eq!(lens.psf_sample, PsfSample::Point);
    let (film, chart) = (Size::new(140, 101), Size::new(120, 130));
    let frame = Frame { axis_px: (80.0, 30.5), scale: (1.2, 1.0), ..Frame::centred(film, chart, 2.0) };
    let problem = Problem::new(Lenses { lens, stack: stacks.remove(0) }, frame, ALL, simd);
    check_dot_products(&problem, &mut Noise(59), "double Gauss");
}

/// Bins of 2 and 8 px, one level and several.
fn transpose_of_tails(simd: Simd) {
    let mut noise = Noise(73);
    for (film, chart, scale, window, surround) in [
        (Size::new(130, 171), Size::new(140, 150), (1.0, 1.1), 11, Surround::Edge),
        (Size::new(130, 171), Size::new(140, 150), (0.9, 1.0), 11, Surround::Mirror),
        (Size::new(530, 400), Size::new(500, 420), (1.0, 1.0), 41, Surround::Black),
        (Size::new(40, 30), Size::new(50, 20), (1.0, 1.5), 41, Surround::Edge),
    ] {
        let frame = frame(&mut noise, film, chart, scale);
        let mut problem = Problem::new(Lenses::with_tails(&mut noise, &frame, window), frame, ALL, simd);
        problem.options.interpolation.surround = surround;
        (problem.gain, problem.tails) = (2.5, true);
        check_dot_products(&problem, &mut noise, &format!("film {film}, window {window}, {surround:?}"));
    }
    let size = Size::new(130, 171);
    let with_middle = frame(&mut noise, size, size, (1.0, 1.0));
    let mut problem = Problem::new(Lenses::with_middle(&mut noise, &with_middle), with_middle, ALL, simd);
    problem.tails = true;
    check_dot_products(&problem, &mut noise, "middle part");
    let frame = frame(&mut noise, size, size, (1.0, 1.0));
    let mut problem = Problem::new(Lenses::with_tails(&mut noise, &frame, 11), frame, ALL, simd);
    problem.tails = true;
    let y: Vec<f32> = (0..size.pixels()).map(|_| noise.between(-1.0, 1.0) as f32).collect();
    assert_eq!(problem.chart(&y, 1), problem.chart(&y, 3));
}

fn transpose_of_tails_entry_by_entry(simd: Simd) {
    let mut noise = Noise(79);
    let frame = Frame { axis_px: (3.0, 4.5), ..Frame::centred(Size::new(6, 7), Size::new(5, 4), 2.0) };
    let mut problem = Problem::new(Lenses::with_tails(&mut noise, &frame, 11), frame, ALL, simd);
    problem.tails = true;
    check_entries(&problem);
}

/// Each column of A by a film of one chart pixel, each row of Aᵀ by the transpose of one film pixel: within 1e-6 of the largest entry.
fn check_entries(problem: &Problem) {
    let (film, chart) = (problem.frame.film.pixels(), problem.frame.chart.pixels());
    let unit = |n: usize, i: usize| (0..n).map(|k| f32::from(u8::from(k == i))).collect::<Vec<_>>();
    let columns: Vec<_> = (0..chart).map(|j| problem.film(&unit(chart, j))).collect();
    let rows: Vec<_> = (0..film).map(|i| problem.chart(&unit(film, i), 1)).collect();
    let largest = columns.iter().flatten().fold(0.0f32, |m, v| m.max(v.abs()));
    for (j, column) in columns.iter().enumerate() {
        for (i, v) in column.iter().enumerate() {
            let difference = (rows[i][j] - v).abs();
            assert!(difference <= 1e-6 * largest, "entry {i}, {j}: {v}, transpose {}", rows[i][j]);
        }
    }
}

fn transpose_entry_by_entry(simd: Simd) {
    let mut noise = Noise(61);
    let (film, chart) = (Size::new(9, 13), Size::new(11, 8));
    for (scale, surround) in [((1.0, 1.3), Surround::Edge), ((0.8, 1.1), Surround::Mirror)] {
        let frame = Frame {
            scale,
            axis_px: (3.0, 7.5),
            center_mm: (1e-3, -2e-3),
            ..Frame::centred(film, chart, 2.0)
        };
        let mut problem = Problem::new(Lenses::random(&mut noise, &frame, 5), frame, ALL, simd);
        problem.options.interpolation.surround = surround;
        check_entries(&problem);
    }
}

fn same_bits_for_threads_and_caches(simd: Simd) {
    let mut noise = Noise(67);
    let (film, chart) = (Size::new(300, 290), Size::new(270, 310));
    for scale in [(1.0, 1.1), (0.9, 0.7)] {
        let frame = frame(&mut noise, film, chart, scale);
        let mut problem = Problem::new(Lenses::random(&mut noise, &frame, 15), frame, ALL, simd);
        let y: Vec<f32> = (0..film.pixels()).map(|_| noise.between(-1.0, 1.0) as f32).collect();
        let one = problem.chart(&y, 1);
        problem.spectra_bytes = 1;
        for threads in [0, 3, 5] {
            let same = one.iter().zip(problem.chart(&y, threads)).all(|(a, b)| a.to_bits() == b.to_bits());
            assert!(same, "{threads} threads, scale {scale:?}");
        }
        let dark = problem.chart(&vec![0.0; film.pixels()], 2);
        assert!(dark.iter().all(|v| v.to_bits() == 0), "the chart of a dark film, overwritten");
    }
}

fn what_has_no_transpose_is_an_error(simd: Simd) {
    let size = Size::new(20, 30);
    let frame = Frame::centred(size, size, 2.0);
    let problem = Problem::new(Lenses::random(&mut Noise(71), &frame, 5), frame, ALL, simd);
    let film = vec![1.0; size.pixels()];
    assert!(matches!(problem.try_chart(&film[1..], 1, false, |_| ()), Err(AdjointError::Length { .. })));
    assert!(matches!(problem.try_chart(&film, 3, true, |_| ()), Err(AdjointError::Stopped)));
    let bins = BinGrid::new(size, 8, 2);
    let layer = Layer::new(bins, Taps::BSpline, vec![0.0; bins.size().pixels()]);
    let found = problem.try_chart(&film, 1, false, |stages| stages.layers.push(layer));
    assert!(found.unwrap_err().to_string().contains("veil"));
}
