//! A surface of a .zmx file.

use super::keywords::is_harmless_in_surface;
use super::line::{IGNORED, Line};
use crate::design::draft::DraftSurface;
use crate::design::error::LensFileError;
use crate::design::straight_axis::Break;
use crate::design::text;
use pipeline::design::glass::Glass;
use pipeline::design::glass_library::GlassLibrary;
use pipeline::design::model_glass::{constant_glass, model_glass};
use pipeline::design::shape::Shape;

/// Surface types.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Kind {
    #[default]
    Standard,
    EvenAsphere,
    OddAsphere,
    /// Even and odd aspheres of any number of terms, of the radius over a norm radius.
    ExtendedEvenAsphere,
    ExtendedOddAsphere,
    CoordinateBreak,
    /// An ideal thin lens.
    Ideal,
}

/// A value of a numbered parameter and the line that it is on.
struct Parameter {
    number: usize,
    value: f64,
    line: usize,
    quote: String,
}

/// What the lines of a surface have given so far.
#[derive(Default)]
pub(super) struct Reader {
    kind: Kind,
    draft: DraftSurface,
    parameters: Vec<Parameter>,
    /// Extra data of extended aspheres: the number of terms, the norm radius, the terms.
    extra: Vec<f64>,
}

/// Highest number of extra data: 120 terms.
const MAX_EXTRA: usize = 122;

/// What a surface needs of the system.
pub(super) struct Context<'a> {
    /// Lens unit in mm.
    pub(super) scale: f64,
    pub(super) glasses: &'a GlassLibrary,
    /// Catalogues that the design names.
    pub(super) catalogues: &'a [String],
}

impl Reader {
    /// Reads a line; a note for the user comes back where something was assumed or ignored.
    pub(super) fn read_line(
        &mut self,
        key: &str,
        line: &Line<'_>,
        context: &Context<'_>,
    ) -> Result<Option<String>, LensFileError> {
        let scale = context.scale;
        let draft = &mut self.draft;
        match key {
            "TYPE" => self.kind = kind(line)?,
            "CURV" => draft.shape.curvature = line.value(1)? / scale,
            "CONI" => draft.shape.conic = line.value(1)?,
            "DISZ" => {
                draft.thickness_mm = match line.words.get(1) {
                    Some(word) if text::is_infinite(word) => f64::INFINITY,
                    _ => line.value(1)? * scale,
                };
            }
            "PARM" => {
                let (number, value) = (line.value(1)?, line.value(2)?);
                if value != 0.0 {
                    let number = number.clamp(0.0, 99.0) as usize;
                    self.parameters.push(Parameter { number, value, line: line.number, quote: line.quote() });
                }
            }
            "XDAT" => {
                let number = line.value(1)?;
                if !(1.0..=MAX_EXTRA as f64).contains(&number) {
                    return Err(line.error(format!("expected the number of extra data, 1 to {MAX_EXTRA}")));
                }
                self.extra.resize(self.extra.len().max(number as usize), 0.0);
                self.extra[number as usize - 1] = line.value(2)?;
            }
            "GLAS" if line.words.get(1).is_some_and(|name| name.eq_ignore_ascii_case("MIRROR")) => {
                draft.is_mirror = true;
            }
            "GLAS" => {
                let (glass, note) = glass(line, context)?;
                draft.glass = Some(glass);
                return Ok(note);
            }
            "COAT" => {
                draft.coating_name = line.words.get(1).map(|name| name.trim_matches('"').to_owned());
            }
            "DIAM" => {
                draft.semi_diameter_mm = line.value(1)? * scale;
                draft.is_fixed = line.value_or(2, 0.0)? == 1.0;
            }
            "CLAP" | "FLAP" => {
                // Between two radii; the inner one is 0 without a hole.
                draft.obscuration_mm = Some(line.value(1)? * scale).filter(|r| *r > 0.0);
                draft.clear_mm = Some(line.value(2)? * scale);
            }
            "SQAP" | "ELAP" => {
                // Half widths along x and y.
                let radius = line.value(1)?.min(line.value(2)?);
                draft.clear_mm = Some(radius * scale);
                return Ok(Some(format!(
                    "line {}: `{}`: an aperture that is not a circle is replaced by the circle inside it, radius {radius}",
                    line.number,
                    line.quote()
                )));
            }
            "OBSC" => {
                // Blocks light between two radii; from 0 it is a central obscuration, else the rim of a mount.
                let inner = line.value(1)?;
                if inner == 0.0 {
                    draft.obscuration_mm = Some(line.value(2)? * scale).filter(|r| *r > 0.0);
                }
                if inner > 0.0 {
                    draft.clear_mm = Some(draft.clear_mm.unwrap_or(f64::INFINITY).min(inner * scale));
                }
            }
            "OBDC" | "SCBD"
                if line
                    .values()
                    .is_ok_and(|v| v.iter().skip(usize::from(key == "SCBD") * 2).any(|v| *v != 0.0)) =>
            {
                return Err(line.error("a tilted or decentred surface or aperture is not supported: the lens must be rotationally symmetric"));
            }
            "OBDC" | "SCBD" => {}
            _ if is_harmless_in_surface(key) => {}
            _ => return Ok(Some(line.ignored())),
        }
        Ok(None)
    }

    /// The surface.
    pub(super) fn finish(mut self, scale: f64) -> Result<DraftSurface, LensFileError> {
        let error = |p: &Parameter, problem: &str| LensFileError::Line {
            line: p.line,
            text: p.quote.clone(),
            problem: problem.to_owned(),
        };
        let shape = &mut self.draft.shape;
        let mut tilts = Break::default();
        for p in &self.parameters {
            // The coefficient of r^power has the unit (lens unit)^(1 − power).
            let (coefficients, index, power) = match (self.kind, p.number) {
                (Kind::EvenAsphere, i @ 1..=8) => (&mut shape.aspheric, i - 1, 2 * i),
                (Kind::OddAsphere, i @ 1..=8) if i % 2 == 0 => (&mut shape.aspheric, i / 2 - 1, i),
                (Kind::OddAsphere, i @ 1..=8) => (&mut shape.odd, i / 2, i),
                (Kind::Ideal, 1) => {
                    self.draft.ideal_focal_mm = Some(p.value * scale);
                    continue;
                }
                // How that program computes the path; here it is always that of an ideal lens.
                (Kind::Ideal, 2) => continue,
                (Kind::CoordinateBreak, i @ 1..=2) => {
                    tilts.decentre_mm[i - 1] = p.value * scale;
                    continue;
                }
                (Kind::CoordinateBreak, i @ 3..=5) => {
                    tilts.tilt_deg[i - 3] = p.value;
                    continue;
                }
                (Kind::CoordinateBreak, 6) => {
                    tilts.tilts_first = true;
                    continue;
                }
                _ => return Err(error(p, "a parameter that this surface type does not have")),
            };
            if coefficients.len() <= index {
                coefficients.resize(index + 1, 0.0);
            }
            coefficients[index] = p.value / scale.powi(power as i32 - 1);
        }
        if self.kind == Kind::Ideal {
            *shape = Shape::default();
        }
        if self.kind == Kind::Ideal && self.draft.ideal_focal_mm.is_none() {
            let problem = "has an ideal lens (PARAXIAL) without focal length (PARM 1)";
            return Err(LensFileError::Incomplete { problem: problem.to_owned() });
        }
        if matches!(self.kind, Kind::ExtendedEvenAsphere | Kind::ExtendedOddAsphere) {
            extended_terms(self.kind, &self.extra, scale, shape)?;
        }
        if self.kind == Kind::CoordinateBreak {
            self.draft.keeps_medium = true;
            self.draft.coordinate_break = Some(tilts);
        }
        Ok(self.draft)
    }
}

/// Adds the terms α_i (r/R)^power of an extended asphere, R and α_i in lens units.
fn extended_terms(kind: Kind, extra: &[f64], scale: f64, shape: &mut Shape) -> Result<(), LensFileError> {
    let &[count, radius, ref terms @ ..] = extra else { return Ok(()) };
    let terms = &terms[..terms.len().min(count.clamp(0.0, MAX_EXTRA as f64) as usize)];
    if terms.iter().any(|a| *a != 0.0) && radius <= 0.0 {
        let problem = format!("has an extended asphere of norm radius {radius}");
        return Err(LensFileError::Incomplete { problem });
    }
    for (i, a) in terms.iter().enumerate().filter(|(_, a)| **a != 0.0) {
        let power = if kind == Kind::ExtendedEvenAsphere { 2 * (i + 1) } else { i + 1 };
        let coefficients = if power % 2 == 0 { &mut shape.aspheric } else { &mut shape.odd };
        let index = (power - 1) / 2;
        coefficients.resize(coefficients.len().max(index + 1), 0.0);
        coefficients[index] += a * scale / (radius * scale).powi(power as i32);
    }
    Ok(())
}

fn kind(line: &Line<'_>) -> Result<Kind, LensFileError> {
    let symmetric = "lenscube traces rotationally symmetric lenses of types STANDARD, EVENASPH, ODDASPHE, XASPHERE, XODDASPH and PARAXIAL";
    match line.words.get(1) {
        Some(&"STANDARD") => Ok(Kind::Standard),
        Some(&"EVENASPH") => Ok(Kind::EvenAsphere),
        Some(&"ODDASPHE") => Ok(Kind::OddAsphere),
        Some(&"XASPHERE") => Ok(Kind::ExtendedEvenAsphere),
        Some(&"XODDASPH") => Ok(Kind::ExtendedOddAsphere),
        Some(&"COORDBRK") => Ok(Kind::CoordinateBreak),
        Some(&"PARAXIAL") => Ok(Kind::Ideal),
        Some(kind) => Err(line.error(format!("surface type {kind} is not supported: {symmetric}"))),
        None => Err(line.error("expected a surface type")),
    }
}

fn glass(line: &Line<'_>, context: &Context<'_>) -> Result<(Glass, Option<String>), LensFileError> {
    let name = *line.words.get(1).ok_or_else(|| line.error("expected a glass name"))?;
    // Some programs write the maker before it: SCHOTT-BK|N-BK7.
    let name = name.rsplit_once('|').map_or(name, |(_, name)| name);
    let found = context.glasses.find(name, context.catalogues);
    // 1: a model glass of n_d, V_d and the deviation of its partial dispersion. Old files have one beside each catalogue glass.
    let is_model = name.starts_with("___") || (found.is_err() && line.value_or(2, 0.0)? == 1.0);
    if !is_model {
        let (glass, note) = found.map_err(|e| line.error(e.to_string()))?;
        // 4: n_d and V_d differ from the catalogue's by the last two values.
        let is_offset = line.value_or(2, 0.0)? == 4.0
            && (line.value_or(10, 0.0)? != 0.0 || line.value_or(11, 0.0)? != 0.0);
        let offset = is_offset.then(|| {
            format!(
                "line {}: `{}`: the offset of the glass's n_d and V_d {IGNORED}",
                line.number,
                line.quote()
            )
        });
        return Ok((glass, offset.or(note)));
    }
    let (n_d, v_d, deviation) = (line.value(4)?, line.value_or(5, 0.0)?, line.value_or(6, 0.0)?);
    if v_d == 0.0 {
        let glass = constant_glass(n_d);
        return Ok((glass, Some(format!("line {}: model glass of constant index {n_d}", line.number))));
    }
    let glass = model_glass(&format!("n={n_d},V={v_d}"), n_d, v_d, deviation)
        .map_err(|e| line.error(e.to_string()))?;
    let note = format!(
        "line {}: model glass of n_d = {n_d}, V_d = {v_d}, ΔP_gF = {deviation}: its dispersion is Conrady's formula on the line of normal glasses",
        line.number
    );
    Ok((glass, Some(note)))
}
