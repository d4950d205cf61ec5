//! Surfaces of an OSLO lens file, in lens units until they are converted.

use super::command::Command;
use super::{INFINITE, Reader, glass, pickup};
use crate::design::draft::DraftSurface;
use crate::design::error::LensFileError;

/// Commands of a surface that do not change its optics: comments, expansion, tolerances, drawing, variables, aperture display.
const HARMLESS: &[&str] = &[
    "TCE", "LN", "CTX", "DRW", "SRF", "ELE", "GRD", "TOL", "VAR", "EC", "ECV", "NOTE", "OPN", "COA", "SNT",
    "RDF", "THF", "GPK", "LMO", "LME",
];

/// Commands for optics that are not rotationally symmetric or not modelled.
const UNSUPPORTED: &[&str] = &[
    "PFL", "PFM", "CVX", "RDX", "GSP", "GOR", "DOE", "DFR", "HOR", "HV1", "HV2", "GC", "BEN", "RCO", "TIR",
    "GRIN", "GDT", "NSS",
];

/// Largest number of an AS coefficient.
const MAX_TERMS: usize = 60;

/// Reads a command of the current surface; false if it is not known.
pub(super) fn read(reader: &mut Reader<'_>, key: &str, command: &Command<'_>) -> Result<bool, LensFileError> {
    let at = reader.at;
    let first = || command.value(1);
    let surface = &mut reader.draft.surfaces[at];
    match key {
        "RD" => {
            let radius = first()?;
            surface.shape.curvature = if radius == 0.0 { 0.0 } else { 1.0 / radius };
        }
        "CV" => surface.shape.curvature = first()?,
        "TH" => {
            let gap = first()?;
            surface.thickness_mm = if gap.abs() >= INFINITE { f64::INFINITY } else { gap };
        }
        "AP" => {
            let is_checked = command.words.get(1).is_some_and(|w| w.eq_ignore_ascii_case("CHK"));
            let radius = command.value(1 + usize::from(is_checked))?;
            surface.semi_diameter_mm = radius;
            surface.clear_mm = (is_checked && radius > 0.0).then_some(radius);
        }
        "AST" => reader.draft.stop = Some(at),
        "AIR" => {
            (surface.is_mirror, surface.glass) = (false, None);
            reader.glass_lines.retain(|(i, _)| *i != at);
        }
        "GLA" => {
            reader.glass_lines.retain(|(i, _)| *i != at);
            reader.glass_lines.push((at, glass::Line::new(command)?));
        }
        "RFL" | "RFH" => surface.is_mirror = true,
        "CC" => surface.shape.conic = first()?,
        "AD" | "AE" | "AF" | "AG" => {
            let term = "DEFG".find(&key[1..]).unwrap_or(0) + 1;
            coefficient(&mut surface.shape.aspheric, term, first()?);
        }
        "ASP" => {
            let kind = command.words.get(1).map_or("", |w| w).to_ascii_uppercase();
            if kind != "ASR" {
                return Err(command.error("this kind of asphere is not supported: ASR (even powers of r) is"));
            }
        }
        "PK" => reader.pickups.extend(pickup::Pickup::new(at, command)?),
        "PY" => {
            if first()? != 0.0 {
                return Err(command.error("a solve of a height other than 0: save the lens without solves"));
            }
            // It sets the gap whose surface it stands on; it is solved where that is the last.
            reader.is_solved = true;
            reader.solved_at = at;
        }
        "PU" | "PUC" | "PI" | "PIC" | "PYC" => {
            return Err(
                command.error("a solve, whose value the file does not hold: save the lens without solves")
            );
        }
        "DCX" | "DCY" | "DCZ" | "TLA" | "TLB" | "TLC" => {
            if first()? != 0.0 {
                return Err(command
                    .error("a tilt or decentre is not supported: the lens must be rotationally symmetric"));
            }
        }
        "DT" => {}
        _ if UNSUPPORTED.contains(&key) => {
            return Err(command.error("not supported: lenscube traces rotationally symmetric systems of spheres, conics and aspheres"));
        }
        _ if HARMLESS.contains(&key) => {}
        _ => {
            let Some(term) = key.strip_prefix("AS").and_then(|n| n.parse::<usize>().ok()) else {
                return Ok(false);
            };
            let value = first()?;
            if (term == 0 && value != 0.0) || term > MAX_TERMS {
                return Err(command.error(format!("expected a coefficient AS1 to AS{MAX_TERMS}")));
            }
            if term > 0 {
                coefficient(&mut surface.shape.aspheric, term - 1, value);
            }
        }
    }
    Ok(true)
}

fn coefficient(list: &mut Vec<f64>, index: usize, value: f64) {
    list.resize(list.len().max(index + 1), 0.0);
    list[index] = value;
}

/// Converts lens units to mm.
pub(super) fn convert(surface: &mut DraftSurface, scale: f64) {
    surface.shape.curvature /= scale;
    for (i, a) in surface.shape.aspheric.iter_mut().enumerate() {
        *a /= scale.powi(2 * i as i32 + 1);
    }
    surface.thickness_mm *= scale;
    surface.semi_diameter_mm *= scale;
    surface.clear_mm = surface.clear_mm.map(|r| r * scale);
}
