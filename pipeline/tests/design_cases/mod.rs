//! Lenses of a few surfaces, and functions of closed forms.
#![allow(dead_code, reason = "each test binary uses its part")]

use lenscube_pipeline::design::System;
use lenscube_pipeline::design::system::{Aperture, FieldKind, RayAiming, Surface};

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
