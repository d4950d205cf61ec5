//! The multi-configuration editor of a .zmx file.
//!
//! ```text
//! MNUM <number of configurations> <saved configuration>
//! <operand> <surface, wavelength or field number> <configuration> <value> <status> …
//! ```
//! One line for each operand and configuration. The system and the surfaces of the file hold the values of the saved configuration. Applied are
//! THIC, CRVT, CONN, GLSS, SDIA, STPS, APER, WAVE and YFIE; TEMP and PRES of 20 °C and 1 atm, and MOFF, change nothing;
//! others are ignored with a note. A value that follows another one (pickup) was saved with the file.

use super::keywords::is_operand;
use super::line::{IGNORED, Line};
use super::surface::Context;
use crate::design::draft::Draft;
use crate::design::error::LensFileError;
use crate::design::text;
use pipeline::design::glass::Glass;
use pipeline::design::system::Aperture;

/// A value of an operand in one configuration.
pub(super) struct Operand {
    key: String,
    number: usize,
    configuration: usize,
    words: Vec<String>,
    line: usize,
    text: String,
}

impl Operand {
    pub(super) fn error(&self, problem: impl Into<String>) -> LensFileError {
        LensFileError::Line { line: self.line, text: self.text.clone(), problem: problem.into() }
    }

    fn value(&self) -> Result<f64, LensFileError> {
        let word = self.words.get(3).map_or("", String::as_str);
        text::number(word).ok_or_else(|| self.error(text::not_a_number(word)))
    }

    fn ignored(&self) -> String {
        format!("line {}: `{}` of configuration {} {IGNORED}", self.line, self.key, self.configuration)
    }
}

/// The editor.
#[derive(Default)]
pub(super) struct Configurations {
    count: usize,
    saved: usize,
    operands: Vec<Operand>,
}

impl Configurations {
    /// Reads a line behind the last surface; other data than the editor's are skipped, with a note where they are not known.
    pub(super) fn read_line(&mut self, key: &str, line: &Line<'_>) -> Result<Option<String>, LensFileError> {
        let whole = |i: usize| line.value_or(i, 0.0).map(|v| v.clamp(0.0, 1e6) as usize);
        if key == "MNUM" {
            (self.count, self.saved) = (whole(1)?, line.value_or(2, 1.0)?.clamp(1.0, 1e6) as usize);
        } else if self.count > 1 && key != "MOFF" && is_operand(key) && line.words.len() > 3 {
            // Tolerances and settings of other tables have no such numbers.
            if let (Ok(number), Ok(configuration)) = (whole(1), whole(2)) {
                let words = line.words.iter().map(|w| (*w).to_owned()).collect();
                let (line, text) = (line.number, line.quote());
                self.operands.push(Operand { key: key.to_owned(), number, configuration, words, line, text });
            }
        } else if !is_operand(key) {
            return Ok(Some(line.ignored()));
        }
        Ok(None)
    }

    /// The configuration to read, and a note if there are several.
    pub(super) fn choose(&self, requested: Option<usize>) -> Result<(usize, Option<String>), LensFileError> {
        let number = requested.unwrap_or(1);
        if number == 0 || number > self.count.max(1) {
            let problem =
                format!("has {} configuration(s), and --configuration is {number}", self.count.max(1));
            return Err(LensFileError::Incomplete { problem });
        }
        let note =
            || format!("configuration {number} of {}; --configuration N reads another one", self.count);
        Ok((number, (self.count > 1).then(note)))
    }

    /// Operands whose values differ from the saved ones.
    pub(super) fn changes(&self, number: usize) -> impl Iterator<Item = &Operand> {
        let differs = number != self.saved.max(1) && self.count > 1;
        self.operands.iter().filter(move |o| differs && o.configuration == number)
    }
}

/// Applies the value of an operand; a note comes back where it is ignored.
pub(super) fn apply(
    operand: &Operand,
    draft: &mut Draft,
    waves: &mut [(usize, f64, f64)],
    y: &mut [f64],
    context: &Context<'_>,
) -> Result<Option<String>, LensFileError> {
    let (number, scale) = (operand.number, context.scale);
    match operand.key.as_str() {
        "TEMP" if operand.value()? == 20.0 => return Ok(None),
        "PRES" if operand.value()? == 1.0 => return Ok(None),
        "STPS" => {
            draft.stop = Some(operand.value()?.clamp(0.0, 1e6) as usize);
            return Ok(None);
        }
        "APER" => {
            let value = operand.value()?;
            draft.aperture = draft.aperture.map(|aperture| match aperture {
                Aperture::EntrancePupil(_) => Aperture::EntrancePupil(value * scale),
                Aperture::ImageFNumber(_) => Aperture::ImageFNumber(value),
                Aperture::WorkingFNumber(_) => Aperture::WorkingFNumber(value),
                Aperture::ObjectNa(_) => Aperture::ObjectNa(value),
                Aperture::StopRadius(r) => Aperture::StopRadius(r),
            });
            return Ok(None);
        }
        "WAVE" | "YFIE" => {
            let value = operand.value()?;
            let target = match operand.key.as_str() {
                "WAVE" => waves.iter_mut().find(|w| w.0 == number).map(|w| &mut w.1),
                _ => y.get_mut(number.wrapping_sub(1)),
            };
            *target.ok_or_else(|| operand.error(format!("there is no number {number}")))? = value;
            return Ok(None);
        }
        _ => (),
    }
    let is_surface = matches!(operand.key.as_str(), "THIC" | "CRVT" | "CONN" | "GLSS" | "SDIA");
    if !is_surface {
        return Ok(Some(operand.ignored()));
    }
    let surface = draft.surfaces.get_mut(number);
    let surface = surface.ok_or_else(|| operand.error(format!("there is no surface {number}")))?;
    match operand.key.as_str() {
        "THIC" => {
            let mm = operand.value()? * scale;
            surface.thickness_mm = if mm >= 1e9 { f64::INFINITY } else { mm };
        }
        "CRVT" => {
            surface.shape.curvature = operand.value()? / scale;
            surface.free.iter_mut().for_each(|free| free.set_curvature(surface.shape.curvature));
        }
        "CONN" => {
            surface.shape.conic = operand.value()?;
            surface.free.iter_mut().for_each(|free| free.set_conic(surface.shape.conic));
        }
        "SDIA" => surface.semi_diameter_mm = operand.value()? * scale,
        _ => {
            let (glass, note) = glass(operand, context)?;
            surface.is_mirror = is_mirror(operand);
            surface.glass = glass;
            return Ok(note);
        }
    }
    Ok(None)
}

fn is_mirror(operand: &Operand) -> bool {
    operand.words[3].trim_matches('"').eq_ignore_ascii_case("MIRROR")
}

/// The glass of a GLSS operand; none is air.
fn glass(operand: &Operand, context: &Context<'_>) -> Result<(Option<Glass>, Option<String>), LensFileError> {
    let name = operand.words[3].trim_matches('"');
    if name.is_empty() || is_mirror(operand) {
        return Ok((None, None));
    }
    let found = context.glasses.find(name, context.catalogues);
    let (glass, note) = found.map_err(|e| operand.error(e.to_string()))?;
    Ok((Some(glass), note))
}
