//! Lenses of a few surfaces, and functions of closed forms.
#![allow(dead_code, reason = "each test binary uses its part")]

use lenscube_pipeline::design::System;
use lenscube_pipeline::design::system::{Aperture, FieldKind, Medium, RayAiming, Surface};

/// A lens at 550 nm with an entrance pupil, fields at 0 and 10 degrees and an object at infinity.
pub fn system(surfaces: Vec<Surface>, stop: usize, pupil_mm: f64) -> System {
    System {
        name: String::new(),
        object_distance_mm: None,
        is_telecentric: false,
        surfaces,
        stop,
        aperture: Aperture::EntrancePupil(pupil_mm),
        field_kind: FieldKind::Angle,
        fields: vec![0.0, 10.0],
        wavelengths_um: vec![(0.55, 1.0)],
        primary: 0,
        aiming: RayAiming::Paraxial,
        notes: Vec::new(),
        asymmetry: None,
    }
}

/// A plane in air.
pub fn flat(gap: f64) -> Surface {
    Surface::new(0.0, gap, Medium::Air)
}

/// An ideal thin lens.
pub fn ideal(focal_mm: f64, gap: f64) -> Surface {
    Surface { ideal_focal_mm: Some(focal_mm), ..flat(gap) }
}

/// An object at 100 mm, ideal lenses of 100 and 50 mm with the stop in the focus of both: magnification −1/2.
pub fn relay(na: f64) -> System {
    let surfaces = vec![ideal(100.0, 100.0), flat(50.0), ideal(50.0, 50.0), flat(0.0)];
    System {
        object_distance_mm: Some(100.0),
        is_telecentric: true,
        aperture: Aperture::ObjectNa(na),
        field_kind: FieldKind::ObjectHeight,
        fields: vec![0.0, 8.0],
        ..system(surfaces, 1, 1.0)
    }
}

/// J₁(x)/x by its series.
pub fn bessel_j1_over_x(x: f64) -> f64 {
    let (mut term, mut sum) = (0.5, 0.5);
    for k in 1..80 {
        term *= -(x * x / 4.0) / (f64::from(k) * f64::from(k + 1));
        sum += term;
    }
    sum
}
