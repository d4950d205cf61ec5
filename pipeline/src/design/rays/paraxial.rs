//! First-order optics: focal lengths, pupils, F-numbers, position of the paraxial image.
//!
//! ```text
//! n' u' = n u − y c (n' − n),   y ← y + t u'      y height [mm], u slope (tan of the angle), c curvature, t gap
//! u' = u + 2 y c                                  mirror; z counts along the light before and behind it
//! n' u' = n u − y/f                               ideal lens
//! ```
//! All paraxial rays are linear combinations of two rays from the first vertex, (y, u) = (1, 0) and (0, 1).
//! *Distortion focal length* = d(chief-ray height in the ACTUAL image plane)/d(tan of the field angle at the entrance pupil):
//! it equals the effective focal length only when the film lies at the paraxial focus of an object at infinity.
//! Heights are positive up, slopes positive upwards along the light. Source: Welford, chapter 3; Kingslake, chapter 3.

use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::{Aperture, System};

/// First-order figures of a system at one wavelength. Positions along z in mm from the first vertex unless noted.
#[derive(Clone, Debug, PartialEq)]
pub struct Paraxial {
    /// Wavelength, µm.
    pub wavelength_um: f64,
    /// Index in front of the film.
    pub image_index: f64,
    /// Effective focal length, for an index of 1 on the side of the film.
    pub effective_focal_length_mm: f64,
    /// From the last surface before the image plane to the paraxial focus for an object at infinity.
    pub back_focal_length_mm: f64,
    /// From the first vertex to the point that is imaged to infinity, along the light: negative before it.
    pub front_focus_mm: f64,
    /// Derivative of the chief ray's height in the actual image plane by its slope at the entrance pupil.
    pub distortion_focal_length_mm: f64,
    /// Entrance pupil, from the first vertex; 0 in a telecentric object space, where the light cone in the plane of the first vertex stands for it.
    pub entrance_pupil_mm: f64,
    /// Entrance pupil radius.
    pub entrance_radius_mm: f64,
    /// Exit pupil, from the image plane (negative: before it; infinite: telecentric).
    pub exit_pupil_mm: f64,
    /// Exit pupil radius (infinite: telecentric).
    pub exit_radius_mm: f64,
    /// Paraxial radius of the marginal ray in the stop.
    pub stop_radius_mm: f64,
    /// Image-side slope of the marginal ray, positive.
    pub marginal_slope: f64,
    /// Height of the marginal ray in the image plane: 0 at the paraxial focus.
    pub marginal_height_mm: f64,
    /// Transverse magnification of the object's paraxial image, 0 for an object at infinity.
    pub magnification: f64,
    /// Image-side over object-side slope of the chief ray; infinite in a telecentric object space.
    pub angular_magnification: f64,
    /// First surface to image plane, along z of the first surface.
    pub total_track_mm: f64,
}

/// Slopes of the marginal ray up to here are those of rounding errors.
const AFOCAL_SLOPE: f64 = 1e-10;

impl Paraxial {
    /// First-order figures at `um`.
    ///
    /// # Errors
    /// [`DesignError::Paraxial`] for a system without power or pupil; [`DesignError::Wavelength`] of a glass.
    pub fn new(system: &System, um: f64) -> Result<Self, DesignError> {
        system.check()?;
        let bad = |what, problem: &str| {
            Err(DesignError::Paraxial { what, wavelength_um: um, problem: problem.to_owned() })
        };
        let mut n = 1.0;
        let (mut y, mut u) = ([1.0, 0.0], [0.0, 1.0]);
        let mut at_stop = y;
        let mut last = y;
        for (i, s) in system.surfaces.iter().enumerate() {
            if i == system.stop {
                at_stop = y;
            }
            if i == system.image() {
                break;
            }
            let next = s.medium.index(um)?;
            for k in 0..2 {
                u[k] = s.slope_behind((y[k], u[k]), (n, next));
            }
            n = next;
            last = y;
            for k in 0..2 {
                y[k] += s.thickness_mm * u[k];
            }
        }
        if at_stop[0] == 0.0 && !system.is_telecentric {
            return bad(
                "entrance pupil",
                "the stop is imaged to infinity on the object side; save the design with a telecentric object space",
            );
        }
        // In a telecentric object space the plane of the first vertex stands for that of the pupil.
        let pupil = if system.is_telecentric { 0.0 } else { at_stop[1] / at_stop[0] };
        // A ray with slope 1 through the pupil's centre, and one parallel to the axis at height 1.
        let central = |v: [f64; 2]| v[1] - pupil * v[0];
        let parallel = system.object_distance_mm.filter(|_| system.is_telecentric);
        let chief = |v: [f64; 2]| parallel.map_or_else(|| central(v), |d| -d * v[0]);
        let power = -n * u[0];
        let efl = 1.0 / power;
        let distance = system.object_distance_mm.map(|d| d + pupil);
        if distance.is_some_and(|d| d <= 0.0) {
            return bad("entrance pupil", "it lies at or before the object");
        }
        // Marginal ray at height 1 in the pupil.
        let slope = distance.map_or(0.0, |d| 1.0 / d);
        let marginal = |v: [f64; 2]| v[0] + slope * central(v);
        let radius = match system.aperture {
            Aperture::EntrancePupil(d) => d / 2.0,
            Aperture::ImageFNumber(f) => efl.abs() / f / 2.0,
            Aperture::WorkingFNumber(f) => 1.0 / (2.0 * f * n * marginal(u).abs()),
            Aperture::ObjectNa(na) => na / (1.0 - na * na).sqrt() * distance.unwrap_or(0.0),
            Aperture::StopRadius(r) if system.is_telecentric => r / marginal(at_stop).abs(),
            Aperture::StopRadius(r) => r / at_stop[0].abs(),
        };
        if !(radius.is_finite() && radius > 0.0) {
            return bad("entrance pupil", "the given aperture has no finite pupil");
        }
        let f = chief(y);
        if f == 0.0 || !f.is_finite() {
            return bad("distortion focal length", "the image plane lies in the exit pupil");
        }
        let exit = -chief(y) / chief(u);
        // Image of the edge of the pupil: of a point, or of a direction.
        let at_exit = |k: usize| y[k] + exit * u[k];
        let (exit_radius, at_stop) = match parallel {
            Some(d) => (at_exit(1) / d, marginal(at_stop)),
            None => (at_exit(0), at_stop[0]),
        };
        Ok(Self {
            wavelength_um: um,
            image_index: n,
            effective_focal_length_mm: efl,
            back_focal_length_mm: -last[0] / u[0],
            front_focus_mm: u[1] / u[0],
            distortion_focal_length_mm: f,
            entrance_pupil_mm: pupil,
            entrance_radius_mm: radius,
            exit_pupil_mm: exit,
            exit_radius_mm: radius * exit_radius.abs(),
            stop_radius_mm: radius * at_stop.abs(),
            marginal_slope: radius * marginal(u).abs(),
            marginal_height_mm: radius * marginal(y),
            magnification: if distance.is_some() { slope / (n * marginal(u)) } else { 0.0 },
            angular_magnification: if system.is_telecentric { f64::INFINITY } else { chief(u) },
            total_track_mm: system.axis()[system.image()].0,
        }
        .with_signed_slope(marginal(u)))
    }

    fn with_signed_slope(self, slope: f64) -> Self {
        // marginal_slope is positive; the sign of the height is that for a ray that converges downwards.
        Self { marginal_height_mm: -slope.signum() * self.marginal_height_mm, ..self }
    }

    /// Checks that light of an object point converges somewhere.
    ///
    /// # Errors
    /// [`DesignError::Paraxial`] for an afocal system.
    pub fn check_image(&self) -> Result<(), DesignError> {
        if self.marginal_slope > AFOCAL_SLOPE {
            return Ok(());
        }
        let problem = "it is afocal: light of an object point leaves it parallel, and no film is in focus";
        Err(DesignError::Paraxial {
            what: "image",
            wavelength_um: self.wavelength_um,
            problem: problem.to_owned(),
        })
    }

    /// Distance of the paraxial focus behind the image plane, mm.
    pub fn focus_shift_mm(&self) -> f64 {
        self.marginal_height_mm / self.marginal_slope
    }

    /// Height in the ACTUAL image plane over object height, by the chief ray; 0 for an object at infinity. Equals `magnification`
    /// if the film is at the paraxial image.
    pub fn film_magnification(&self, object_distance_mm: Option<f64>) -> f64 {
        object_distance_mm.map_or(0.0, |d| -self.distortion_focal_length_mm / (d + self.entrance_pupil_mm))
    }

    /// Height in the PARAXIAL image plane over tan(field angle), positive.
    pub fn image_scale_mm(&self, object_distance_mm: Option<f64>) -> f64 {
        match object_distance_mm {
            None => self.effective_focal_length_mm.abs(),
            Some(d) => (d + self.entrance_pupil_mm) * self.magnification.abs(),
        }
    }

    /// Paraxial working F-number.
    pub fn working_f_number(&self) -> f64 {
        1.0 / (2.0 * self.image_index * self.marginal_slope)
    }

    /// Image-space F-number: focal length over entrance pupil diameter.
    pub fn image_f_number(&self) -> f64 {
        self.effective_focal_length_mm.abs() / (2.0 * self.entrance_radius_mm)
    }
}
