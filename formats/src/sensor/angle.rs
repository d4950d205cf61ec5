//! The response of pixels over the angle of incidence and plates in front of them: `angle` and `plate` of a description, with their tables in CSV.
//!
//! | table | columns |
//! |---|---|
//! | response | `angle_deg` in air, ascending, 0 among or between them, and `response`; or `horizontal` and `vertical`: tilted along rows and along columns |
//! | the same by wavelength | `response_450`, `response_550`, …; or `horizontal_450`, `vertical_450`, …: nm, in any order |
//! | microlenses | `height_mm` from the axis, ascending from 0, and `cra_deg`, the chief-ray angle for which they are shifted |
//! | plate | `wavelength_nm` and `transmittance` at normal incidence |

use std::path::Path;

use pipeline::bounds::WAVELENGTH_NM;
use pipeline::real;
use pipeline::sensor::Curve;
use pipeline::sensor::angle::{
    Acceptance, AngularResponse, Microlenses, Plate, PlateKind, Response, SlopeTable, radians, slope,
};
use serde::{Deserialize, Serialize};

use super::Curves;
use super::error::SensorError;
use super::table::{self, Quantity, names_of};
use super::text::{AcceptanceText, AngleText, CENTRED, OF_LENS, PlateText, PlateWord};

/// Largest angle, degrees.
const MAX_DEG: f64 = 85.0;
/// Range of an index.
const INDEX: (f64, f64) = (1.0, 4.0);
/// Exponents of a response by its half width.
const EXPONENTS: [u32; 4] = [2, 4, 6, 8];
/// Largest response in a table.
const MAX_RESPONSE: f64 = 1e6;
/// Wavelengths of a response, at most.
const MAX_WAVELENGTHS: usize = 64;
/// Columns of responses.
const RESPONSES: [&str; 3] = ["response", "horizontal", "vertical"];

/// `angle` with the content of its tables.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub(super) struct AngleFile {
    stack_index: f64,
    microlenses: MicrolensFile,
    /// By channel.
    channels: Vec<AcceptanceFile>,
}

#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
enum MicrolensFile {
    Centred,
    Lens,
    Table { height_mm: Vec<f64>, cra_deg: Vec<f64> },
}

#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
enum AcceptanceFile {
    Model { acceptance_deg: f64, exponent: u32 },
    Radial { angle_deg: Vec<f64>, response: Vec<f64> },
    Separable { angle_deg: Vec<f64>, horizontal: Vec<f64>, vertical: Vec<f64> },
    Spectral { wavelength_nm: Vec<f64>, tables: Vec<Self> },
}

/// `plate` with the content of its table.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub(super) struct PlateFile {
    kind: PlateWord,
    index: f64,
    wavelength_nm: Vec<f64>,
    transmittance: Vec<f64>,
}

impl AngleFile {
    /// Of the channels `names`.
    pub(super) fn read(curves: &Curves<'_>, text: &AngleText, names: &[String]) -> Result<Self, SensorError> {
        if let Some(name) = text.filters.keys().find(|name| !names.contains(name)) {
            let expected = format!("filters of the pattern: {}", names.join(", "));
            return Err(curves.wrong(&format!("angle.filters.{name}"), &expected, "another name"));
        }
        let of = |name: &String| match text.filters.get(name) {
            Some(own) => acceptance(curves, &format!("angle.filters.{name}"), own),
            None => acceptance(curves, "angle", &text.of_all()),
        };
        let channels = names.iter().map(of).collect::<Result<_, _>>()?;
        let microlenses = match text.microlenses.as_str() {
            CENTRED => MicrolensFile::Centred,
            OF_LENS => MicrolensFile::Lens,
            file => {
                let (path, text) = curves.table("angle.microlenses", file)?;
                let rows = table::columns(&path, &text, ["height_mm", "cra_deg"])?;
                let (height_mm, cra_deg) = rows.iter().map(|(_, [h, cra])| (*h, *cra)).unzip();
                MicrolensFile::Table { height_mm, cra_deg }
            }
        };
        let angle = Self { stack_index: text.stack_index, microlenses, channels };
        angle
            .check(names.len())
            .map_err(|(field, expected, found)| curves.wrong(&field, &expected, &found))?;
        Ok(angle)
    }

    /// Field, what is expected and what is found, of what is wrong with a description of `channels` channels.
    pub(super) fn check(&self, channels: usize) -> Result<(), (String, String, String)> {
        let wrong =
            |field: &str, expected: &str, found: String| Err((field.to_owned(), expected.to_owned(), found));
        if !(INDEX.0..=INDEX.1).contains(&self.stack_index) {
            return wrong("angle.stack_index", "1 to 4, e.g. 1.5", self.stack_index.to_string());
        }
        if self.channels.len() != channels {
            return wrong("angle", "a response of each filter", self.channels.len().to_string());
        }
        if let MicrolensFile::Table { height_mm, cra_deg } = &self.microlenses {
            let is_height = height_mm.first() == Some(&0.0) && height_mm.is_sorted_by(|a, b| a < b);
            if height_mm.len() < 2 || !is_height || cra_deg.len() != height_mm.len() {
                return wrong("angle.microlenses", "heights that ascend from 0 mm", format!("{height_mm:?}"));
            }
            if let Some(bad) = cra_deg.iter().find(|v| !(-MAX_DEG..=MAX_DEG).contains(*v)) {
                return wrong("angle.microlenses", "chief-ray angles of -85 to 85 degrees", bad.to_string());
            }
        }
        self.channels.iter().try_for_each(AcceptanceFile::check)
    }

    /// The response of the pipeline's sensor.
    pub(super) fn response(&self) -> AngularResponse {
        let n = self.stack_index;
        AngularResponse {
            stack_index: n,
            microlenses: match &self.microlenses {
                MicrolensFile::Centred => Microlenses::Centred,
                MicrolensFile::Lens => Microlenses::OfLens,
                MicrolensFile::Table { height_mm, cra_deg } => {
                    let sines = cra_deg.iter().map(|deg| sine(*deg));
                    Microlenses::Table(height_mm.iter().copied().zip(sines).collect())
                }
            },
            channels: self.channels.iter().map(|channel| channel.acceptance(n)).collect(),
        }
    }
}

fn sine(deg: f64) -> f64 {
    real::sin(radians(deg))
}

impl AcceptanceFile {
    /// As [`AngleFile::check`].
    fn check(&self) -> Result<(), (String, String, String)> {
        let wrong =
            |field: &str, expected: &str, found: String| Err((field.to_owned(), expected.to_owned(), found));
        match self {
            Self::Model { acceptance_deg, exponent } => {
                if !(*acceptance_deg > 0.0 && *acceptance_deg <= MAX_DEG) {
                    let expected = "above 0, at most 85 degrees";
                    return wrong("angle.acceptance_deg", expected, acceptance_deg.to_string());
                }
                match EXPONENTS.contains(exponent) {
                    true => Ok(()),
                    false => wrong("angle.exponent", "2, 4, 6 or 8", exponent.to_string()),
                }
            }
            Self::Radial { angle_deg, response } => check_table(angle_deg, &[response]),
            Self::Separable { angle_deg, horizontal, vertical } => {
                check_table(angle_deg, &[horizontal, vertical])
            }
            Self::Spectral { wavelength_nm, tables } => {
                let ascends = !wavelength_nm.is_empty() && wavelength_nm.is_sorted_by(|a, b| a < b);
                let is_table = |of: &Self| matches!(of, Self::Radial { .. } | Self::Separable { .. });
                if !ascends || tables.len() != wavelength_nm.len() || !tables.iter().all(is_table) {
                    return wrong(
                        "angle.file",
                        "a table at each of ascending wavelengths",
                        "other ones".into(),
                    );
                }
                tables.iter().try_for_each(Self::check)
            }
        }
    }

    /// The responses in layers of the index `stack_index`.
    fn acceptance(&self, stack_index: f64) -> Acceptance {
        let table = |angle_deg: &[f64], values: &[f64]| {
            let sines: Vec<f64> = angle_deg.iter().map(|deg| sine(*deg)).collect();
            SlopeTable::new(&sines, values, stack_index)
        };
        let response = match self {
            Self::Model { acceptance_deg, exponent } => Response::Model {
                half_slope: slope(sine(*acceptance_deg), stack_index),
                half_exponent: exponent / 2,
            },
            Self::Radial { angle_deg, response } => Response::Radial(table(angle_deg, response)),
            Self::Separable { angle_deg, horizontal, vertical } => Response::Separable {
                horizontal: table(angle_deg, horizontal),
                vertical: table(angle_deg, vertical),
            },
            Self::Spectral { wavelength_nm, tables } => {
                let responses = tables.iter().flat_map(|of| of.acceptance(stack_index).responses);
                return Acceptance { wavelengths_nm: wavelength_nm.clone(), responses: responses.collect() };
            }
        };
        response.into()
    }
}

fn check_table(angle_deg: &[f64], columns: &[&Vec<f64>]) -> Result<(), (String, String, String)> {
    let wrong = |expected: &str, found: String| Err(("angle.file".to_owned(), expected.to_owned(), found));
    let ascends = angle_deg.len() >= 2 && angle_deg.is_sorted_by(|a, b| a < b);
    if !ascends || columns.iter().any(|column| column.len() != angle_deg.len()) {
        return wrong("rows of ascending angles", format!("{} rows", angle_deg.len()));
    }
    let (first, last) = (angle_deg[0], angle_deg[angle_deg.len() - 1]);
    // The same in all directions: from 0 on.
    let is_around = if columns.len() == 1 { first == 0.0 } else { first < 0.0 && last > 0.0 };
    if !is_around || first < -MAX_DEG || last > MAX_DEG {
        let expected = match columns.len() {
            1 => "angles from 0 to at most 85 degrees",
            _ => "angles from below 0 to above 0, within -85 and 85 degrees",
        };
        return wrong(expected, format!("{first} to {last}"));
    }
    for column in columns {
        if let Some(bad) = column.iter().find(|v| !(0.0..=MAX_RESPONSE).contains(*v)) {
            return wrong("responses of 0 or more", bad.to_string());
        }
        let at = angle_deg.partition_point(|a| *a <= 0.0);
        if column[at - 1] <= 0.0 || (angle_deg[at - 1] < 0.0 && column[at] <= 0.0) {
            return wrong("a response above 0 at 0 degrees", "0".into());
        }
    }
    Ok(())
}

fn acceptance(
    curves: &Curves<'_>,
    field: &str,
    text: &AcceptanceText,
) -> Result<AcceptanceFile, SensorError> {
    let file = match (text.acceptance_deg, &text.file) {
        (Some(acceptance_deg), None) => {
            return Ok(AcceptanceFile::Model {
                acceptance_deg,
                exponent: text.exponent.unwrap_or(EXPONENTS[0]),
            });
        }
        (None, Some(file)) if text.exponent.is_none() => file,
        (None, Some(_)) => {
            return Err(curves.wrong(&format!("{field}.exponent"), "none beside a file", "one"));
        }
        (both, _) => {
            let found = if both.is_some() { "both" } else { "neither" };
            return Err(curves.wrong(field, "either acceptance_deg or file", found));
        }
    };
    let (path, text) = curves.table(&format!("{field}.file"), file)?;
    let head = text.lines().find(|line| !line.trim().is_empty()).unwrap_or_default();
    let names = names_of(head);
    let fail = |problem: String| SensorError::Table { path: path.clone(), problem };
    let read = |wavelength: &str| acceptance_table(&path, &text, &names, wavelength);
    let mut spectral: Vec<(f64, &str)> = names.iter().filter_map(|name| wavelength_of(name)).collect();
    if spectral.is_empty() {
        return read("");
    }
    if let Some(plain) = RESPONSES.iter().find(|column| names.contains(column)) {
        return Err(fail(format!(
            "has the column {plain} beside columns by wavelength: expected one or the others"
        )));
    }
    spectral.sort_by(|a, b| a.0.total_cmp(&b.0).then_with(|| a.1.cmp(b.1)));
    spectral.dedup();
    if spectral.len() > MAX_WAVELENGTHS {
        return Err(fail(format!(
            "responses at {} wavelengths, expected at most {MAX_WAVELENGTHS}",
            spectral.len()
        )));
    }
    for (nm, _) in &spectral {
        WAVELENGTH_NM.check(*nm).map_err(|e| fail(format!("in the name of a column: {e}")))?;
    }
    if let Some(twice) = spectral.windows(2).find(|two| two[0].0 == two[1].0) {
        return Err(fail(format!(
            "{} nm stands in the names of columns as {} and {}",
            twice[0].0, twice[0].1, twice[1].1
        )));
    }
    Ok(AcceptanceFile::Spectral {
        wavelength_nm: spectral.iter().map(|(nm, _)| *nm).collect(),
        tables: spectral.iter().map(|(_, text)| read(text)).collect::<Result<_, _>>()?,
    })
}

/// The wavelength in the name of a column of a response, nm, and as it is written there: of `response_450` 450 and `450`.
fn wavelength_of(name: &str) -> Option<(f64, &str)> {
    let text = RESPONSES.iter().find_map(|column| name.strip_prefix(column))?.strip_prefix('_')?;
    Some((text.parse().ok()?, text))
}

/// Angles and responses of the columns whose names have the wavelength `wavelength`; none if it is empty.
fn acceptance_table(
    path: &Path,
    text: &str,
    names: &[&str],
    wavelength: &str,
) -> Result<AcceptanceFile, SensorError> {
    let [response, horizontal, vertical] = RESPONSES.map(|column| match wavelength {
        "" => column.to_owned(),
        nm => format!("{column}_{nm}"),
    });
    if names.contains(&&*response) {
        let rows = table::columns(path, text, ["angle_deg", &response])?;
        let (angle_deg, response) = rows.iter().map(|(_, [angle, v])| (*angle, *v)).unzip();
        return Ok(AcceptanceFile::Radial { angle_deg, response });
    }
    let rows = table::columns(path, text, ["angle_deg", &horizontal, &vertical])?;
    let column = |k: usize| rows.iter().map(|(_, row)| row[k]).collect();
    Ok(AcceptanceFile::Separable { angle_deg: column(0), horizontal: column(1), vertical: column(2) })
}

impl PlateFile {
    pub(super) fn read(curves: &Curves<'_>, text: &PlateText) -> Result<Self, SensorError> {
        let (path, table) = curves.table("plate.file", &text.file)?;
        let curve = table::curve(&path, &table, "transmittance", Quantity::Share("transmittance"))?;
        let Curve { wavelengths_nm, values } = curve;
        let plate =
            Self { kind: text.kind, index: text.index, wavelength_nm: wavelengths_nm, transmittance: values };
        plate.check().map_err(|(field, expected, found)| curves.wrong(&field, &expected, &found))?;
        Ok(plate)
    }

    /// As [`AngleFile::check`].
    pub(super) fn check(&self) -> Result<(), (String, String, String)> {
        let wrong =
            |field: &str, expected: &str, found: String| Err((field.to_owned(), expected.to_owned(), found));
        // Directions in air have sines up to 1.
        if !(self.index > INDEX.0 && self.index <= INDEX.1) {
            return wrong("plate.index", "above 1, at most 4, e.g. 1.52", self.index.to_string());
        }
        let ascends = self.wavelength_nm.is_sorted_by(|a, b| a < b);
        if !ascends || self.wavelength_nm.len() < 2 || self.transmittance.len() != self.wavelength_nm.len() {
            return wrong("plate.file", "two rows of ascending wavelengths or more", "other ones".into());
        }
        match self.transmittance.iter().find(|v| !(0.0..=1.0).contains(*v)) {
            None => Ok(()),
            Some(bad) => wrong("plate.file", "transmittances of 0 to 1", bad.to_string()),
        }
    }

    pub(super) fn plate(&self) -> Plate {
        Plate {
            curve: Curve { wavelengths_nm: self.wavelength_nm.clone(), values: self.transmittance.clone() },
            kind: match self.kind {
                PlateWord::Interference => PlateKind::Interference,
                PlateWord::Absorbing => PlateKind::Absorbing,
            },
            index: self.index,
        }
    }
}
