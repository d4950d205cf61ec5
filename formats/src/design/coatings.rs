//! Coatings by name: files of coatings, the names that designs give, and the built-in ones.
//!
//! | module | content |
//! |---|---|
//! | [`toml`] | coatings of a lens in TOML: layers, reflectances, measured tables, and which surface has which |
//! | [`dat`] | the coating file of the lens design program: `MATE`, `COAT`, `TABLE`, `IDEAL` |
//! | `csv` | measured tables |
//!
//! Built-in names: `none` (bare), `ideal` (all light passes), `mgf2` and `mgf2@NM` (a quarter wave of index 1.38 at NM, else 550 nm), and `I.xx` of the
//! design program (transmittance 0.xx, the rest reflected).

mod csv;
pub mod dat;
pub mod toml;

use super::error::LensFileError;
use pipeline::design::System;
use pipeline::design::coating::{Coating, CoatingTable};
use pipeline::design::coatings::Coatings;
use std::collections::BTreeMap;

/// Most coatings of a file, layers of a coating, rows of a table.
const MAX_COATINGS: usize = 1000;
const MAX_LAYERS: usize = 200;
const MAX_ROWS: usize = 10_000;
/// Bounds of n, k and of a layer's thickness in µm.
const N: std::ops::RangeInclusive<f64> = 0.01..=10.0;
const K: std::ops::RangeInclusive<f64> = 0.0..=100.0;
const THICKNESS_UM: std::ops::RangeInclusive<f64> = 0.0..=100.0;

/// Index of magnesium fluoride, taken without dispersion.
const MGF2: f64 = 1.38;
/// Wavelength of `mgf2` without one, nm.
const MGF2_NM: f64 = 550.0;

/// Coatings of a file by upper-case name. A coating that cannot be used is an error only where a surface has it.
#[derive(Clone, Debug, Default)]
pub struct CoatingFile {
    named: BTreeMap<String, Result<Coating, String>>,
    /// Of boundaries with air that are not named.
    default: Option<String>,
    /// Surface number from 1, and the name of its coating.
    surfaces: Vec<(usize, String)>,
}

fn error(problem: impl Into<String>) -> LensFileError {
    LensFileError::Coating { problem: problem.into() }
}

/// The quarter wave of `mgf2` at `nm`.
pub fn mgf2(nm: Option<f64>) -> Coating {
    Coating::quarter_wave("mgf2", MGF2, nm.unwrap_or(MGF2_NM) / 1e3)
}

/// A coating of that transmittance and reflectance at all wavelengths and angles.
fn constant(name: &str, transmittance: f64, reflectance: f64) -> Coating {
    Coating::Table(CoatingTable {
        name: name.to_owned(),
        wavelengths_um: vec![0.55],
        angles_deg: vec![0.0],
        values: vec![[reflectance, reflectance, transmittance, transmittance]],
    })
}

/// A built-in coating; the inner `None` is `ideal`.
fn builtin(name: &str) -> Option<Option<Coating>> {
    let lower = name.to_ascii_lowercase();
    let share = |digits: &str| format!("0.{digits}").parse::<f64>().ok();
    match (lower.as_str(), lower.split_once('@')) {
        ("none", _) => Some(Some(Coating::Bare)),
        ("ideal", _) => Some(None),
        ("mgf2", _) => Some(Some(mgf2(None))),
        (_, Some(("mgf2", nm))) => {
            let nm = nm.parse().ok().filter(|nm| pipeline::bounds::WAVELENGTH_NM.contains(*nm))?;
            Some(Some(mgf2(Some(nm))))
        }
        _ => {
            let digits = lower
                .strip_prefix("i.")
                .filter(|d| !d.is_empty() && d.bytes().all(|b| b.is_ascii_digit()))?;
            share(digits).map(|t| Some(constant(name, t, 1.0 - t)))
        }
    }
}

impl CoatingFile {
    /// The coating `name`; the inner `None` passes all light.
    ///
    /// # Errors
    /// [`LensFileError::Coating`]: the name is not known (lists those that are), or its entry cannot be used.
    pub fn get(&self, name: &str) -> Result<Option<Coating>, LensFileError> {
        match self.named.get(&name.to_ascii_uppercase()) {
            Some(Ok(coating)) => Ok(Some(coating.clone())),
            Some(Err(problem)) => Err(error(format!("coating {name}: {problem}"))),
            None => {
                builtin(name).ok_or_else(|| error(format!("no coating `{name}`; there are {}", self.names())))
            }
        }
    }

    /// Whether it or the program has a coating of this name.
    pub fn has(&self, name: &str) -> bool {
        self.named.contains_key(&name.to_ascii_uppercase()) || builtin(name).is_some()
    }

    fn names(&self) -> String {
        let named = self.named.keys().map(String::as_str);
        let names: Vec<&str> = named.take(40).chain(["none", "ideal", "mgf2", "mgf2@NM"]).collect();
        let more = if self.named.len() > 40 { " and others" } else { "" };
        format!("{}{more}", names.join(", "))
    }

    /// Adds a coating.
    fn add(&mut self, name: &str, coating: Result<Coating, String>) -> Result<(), String> {
        if self.named.len() == MAX_COATINGS {
            return Err(format!("more than {MAX_COATINGS} coatings"));
        }
        self.named.insert(name.to_ascii_uppercase(), coating);
        Ok(())
    }

    /// The coatings that the file gives to the surfaces of a lens: its default, else none, and those it names.
    ///
    /// # Errors
    /// As [`CoatingFile::get`]; no surface has a coating.
    pub fn coatings(&self) -> Result<Coatings, LensFileError> {
        if self.default.is_none() && self.surfaces.is_empty() {
            return Err(error(
                "the file gives no surface a coating; name one in `default` or [surface] (bare surfaces: --coatings none)",
            ));
        }
        let default = match &self.default {
            Some(name) => self.get(name)?.unwrap_or(constant("ideal", 1.0, 0.0)),
            None => Coating::Bare,
        };
        let surface = |(number, name): &(usize, String)| {
            let index = number.checked_sub(1).ok_or_else(|| error("surfaces are counted from 1, found 0"))?;
            Ok::<_, LensFileError>((index, self.get(name)?))
        };
        Ok(Coatings { default, surfaces: self.surfaces.iter().map(surface).collect::<Result<_, _>>()? })
    }

    /// The coatings that a design names for its surfaces, by the entries of its coating file; other surfaces are bare. Notes for the user.
    ///
    /// # Errors
    /// Names that are not known; a coating that cannot be used.
    pub fn of_design(&self, system: &System) -> Result<(Coatings, Vec<String>), LensFileError> {
        let primary_nm = system.primary_um() * 1e3;
        let (mut surfaces, mut notes, mut unknown) = (Vec::new(), Vec::new(), Vec::<&str>::new());
        for (i, s) in system.surfaces.iter().enumerate().take(system.image()) {
            let Some(name) = s.coating_name.as_deref() else { continue };
            // An uncoated dummy surface or stop may carry a name.
            if !s.is_mirror && !system.is_boundary(i).0 {
                continue;
            }
            if self.has(name) {
                surfaces.push((i, self.get(name)?));
            } else if name.eq_ignore_ascii_case("AR") {
                notes.push(format!(
                    "coating AR of surface {}: a quarter wave of MgF2 at the primary wavelength, for want of its coating file",
                    i + 1
                ));
                surfaces.push((i, Some(mgf2(Some(primary_nm)))));
            } else if !unknown.contains(&name) {
                unknown.push(name);
            }
        }
        if !unknown.is_empty() {
            return Err(error(format!(
                "the design names the coatings {}, and its coating file is not beside it; give them with --coatings FILE, or \
                 --coatings none or mgf2",
                unknown.join(", ")
            )));
        }
        if system.surfaces.iter().all(|s| s.coating_name.is_none()) {
            notes.push("the design names no coatings: all surfaces are bare".to_owned());
        }
        Ok((Coatings { default: Coating::Bare, surfaces }, notes))
    }
}

/// Checks a film's index and thickness.
fn check_layer(n: f64, k: f64, thickness_um: f64) -> Result<(), String> {
    for (what, value, bound) in [("n", n, &N), ("k", k, &K)] {
        if !bound.contains(&value) {
            return Err(format!(
                "{what} of a layer is {value}, expected {} to {}",
                bound.start(),
                bound.end()
            ));
        }
    }
    if !THICKNESS_UM.contains(&thickness_um) {
        let (least, most) = (THICKNESS_UM.start(), THICKNESS_UM.end());
        let thickness_nm = 1e3 * thickness_um;
        return Err(format!(
            "a layer is {thickness_nm} nm ({thickness_um} µm) thick, expected {least} to {most} µm"
        ));
    }
    Ok(())
}

/// Checks the powers of a table.
fn check_powers([rs, rp, ts, tp]: [f64; 4]) -> Result<(), String> {
    let is_share = |v: f64| (0.0..=1.0 + 1e-6).contains(&v);
    match [rs, rp, ts, tp].into_iter().all(is_share) && rs + ts <= 1.0 + 1e-6 && rp + tp <= 1.0 + 1e-6 {
        true => Ok(()),
        false => Err(format!(
            "R_s {rs}, R_p {rp}, T_s {ts}, T_p {tp}: expected shares from 0 to 1 whose sums R + T are at most 1"
        )),
    }
}

#[cfg(test)]
mod tests;
