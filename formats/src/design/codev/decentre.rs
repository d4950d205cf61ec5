//! Tilts and decentres of a surface: XDE, YDE, ZDE, ADE, BDE, CDE and their kinds.
//!
//! | kind | before the surface | behind it |
//! |---|---|---|
//! | (none) | decentre, then tilt | |
//! | DAR (decentre and return) | decentre, then tilt | the inverse |
//! | BEN (decentre and bend: fold mirrors) | decentre, then tilt | the tilt again |
//! | REV (reverse) | | the inverse |
//!
//! ADE (about x) and BDE (about y) are left-handed, CDE (about z) is right-handed. Thicknesses count behind all of these. Whether the surfaces
//! are on one axis nevertheless is found by `straight_axis`; a design with others has no rotational symmetry. Source: the decentre types of ray-optics (M. J. Hayford), which reads such files.

use super::command::Command;
use crate::design::draft::DraftSurface;
use crate::design::error::LensFileError;
use crate::design::straight_axis::Break;
use pipeline::bounds::TILT_DEG;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Kind {
    #[default]
    Basic,
    Return,
    Bend,
    Reverse,
}

/// Tilts and decentres of one surface; lengths in lens units.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Decentre {
    kind: Kind,
    decentre: [f64; 3],
    tilt_deg: [f64; 3],
}

/// Whether a command is one of these.
pub(super) fn is_decentre(key: &str) -> bool {
    matches!(key, "XDE" | "YDE" | "ZDE" | "ADE" | "BDE" | "CDE" | "DAR" | "BEN" | "REV")
}

impl Decentre {
    /// Reads a command, whose value is word `value`.
    pub(super) fn read(
        &mut self,
        key: &str,
        command: &Command<'_>,
        value: usize,
    ) -> Result<(), LensFileError> {
        let axis = "XYZABC".find(&key[..1]).unwrap_or(0) % 3;
        match key {
            "DAR" => self.kind = Kind::Return,
            "BEN" => self.kind = Kind::Bend,
            "REV" => self.kind = Kind::Reverse,
            "XDE" | "YDE" | "ZDE" => self.decentre[axis] = command.value(value)?,
            _ => {
                let tilt_deg = TILT_DEG.check(command.value(value)?);
                self.tilt_deg[axis] = tilt_deg.map_err(|e| command.error(e.to_string()))?;
            }
        }
        Ok(())
    }

    /// Applies them to the surface; `scale` is the lens unit in mm.
    pub(super) fn apply(&self, surface: &mut DraftSurface, scale: f64) {
        let [a, b, c] = self.tilt_deg;
        let whole = Break {
            decentre_mm: self.decentre.map(|v| v * scale),
            tilt_deg: [-a, -b, c],
            tilts_first: false,
        };
        surface.coordinate_break = (self.kind != Kind::Reverse).then_some(whole);
        surface.break_behind = match self.kind {
            Kind::Basic => None,
            Kind::Bend => Some(Break { decentre_mm: [0.0; 3], ..whole }),
            Kind::Return | Kind::Reverse => Some(whole.undone()),
        };
    }
}
