//! Chief rays of one wavelength: field angle, REAL image height and relative illumination, of tables or by tracing.

use crate::design::error::DesignError;
use crate::design::illumination::irradiance_sr;
use crate::design::ray::Tracer;
use crate::lens::LensBand;
use crate::real;
use rayon::prelude::*;

/// Where chief rays come from.
pub enum FieldSource<'a> {
    /// Tables of a lens with rotational symmetry, linear between their points.
    Band {
        /// The tables.
        band: &'a LensBand,
        /// Distortion focal length of the lens, mm.
        distortion_focal_length_mm: f64,
    },
    /// Rays of a design.
    Design(Box<Tracer<'a>>),
}

/// A field point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldPoint {
    /// Tangent of the field angle at the centre of the entrance pupil.
    pub tan: f64,
    /// The angle, rad.
    pub angle_rad: f64,
    /// REAL image height, mm.
    pub real_mm: f64,
}

impl FieldPoint {
    /// The field point of a tangent and a REAL image height.
    pub fn new(tan: f64, real_mm: f64) -> Self {
        Self { tan, angle_rad: real::atan(tan), real_mm }
    }
}

impl FieldSource<'_> {
    /// Wavelength, nm.
    pub fn wavelength_nm(&self) -> f64 {
        match self {
            Self::Band { band, .. } => band.wavelength_nm,
            Self::Design(tracer) => tracer.wavelength_um * 1e3,
        }
    }

    /// dr/dt on the axis, mm.
    ///
    /// # Errors
    /// A ray that does not reach the image.
    pub fn focal_mm(&self) -> Result<f64, DesignError> {
        match self {
            Self::Band { band, distortion_focal_length_mm } => {
                Ok(distortion_focal_length_mm / band.scale_on_axis())
            }
            Self::Design(tracer) => Ok(tracer.chief_height_and_slope(0.0)?.1),
        }
    }

    /// Largest REAL image height, mm.
    pub fn last_mm(&self) -> f64 {
        match self {
            Self::Band { band, .. } => band.image_height_mm[band.image_height_mm.len() - 1],
            // Rounding must not ask for a ray beyond the last one.
            Self::Design(tracer) => tracer.farthest_field().0 * (1.0 - 1e-9),
        }
    }

    /// Ideal height over the tangent of the field angle, mm.
    pub fn ideal_scale_mm(&self) -> f64 {
        match self {
            Self::Band { distortion_focal_length_mm, .. } => *distortion_focal_length_mm,
            Self::Design(tracer) => tracer.ideal_scale_mm(),
        }
    }

    /// The field point at a REAL image height.
    ///
    /// # Errors
    /// No chief ray has it.
    pub fn point_at(&self, real_mm: f64) -> Result<FieldPoint, DesignError> {
        let tan = match self {
            Self::Band { band, distortion_focal_length_mm } => {
                band.ideal_height_at(real_mm) / distortion_focal_length_mm
            }
            Self::Design(tracer) => tracer.field_of_height(real_mm)?,
        };
        Ok(FieldPoint::new(tan, real_mm))
    }

    /// REAL image height of the field point at a tangent, mm.
    ///
    /// # Errors
    /// Its chief ray does not reach the image.
    pub fn real_at(&self, tan: f64) -> Result<f64, DesignError> {
        match self {
            Self::Band { band, distortion_focal_length_mm } => {
                Ok(band.real_height_at(tan * distortion_focal_length_mm))
            }
            Self::Design(tracer) => tracer.chief_height_mm(tan),
        }
    }

    /// Relative illumination at field points.
    ///
    /// # Errors
    /// Rays that do not reach the image.
    pub fn illumination(&self, points: &[FieldPoint]) -> Result<Vec<f64>, DesignError> {
        match self {
            Self::Band { band, .. } => Ok(points.iter().map(|p| band.illumination_at(p.real_mm)).collect()),
            Self::Design(tracer) => {
                let axis = irradiance_sr(tracer, 0.0)?;
                points.par_iter().map(|p| Ok(irradiance_sr(tracer, p.tan)? / axis)).collect()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_give_angles_and_the_focal_length_on_the_axis() {
        let real: Vec<f64> = (0..=1000).map(|i| f64::from(i) * 0.01).collect();
        let mut band = LensBand::ideal(550.0, real.clone());
        // r = 49 t of a lens whose ideal heights are 50 t.
        band.ideal_height_mm = real.iter().map(|r| r * 50.0 / 49.0).collect();
        let source = FieldSource::Band { band: &band, distortion_focal_length_mm: 50.0 };
        assert!((source.focal_mm().unwrap() - 49.0).abs() < 1e-12);
        let point = source.point_at(9.8).unwrap();
        assert!((point.tan - 0.2).abs() < 1e-12 && (point.angle_rad - 0.2_f64.atan()).abs() < 1e-12);
        assert!((source.real_at(0.2).unwrap() - 9.8).abs() < 1e-12);
        assert_eq!((source.last_mm(), source.illumination(&[point]).unwrap()), (10.0, vec![1.0]));
    }
}
