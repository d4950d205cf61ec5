//! Glasses of an OSLO lens file.

use super::command::Command;
use crate::design::error::LensFileError;
use pipeline::design::glass::{Dispersion, Glass};
use pipeline::design::glass_library::GlassLibrary;
use pipeline::design::model_glass::{constant_glass, glass_code, model_glass};

/// Abbe numbers are above this, indices below.
const MAX_INDEX: f64 = 10.0;

/// A GLA command, kept until the wavelengths are known.
pub(super) struct Line {
    number: usize,
    text: String,
    name: String,
    indices: Vec<f64>,
}

impl Line {
    pub(super) fn new(command: &Command<'_>) -> Result<Self, LensFileError> {
        let word = command.words.get(1).ok_or_else(|| command.error("expected a glass"))?.trim_matches('"');
        let is_model = word.eq_ignore_ascii_case("MOD");
        let first = if is_model { 2 } else { 1 };
        // A glass code of digits is a name.
        let is_number = |w: &&str| w.parse::<f64>().is_ok() && glass_code(w).is_none();
        let is_number = |i: usize| command.words.get(i).is_some_and(is_number);
        let is_named = !is_number(first);
        let name =
            if is_named { command.words.get(first).map_or(word, |w| w.trim_matches('"')) } else { "model" };
        let indices = match is_model || !is_named {
            true => command.values(first + usize::from(is_named))?,
            false => Vec::new(),
        };
        Ok(Self { number: command.line, text: command.quote(), name: name.to_owned(), indices })
    }

    /// The glass, none for air, and a note.
    pub(super) fn glass(
        &self,
        glasses: &GlassLibrary,
        um: &[f64],
    ) -> Result<(Option<Glass>, Option<String>), LensFileError> {
        let error =
            |problem: String| LensFileError::Line { line: self.number, text: self.text.clone(), problem };
        let noted = |note: String| Some(format!("line {}: {note}", self.number));
        match self.indices[..] {
            [] if self.name.eq_ignore_ascii_case("AIR") => Ok((None, None)),
            [] => {
                let (glass, note) = glasses.find(&self.name, &[]).map_err(|e| error(e.to_string()))?;
                Ok((Some(glass), note.and_then(noted)))
            }
            [n] if (1.0..MAX_INDEX).contains(&n) => {
                Ok((Some(constant_glass(n)), noted(format!("n = {n} without dispersion"))))
            }
            [n, v] if v > MAX_INDEX => {
                let glass =
                    model_glass(&format!("n={n},V={v}"), n, v, 0.0).map_err(|e| error(e.to_string()))?;
                Ok((Some(glass), noted(format!("n_d = {n}, V_d = {v}: a model glass of these values"))))
            }
            ref indices
                if indices.len() == um.len() && indices.iter().all(|n| (1.0..MAX_INDEX).contains(n)) =>
            {
                let range =
                    um.iter().fold((f64::INFINITY, 0.0), |(a, b): (f64, f64), v| (a.min(*v), b.max(*v)));
                let points: Vec<(f64, f64)> = um.iter().copied().zip(indices.iter().copied()).collect();
                let dispersion = Dispersion::table(&points).map_err(error)?;
                Ok((Some(Glass::new(self.name.clone(), dispersion, range)), None))
            }
            _ => Err(error(format!(
                "expected a glass name, one index, n_d and V_d, or an index of 1 to 10 for each of {} wavelengths",
                um.len()
            ))),
        }
    }
}
