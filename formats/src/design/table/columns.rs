//! Columns of a lens table.
//!
//! Names without case, blanks, hyphens and units: radius (r) or curvature (c); thickness (t, d, distance); glass (material; `mirror` reflects); n (nd) and V (vd, abbe);
//! dP_gF of a model glass; semi-diameter (sd) or diameter; aperture radius; obscuration radius; conic (k); ideal f (focal length of an ideal thin lens); a2, a4, a6, … and a1, a3, … of the asphere, the coefficients
//! of rⁿ. A unit in brackets must be that of the table. Columns for people (note, element, type) are skipped; others are ignored with a note.

use super::line::Line;
use super::units::{self, Unit};
use crate::design::error::LensFileError;

/// Meaning of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Column {
    Surface,
    Radius,
    Curvature,
    Thickness,
    Glass,
    Index,
    Abbe,
    PartialDispersion,
    SemiDiameter,
    Diameter,
    ApertureRadius,
    ObscurationRadius,
    Conic,
    IdealFocalLength,
    /// Coefficient of r^n.
    Coefficient(usize),
    Comment,
}

impl Column {
    /// Whether its values are lengths or their powers.
    fn has_length(self) -> bool {
        matches!(
            self,
            Self::Radius
                | Self::Curvature
                | Self::Thickness
                | Self::SemiDiameter
                | Self::Diameter
                | Self::ApertureRadius
                | Self::ObscurationRadius
                | Self::IdealFocalLength
                | Self::Coefficient(_)
        )
    }
}

/// Highest power of an asphere's column.
const MAX_POWER: usize = 60;

/// The name without units, signs and case.
pub(super) fn plain(name: &str) -> String {
    let bare = name.split(['(', '[']).next().unwrap_or_default();
    let bare = bare.trim().trim_end_matches(':').to_lowercase();
    let bare = bare.strip_suffix(" mm").unwrap_or(&bare);
    bare.chars().filter(|c| !matches!(c, ' ' | '-' | '_' | '.' | '\u{feff}' | '/' | '#')).collect()
}

fn column(name: &str) -> Option<Column> {
    let plain = plain(name);
    Some(match plain.as_str() {
        "surface" | "surf" | "no" | "number" | "" => Column::Surface,
        "radius" | "r" | "radiusofcurvature" | "roc" => Column::Radius,
        "curvature" | "c" | "curv" => Column::Curvature,
        "thickness" | "t" | "d" | "distance" | "spacing" | "separation" => Column::Thickness,
        "glass" | "material" | "medium" => Column::Glass,
        "n" | "nd" | "index" | "refractiveindex" => Column::Index,
        "v" | "vd" | "ν" | "νd" | "abbe" | "abbenumber" => Column::Abbe,
        "dpgf" | "δpgf" => Column::PartialDispersion,
        "semidiameter" | "sd" | "semiaperture" => Column::SemiDiameter,
        "diameter" | "dia" => Column::Diameter,
        "apertureradius" | "clearradius" => Column::ApertureRadius,
        "obscurationradius" | "obscuration" | "holeradius" | "innerradius" => Column::ObscurationRadius,
        "conic" | "k" | "κ" | "kappa" | "conicconstant" => Column::Conic,
        "idealf" | "idealfocallength" => Column::IdealFocalLength,
        "note" | "notes" | "comment" | "remark" | "element" | "type" => Column::Comment,
        _ => {
            let power = plain.strip_prefix(['a', 'α'])?.parse().ok()?;
            (1..=MAX_POWER).contains(&power).then_some(Column::Coefficient(power))?
        }
    })
}

/// Whether these cells are the header row.
pub(super) fn is_header(cells: &[String]) -> bool {
    let columns: Vec<Option<Column>> = cells.iter().map(|c| column(c)).collect();
    let has = |wanted: Column| columns.contains(&Some(wanted));
    (has(Column::Radius) || has(Column::Curvature)) && has(Column::Thickness)
}

/// The columns of a table.
pub(super) struct Columns {
    columns: Vec<Option<Column>>,
    pub(super) notes: Vec<String>,
}

impl Columns {
    /// `scale` is the lens unit in mm.
    pub(super) fn new(line: &Line<'_>, scale: f64, strict: bool) -> Result<Self, LensFileError> {
        let columns: Vec<Option<Column>> = line.cells.iter().map(|cell| column(cell)).collect();
        let mut notes = Vec::new();
        for (i, (cell, column)) in line.cells.iter().zip(&columns).enumerate() {
            if column.is_some_and(Column::has_length) {
                units::check(line, cell, Unit::Length(scale))?;
            }
            match column {
                None if strict => {
                    return Err(line.error(format!("column `{cell}` is not known, and --strict allows none")));
                }
                None => {
                    notes.push(format!("line {}: column `{cell}` is not known and was ignored", line.number))
                }
                Some(Column::Comment) => (),
                Some(Column::Surface) if cell.is_empty() => (),
                Some(column) if columns[..i].contains(&Some(*column)) => {
                    return Err(line.error(format!("column `{cell}` occurs twice")));
                }
                Some(_) => (),
            }
        }
        Ok(Self { columns, notes })
    }

    /// The cell of a column; empty if there is none.
    pub(super) fn cell<'a>(&self, line: &'a Line<'_>, wanted: Column) -> &'a str {
        self.columns.iter().position(|c| *c == Some(wanted)).map_or("", |i| line.cell(i))
    }

    /// Powers of the asphere's columns.
    pub(super) fn powers(&self) -> impl Iterator<Item = usize> {
        self.columns.iter().filter_map(|c| match c {
            Some(Column::Coefficient(power)) => Some(*power),
            _ => None,
        })
    }
}
