//! The directions of the light at places of the film ([`crate::lens::cone_field`]) of a lens without rotational symmetry, from the rays of the open pupil.
//!
//! ```text
//! ⟨f⟩ = Σ w_i Ω_i f(l_i, m_i) / Σ w_i Ω_i        w_i: weights of the pupil's quadrature, Ω_i = |d(l, m)/d(p, q)|;  L Lᵀ = 4 ⟨δ δᵀ⟩ by Cholesky
//! ```
//! (l, m) in the film frame: right, down, from the normal of the film as built. As [`crate::design::figures::image_cone`] of lenses with rotational symmetry: vignetting, pupil aberration and defocus
//! included, losses at coatings left out.

use rayon::prelude::*;

use super::error::SkewError;
use super::illumination::{RINGS, SPOKES};
use super::map::FilmRange;
use super::opening::Opening;
use super::system::BuiltLens;
use super::trace::SkewTracer;
use crate::lens::cone_field::ConeGrid;

/// Nodes along a side of the grid.
const SIDE: usize = 17;

/// Numbers of the cone at a place of the film ([`ConeGrid::NUMBERS`]).
///
/// # Errors
/// No chief ray or no light at the place; a ray of the pupil that does not reach the film.
pub fn film_cone(tracer: &SkewTracer<'_>, film_mm: [f64; 2]) -> Result<[f64; ConeGrid::NUMBERS], SkewError> {
    let t = tracer.field_of(film_mm)?;
    let chief = tracer.ray(t, 0.0, 0.0)?;
    let (mut all, mut first, mut second) = (0.0, [0.0; 2], [0.0; 3]);
    for node in Opening::new(tracer, t)?.nodes(tracer, t, RINGS, SPOKES) {
        let ray = tracer.ray(t, node.p, node.q)?;
        let share = node.weight * ray.solid_angle();
        // From the chief ray: differences of large squares lose digits.
        let (l, m) = (ray.l.v - chief.l.v, ray.m.v - chief.m.v);
        all += share;
        first.iter_mut().zip([l, m]).for_each(|(sum, v)| *sum += share * v);
        second.iter_mut().zip([l * l, l * m, m * m]).for_each(|(sum, v)| *sum += share * v);
    }
    let [x, y] = first.map(|sum| sum / all);
    let [xx, xy, yy] = second.map(|sum| sum / all);
    let along = 2.0 * (xx - x * x).max(0.0).sqrt();
    let shear = 4.0 * (xy - x * y) / along;
    let across = (4.0 * (yy - y * y) - shear * shear).max(0.0).sqrt();
    let (l, m) = (chief.l.v, chief.m.v);
    Ok([l, m, l + x, m + y, along, shear, across])
}

/// The cones of `lens` at `um` over `film`.
///
/// # Errors
/// As [`film_cone`]; [`SkewError::Cones`] of light that reaches 90 degrees from the film's normal.
pub fn film_cones(lens: &BuiltLens, um: f64, film: FilmRange) -> Result<ConeGrid, SkewError> {
    let tracer = SkewTracer::new(lens, um)?;
    let share = |k: usize| k as f64 / (SIDE - 1) as f64;
    let place = |k: usize| film.at([share(k % SIDE), share(k / SIDE)]);
    let cones =
        (0..SIDE * SIDE).into_par_iter().map(|k| film_cone(&tracer, place(k))).collect::<Result<_, _>>()?;
    let x_mm = (0..SIDE).map(|i| film.at([share(i), 0.0])[0]).collect();
    let y_mm = (0..SIDE).map(|j| film.at([0.0, share(j)])[1]).collect();
    ConeGrid::new(x_mm, y_mm, cones).map_err(|problem| SkewError::Cones { wavelength_um: um, problem })
}

#[cfg(test)]
mod tests {
    use super::super::tests::lenses::{UM, double_gauss, film, lens_0};
    use super::*;
    use crate::design::figures::image_cone::image_cone;
    use crate::design::prescription::system::RayAiming;
    use crate::design::pupil::test_lenses;
    use crate::design::rays::ray::Tracer;
    use crate::lens::cone_field::PlacedCone;
    use crate::real;

    /// Covariance of the ellipse on the film: xx, xy, yy, times 4.
    fn covariance(cone: &PlacedCone) -> [f64; 3] {
        let [a, b, c] = cone.root;
        let [u, v] = [cone.on_film([a, b]), cone.on_film([0.0, c])];
        [u[0] * u[0] + v[0] * v[0], u[0] * u[1] + v[0] * v[1], u[1] * u[1] + v[1] * v[1]]
    }

    /// Without errors, on all sides of the axis: with no aperture, and with a vignetted pupil. The signs are those of the symmetric tracer, whose rays go away from the axis.
    #[test]
    fn a_lens_without_errors_has_the_cones_of_its_design() {
        for (system, height_mm, tolerance) in
            [(double_gauss(RayAiming::Real), 15.0, 1e-6), (test_lenses::lens("mirrorless-50"), 18.0, 2e-5)]
        {
            let nominal = Tracer::new(&system, UM).unwrap();
            let built = BuiltLens::new(&system, &[]).unwrap();
            let tracer = SkewTracer::new(&built, UM).unwrap();
            let expected = image_cone(&nominal, nominal.field_of_height(height_mm).unwrap()).unwrap();
            for azimuth in [0.0, 0.7, 2.0, -2.4] {
                let (sin, cos) = real::sin_cos(azimuth);
                let away = [cos, sin];
                let [a, b, c, d, roots @ ..] = film_cone(&tracer, away.map(|v| height_mm * v)).unwrap();
                let found = PlacedCone { axis: [1.0, 0.0], chief: [a, b], centre: [c, d], root: roots };
                let expected = PlacedCone::symmetric(&expected, away);
                let both = |of: &PlacedCone| [of.on_film(of.chief), of.on_film(of.centre)];
                let (found_moments, expected_moments) = (covariance(&found), covariance(&expected));
                let pairs =
                    both(&found).into_iter().zip(both(&expected)).flat_map(|(a, b)| a.into_iter().zip(b));
                for (found, expected) in pairs.chain(found_moments.into_iter().zip(expected_moments)) {
                    assert!((found - expected).abs() < tolerance, "{azimuth}: {found} {expected}");
                }
            }
        }
    }

    /// A positive tilt about y turns +X of the film against the light, whose direction on the axis then has a negative X.
    #[test]
    fn a_tilted_film_sees_the_cone_turned() {
        let of = |deviations: &[_]| {
            let built = BuiltLens::new(&double_gauss(RayAiming::Real), deviations).unwrap();
            film_cone(&SkewTracer::new(&built, UM).unwrap(), [0.0; 2]).unwrap()
        };
        let flat = of(&[]);
        for angle in [0.1_f64, -0.1] {
            let [l, m, ..] = of(&[film([0.0, angle])]);
            assert!((l + real::sin(angle)).abs() < 1e-9 && m.abs() < 1e-9, "{angle}: {l} {m}");
        }
        assert!(
            flat[0].abs() < 1e-12 && (flat[4] - flat[6]).abs() < 1e-6 && flat[5].abs() < 1e-9,
            "{flat:?}"
        );
    }

    /// Smooth where nothing clips the pupil; where apertures begin to, at the axis too, the numbers have kinks: 5e-4 is 0.03 degrees.
    #[test]
    fn cones_between_nodes_are_those_of_rays() {
        let errors = [lens_0(), vec![film([2e-3, -3e-3])]].concat();
        let range = FilmRange { x_mm: [-9.0, 12.0], y_mm: [-4.0, 8.0] };
        let clipped = test_lenses::lens("mirrorless-50");
        for (system, errors, tolerance) in
            [(double_gauss(RayAiming::Real), &errors[..], 1e-6), (clipped, &errors[errors.len() - 1..], 5e-4)]
        {
            let built = BuiltLens::new(&system, errors).unwrap();
            let grid = film_cones(&built, UM, range).unwrap();
            let tracer = SkewTracer::new(&built, UM).unwrap();
            for place in [[0.0, 0.0], [-8.9, 7.7], [11.3, -3.1], [5.2, 6.6]] {
                let expected = film_cone(&tracer, place).unwrap();
                let PlacedCone { chief, centre, root, .. } = grid.at(place);
                let found = [&chief[..], &centre, &root].concat();
                for (found, expected) in found.into_iter().zip(expected) {
                    assert!((found - expected).abs() < tolerance, "{place:?}: {found} {expected}");
                }
            }
        }
    }
}
