//! Ghosts in first order: place, size and share.
//!
//! ```text
//! y = A y₀ + B u₀                                         height at a crossing, of a ray of height y₀ and slope u₀ in the plane of the first vertex
//! u' = (n₁ u − y c (n₂ − n₁))/n₂,   u' = u + 2 c y        refraction, reflection; z along the light, c as the light sees it
//! x = c ρ + m tan θ,   c = A,   m = B − A z_p             on the film, ρ height in the entrance pupil, at z_p (object at infinity)
//! a = min over crossings of clear radius / |c_k|,   γ = (w/w_image) (a/a_pupil)²
//! ```
//! γ is the share of the image's light on the axis, |c| a the radius of the blob on the film, γ/(π c² a²) its density.

use std::f64::consts::PI;

use super::light::GhostLight;
use super::path::{Act, Crossing, GhostLens, GhostPath};

/// First-order figures of a ghost.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FirstOrder {
    /// x on the film per height in the entrance pupil.
    pub height_per_pupil: f64,
    /// x on the film per tangent of the field angle, mm.
    pub height_per_tan: f64,
    /// Radius in the entrance pupil that passes all clear radii, on the axis, mm.
    pub open_radius_mm: f64,
    /// Radius of the blob on the film, mm.
    pub blob_mm: f64,
    /// Reflectances and transmittances at normal incidence over those of the image.
    pub weight: f64,
    /// Share of the light of the image, on the axis.
    pub share: f64,
}

impl FirstOrder {
    /// Share per area of the blob, 1/mm².
    pub fn density(&self) -> f64 {
        self.share / (PI * self.blob_mm * self.blob_mm)
    }
}

/// (A, B) at every crossing.
pub(super) fn heights(crossings: &[Crossing<'_>]) -> Vec<[f64; 2]> {
    let (mut y, mut u) = ([1.0, 0.0], [0.0, 1.0]);
    let mut rows = Vec::with_capacity(crossings.len());
    for crossing in crossings {
        rows.push(y);
        let (n1, n2) = crossing.indices;
        let c = crossing.shape.paraxial_curvature();
        for k in 0..2 {
            u[k] = match (crossing.act, crossing.ideal_focal_mm) {
                (Act::Reflects | Act::Mirrors, _) => u[k] + 2.0 * c * y[k],
                (_, Some(f)) => (n1 * u[k] - y[k] / f) / n2,
                _ => (n1 * u[k] - y[k] * c * (n2 - n1)) / n2,
            };
            y[k] += crossing.gap_mm * u[k];
        }
    }
    rows
}

impl GhostLens<'_> {
    /// First-order figures of `path` with the light `light`.
    pub fn first_order(&self, path: GhostPath, light: &GhostLight) -> FirstOrder {
        let crossings = self.crossings(Some(path));
        let rows = heights(&crossings);
        let primary = &self.tracer.primary;
        let pupil = primary.entrance_pupil_mm;
        // Per height ρ in the pupil and per tangent t: y₀ = ρ − z_p u₀, u₀ = t, or from an object point at a finite distance.
        let slope = self.tracer.object_distance_mm().map_or(0.0, |d| 1.0 / (d + pupil));
        let per_pupil = |[a, b]: [f64; 2]| a * (1.0 - pupil * slope) + b * slope;
        let [a, b] = rows[rows.len() - 1];
        let per_tan = match (self.system.is_telecentric, self.tracer.object_distance_mm()) {
            (true, Some(d)) => -a * d,
            _ => b - a * pupil,
        };
        let open = crossings.iter().zip(&rows).take(rows.len() - 1).map(|(crossing, row)| {
            let c = per_pupil(*row).abs();
            if c > 0.0 { self.apertures.clear_mm[crossing.surface] / c } else { f64::INFINITY }
        });
        let open_radius_mm = open.fold(f64::INFINITY, f64::min);
        let c = per_pupil([a, b]);
        let weight = light.on_axis(&crossings) / light.on_axis(&self.crossings(None));
        FirstOrder {
            height_per_pupil: c,
            height_per_tan: per_tan,
            open_radius_mm,
            blob_mm: c.abs() * open_radius_mm,
            weight,
            share: weight * (open_radius_mm / primary.entrance_radius_mm).powi(2),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_lenses::*;
    use super::*;

    #[test]
    fn two_reflections_inside_a_thin_lens_focus_at_a_seventh() {
        // n = 1.5, f = 100: f (n − 1)/(3 n − 1).
        let (n, c1, c2) = (1.5, 0.012, -0.008);
        let focus: f64 = 100.0 * (n - 1.0) / (3.0 * n - 1.0);
        assert!((focus - 14.2857).abs() < 1e-4);
        let system = lens(&[(c1, 1e-9, n, 1.0), (c2, focus, 1.0, 1.0)], 0);
        let apertures = Apertures::new(&system, 1.0).unwrap();
        let lens = GhostLens::new(&system, 0.55, &apertures).unwrap();
        let rows = heights(&lens.crossings(Some(GhostPath { first: 1, second: 0 })));
        let [a, b] = rows[rows.len() - 1];
        assert!(a.abs() < 1e-9 && (b / focus - 1.0).abs() < 1e-9, "{a} {b}");
    }
}
