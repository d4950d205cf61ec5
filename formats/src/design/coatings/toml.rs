//! Coatings of a lens in TOML.
//!
//! ```toml
//! default = "bbar"                              # boundaries with air that are not named; else bare
//! [surface]                                     # numbers as `lens show` prints them
//! 1 = "mgf2"
//! [coating.bbar]
//! reflectance = [[400, 0.006], [450, 0.002]]    # nm, share; or one number
//! [coating.ircut]
//! layers = [["TiO2", 62.0], ["SiO2", 94.5]]     # thickness in nm, from the side of the lower index
//! [coating.measured]
//! table = "measured.csv"                        # beside this file
//! [material.TiO2]
//! n = [[400, 2.55, 0.0], [700, 2.30, 0.0]]      # nm, n, k; or one number
//! ```

use super::{CoatingFile, MAX_LAYERS, MAX_ROWS, check_layer, csv, error};
use crate::design::error::LensFileError;
use crate::toml_error::{line, located};
use ::toml::de::{DeTable, DeValue};
use ::toml::{Table, Value};
use pipeline::design::coating::{Coating, Film, FilmIndex, Spectrum};

/// What reads a table beside the file.
pub type ReadBeside<'a> = &'a dyn Fn(&str) -> Result<String, String>;

/// Reads the coatings in `text`; `beside` reads the tables that it names.
///
/// # Errors
/// [`LensFileError::Coating`] with the line, the entry and what is wrong with it.
pub fn parse(text: &str, beside: ReadBeside<'_>) -> Result<CoatingFile, LensFileError> {
    let table: Table = ::toml::from_str(text).map_err(|e| error(located(&e, text)))?;
    read(&table, text, beside).map_err(error)
}

/// `problem` with the line at which the last of the nested `keys` of `text` that there is stands.
fn at_line(text: &str, keys: &[&str], problem: &str) -> String {
    let Ok(root) = DeTable::parse(text) else { return problem.to_owned() };
    let (mut table, mut found) = (Some(root.get_ref()), None);
    for key in keys {
        let Some((name, value)) = table.and_then(|table| table.get_key_value(*key)) else { break };
        found = Some(line(text, &name.span()));
        table = DeValue::as_table(value.get_ref());
    }
    found.map_or_else(|| problem.to_owned(), |line| format!("line {line}: {problem}"))
}

/// Names of the tables that the coatings in `text` read beside their file; none of a text that is not read.
pub fn tables_beside(text: &str) -> Vec<String> {
    let table: Table = ::toml::from_str(text).unwrap_or_default();
    let coatings = table.get("coating").and_then(Value::as_table);
    let named = coatings.into_iter().flat_map(Table::values).filter_map(|c| c.get("table")?.as_str());
    named.map(str::to_owned).collect()
}

fn read(table: &Table, text: &str, beside: ReadBeside<'_>) -> Result<CoatingFile, String> {
    let known = ["default", "surface", "coating", "material"];
    if let Some(key) = table.keys().find(|key| !known.contains(&key.as_str())) {
        let problem = format!("`{key}` is not known; expected {}", known.join(", "));
        return Err(at_line(text, &[key], &problem));
    }
    let part = |key: &str| match table.get(key) {
        None => Ok(Table::new()),
        Some(Value::Table(part)) => Ok(part.clone()),
        Some(_) => Err(at_line(text, &[key], &format!("`{key}` is not a table"))),
    };
    let default = table.get("default").map(word).transpose();
    let default = default.map_err(|e| at_line(text, &["default"], &format!("default: {e}")))?;
    let mut file = CoatingFile { default, ..CoatingFile::default() };
    for (number, name) in part("surface")? {
        let wrong = |problem: &str| at_line(text, &["surface", &number], &format!("[surface] {problem}"));
        let surface =
            number.parse().map_err(|_| wrong(&format!("{number}: expected the number of a surface")))?;
        if file.surfaces.iter().any(|(other, _)| *other == surface) {
            return Err(wrong(&format!("has two coatings of surface {surface}")));
        }
        file.surfaces.push((surface, word(&name).map_err(|e| wrong(&format!("{number}: {e}")))?));
    }
    let materials = part("material")?;
    for (name, entry) in part("coating")? {
        let key = entry.as_table().and_then(|entry| entry.keys().next()).map_or("", |key| key);
        let wrong =
            |problem: &str| at_line(text, &["coating", &name, key], &format!("[coating.{name}] {problem}"));
        let coating = coating(&name, &entry, (&materials, text), beside).map_err(|e| wrong(&e))?;
        // Names are compared without regard to case, as those of the design program.
        if file.named.contains_key(&name.to_ascii_uppercase()) {
            return Err(wrong("another coating has this name in other letters"));
        }
        file.add(&name, Ok(coating))?;
    }
    Ok(file)
}

fn word(value: &Value) -> Result<String, String> {
    value
        .as_str()
        .map(str::to_owned)
        .ok_or_else(|| format!("{value:?} is not the name of a coating in quotes"))
}

fn number(value: &Value) -> Result<f64, String> {
    let number = value.as_float().or_else(|| value.as_integer().map(|i| i as f64));
    number.filter(|v| v.is_finite()).ok_or_else(|| format!("{value:?} is not a number"))
}

/// Rows of `columns` numbers with an ascending wavelength first, or one number for all wavelengths.
fn rows(value: &Value, columns: usize) -> Result<Vec<Vec<f64>>, String> {
    let Value::Array(rows) = value else {
        let mut row = vec![550.0, number(value)?];
        row.resize(columns, 0.0);
        return Ok(vec![row]);
    };
    if rows.is_empty() || rows.len() > MAX_ROWS {
        return Err(format!("expected 1 to {MAX_ROWS} rows, found {}", rows.len()));
    }
    let row = |row: &Value| {
        let cells = row.as_array().filter(|cells| cells.len() == columns);
        let cells = cells
            .ok_or_else(|| format!("{row:?}: expected {columns} numbers, the wavelength in nm first"))?;
        cells.iter().map(number).collect::<Result<Vec<f64>, String>>()
    };
    let rows: Vec<Vec<f64>> = rows.iter().map(row).collect::<Result<_, _>>()?;
    match rows[0][0] > 0.0 && rows.windows(2).all(|w| w[1][0] > w[0][0]) {
        true => Ok(rows),
        false => Err("wavelengths do not ascend from above 0 nm".to_owned()),
    }
}

/// A coating; of layers, whose materials are in a table of the text.
fn coating(
    name: &str,
    entry: &Value,
    materials: (&Table, &str),
    beside: ReadBeside<'_>,
) -> Result<Coating, String> {
    let entry = entry.as_table().filter(|t| t.len() == 1);
    let entry = entry.ok_or("expected one of reflectance, layers, table")?;
    if let Some(value) = entry.get("reflectance") {
        let rows = rows(value, 2)?;
        if rows.len() == 1 && value.is_array() {
            return Err("reflectance: a table of one row has one wavelength alone; give one number for all, or two rows at least".to_owned());
        }
        if let Some(row) = rows.iter().find(|row| !(0.0..=1.0).contains(&row[1])) {
            return Err(format!("reflectance {}: expected a share from 0 to 1", row[1]));
        }
        let entries = rows.iter().map(|row| (row[0] / 1e3, row[1])).collect();
        return Ok(Coating::Reflectance(Spectrum { name: name.to_owned(), entries }));
    }
    if let Some(value) = entry.get("layers") {
        let layers = value.as_array().filter(|l| (1..=MAX_LAYERS).contains(&l.len()));
        let layers = layers.ok_or_else(|| format!("layers: expected 1 to {MAX_LAYERS} of them"))?;
        return Ok(Coating::Films(layers.iter().map(|l| film(l, materials)).collect::<Result<_, _>>()?));
    }
    if let Some(value) = entry.get("table") {
        let path = value.as_str().ok_or("table: expected the name of a file in quotes")?;
        let table = beside(path).and_then(|text| csv::parse(name, &text));
        return Ok(Coating::Table(table.map_err(|e| format!("{path}: {e}"))?));
    }
    Err(format!("`{}`: expected one of reflectance, layers, table", entry.keys().next().map_or("", |k| k)))
}

fn film(layer: &Value, (materials, text): (&Table, &str)) -> Result<Film, String> {
    let Some([Value::String(name), thickness]) = layer.as_array().map(Vec::as_slice) else {
        return Err(format!("{layer:?}: expected [\"MATERIAL\", thickness in nm]"));
    };
    let entry = materials.get(name).and_then(Value::as_table);
    let material = entry.and_then(|m| m.get("n"));
    let material =
        material.ok_or_else(|| format!("material {name} has no entry [material.{name}] with n"))?;
    let wrong = |key: &str, problem: &str| {
        at_line(text, &["material", name, key], &format!("[material.{name}] {problem}"))
    };
    if let Some(other) = entry.into_iter().flat_map(Table::keys).find(|key| *key != "n") {
        let expected = "an absorbing material is n = [[wavelength in nm, n, k], …]";
        return Err(wrong(other, &format!("`{other}` is not known: {expected}")));
    }
    let entries: Vec<(f64, f64, f64)> = rows(material, 3)
        .map_err(|e| wrong("n", &e))?
        .iter()
        .map(|row| (row[0] / 1e3, row[1], row[2]))
        .collect();
    let thickness_um = number(thickness)? / 1e3;
    entries.iter().try_for_each(|(_, n, k)| check_layer(*n, *k, thickness_um))?;
    Ok(Film { index: FilmIndex { name: name.clone(), entries }, thickness_um })
}
