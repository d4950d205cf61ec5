//! Lensfun's models: distortion `ptlens`, lateral colour `poly3`, relative illumination `pa`.
//!
//! ```text
//! q = f·u/R           u = tan θ (rectilinear) or θ (fisheye), R half of the film's smaller side, mm
//! r/R = ρ (a ρ³ + b ρ² + c ρ + 1 − a − b − c),  ρ = s q,  s = 1/(1 − a − b − c)      green, so that dr/dq = 1 on the axis
//! r_c/R = (r/R) (v + c (r/R) + b (r/R)²)       red and blue of the field point whose green is at r
//! R(r) = 1 + k1 x² + k2 x⁴ + k3 x⁶,  x = r over half of the film's diagonal
//! ```
//! With α = a s⁴, β = b s³, γ = c s² the first is r/R = q (1 + γ q + β q² + α q³), which is linear; s is the root of s⁴ − s³ − γ s² − β s − α = 0 next to 1. A corrected picture is the
//! ideal one magnified by s, so that its focal length, which the files call `focal`, is f s; lensfun's real focal length, `focal`·(1 − a − b − c), is f.
//! Radii are those of lensfun 0.3.95 and later, which measure the film between the outer edges of its pixels; 0.3.4 and before measure it between their centres, which
//! changes r by the distortion over the number of pixels.
//! Source: lensfun, libs/lensfun/modifier.cpp ("About coordinate systems in Lensfun"), mod-coord.cpp, mod-subpix.cpp, mod-color.cpp of versions 0.3.4 and 0.3.95.

use super::field_map::{FieldPoint, FieldSource};
use super::target::{Residual, Target, horner};
use super::{CameraModelError, WIDE, check_ascends};
use crate::design::error::DesignError;
use rayon::prelude::*;

/// Projection of the corrected picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Projection {
    /// Radius f tan θ.
    Rectilinear,
    /// Radius f θ.
    Fisheye,
}

/// Field beyond which the corrected picture of a lens is a fisheye's, rad: 60 degrees.
const RECTILINEAR_RAD: f64 = std::f64::consts::FRAC_PI_3;
/// One of so many field points has its relative illumination computed.
const ILLUMINATION_STEP: usize = 20;
/// Steps of Newton's method.
const STEPS: usize = 50;

impl Projection {
    /// That of a field up to `last`.
    pub fn of_field(last: &FieldPoint) -> Self {
        if last.angle_rad <= RECTILINEAR_RAD { Self::Rectilinear } else { Self::Fisheye }
    }

    fn of(self, point: &FieldPoint) -> f64 {
        match self {
            Self::Rectilinear => point.tan,
            Self::Fisheye => point.angle_rad,
        }
    }
}

/// Distortion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PtLens {
    /// What is undistorted.
    pub projection: Projection,
    /// a, b, c.
    pub abc: [f64; 3],
    /// Focal length of the corrected picture over f.
    pub scale: f64,
    half_side_mm: f64,
    /// γ, β, α.
    expanded: [f64; 3],
}

impl PtLens {
    /// The fit on a film whose smaller side is 2·`half_side_mm`.
    ///
    /// # Errors
    /// It does not ascend over the field, or has no s.
    pub fn fit(target: &Target, projection: Projection, half_side_mm: f64) -> Result<Self, CameraModelError> {
        let undetermined = CameraModelError::Undetermined { model: MODEL };
        let per_u = target.focal_mm / half_side_mm;
        let expanded = target.polynomial(
            [2, 3, 4],
            |p| per_u * projection.of(p),
            |p| p.real_mm / half_side_mm - per_u * projection.of(p),
        );
        let expanded = expanded.ok_or_else(|| undetermined.clone())?;
        let scale = scale(expanded).ok_or(undetermined)?;
        let [gamma, beta, alpha] = expanded;
        let abc = [alpha / scale.powi(4), beta / scale.powi(3), gamma / scale.powi(2)];
        let fit = Self { projection, abc, scale, half_side_mm, expanded };
        let fold = target.fold_mm(|p| per_u * projection.of(p), |q| fit.radius(q));
        check_ascends(MODEL, target, fold, WIDE)?;
        Ok(fit)
    }

    /// r/R at q.
    fn radius(&self, q: f64) -> f64 {
        let [gamma, beta, alpha] = self.expanded;
        q * horner(&[1.0, gamma, beta, alpha], q)
    }

    /// REAL image height of a field point by the model, mm.
    pub fn real_mm(&self, target: &Target, point: &FieldPoint) -> f64 {
        self.half_side_mm * self.radius(target.focal_mm / self.half_side_mm * self.projection.of(point))
    }
}

/// s of γ, β, α.
fn scale([gamma, beta, alpha]: [f64; 3]) -> Option<f64> {
    let value = |s: f64| horner(&[-alpha, -beta, -gamma, -1.0, 1.0], s);
    let slope = |s: f64| horner(&[-beta, -2.0 * gamma, -3.0, 4.0], s);
    let mut s = 1.0;
    for _ in 0..STEPS {
        let step = value(s) / slope(s);
        s -= step;
        if step.abs() <= 4.0 * f64::EPSILON * s.abs() {
            return (s > 0.0).then_some(s);
        }
    }
    None
}

/// Lateral colour of a wavelength.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LateralColour {
    /// v, c, b.
    pub vcb: [f64; 3],
    /// Over the film, px.
    pub residual: Residual,
}

/// A fit of lateral colour or illumination that failed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LensfunError {
    /// A ray.
    #[error(transparent)]
    Design(#[from] DesignError),
    /// The fit.
    #[error(transparent)]
    Model(#[from] CameraModelError),
}

impl LateralColour {
    /// The fit of `colour` against the field points of `green`.
    ///
    /// # Errors
    /// A field point that the wavelength does not have.
    pub fn fit(green: &Target, colour: &FieldSource<'_>, half_side_mm: f64) -> Result<Self, LensfunError> {
        let real: Vec<f64> =
            green.points.par_iter().map(|p| colour.real_at(p.tan)).collect::<Result<_, _>>()?;
        // Field points with the REAL height of the other colour in place of their angle.
        let last = green.last().real_mm;
        let row = |i: usize, p: &FieldPoint| {
            let share = p.real_mm / last;
            ([share, share * share, share.powi(3)], real[i] / half_side_mm)
        };
        let found = green.solve(row, 3).ok_or(CameraModelError::Undetermined { model: MODEL })?;
        let vcb = std::array::from_fn(|j| found[j] / (last / half_side_mm).powi(j as i32 + 1));
        let model = |p: &FieldPoint| {
            let r = p.real_mm / half_side_mm;
            half_side_mm * r * horner(&vcb, r)
        };
        let by_height = |p: &FieldPoint| {
            let i = green.points.partition_point(|q| q.real_mm < p.real_mm);
            (model(p) - real[i]) / green.pitch_mm()
        };
        Ok(Self { vcb, residual: green.residual(by_height) })
    }
}

/// Relative illumination.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vignetting {
    /// k1, k2, k3.
    pub k: [f64; 3],
    /// Over the film.
    pub residual: Residual,
}

impl Vignetting {
    /// The fit on a film whose diagonal is 2·`half_diagonal_mm`.
    ///
    /// # Errors
    /// A field point whose light does not reach the film.
    pub fn fit(
        target: &Target,
        source: &FieldSource<'_>,
        half_diagonal_mm: f64,
    ) -> Result<Self, LensfunError> {
        let thin = target.thinned(ILLUMINATION_STEP);
        let light = source.illumination(&thin.points)?;
        let square = |p: &FieldPoint| (p.real_mm / half_diagonal_mm).powi(2);
        let row = |i: usize, p: &FieldPoint| {
            let s = square(p);
            ([s, s * s, s * s * s], light[i] - 1.0)
        };
        let found = thin.solve(row, 3).ok_or(CameraModelError::Undetermined { model: MODEL })?;
        let k = [found[0], found[1], found[2]];
        let difference = |p: &FieldPoint| {
            let i = thin.points.partition_point(|q| q.real_mm < p.real_mm);
            horner(&[1.0, k[0], k[1], k[2]], square(p)) - light[i]
        };
        Ok(Self { k, residual: thin.residual(difference) })
    }
}

const MODEL: &str = "lensfun";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera_model::target::synthetic;
    use crate::lens::LensBand;

    fn near(found: [f64; 3], expected: [f64; 3]) {
        for (f, e) in std::iter::zip(found, expected) {
            assert!((f - e).abs() < 1e-9, "{found:?}, expected {expected:?}");
        }
    }

    #[test]
    fn distortion_is_recovered() {
        let (abc, half, focal) = ([0.008, -0.031, 0.012], 6.0, 25.0);
        let d = 1.0 - abc.iter().sum::<f64>();
        // A corrected picture of focal length f/d.
        let real = |u: f64| {
            let rho = focal / d * u / half;
            half * rho * horner(&[d, abc[2], abc[1], abc[0]], rho)
        };
        for projection in [Projection::Rectilinear, Projection::Fisheye] {
            let target = synthetic(focal, 0.4, |t| {
                real(if projection == Projection::Rectilinear { t } else { t.atan() })
            });
            let fit = PtLens::fit(&target, projection, half).unwrap();
            near(fit.abc, abc);
            assert!((fit.scale - 1.0 / d).abs() < 1e-9);
            assert!(target.residual_px(|p| fit.real_mm(&target, p)).max < 1e-9);
        }
    }

    #[test]
    fn lateral_colour_and_illumination_are_recovered() {
        let real: Vec<f64> = (0..=4000).map(|i| f64::from(i) * 0.003).collect();
        let (vcb, k, half) = ([1.0004, -0.0002, 0.0007], [-0.4, 0.05, 0.02], 6.0);
        let mut red = LensBand::ideal(620.0, real.clone());
        red.ideal_height_mm.clone_from(&real);
        red.image_height_mm = real.iter().map(|r| r * horner(&vcb, r / half)).collect();
        let source = FieldSource::Band { band: &red, distortion_focal_length_mm: 25.0 };
        let green = synthetic(25.0, 0.4, |t| 25.0 * t);
        let fit = LateralColour::fit(&green, &source, half).unwrap();
        for (f, e) in std::iter::zip(fit.vcb, vcb) {
            // The table is linear between steps of 3 µm.
            assert!((f - e).abs() < 1e-7, "{fit:?}");
        }
        assert!(fit.residual.max < 1e-3);
        let mut band = LensBand::ideal(550.0, real.clone());
        band.relative_illumination =
            real.iter().map(|r| horner(&[1.0, k[0], k[1], k[2]], (r / 10.0).powi(2))).collect();
        let source = FieldSource::Band { band: &band, distortion_focal_length_mm: 25.0 };
        let fit = Vignetting::fit(&green, &source, 10.0).unwrap();
        for (f, e) in std::iter::zip(fit.k, k) {
            assert!((f - e).abs() < 1e-6, "{fit:?}");
        }
        assert!(fit.residual.max < 1e-7);
    }

    #[test]
    fn projection_follows_the_field() {
        let at = |degrees: f64| Projection::of_field(&FieldPoint::new(degrees.to_radians().tan(), 1.0));
        assert_eq!((at(59.0), at(61.0)), (Projection::Rectilinear, Projection::Fisheye));
    }
}
