//! System data of a lens at the primary wavelength.
//!
//! First-order figures are those of [`crate::design::paraxial`]. Names that lens design programs print mean what they mean there: *image space
//! NA* is n sin u' of the paraxial marginal ray, *paraxial image height* f tan θ (object height × magnification) in the paraxial image
//! plane, *working F-number* 1/(2 sin u') of the real marginal ray. Own figures: *numerical aperture of real rays*, from the projected
//! solid angle Ω = π NA²; *paraxial height on the film*, of the chief ray in the actual film plane. Lengths
//! in mm; positions from the first surface, exit pupil from the image plane.

use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::{FieldKind, System};
use crate::design::pupil::illumination::numerical_aperture;
use crate::design::rays::paraxial::Paraxial;
use crate::design::rays::ray::Tracer;
use crate::real;

/// System data of a design.
#[derive(Clone, Debug, PartialEq)]
pub struct Description {
    /// Name in the design.
    pub name: String,
    /// Primary wavelength, nm.
    pub primary_wavelength_nm: f64,
    /// Effective focal length.
    pub effective_focal_length_mm: f64,
    /// Slope of the paraxial chief ray in the image plane.
    pub distortion_focal_length_mm: f64,
    /// Last surface to paraxial focus of an object at infinity.
    pub back_focal_length_mm: f64,
    /// First surface to image plane.
    pub total_track_mm: f64,
    /// Image plane to paraxial focus at this conjugate.
    pub paraxial_focus_mm: f64,
    /// Focal length over entrance pupil diameter; 0 in a telecentric object space.
    pub image_space_f_number: f64,
    /// 1/(2 tan u') of the paraxial marginal ray.
    pub paraxial_working_f_number: f64,
    /// 1/(2 NA), real rays.
    pub working_f_number: f64,
    /// sin u' of the paraxial marginal ray at this conjugate.
    pub image_space_na: f64,
    /// Image-space numerical aperture of real rays on the axis.
    pub real_na: f64,
    /// Entrance pupil position; infinite in a telecentric object space, as is the diameter.
    pub entrance_pupil_position_mm: f64,
    /// Entrance pupil diameter.
    pub entrance_pupil_diameter_mm: f64,
    /// Exit pupil position, from the image plane.
    pub exit_pupil_position_mm: f64,
    /// Exit pupil diameter.
    pub exit_pupil_diameter_mm: f64,
    /// Paraxial radius of the stop.
    pub stop_radius_mm: f64,
    /// Height of the outermost field point in the paraxial image plane.
    pub paraxial_image_height_mm: f64,
    /// Height of the paraxial chief ray of the outermost field point in the film plane.
    pub paraxial_film_height_mm: f64,
    /// Angle of the outermost field point at the entrance pupil, degrees.
    pub maximum_field_deg: f64,
    /// Image-side over object-side slope of the paraxial chief ray.
    pub angular_magnification: f64,
    /// Paraxial transverse magnification, 0 for an object at infinity.
    pub magnification: f64,
    /// Object distance before the first surface; `None` = infinity.
    pub object_distance_mm: Option<f64>,
}

/// System data of `system`.
///
/// # Errors
/// No first-order properties, a wavelength outside a glass's range, or an axial ray that does not reach the image.
pub fn describe(system: &System) -> Result<Description, DesignError> {
    let p = Paraxial::new(system, system.primary_um())?;
    let na = numerical_aperture(&Tracer::new(system, system.primary_um())?)?;
    let tan = system.fields.iter().map(|f| field_tan(system, &p, *f).abs()).fold(0.0, f64::max);
    Ok(Description {
        name: system.name.clone(),
        primary_wavelength_nm: system.primary_um() * 1e3,
        effective_focal_length_mm: p.effective_focal_length_mm,
        distortion_focal_length_mm: p.distortion_focal_length_mm,
        back_focal_length_mm: p.back_focal_length_mm,
        total_track_mm: p.total_track_mm,
        paraxial_focus_mm: p.focus_shift_mm(),
        image_space_f_number: if system.is_telecentric { 0.0 } else { p.image_f_number() },
        paraxial_working_f_number: p.working_f_number(),
        working_f_number: 0.5 / na,
        image_space_na: p.image_index * real::sin(real::atan(p.marginal_slope)),
        real_na: na,
        entrance_pupil_position_mm: if system.is_telecentric { f64::INFINITY } else { p.entrance_pupil_mm },
        entrance_pupil_diameter_mm: match system.is_telecentric {
            true => f64::INFINITY,
            false => 2.0 * p.entrance_radius_mm,
        },
        exit_pupil_position_mm: p.exit_pupil_mm,
        exit_pupil_diameter_mm: 2.0 * p.exit_radius_mm,
        stop_radius_mm: p.stop_radius_mm,
        paraxial_image_height_mm: tan * p.image_scale_mm(system.object_distance_mm),
        paraxial_film_height_mm: tan * p.distortion_focal_length_mm.abs(),
        maximum_field_deg: if system.is_telecentric { 0.0 } else { real::atan(tan).to_degrees() },
        angular_magnification: p.angular_magnification,
        magnification: p.magnification,
        object_distance_mm: system.object_distance_mm,
    })
}

/// Tangent of a field point's angle at the entrance pupil, from the field value of the design.
pub fn field_tan(system: &System, primary: &Paraxial, field: f64) -> f64 {
    match (system.field_kind, system.object_distance_mm) {
        (FieldKind::Angle, _) => real::tan(field.to_radians()),
        (FieldKind::ObjectHeight, Some(distance)) => field / (distance + primary.entrance_pupil_mm),
        // Undefined for an object at infinity; the design program lists 0.
        (FieldKind::ObjectHeight, None) => 0.0,
        (FieldKind::ParaxialImageHeight, distance) => field / primary.image_scale_mm(distance),
        (FieldKind::RealImageHeight, _) => {
            let exact = Tracer::new(system, system.primary_um()).and_then(|t| t.field_of_height(field.abs()));
            exact.unwrap_or(field / primary.distortion_focal_length_mm.abs())
        }
    }
}
