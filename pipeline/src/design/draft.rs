//! A prescription as a reader collects it from a design file, and what all file formats have in common when it becomes a [`System`].
//!
//! Surfaces run from the object (0) to the image plane (last). A surface blocks light beyond its clear aperture or its fixed semi-diameter
//! (which the design program treats as a floating aperture) if a refractive index changes there or it is curved; on dummy planes a semi-diameter is only drawn.
//! Vignetting factors describe how much of the pupil the semi-diameters leave open, so where a file has factors and no aperture, its
//! semi-diameters become apertures. A curved image surface is replaced by the plane through its vertex.

use super::error::DesignError;
use super::glass::Glass;
use super::surface::Shape;
use super::system::{Aperture, FieldKind, Medium, RayAiming, Surface, System};

/// Object distances from here on count as infinite, mm.
const INFINITE_MM: f64 = 1e9;

/// Semi-diameters that stand for vignetting factors are enlarged by this share, so that rounding does not clip the axial beam.
const VIGNETTING_SLACK: f64 = 1e-6;

/// A surface, and the gap behind it.
#[derive(Clone, Debug, Default)]
pub(super) struct DraftSurface {
    pub(super) shape: Shape,
    /// Distance to the next surface, mm; may be infinite.
    pub(super) thickness_mm: f64,
    /// Glass behind it; none is air.
    pub(super) glass: Option<Glass>,
    /// Clear aperture, mm.
    pub(super) clear_mm: Option<f64>,
    /// Semi-diameter as drawn, mm; 0 if unknown.
    pub(super) semi_diameter_mm: f64,
    /// Whether the semi-diameter was fixed by the designer.
    pub(super) is_fixed: bool,
}

/// A prescription.
#[derive(Clone, Debug, Default)]
pub(super) struct Draft {
    pub(super) name: String,
    pub(super) surfaces: Vec<DraftSurface>,
    /// Surface number of the stop.
    pub(super) stop: Option<usize>,
    pub(super) aperture: Option<Aperture>,
    pub(super) field_kind: Option<FieldKind>,
    /// In degrees or mm.
    pub(super) fields: Vec<f64>,
    pub(super) wavelengths_um: Vec<(f64, f64)>,
    /// Index of the primary wavelength.
    pub(super) primary: usize,
    pub(super) aiming: Option<RayAiming>,
    pub(super) has_vignetting_factors: bool,
    pub(super) notes: Vec<String>,
}

fn incomplete(problem: impl Into<String>) -> DesignError {
    DesignError::Incomplete { problem: problem.into() }
}

impl Draft {
    /// The system in front of a flat film.
    ///
    /// # Errors
    /// [`DesignError::Incomplete`] names what is missing or not supported.
    pub(super) fn finish(mut self) -> Result<System, DesignError> {
        let last = self.surfaces.len().saturating_sub(1);
        if last < 2 {
            return Err(incomplete("has fewer than three surfaces (object, one more, image)"));
        }
        let stop = match self.stop {
            Some(stop) if (1..last).contains(&stop) => stop,
            Some(stop) => {
                return Err(incomplete(format!("has its stop at surface {stop}, the object or the image")));
            }
            None => return Err(incomplete("has no aperture stop among its inner surfaces")),
        };
        let object = &self.surfaces[0];
        if object.glass.is_some() {
            return Err(incomplete("has its object inside glass"));
        }
        let object_distance_mm = (object.thickness_mm.abs() < INFINITE_MM).then_some(object.thickness_mm);
        let aperture = match self
            .aperture
            .ok_or_else(|| incomplete("has no aperture (pupil, F-number, NA or stop radius)"))?
        {
            Aperture::StopRadius(_) if self.surfaces[stop].semi_diameter_mm <= 0.0 => {
                return Err(incomplete(format!(
                    "has the size of its stop as aperture, and its stop, surface {stop}, has no semi-diameter"
                )));
            }
            Aperture::StopRadius(_) => Aperture::StopRadius(self.surfaces[stop].semi_diameter_mm),
            other => other,
        };
        let mut surfaces = Vec::with_capacity(last);
        for (i, pair) in self.surfaces.windows(2).enumerate() {
            let (before, draft) = (&pair[0], &pair[1]);
            surfaces.push(surface(i + 1, before.glass.as_ref(), draft, i + 1 == last)?);
        }
        flatten_image(&mut surfaces, &mut self.notes);
        if self.has_vignetting_factors {
            apertures_for_vignetting(&mut surfaces, &mut self.notes);
        }
        let aiming = self.aiming.unwrap_or(RayAiming::Paraxial);
        let system = System {
            name: self.name,
            object_distance_mm,
            surfaces,
            stop: stop - 1,
            aperture,
            field_kind: self.field_kind.unwrap_or(FieldKind::Angle),
            fields: if self.fields.is_empty() { vec![0.0] } else { self.fields },
            wavelengths_um: self.wavelengths_um,
            primary: self.primary,
            aiming,
            notes: self.notes,
        };
        system.check()?;
        Ok(system)
    }
}

/// Surface `number` behind the medium `before`.
fn surface(
    number: usize,
    before: Option<&Glass>,
    draft: &DraftSurface,
    is_image: bool,
) -> Result<Surface, DesignError> {
    if !is_image && !draft.thickness_mm.is_finite() {
        return Err(incomplete(format!("has an infinite gap behind surface {number}")));
    }
    let bends = !draft.shape.is_flat() || draft.glass.as_ref() != before;
    let fixed = (draft.is_fixed && bends && draft.semi_diameter_mm > 0.0).then_some(draft.semi_diameter_mm);
    Ok(Surface {
        shape: draft.shape.clone(),
        thickness_mm: if is_image { 0.0 } else { draft.thickness_mm },
        medium: draft.glass.clone().map_or(Medium::Air, Medium::Glass),
        aperture_mm: draft.clear_mm.or(fixed).filter(|_| !is_image),
        semi_diameter_mm: draft.semi_diameter_mm,
    })
}

fn flatten_image(surfaces: &mut [Surface], notes: &mut Vec<String>) {
    let Some(image) = surfaces.last_mut().filter(|s| !s.shape.is_flat()) else { return };
    let radius = 1.0 / image.shape.paraxial_curvature();
    image.shape = Shape::default();
    notes.push(format!(
        "the design's image surface is curved (radius {radius:.4} mm); the film is the plane through its vertex"
    ));
}

fn apertures_for_vignetting(surfaces: &mut [Surface], notes: &mut Vec<String>) {
    if surfaces.iter().any(|s| s.aperture_mm.is_some()) {
        notes.push("vignetting factors are not used: the design's apertures are traced".to_owned());
        return;
    }
    if surfaces.iter().all(|s| s.semi_diameter_mm <= 0.0) {
        notes.push(
            "vignetting factors are not used, and the design has no apertures: nothing is vignetted"
                .to_owned(),
        );
        return;
    }
    for surface in surfaces.iter_mut().rev().skip(1).filter(|s| s.semi_diameter_mm > 0.0) {
        surface.aperture_mm = Some(surface.semi_diameter_mm * (1.0 + VIGNETTING_SLACK));
    }
    notes.push("vignetting factors are represented by the design's semi-diameters as apertures".to_owned());
}
