//! Lenses with closed forms.

use crate::design::prescription::shape::Shape;
use crate::design::prescription::system::{Aperture, FieldKind, Medium, RayAiming, Surface, System};

/// A system for an object at infinity, all of whose rays reach the film.
pub(in crate::design) fn system(
    surfaces: Vec<Surface>,
    stop: usize,
    pupil_mm: f64,
    field_deg: f64,
) -> System {
    System {
        name: "closed form".to_owned(),
        object_distance_mm: None,
        is_telecentric: false,
        surfaces,
        stop,
        aperture: Aperture::EntrancePupil(pupil_mm),
        field_kind: FieldKind::Angle,
        fields: vec![0.0, field_deg],
        wavelengths_um: vec![(0.5, 1.0)],
        primary: 0,
        aiming: RayAiming::Paraxial,
        notes: Vec::new(),
        asymmetry: None,
    }
}

/// A parabolic mirror of focal length `f` with the film in its focus.
pub(in crate::design) fn parabolic_mirror(f: f64, pupil_mm: f64) -> System {
    let mirror = Surface {
        shape: Shape { curvature: -0.5 / f, conic: -1.0, ..Shape::default() },
        is_mirror: true,
        ..Surface::new(0.0, f, Medium::Air)
    };
    system(vec![mirror, Surface::new(0.0, 0.0, Medium::Air)], 0, pupil_mm, 1.0)
}
