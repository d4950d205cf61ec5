//! Cardinal points.
//!
//! ```text
//! F: where rays that leave parallel to the axis cross it before the lens      F': where rays that arrive parallel cross it behind it
//! object side: f = −1/P, H = F − f, N = F + n'/P, H̃ = F + f, Ñ = F − n'/P
//! image side: f' = n'/P, H' = F' − f', N' = F' − 1/P, H̃' = F' + f', Ñ' = F' + 1/P       1/P effective focal length, index 1 before the lens
//! ```
//! H, H': principal points (magnification 1); N, N': nodal points (angular magnification 1); H̃, H̃', Ñ, Ñ': anti-principal and anti-nodal points
//! (−1). Positions along the light, object side from the first surface, image side from the film. Source: Welford, chapter 3.

use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::System;
use crate::design::rays::paraxial::Paraxial;

/// Focal length and points of one side, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Side {
    /// Focal length, negative on the object side of a positive lens.
    pub focal_length_mm: f64,
    /// Focal point.
    pub focal_mm: f64,
    /// Principal point.
    pub principal_mm: f64,
    /// Anti-principal point.
    pub anti_principal_mm: f64,
    /// Nodal point.
    pub nodal_mm: f64,
    /// Anti-nodal point.
    pub anti_nodal_mm: f64,
}

impl Side {
    /// From the focal length, the position of the focal point and its distance to the nodal point.
    fn new(focal_length_mm: f64, focal_mm: f64, to_nodal_mm: f64) -> Self {
        Self {
            focal_length_mm,
            focal_mm,
            principal_mm: focal_mm - focal_length_mm,
            anti_principal_mm: focal_mm + focal_length_mm,
            nodal_mm: focal_mm + to_nodal_mm,
            anti_nodal_mm: focal_mm - to_nodal_mm,
        }
    }
}

/// Points of the object side and of the image side at `um`.
///
/// # Errors
/// No first-order properties; a wavelength outside a glass's range.
pub fn cardinal_points(system: &System, um: f64) -> Result<[Side; 2], DesignError> {
    let p = Paraxial::new(system, um)?;
    let (efl, index) = (p.effective_focal_length_mm, p.image_index);
    let last_gap_mm = system.surfaces[system.image() - 1].thickness_mm;
    Ok([
        Side::new(-efl, p.front_focus_mm, index * efl),
        Side::new(index * efl, p.back_focal_length_mm - last_gap_mm, -efl),
    ])
}

#[cfg(test)]
mod tests {
    use super::super::tests::system;
    use super::*;
    use crate::design::prescription::glass::{Dispersion, Glass};
    use crate::design::prescription::system::{Medium, Surface};

    fn glass(n: f64) -> Medium {
        Medium::Glass(Glass::new("constant".into(), Dispersion::constant(n), (0.1, 9.0)))
    }

    /// A thick biconvex lens: H at f (n − 1) t c₂ / n behind the first surface (c₂ < 0 turns it inwards), by the lensmaker's formula.
    #[test]
    fn thick_lens_has_the_points_of_the_lensmakers_formula() {
        let (n, t, c1, c2) = (1.5, 1.0, 0.05, -0.05);
        let lens = system(
            vec![
                Surface::new(c1, t, glass(n)),
                Surface::new(c2, 19.792, Medium::Air),
                Surface::new(0.0, 0.0, Medium::Air),
            ],
            0,
            2.0,
            1.0,
        );
        let [object, image] = cardinal_points(&lens, 0.5).unwrap();
        let f = 1.0 / ((n - 1.0) * (c1 - c2 + (n - 1.0) * t * c1 * c2 / n));
        let (h, h_image) = (-f * (n - 1.0) * t * c2 / n, -f * (n - 1.0) * t * c1 / n);
        assert!((object.focal_length_mm + f).abs() < 1e-12 && (image.focal_length_mm - f).abs() < 1e-12);
        assert!((object.principal_mm - h).abs() < 1e-12, "{object:?} {h}");
        assert!((image.principal_mm - (h_image - 19.792)).abs() < 1e-12, "{image:?} {h_image}");
        // In air the nodal points are the principal points.
        assert!((object.nodal_mm - object.principal_mm).abs() < 1e-12);
        assert!((image.nodal_mm - image.principal_mm).abs() < 1e-12);
        assert!((image.anti_principal_mm - (image.focal_mm + f)).abs() < 1e-12);
    }

    /// A single surface into a glass: principal points at its vertex, nodal points at its centre.
    #[test]
    fn nodal_points_of_a_surface_are_its_centre() {
        let lens = system(
            vec![Surface::new(0.05, 60.0, glass(1.5)), Surface::new(0.0, 0.0, Medium::Air)],
            0,
            2.0,
            1.0,
        );
        let [object, image] = cardinal_points(&lens, 0.5).unwrap();
        for (found, expected) in [
            (object.principal_mm, 0.0),
            (object.nodal_mm, 20.0),
            (image.principal_mm, -60.0),
            (image.nodal_mm, -40.0),
            (image.focal_length_mm, 60.0),
            (object.focal_length_mm, -40.0),
        ] {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}: {object:?} {image:?}");
        }
    }
}
