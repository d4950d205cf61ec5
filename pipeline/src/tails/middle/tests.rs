//! The middle part on bins against its images, and its conservation of light.

use super::*;
use crate::lens::LensBand;
use crate::lens::middle::{Middle, core_share};
use crate::lens::tail::{BandTail, ORDERS, TERMS, value};
use crate::simd::Isa;
use crate::tails::light::Light;
use crate::tails::{TailKernels, levels};

const PITCH_UM: f64 = 2.0;
/// Half a side of the windows, and the radius of the power laws, film pixels.
const HALF_PX: f64 = 130.5;
const INNER_PX: f64 = 260.0;

/// Light at (x, y) mm, in any unit: longer along +x unless it is round.
fn image(is_round: bool, x: f64, y: f64) -> f64 {
    let px = PITCH_UM * 1e-3;
    let r = (x * x + y * y).sqrt() / px;
    let (a, b) = (if is_round { 90.0 * px } else { 110.0 * px }, 90.0 * px);
    (1.0 - core_share(r, HALF_PX)) * (-(x * x / (a * a) + y * y / (b * b))).exp()
}

fn band() -> LensBand {
    let height_mm = vec![0.0, 0.5, 1.0];
    let (size, pitch_mm) = (101, 2.0 * INNER_PX * PITCH_UM * 1e-3 / 101.0);
    let at = |i: usize| (i as f64 - 50.0) * pitch_mm;
    // 4 % of the light on the axis, 6 % at 1 mm.
    let of_height = |k: u32| {
        let one: Vec<f64> = (0..size * size).map(|i| image(k == 0, at(i % size), at(i / size))).collect();
        let scale = (0.04 + 0.01 * f64::from(k)) / one.iter().sum::<f64>();
        one.into_iter().map(move |v| (v * scale) as f32)
    };
    let samples: Vec<f32> = (0..3).flat_map(of_height).collect();
    let mut c = [[0.0; TERMS]; ORDERS];
    c[0][0] = 5e-5;
    let tail = BandTail {
        inner_mm: INNER_PX * PITCH_UM * 1e-3,
        height_mm: height_mm.clone(),
        coefficients: vec![c; 3],
        middle: Some(Middle { size, pitch_mm, samples: samples.into() }),
    };
    LensBand {
        psf_height_mm: vec![0.0, 0.25, 0.5, 1.0],
        azimuth_count: vec![1, 8, 8, 8],
        psf_size: 261,
        psf_pitch_um: PITCH_UM,
        kernel_pitch_um: None,
        psf_energy: vec![0.97; 4],
        tail: Some(tail),
        ..LensBand::ideal(550.0, height_mm)
    }
}

/// Light of a function of the place.
struct Exact<F>(F);

impl<F: Fn(f64, f64) -> f64 + Sync> Light for Exact<F> {
    fn along(&self, y: f64, x: f64, step: f64, out: &mut [f32]) {
        out.iter_mut().enumerate().for_each(|(i, to)| *to = (self.0)(y, x + i as f64 * step) as f32);
    }
}

fn layer(plan: &TailPlan, frame: &Frame, light: &dyn Light, simd: Simd, threads: usize) -> Vec<f32> {
    let lights = levels::lights(plan, light, threads);
    levels::layer(plan, &TailKernels::new(plan, simd), frame, lights, 2, threads)
}

#[test]
fn bins_follow_from_core_and_radius() {
    let of = |half_px, inner_px| bin_px(half_px, inner_px, (2, 8), 4);
    assert_eq!(of(80.0, 180.0), Some(8));
    assert_eq!(of(80.0, 159.0), Some(4));
    assert_eq!(of(79.0, 700.0), Some(4));
    assert_eq!(of(19.0, 80.0), None);
    assert_eq!(of(400.0, 1800.0), None, "too large a kernel");
}

#[test]
fn a_spot_has_the_middle_part_of_its_place_turned_to_its_azimuth() {
    let film = Size::new(700, 900);
    let frame = Frame::centred(film, film, PITCH_UM);
    let band = band();
    let plan = TailPlan::new(&frame, &band).unwrap();
    assert_eq!((plan.bin_px(), plan.levels), (8, 3));
    let tail = band.tail.as_ref().unwrap();
    let px = PITCH_UM * 1e-3;
    for (sy, sx) in [(349.5, 449.5), (200.0, 700.0), (520.0, 310.0)] {
        // A standard deviation of 12 px, which samples at half bins resolve.
        let weight = |y: f64, x: f64| (-(y * y + x * x) / 288.0).exp();
        let spot = Exact(move |y: f64, x: f64| weight(y - sy, x - sx) / (288.0 * std::f64::consts::PI));
        let values = layer(&plan, &frame, &spot, Simd::detect(), 2);
        let columns = BinGrid { margin: 2, ..plan.bins(0) }.size().width;
        let (dy, dx) = (sy - frame.axis_px.0, sx - frame.axis_px.1);
        let (sin, cos) = dy.atan2(dx).sin_cos();
        let h_mm = dy.hypot(dx) * px;
        let psf = |y: f64, x: f64| {
            let (along, across) = ((x * cos + y * sin) * px, (y * cos - x * sin) * px);
            let of_tail = value(&tail.coefficients[0], tail.inner_mm, along, across);
            tail.middle_density(h_mm, along, across) + of_tail
        };
        let place = |i: usize| (i as f64 - 2.0 + 0.5) * 8.0 - 0.5;
        let steps = || (-9..=9).map(|i| 4.0 * f64::from(i));
        let (mut worst, mut largest) = (0.0_f64, 0.0_f64);
        for (i, found) in values.iter().enumerate().step_by(7) {
            let (y, x) = (place(i / columns) - sy, place(i % columns) - sx);
            let (mut sum, mut weights) = (0.0, 0.0);
            for (v, u) in steps().flat_map(|v| steps().map(move |u| (v, u))) {
                sum += weight(v, u) * psf(y - v, x - u);
                weights += weight(v, u);
            }
            let expected = sum / weights * px * px;
            worst = worst.max((f64::from(*found) - expected).abs());
            largest = largest.max(expected);
        }
        println!("spot at {sy}, {sx}: worst {worst:.1e} of {largest:.1e}");
        assert!(worst < 0.03 * largest, "{sy} {sx}: {worst} {largest}");
    }
}

#[test]
fn uniform_light_gets_back_what_near_kernels_leave() {
    let film = Size::new(500, 400);
    let frame = Frame::centred(film, film, PITCH_UM);
    let mut band = band();
    let tail = band.tail.as_mut().unwrap();
    // The same everywhere, so that the sum is that of one field point.
    let middle = tail.middle.as_ref().unwrap();
    let samples = [middle.image(0); 3].concat().into();
    tail.middle = Some(Middle { samples, ..middle.clone() });
    let plan = TailPlan::new(&frame, &band).unwrap();
    let shares = plan.near_shares();
    let values = layer(&plan, &frame, &Exact(|_, _| 1.0), Simd::detect(), 1);
    let worst = values.iter().map(|v| (f64::from(*v) + shares[0] - 1.0).abs()).fold(0.0, f64::max);
    println!("near share {:.5}, worst {worst:.1e}", shares[0]);
    assert!(worst < 1.5e-5, "{worst:e}");
    let light = crate::lens::tail::light(&band.tail.as_ref().unwrap().coefficients[0], 0.52);
    assert!((1.0 - shares[0] - 0.04 - light).abs() < 1e-5, "{shares:?} {light}");
    assert!(shares.iter().all(|share| (share - shares[0]).abs() < 1e-12));
}

#[test]
fn bits_depend_neither_on_instructions_nor_on_threads() {
    let film = Size::new(500, 700);
    let frame = Frame::centred(film, film, PITCH_UM);
    let plan = TailPlan::new(&frame, &band()).unwrap();
    let of = |simd, threads| {
        let light = Exact(|y: f64, x: f64| if (y - 200.0).hypot(x - 300.0) < 90.0 { 1.0 } else { 0.0 });
        let values = layer(&plan, &frame, &light, simd, threads);
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
