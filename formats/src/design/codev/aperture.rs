//! Apertures of a sequence file that are not discs about the vertex: REX, REY, ELX, ELY (half sides and semi-axes), ADX, ADY (decentres).
//!
//! A decentre is that of the aperture before it, clear (CIR, REX, …) or an obscuration (`OBS`); those of edges (`EDG`) and holes (`HOL`) are drawn
//! and not read. Of half a rectangle or ellipse along x or y alone the other half is the same.

use super::command::Command;
use crate::design::draft::DraftSurface;
use crate::design::error::LensFileError;
use pipeline::design::prescription::asymmetry::{Form, Outline};

/// The apertures of a surface.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Apertures {
    clear: Shape,
    hidden: Shape,
}

/// One of them, mm.
#[derive(Clone, Copy, Debug, Default)]
struct Shape {
    /// Its form, if it is not a circle.
    form: Option<Form>,
    half_mm: [Option<f64>; 2],
    centre_mm: [f64; 2],
}

/// Whether the aperture of a command is drawn only.
fn is_drawn(command: &Command<'_>) -> bool {
    command.words.iter().any(|w| matches!(w.to_ascii_uppercase().as_str(), "EDG" | "HOL"))
}

/// Whether a command is a decentre of an aperture.
pub(super) fn is_decentre(key: &str) -> bool {
    matches!(key, "ADX" | "ADY" | "ARO")
}

impl Apertures {
    fn of(&mut self, command: &Command<'_>) -> &mut Shape {
        let is_obscuration = command.words.iter().any(|w| w.eq_ignore_ascii_case("OBS"));
        if is_obscuration { &mut self.hidden } else { &mut self.clear }
    }

    /// Reads REX, REY, ELX or ELY of `half_mm`.
    pub(super) fn read_half(&mut self, key: &str, command: &Command<'_>, half_mm: f64) {
        let shape = self.of(command);
        shape.form = Some(if key.starts_with('R') { Form::Rectangle } else { Form::Ellipse });
        shape.half_mm[usize::from(key.ends_with('Y'))] = Some(half_mm);
    }

    /// Reads ADX, ADY or ARO; `scale` is the lens unit in mm.
    ///
    /// # Errors
    /// A rotated aperture.
    pub(super) fn read_decentre(
        &mut self,
        key: &str,
        command: &Command<'_>,
        scale: f64,
    ) -> Result<(), LensFileError> {
        // The label of an aperture may stand before the value.
        let value = command.value(command.words.len() - 1)?;
        if is_drawn(command) || value == 0.0 {
            return Ok(());
        }
        if key == "ARO" {
            return Err(command.error("a rotated aperture (ARO) is not supported"));
        }
        self.of(command).centre_mm[usize::from(key == "ADY")] = value * scale;
        Ok(())
    }

    /// Gives them to the surface.
    pub(super) fn apply(&self, surface: &mut DraftSurface) {
        surface.outline = self.clear.outline(surface.clear_mm);
        surface.hidden = self.hidden.outline(surface.obscuration_mm);
        if surface.outline.is_some_and(|o| o.centre_mm != [0.0; 2]) {
            surface.clear_mm = None;
        }
        if surface.hidden.is_some() {
            surface.obscuration_mm = None;
        }
    }
}

impl Shape {
    /// The outline, if it is not a disc about the vertex; `radius_mm` is that of a circle.
    fn outline(&self, radius_mm: Option<f64>) -> Option<Outline> {
        let centre_mm = self.centre_mm;
        match (self.form, self.half_mm) {
            (Some(form), [x, y]) => {
                let half_mm = [x.or(y)?, y.or(x)?];
                Some(Outline { form, half_mm, centre_mm })
            }
            (None, _) if centre_mm == [0.0; 2] => None,
            (None, _) => radius_mm.map(|radius| Outline { centre_mm, ..Outline::disc(radius) }),
        }
    }
}
