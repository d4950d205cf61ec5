//! Commands that qualify surfaces: shape, apertures, tilts, and new values of radius and thickness.

use super::command::Command;
use super::decentre::is_decentre;
use super::free::is_free;
use super::{Reader, aperture, curvature};
use crate::design::asymmetric::CIRCLE_INSIDE;
use crate::design::error::LensFileError;

impl Reader<'_> {
    /// Commands that qualify the last surface, or those that they name.
    pub(super) fn read_qualifier(&mut self, key: &str, command: &Command<'_>) -> Result<bool, LensFileError> {
        if key == "PIM" {
            self.is_solved_for_image = !command.words.get(1).is_some_and(|w| w.starts_with(['n', 'N']));
            return Ok(true);
        }
        let last = self.draft.surfaces.len().saturating_sub(1);
        let Some(named) = command.surfaces(1, self.has_image.then_some(last)) else {
            return self.qualify(last, key, command, 1);
        };
        if *named.end() > last {
            return Err(command.error(format!("there is no surface {} before this command", named.end())));
        }
        let mut is_known = true;
        for index in named {
            is_known &= self.qualify(index, key, command, 2)?;
        }
        Ok(is_known)
    }

    /// Applies a command to surface `index`; its value is word `value`.
    fn qualify(
        &mut self,
        index: usize,
        key: &str,
        command: &Command<'_>,
        value: usize,
    ) -> Result<bool, LensFileError> {
        let scale = self.scale;
        if key == "STO" {
            self.draft.stop = Some(index);
            return Ok(true);
        }
        if is_decentre(key) {
            if index == 0 {
                return Err(command.error("a tilt or decentre of the object is not supported"));
            }
            self.decentres.entry(index).or_default().read(key, command, value)?;
            return Ok(true);
        }
        if is_free(key) {
            self.free.entry(index).or_default().read(key, command, value)?;
            return Ok(true);
        }
        if aperture::is_decentre(key) {
            self.apertures.entry(index).or_default().read_decentre(key, command, scale)?;
            return Ok(true);
        }
        let Some(surface) = self.draft.surfaces.get_mut(index) else { return Ok(false) };
        match key {
            "K" | "KY" => surface.shape.conic = command.value(value)?,
            "A" | "B" | "C" | "D" | "E" | "F" | "G" | "H" | "J" => {
                // r⁴ to r²⁰; I is not used.
                let term = "ABCDEFGHJ".find(key).unwrap_or(0) + 1;
                if surface.shape.aspheric.len() <= term {
                    surface.shape.aspheric.resize(term + 1, 0.0);
                }
                surface.shape.aspheric[term] = command.value(value)? / scale.powi(2 * term as i32 + 1);
            }
            "RMD" => {
                let mode = command.words.get(value).map_or("", |w| w).to_ascii_uppercase();
                surface.is_mirror |= mode.starts_with("REFL") || mode == "TIR";
            }
            "CIR" => match command.words.get(value).map(|w| w.to_ascii_uppercase()).as_deref() {
                // Edges and holes are drawn.
                Some("EDG" | "HOL") => {}
                Some("OBS") => {
                    // Its label may stand before the radius.
                    let radius = command.value(command.words.len() - 1)?;
                    surface.obscuration_mm = Some(radius * scale).filter(|r| *r > 0.0);
                }
                _ => surface.clear_mm = Some(command.value(value)? * scale),
            },
            "REX" | "REY" | "ELX" | "ELY" => match command.words.get(value).map(|w| w.to_ascii_uppercase()) {
                Some(kind) if kind == "EDG" || kind == "HOL" => {}
                Some(kind) if kind == "OBS" => return Ok(false),
                _ => {
                    // Half a side of a rectangle, or a semi-axis of an ellipse.
                    let half = command.value(value)? * scale;
                    surface.clear_mm = Some(surface.clear_mm.map_or(half, |radius| radius.min(half)));
                    self.apertures.entry(index).or_default().read_half(key, command, half);
                    let (line, text) = (command.line, command.text.trim());
                    self.draft.notes.push(format!("line {line}: `{text}`: {CIRCLE_INSIDE}"));
                }
            },
            // Its saved value stands in the surface's line.
            "THI" | "CUY" | "RDY" if command.is_solve(value) => {}
            "THI" => surface.thickness_mm = command.value_or_infinite(value)? * scale,
            "RDY" => surface.shape.curvature = curvature(command.value_or_infinite(value)?, true, scale),
            "CUY" => surface.shape.curvature = curvature(command.value(value)?, false, scale),
            _ => return Ok(false),
        }
        Ok(true)
    }
}
