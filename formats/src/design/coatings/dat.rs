//! The coating file of the lens design program (`COATING.DAT`).
//!
//! ```text
//! MATE name            wavelength [µm], n, k with the sign −; a line each
//! COAT name            material, thickness, whether it is absolute [0], group of a loop [0], taper; a line a layer
//! IDEAL name T [R]     TABLE name     ANGL degrees     WAVE µm Rs Rp Ts Tp
//! ! comment
//! ```
//! A thickness is in primary wavelengths in the material, or in µm if absolute. Loops, tapers, `IDEAL2`, encrypted coatings and materials that the file does not
//! define make a coating unusable, which is an error only where a surface has it.

use super::{CoatingFile, MAX_LAYERS, MAX_ROWS, check_layer, check_powers, constant, csv, error};
use crate::design::error::LensFileError;
use crate::design::text::{decode, number};
use pipeline::design::coating::{Coating, Film, FilmIndex};
use std::collections::BTreeMap;

/// Longest file that is read.
const MAX_LINES: usize = 1_000_000;

/// Words of a layer, and their line.
type Layer = (usize, Vec<String>);

#[derive(Default)]
enum Open {
    #[default]
    Nothing,
    Material(String),
    /// Name, line of the name, layers.
    Coating(String, usize, Vec<Layer>),
    Table {
        name: String,
        /// Line of the name.
        line: usize,
        angle: Option<f64>,
        rows: Vec<(f64, f64, [f64; 4])>,
        /// What is wrong with the first row that cannot be.
        problem: Option<String>,
    },
}

/// `problem` with its line.
fn at_line(line: usize, problem: &str) -> String {
    format!("line {line} of the coating file: {problem}")
}

/// Reads a coating file for a lens of the primary wavelength `primary_um`.
///
/// # Errors
/// [`LensFileError::Coating`]: a line that no coating file has.
pub fn parse(bytes: &[u8], primary_um: f64) -> Result<CoatingFile, LensFileError> {
    let mut reader = Reader { primary_um, ..Reader::default() };
    for (i, line) in decode(bytes).lines().enumerate() {
        let words: Vec<&str> = line.split('!').next().unwrap_or_default().split_whitespace().collect();
        if words.is_empty() {
            continue;
        }
        let result = match i < MAX_LINES {
            true => reader.line(i + 1, &words),
            false => Err(format!("more than {MAX_LINES} lines")),
        };
        result.map_err(|problem| error(at_line(i + 1, &problem)))?;
    }
    reader.close().map_err(error)?;
    reader.finish().map_err(error)
}

#[derive(Default)]
struct Reader {
    primary_um: f64,
    file: CoatingFile,
    materials: BTreeMap<String, Vec<(f64, f64, f64)>>,
    open: Open,
    /// Layers wait for materials that follow them.
    coatings: Vec<(String, usize, Vec<Layer>)>,
}

impl Reader {
    /// Reads the words of a line.
    fn line(&mut self, line: usize, words: &[&str]) -> Result<(), String> {
        let name = || words.get(1).map(|w| (*w).to_owned()).ok_or("the name is missing");
        match words[0].to_ascii_uppercase().as_str() {
            "MATE" => {
                self.close()?;
                let name = name()?.to_ascii_uppercase();
                self.materials.insert(name.clone(), Vec::new());
                self.open = Open::Material(name);
            }
            "COAT" => {
                self.close()?;
                self.open = Open::Coating(name()?, line, Vec::new());
            }
            "TABLE" => {
                self.close()?;
                let (name, rows) = (name()?, Vec::new());
                self.open = Open::Table { name, line, angle: None, rows, problem: None };
            }
            "IDEAL" => {
                self.close()?;
                let shares: Option<Vec<f64>> = words.iter().skip(2).map(|w| number(w)).collect();
                let shares = shares.filter(|s| !s.is_empty()).ok_or("expected IDEAL name T [R]")?;
                let (t, r) = (shares[0], shares.get(1).copied().unwrap_or(1.0 - shares[0]));
                let coating = check_powers([r, r, t, t]).map(|()| constant(words[1], t, r));
                let coating = coating.map_err(|problem| at_line(line, &problem));
                self.file.add(&name()?, coating)?;
            }
            keyword @ ("IDEAL2" | "ENCRYPTED") => {
                self.close()?;
                self.file.add(&name()?, Err(at_line(line, &format!("{keyword} is not read"))))?;
            }
            "TAPR" => {
                self.close()?;
                self.open = Open::Nothing;
            }
            keyword => self.continued(line, keyword, words)?,
        }
        Ok(())
    }

    /// A line of the open entry.
    fn continued(&mut self, line: usize, keyword: &str, words: &[&str]) -> Result<(), String> {
        let numbers = |words: &[&str]| words.iter().map(|w| number(w)).collect::<Option<Vec<f64>>>();
        match &mut self.open {
            Open::Material(name) => {
                let row = numbers(words).filter(|n| n.len() >= 2);
                let row = row.ok_or_else(|| format!("`{}` is not a wavelength, n and k", words.join(" ")))?;
                let entries = self.materials.entry(name.clone()).or_default();
                if entries.len() < MAX_ROWS {
                    entries.push((row[0], row[1], row.get(2).map_or(0.0, |k| -k)));
                }
            }
            Open::Coating(_, _, layers) if layers.len() <= MAX_LAYERS => {
                layers.push((line, words.iter().map(|w| (*w).to_owned()).collect()));
            }
            Open::Table { angle, rows, problem, .. } => match (keyword, numbers(&words[1..]), *angle) {
                ("ANGL", Some(n), _) if n.len() == 1 => *angle = Some(n[0]),
                ("WAVE", Some(n), Some(angle)) if n.len() >= 5 && rows.len() < MAX_ROWS => {
                    let powers = [n[1], n[2], n[3], n[4]];
                    if problem.is_none() {
                        *problem = check_powers(powers).err().map(|found| at_line(line, &found));
                    }
                    rows.push((n[0], angle, powers));
                }
                _ => return Err(format!("`{}` is not ANGL degrees or WAVE µm Rs Rp Ts Tp", words.join(" "))),
            },
            // The rest of an entry that is not read, such as the points of a taper.
            Open::Coating(..) | Open::Nothing => {}
        }
        Ok(())
    }

    fn close(&mut self) -> Result<(), String> {
        match std::mem::take(&mut self.open) {
            Open::Nothing | Open::Material(_) => Ok(()),
            Open::Coating(name, line, layers) => {
                self.coatings.push((name, line, layers));
                Ok(())
            }
            Open::Table { name, line, rows, problem, .. } => {
                let grid = || csv::grid(&name, rows).map_err(|found| at_line(line, &found));
                let table = problem.map_or_else(grid, Err).map(Coating::Table);
                self.file.add(&name, table)
            }
        }
    }

    fn finish(mut self) -> Result<CoatingFile, String> {
        for (name, line, layers) in std::mem::take(&mut self.coatings) {
            let film = |(line, words): &Layer| self.film(words).map_err(|problem| at_line(*line, &problem));
            let films = match layers.len() {
                0 => Err(at_line(line, "it has no layer")),
                n if n > MAX_LAYERS => Err(at_line(line, &format!("it has more than {MAX_LAYERS} layers"))),
                _ => layers.iter().map(film).collect(),
            };
            self.file.add(&name, films.map(Coating::Films))?;
        }
        Ok(self.file)
    }

    fn film(&self, layer: &[String]) -> Result<Film, String> {
        let figure = |i: usize| layer.get(i).map_or(Some(0.0), |w| number(w));
        let numbers = (figure(1), figure(2), figure(3));
        let (Some(thickness), Some(is_absolute), Some(group)) = numbers else {
            return Err(format!("layer `{}`: expected a material and a thickness", layer.join(" ")));
        };
        if group != 0.0 || layer.len() > 4 {
            return Err(format!("layer `{}`: loops and tapers are not read", layer.join(" ")));
        }
        let mut entries = match self.materials.get(&layer[0].to_ascii_uppercase()) {
            Some(entries) if !entries.is_empty() => entries.clone(),
            _ => return Err(format!("the file does not define its material {}", layer[0])),
        };
        entries.sort_by(|a, b| a.0.total_cmp(&b.0));
        entries.dedup_by(|a, b| a.0 == b.0);
        let index = FilmIndex { name: layer[0].clone(), entries };
        let thickness_um = match is_absolute != 0.0 {
            true => thickness,
            false => {
                let at_primary = index.at(self.primary_um).map_err(|e| e.to_string())?;
                thickness * self.primary_um / at_primary.re
            }
        };
        index.entries.iter().try_for_each(|(_, n, k)| check_layer(*n, *k, thickness_um))?;
        Ok(Film { index, thickness_um })
    }
}
