//! Coatings of a design: `--coatings`.

use super::bytes::read_bytes;
use crate::args::CoatingsArg;
use crate::failure::usage;
use anyhow::{Context, Result};
use formats::design::coatings::{self, CoatingFile, dat, mgf2, toml};
use formats::design::zar::Member;
use pipeline::design::System;
use pipeline::design::coating::Coating;
use pipeline::design::coatings::Coatings;
use std::path::{Path, PathBuf};

/// The coating file of a design: its name in the design, and what its archive has.
#[derive(Default)]
pub(super) struct DesignCoatings {
    /// The design.
    pub(super) path: PathBuf,
    /// As the design names it.
    pub(super) name: Option<String>,
    /// Coating files in its archive.
    pub(super) members: Vec<Member>,
}

/// `system` with the coatings of `--coatings`.
///
/// # Errors
/// A file that cannot be read; a coating that is not known or cannot be used; a surface that the design does not have.
pub(super) fn coat(system: System, given: &CoatingsArg, design: &DesignCoatings) -> Result<System> {
    let of_all = |default| Ok((Coatings { default, surfaces: Vec::new() }, Vec::new()));
    let coatings: Result<_> = match given {
        CoatingsArg::Ideal => return Ok(system),
        CoatingsArg::Bare => of_all(Coating::Bare),
        CoatingsArg::Mgf2(nm) => of_all(mgf2(*nm)),
        CoatingsArg::Design => Ok(design.file(system.primary_um())?.of_design(&system)?),
        CoatingsArg::File(path) => {
            let reading = || format!("--coatings {}", path.display());
            let file = read(path, system.primary_um()).with_context(reading)?;
            // Names of the design program are those of its own files.
            let is_dat = is_dat(path);
            Ok(match is_dat {
                true => file.of_design(&system).with_context(reading)?,
                false => (file.coatings().with_context(reading)?, Vec::new()),
            })
        }
    };
    let (coatings, notes) = coatings?;
    let mut system = system.with_coatings(&coatings)?;
    system.notes.extend(notes);
    Ok(system)
}

fn is_dat(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("dat"))
}

/// Reads a file of coatings: TOML, or that of the lens design program.
fn read(path: &Path, primary_um: f64) -> Result<CoatingFile> {
    let bytes = read_bytes(path)?;
    if is_dat(path) {
        return Ok(dat::parse(&bytes, primary_um)?);
    }
    let text = String::from_utf8(bytes).context("the file is not text in UTF-8")?;
    let folder = path.parent().unwrap_or(Path::new("."));
    let beside = |name: &str| {
        let bytes = read_bytes(&folder.join(name)).map_err(|e| crate::failure::line(&e))?;
        String::from_utf8(bytes).map_err(|_| "the file is not text in UTF-8".to_owned())
    };
    Ok(toml::parse(&text, &beside)?)
}

/// Tables that a file of coatings names; none of one that is not read.
pub fn coating_tables(path: &Path) -> Vec<PathBuf> {
    let folder = path.parent().unwrap_or(Path::new("."));
    let is_regular = path.metadata().is_ok_and(|m| m.is_file());
    let bytes = if is_regular && !is_dat(path) { read_bytes(path).unwrap_or_default() } else { Vec::new() };
    toml::tables_beside(&String::from_utf8_lossy(&bytes)).iter().map(|name| folder.join(name)).collect()
}

/// Files beside the design with the name of its coating file, ignoring case, sorted.
pub(super) fn named_beside(design: &Path, name: &str) -> Vec<PathBuf> {
    let folder = design.parent().filter(|d| !d.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let paths = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut found: Vec<PathBuf> =
        paths.filter(|path| path.file_name().is_some_and(|n| n.eq_ignore_ascii_case(name))).collect();
    found.sort();
    found
}

impl DesignCoatings {
    /// The coating file that the design names, in its archive or beside it; without one, the built-in coatings.
    fn file(&self, primary_um: f64) -> Result<CoatingFile> {
        let Some(name) = &self.name else { return Ok(CoatingFile::default()) };
        if let Some(member) = self.members.iter().find(|m| m.name.eq_ignore_ascii_case(name)) {
            return dat::parse(&member.data, primary_um).with_context(|| format!("reading {}", member.name));
        }
        let found = named_beside(&self.path, name);
        let same_case = found.iter().position(|path| path.file_name().is_some_and(|n| n == name.as_str()));
        let path = match (&found[..], same_case) {
            ([], _) => return Ok(CoatingFile::default()),
            ([path], _) => path,
            (_, Some(k)) => &found[k],
            ([first, second, ..], None) => {
                return Err(usage(format!(
                    "the design names the coating file {name}, and {} and {} differ in letters' case alone: give one of them to --coatings, or rename one",
                    first.display(),
                    second.display()
                )));
            }
        };
        read(path, primary_um).with_context(|| format!("reading {}", path.display()))
    }
}

/// Transmission on the axis that a quarter wave of MgF2 would leave a lens whose coatings are ideal, at `wavelengths_nm`; none of a lens with
/// coatings.
pub fn note_on_ideal(system: &System, wavelengths_nm: &[f64]) -> Option<String> {
    let is_coated = system.surfaces.iter().any(|s| s.coating.is_some());
    let (first, last) = (wavelengths_nm.first()?, wavelengths_nm.last()?);
    let nm: Vec<f64> = if first == last { vec![*first] } else { vec![*first, *last] };
    let coatings = Coatings { default: coatings::mgf2(None), surfaces: Vec::new() };
    let coated = system.clone().with_coatings(&coatings).ok().filter(|_| !is_coated)?;
    let at = |nm: &f64| {
        let left = pipeline::design::illumination::axial_transmission(&coated, nm / 1e3).ok()?;
        Some(format!("{left:.2} at {nm} nm"))
    };
    let figures: Vec<String> = nm.iter().map(at).collect::<Option<_>>()?;
    Some(format!(
        "transmission 1: reflections and absorption of the lens are left out; --coatings mgf2 would leave {}",
        figures.join(" and ")
    ))
}
