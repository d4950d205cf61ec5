//! A prescription as a reader collects it from a design file, and what all file formats have in common when it becomes a [`System`].
//!
//! Surfaces run from the object (0) to the image plane (last). A surface blocks light beyond its clear aperture or its fixed semi-diameter
//! (which the design program treats as a floating aperture) if a refractive index changes there or it is curved; on dummy planes a semi-diameter is only drawn.
//! Vignetting factors describe how much of the pupil the semi-diameters leave open, so where a file has factors, the semi-diameters of its
//! surfaces without aperture become apertures. A curved image surface is replaced by the plane through its vertex.
//! A design with surfaces off one axis, with shapes or with decentred apertures that are not rotationally symmetric has its true surfaces beside
//! its straightened lens (module `asymmetric`).
//! Files count z along the first light: behind an odd number of mirrors their thicknesses are negative. The system counts along the light.

use super::asymmetric::{CIRCLE_INSIDE, Place, free_surface, places, reason};
use super::error::LensFileError;
use super::freeform::FreeShape;
use super::straight_axis::{Break, straighten};
use pipeline::design::glass::Glass;
use pipeline::design::prescription::asymmetry::{Asymmetry, FreeSurface, Outline};
use pipeline::design::prescription::pose::Pose;
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
    /// Of a surface without rotational symmetry its profile along y.
    pub(super) shape: Shape,
    /// Its shape if that has no rotational symmetry.
    pub(super) free: Option<FreeShape>,
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
    /// A clear aperture that is not a disc about the vertex; `clear_mm` is then the circle inside it, if that is about the vertex.
    pub(super) outline: Option<Outline>,
    /// An obscuration that is not a disc about the vertex.
    pub(super) hidden: Option<Outline>,
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
    /// Its place in the lens frame where the file gives the places of all surfaces, which have no thicknesses then.
    pub(super) place: Option<Pose>,
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
        let (surfaces, asymmetry) = self.trace_surfaces()?;
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
            asymmetry,
        };
        system.check()?;
        Ok(system)
    }

    /// The surfaces, straightened, and the true ones if they are not on one axis or not rotationally symmetric.
    fn trace_surfaces(&mut self) -> Result<(Vec<Surface>, Option<Asymmetry>), LensFileError> {
        let (mut straight, mut notes) = (self.surfaces.clone(), Vec::new());
        let is_straight = straighten(&mut straight, self.stop, &mut notes);
        if let Some(reason) = reason(&self.surfaces, is_straight) {
            let (surfaces, free) = self.asymmetric_surfaces(reason)?;
            return Ok((surfaces, Some(Asymmetry { surfaces: free })));
        }
        self.notes.append(&mut notes);
        let last = straight.len() - 1;
        let mut surfaces = Vec::with_capacity(last);
        let mut direction = 1.0;
        for (i, pair) in straight.windows(2).enumerate() {
            let (before, draft) = (&pair[0], &pair[1]);
            let is_reversed = direction < 0.0;
            if draft.is_mirror {
                direction = -direction;
            }
            let gap_mm = if draft.thickness_mm == 0.0 { 0.0 } else { direction * draft.thickness_mm };
            surfaces.push(surface(
                i + 1,
                before.glass.as_ref(),
                draft,
                i + 1 == last,
                (is_reversed, gap_mm),
            )?);
        }
        note_missing_obscuration(&surfaces, &mut self.notes);
        flatten_image(&mut surfaces, &mut self.notes);
        note_virtual_image(&surfaces, &mut self.notes);
        if self.has_vignetting_factors {
            apertures_for_vignetting(&mut surfaces, &mut self.notes);
        }
        Ok((surfaces, None))
    }

    /// The straightened surfaces and the true ones of a design without rotational symmetry.
    fn asymmetric_surfaces(
        &mut self,
        reason: String,
    ) -> Result<(Vec<Surface>, Vec<FreeSurface>), LensFileError> {
        self.notes.retain(|note| !note.contains(CIRCLE_INSIDE));
        self.notes.push(format!(
            "{reason}: the design has no rotational symmetry; it is traced over the film's area"
        ));
        let last = self.surfaces.len() - 1;
        let (mut surfaces, mut free) = (Vec::with_capacity(last), Vec::with_capacity(last));
        for (i, (pair, place)) in self.surfaces.windows(2).zip(places(&self.surfaces)).enumerate() {
            let (number, before, draft) = (i + 1, pair[0].glass.as_ref(), &pair[1]);
            let Place { is_reversed, gap_mm, .. } = place;
            surfaces.push(surface(number, before, draft, number == last, (is_reversed, gap_mm))?);
            let is_frame = draft.is_frame(before) && self.stop != Some(number) && number != last;
            let fixed_mm = draft.fixed_mm(before).filter(|_| number != last && !is_frame);
            free.push(free_surface(draft, &place, (number == last, is_frame), fixed_mm));
        }
        if let Some(image) = self.surfaces[last].free.as_ref().filter(|_| surfaces[last - 1].shape.is_flat())
        {
            self.notes.push(format!(
                "the design's image surface is {}; the film is the plane through its vertex",
                image.what
            ));
        }
        flatten_image(&mut surfaces, &mut self.notes);
        if self.has_vignetting_factors {
            self.notes.push(
                "vignetting factors are not used in a design without rotational symmetry: its apertures are traced".to_owned(),
            );
        }
        Ok((surfaces, free))
    }
}

impl DraftSurface {
    /// Whether it changes the direction of light behind the medium `before`.
    fn bends(&self, before: Option<&Glass>) -> bool {
        self.is_mirror
            || !self.shape.is_flat()
            || self.free.is_some()
            || self.ideal_focal_mm.is_some()
            || self.glass.as_ref() != before
    }

    /// Its semi-diameter where that clips light behind the medium `before`.
    fn fixed_mm(&self, before: Option<&Glass>) -> Option<f64> {
        // The shadow of a mirror is drawn as large as its obscuration, and clips nothing else.
        let inner = self.obscuration_mm.unwrap_or(0.0);
        let clips = self.is_fixed && self.bends(before) && self.semi_diameter_mm > inner;
        clips.then_some(self.semi_diameter_mm)
    }

    /// Whether it only changes the frame of the surfaces behind it.
    fn is_frame(&self, before: Option<&Glass>) -> bool {
        let clips = self.clear_mm.is_some() || self.obscuration_mm.is_some();
        let has_break = self.coordinate_break.is_some() || self.break_behind.is_some();
        has_break && !self.bends(before) && !clips && self.outline.is_none() && self.hidden.is_none()
    }
}

/// Surface `number` behind the medium `before`. `along_light`: whether the light arrives against z of the file, and the gap behind it along the light, mm.
fn surface(
    number: usize,
    before: Option<&Glass>,
    draft: &DraftSurface,
    is_image: bool,
    (is_reversed, gap_mm): (bool, f64),
) -> Result<Surface, LensFileError> {
    if !is_image && !draft.thickness_mm.is_finite() {
        return Err(incomplete(format!("has an infinite gap behind surface {number}")));
    }
    if is_image && draft.is_mirror {
        return Err(incomplete(format!("has a mirror as its image surface {number}")));
    }
    let fixed = draft.fixed_mm(before);
    Ok(Surface {
        shape: if is_reversed { draft.shape.reversed() } else { draft.shape.clone() },
        thickness_mm: if is_image { 0.0 } else { gap_mm },
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
