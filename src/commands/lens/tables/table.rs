//! A table as JSON and as CSV.

use crate::args::TableName;
use crate::progress::number;
use serde_json::{Map, Value};
use std::path::{Path, PathBuf};

/// Rows of values under names that carry their units.
pub struct Table {
    /// Its name.
    pub name: TableName,
    columns: Vec<String>,
    rows: Vec<Vec<Value>>,
}

impl Table {
    /// A table of `rows`, each with a value for each of `columns`.
    pub fn new(name: TableName, columns: &[&str], rows: Vec<Vec<Value>>) -> Self {
        Self { name, columns: columns.iter().map(|c| (*c).to_owned()).collect(), rows }
    }

    /// A table of JSON objects with the same keys.
    pub fn of_objects(name: TableName, objects: impl Iterator<Item = Value>) -> Self {
        let mut table = Self { name, columns: Vec::new(), rows: Vec::new() };
        for object in objects {
            let Value::Object(map) = object else { continue };
            table.columns = map.keys().cloned().collect();
            table.rows.push(map.into_iter().map(|(_, v)| v).collect());
        }
        table
    }

    /// Its key in JSON.
    pub fn key(&self) -> String {
        self.name.name().replace('-', "_")
    }

    /// A list of objects.
    pub fn json(self) -> Value {
        let object =
            |row: Vec<Value>| Value::Object(self.columns.iter().cloned().zip(row).collect::<Map<_, _>>());
        Value::Array(self.rows.into_iter().map(object).collect())
    }

    /// A header line and a line per row, numbers to twelve digits; what is not available is empty.
    pub fn csv(&self) -> String {
        let cell = |v: &Value| match v {
            Value::Null => String::new(),
            Value::String(s) => s.clone(),
            Value::Number(n) if n.is_f64() => Value::from(n.as_f64().map(number)).to_string(),
            v => v.to_string(),
        };
        let rows = self.rows.iter().map(|row| csv_line(&row.iter().map(cell).collect::<Vec<_>>()));
        std::iter::once(csv_line(&self.columns)).chain(rows).collect()
    }
}

/// A line of cells; a quote is doubled (RFC 4180).
pub fn csv_line(cells: &[String]) -> String {
    let quoted = |cell: &String| match cell.contains([',', '"', '\n', '\r']) {
        true => format!("\"{}\"", cell.replace('"', "\"\"")),
        false => cell.clone(),
    };
    cells.iter().map(quoted).collect::<Vec<_>>().join(",") + "\n"
}

/// The file of a table in `dir`.
pub fn csv_file(dir: &Path, name: TableName) -> PathBuf {
    dir.join(format!("{}.csv", name.name()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn csv_has_units_empty_cells_and_quotes() {
        let rows = vec![
            vec![json!(550.0), Value::Null, json!("a, \"b\"")],
            vec![json!(0.1 + 0.2), json!(3), json!("c")],
        ];
        let table = Table::new(TableName::Spots, &["wavelength_nm", "rms_um", "name"], rows);
        assert_eq!(table.csv(), "wavelength_nm,rms_um,name\n550.0,,\"a, \"\"b\"\"\"\n0.3,3,c\n");
        assert_eq!(table.key(), "spots");
        assert_eq!(table.json()[1]["rms_um"], 3);
    }
}
