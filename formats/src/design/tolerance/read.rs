//! The entries of a description.

use std::path::{Path, PathBuf};

use pipeline::bounds::WAVELENGTH_NM;
use pipeline::design::System;
use pipeline::design::tolerance::{
    Compensation, Criterion, Direction, Figure, Law, Limits, Pivot, Quantity, RadiusUnit, Target, Tolerance,
    Tolerances,
};

use super::error::ToleranceFileError as Error;
use super::limits::{law_of, limits};
use super::settings::{COMPENSATE, CRITERION, compensation, criterion};
use crate::toml_table::{Entry, Source, TableError};

/// Test wavelength where a description names none: the mercury line e of ISO 10110, nm.
pub(super) const FRINGE_NM: f64 = 546.1;

/// Most errors of a description.
const MAX_ERRORS: usize = 20_000;

const ROOT: &[&str] =
    &["tolerances", "element", "surface", "gap", "glass", "film", "compensate", "criterion"];
const DEFAULTS: &[&str] = &["law", "fringe_nm"];
const ELEMENT: &[&str] = &[
    "surfaces",
    "decentre_um",
    "decentre_x_um",
    "decentre_y_um",
    "radial",
    "tilt_arcmin",
    "tilt_x_arcmin",
    "tilt_y_arcmin",
    "tilt_radial",
    "pivot",
    "pivot_offset_mm",
    "wedge_arcmin",
    "wedge_x_arcmin",
    "wedge_y_arcmin",
    "wedge_radial",
    "shift_um",
];
const SURFACE: &[&str] = &[
    "surface",
    "radius_percent",
    "radius_fringes",
    "radius_um",
    "irregularity_fringes",
    "figure",
    "zernike",
    "conic",
    "decentre_um",
    "decentre_x_um",
    "decentre_y_um",
    "radial",
    "tilt_arcmin",
    "tilt_x_arcmin",
    "tilt_y_arcmin",
    "tilt_radial",
];
const GAP: &[&str] = &["after", "thickness_um", "absorb"];
const GLASS: &[&str] = &["after", "index", "abbe_percent"];
const FILM: &[&str] = &[
    "decentre_um",
    "decentre_x_um",
    "decentre_y_um",
    "radial",
    "tilt_arcmin",
    "tilt_x_arcmin",
    "tilt_y_arcmin",
    "tilt_radial",
    "shift_um",
];

/// A description of the errors of a lens.
#[derive(Clone, Debug, PartialEq)]
pub struct ToleranceFile {
    path: PathBuf,
    /// The errors, in the order of the text.
    pub list: Vec<Tolerance>,
    /// The line of each.
    lines: Vec<usize>,
    /// Test wavelength, nm.
    pub fringe_nm: f64,
    /// Adjustments of each built lens.
    pub compensation: Compensation,
    /// What a lens is judged by.
    pub criterion: Criterion,
}

impl ToleranceFile {
    /// The description `text`; `path` is named in errors.
    ///
    /// # Errors
    /// [`ToleranceFileError`](Error) with the line.
    pub fn parse(path: &Path, text: &str) -> Result<Self, Error> {
        let source = Source { path, text };
        let tables = source.parse()?;
        let root = source.root(&tables, ROOT)?;
        let defaults = root.table("tolerances", DEFAULTS)?;
        let default = |key| defaults.as_ref().and_then(|d| d.field(key));
        let law = default("law").map_or(Ok(Law::default()), |field| law_of(&field))?;
        let fringe_nm = match default("fringe_nm") {
            Some(field) => {
                Some(field.number()?).filter(|nm| WAVELENGTH_NM.contains(*nm)).ok_or_else(|| {
                    field.error(format!("a wavelength in nm, {} to {}", WAVELENGTH_NM.min, WAVELENGTH_NM.max))
                })?
            }
            None => FRINGE_NM,
        };
        let mut found = Found { law, list: Vec::new(), lines: Vec::new() };
        for entry in root.tables("element", ELEMENT)? {
            found.entry(&entry, Found::element)?;
        }
        for entry in root.tables("surface", SURFACE)? {
            found.entry(&entry, Found::surface)?;
        }
        for entry in root.tables("gap", GAP)? {
            found.entry(&entry, Found::gap)?;
        }
        for entry in root.tables("glass", GLASS)? {
            found.entry(&entry, Found::glass)?;
        }
        for entry in root.tables("film", FILM)? {
            found.entry(&entry, Found::film)?;
        }
        let compensate = root.table("compensate", COMPENSATE)?;
        let judged = root.table("criterion", CRITERION)?;
        Ok(Self {
            path: path.into(),
            list: found.list,
            lines: found.lines,
            fringe_nm,
            compensation: compensate.as_ref().map_or(Ok(Compensation::default()), compensation)?,
            criterion: judged.as_ref().map_or(Ok(Criterion::default()), criterion)?,
        })
    }

    /// The errors of the nominal lens `system`.
    ///
    /// # Errors
    /// [`ToleranceFileError::Tolerance`](Error::Tolerance): a surface that the lens does not have, errors that are at odds.
    pub fn tolerances(&self, system: &System) -> Result<Tolerances, Error> {
        Tolerances::new(&self.list, self.fringe_nm, system).map_err(|source| Error::Tolerance {
            path: self.path.clone(),
            line: self.lines[source.index],
            other_line: source.other.map(|other| self.lines[other]),
            source: Box::new(source),
        })
    }
}

/// The errors of the entries so far.
struct Found {
    law: Law,
    list: Vec<Tolerance>,
    lines: Vec<usize>,
}

impl Found {
    /// An entry, which has one error at least.
    fn entry(
        &mut self,
        entry: &Entry<'_>,
        read: fn(&mut Self, &Entry<'_>) -> Result<(), TableError>,
    ) -> Result<(), TableError> {
        let before = self.list.len();
        read(self, entry)?;
        if self.list.len() == before {
            return Err(entry.error("has no error: expected one with its limits at least"));
        }
        if self.list.len() > MAX_ERRORS {
            return Err(
                entry.error(format!("is one too many: expected at most {MAX_ERRORS} errors in the file"))
            );
        }
        Ok(())
    }

    fn push(&mut self, target: Target, quantity: Quantity, limits: Limits, line: usize) {
        self.list.push(Tolerance { target, quantity, limits });
        self.lines.push(line);
    }

    /// The error of `key`, if it is there.
    fn add(
        &mut self,
        entry: &Entry<'_>,
        key: &str,
        target: Target,
        quantity: Quantity,
    ) -> Result<(), TableError> {
        if let Some(field) = entry.field(key) {
            self.push(target, quantity, limits(&field, self.law)?, field.line());
        }
        Ok(())
    }

    /// Errors along or about x and y: `both` sets the two, or where `radial` is true their size in a drawn direction.
    fn add_axes(
        &mut self,
        entry: &Entry<'_>,
        [both, x, y, radial]: [&str; 4],
        target: Target,
        quantity: fn(Direction) -> Quantity,
    ) -> Result<(), TableError> {
        let flag = entry.field(radial);
        let is_radial = entry.flag(radial)?;
        if let Some(field) = flag.filter(|_| is_radial && entry.field(both).is_none()) {
            return Err(field.error(format!("false, or {both}")));
        }
        if is_radial {
            self.add(entry, both, target, quantity(Direction::Radial))?;
        } else {
            self.add(entry, both, target, quantity(Direction::X))?;
            self.add(entry, both, target, quantity(Direction::Y))?;
        }
        self.add(entry, x, target, quantity(Direction::X))?;
        self.add(entry, y, target, quantity(Direction::Y))
    }

    fn add_decentre_and_tilt(&mut self, entry: &Entry<'_>, target: Target) -> Result<(), TableError> {
        let decentre = ["decentre_um", "decentre_x_um", "decentre_y_um", "radial"];
        self.add_axes(entry, decentre, target, Quantity::Decentre)?;
        let tilt = ["tilt_arcmin", "tilt_x_arcmin", "tilt_y_arcmin", "tilt_radial"];
        self.add_axes(entry, tilt, target, Quantity::Tilt)
    }

    fn element(&mut self, entry: &Entry<'_>) -> Result<(), TableError> {
        let expected = "[first, last], surface numbers";
        let [first, last] = entry.required("surfaces", expected)?.pair(expected)?;
        let (first, last) = (first.index()?, last.index()?);
        let target = Target::Element {
            first,
            last,
            pivot: Pivot {
                surface: entry.field("pivot").map_or(Ok(first), |field| field.index())?,
                offset_mm: entry.field("pivot_offset_mm").map_or(Ok(0.0), |field| field.number())?,
            },
        };
        self.add_decentre_and_tilt(entry, target)?;
        let wedge = ["wedge_arcmin", "wedge_x_arcmin", "wedge_y_arcmin", "wedge_radial"];
        self.add_axes(entry, wedge, target, Quantity::Wedge)?;
        self.add(entry, "shift_um", target, Quantity::Shift)
    }

    fn surface(&mut self, entry: &Entry<'_>) -> Result<(), TableError> {
        let target = Target::Surface(entry.required("surface", "a surface number")?.index()?);
        for (key, unit) in [
            ("radius_percent", RadiusUnit::Percent),
            ("radius_fringes", RadiusUnit::Fringes),
            ("radius_um", RadiusUnit::Um),
        ] {
            self.add(entry, key, target, Quantity::Radius(unit))?;
        }
        self.figure(entry, target)?;
        self.add(entry, "conic", target, Quantity::Conic)?;
        self.add_decentre_and_tilt(entry, target)
    }

    fn figure(&mut self, entry: &Entry<'_>, target: Target) -> Result<(), TableError> {
        let words =
            [("astigmatism", Some(Figure::Astigmatism)), ("mixed", Some(Figure::Mixed)), ("zernike", None)];
        let (size, terms) = (entry.field("irregularity_fringes"), entry.field("zernike"));
        let figure = match entry.field("figure") {
            Some(field) => {
                let figure = field.word(&words)?;
                let (key, is_there) = match figure {
                    Some(_) => ("irregularity_fringes", size.is_some()),
                    None => ("zernike", terms.is_some()),
                };
                if !is_there {
                    return Err(field.error(format!("none without {key}")));
                }
                figure
            }
            None => size.as_ref().map(|_| Figure::Astigmatism),
        };
        match figure {
            Some(figure) => {
                self.add(entry, "irregularity_fringes", target, Quantity::Irregularity(figure))?
            }
            None => {
                if let Some(field) = size {
                    return Err(field.error("none where figure = \"zernike\": its size is rms_waves"));
                }
            }
        }
        let Some(field) = terms else { return Ok(()) };
        if figure.is_some() {
            return Err(field.error("none but where figure = \"zernike\""));
        }
        let zernike = field.table("zernike".to_owned(), &["terms", "rms_waves"])?;
        let expected = "[first, last], numbers of Zernike terms (standard) from 4 to 231";
        let range = zernike.required("terms", expected)?;
        let [first, last] = range.pair(expected)?;
        let (first, last) = (first.index()?, last.index()?);
        if !(4 <= first && first <= last && last <= 231) {
            return Err(range.error(expected));
        }
        let size = zernike.required("rms_waves", "a number of waves")?;
        let rms = limits(&size, self.law)?;
        if rms.low != -rms.high {
            return Err(size.error("one number (±)"));
        }
        let each = rms.high / ((last - first + 1) as f64).sqrt();
        for term in first..=last {
            let one = Limits::symmetric(each, rms.law);
            self.push(target, Quantity::Zernike(term as u32), one, size.line());
        }
        Ok(())
    }

    fn gap(&mut self, entry: &Entry<'_>) -> Result<(), TableError> {
        let after = entry.required("after", "the number of the surface before the gap")?.index()?;
        let absorb = entry.field("absorb").map(|field| field.index()).transpose()?;
        self.add(entry, "thickness_um", Target::Gap { after, absorb }, Quantity::Thickness)
    }

    fn glass(&mut self, entry: &Entry<'_>) -> Result<(), TableError> {
        let after = entry.required("after", "the number of the surface before the glass")?.index()?;
        self.add(entry, "index", Target::Glass(after), Quantity::Index)?;
        self.add(entry, "abbe_percent", Target::Glass(after), Quantity::Abbe)
    }

    fn film(&mut self, entry: &Entry<'_>) -> Result<(), TableError> {
        self.add_decentre_and_tilt(entry, Target::Film)?;
        self.add(entry, "shift_um", Target::Film, Quantity::Shift)
    }
}
