//! Films of PSF fields with azimuths and of Cartesian fields, compared with f64 sums, with the NumPy reference and with each other.
//!
//! Each case runs once per instruction set; sets that the machine lacks are reported as ignored.

mod oracle;

use lenscube_pipeline::buffer::TileBuffer;
use lenscube_pipeline::geometry::{Frame, Rect, Size};
use lenscube_pipeline::lens::{PsfSample, PsfStack};
use lenscube_pipeline::psf::grid::{Node, NodeGrid};
use lenscube_pipeline::psf::kernel::on_demand::{KernelsOnDemand, PsfSource};
use lenscube_pipeline::psf::kernel::{KernelScratch, NodeKernels};
use lenscube_pipeline::psf::spectra::SpectrumCache;
use lenscube_pipeline::psf::{BandPsf, PsfScratch};
use lenscube_pipeline::simd::Simd;
use oracle::{Image, Noise, errors, on_every_isa};
use std::f64::consts::TAU;
use std::ops::Range;
use std::process::ExitCode;
use std::sync::Arc;

const PITCH_MM: f64 = 2e-3;

/// A PSF of `n` × `n` integrated samples at film pitch, sum 1: a Gaussian about (`cx`, `cy`) of widths `a` along x, `b` along y, px.
fn spot(n: usize, (cx, cy): (f64, f64), (a, b): (f64, f64)) -> Vec<f32> {
    let c = (n / 2) as f64;
    let value = |i: usize| {
        let (y, x) = ((i / n) as f64 - c - cy, (i % n) as f64 - c - cx);
        (-(x * x / (2.0 * a * a) + y * y / (2.0 * b * b))).exp()
    };
    normalised((0..n * n).map(value).collect())
}

/// The same with noise.
fn random_psf(noise: &mut Noise, n: usize) -> Vec<f32> {
    let centre = (noise.between(-1.5, 1.5), noise.between(-1.5, 1.5));
    let psf = spot(n, centre, (0.15 * n as f64 + 0.5, 0.1 * n as f64 + 0.5));
    normalised(psf.into_iter().map(|v| f64::from(v) * noise.between(0.5, 1.5)).collect())
}

fn normalised(psf: Vec<f64>) -> Vec<f32> {
    let sum: f64 = psf.iter().sum();
    psf.into_iter().map(|v| (v / sum) as f32).collect()
}

fn integrated(psfs: &[Vec<f32>]) -> PsfStack {
    let size = psfs[0].len().isqrt();
    PsfStack { size, pitch_um: 1e3 * PITCH_MM, sample: PsfSample::Integrated, samples: psfs.concat() }
}

fn frame(size: Size, axis_px: (f64, f64)) -> Frame {
    Frame { axis_px, ..Frame::centred(size, size, 1e3 * PITCH_MM) }
}

fn in_memory(grid: &NodeGrid, stack: &PsfStack, simd: Simd) -> BandPsf {
    BandPsf::new(0, grid.clone(), NodeKernels::new(stack, 1e3 * PITCH_MM, None, simd), simd)
}

fn on_demand(grid: &NodeGrid, stack: &PsfStack, simd: Simd) -> BandPsf {
    let (psfs, rows) = (stack.clone(), grid.clone());
    let reader = move |_: usize, sets: Range<usize>| {
        let rows = sets.flat_map(|set| rows.psf_rows(set));
        Ok(rows.flat_map(|row| psfs.window(row)).copied().collect::<Vec<f32>>())
    };
    let source = PsfSource::new(Arc::new(reader), 2);
    let shape = (stack.size, stack.pitch_um, stack.sample);
    let kernels = KernelsOnDemand::new((&source, 0), grid.psf_sets(), shape, 1e3 * PITCH_MM, None, simd);
    BandPsf::on_demand(0, grid.clone(), kernels, simd)
}

/// The film of `psf`, `remapped` being the remapped image on the film grown by half the window.
fn film(psf: &BandPsf, frame: &Frame, remapped: &Image, cache: &SpectrumCache) -> Vec<f32> {
    let (size, grown) = (frame.film, psf.reaches(frame.film.rect()));
    assert_eq!(grown.size(), remapped.size);
    let mut film = vec![0f32; size.pixels()];
    let mut scratch = PsfScratch::default();
    for tile in grown.tiles(psf.blocks().tile, psf.blocks().tile) {
        let at = |i: usize| {
            let (y, x) = ((tile.y - grown.y) as usize, (tile.x - grown.x) as usize);
            remapped.at(y + i / tile.width, x + i % tile.width) as f32
        };
        let pixels: Vec<f32> = (0..tile.size().pixels()).map(at).collect();
        let mut out = TileBuffer::default();
        psf.scatter(frame, tile, &pixels, cache, &mut out, &mut scratch);
        let reach = psf.reaches(tile);
        let on_film: Rect = reach.intersect(size.rect());
        for y in on_film.y..on_film.bottom() {
            for x in on_film.x..on_film.right() {
                film[y as usize * size.width + x as usize] +=
                    out.data[(y - reach.y) as usize * out.stride + (x - reach.x) as usize];
            }
        }
    }
    film
}

fn film_of(psf: &BandPsf, frame: &Frame, remapped: &Image) -> Vec<f32> {
    film(psf, frame, remapped, &SpectrumCache::new(64 << 20))
}

/// A remapped image for windows of `n` px: numbers in 0..1 that f32 holds.
fn noise_image(noise: &mut Noise, frame: &Frame, n: usize) -> Image {
    let size = frame.film.rect().grown(n / 2).size();
    Image { size, data: (0..size.pixels()).map(|_| f64::from(noise.next() as f32)).collect() }
}

/// film[v, u] = Σ remapped[y, x]·Σ weight·kernel[v − y, u − x], in f64; `nodes` has the kernels and weights at (X, Y) mm.
fn direct_sum(
    frame: &Frame,
    remapped: &Image,
    n: usize,
    nodes: impl Fn(f64, f64) -> Vec<(usize, f64)>,
    kernels: &[Vec<f64>],
) -> Vec<f64> {
    let (size, half) = (frame.film, (n / 2) as i64);
    let mut film = vec![0.0; size.pixels()];
    for row in 0..remapped.size.height {
        for col in 0..remapped.size.width {
            let (y, x) = (row as i64 - half, col as i64 - half);
            let place = |at: i64, axis: f64| (at as f64 - axis) * PITCH_MM;
            for (id, weight) in nodes(place(x, frame.axis_px.1), place(y, frame.axis_px.0)) {
                let value = weight * remapped.at(row, col);
                for (i, kernel) in kernels[id].iter().enumerate() {
                    let (v, u) = (y - half + (i / n) as i64, x - half + (i % n) as i64);
                    if (0..size.height as i64).contains(&v) && (0..size.width as i64).contains(&u) {
                        film[v as usize * size.width + u as usize] += value * kernel;
                    }
                }
            }
        }
    }
    film
}

/// The two of `at` that a place lies between, with their weights: linear, beyond either end that of the end.
fn between(at: &[f64], place: f64) -> [(usize, f64); 2] {
    if at.len() == 1 {
        return [(0, 1.0), (0, 0.0)];
    }
    let i = at.partition_point(|v| *v <= place).clamp(1, at.len() - 1);
    let share = ((place - at[i - 1]) / (at[i] - at[i - 1])).clamp(0.0, 1.0);
    [(i - 1, 1.0 - share), (i, share)]
}

/// Σ_h c_h exp(ihθ) with the Fourier coefficients c_h of `samples` at equidistant azimuths; of an even number the highest is a cosine.
fn fourier_interpolated(samples: &[&[f32]], theta: f64) -> Vec<f64> {
    let count = samples.len();
    let at = |a: usize| TAU * a as f64 / count as f64;
    let weight = |a: usize| {
        let x = theta - at(a);
        let full: f64 = (1..count.div_ceil(2)).map(|h| 2.0 * (h as f64 * x).cos()).sum();
        // Of an even number, cos(A/2·θ)·cos(A/2·φ_a).
        let half = count as f64 / 2.0;
        let highest = if count.is_multiple_of(2) { (half * theta).cos() * (half * at(a)).cos() } else { 0.0 };
        (1.0 + full + highest) / count as f64
    };
    let weights: Vec<f64> = (0..count).map(weight).collect();
    let sum = |i: usize| weights.iter().zip(samples).map(|(w, psf)| w * f64::from(psf[i])).sum();
    (0..samples[0].len()).map(sum).collect()
}

/// `psf` rotated by quarter turns, +x to +y (down).
fn quarter_turns<T: Copy>(psf: &[T], n: usize, turns: usize) -> Vec<T> {
    (0..turns).fold(psf.to_vec(), |k, _| (0..n * n).map(|i| k[(n - 1 - i % n) * n + i / n]).collect())
}

/// Random PSFs at `samples[k]` azimuths of heights with four nodes each, whose rotations are exact.
fn film_of_a_polar_field_equals_the_f64_sum(simd: Simd) {
    let heights_mm = [0.0, 0.06, 0.1, 0.25];
    for (n, samples, size, axis_px) in [
        (15, [1, 6, 5, 12], Size::new(90, 121), (44.5, 60.0)),
        (9, [1, 3, 1, 7], Size::new(64, 150), (-30.0, 20.25)),
        (31, [1, 8, 16, 10], Size::new(40, 50), (19.5, 24.5)),
        (1, [1, 6, 5, 12], Size::new(33, 45), (16.0, 22.0)),
    ] {
        let mut noise = Noise(n as u64 + 77);
        let psfs: Vec<Vec<f32>> = (0..samples.iter().sum()).map(|_| random_psf(&mut noise, n)).collect();
        let grid = NodeGrid::polar(&heights_mm, &[1, 4, 4, 4], &samples, PITCH_MM);
        let mut kernels = Vec::new();
        for k in 0..heights_mm.len() {
            let of_height: Vec<&[f32]> = grid.psf_rows(k).map(|row| &psfs[row][..]).collect();
            for j in 0..if k == 0 { 1 } else { 4 } {
                let psf = fourier_interpolated(&of_height, TAU * j as f64 / 4.0);
                kernels.push(quarter_turns(&psf, n, j));
            }
        }
        let nodes = |x: f64, y: f64| {
            let turn = (y.atan2(x).rem_euclid(TAU)) / TAU * 4.0;
            let mut nodes = Vec::new();
            for (k, radial) in between(&heights_mm, x.hypot(y)) {
                if k == 0 {
                    nodes.push((0, radial));
                    continue;
                }
                let (j, share) = (turn.floor() as usize, turn - turn.floor());
                nodes.push((4 * k - 3 + j % 4, radial * (1.0 - share)));
                nodes.push((4 * k - 3 + (j + 1) % 4, radial * share));
            }
            nodes
        };
        let frame = frame(size, axis_px);
        let remapped = noise_image(&mut noise, &frame, n);
        let expected = direct_sum(&frame, &remapped, n, nodes, &kernels);
        let stack = integrated(&psfs);
        let found = film_of(&in_memory(&grid, &stack, simd), &frame, &remapped);
        let (worst, l2) = errors(&found, &expected);
        assert!(worst <= 2e-6 && l2 <= 1e-6, "{n} px: max {worst:.1e}, L2 {l2:.1e}");
        assert_eq!(found, film_of(&on_demand(&grid, &stack, simd), &frame, &remapped));
    }
}

/// Random PSFs in columns and rows; films that reach beyond them, and one node.
fn film_of_a_cartesian_field_equals_the_f64_sum(simd: Simd) {
    let uniform = |first: f64, step: f64, count: usize| -> Vec<f64> {
        (0..count).map(|i| first + step * i as f64).collect()
    };
    for (n, x_mm, y_mm, size, axis_px) in [
        (15, uniform(-0.1, 0.05, 5), uniform(-0.09, 0.06, 4), Size::new(90, 121), (44.5, 60.0)),
        (9, uniform(-0.05, 0.01, 8), uniform(-0.03, 0.012, 6), Size::new(200, 150), (70.0, 80.25)),
        (31, uniform(0.0, 0.5, 2), uniform(-0.2, 0.4, 2), Size::new(140, 50), (19.5, 24.5)),
        (5, uniform(-0.02, 0.01, 5), uniform(0.3, 0.1, 3), Size::new(80, 90), (500.0, -20.0)),
        (7, vec![0.02], vec![-0.01], Size::new(80, 90), (40.0, 40.0)),
        (7, vec![0.02], uniform(-0.05, 0.05, 3), Size::new(80, 90), (40.0, 40.0)),
        (1, uniform(-0.1, 0.05, 5), uniform(-0.09, 0.06, 4), Size::new(33, 45), (16.0, 22.0)),
    ] {
        let mut noise = Noise(n as u64 + x_mm.len() as u64);
        let psfs: Vec<Vec<f32>> = (0..x_mm.len() * y_mm.len()).map(|_| random_psf(&mut noise, n)).collect();
        let kernels: Vec<Vec<f64>> =
            psfs.iter().map(|psf| psf.iter().map(|v| f64::from(*v)).collect()).collect();
        let nodes = |x: f64, y: f64| {
            let columns = between(&x_mm, x);
            let of_row =
                |(j, row): (usize, f64)| columns.map(|(i, column)| (j * x_mm.len() + i, row * column));
            between(&y_mm, y).into_iter().flat_map(of_row).collect()
        };
        let frame = frame(size, axis_px);
        let remapped = noise_image(&mut noise, &frame, n);
        let expected = direct_sum(&frame, &remapped, n, nodes, &kernels);
        let (grid, stack) = (NodeGrid::cartesian(&x_mm, &y_mm, PITCH_MM), integrated(&psfs));
        let found = film_of(&in_memory(&grid, &stack, simd), &frame, &remapped);
        let (worst, l2) = errors(&found, &expected);
        assert!(worst <= 2e-6 && l2 <= 1e-6, "{n} px, {x_mm:?}: max {worst:.1e}, L2 {l2:.1e}");
        assert_eq!(found, film_of(&on_demand(&grid, &stack, simd), &frame, &remapped));
    }
}

/// `golden_fields.py` beside this file: `spread` of a `PolarField` (rotated by the cubic spline) and of a `GridField` of the NumPy reference.
fn films_are_those_of_the_reference(simd: Simd) {
    let (n, frame) = (25, frame(Size::new(24, 26), (10.25, 11.5)));
    let size = frame.film.rect().grown(n / 2).size();
    let data = (0..size.pixels()).map(|i| (i * 7919 % 1009) as f64 / 1009.0).collect();
    let remapped = Image { size, data };
    let mut polar = Vec::new();
    for (k, samples) in [1, 5, 8].into_iter().enumerate() {
        for a in 0..samples {
            let (k, a, samples) = (k as f64, a as f64, f64::from(samples));
            let centre = (0.9 * a.cos() + 0.2 * k, 0.7 * (2.0 * a + k).sin());
            polar.push(spot(n, centre, (1.0 + 0.1 * a / samples, 1.3 - 0.1 * k)));
        }
    }
    let mut cartesian = Vec::new();
    for (j, i) in (0..4).flat_map(|j| (0..3).map(move |i| (f64::from(j), f64::from(i)))) {
        cartesian.push(spot(n, (0.5 * i - 0.4 * j, 0.6 * j - 0.3 * i), (1.0 + 0.1 * j, 1.3 - 0.1 * i)));
    }
    let (x_mm, y_mm) = ([-0.02, 0.0, 0.02], [-0.015, 0.0, 0.015, 0.03]);
    for (grid, psfs, peak, values) in [
        (NodeGrid::polar(&[0.0, 0.017, 0.04], &[1, 8, 12], &[1, 5, 8], PITCH_MM), polar, POLAR.0, POLAR.1),
        (NodeGrid::cartesian(&x_mm, &y_mm, PITCH_MM), cartesian, CARTESIAN.0, CARTESIAN.1),
    ] {
        let film = film_of(&in_memory(&grid, &integrated(&psfs), simd), &frame, &remapped);
        for ((y, x), expected) in GOLDEN_AT.into_iter().zip(values) {
            let found = f64::from(film[y * 26 + x]);
            assert!((found - expected).abs() < 2e-6 * peak, "({y}, {x}): {found}, expected {expected}");
        }
    }
}

/// Pixels (row, column) of the golden films, and per film the peak and their values.
const GOLDEN_AT: [(usize, usize); 8] =
    [(0, 0), (3, 20), (10, 11), (11, 12), (14, 2), (17, 25), (23, 0), (23, 25)];
const POLAR: (f64, [f64; 8]) = (
    0.6112775551586036,
    [
        0.3868357535842102,
        0.4372650924881772,
        0.4594781139569518,
        0.4938344353273162,
        0.48282355208388467,
        0.4858209988355893,
        0.5592372332977349,
        0.47494694531605514,
    ],
);
const CARTESIAN: (f64, [f64; 8]) = (
    0.5648628101531188,
    [
        0.47503088033029073,
        0.4893899639237883,
        0.45333637398638693,
        0.5021082848525377,
        0.420114197250396,
        0.47678320233408195,
        0.49030121662974296,
        0.42475684092144644,
    ],
);

/// A comatic PSF of point samples, off the meridian by `skew` µm.
fn comet(n: usize, pitch_um: f64, skew: f64) -> Vec<f32> {
    let c = (n / 2) as f64;
    let value = |i: usize| {
        let (y, x) = (((i / n) as f64 - c) * pitch_um, ((i % n) as f64 - c) * pitch_um);
        let spot = |cx: f64, cy: f64, a: f64, b: f64| {
            (-((x - cx).powi(2) / (2.0 * a * a) + (y - cy).powi(2) / (2.0 * b * b))).exp()
        };
        spot(0.4, 0.0, 1.3, 0.9) + 0.2 * spot(4.0, skew, 3.0, 2.0)
    };
    normalised((0..n * n).map(value).collect())
}

fn point_samples(psfs: &[Vec<f32>]) -> PsfStack {
    let size = psfs[0].len().isqrt();
    PsfStack { size, pitch_um: 0.5, sample: PsfSample::Point, samples: psfs.concat() }
}

/// PSFs that are equal at all azimuths: the film of a symmetric lens.
fn equal_azimuths_are_one(simd: Simd) {
    let (heights_mm, azimuths) = ([0.0, 0.06, 0.1, 0.25], [1, 8, 20, 36]);
    let mut noise = Noise(5);
    for (skew, axis_px) in [(0.0, (60.0, 50.0)), (0.7, (-20.0, 15.5))] {
        let psfs: Vec<Vec<f32>> = (0..4).map(|k| comet(61, 0.5, skew * (1.0 + 0.2 * f64::from(k)))).collect();
        let frame = frame(Size::new(110, 100), axis_px);
        let one = in_memory(&NodeGrid::new(&heights_mm, &azimuths, PITCH_MM), &point_samples(&psfs), simd);
        let remapped = noise_image(&mut noise, &frame, one.blocks().window);
        let expected: Vec<f64> = film_of(&one, &frame, &remapped).into_iter().map(f64::from).collect();
        for samples in [[1, 8, 8, 8], [1, 8, 12, 16], [1, 1, 20, 36]] {
            let rows: Vec<Vec<f32>> =
                samples.into_iter().zip(&psfs).flat_map(|(count, psf)| vec![psf.clone(); count]).collect();
            let grid = NodeGrid::polar(&heights_mm, &azimuths, &samples, PITCH_MM);
            let stack = point_samples(&rows);
            let found = film_of(&in_memory(&grid, &stack, simd), &frame, &remapped);
            let (worst, l2) = errors(&found, &expected);
            assert!(worst <= 2e-6 && l2 <= 1e-6, "{samples:?}: max {worst:.1e}, L2 {l2:.1e}");
            assert_eq!(found, film_of(&on_demand(&grid, &stack, simd), &frame, &remapped));
        }
    }
}

/// Errors and remapped image rotated by 90° (+x to +y, down): the film rotated by 90°.
fn rotated_errors_rotate_the_film(simd: Simd) {
    let (heights_mm, azimuths, samples) = ([0.0, 0.06, 0.1, 0.25], [1, 8, 20, 36], [1, 8, 12, 20]);
    let side = 81;
    let frame = frame(Size::new(side, side), (40.0, 40.0));
    let grid = NodeGrid::polar(&heights_mm, &azimuths, &samples, PITCH_MM);
    let mut noise = Noise(11);
    let psfs: Vec<Vec<f32>> =
        (0..samples.iter().sum()).map(|_| comet(61, 0.5, noise.between(-2.0, 2.0))).collect();
    let mut rotated = Vec::new();
    for (k, count) in samples.into_iter().enumerate() {
        let of_height = &psfs[grid.psf_rows(k)];
        // What was seen at φ is seen at φ + 90°; the axis node is not rotated with its azimuth.
        let at = |a: usize| of_height[(a + count - count / 4) % count].clone();
        rotated.extend((0..count).map(|a| if k == 0 { quarter_turns(&of_height[0], 61, 1) } else { at(a) }));
    }
    let stage = in_memory(&grid, &point_samples(&psfs), simd);
    let remapped = noise_image(&mut noise, &frame, stage.blocks().window);
    let turned = Image { size: remapped.size, data: quarter_turns(&remapped.data, remapped.size.width, 1) };
    let film = film_of(&stage, &frame, &remapped);
    let expected: Vec<f64> = quarter_turns(&film, side, 1).into_iter().map(f64::from).collect();
    let found = film_of(&in_memory(&grid, &point_samples(&rotated), simd), &frame, &turned);
    let (worst, l2) = errors(&found, &expected);
    assert!(worst <= 2e-6 && l2 <= 1e-6, "max {worst:.1e}, L2 {l2:.1e}");
}

/// A point of light 20 px from the axis at 0, 90° (down), 180° and 270°. At 90° alone the PSF has its light 2 px away from the axis (+x of the
/// rotating frame) and 3 px towards +y of it, which is −X of the film there.
fn spot_lands_where_the_rotating_frame_says(simd: Simd) {
    let n = 11;
    let one_pixel = |dx: i64, dy: i64| {
        let at = (5 + dy) * 11 + 5 + dx;
        (0..n * n).map(|i| if i as i64 == at { 1.0 } else { 0.0 }).collect::<Vec<f32>>()
    };
    let centre = one_pixel(0, 0);
    let psfs = [centre.clone(), centre.clone(), one_pixel(2, 3), centre.clone(), centre];
    let grid = NodeGrid::polar(&[0.0, 20.0 * PITCH_MM], &[1, 8], &[1, 4], PITCH_MM);
    let stage = in_memory(&grid, &integrated(&psfs), simd);
    let frame = frame(Size::new(61, 61), (30.0, 30.0));
    for ((row, col), (at_row, at_col)) in
        [((30, 50), (30, 50)), ((50, 30), (52, 27)), ((30, 10), (30, 10)), ((10, 30), (10, 30))]
    {
        let light = |y: usize, x: usize| f64::from(u8::from((y, x) == (row + 5, col + 5)));
        let film = film_of(&stage, &frame, &Image::new(Size::new(71, 71), light));
        let (peak, value) = film
            .iter()
            .enumerate()
            .fold((0, 0.0), |(i, max), (j, v)| if *v > max { (j, *v) } else { (i, max) });
        assert_eq!((peak / 61, peak % 61), (at_row, at_col), "light at ({row}, {col})");
        assert!((value - 1.0).abs() < 1e-6, "{value}");
    }
}

/// In any order of tiles, with a cache for all spectra or for none.
fn same_bits_for_any_cache_size(simd: Simd) {
    let mut noise = Noise(23);
    let psfs: Vec<Vec<f32>> = (0..25).map(|_| random_psf(&mut noise, 15)).collect();
    let frame = frame(Size::new(150, 140), (70.0, 70.0));
    let remapped = noise_image(&mut noise, &frame, 15);
    let at: Vec<f64> = (0..5).map(|i| 0.06 * f64::from(i) - 0.12).collect();
    for grid in [
        NodeGrid::polar(&[0.0, 0.1, 0.2], &[1, 16, 24], &[1, 8, 16], PITCH_MM),
        NodeGrid::cartesian(&at, &at, PITCH_MM),
    ] {
        for stage in [in_memory, on_demand] {
            let stage = stage(&grid, &integrated(&psfs), simd);
            let film = |limit| film(&stage, &frame, &remapped, &SpectrumCache::new(limit));
            assert_eq!(film(usize::MAX), film(1));
        }
    }
}

/// Kernels between azimuths in f32 lanes compared with the portable engine's f64 sums.
fn kernels_equal_those_of_the_portable_engine(simd: Simd) {
    let mut noise = Noise(31);
    let psfs: Vec<Vec<f32>> = (0..17).map(|_| comet(123, 0.5, noise.between(-2.0, 2.0))).collect();
    let grid = NodeGrid::polar(&[0.0, 1.0], &[1, 72], &[1, 16], PITCH_MM);
    let (stack, mut s) = (point_samples(&psfs), KernelScratch::default());
    let [lanes, plain] = [simd, Simd::PORTABLE].map(|simd| NodeKernels::new(&stack, 2.0, None, simd));
    let side = plain.size();
    for j in 0..72 {
        let [a, b] = [&lanes, &plain].map(|kernels| {
            let mut out = vec![0.0; side * side];
            kernels.kernel(&grid, Node { k: 1, j }, &mut s, &mut out);
            out
        });
        let peak = b.iter().fold(0.0f32, |m, v| m.max(*v));
        let worst = a.iter().zip(&b).fold(0.0f32, |m, (a, b)| m.max((a - b).abs())) / peak;
        let l1: f64 = a.iter().zip(&b).map(|(a, b)| f64::from((a - b).abs())).sum();
        assert!(worst < 1e-6 && l1 < 2e-6, "azimuth {j}: {worst:.1e}, L1 {l1:.1e}");
    }
}

fn main() -> ExitCode {
    on_every_isa(&[
        ("film_of_a_polar_field_equals_the_f64_sum", film_of_a_polar_field_equals_the_f64_sum),
        ("film_of_a_cartesian_field_equals_the_f64_sum", film_of_a_cartesian_field_equals_the_f64_sum),
        ("films_are_those_of_the_reference", films_are_those_of_the_reference),
        ("equal_azimuths_are_one", equal_azimuths_are_one),
        ("rotated_errors_rotate_the_film", rotated_errors_rotate_the_film),
        ("spot_lands_where_the_rotating_frame_says", spot_lands_where_the_rotating_frame_says),
        ("same_bits_for_any_cache_size", same_bits_for_any_cache_size),
        ("kernels_equal_those_of_the_portable_engine", kernels_equal_those_of_the_portable_engine),
    ])
}
