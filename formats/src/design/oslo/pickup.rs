//! Pickups: a value of a surface that equals that of another one.

use super::command::Command;
use crate::design::draft::DraftSurface;
use crate::design::error::LensFileError;

#[derive(Clone, Copy)]
enum Value {
    Curvature,
    Thickness,
    Glass,
    Aperture,
}

/// A pickup.
pub(super) struct Pickup {
    surface: usize,
    source: usize,
    value: Value,
    /// Factor and constant.
    factor: f64,
    constant: f64,
    line: usize,
    text: String,
}

impl Pickup {
    /// Reads `PK <what> <surface> [constant]`; a surface below 1 counts from this one. None for what does not change the optics.
    pub(super) fn new(surface: usize, command: &Command<'_>) -> Result<Option<Self>, LensFileError> {
        let what = command.words.get(1).map_or("", |w| w).to_ascii_uppercase();
        let (value, factor) = match what.as_str() {
            "CV" => (Value::Curvature, 1.0),
            "CVM" => (Value::Curvature, -1.0),
            "TH" => (Value::Thickness, 1.0),
            "THM" => (Value::Thickness, -1.0),
            "GLA" => (Value::Glass, 1.0),
            "AP" => (Value::Aperture, 1.0),
            "ELE" | "TCE" => return Ok(None),
            _ => return Err(command.error("this pickup is not supported: CV, CVM, TH, THM, GLA and AP are")),
        };
        let number = command.value(2)?;
        let source = if number <= 0.0 { surface as f64 + number } else { number };
        if !(0.0..surface as f64).contains(&source) {
            return Err(command.error("expected a surface before this one"));
        }
        let constant = if command.words.len() > 3 { command.value(3)? } else { 0.0 };
        let (line, text) = (command.line, command.quote());
        Ok(Some(Self { surface, source: source as usize, value, factor, constant, line, text }))
    }

    pub(super) fn apply(&self, surfaces: &mut [DraftSurface]) -> Result<(), LensFileError> {
        let source = surfaces[self.source].clone();
        let of = |v: f64| self.factor * v + self.constant;
        let target = &mut surfaces[self.surface];
        match self.value {
            Value::Curvature => {
                target.shape = if self.factor > 0.0 { source.shape } else { source.shape.reversed() };
                target.shape.curvature += self.constant;
            }
            Value::Thickness => target.thickness_mm = of(source.thickness_mm),
            Value::Glass if source.is_mirror => {
                let problem = "a pickup of the glass of a mirror".to_owned();
                return Err(LensFileError::Line { line: self.line, text: self.text.clone(), problem });
            }
            Value::Glass => target.glass = source.glass,
            Value::Aperture => {
                target.semi_diameter_mm = of(source.semi_diameter_mm);
                target.clear_mm = source.clear_mm.map(of);
            }
        }
        Ok(())
    }
}
