//! The directions of the light at the film ([`crate::lens::cone`]), from the rays of a bundle.
//!
//! ```text
//! ⟨f⟩ = Σ w_i Ω_i f(l_i, m_i) / Σ w_i Ω_i        w_i: weights of the bundle's quadrature, Ω_i = |d(l, m)/d(p, q)|
//! ```
//! Of a thin lens with its stop at distance s before the film, a circle of radius ρ: the bundle at height h is that of the cone from (h, 0, s) to the circle. Includes vignetting, pupil
//! aberration and defocus; losses at coatings, which differ a little over the pupil, are left out.

use rayon::prelude::*;

use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::System;
use crate::design::pupil::bundle::Bundle;
use crate::design::rays::ray::Tracer;
use crate::lens::cone::{Cone, ConeTable};

/// Heights of a table.
const HEIGHTS: usize = 33;

/// The cone of the field point at tan(field angle) `tan`.
///
/// # Errors
/// A ray of the pupil that does not reach the image.
pub fn image_cone(tracer: &Tracer<'_>, tan: f64) -> Result<Cone, DesignError> {
    let bundle = Bundle::trace(tracer, tan, 7, 9)?;
    let (mut all, mut along, mut squares) = (0.0, 0.0, [0.0; 2]);
    for (weight, ray) in &bundle.rays {
        let share = weight * ray.solid_angle();
        all += share;
        along += share * ray.l.v;
        squares[0] += share * ray.l.v * ray.l.v;
        squares[1] += share * ray.m.v * ray.m.v;
    }
    let centre = along / all;
    Ok(Cone {
        chief: bundle.chief.l.v,
        centre,
        tangential: 2.0 * (squares[0] / all - centre * centre).max(0.0).sqrt(),
        sagittal: 2.0 * (squares[1] / all).sqrt(),
    })
}

/// The cones of `system` at `um` up to `reach_mm` on the film.
///
/// # Errors
/// As [`image_cone`]; the lens cannot be traced so far.
pub fn image_cones(system: &System, um: f64, reach_mm: f64) -> Result<ConeTable, DesignError> {
    let tracer = Tracer::new(system, um)?;
    let step_mm = reach_mm / (HEIGHTS - 1) as f64;
    let cones: Result<Vec<Cone>, DesignError> = (0..HEIGHTS)
        .into_par_iter()
        .map(|k| image_cone(&tracer, tracer.field_of_height(step_mm * k as f64)?))
        .collect();
    let mut cones = cones?;
    (cones[0].chief, cones[0].centre) = (0.0, 0.0);
    Ok(ConeTable::new(step_mm, cones))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::pupil::illumination::solid_angle_sr;
    use crate::design::rays::paraxial::Paraxial;
    use crate::real;
    use std::f64::consts::PI;

    /// Near the axis the chief ray comes from the middle of the paraxial exit pupil.
    #[test]
    fn chief_rays_near_the_axis_come_from_the_exit_pupil() {
        let lens = System::double_gauss_28();
        let exit_pupil_mm = Paraxial::new(&lens, 0.5876).unwrap().exit_pupil_mm;
        let tracer = Tracer::new(&lens, 0.5876).unwrap();
        for height_mm in [0.05, 0.2] {
            let cone = image_cone(&tracer, tracer.field_of_height(height_mm).unwrap()).unwrap();
            let expected = height_mm / real::hypot(height_mm, exit_pupil_mm);
            assert!((cone.chief / expected - 1.0).abs() < 1e-4, "{height_mm}: {} {expected}", cone.chief);
        }
    }

    #[test]
    fn cone_of_a_circular_pupil_has_its_marginal_rays_and_solid_angle() {
        let lens = System::double_gauss_28();
        let tracer = Tracer::new(&lens, 0.5876).unwrap();
        let axis = image_cone(&tracer, 0.0).unwrap();
        assert!(axis.chief.abs() < 1e-12 && axis.centre.abs() < 1e-9);
        assert!((axis.tangential - axis.sagittal).abs() < 1e-6, "{axis:?}");
        for height_mm in [0.0, 10.0, 20.0] {
            let tan = tracer.field_of_height(height_mm).unwrap();
            let cone = image_cone(&tracer, tan).unwrap();
            let area = PI * cone.tangential * cone.sagittal;
            let expected = solid_angle_sr(&tracer, tan).unwrap();
            // An ellipse with the moments of an outline that is nearly one has nearly its area.
            assert!((area / expected - 1.0).abs() < 5e-3, "{height_mm}: {area} {expected}");
            assert!(height_mm == 0.0 || cone.chief > 0.0);
        }
        let table = image_cones(&lens, 0.5876, 20.0).unwrap();
        let tan = tracer.field_of_height(13.3).unwrap();
        let (found, expected) = (table.at(13.3), image_cone(&tracer, tan).unwrap());
        assert!((found.chief - expected.chief).abs() < 1e-6);
        assert!((found.tangential - expected.tangential).abs() < 1e-4, "{found:?} {expected:?}");
    }
}
