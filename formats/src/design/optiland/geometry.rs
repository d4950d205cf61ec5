//! Shapes and apertures of the surfaces of Optiland's JSON.
//!
//! | type | values |
//! |---|---|
//! | Plane, StandardGeometry, EvenAsphere, OddAsphere | radius, conic, coefficients of r², r⁴, … or r, r², … |
//! | BiconicGeometry | radius_x, conic_x, radius_y, conic_y: the sum of a sag along x and one along y |
//! | ToroidalGeometry | radius_y, conic_yz, coeffs_poly_y (of y², y⁴, …): the curve swept at radius_x |
//! | PolynomialGeometry | radius, conic, coefficients: the row i has those of x^i, x^i y, x^i y², … |
//! | ZernikePolynomialGeometry | radius, conic, coefficients, norm_radius, zernike_type: standard (OSA), noll or fringe |
//!
//! A biconic surface of other programs has one square root, that of Optiland one for each axis. Where both are curved the sag along x is a
//! series to x³⁰: c x²/2 · Σ …, with an error below 1e-9 of it where x is below half the radius. Source: Optiland 0.6, `geometries`,
//! `zernike`, `physical_apertures`.

use super::values::{incomplete, list, number, text};
use crate::design::asymmetric::CIRCLE_INSIDE;
use crate::design::draft::DraftSurface;
use crate::design::error::LensFileError;
use crate::design::freeform::{Zernike, give};
use pipeline::design::prescription::asymmetry::{Form, Outline};
use pipeline::design::prescription::freeform::{AlongY, SkewShape, XyTerm};
use serde_json::Value;

/// Highest power of x or y.
const MAX_POWER: usize = 30;

/// Gives the surface its shape.
///
/// # Errors
/// A type or value that is not supported.
pub(super) fn shape(geometry: &Value, draft: &mut DraftSurface) -> Result<(), LensFileError> {
    let inverse = |pointer: &str| -> Result<f64, LensFileError> {
        let radius = number(geometry, pointer, f64::INFINITY)?;
        Ok(if radius == 0.0 || radius.is_infinite() { 0.0 } else { 1.0 / radius })
    };
    draft.shape.curvature = inverse("/radius")?;
    draft.shape.conic = number(geometry, "/conic", 0.0)?;
    match text(geometry, "/type") {
        "Plane" | "StandardGeometry" | "Standard" => {}
        "EvenAsphere" => draft.shape.aspheric = numbers(list(geometry, "/coefficients"))?,
        "OddAsphere" => {
            let coefficients = numbers(list(geometry, "/coefficients"))?;
            draft.shape.odd = coefficients.iter().copied().step_by(2).collect();
            draft.shape.aspheric = coefficients.iter().copied().skip(1).step_by(2).collect();
        }
        "BiconicGeometry" => {
            let along_x = (inverse("/radius_x")?, number(geometry, "/conic_x", 0.0)?);
            let along_y = (inverse("/radius_y")?, number(geometry, "/conic_y", 0.0)?);
            give(draft, "a biconic surface", biconic(along_x, along_y), false);
        }
        "ToroidalGeometry" => {
            let radius = number(geometry, "/radius_x", f64::INFINITY)?;
            let along_y = AlongY {
                curvature: inverse("/radius_y")?,
                conic: number(geometry, "/conic_yz", 0.0)?,
                aspheric: numbers(list(geometry, "/coeffs_poly_y"))?,
                swept_mm: Some(if radius == 0.0 { f64::INFINITY } else { radius }),
            };
            let what = if radius.is_infinite() || radius == 0.0 { "a cylinder" } else { "a toroid" };
            give(draft, what, SkewShape { along_y: Some(along_y), ..SkewShape::default() }, false);
        }
        "PolynomialGeometry" => {
            let xy = polynomial(list(geometry, "/coefficients"))?;
            let base = draft.shape.clone();
            give(draft, "an XY polynomial", SkewShape { base, xy, ..SkewShape::default() }, false);
        }
        "ZernikePolynomialGeometry" => {
            let xy = zernike(geometry)?;
            let base = draft.shape.clone();
            give(draft, "a Zernike surface", SkewShape { base, xy, ..SkewShape::default() }, false);
        }
        other => {
            let known = "Plane, StandardGeometry, EvenAsphere, OddAsphere, BiconicGeometry, ToroidalGeometry, PolynomialGeometry and ZernikePolynomialGeometry";
            return Err(incomplete(format!(
                "has a surface of type `{other}`, which is not supported: {known} are"
            )));
        }
    }
    Ok(())
}

fn numbers(values: &[Value]) -> Result<Vec<f64>, LensFileError> {
    let number = |c: &Value| {
        c.as_f64().ok_or_else(|| incomplete(format!("has an asphere coefficient that is not a number: {c}")))
    };
    values.iter().map(number).collect()
}

/// The sum of the sags of two conics, (curvature, conic constant) along x and along y.
fn biconic((cx, kx): (f64, f64), (cy, ky): (f64, f64)) -> SkewShape {
    let mut shape = SkewShape::default();
    if cy == 0.0 {
        (shape.base.curvature, shape.base.conic) = (cx, kx);
        shape.along_y = Some(AlongY::default());
        return shape;
    }
    // The cylinder along y, and the series along x: with u = (1 + κ) c² x², (1 − √(1 − u))/((1 + κ) c) = c x²/2 · (1 + u/4 + u²/8 + …).
    shape.along_y =
        Some(AlongY { curvature: cy, conic: ky, swept_mm: Some(f64::INFINITY), ..AlongY::default() });
    let mut term = 0.5 * cx;
    for i in 1..=MAX_POWER / 2 {
        shape.xy.push(XyTerm::new(2 * i as u32, 0, term));
        term *= (1.0 + kx) * cx * cx * (2 * i - 1) as f64 / (2 * i + 2) as f64;
    }
    shape
}

fn polynomial(rows: &[Value]) -> Result<Vec<XyTerm>, LensFileError> {
    let mut terms = Vec::new();
    for (i, row) in rows.iter().enumerate() {
        let row = numbers(row.as_array().map_or(&[], Vec::as_slice))?;
        for (j, c) in row.into_iter().enumerate().filter(|(_, c)| *c != 0.0) {
            if i.max(j) > MAX_POWER {
                return Err(incomplete(format!(
                    "has an XY term x^{i} y^{j}, the highest power is {MAX_POWER}"
                )));
            }
            terms.push(XyTerm::new(i as u32, j as u32, c));
        }
    }
    Ok(terms)
}

fn zernike(geometry: &Value) -> Result<Vec<XyTerm>, LensFileError> {
    let (numbering, is_normalised) = match text(geometry, "/zernike_type") {
        "standard" | "" => (Zernike::Osa, true),
        "noll" => (Zernike::Noll, true),
        "fringe" => (Zernike::FringeOnwards, false),
        other => return Err(incomplete(format!("has Zernike polynomials of type `{other}`"))),
    };
    let coefficients = numbers(list(geometry, "/coefficients"))?;
    let used = coefficients.iter().rposition(|a| *a != 0.0).map_or(0, |i| i + 1);
    if used > numbering.count() {
        return Err(incomplete(format!("has a Zernike term {used}, the maximum is {}", numbering.count())));
    }
    let radius_mm = number(geometry, "/norm_radius", 1.0)?;
    if used > 0 && !(radius_mm > 0.0 && radius_mm.is_finite()) {
        return Err(incomplete(format!("has Zernike polynomials of norm radius {radius_mm}")));
    }
    Ok(numbering.series(&coefficients[..used], radius_mm, is_normalised))
}

/// Gives the surface its aperture; a note says what a symmetric lens has instead.
///
/// # Errors
/// A type that is not supported.
pub(super) fn aperture(
    aperture: &Value,
    draft: &mut DraftSurface,
    notes: &mut Vec<String>,
) -> Result<(), LensFileError> {
    if aperture.is_null() {
        return Ok(());
    }
    let at = |pointer: &str, missing: f64| number(aperture, pointer, missing);
    let kind = text(aperture, "/type");
    let outline = match kind {
        "RadialAperture" | "OffsetRadialAperture" => {
            let centre_mm = [at("/offset_x", 0.0)?, at("/offset_y", 0.0)?];
            let hole = Some(at("/r_min", 0.0)?).filter(|r| *r > 0.0);
            let clear = Some(at("/r_max", f64::INFINITY)?).filter(|r| r.is_finite());
            if centre_mm == [0.0; 2] {
                (draft.obscuration_mm, draft.clear_mm) = (hole, clear);
                return Ok(());
            }
            let disc = |radius: f64| Outline { centre_mm, ..Outline::disc(radius) };
            draft.hidden = hole.map(disc);
            draft.outline = clear.map(disc);
            return Ok(());
        }
        "RectangularAperture" => {
            let sides = [
                at("/x_min", f64::NAN)?,
                at("/x_max", f64::NAN)?,
                at("/y_min", f64::NAN)?,
                at("/y_max", f64::NAN)?,
            ];
            if !sides.iter().all(|v| v.is_finite()) {
                return Err(incomplete("has a rectangular aperture without the four sides of a rectangle"));
            }
            let [x0, x1, y0, y1] = sides;
            let half_mm = [0.5 * (x1 - x0), 0.5 * (y1 - y0)];
            Outline { form: Form::Rectangle, half_mm, centre_mm: [0.5 * (x0 + x1), 0.5 * (y0 + y1)] }
        }
        "EllipticalAperture" => Outline {
            form: Form::Ellipse,
            half_mm: [at("/a", f64::NAN)?, at("/b", f64::NAN)?],
            centre_mm: [at("/offset_x", 0.0)?, at("/offset_y", 0.0)?],
        },
        other => {
            let known = "RadialAperture, OffsetRadialAperture, RectangularAperture or EllipticalAperture";
            return Err(incomplete(format!("has an aperture of type `{other}`, expected {known}")));
        }
    };
    draft.outline = Some(outline);
    if outline.centre_mm == [0.0; 2] {
        let radius = outline.half_mm[0].min(outline.half_mm[1]);
        draft.clear_mm = Some(radius);
        notes.push(format!("{kind}: {CIRCLE_INSIDE}, radius {radius}"));
    }
    Ok(())
}
