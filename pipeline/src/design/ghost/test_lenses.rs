//! Lenses for the tests of ghosts.

pub(super) use super::apertures::Apertures;
use crate::design::prescription::coating::{Coating, Spectrum};
use crate::design::prescription::coatings::Coatings;
use crate::design::prescription::glass::{Dispersion, Glass};
use crate::design::prescription::system::{Aperture, FieldKind, Medium, RayAiming, Surface, System};

/// A lens of uncoated surfaces (curvature, thickness, index behind, clear radius) and a film.
pub(super) fn lens(rows: &[(f64, f64, f64, f64)], stop: usize) -> System {
    let surface = |&(curvature, thickness, n, clear): &(f64, f64, f64, f64)| {
        let glass = || Glass::new("n".to_owned(), Dispersion::constant(n), (0.0, 9.0));
        let medium = if n == 1.0 { Medium::Air } else { Medium::Glass(glass()) };
        let mut s = Surface::new(curvature, thickness, medium);
        s.aperture_mm = Some(clear);
        s.coating = Some(Coating::Bare);
        s
    };
    let mut surfaces: Vec<Surface> = rows.iter().map(surface).collect();
    surfaces.push(Surface::new(0.0, 0.0, Medium::Air));
    System {
        name: "lens".to_owned(),
        object_distance_mm: None,
        is_telecentric: false,
        surfaces,
        stop,
        aperture: Aperture::EntrancePupil(0.2),
        field_kind: FieldKind::Angle,
        fields: vec![0.0],
        wavelengths_um: vec![(0.55, 1.0)],
        primary: 0,
        aiming: RayAiming::Paraxial,
        notes: Vec::new(),
        asymmetry: None,
    }
}

/// The Double Gauss with `coating` on its boundaries with air, without absorption.
pub(super) fn double_gauss(coating: Coating) -> System {
    let coatings = Coatings { default: coating, surfaces: Vec::new() };
    let mut system = System::double_gauss_28().with_coatings(&coatings).unwrap();
    for s in &mut system.surfaces {
        if let Medium::Glass(glass) = &mut s.medium {
            glass.absorption = None;
        }
    }
    system
}

/// Bare, a quarter wave of index 1.38 at 550 nm, 0.2 %.
pub(super) fn coatings() -> [Coating; 3] {
    let low = Spectrum { name: "low".to_owned(), entries: vec![(0.5, 0.002)] };
    [Coating::Bare, Coating::quarter_wave("MgF2", 1.38, 0.55), Coating::Reflectance(low)]
}

/// A biconvex lens of 20 mm behind its stop, f/4, uncoated.
pub(super) fn singlet() -> System {
    let mut system = lens(&[(0.0, 1.0, 1.0, 2.5), (0.05, 3.0, 1.5, 5.0), (-0.05, 19.0, 1.0, 5.0)], 0);
    system.aperture = Aperture::EntrancePupil(5.0);
    system
}
