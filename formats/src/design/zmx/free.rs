//! Surfaces of a .zmx file without rotational symmetry.
//!
//! | type | parameters | extra data |
//! |---|---|---|
//! | BICONICX | 1 radius along x (0: a plane), 2 conic constant along x; those along y are CURV and CONI | |
//! | TOROIDAL | 1 radius R of the rotation about an axis along y (0: a cylinder), 2-8 coefficients of y², y⁴, … | Zernike standard terms |
//! | POLYNOMI | 1-4 coefficients of x², x⁴, x⁶, x⁸, 5-8 of y², … | |
//! | XPOLYNOM | | extended polynomial, on a conic |
//! | SZERNSAG, FZERNSAG | 1-8 coefficients of r², r⁴, …, on a conic | Zernike standard or fringe terms |
//! | TILTSURF | 1, 2 tangents: z = x p₁ + y p₂ | |
//!
//! Extra data are their number, the norm radius and the terms, in lens units; some files have them as parameters from 13. The terms hold
//! beyond the norm radius too (parameter 0, which tells the design program whether they do, is not used). Source: OpticStudio, help of these surface types; scaling of their
//! parameters with the lens unit in PyZDDE.

use crate::design::draft::DraftSurface;
use crate::design::freeform::{MAX_XY, MAX_ZERNIKE, Zernike, give, xy_series};
use pipeline::design::prescription::freeform::{AlongY, SkewShape, XyTerm};
use pipeline::design::shape::Shape;

/// Parameter number of the first of the extra data, in files that have them as parameters.
const FIRST_EXTRA: usize = 13;
/// Maximum number of terms that extra data declare; those behind the last that is not 0 are not counted further.
const MAX_DECLARED: f64 = 1e3;

/// Surface types.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Free {
    Biconic,
    Toroid,
    Polynomial,
    ExtendedPolynomial,
    ZernikeStandard,
    ZernikeFringe,
    Tilted,
}

impl Free {
    /// That of a name in the file.
    pub(super) fn of(name: &str) -> Option<Self> {
        match name {
            "BICONICX" => Some(Self::Biconic),
            "TOROIDAL" => Some(Self::Toroid),
            "POLYNOMI" => Some(Self::Polynomial),
            "XPOLYNOM" => Some(Self::ExtendedPolynomial),
            "SZERNSAG" => Some(Self::ZernikeStandard),
            "FZERNSAG" => Some(Self::ZernikeFringe),
            "TILTSURF" => Some(Self::Tilted),
            _ => None,
        }
    }

    /// Whether it has a parameter of this number.
    pub(super) fn has_parameter(self, number: usize) -> bool {
        match self {
            Self::Biconic | Self::Tilted => (1..=2).contains(&number),
            Self::Polynomial => (1..=8).contains(&number),
            Self::ExtendedPolynomial => number >= FIRST_EXTRA,
            Self::Toroid => number <= 8 || number >= FIRST_EXTRA,
            Self::ZernikeStandard | Self::ZernikeFringe => number <= 10 || number >= FIRST_EXTRA,
        }
    }

    /// Its shape, of the conic `base` (mm), of parameters with their numbers and extra data in lens units of `scale` mm.
    ///
    /// # Errors
    /// What is wrong with the surface.
    pub(super) fn shape(
        self,
        base: &Shape,
        parameters: &[(usize, f64)],
        extra: &[f64],
        scale: f64,
    ) -> Result<SkewShape, String> {
        let p = |number: usize| parameters.iter().rfind(|(n, _)| *n == number).map_or(0.0, |(_, v)| *v);
        // The coefficient of a term of this power.
        let term = |number: usize, power: i32| p(number) / scale.powi(power - 1);
        let inverse = |radius: f64| if radius == 0.0 { 0.0 } else { 1.0 / (radius * scale) };
        let mut shape = SkewShape::from(base.clone());
        match self {
            Self::Biconic => {
                shape.along_y =
                    Some(AlongY { curvature: base.curvature, conic: base.conic, ..AlongY::default() });
                (shape.base.curvature, shape.base.conic) = (inverse(p(1)), p(2));
            }
            Self::Toroid => {
                let radius = if p(1) == 0.0 { f64::INFINITY } else { p(1) * scale };
                let aspheric = (1..=7).map(|i| term(i + 1, 2 * i as i32)).collect();
                let Shape { curvature, conic, .. } = *base;
                shape = SkewShape {
                    along_y: Some(AlongY { curvature, conic, aspheric, swept_mm: Some(radius) }),
                    ..SkewShape::default()
                };
            }
            Self::Polynomial => {
                if base.curvature != 0.0 || base.conic != 0.0 {
                    return Err(
                        "has a polynomial surface (POLYNOMI) with a radius or conic constant".to_owned()
                    );
                }
                for i in 1..=4 {
                    let power = 2 * i as u32;
                    shape.xy.push(XyTerm::new(power, 0, term(i, power as i32)));
                    shape.xy.push(XyTerm::new(0, power, term(i + 4, power as i32)));
                }
            }
            Self::Tilted => {
                shape = SkewShape {
                    xy: vec![XyTerm::new(1, 0, p(1)), XyTerm::new(0, 1, p(2))],
                    ..SkewShape::default()
                };
            }
            Self::ZernikeStandard | Self::ZernikeFringe => {
                if p(9) != 0.0 || p(10) != 0.0 {
                    return Err("has Zernike terms about a decentred point (parameters 9 and 10), which is not supported".to_owned());
                }
                shape.base.aspheric = (1..=8).map(|i| term(i, 2 * i as i32)).collect();
            }
            Self::ExtendedPolynomial => {}
        }
        let (terms_mm, radius_mm) = self.terms(parameters, extra, scale)?;
        shape.xy.extend(match self {
            Self::ExtendedPolynomial => xy_series(&terms_mm, radius_mm),
            Self::Toroid | Self::ZernikeStandard => Zernike::Noll.series(&terms_mm, radius_mm, true),
            Self::ZernikeFringe => Zernike::Fringe.series(&terms_mm, radius_mm, false),
            Self::Biconic | Self::Polynomial | Self::Tilted => Vec::new(),
        });
        Ok(shape)
    }

    /// The terms of the extra data and the norm radius, mm.
    fn terms(
        self,
        parameters: &[(usize, f64)],
        extra: &[f64],
        scale: f64,
    ) -> Result<(Vec<f64>, f64), String> {
        let mut data = extra.to_vec();
        for (number, value) in parameters.iter().filter(|(n, _)| *n >= FIRST_EXTRA) {
            let index = number - FIRST_EXTRA;
            data.resize(data.len().max(index + 1), 0.0);
            data[index] = *value;
        }
        let &[count, radius, ref terms @ ..] = &data[..] else { return Ok((Vec::new(), 1.0)) };
        if !(0.0..=MAX_DECLARED).contains(&count) || count.fract() != 0.0 {
            return Err(format!(
                "has {} of {count} terms, expected a whole number from 0 to {MAX_DECLARED}",
                self.what(None)
            ));
        }
        let terms = &terms[..terms.len().min(count as usize)];
        let used = terms.iter().rposition(|a| *a != 0.0).map_or(0, |i| i + 1);
        let maximum = match self {
            Self::ExtendedPolynomial => MAX_XY,
            Self::ZernikeFringe => Zernike::Fringe.count(),
            _ => MAX_ZERNIKE,
        };
        if used > maximum {
            return Err(format!("has {} with a term {used}, the maximum is {maximum}", self.what(None)));
        }
        if used > 0 && radius <= 0.0 {
            return Err(format!("has {} of norm radius {radius}", self.what(None)));
        }
        Ok((terms[..used].iter().map(|a| a * scale).collect(), radius * scale))
    }

    /// What it is, in words.
    fn what(self, shape: Option<&SkewShape>) -> &'static str {
        let swept = shape.and_then(|s| s.along_y.as_ref()).and_then(|y| y.swept_mm);
        match self {
            Self::Biconic => "a biconic surface",
            Self::Toroid if swept.is_some_and(f64::is_infinite) => "a cylinder",
            Self::Toroid => "a toroid",
            Self::Polynomial | Self::ExtendedPolynomial => "an XY polynomial",
            Self::ZernikeStandard | Self::ZernikeFringe => "a Zernike surface",
            Self::Tilted => "a tilted plane",
        }
    }

    /// Gives the surface its shape.
    pub(super) fn give(self, surface: &mut DraftSurface, shape: SkewShape) {
        let what = self.what(Some(&shape));
        give(surface, what, shape, false);
    }
}
