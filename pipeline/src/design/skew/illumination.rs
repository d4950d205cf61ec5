//! Light of a field of a built lens per area of the film.
//!
//! ```text
//! object at infinity:  G = ∫∫ dx dy (beam in the nominal entrance pupil plane) · (1 + tx² + ty²)⁻² / |det ∂(X, Y)/∂(tx, ty)|
//! finite distance:     G = ∫∫ dL dM (bundle at the object point) · z² / |det ∂(X, Y)/∂(tx, ty)|,      z object to entrance pupil
//! R(X, Y) = G(field of (X, Y)) / G(field of the film's centre)                                        same lens, same wavelength
//! ```
//! (X, Y) of the chief rays on the film as built: R has the obliquity of a tilted film. For a symmetric lens G is that of
//! [`crate::design::pupil::illumination`]. Ω = ∫∫ |d(L, M)_film/d(p, q)| dp dq, the solid angle of the bundle at the film, is a
//! figure beside it.
//! Source: Rimmer, Relative illumination calculations, Proc. SPIE 655 (1986); Welford, chapter 5 (étendue).

use super::chief::Chief;
use super::opening::Opening;
use super::trace::SkewTracer;
use crate::design::prescription::error::DesignError;
use crate::design::pupil::illumination::FieldLight;

/// As of the symmetric tracer: the Jacobians are smooth, 7 × 18 nodes are accurate to 1e-9 at F/1.8. The segments of a clipped
/// pupil have more spokes each.
pub(super) const RINGS: usize = 7;
pub(super) const SPOKES: usize = 18;
const CLIPPED_SPOKES: usize = 12;

/// Light of a field with the chief ray `chief` and the open pupil `opening`.
///
/// # Errors
/// A ray of the pupil that does not reach the film.
pub fn light_within(
    tracer: &SkewTracer<'_>,
    t: [f64; 2],
    chief: &Chief,
    opening: &Opening,
) -> Result<FieldLight, DesignError> {
    let (mut flux, mut omega) = (0.0, 0.0);
    let spokes = if opening.is_open() { SPOKES } else { CLIPPED_SPOKES };
    for node in opening.nodes(tracer, t, RINGS, spokes) {
        let ray = tracer.ray(t, node.p, node.q)?;
        flux += node.weight * ray.flux;
        omega += node.weight * ray.solid_angle();
    }
    let object = match tracer.object_distance_mm() {
        None => (1.0 + t[0] * t[0] + t[1] * t[1]).powi(-2),
        Some(distance) => (distance + tracer.primary.entrance_pupil_mm).powi(2),
    };
    let irradiance_sr = flux * object / chief.determinant().abs();
    Ok(FieldLight { irradiance_sr, solid_angle_sr: omega })
}

/// Light of the field of slopes `t`.
///
/// # Errors
/// All rays are blocked, or one of the pupil or the chief ray does not reach the film.
pub fn field_light(tracer: &SkewTracer<'_>, t: [f64; 2]) -> Result<FieldLight, DesignError> {
    light_within(tracer, t, &tracer.chief(t)?, &Opening::new(tracer, t)?)
}

#[cfg(test)]
mod tests {
    use super::super::deviation::Deviation;
    use super::super::system::BuiltLens;
    use super::super::tests::lenses::{UM, double_gauss, film, lens, lens_0, moved};
    use super::*;
    use crate::design::prescription::system::{RayAiming, System};
    use crate::design::pupil::illumination as symmetric;
    use crate::design::pupil::test_lenses;
    use crate::design::rays::ray::Tracer;
    use crate::real;

    fn irradiance(lens: &System, deviations: &[Deviation], t: [f64; 2]) -> f64 {
        let built = BuiltLens::new(lens, deviations).unwrap();
        field_light(&SkewTracer::new(&built, UM).unwrap(), t).unwrap().irradiance_sr
    }

    /// Without apertures, with one to four rims, with an obscuration.
    #[test]
    fn a_lens_without_deviations_has_the_light_of_its_nominal_lens() {
        let mut clipped = double_gauss(RayAiming::Real);
        clipped.surfaces[0].aperture_mm = Some(26.0);
        clipped.surfaces[10].aperture_mm = Some(16.0);
        let near = System { object_distance_mm: Some(900.0), ..double_gauss(RayAiming::Paraxial) };
        let lenses = [
            (double_gauss(RayAiming::Paraxial), 0.2, 1e-9),
            (double_gauss(RayAiming::Real), 0.2, 1e-9),
            (near, 0.15, 1e-9),
            (test_lenses::lens("phone"), 0.55, 1e-9),
            (clipped, 0.2, 2e-6),
            (test_lenses::lens("mirrorless-50"), 0.4, 2e-6),
            (test_lenses::lens("macro-70"), 0.25, 2e-6),
            (test_lenses::lens("mirror-500"), 0.03, 2e-6),
        ];
        for (system, tan, tolerance) in lenses {
            let tracer = Tracer::new(&system, UM).unwrap();
            let built = BuiltLens::new(&system, &[]).unwrap();
            let skew = SkewTracer::new(&built, UM).unwrap();
            for (tan, azimuth) in [(0.0, 0.0), (tan, 0.0), (tan, 0.7), (0.7 * tan, -2.5)] {
                let expected = symmetric::field_light(&tracer, tan).unwrap();
                let (s, c) = real::sin_cos(azimuth);
                let tan = tracer.image_sign() * tan;
                let found = field_light(&skew, [tan * c, tan * s]).unwrap();
                let ratio = found.irradiance_sr / expected.irradiance_sr - 1.0;
                assert!(ratio.abs() < tolerance, "{} {tan} {azimuth}: {ratio:e}", system.name);
                let ratio = found.solid_angle_sr / expected.solid_angle_sr - 1.0;
                assert!(ratio.abs() < tolerance, "{} {tan} {azimuth}: {ratio:e}", system.name);
            }
        }
    }

    /// A stop alone with a tilted film: G = area · cos θ · (v·N)/|v|³, v the film point from the stop, N the film's normal.
    #[test]
    fn a_pinhole_with_a_tilted_film() {
        let (f, a) = (20.0, 0.1_f64);
        let hole = lens(&[(0.0, f, 1.0)], 0, 0.01);
        for t in [[0.0, 0.0], [0.3, 0.1], [-0.4, 0.2]] {
            let z = f / (1.0 + real::tan(a) * t[0]);
            let v = [z * t[0], z * t[1], z];
            let length = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
            let on_normal = v[0] * real::sin(a) + v[2] * real::cos(a);
            let exact = std::f64::consts::PI * 1e-4 * (z / length) * on_normal / length.powi(3);
            let found = irradiance(&hole, &[film([0.0, a])], t);
            assert!((found / exact - 1.0).abs() < 1e-11, "{t:?} {:e}", found / exact - 1.0);
        }
    }

    #[test]
    fn light_of_the_axis_in_closed_form_and_of_a_decentred_lens() {
        let paraxial = double_gauss(RayAiming::Paraxial);
        let exact = std::f64::consts::PI * (33.33 / 2.0 / 99.33207888853303_f64).powi(2);
        assert!((irradiance(&paraxial, &[], [0.0; 2]) / exact - 1.0).abs() < 2e-6);
        let real = double_gauss(RayAiming::Real);
        assert!((irradiance(&real, &[], [0.0; 2]) / exact - 1.0).abs() < 2e-6);
        let whole = moved([0, 10], [0.4, 0.0], [0.0; 2]);
        let ratio = irradiance(&real, &[whole], [0.1, 0.0]) / irradiance(&real, &[], [0.1, 0.0]);
        assert!((ratio - 1.0).abs() < 1e-7);
    }

    /// `etendue(lens0()[0], t, UM, real, 7, 18)` of the model for built lens 0; its differences are accurate to 2e-8.
    #[test]
    fn light_of_built_lens_0() {
        let golden = [
            (RayAiming::Real, [0.0, 0.0], 0.08842166884869719),
            (RayAiming::Real, [0.1, -0.05], 0.08643868595983831),
            (RayAiming::Real, [-0.12, 0.12], 0.08395020939967711),
            (RayAiming::Real, [0.0, 0.19], 0.08294761885813234),
            (RayAiming::Paraxial, [0.1, -0.05], 0.08676533902706918),
            (RayAiming::Paraxial, [0.0, 0.19], 0.08399815837536082),
        ];
        for (aiming, t, expected) in golden {
            let found = irradiance(&double_gauss(aiming), &lens_0(), t);
            assert!((found / expected - 1.0).abs() < 2e-8, "{t:?} {:e}", found / expected - 1.0);
        }
    }

    /// The clipped pupil against the area of a fine scan of it, with deviations that make it asymmetric.
    #[test]
    fn the_opening_of_a_clipped_decentred_lens() {
        let mut clipped = double_gauss(RayAiming::Real);
        clipped.surfaces[0].aperture_mm = Some(24.0);
        clipped.surfaces[10].aperture_mm = Some(15.0);
        let built = BuiltLens::new(&clipped, &[moved([0, 1], [0.6, 0.9], [0.0; 2])]).unwrap();
        let tracer = SkewTracer::new(&built, UM).unwrap();
        let t = [0.1, -0.17];
        let opening = Opening::new(&tracer, t).unwrap();
        assert_eq!(opening.limits(), [0, 10]);
        let area: f64 = opening.nodes(&tracer, t, 4, 24).iter().map(|n| n.weight).sum();
        let side = 400;
        let at = |i: usize| (2 * i + 1) as f64 / side as f64 - 1.0;
        let open = (0..side * side)
            .map(|k| (at(k % side), at(k / side)))
            .filter(|(p, q)| p * p + q * q <= 1.0 && tracer.clip(t, *p, *q).passes());
        let scanned = open.count() as f64 * (2.0 / side as f64).powi(2);
        assert!((area / scanned - 1.0).abs() < 1e-3, "{area} {scanned}");
    }
}
