//! Image circle of a lens: the real image height up to which its clear apertures let light through.

use crate::design::pupil::illumination::irradiance_sr;
use crate::design::rays::ray::Tracer;
use crate::real;

/// Relative illumination at the edge of the image circle.
pub const EDGE: f64 = 0.1;
/// Angles of the field at which the illumination is determined first.
const STEPS: u32 = 24;
/// Bisections of the angle of the edge.
const BISECTIONS: u32 = 12;

impl Tracer<'_> {
    /// Real image height, mm, from which on the relative illumination is below [`EDGE`]; `None` if no aperture blocks so much light up to
    /// the outermost chief ray that reaches the film.
    pub fn image_circle_mm(&self) -> Option<f64> {
        if !self.has_apertures() {
            return None;
        }
        let axis = irradiance_sr(self, 0.0).ok()?;
        let is_lit =
            |angle: f64| irradiance_sr(self, real::tan(angle)).is_ok_and(|light| light >= EDGE * axis);
        let last = real::atan(self.farthest_field().1);
        let angle = |step: u32| last * f64::from(step) / f64::from(STEPS);
        let dark = (1..=STEPS).find(|step| !is_lit(angle(*step)))?;
        let (mut low, mut high) = (angle(dark - 1), angle(dark));
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (low + high);
            if is_lit(middle) { low = middle } else { high = middle }
        }
        self.chief_height_mm(real::tan(low)).ok().filter(|mm| *mm > 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::prescription::system::{Aperture, FieldKind, Medium, RayAiming, Surface, System};

    #[test]
    fn two_equal_holes_end_the_image_circle_where_their_discs_overlap_by_a_tenth() {
        // A lens at the stop with a hole of the same radius 30 mm before it: discs of radius a, their centres 30 t apart.
        let (a, f, gap) = (3.0, 50.0, 30.0);
        let mut hole = Surface::new(0.0, gap, Medium::Air);
        hole.aperture_mm = Some(a);
        // A parabolic mirror: the chief ray through its vertex has the image height f tan θ.
        let mut mirror = Surface::new(-0.5 / f, f, Medium::Air);
        mirror.shape.conic = -1.0;
        mirror.is_mirror = true;
        let system = System {
            name: "holes".to_owned(),
            object_distance_mm: None,
            is_telecentric: false,
            surfaces: vec![hole, mirror, Surface::new(0.0, 0.0, Medium::Air)],
            stop: 1,
            aperture: Aperture::EntrancePupil(2.0 * a),
            field_kind: FieldKind::Angle,
            fields: vec![0.0],
            wavelengths_um: vec![(0.55, 1.0)],
            primary: 0,
            aiming: RayAiming::Paraxial,
            notes: Vec::new(),
            asymmetry: None,
        };
        let tracer = Tracer::new(&system, 0.55).unwrap();
        let found = tracer.image_circle_mm().unwrap();
        // RI = cos⁴θ · overlap; found is f tan θ.
        let tan = found / f;
        let half = gap * tan / (2.0 * a);
        let overlap = 2.0 / std::f64::consts::PI * (half.acos() - half * (1.0 - half * half).sqrt());
        let expected = overlap / (1.0 + tan * tan).powi(2);
        assert!((expected - EDGE).abs() < 1e-3, "{found} mm: {expected}");
        let open = System {
            surfaces: system.surfaces.iter().map(|s| Surface { aperture_mm: None, ..s.clone() }).collect(),
            ..system
        };
        assert_eq!(Tracer::new(&open, 0.55).unwrap().image_circle_mm(), None);
    }
}
