//! Fields of a description that `--set` replaces, and the tables that the description then names.

use std::path::{Path, PathBuf};

use super::{MAX_DESCRIPTION, read};
use crate::durable::parent_of;

/// Paths of the tables that the description at `path` names, with `set` (`FIELD=VALUE`) applied; none of one that cannot be read.
pub fn sensor_tables(path: &Path, set: &[String]) -> Vec<PathBuf> {
    let text = read(path, MAX_DESCRIPTION).ok().flatten().unwrap_or_default();
    let mut table: toml::Table = toml::from_str(&text).unwrap_or_default();
    for word in set {
        // An error when the description is opened.
        let _ = replace(&mut table, word);
    }
    let mut names = Vec::new();
    named_files(&toml::Value::Table(table), false, &mut names);
    names.into_iter().map(|name| parent_of(path).join(name)).collect()
}

/// Texts of the fields `file` and `filters` in `value`; `is_file` if it is of such a field.
fn named_files(value: &toml::Value, is_file: bool, names: &mut Vec<String>) {
    match value {
        toml::Value::String(name) if is_file => names.push(name.clone()),
        toml::Value::Array(items) => items.iter().for_each(|item| named_files(item, is_file, names)),
        toml::Value::Table(fields) => {
            for (key, inner) in fields {
                named_files(inner, key == "file" || key == "filters", names);
            }
        }
        _ => (),
    }
}

/// Replaces one field: `noise.prnu=0`.
pub(super) fn replace(table: &mut toml::Table, word: &str) -> Result<(), String> {
    let (field, value) = word.split_once('=').ok_or("expected FIELD=VALUE, e.g. noise.prnu=0")?;
    let parsed = toml::from_str::<toml::Table>(&format!("value = {value}")).ok();
    // A word without quotes is text.
    let value = parsed
        .and_then(|mut t| t.remove("value"))
        .unwrap_or_else(|| toml::Value::String(value.trim().into()));
    let names: Vec<&str> = field.trim().split('.').collect();
    if names == ["schema"] {
        return Err("the schema of a description cannot be replaced".into());
    }
    let (last, groups) = names.split_last().ok_or("expected FIELD=VALUE")?;
    let mut place = table;
    for group in groups {
        let inner = place.entry(*group).or_insert_with(|| toml::Value::Table(toml::Table::new()));
        place = inner.as_table_mut().ok_or_else(|| format!("{group} is a value, not a group of fields"))?;
    }
    place.insert((*last).to_owned(), value);
    Ok(())
}
