//! Surfaces of a sequence file without rotational symmetry.
//!
//! | command | surface | its values |
//! |---|---|---|
//! | CYL | cylinder | radius along y (RDY, K, A to J) or along x (RDX) |
//! | YTO | toroid: the curve of RDY, K, A to J in the yz plane, swept about an axis along y at RDX (0: a cylinder) | RDX |
//! | XTO | toroid: the curve of RDX, K, A to J in the xz plane, swept about an axis along x at RDY | RDX |
//! | AAS | biconic RDX, KX, RDY, KY (K), and Σ A_n ((1 − B_n) x² + (1 + B_n) y²)^n, n = 2 to 5 | AR to DR, AP to DP |
//! | SPS XYP | conic and C_k x^i y^j, k = ((i + j)² + i + 3j)/2 + 1 from 2; C1 is the conic constant | SCO C1 …, NRADIUS, K |
//! | SPS ZRN | conic, A to J, Zernike polynomials C2 = Z1, C3 = Z2, … in the order of CODE V; C1 is the norm radius | SCO |
//! | SPS ZFR | conic, A to J, fringe Zernike polynomials C4 = Z1, C5 = Z2, …; C1 is the conic constant, C3 the norm radius | SCO |
//!
//! Coefficients are in lens units, x and y over the norm radius (XYP without one: 1 lens unit). Source: CODE V, surface types; the toroids and apertures
//! of ray-optics (M. J. Hayford); the converter of CODE V files of OpticStudio (ZFR).

use super::command::Command;
use crate::design::draft::DraftSurface;
use crate::design::error::LensFileError;
use crate::design::freeform::{Zernike, anamorphic_term, give, xy_series};
use pipeline::design::prescription::freeform::{AlongY, SkewShape};
use pipeline::design::shape::Shape;

/// Highest number of a coefficient C of a special surface.
const MAX_COEFFICIENT: usize = 232;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Cylinder,
    YToroid,
    XToroid,
    Anamorphic,
    Polynomial,
    Zernike,
    FringeZernike,
}

/// What the commands of a surface have given so far; lengths in lens units.
#[derive(Clone, Debug, Default)]
pub(super) struct Free {
    kind: Option<Kind>,
    curvature_x: f64,
    conic_x: f64,
    /// (R, P) of the terms of r⁴, r⁶, r⁸, r¹⁰ of an anamorphic asphere.
    anamorphic: [(f64, f64); 4],
    norm_radius: Option<f64>,
    /// C1, C2, …
    coefficients: Vec<f64>,
    /// Line of the first command.
    line: usize,
    text: String,
}

/// Whether a command is one of these.
pub(super) fn is_free(key: &str) -> bool {
    let is_pair = key.len() == 2 && key.starts_with(['A', 'B', 'C', 'D']) && key.ends_with(['R', 'P']);
    is_pair || matches!(key, "CYL" | "YTO" | "XTO" | "AAS" | "SPS" | "SCO" | "RDX" | "CUX" | "KX")
}

impl Free {
    /// Reads a command, whose value is word `value`.
    ///
    /// # Errors
    /// A surface or coefficient that is not supported.
    pub(super) fn read(
        &mut self,
        key: &str,
        command: &Command<'_>,
        value: usize,
    ) -> Result<(), LensFileError> {
        if self.kind.is_none() {
            (self.line, self.text) = (command.line, command.text.trim().to_owned());
        }
        match key {
            "CYL" => self.kind = Some(Kind::Cylinder),
            "YTO" => self.kind = Some(Kind::YToroid),
            "XTO" => self.kind = Some(Kind::XToroid),
            "AAS" => self.kind = Some(Kind::Anamorphic),
            "SPS" => self.kind = Some(special(command, value)?),
            "SCO" => self.read_coefficient(command, value)?,
            "RDX" => {
                let radius = command.value_or_infinite(value)?;
                self.curvature_x = if radius == 0.0 || radius.is_infinite() { 0.0 } else { 1.0 / radius };
            }
            "CUX" => self.curvature_x = command.value(value)?,
            "KX" => self.conic_x = command.value(value)?,
            pair => {
                let term = "ABCD".find(&pair[..1]).unwrap_or(0);
                let v = command.value(value)?;
                if pair.ends_with('R') {
                    self.anamorphic[term].0 = v;
                } else {
                    self.anamorphic[term].1 = v;
                }
            }
        }
        Ok(())
    }

    fn read_coefficient(&mut self, command: &Command<'_>, at: usize) -> Result<(), LensFileError> {
        let name = command.words.get(at).map(|w| w.to_ascii_uppercase()).unwrap_or_default();
        let value = command.value(at + 1)?;
        if name == "NRADIUS" {
            self.norm_radius = Some(value);
            return Ok(());
        }
        let number = if name == "K" && self.kind != Some(Kind::Zernike) {
            Some(1)
        } else {
            name.strip_prefix('C').and_then(|n| n.parse().ok())
        };
        match number {
            Some(n @ 1..=MAX_COEFFICIENT) => {
                self.coefficients.resize(self.coefficients.len().max(n), 0.0);
                self.coefficients[n - 1] = value;
                Ok(())
            }
            _ if value == 0.0 => Ok(()),
            _ => Err(command.error(format!(
                "a coefficient of a special surface that is not supported: expected C1 to C{MAX_COEFFICIENT}, NRADIUS or K"
            ))),
        }
    }

    /// Gives the surface its shape; `scale` is the lens unit in mm.
    ///
    /// # Errors
    /// Values that the surface type does not have or that are not supported.
    pub(super) fn apply(&self, surface: &mut DraftSurface, scale: f64) -> Result<(), LensFileError> {
        let error =
            |problem: String| LensFileError::Line { line: self.line, text: self.text.clone(), problem };
        // Radii along x of surfaces that are not said to be anamorphic.
        let Some(kind) = self.kind else {
            let has_x = self.curvature_x != 0.0 && self.curvature_x / scale != surface.shape.curvature;
            return match has_x || self.conic_x != 0.0 {
                true => {
                    Err(error("a value along x of a surface that is not CYL, YTO, XTO or AAS".to_owned()))
                }
                false => Ok(()),
            };
        };
        let base = std::mem::take(&mut surface.shape);
        let along_x = self.curvature_x / scale;
        let has_terms = base.conic != 0.0 || base.is_aspheric();
        let toroid = |curvature: f64, swept: f64| SkewShape {
            along_y: Some(AlongY {
                curvature,
                conic: base.conic,
                aspheric: base.aspheric.clone(),
                swept_mm: Some(if swept == 0.0 { f64::INFINITY } else { 1.0 / swept }),
            }),
            ..SkewShape::default()
        };
        let (what, shape, is_rotated) = match kind {
            Kind::Cylinder if base.curvature != 0.0 && along_x != 0.0 => {
                return Err(error("a cylinder with radii along x and along y".to_owned()));
            }
            Kind::Cylinder if along_x != 0.0 => ("a cylinder", toroid(along_x, 0.0), true),
            Kind::Cylinder => ("a cylinder", toroid(base.curvature, 0.0), false),
            Kind::YToroid => ("a toroid", toroid(base.curvature, along_x), false),
            Kind::XToroid => ("a toroid", toroid(along_x, base.curvature), true),
            Kind::Anamorphic => ("an anamorphic asphere", self.anamorphic(&base, along_x, scale), false),
            Kind::Polynomial | Kind::Zernike | Kind::FringeZernike => {
                if kind == Kind::Polynomial && has_terms && base.is_aspheric() {
                    return Err(error("an XY polynomial (SPS XYP) with coefficients A to J".to_owned()));
                }
                ("a special surface", self.special(kind, base, scale).map_err(error)?, false)
            }
        };
        let what = match kind {
            Kind::Polynomial => "an XY polynomial",
            Kind::Zernike | Kind::FringeZernike => "a Zernike surface",
            _ => what,
        };
        give(surface, what, shape, is_rotated);
        Ok(())
    }

    fn anamorphic(&self, base: &Shape, along_x: f64, scale: f64) -> SkewShape {
        let mut shape = SkewShape {
            base: Shape { curvature: along_x, conic: self.conic_x, ..Shape::default() },
            along_y: Some(AlongY { curvature: base.curvature, conic: base.conic, ..AlongY::default() }),
            ..SkewShape::default()
        };
        for (n, (a, b)) in (2..).zip(self.anamorphic) {
            let a_mm = a / scale.powi(2 * n as i32 - 1);
            if b == 0.0 && a != 0.0 {
                shape.base.aspheric.resize(n as usize, 0.0);
                shape.base.aspheric[n as usize - 1] = a_mm;
            } else if a != 0.0 {
                shape.xy.extend(anamorphic_term(n, a_mm, b));
            }
        }
        shape
    }

    fn special(&self, kind: Kind, base: Shape, scale: f64) -> Result<SkewShape, String> {
        let c = |number: usize| self.coefficients.get(number - 1).copied().unwrap_or(0.0);
        let first = match kind {
            Kind::Zernike | Kind::Polynomial => 2,
            _ => 4,
        };
        let mut shape = SkewShape::from(base);
        let conic = if kind == Kind::Zernike { 0.0 } else { c(1) };
        if conic != 0.0 {
            shape.base.conic = conic;
        }
        if kind == Kind::FringeZernike && c(2) != 0.0 {
            return Err(
                "a Zernike surface (SPS ZFR) with a coefficient C2, which is not supported".to_owned()
            );
        }
        let slot = match kind {
            Kind::Zernike => c(1),
            Kind::FringeZernike => c(3),
            _ => 1.0,
        };
        let radius = self.norm_radius.unwrap_or(slot);
        let terms: Vec<f64> = self.coefficients.iter().skip(first - 1).map(|a| a * scale).collect();
        let used = terms.iter().rposition(|a| *a != 0.0).map_or(0, |i| i + 1);
        if used > 0 && radius <= 0.0 {
            return Err(format!("a special surface of norm radius {radius}"));
        }
        let (terms, radius_mm) = (&terms[..used], radius * scale);
        let (numbering, name) = match kind {
            Kind::Polynomial => {
                shape.xy = xy_series(terms, radius_mm);
                return Ok(shape);
            }
            Kind::Zernike => (Zernike::CodeV, "ZRN"),
            _ => (Zernike::Fringe, "ZFR"),
        };
        if used > numbering.count() {
            let (found, last) = (used + first - 1, numbering.count() + first - 1);
            return Err(format!(
                "a Zernike surface (SPS {name}) with a coefficient C{found}, the last is C{last}"
            ));
        }
        shape.xy = numbering.series(terms, radius_mm, false);
        Ok(shape)
    }
}

/// The special surface of a command SPS.
fn special(command: &Command<'_>, at: usize) -> Result<Kind, LensFileError> {
    match command.words.get(at).map(|w| w.to_ascii_uppercase()).as_deref() {
        Some("XYP") => Ok(Kind::Polynomial),
        Some("ZRN") => Ok(Kind::Zernike),
        Some("ZFR") => Ok(Kind::FringeZernike),
        _ => Err(command.error("this special surface is not supported: XYP, ZRN and ZFR are")),
    }
}
