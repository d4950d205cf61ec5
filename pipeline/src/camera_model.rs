//! Camera models of other programs, fitted to the distortion of a lens with rotational symmetry.
//!
//! ```text
//! t = tan θ = h/f_D      θ angle of the field point to the axis at the centre of the entrance pupil, h its IDEAL height, f_D the distortion focal length
//! r                      its REAL image height, mm;  f = dr/dt on the axis at the wavelength of the fit (f_D at the primary one)
//! model                  r = f·m(t) or f·m(θ) with coefficients of m: the direction ideal → real, as these programs distort
//! fit                    min Σ w (f·m − r)²,  w = r·φ(r), φ the angle of the circle of radius r that lies on the film
//! ```
//! w is the area element of the film, so that the sum is the mean over its pixels; f is not fitted, so that a picture that another program corrects is the
//! ideal image plane, on which charts lie. Points lie at equal steps of r up to the corner of the film ([`target`]), whose residual is known there in pixels.
//!
//! | model | m | module |
//! |---|---|---|
//! | OpenCV, COLMAP | polynomial or quotient of polynomials of t | [`opencv`] |
//! | OpenCV fisheye | odd polynomial of θ | [`fisheye`] |
//! | f-theta | polynomial of θ, and one of r | [`ftheta`] |
//! | lensfun | polynomial of r, lateral colour, relative illumination | [`lensfun`] |
//!
//! Left out: decentring (p1 = p2 = 0), field points at 90 degrees and beyond, which tables over f·tan θ do not have, and distances other than
//! that of the tables: the centre of the entrance pupil moves with the field.

pub mod field_map;
pub mod fisheye;
pub mod ftheta;
pub mod lensfun;
pub mod opencv;
pub mod target;

use crate::geometry::Size;
use target::Target;
use thiserror::Error;

/// Film and focal length of a camera model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intrinsics {
    /// Pixels of the film, whose middle is on the axis.
    pub size: Size,
    /// f over the pixel pitch.
    pub focal_px: f64,
}

impl Intrinsics {
    /// (cx, cy) where the centre of the first pixel is at (`first`, `first`).
    pub fn principal_point(&self, first: f64) -> [f64; 2] {
        [self.size.width, self.size.height].map(|n| (n as f64 - 1.0) / 2.0 + first)
    }
}

/// A model that does not describe the lens.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum CameraModelError {
    /// A polynomial that decreases within the field.
    #[error(
        "{model} does not describe this field of {field_deg:.2} degrees: fitted to it, its image height decreases at {at_mm:.4} mm; models over the angle ({wide}) describe wide fields, or give a smaller film"
    )]
    Folds {
        /// The model.
        model: &'static str,
        /// Angle of the outermost field point.
        field_deg: f64,
        /// REAL image height there.
        at_mm: f64,
        /// Models for wide fields.
        wide: &'static str,
    },
    /// Points do not determine the coefficients.
    #[error("{model}: the field points do not determine its coefficients")]
    Undetermined {
        /// The model.
        model: &'static str,
    },
}

/// Fails if the fit of `model` to `target` decreases, which it does at the REAL height `fold_mm`; `wide` are models for wide fields.
fn check_ascends(
    model: &'static str,
    target: &Target,
    fold_mm: Option<f64>,
    wide: &'static str,
) -> Result<(), CameraModelError> {
    let field_deg = target.last().angle_rad.to_degrees();
    let folds = |at_mm| Err(CameraModelError::Folds { model, field_deg, at_mm, wide });
    fold_mm.map_or(Ok(()), folds)
}

/// Models over the angle.
const WIDE: &str = "opencv-fisheye, ftheta";
