//! The paraxial marginal and chief ray at every surface.
//!
//! ```text
//! n' u' = n u − y c (n' − n),   y ← y + t u',   A = n i = n (u + y c) = n' (u' + y c)      [`crate::design::paraxial`]
//! H = n (u ȳ − ū y)      Lagrange invariant, the same at every surface
//! ```
//! The marginal ray (y, u) passes the edge of the paraxial entrance pupil from the axial object point, the chief ray (ȳ, ū) its centre from the
//! outermost field point of the design, whose image is on +x. z counts along the light: slopes behind a mirror have the sign that the light
//! sees. Source: Welford, chapter 3.

use super::describe::field_tan;
use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::System;
use crate::design::rays::paraxial::Paraxial;

/// A paraxial ray at a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParaxialPoint {
    /// Height, mm.
    pub height_mm: f64,
    /// Slope before the surface.
    pub slope_before: f64,
    /// Slope behind it.
    pub slope: f64,
    /// Index times the angle of incidence: A.
    pub invariant: f64,
}

/// Both rays at one surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParaxialRays {
    /// Index before the surface.
    pub index_before: f64,
    /// Index behind it.
    pub index: f64,
    /// The marginal ray.
    pub marginal: ParaxialPoint,
    /// The chief ray.
    pub chief: ParaxialPoint,
}

impl ParaxialRays {
    /// The Lagrange invariant, mm.
    pub fn lagrange_mm(&self) -> f64 {
        let (m, c) = (&self.marginal, &self.chief);
        self.index_before * (m.slope_before * c.height_mm - c.slope_before * m.height_mm)
    }
}

/// The rays at all surfaces of `system`, the film the last, at `um`; pupil and field are those of the primary wavelength.
///
/// # Errors
/// No first-order properties; a wavelength outside a glass's range.
pub fn paraxial_rays(system: &System, um: f64) -> Result<Vec<ParaxialRays>, DesignError> {
    let primary = Paraxial::new(system, system.primary_um())?;
    let tan = system.fields.iter().map(|f| field_tan(system, &primary, *f).abs()).fold(0.0, f64::max);
    // An image on +x.
    let tan = tan * primary.distortion_focal_length_mm.signum();
    let (pupil, radius) = (primary.entrance_pupil_mm, primary.entrance_radius_mm);
    let mut rays = match system.object_distance_mm {
        None => [(radius, 0.0), (-tan * pupil, tan)],
        Some(d) if system.is_telecentric => [(radius, radius / d), (-tan * d, 0.0)],
        Some(d) => [(radius * d / (d + pupil), radius / (d + pupil)), (-tan * pupil, tan)],
    };
    let mut n = 1.0;
    let mut all = Vec::with_capacity(system.surfaces.len());
    for (i, s) in system.surfaces.iter().enumerate() {
        let is_film = i == system.image();
        let next = if is_film { n } else { s.medium.index(um)? };
        let curvature = s.shape.paraxial_curvature();
        let [marginal, chief] = rays.map(|(y, u)| ParaxialPoint {
            height_mm: y,
            slope_before: u,
            slope: if is_film { u } else { s.slope_behind((y, u), (n, next)) },
            invariant: n * (u + y * curvature),
        });
        rays = [marginal, chief].map(|r| (r.height_mm + s.thickness_mm * r.slope, r.slope));
        all.push(ParaxialRays { index_before: n, index: next, marginal, chief });
        n = next;
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_of_the_double_gauss_have_one_invariant_and_the_described_figures() {
        let mut system = System::double_gauss_28();
        for distance in [None, Some(2000.0)] {
            system.object_distance_mm = distance;
            let um = system.primary_um();
            let rays = paraxial_rays(&system, um).unwrap();
            let first = rays[0].lagrange_mm();
            assert!(rays.iter().all(|r| (r.lagrange_mm() - first).abs() < 1e-10 * first.abs()));
            let p = Paraxial::new(&system, um).unwrap();
            let film = rays.last().unwrap();
            let tan = 14.0_f64.to_radians().tan();
            assert!((film.chief.height_mm - tan * p.distortion_focal_length_mm).abs() < 1e-10);
            assert!((film.marginal.slope.abs() - p.marginal_slope).abs() < 1e-13);
            assert!((rays[system.stop].marginal.height_mm.abs() - p.stop_radius_mm).abs() < 1e-10);
            assert!(rays[system.stop].chief.height_mm.abs() < 1e-10);
        }
    }
}
