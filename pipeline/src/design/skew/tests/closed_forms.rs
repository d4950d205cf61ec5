//! Closed forms, golden values of the model, and rays of another program.

use super::lenses::{ARCMIN, LAST, REAR, UM, double_gauss, few_errors, film, lens, lens_0, moved};
use crate::design::prescription::pose::Pose;
use crate::design::prescription::system::{RayAiming, System};
use crate::design::rays::surface::Ray;
use crate::design::skew::deviation::{Deviation, Pivot};
use crate::design::skew::system::BuiltLens;
use crate::design::skew::trace::SkewTracer;
use crate::real;

fn close(a: f64, b: f64, tolerance: f64) {
    assert!((a - b).abs() <= tolerance, "{a} {b}: {:e} > {tolerance:e}", (a - b).abs());
}

/// A ray of the lens frame from z = 0 to the film: its place (x, y up) and direction in the frame of the film, and its path.
fn beam(lens: &BuiltLens, p: [f64; 2], [l, m]: [f64; 2]) -> Ray<f64> {
    let tracer = SkewTracer::new(lens, UM).unwrap();
    let start = Ray { p: [p[0], p[1], 0.0], d: [l, m, (1.0 - l * l - m * m).sqrt()], path: 0.0 };
    tracer.run(start, lens.nominal().image(), |_, _| {}).unwrap()
}

/// (x, y) of a chief ray, y up.
fn chief(lens: &BuiltLens, t: [f64; 2]) -> [f64; 2] {
    let [x, y] = SkewTracer::new(lens, UM).unwrap().chief(t).unwrap().at_mm;
    [x, -y]
}

fn built(system: &System, deviations: &[Deviation]) -> BuiltLens {
    BuiltLens::new(system, deviations).unwrap()
}

#[test]
fn a_tilted_plate_shifts_a_ray() {
    let (n, t) = (1.5_f64, 10.0);
    let plate = lens(&[(0.0, t, n), (0.0, 50.0, 1.0)], 0, 1.0);
    for angle in [ARCMIN, 0.1, 0.5] {
        let y = beam(&built(&plate, &[moved([0, 1], [0.0; 2], [angle, 0.0])]), [0.0; 2], [0.0; 2]).p[1];
        let (s, c) = real::sin_cos(angle);
        // A tilt about +x turns +y towards +z: the normal leans to −y, the ray shifts to −y.
        close(y, -t * s * (1.0 - c / (n * n - s * s).sqrt()), 1e-12);
    }
}

#[test]
fn a_wedge_bends_a_ray() {
    let n = 1.52;
    let plate = lens(&[(0.0, 5.0, n), (0.0, 100.0, 1.0)], 0, 1.0);
    for (angle, tolerance) in [(ARCMIN, 1e-6), (0.05, 2e-3)] {
        let wedge = Deviation::Element {
            surfaces: [0, 1],
            decentre_mm: [0.0; 2],
            tilt_rad: [0.0; 3],
            wedge_rad: [0.0, angle],
            shift_mm: 0.0,
            pivot: None,
        };
        let d = beam(&built(&plate, &[wedge]), [0.0; 2], [0.0; 2]).d;
        let exact = real::asin(n * real::sin(angle)) - angle;
        // A tilt about +y: the glass is thicker at −x, the ray bends there.
        close(real::atan2(d[0], d[2]), -exact, 1e-14);
        close(exact / ((n - 1.0) * angle), 1.0, tolerance);
    }
}

#[test]
fn a_decentred_thin_lens_shifts_its_image_by_its_decentre() {
    let thin = lens(&[(0.01, 0.0, 1.5), (-0.01, 100.0, 1.0)], 0, 1.0);
    for d in [0.02, 0.05] {
        let x = beam(&built(&thin, &[moved([0, 1], [d, 0.0], [0.0; 2])]), [1e-4, 0.0], [0.0; 2]).p[0];
        close(x, beam(&built(&thin, &[]), [1e-4 - d, 0.0], [0.0; 2]).p[0] + d, 1e-13);
        close(x, d, 1e-6);
    }
}

/// First-order shift of the image per mm of decentre of surfaces for a ray along the axis: y' = y + t u', n'u' = n u − (y − d) c
/// (n' − n).
fn paraxial_shift(system: &System, [first, last]: [usize; 2]) -> f64 {
    let (mut y, mut u, mut n) = (0.0, 0.0, 1.0);
    for (i, s) in system.surfaces.iter().enumerate().take(system.image()) {
        let next = s.medium.index(UM).unwrap();
        let d = if (first..=last).contains(&i) { 1.0 } else { 0.0 };
        u = (n * u - (y - d) * s.shape.curvature * (next - n)) / next;
        (n, y) = (next, y + s.thickness_mm * u);
    }
    y
}

#[test]
fn boresight_of_decentred_elements() {
    let paraxial = double_gauss(RayAiming::Paraxial);
    for surfaces in [REAR, LAST, [0, 1]] {
        let d = 1e-5;
        let [more, less] = [d, -d].map(|d| {
            beam(&built(&paraxial, &[moved(surfaces, [d, 0.0], [0.0; 2])]), [0.0; 2], [0.0; 2]).p[0]
        });
        close((more - less) / (2.0 * d), paraxial_shift(&paraxial, surfaces), 1e-8);
    }
    // Measured with another program: µm.
    for (surfaces, d, um) in [(REAR, 0.02, -4.95), (REAR, 0.05, -12.38), (LAST, 0.05, 35.84)] {
        let x = chief(&built(&paraxial, &[moved(surfaces, [d, 0.0], [0.0; 2])]), [0.0; 2])[0];
        close(1e3 * x, um, 0.006);
    }
    for (surface, minutes, um) in [(4, 1.0, 11.79), (0, 1.0, 17.57), (8, 3.0, 32.19)] {
        let tilt = moved([surface, surface], [0.0; 2], [0.0, minutes * ARCMIN]);
        close(1e3 * chief(&built(&paraxial, &[tilt]), [0.0; 2])[0].abs(), um, 0.006);
    }
}

/// A rear doublet 20 µm towards +y moves the image to −y, which is DOWN the film: Y > 0.
#[test]
fn film_frame() {
    let lens = built(&double_gauss(RayAiming::Real), &[moved(REAR, [0.0, 0.02], [0.0; 2])]);
    let tracer = SkewTracer::new(&lens, UM).unwrap();
    let [x, y] = tracer.chief([0.0; 2]).unwrap().at_mm;
    assert!(x.abs() < 1e-12 && (4.6e-3..5.3e-3).contains(&y), "{x} {y}");
    let t = tracer.field_of([3.0, 4.0]).unwrap();
    assert!(t[0] > 0.0 && t[1] < 0.0);
    // A tilt about +x turns +y towards +z: a film so tilted is hit later at +y.
    let tilted = built(&double_gauss(RayAiming::Real), &[film([0.1, 0.0])]);
    assert!(tilted.poses()[11].rotation[2][1] > 0.09);
}

#[test]
fn the_whole_lens_decentred_is_a_shift_and_rotated_about_z_nothing() {
    let system = double_gauss(RayAiming::Real);
    let nominal = built(&system, &[]);
    let shifted = built(&system, &[moved([0, 10], [0.3, -0.2], [0.0; 2])]);
    let turned = built(&system, &[Deviation::element(0, 10, [0.0; 2], [0.0, 0.0, 0.7])]);
    for t in [[0.0, 0.0], [0.1, -0.05], [-0.12, 0.12]] {
        let [x, y] = chief(&nominal, t);
        let [sx, sy] = chief(&shifted, t);
        close(sx - x, 0.3, 1e-11);
        close(sy - y, -0.2, 1e-11);
        let [tx, ty] = chief(&turned, t);
        close(tx, x, 1e-11);
        close(ty, y, 1e-11);
    }
}

/// Everything tilted about the entrance pupil: the same image, of another direction.
#[test]
fn lens_and_film_tilted_together_turn_the_field() {
    let (system, a) = (double_gauss(RayAiming::Real), 0.03);
    let pupil = SkewTracer::new(&built(&system, &[]), UM).unwrap().primary.entrance_pupil_mm;
    let pivot = Pivot { surface: 0, offset_mm: pupil };
    let lens = Deviation::Element {
        surfaces: [0, 10],
        decentre_mm: [0.0; 2],
        tilt_rad: [0.0, a, 0.0],
        wedge_rad: [0.0; 2],
        shift_mm: 0.0,
        pivot: Some(pivot),
    };
    // The film by its centre: where the tilt about the pupil takes it.
    let pose = Pose::new([0.0; 3], [0.0, a, 0.0]).within(&Pose::at([0.0, 0.0, pupil]));
    let z = built(&system, &[]).poses()[11].origin_mm[2];
    let [dx, _, at] = pose.point([0.0, 0.0, z]);
    let film = Deviation::Film { decentre_mm: [dx, 0.0], tilt_rad: [0.0, a], shift_mm: at - z };
    let (nominal, tilted) = (built(&system, &[]), built(&system, &[lens, film]));
    for t in [[0.0, 0.0], [0.1, -0.05]] {
        let v = Pose::new([0.0; 3], [0.0, a, 0.0]).point([t[0], t[1], 1.0]);
        let (found, expected) = (chief(&tilted, [v[0] / v[2], v[1] / v[2]]), chief(&nominal, t));
        (0..2).for_each(|i| close(found[i], expected[i], 1e-10));
    }
}

#[test]
fn a_pinhole_with_a_tilted_film() {
    let (f, a) = (20.0, 0.1_f64);
    let hole = built(&lens(&[(0.0, f, 1.0)], 0, 0.01), &[film([0.0, a])]);
    for t in [[0.0, 0.0], [0.3, 0.1], [-0.4, 0.2]] {
        // The plane x sin a + (z − f) cos a = 0.
        let z = f / (1.0 + real::tan(a) * t[0]);
        let [x, y] = chief(&hole, t);
        close(x, z * t[0] / real::cos(a), 1e-12);
        close(y, z * t[1], 1e-12);
    }
}

/// A group that is turned about a pivot carries its elements; an element's own deviation is in the turned frame.
#[test]
fn groups_nest() {
    let (system, a) = (double_gauss(RayAiming::Paraxial), 0.01);
    let group = Deviation::Element {
        surfaces: [6, 10],
        decentre_mm: [0.0; 2],
        tilt_rad: [0.0, a, 0.0],
        wedge_rad: [0.0; 2],
        shift_mm: 0.0,
        pivot: Some(Pivot { surface: 6, offset_mm: 5.0 }),
    };
    let both = built(&system, &[group, moved(LAST, [0.05, 0.0], [0.0; 2])]);
    let z = |i: usize| system.axis()[i].0;
    let pivot = z(6) + 5.0;
    let turned = Pose::new([0.0; 3], [0.0, a, 0.0]);
    let v = turned.point([0.05, 0.0, z(9) - pivot]);
    let pose = both.poses()[9];
    (0..3).for_each(|i| close(pose.origin_mm[i], v[i] + if i == 2 { pivot } else { 0.0 }, 1e-12));
    (0..9).for_each(|k| close(pose.rotation[k / 3][k % 3], turned.rotation[k / 3][k % 3], 1e-15));
}

/// `chief(lens0()[0], t, UM, real)` of the model for built lens 0: X, Y.
#[test]
fn chief_rays_of_built_lens_0() {
    let golden = [
        (RayAiming::Real, [0.0, 0.0], [-0.014675192849898981, -0.01775187446969228]),
        (RayAiming::Real, [0.1, -0.05], [9.90510405686978, 4.942055630819517]),
        (RayAiming::Real, [-0.12, 0.12], [-11.89432779917283, -11.897384511664363]),
        (RayAiming::Real, [0.0, 0.19], [-0.01517337839504422, -18.805957327138664]),
        (RayAiming::Paraxial, [0.0, 0.0], [-0.01469648633750388, -0.017764126433634238]),
        (RayAiming::Paraxial, [0.1, -0.05], [9.905148038551808, 4.942076642988331]),
        (RayAiming::Paraxial, [-0.12, 0.12], [-11.89444565511497, -11.89749801031153]),
        (RayAiming::Paraxial, [0.0, 0.19], [-0.015180037502833775, -18.806092104597205]),
    ];
    for (aiming, t, expected) in golden {
        let lens = built(&double_gauss(aiming), &lens_0());
        let found = SkewTracer::new(&lens, UM).unwrap().chief(t).unwrap().at_mm;
        (0..2).for_each(|i| close(found[i], expected[i], 1e-10));
    }
    let lens = built(&double_gauss(RayAiming::Real), &few_errors());
    let found = SkewTracer::new(&lens, UM).unwrap().chief([0.12, -0.07]).unwrap().at_mm;
    close(found[0], 11.88341565, 5e-9);
    close(found[1], 6.92378306, 5e-9);
}

/// `trace(lens0()[0], *launch(...))` of the model: X, Y, L, M, path.
#[test]
fn rays_of_built_lens_0() {
    let golden = [
        (
            RayAiming::Real,
            [0.5, 0.7],
            [
                9.901867507530797,
                4.951766897929995,
                0.0058789478596286675,
                0.16188790262679995,
                104.1694836320246,
            ],
        ),
        (
            RayAiming::Real,
            [-0.9, 0.1],
            [
                9.915363380178949,
                4.941434778294729,
                0.23645591634275737,
                0.0607172899064744,
                104.17019583304204,
            ],
        ),
        (
            RayAiming::Paraxial,
            [-0.9, 0.1],
            [
                9.915452634003795,
                4.941407321238454,
                0.23874177079882647,
                0.06126256431847954,
                104.17021535161379,
            ],
        ),
    ];
    for (aiming, [p, q], expected) in golden {
        let lens = built(&double_gauss(aiming), &lens_0());
        let r = SkewTracer::new(&lens, UM).unwrap().ray([0.1, -0.05], p, q).unwrap();
        let found = [r.x.v, r.y.v, r.l.v, r.m.v, r.path.v];
        (0..5).for_each(|i| close(found[i], expected[i], 2e-10));
    }
}

/// Rays through a surface that is decentred and tilted about two axes, and through an element; x, y, L, M, path of Optiland 0.6.3
/// (`RealRays` traced by `surfaces.trace` through `x = 0.05, y = -0.03, rx = 0.004, ry = -0.007` of surface 3; the element with
/// the angles of Rx Ry).
#[test]
fn rays_of_another_program() {
    let rows = [
        (1.0 / 54.0, 8.7, 1.6),
        (1.0 / 152.5, 12.0, 1.0),
        (0.0, 5.0, 1.0),
        (-1.0 / 36.98, 6.0, 1.62),
        (-1.0 / 67.0, 60.0, 1.0),
    ];
    let mut system = lens(&rows, 2, 1.0);
    system.surfaces[3].shape.conic = -0.3;
    let (decentre, [rx, ry]) = ([0.05, -0.03], [0.004, -0.007]);
    // Rz Ry Rx of Optiland as Rx Ry Rz.
    let m = Pose::optiland([0.0; 3], [rx, ry, 0.0]).rotation;
    let tilt = [real::atan2(-m[1][2], m[2][2]), real::asin(m[0][2]), real::atan2(-m[0][1], m[0][0])];
    let surface = built(&system, &[Deviation::element(3, 3, decentre, tilt)]);
    let element = built(&system, &[moved([3, 4], decentre, [rx, ry])]);
    let starts = [
        ([0.0, 0.0], [0.0, 0.0]),
        ([5.0, 1.0], [0.1, -0.05]),
        ([-3.0, 4.0], [-0.05, 0.1]),
        ([2.0, -6.0], [0.02, 0.03]),
    ];
    let of_surface = [
        [
            -0.3192359539709175,
            -0.12188270956908888,
            -0.00500085978999138,
            -0.0019093035536804903,
            100.6410856937852,
        ],
        [
            13.057801525661723,
            -4.226535806258099,
            0.10058856551095446,
            -0.06044372755056656,
            101.18773252753195,
        ],
        [
            -7.38033227871172,
            12.508227540621856,
            -0.05687774781157738,
            0.10512497361897494,
            101.24137889326136,
        ],
        [
            3.1200701404537563,
            -1.7618478491889187,
            0.014935268097762376,
            0.040821780371326756,
            100.69527117403933,
        ],
    ];
    let of_element = [
        [
            -0.054388913585750695,
            -0.0030607888310089223,
            -0.0005868215307456807,
            7.102589529455849e-05,
            100.64010188632074,
        ],
        [
            13.326089827588973,
            -4.105375416323966,
            0.10496973007668936,
            -0.058444897769217234,
            101.23764956175623,
        ],
        [
            -7.1116813753393355,
            12.6286811863641,
            -0.05246373021276742,
            0.10710745146321585,
            101.23423224142931,
        ],
        [
            3.3867410696611433,
            -1.6412277581891037,
            0.019359854610597835,
            0.04281927660208539,
            100.70629872639242,
        ],
    ];
    for (lens, golden) in [(surface, of_surface), (element, of_element)] {
        for ((p, d), expected) in starts.iter().zip(golden) {
            let r = beam(&lens, *p, *d);
            let found = [r.p[0], r.p[1], r.d[0], r.d[1], r.path];
            (0..5).for_each(|i| close(found[i], expected[i], 1e-12 * expected[i].abs().max(1.0)));
        }
    }
}
