//! Surfaces that cross within the aperture that light uses: such a prescription cannot be made, and rays go backwards there.
//!
//! ```text
//! gap(r) = t + sag₂(r) − sag₁(r)      t thickness, sag towards +z of the light [mm]; behind a mirror sag₁ counts the other way
//! ```
//! Planes of reference and diaphragms, which have the same medium on both sides, are left out: a stop may lie in the hollow of a lens.
//! The used radius of a surface is that of its meridional rays from three field points, as far as they pass its aperture.

use super::describe::field_tan;
use crate::design::prescription::error::tidy;
use crate::design::prescription::system::{Medium, System};
use crate::design::rays::ray::Tracer;

/// Depth of a crossing that is not one of rounding, mm.
const DEPTH_MM: f64 = 1e-5;
/// Radii at which the gap is determined.
const STEPS: u32 = 200;

/// A note for each pair of neighbouring surfaces that cross.
pub fn crossings(system: &System) -> Vec<String> {
    let used = used_radii(system);
    let surfaces = &system.surfaces;
    let boundaries: Vec<usize> = (0..system.image()).filter(|i| is_boundary(system, *i)).collect();
    boundaries
        .windows(2)
        .filter_map(|pair| {
            let (i, j) = (pair[0], pair[1]);
            let thickness_mm: f64 = surfaces[i..j].iter().map(|s| s.thickness_mm).sum();
            let radius = used[i].min(used[j]);
            let along = if surfaces[i].is_mirror { -1.0 } else { 1.0 };
            let radii = (1..=STEPS).map(|k| radius * f64::from(k) / f64::from(STEPS));
            let crosses = |r: &f64| {
                let sags = surfaces[i].shape.sag_mm(*r).zip(surfaces[j].shape.sag_mm(*r));
                sags.is_some_and(|(a, b)| thickness_mm + b - along * a < -DEPTH_MM)
            };
            let at = radii.clone().find(crosses)?;
            Some(format!(
                "surfaces {} and {} cross at {at:.3} mm from the axis; light uses them up to {radius:.3} mm: check their radii and the \
                 thickness of {} mm between them",
                i + 1,
                j + 1,
                tidy(&thickness_mm),
            ))
        })
        .collect()
}

/// Whether the surface bends light.
fn is_boundary(system: &System, index: usize) -> bool {
    let before = match index {
        0 => &Medium::Air,
        _ => &system.surfaces[index - 1].medium,
    };
    let surface = &system.surfaces[index];
    surface.is_mirror || surface.ideal_focal_mm.is_some() || surface.medium != *before
}

/// Largest distance from the axis of a meridional ray at each surface, mm; 0 where no ray is known.
fn used_radii(system: &System) -> Vec<f64> {
    let mut used = vec![0.0_f64; system.surfaces.len()];
    let Ok(tracer) = Tracer::new(system, system.primary_um()) else { return used };
    let fields = system.fields.iter().map(|field| field_tan(system, &tracer.primary, *field).abs());
    let last = fields.filter(|tan| tan.is_finite()).fold(0.0, f64::max);
    for tan in [0.0, 0.7 * last, last] {
        for p in (-10..=10).map(|i| f64::from(i) / 10.0).filter(|p| tracer.passes(tan, *p, 0.0)) {
            for (radius, (_, x)) in used.iter_mut().zip(tracer.path(tan, p, 0.0).iter().flatten().skip(1)) {
                *radius = radius.max(x.abs());
            }
        }
    }
    used
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_thickness_that_is_too_small_makes_surfaces_cross() {
        assert!(crossings(&System::double_gauss_28()).is_empty());
        let mut system = System::double_gauss_28();
        // The first element: 8.75 mm thick, used up to 33 mm, where its faces are 8 mm nearer than on the axis.
        system.surfaces[0].thickness_mm = 1.0;
        let notes = crossings(&system);
        assert!(notes.len() == 1 && notes[0].starts_with("surfaces 1 and 2 cross at "), "{notes:?}");
        let mm: f64 = notes[0][26..].split(' ').next().unwrap().parse().unwrap();
        let gap = |r: f64| {
            let sag = |i: usize| system.surfaces[i].shape.sag_mm(r).unwrap();
            1.0 + sag(1) - sag(0)
        };
        assert!(gap(mm) < 0.0 && gap(0.97 * mm) > 0.0, "{mm}");
    }

    #[test]
    fn diaphragm_in_the_hollow_of_a_lens_crosses_nothing() {
        let mut system = System::double_gauss_28();
        // The stop, a plane between two hollow faces, at the vertex of the one behind it.
        let stop = (0..system.image()).find(|i| !is_boundary(&system, *i)).unwrap();
        let gap_mm = system.surfaces[stop].thickness_mm;
        system.surfaces[stop - 1].thickness_mm += gap_mm;
        system.surfaces[stop].thickness_mm = 0.0;
        // The pupil grows, so that elements cross; the stop crosses nothing.
        let notes = crossings(&system);
        let names = [format!("surfaces {} and", stop + 1), format!("and {} cross", stop + 1)];
        assert!(!notes.iter().any(|note| names.iter().any(|name| note.contains(name))), "{notes:?}");
        let sag = system.surfaces[stop + 1].shape.sag_mm(5.0).unwrap();
        assert!(sag < -0.1, "the face behind the stop is not hollow: {sag}");
    }
}
