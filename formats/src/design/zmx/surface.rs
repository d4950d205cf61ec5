//! A surface of a .zmx file.

use super::free::Free;
use super::keywords::is_harmless_in_surface;
use super::line::{IGNORED, Line};
use crate::design::asymmetric::CIRCLE_INSIDE;
use crate::design::draft::DraftSurface;
use crate::design::error::LensFileError;
use crate::design::straight_axis::Break;
use crate::design::text;
use pipeline::bounds::TILT_DEG;
use pipeline::design::glass::Glass;
use pipeline::design::glass_library::GlassLibrary;
use pipeline::design::model_glass::{constant_glass, model_glass};
use pipeline::design::prescription::asymmetry::{Form, Outline};
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
    /// Without rotational symmetry.
    Free(Free),
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
    /// Extra data of extended surfaces: the number of terms, the norm radius, the terms.
    extra: Vec<f64>,
    /// Centre of its aperture and obscuration, mm.
    centre_mm: [f64; 2],
}

/// Highest number of extra data: 240 terms.
const MAX_EXTRA: usize = 242;

/// Highest number of a parameter; extra data are parameters from 13 in some files.
const MAX_PARAMETER: usize = 12 + MAX_EXTRA;

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
                    let number = number.clamp(0.0, MAX_PARAMETER as f64 + 1.0) as usize;
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
                let half = [line.value(1)?, line.value(2)?];
                let form = if key == "SQAP" { Form::Rectangle } else { Form::Ellipse };
                draft.outline = Some(Outline { form, half_mm: half.map(|v| v * scale), centre_mm: [0.0; 2] });
                let radius = half[0].min(half[1]);
                draft.clear_mm = Some(radius * scale);
                return Ok(Some(format!(
                    "line {}: `{}`: {CIRCLE_INSIDE}, radius {radius}",
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
            "OBDC" => self.centre_mm = [line.value(1)? * scale, line.value_or(2, 0.0)? * scale],
            "SCBD" => self.read_tilt(line, scale)?,
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
        self.move_apertures();
        if let Kind::Free(free) = self.kind {
            let parameters = self.parameters.iter().map(|p| (p.number, p.value)).collect::<Vec<_>>();
            if let Some(p) = self.parameters.iter().find(|p| !free.has_parameter(p.number)) {
                return Err(error(p, "a parameter that this surface type does not have"));
            }
            let shape = free.shape(&self.draft.shape, &parameters, &self.extra, scale);
            free.give(&mut self.draft, shape.map_err(|problem| LensFileError::Incomplete { problem })?);
            return Ok(self.draft);
        }
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
                    tilts.tilt_deg[i - 3] = TILT_DEG.check(p.value).map_err(|e| error(p, &e.to_string()))?;
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
            if self.draft.coordinate_break.is_some() || self.draft.break_behind.is_some() {
                let problem = "has a coordinate break (COORDBRK) that is tilted or decentred itself (SCBD)";
                return Err(LensFileError::Incomplete { problem: problem.to_owned() });
            }
            self.draft.keeps_medium = true;
            self.draft.coordinate_break = Some(tilts);
        }
        Ok(self.draft)
    }
}

impl Reader {
    /// Reads the tilt and decentre of the surface, before it (1) or behind it (2): order, what it is a pickup of (the saved values hold), decentres, tilts.
    /// A coordinate return (3) is solved in the parameters of its coordinate break.
    fn read_tilt(&mut self, line: &Line<'_>, scale: f64) -> Result<(), LensFileError> {
        let side = line.value(1)?;
        if side == 3.0 {
            return Ok(());
        }
        let mut v = [0.0; 5];
        for (i, v) in v.iter_mut().enumerate() {
            *v = line.value_or(i + 4, 0.0)?;
        }
        let [x, y, ax, ay, az] = v;
        for tilt_deg in [ax, ay, az] {
            TILT_DEG.check(tilt_deg).map_err(|e| line.error(e.to_string()))?;
        }
        let tilts_first = line.value_or(2, 0.0)? != 0.0;
        let decentre_mm = [x * scale, y * scale, 0.0];
        let found = (v != [0.0; 5]).then_some(Break { decentre_mm, tilt_deg: [ax, ay, az], tilts_first });
        match side {
            1.0 => self.draft.coordinate_break = found,
            2.0 => self.draft.break_behind = found,
            _ => {
                return Err(line.error(
                    "expected a tilt before the surface (1), behind it (2) or a coordinate return (3)",
                ));
            }
        }
        Ok(())
    }

    /// Moves the aperture and the obscuration to their centre; discs beside the vertex are no longer those of a symmetric lens.
    fn move_apertures(&mut self) {
        let (draft, centre_mm) = (&mut self.draft, self.centre_mm);
        if centre_mm == [0.0; 2] {
            return;
        }
        let disc = |radius: f64| Outline { centre_mm, ..Outline::disc(radius) };
        let clear = draft.clear_mm.take().map(disc);
        draft.outline = draft.outline.map(|o| Outline { centre_mm, ..o }).or(clear);
        draft.hidden = draft.obscuration_mm.take().map(disc);
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
    let known = "STANDARD, EVENASPH, ODDASPHE, XASPHERE, XODDASPH, COORDBRK, PARAXIAL, BICONICX, TOROIDAL, XPOLYNOM, POLYNOMI, SZERNSAG, FZERNSAG and TILTSURF are";
    match line.words.get(1) {
        Some(&"STANDARD") => Ok(Kind::Standard),
        Some(&"EVENASPH") => Ok(Kind::EvenAsphere),
        Some(&"ODDASPHE") => Ok(Kind::OddAsphere),
        Some(&"XASPHERE") => Ok(Kind::ExtendedEvenAsphere),
        Some(&"XODDASPH") => Ok(Kind::ExtendedOddAsphere),
        Some(&"COORDBRK") => Ok(Kind::CoordinateBreak),
        Some(&"PARAXIAL") => Ok(Kind::Ideal),
        Some(kind) => match Free::of(kind) {
            Some(free) => Ok(Kind::Free(free)),
            None => Err(line.error(format!("surface type {kind} is not supported: {known}"))),
        },
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
