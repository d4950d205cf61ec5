//! A prescription as a reader collects it from a design file, and what all file formats have in common when it becomes a [`System`].
//!
//! Surfaces run from the object (0) to the image plane (last). A surface blocks light beyond its clear aperture or its fixed semi-diameter
//! (which the design program treats as a floating aperture) if a refractive index changes there or it is curved; on dummy planes a semi-diameter is only drawn.
//! Vignetting factors describe how much of the pupil the semi-diameters leave open, so where a file has factors, the semi-diameters of its
//! surfaces without aperture become apertures. A curved image surface is replaced by the plane through its vertex.
//! Files count z along the first light: behind an odd number of mirrors their thicknesses are negative. The system counts along the light.

use super::error::LensFileError;
use super::straight_axis::{Break, straighten};
use pipeline::design::glass::Glass;
use pipeline::design::shape::Shape;
use pipeline::design::system::{Aperture, FieldKind, Medium, RayAiming, Surface, System};
use pipeline::real;

/// Object distances from here on count as infinite, mm.
pub const INFINITE_MM: f64 = 1e9;

/// Semi-diameters that stand for vignetting factors are enlarged by this share, so that rounding does not clip the axial beam.
const VIGNETTING_SLACK: f64 = 1e-6;

/// Maximum number of surfaces; readers stop there.
pub(super) const MAX_SURFACES: usize = 1000;

/// Radial field of a point with components along x and y: of angles, which are projected (tan θ_x = L/N), atan √(tan² θ_x + tan² θ_y) in degrees.
pub(super) fn radial_field(kind: Option<FieldKind>, x: f64, y: f64) -> f64 {
    let is_angle = matches!(kind, None | Some(FieldKind::Angle));
    // On a meridian the number of the file, without rounding.
    if !is_angle || x == 0.0 || y == 0.0 {
        return real::hypot(x, y);
    }
    let tan = |degrees: f64| real::tan(degrees.to_radians());
    real::atan(real::hypot(tan(x), tan(y))).to_degrees()
}

/// A surface, and the gap behind it.
#[derive(Clone, Debug, Default)]
pub(super) struct DraftSurface {
    pub(super) shape: Shape,
    /// Distance to the next surface, mm; may be infinite.
    pub(super) thickness_mm: f64,
    /// Glass behind it; none is air. Not used for a mirror and where `keeps_medium`: it is that in front of it.
    pub(super) glass: Option<Glass>,
    /// Whether the medium in front of it continues behind it.
    pub(super) keeps_medium: bool,
    pub(super) is_mirror: bool,
    /// Focal length of an ideal thin lens, mm.
    pub(super) ideal_focal_mm: Option<f64>,
    /// Clear aperture, mm.
    pub(super) clear_mm: Option<f64>,
    /// Radius of a central obscuration, mm.
    pub(super) obscuration_mm: Option<f64>,
    /// Semi-diameter as drawn, mm; 0 if unknown.
    pub(super) semi_diameter_mm: f64,
    /// Name of its coating.
    pub(super) coating_name: Option<String>,
    /// Whether the semi-diameter was fixed by the designer.
    pub(super) is_fixed: bool,
    /// Tilts and decentres of this surface and of those behind it.
    pub(super) coordinate_break: Option<Break>,
    /// Tilts and decentres of the surfaces behind this one, before its thickness.
    pub(super) break_behind: Option<Break>,
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
    pub(super) is_telecentric: bool,
    pub(super) notes: Vec<String>,
}

fn incomplete(problem: impl Into<String>) -> LensFileError {
    LensFileError::Incomplete { problem: problem.into() }
}

impl Draft {
    /// The system in front of a flat film.
    ///
    /// # Errors
    /// [`LensFileError::Incomplete`] names what is missing or not supported.
    pub(super) fn finish(mut self) -> Result<System, LensFileError> {
        let last = self.surfaces.len().saturating_sub(1);
        if last < 2 {
            return Err(incomplete("has fewer than three surfaces (object, one more, image)"));
        }
        if last > MAX_SURFACES {
            return Err(incomplete(format!("has {last} surfaces, the maximum is {MAX_SURFACES}")));
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
        for i in 1..last {
            if self.surfaces[i].is_mirror || self.surfaces[i].keeps_medium {
                self.surfaces[i].glass = self.surfaces[i - 1].glass.clone();
            }
        }
        straighten(&mut self.surfaces, self.stop, &mut self.notes)?;
        let mut surfaces = Vec::with_capacity(last);
        let mut direction = 1.0;
        for (i, pair) in self.surfaces.windows(2).enumerate() {
            let (before, draft) = (&pair[0], &pair[1]);
            surfaces.push(surface(i + 1, before.glass.as_ref(), draft, i + 1 == last, &mut direction)?);
        }
        note_missing_obscuration(&surfaces, &mut self.notes);
        flatten_image(&mut surfaces, &mut self.notes);
        note_virtual_image(&surfaces, &mut self.notes);
        if self.has_vignetting_factors {
            apertures_for_vignetting(&mut surfaces, &mut self.notes);
        }
        let mut aiming = self.aiming.unwrap_or(RayAiming::Paraxial);
        if self.is_telecentric && aiming == RayAiming::Real {
            aiming = RayAiming::Paraxial;
            self.notes.push(
                "the object space is telecentric: chief rays are parallel to the axis, rays are not aimed at the stop"
                    .to_owned(),
            );
        }
        let system = System {
            name: self.name,
            object_distance_mm,
            is_telecentric: self.is_telecentric,
            surfaces,
            stop: stop - 1,
            aperture,
            field_kind: self.field_kind.unwrap_or(FieldKind::Angle),
            fields: if self.fields.is_empty() { vec![0.0] } else { self.fields },
            wavelengths_um: self.wavelengths_um,
            primary: self.primary,
            aiming,
            notes: self.notes,
            asymmetry: None,
        };
        system.check()?;
        Ok(system)
    }
}

/// Surface `number` behind the medium `before`. `direction` is that of the light along z of the file, and is updated by a mirror.
fn surface(
    number: usize,
    before: Option<&Glass>,
    draft: &DraftSurface,
    is_image: bool,
    direction: &mut f64,
) -> Result<Surface, LensFileError> {
    if !is_image && !draft.thickness_mm.is_finite() {
        return Err(incomplete(format!("has an infinite gap behind surface {number}")));
    }
    if is_image && draft.is_mirror {
        return Err(incomplete(format!("has a mirror as its image surface {number}")));
    }
    let bends = draft.is_mirror
        || !draft.shape.is_flat()
        || draft.ideal_focal_mm.is_some()
        || draft.glass.as_ref() != before;
    // The shadow of a mirror is drawn as large as its obscuration, and clips nothing else.
    let inner = draft.obscuration_mm.unwrap_or(0.0);
    let fixed = (draft.is_fixed && bends && draft.semi_diameter_mm > inner).then_some(draft.semi_diameter_mm);
    let shape = if *direction > 0.0 { draft.shape.clone() } else { draft.shape.reversed() };
    if draft.is_mirror {
        *direction = -*direction;
    }
    Ok(Surface {
        shape,
        thickness_mm: if is_image || draft.thickness_mm == 0.0 {
            0.0
        } else {
            *direction * draft.thickness_mm
        },
        medium: draft.glass.clone().map_or(Medium::Air, Medium::Glass),
        ideal_focal_mm: draft.ideal_focal_mm,
        is_mirror: draft.is_mirror,
        aperture_mm: draft.clear_mm.or(fixed).filter(|_| !is_image),
        obscuration_mm: draft.obscuration_mm.filter(|r| !is_image && *r > 0.0),
        semi_diameter_mm: draft.semi_diameter_mm,
        coating_name: draft.coating_name.clone(),
        coating: None,
    })
}

fn note_virtual_image(surfaces: &[Surface], notes: &mut Vec<String>) {
    let bends = |i: &usize| {
        surfaces[*i].is_mirror || surfaces[*i].ideal_focal_mm.is_some() || !surfaces[*i].shape.is_flat()
    };
    let Some(last) = (0..surfaces.len() - 1).rev().find(bends) else { return };
    let gap: f64 = surfaces[last..].iter().map(|s| s.thickness_mm).sum();
    if gap < 0.0 {
        let before = -gap;
        notes.push(format!(
            "the film lies {before:.4} mm before the last curved surface: rays are traced backwards to a virtual image"
        ));
    }
}

fn note_missing_obscuration(surfaces: &[Surface], notes: &mut Vec<String>) {
    let mirrors = surfaces.iter().filter(|s| s.is_mirror && !s.shape.is_flat()).count();
    if mirrors > 1 && surfaces.iter().all(|s| s.obscuration_mm.is_none()) {
        notes.push(
            "the design has mirrors and no central obscuration: the light that they block is not subtracted"
                .to_owned(),
        );
    }
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
    let has_apertures = surfaces.iter().any(|s| s.aperture_mm.is_some());
    if surfaces.iter().all(|s| s.semi_diameter_mm <= 0.0) {
        notes.push(match has_apertures {
            true => "vignetting factors are not used: the design's apertures are traced".to_owned(),
            false => "vignetting factors are not used, and the design has no apertures: nothing is vignetted"
                .to_owned(),
        });
        return;
    }
    for surface in surfaces.iter_mut().rev().skip(1) {
        let is_open = surface.semi_diameter_mm > surface.obscuration_mm.unwrap_or(0.0);
        if is_open && surface.aperture_mm.is_none() {
            surface.aperture_mm = Some(surface.semi_diameter_mm * (1.0 + VIGNETTING_SLACK));
        }
    }
    let which = if has_apertures { " of surfaces without aperture" } else { "" };
    notes.push(format!(
        "vignetting factors are represented by the design's semi-diameters{which} as apertures"
    ));
}
