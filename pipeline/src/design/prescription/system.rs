//! A prescription: surfaces along the axis, stop, aperture, fields, wavelengths.
//!
//! Lengths in mm, wavelengths in µm. The object lies in air at `object_distance_mm` before surface 0 (`None` = infinity);
//! `surfaces` are from the first surface to the image plane, which is the last and flat; it may lie in a glass (a sensor behind cement). Each surface has the distance to the
//! next one and the medium in between. Rotationally symmetric; what a design without symmetry has beside that: [`super::asymmetry`].
//!
//! z counts along the light: behind an odd number of mirrors it runs against the z of the design file, so that thicknesses are positive
//! and curvatures have the sign that the light sees. [`System::axis`] gives the places in the z of the first surface.

use super::asymmetry::Asymmetry;
use super::coating::Coating;
use super::error::DesignError;
use super::glass::Glass;
use super::shape::Shape;

/// The medium behind a surface.
#[derive(Clone, Debug, PartialEq)]
pub enum Medium {
    /// Air, of index 1: glass catalogues are relative to air.
    Air,
    /// A glass.
    Glass(Glass),
}

impl Medium {
    /// Index at `um`.
    ///
    /// # Errors
    /// [`DesignError::Wavelength`] outside the glass's range.
    pub fn index(&self, um: f64) -> Result<f64, DesignError> {
        match self {
            Self::Air => Ok(1.0),
            Self::Glass(glass) => glass.index(um),
        }
    }
}

/// A surface with the gap and the medium behind it.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    /// Its shape.
    pub shape: Shape,
    /// Distance to the next surface, mm.
    pub thickness_mm: f64,
    /// Medium behind it.
    pub medium: Medium,
    /// Focal length of an ideal thin lens, mm, if the surface is one; its shape is then flat.
    pub ideal_focal_mm: Option<f64>,
    /// Whether it reflects; the medium behind it is then that in front of it.
    pub is_mirror: bool,
    /// Radius of the aperture, mm; `None` = unlimited.
    pub aperture_mm: Option<f64>,
    /// Radius within which it blocks light, mm: a central obscuration, or the hole of a mirror.
    pub obscuration_mm: Option<f64>,
    /// Clear radius for drawings, mm (0 = unknown); does not clip rays.
    pub semi_diameter_mm: f64,
    /// Name of the coating in the design.
    pub coating_name: Option<String>,
    /// Coating that light is followed through; `None` = all light passes.
    pub coating: Option<Coating>,
}

impl Surface {
    /// A surface without aperture.
    pub fn new(curvature: f64, thickness_mm: f64, medium: Medium) -> Self {
        let shape = Shape { curvature, ..Shape::default() };
        Self {
            shape,
            thickness_mm,
            medium,
            ideal_focal_mm: None,
            is_mirror: false,
            aperture_mm: None,
            obscuration_mm: None,
            semi_diameter_mm: 0.0,
            coating_name: None,
            coating: None,
        }
    }

    /// Slope of a paraxial ray of height and slope (y, u) behind the surface, between indices n and n'.
    pub(in crate::design) fn slope_behind(&self, (y, u): (f64, f64), (n, next): (f64, f64)) -> f64 {
        match self.ideal_focal_mm {
            Some(f) => (n * u - y / f) / next,
            None if self.is_mirror => u + 2.0 * y * self.shape.paraxial_curvature(),
            None => (n * u - y * self.shape.paraxial_curvature() * (next - n)) / next,
        }
    }
}

/// System aperture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Aperture {
    /// Entrance pupil diameter, mm.
    EntrancePupil(f64),
    /// Image-space F-number: focal length over entrance pupil diameter.
    ImageFNumber(f64),
    /// Paraxial working F-number 1/(2 tan u') at this conjugate.
    WorkingFNumber(f64),
    /// Object-space numerical aperture; finite objects only.
    ObjectNa(f64),
    /// Radius of the stop, mm.
    StopRadius(f64),
}

/// Kind of the field values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FieldKind {
    /// Angle at the entrance pupil, degrees.
    Angle,
    /// Object height, mm.
    ObjectHeight,
    /// Height in the paraxial image plane (not that of the film) at the primary wavelength, mm.
    ParaxialImageHeight,
    /// Real height of the chief ray of the primary wavelength in the image plane, mm.
    RealImageHeight,
}

/// Ray aiming.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RayAiming {
    /// At the paraxial entrance pupil of the primary wavelength (the design program's "ray aiming off").
    Paraxial,
    /// At points of the stop.
    Real,
}

/// Position of the film.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ImagePlane {
    /// As in the design.
    AsDesigned,
    /// At the paraxial focus of this wavelength, µm.
    Paraxial(f64),
    /// At the minimum RMS radius of the axial spot of this wavelength, µm.
    BestRmsSpot(f64),
    /// At the maximum axial Strehl ratio of this wavelength, µm.
    BestStrehl(f64),
}

/// A prescription.
#[derive(Clone, Debug, PartialEq)]
pub struct System {
    /// Name.
    pub name: String,
    /// Object distance before surface 0, mm; `None` = infinity.
    pub object_distance_mm: Option<f64>,
    /// Whether the chief rays of all object points are parallel to the axis, wherever the stop is.
    pub is_telecentric: bool,
    /// Surfaces, the last is the image plane.
    pub surfaces: Vec<Surface>,
    /// Index of the stop.
    pub stop: usize,
    /// System aperture.
    pub aperture: Aperture,
    /// Kind of `fields`.
    pub field_kind: FieldKind,
    /// Radial field points of the design.
    pub fields: Vec<f64>,
    /// Wavelengths in µm with their weights.
    pub wavelengths_um: Vec<(f64, f64)>,
    /// Index of the primary wavelength.
    pub primary: usize,
    /// Ray aiming.
    pub aiming: RayAiming,
    /// Notes of the reader for the user.
    pub notes: Vec<String>,
    /// Poses and shapes of the surfaces of a design without rotational symmetry, whose `surfaces` are then its straightened lens; `None` = rotationally
    /// symmetric.
    pub asymmetry: Option<Asymmetry>,
}

impl System {
    /// The straightened lens of a design without rotational symmetry, else the design itself.
    #[must_use]
    pub fn straightened(&self) -> Self {
        Self { asymmetry: None, ..self.clone() }
    }

    /// Primary wavelength, µm.
    pub fn primary_um(&self) -> f64 {
        self.wavelengths_um[self.primary].0
    }

    /// Index of the image plane among the surfaces.
    pub fn image(&self) -> usize {
        self.surfaces.len() - 1
    }

    /// Position of each surface's vertex along z of the first surface, mm, and whether light arrives there along +z (1) or −z (−1).
    pub fn axis(&self) -> Vec<(f64, f64)> {
        let (mut z, mut direction) = (0.0, 1.0);
        let mut axis = Vec::with_capacity(self.surfaces.len());
        for s in &self.surfaces {
            axis.push((z, direction));
            direction = if s.is_mirror { -direction } else { direction };
            z += direction * s.thickness_mm;
        }
        axis
    }

    /// First surfaces of the plane-parallel plates of glass between the lens and the image plane: cover glass, filters.
    pub fn image_plates(&self) -> Vec<usize> {
        let has_power = |s: &Surface| !s.shape.is_flat() || s.is_mirror || s.ideal_focal_mm.is_some();
        let behind = self.surfaces.iter().rposition(has_power).map_or(0, |last| last + 1);
        (behind..self.image()).filter(|i| matches!(self.surfaces[*i].medium, Medium::Glass(_))).collect()
    }

    /// Checks the assumptions of the tracer.
    ///
    /// # Errors
    /// [`DesignError::Incomplete`] with what is missing or impossible.
    pub fn check(&self) -> Result<(), DesignError> {
        let no = |problem: &str| Err(DesignError::Incomplete { problem: problem.to_owned() });
        if self.surfaces.len() < 2 {
            return no("has no surface before the image plane");
        }
        if self.stop >= self.image() {
            return no("has no aperture stop before the image plane");
        }
        if self.wavelengths_um.is_empty() {
            return no("has no wavelengths");
        }
        if self.wavelengths_um.get(self.primary).is_none() {
            return no("has no primary wavelength");
        }
        if self.wavelengths_um.iter().any(|(um, w)| !(um.is_finite() && *um > 0.0 && w.is_finite())) {
            return no("has a wavelength that is not a positive number of µm");
        }
        if self.object_distance_mm.is_some_and(|d| !(d.is_finite() && d > 0.0)) {
            return no("has an object that is not before the lens");
        }
        if self.is_telecentric {
            self.check_telecentric()?;
        }
        if let Some(problem) = self.asymmetry.as_ref().and_then(|a| a.problem(self.surfaces.len())) {
            return no(problem);
        }
        let image = &self.surfaces[self.image()];
        if !image.shape.is_flat() {
            return no("has a curved image surface; a film is flat");
        }
        for s in &self.surfaces {
            let numbers = [s.shape.curvature, s.shape.conic, s.thickness_mm, s.semi_diameter_mm];
            if numbers.iter().chain(&s.shape.aspheric).any(|v| !v.is_finite()) {
                return no("has a surface with a number that is not finite");
            }
            let is_lens = |f: f64| f.is_finite() && f != 0.0 && !s.is_mirror && s.shape.is_flat();
            if s.ideal_focal_mm.is_some_and(|f| !is_lens(f)) {
                return no("has an ideal lens that is not flat or whose focal length is zero or not finite");
            }
            if [s.aperture_mm, s.obscuration_mm].iter().flatten().any(|a| !(a.is_finite() && *a > 0.0)) {
                return no("has a surface whose aperture or obscuration is not a positive radius");
            }
            if let (Some(aperture), Some(hidden)) = (s.aperture_mm, s.obscuration_mm)
                && hidden >= aperture
            {
                return no("has a surface whose obscuration is as large as its aperture");
            }
        }
        let (Aperture::EntrancePupil(v)
        | Aperture::ImageFNumber(v)
        | Aperture::WorkingFNumber(v)
        | Aperture::ObjectNa(v)
        | Aperture::StopRadius(v)) = self.aperture;
        if !(v.is_finite() && v > 0.0) {
            return no("has an aperture that is not a positive number");
        }
        if matches!(self.aperture, Aperture::ObjectNa(na) if na >= 1.0 || self.object_distance_mm.is_none()) {
            return no("gives an object-space NA that its object distance does not allow");
        }
        Ok(())
    }

    fn check_telecentric(&self) -> Result<(), DesignError> {
        let no = |problem: &str| Err(DesignError::Incomplete { problem: problem.to_owned() });
        if self.object_distance_mm.is_none() {
            return no("has a telecentric object space and an object at infinity");
        }
        if matches!(self.aperture, Aperture::EntrancePupil(_) | Aperture::ImageFNumber(_)) {
            return no(
                "has a telecentric object space, whose aperture is an object-space NA, a working F-number or the radius of the stop",
            );
        }
        if self.field_kind == FieldKind::Angle && self.fields.iter().any(|f| *f != 0.0) {
            return no("has a telecentric object space, whose field points are heights, not angles");
        }
        if self.aiming == RayAiming::Real {
            return no(
                "has a telecentric object space, whose rays are not aimed at the stop: use `--aiming paraxial`",
            );
        }
        Ok(())
    }
}
