//! Layers of tails against the sum over all sources and pixels that defines them, in f64.

use super::*;
use crate::geometry::Size;
use crate::lens::LensBand;
use crate::lens::tail::{BandTail, Coefficients, value};
use crate::simd::Isa;
use crate::tails::MAX_BIN_PX;
use crate::tails::harmonics;

const PITCH_UM: f64 = 2.0;

/// Coefficients that vary over the field like those of a Double Gauss: 1 % of the light beyond 20 px.
fn field(h_mm: f64) -> Coefficients {
    let (c, px) = (0.0265, PITCH_UM * 1e-3);
    let u = h_mm / 3.0;
    let third = [c * (1.0 + 0.1 * u * u), 0.0, 0.4 * c * u * u, 0.0, 0.1 * c * u.powi(4)];
    let fifth = [0.6 * c * 400.0, 0.1 * u * c * 400.0, 0.0, 0.0, 0.0];
    std::array::from_fn(|m| [third[m] * px, fifth[m] * px.powi(3)])
}

fn band(inner_px: f64) -> LensBand {
    let height_mm: Vec<f64> = (0..=12).map(|i| 0.25 * f64::from(i)).collect();
    let tail = BandTail {
        inner_mm: inner_px * PITCH_UM * 1e-3,
        coefficients: height_mm.iter().map(|h| field(*h)).collect(),
        height_mm: height_mm.clone(),
        middle: None,
    };
    LensBand {
        psf_height_mm: height_mm.clone(),
        azimuth_count: [1].into_iter().chain([8; 12]).collect(),
        psf_size: 41,
        psf_energy: vec![0.99; 13],
        tail: Some(tail),
        cones: None,
        planar: None,
        ..LensBand::ideal(550.0, height_mm)
    }
}

/// Light of a function of the place, read exactly.
struct Exact<F>(F);

impl<F: Fn(f64, f64) -> f64 + Sync> Light for Exact<F> {
    fn along(&self, y: f64, x: f64, step: f64, out: &mut [f32]) {
        out.iter_mut().enumerate().for_each(|(i, to)| *to = (self.0)(y, x + i as f64 * step) as f32);
    }
}

/// The layer of `light` with a margin of 2 bins.
fn layer_of(plan: &TailPlan, frame: &Frame, light: &dyn Light, simd: Simd, threads: usize) -> Vec<f32> {
    layer(plan, &TailKernels::new(plan, simd), frame, lights(plan, light, threads), 2, threads)
}

/// The layer at film pixel (y, x), from its values on bins with a margin of 2.
fn at_pixel(plan: &TailPlan, values: &[f32], (y, x): (i64, i64)) -> f64 {
    let bins = plan.bins(0);
    let columns = bins.bins().width + 4;
    let along = |pixel: i64| {
        let u = (pixel as f64 + 0.5) / bins.bin_px as f64 - 0.5;
        ((u.floor() as i64 + 1) as usize, Taps::Lagrange.weights(u - u.floor()))
    };
    let ((top, wy), (left, wx)) = (along(y), along(x));
    (0..4)
        .flat_map(|i| (0..4).map(move |j| (i, j)))
        .map(|(i, j)| wy[i] * wx[j] * f64::from(values[(top + i) * columns + left + j]))
        .sum()
}

/// A smooth spot at (y, x) of unit light with a standard deviation of 12 px, which samples at half bins resolve.
fn spot(y: f64, x: f64) -> impl Fn(f64, f64) -> f64 + Sync + Copy {
    const SIGMA: f64 = 12.0;
    move |v: f64, u: f64| {
        let r2 = (v - y).powi(2) + (u - x).powi(2);
        (-r2 / (2.0 * SIGMA * SIGMA)).exp() / (2.0 * std::f64::consts::PI * SIGMA * SIGMA)
    }
}

#[test]
fn spots_have_the_tails_of_their_places() {
    let (film, inner) = (Size::new(900, 1100), 20.5);
    let frame = Frame::centred(film, film, PITCH_UM);
    let band = band(inner);
    let plan = TailPlan::new(&frame, &band).unwrap();
    assert_eq!((plan.bin_px(), plan.levels), (MAX_BIN_PX, 3));
    for (sy, sx) in [(449.5, 549.5), (300.0, 900.0), (120.0, 130.0), (-40.0, 500.0)] {
        let light = spot(sy, sx);
        let values = layer_of(&plan, &frame, &Exact(light), Simd::detect(), 2);
        let (dy, dx) = (sy - frame.axis_px.0, sx - frame.axis_px.1);
        let tail = band.tail.as_ref().unwrap();
        let pitch = PITCH_UM * 1e-3;
        let c = tail.at(dy.hypot(dx) * pitch);
        let azimuth = dy.atan2(dx);
        let (sin, cos) = azimuth.sin_cos();
        // T of a point at the spot, spread over the spot by its second moment: a mean over 9 x 9 places of weights of a Gaussian.
        let expected = |y: f64, x: f64| -> f64 {
            let (mut sum, mut weight) = (0.0, 0.0);
            for i in -12..=12 {
                for j in -12..=12 {
                    let (ty, tx) = (f64::from(i) * 3.0, f64::from(j) * 3.0);
                    let w = (-(ty * ty + tx * tx) / 288.0).exp();
                    let (v, u) = (y - sy - ty, x - sx - tx);
                    let (along, across) = (u * cos + v * sin, v * cos - u * sin);
                    sum += w * value(&c, tail.inner_mm, along * pitch, across * pitch) * pitch * pitch;
                    weight += w;
                }
            }
            sum / weight
        };
        let (mut worst, mut errors) = (0.0_f64, Vec::new());
        let mut near = 0.0_f64;
        for y in (0..900).step_by(37) {
            for x in (0..1100).step_by(41) {
                let (found, expected) = (at_pixel(&plan, &values, (y, x)), expected(y as f64, x as f64));
                let error = (found / expected - 1.0).abs();
                if (y as f64 - sy).hypot(x as f64 - sx) < 2.5 * inner {
                    near = near.max(error);
                } else {
                    errors.push(error);
                    worst = worst.max(error);
                }
            }
        }
        errors.sort_by(f64::total_cmp);
        let median = errors[errors.len() / 2];
        println!("spot at {sy}, {sx}: near {near:.1e}, beyond {worst:.1e}, median {median:.1e}");
        assert!(near < 0.1 && worst < 0.08 && median < 1e-2, "{sy} {sx}: {near} {worst} {median}");
    }
}

#[test]
fn uniform_light_gets_back_what_near_kernels_leave() {
    let film = Size::new(400, 300);
    let frame = Frame::centred(film, film, PITCH_UM);
    for inner in [5.2, 11.0, 20.5, 64.0] {
        let mut band = band(inner);
        let tail = band.tail.as_mut().unwrap();
        // The same everywhere, so that the sum is that of one field point.
        let scale = inner / 20.5;
        let c = field(0.0).map(|[third, fifth]| [third * scale, fifth * scale.powi(3)]);
        tail.coefficients = vec![c; 13];
        let plan = TailPlan::new(&frame, &band).unwrap();
        let share = plan.near_shares()[0];
        let values = layer_of(&plan, &frame, &Exact(|_, _| 1.0), Simd::detect(), 1);
        let worst = values.iter().map(|v| (f64::from(*v) + share - 1.0).abs()).fold(0.0, f64::max);
        println!("{inner} px: bins of {}, near share {share:.5}, worst {worst:.1e}", plan.bin_px());
        assert!(worst < 2e-7, "{inner}: {worst:e}");
        // And about the integral of T.
        let light = crate::lens::tail::light(&c, band.tail.as_ref().unwrap().inner_mm);
        assert!((1.0 - share - light).abs() < 2e-3 * light, "{share} {light}");
    }
    assert!(TailPlan::new(&frame, &band(4.9)).is_none());
    assert!(TailPlan::new(&frame, &LensBand { tail: None, ..band(20.0) }).is_none());
}

#[test]
fn harmonics_of_the_azimuth_have_no_light_on_bins() {
    let film = Size::new(400, 300);
    let plan = TailPlan::new(&Frame::centred(film, film, PITCH_UM), &band(20.5)).unwrap();
    for level in [0, 1] {
        for (kernel, (image, _)) in harmonics::kernels().zip(harmonics::images(&plan, level)) {
            let light = image.iter().map(|v| v.abs()).sum::<f64>();
            let sum = image.iter().sum::<f64>().abs() / light;
            assert!((sum < 1e-13) == (kernel.m > 0), "level {level}, {kernel:?}: {sum:e}");
        }
    }
}

#[test]
fn bits_depend_neither_on_instructions_nor_on_threads() {
    let film = Size::new(700, 900);
    let frame = Frame::centred(film, film, PITCH_UM);
    let band = band(20.5);
    let plan = TailPlan::new(&frame, &band).unwrap();
    let light = spot(311.0, 705.5);
    let of = |simd, threads| {
        let values = layer_of(&plan, &frame, &Exact(light), simd, threads);
        values.into_iter().map(f32::to_bits).collect::<Vec<_>>()
    };
    let expected = of(Simd::PORTABLE, 1);
    assert!(expected.iter().any(|v| *v != 0));
    for simd in Isa::ALL.into_iter().filter_map(|isa| Simd::require(isa).ok()) {
        for threads in [1, 3] {
            assert!(of(simd, threads) == expected, "{simd:?}, {threads} threads");
        }
    }
}
