//! What pixels collect of the light of their neighbours: `crosstalk` of a description, with its tables in CSV.
//!
//! | table | columns |
//! |---|---|
//! | `file` | `wavelength_nm`, ascending, one row or more, and a column `DOWN:RIGHT` for each pixel around (`0:1` is the next one in the row), up to 3 pixels away: its share of the charge of a pixel. The rest stays; a column `0:0` is checked to be it |
//! | `absorption` | `wavelength_nm` and `absorption_per_um`, 1/µm; built in: `silicon-absorption.csv` |

use std::path::Path;

use pipeline::sensor::Crosstalk;
use pipeline::sensor::crosstalk::{MAX_RADIUS, with_rest};
use pipeline::sensor::diffusion::{self, Silicon};
use serde::{Deserialize, Serialize};

use super::Curves;
use super::error::SensorError;
use super::table::{self, names_of};
use super::text::CrosstalkText;

/// Absorption where a description names none.
const SILICON: &str = "silicon-absorption.csv";
/// Longest diffusion length and deepest depletion, µm; largest absorption, 1/µm.
const MAX_UM: f64 = 1000.0;
const MAX_PER_UM: f64 = 1e4;
/// What the shares of a row may differ from 1.
const ROUNDING: f64 = 1e-6;

/// `crosstalk` with the content of its tables.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub(super) struct CrosstalkFile {
    #[serde(skip_serializing_if = "Option::is_none")]
    table: Option<SharesFile>,
    #[serde(skip_serializing_if = "Option::is_none")]
    diffusion: Option<DiffusionFile>,
}

#[derive(Clone, Debug, Deserialize, Serialize)]
struct SharesFile {
    wavelength_nm: Vec<f64>,
    /// (down, right) of each column.
    places: Vec<(i8, i8)>,
    /// By wavelength, then column.
    shares: Vec<Vec<f64>>,
}

#[derive(Clone, Debug, Deserialize, Serialize)]
struct DiffusionFile {
    diffusion_length_um: f64,
    depletion_um: f64,
    wavelength_nm: Vec<f64>,
    absorption_per_um: Vec<f64>,
}

/// Field, what is expected and what is found.
type Wrong = (String, String, String);

fn wrong<T>(field: &str, expected: &str, found: impl ToString) -> Result<T, Wrong> {
    Err((field.to_owned(), expected.to_owned(), found.to_string()))
}

impl CrosstalkFile {
    pub(super) fn read(curves: &Curves<'_>, text: &CrosstalkText) -> Result<Self, SensorError> {
        let of_table = |file: &String| {
            let (path, text) = curves.table("crosstalk.file", file)?;
            shares(&path, &text)
        };
        let table = text.file.as_ref().map(of_table).transpose()?;
        let diffusion = match (text.diffusion_length_um, text.depletion_um) {
            (Some(diffusion_length_um), Some(depletion_um)) => {
                let file = text.absorption.as_deref().unwrap_or(SILICON);
                let (path, text) = curves.table("crosstalk.absorption", file)?;
                let rows = table::columns(&path, &text, ["wavelength_nm", "absorption_per_um"])?;
                let (wavelength_nm, absorption_per_um) = rows.iter().map(|(_, [nm, a])| (*nm, *a)).unzip();
                Some(DiffusionFile { diffusion_length_um, depletion_um, wavelength_nm, absorption_per_um })
            }
            (None, None) if text.absorption.is_none() => None,
            _ => {
                let (expected, found) =
                    ("both diffusion_length_um and depletion_um", "one, or an absorption alone");
                return Err(curves.wrong("crosstalk", expected, found));
            }
        };
        let file = Self { table, diffusion };
        file.check().map_err(|(field, expected, found)| curves.wrong(&field, &expected, &found))?;
        Ok(file)
    }

    /// As [`super::angle::AngleFile::check`].
    pub(super) fn check(&self) -> Result<(), Wrong> {
        if self.table.is_none() && self.diffusion.is_none() {
            return wrong("crosstalk", "a file, or diffusion_length_um and depletion_um", "neither");
        }
        self.table.as_ref().map_or(Ok(()), SharesFile::check)?;
        self.diffusion.as_ref().map_or(Ok(()), DiffusionFile::check)
    }

    /// Of pixels of this pitch and aperture.
    pub(super) fn crosstalk(&self, pitch_um: f64, aperture_um: f64) -> Crosstalk {
        let diffusion = self.diffusion.as_ref().map(|file| file.crosstalk(pitch_um, aperture_um));
        match (self.table.as_ref().map(SharesFile::crosstalk), diffusion) {
            (Some(table), Some(diffusion)) => table.and(&diffusion),
            (one, other) => one.or(other).expect("checked: one of the two is there"),
        }
    }
}

/// A table of shares.
fn shares(path: &Path, text: &str) -> Result<SharesFile, SensorError> {
    let fail = |problem: String| SensorError::Table { path: path.into(), problem };
    let head = text.lines().find(|line| !line.trim().is_empty()).unwrap_or_default();
    let place = |name: &str| -> Option<(i8, i8)> {
        let (down, right) = name.split_once(':')?;
        let along = |word: &str| {
            word.trim().parse().ok().filter(|v: &i8| usize::from(v.unsigned_abs()) <= MAX_RADIUS)
        };
        Some((along(down)?, along(right)?))
    };
    let mut wanted = vec!["wavelength_nm"];
    let mut places = Vec::new();
    for name in names_of(head).into_iter().filter(|name| *name != "wavelength_nm") {
        let Some(place) = place(name).filter(|place| !places.contains(place)) else {
            return Err(fail(format!(
                "column {name}: expected DOWN:RIGHT of a pixel within {MAX_RADIUS} pixels, once, e.g. 0:1 or -1:0"
            )));
        };
        wanted.push(name);
        places.push(place);
    }
    let mut file = SharesFile { wavelength_nm: Vec::new(), places, shares: Vec::new() };
    for (line, row) in table::rows(path, text, &wanted, 1)? {
        let own: f64 =
            std::iter::zip(&file.places, &row[1..]).filter(|(p, _)| **p == (0, 0)).map(|(_, v)| v).sum();
        let sum: f64 = row[1..].iter().sum();
        if file.places.contains(&(0, 0)) && (sum - 1.0).abs() > ROUNDING {
            return Err(fail(format!(
                "line {line}: expected shares whose sum is 1, found {sum} with {own} at 0:0"
            )));
        }
        file.wavelength_nm.push(row[0]);
        file.shares.push(row[1..].to_vec());
    }
    Ok(file)
}

impl SharesFile {
    fn check(&self) -> Result<(), Wrong> {
        let field = "crosstalk.file";
        let lines = self.shares.len() == self.wavelength_nm.len()
            && self.shares.iter().all(|row| row.len() == self.places.len());
        if !lines || self.wavelength_nm.is_empty() || !self.wavelength_nm.is_sorted_by(|a, b| a < b) {
            return wrong(field, "rows of ascending wavelengths", self.wavelength_nm.len());
        }
        let is_near = |v: i8| usize::from(v.unsigned_abs()) <= MAX_RADIUS;
        if !self.places.iter().any(|p| *p != (0, 0))
            || !self.places.iter().all(|(y, x)| is_near(*y) && is_near(*x))
        {
            return wrong(field, "columns of pixels around, e.g. 0:1", format!("{:?}", self.places));
        }
        if let Some(bad) = self.shares.iter().flatten().find(|v| !(0.0..=1.0).contains(*v)) {
            return wrong(field, "shares of 0 to 1", bad);
        }
        let moved = |row: &Vec<f64>| -> f64 {
            std::iter::zip(&self.places, row).filter(|(p, _)| **p != (0, 0)).map(|(_, v)| v).sum()
        };
        match self.shares.iter().map(moved).find(|sum| *sum > 1.0) {
            None => Ok(()),
            Some(sum) => wrong(field, "shares whose sum over the pixels around is at most 1", sum),
        }
    }

    fn crosstalk(&self) -> Crosstalk {
        let far = self.places.iter().map(|(y, x)| y.unsigned_abs().max(x.unsigned_abs()));
        let radius = usize::from(far.max().unwrap_or(0)).max(1);
        let side = 2 * radius + 1;
        let kernel = |row: &Vec<f64>| {
            let mut shares = vec![0.0; side * side];
            for ((down, right), share) in std::iter::zip(&self.places, row) {
                let at = |v: i8| (radius as isize + isize::from(v)) as usize;
                shares[at(*down) * side + at(*right)] = *share;
            }
            with_rest(shares)
        };
        Crosstalk {
            radius,
            wavelengths_nm: self.wavelength_nm.clone(),
            shares: self.shares.iter().map(kernel).collect(),
            farther: vec![0.0; self.wavelength_nm.len()],
        }
    }
}

impl DiffusionFile {
    fn check(&self) -> Result<(), Wrong> {
        for (field, value, is_right) in [
            ("crosstalk.diffusion_length_um", self.diffusion_length_um, self.diffusion_length_um > 0.0),
            ("crosstalk.depletion_um", self.depletion_um, self.depletion_um >= 0.0),
        ] {
            if !is_right || value > MAX_UM {
                return wrong(field, "a length of at most 1000 µm, above 0 for the diffusion length", value);
            }
        }
        let ascends = self.wavelength_nm.is_sorted_by(|a, b| a < b);
        if !ascends
            || self.wavelength_nm.is_empty()
            || self.wavelength_nm.len() != self.absorption_per_um.len()
        {
            return wrong("crosstalk.absorption", "rows of ascending wavelengths", self.wavelength_nm.len());
        }
        match self.absorption_per_um.iter().find(|v| !(**v > 0.0 && **v <= MAX_PER_UM)) {
            None => Ok(()),
            Some(bad) => wrong("crosstalk.absorption", "coefficients above 0, at most 10000 per µm", bad),
        }
    }

    fn crosstalk(&self, pitch_um: f64, aperture_um: f64) -> Crosstalk {
        let silicon =
            Silicon { diffusion_length_um: self.diffusion_length_um, depletion_um: self.depletion_um };
        let at = |alpha: &f64| {
            let (shares, farther) = silicon.shares(*alpha, pitch_um, aperture_um);
            (with_rest(shares), farther)
        };
        let (shares, farther) = self.absorption_per_um.iter().map(at).unzip();
        Crosstalk { radius: diffusion::RADIUS, wavelengths_nm: self.wavelength_nm.clone(), shares, farther }
    }
}
