//! Tables of a TOML text: known keys, and values with their lines.

use std::path::{Path, PathBuf};

use pipeline::bounds::Bound;
use pipeline::words::edit_distance;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::toml_error::{line, located};

/// Characters of a key or a value that errors quote.
const MAX_QUOTE_CHARS: usize = 40;
/// Maximum numbers of a list.
const MAX_LIST: usize = 65_536;

/// A text that is not TOML, or an entry that cannot be.
#[derive(Clone, Debug, thiserror::Error, PartialEq)]
#[error("{}: {}{problem}", .path.display(), .line.map_or(String::new(), |line| format!("line {line}: ")))]
pub struct TableError {
    /// The file.
    pub path: PathBuf,
    /// Line of the entry, from 1; none if the problem has line and column.
    pub line: Option<usize>,
    /// Found and expected content.
    pub problem: String,
}

/// The text of a file.
#[derive(Clone, Copy)]
pub(crate) struct Source<'a> {
    pub path: &'a Path,
    pub text: &'a str,
}

/// A table with its name as the text has it: `[[element]]`; empty of the whole text.
pub(crate) struct Entry<'a> {
    source: Source<'a>,
    name: String,
    /// Line of its head.
    line: usize,
    table: &'a DeTable<'a>,
}

/// A value with its table and key.
#[derive(Clone)]
pub(crate) struct Field<'a> {
    source: Source<'a>,
    name: String,
    value: &'a Spanned<DeValue<'a>>,
}

impl<'a> Source<'a> {
    /// The tables of the text.
    pub fn parse(self) -> Result<Spanned<DeTable<'a>>, TableError> {
        DeTable::parse(self.text).map_err(|e| TableError {
            path: self.path.into(),
            line: None,
            problem: located(&e, self.text),
        })
    }

    /// The whole text as a table with these keys.
    pub fn root(self, root: &'a Spanned<DeTable<'a>>, keys: &[&str]) -> Result<Entry<'a>, TableError> {
        Entry { source: self, name: String::new(), line: 1, table: root.get_ref() }.with_keys(keys)
    }

    fn error(self, line: usize, problem: String) -> TableError {
        TableError { path: self.path.into(), line: Some(line), problem }
    }
}

impl<'a> Entry<'a> {
    /// Its name in errors.
    fn name(&self) -> &str {
        if self.name.is_empty() { "the file" } else { &self.name }
    }

    /// Itself, if it has no other keys.
    fn with_keys(self, keys: &[&str]) -> Result<Self, TableError> {
        let unknown = self.table.iter().find(|(key, _)| !keys.contains(&key.get_ref().as_ref()));
        let Some((key, _)) = unknown else { return Ok(self) };
        let name = key.get_ref();
        let nearest = keys.iter().min_by_key(|known| edit_distance(name, known)).copied().unwrap_or_default();
        let problem = format!(
            "{} has no key `{}`; did you mean `{nearest}`? Keys: {}",
            self.name(),
            quoted(name),
            keys.join(", ")
        );
        Err(self.source.error(line(self.source.text, &key.span()), problem))
    }

    /// An error of the table as a whole: what it has or lacks.
    pub fn error(&self, problem: impl std::fmt::Display) -> TableError {
        self.source.error(self.line, format!("{} {problem}", self.name()))
    }

    /// The value of `key`, which may be absent.
    pub fn field(&self, key: &str) -> Option<Field<'a>> {
        let value = self.table.get(key)?;
        let name = format!("{} {key}", self.name).trim_start().to_owned();
        Some(Field { source: self.source, name, value })
    }

    /// The value of `key`, which must be there.
    pub fn required(&self, key: &str, expected: &str) -> Result<Field<'a>, TableError> {
        self.field(key).ok_or_else(|| self.error(format!("has no key `{key}`: expected {expected}")))
    }

    /// The table `[key]`, which may be absent.
    pub fn table(&self, key: &str, keys: &[&str]) -> Result<Option<Entry<'a>>, TableError> {
        self.field(key).map(|field| field.table(format!("[{key}]"), keys)).transpose()
    }

    /// The tables `[[key]]`.
    pub fn tables(&self, key: &str, keys: &[&str]) -> Result<Vec<Entry<'a>>, TableError> {
        let Some(field) = self.field(key) else { return Ok(Vec::new()) };
        let name = format!("[[{key}]]");
        let all = field.elements().ok_or_else(|| field.error(format!("tables headed {name}")))?;
        all.iter().map(|one| one.table(name.clone(), keys)).collect()
    }

    /// A number within a bound, if given.
    pub fn bounded(&self, key: &str, bound: Bound) -> Result<Option<f64>, TableError> {
        self.field(key).map(|field| field.bounded(bound)).transpose()
    }

    /// true or false; absent: false.
    pub fn flag(&self, key: &str) -> Result<bool, TableError> {
        self.field(key).map_or(Ok(false), |field| field.boolean())
    }
}

impl<'a> Field<'a> {
    /// Its line.
    pub fn line(&self) -> usize {
        line(self.source.text, &self.value.span())
    }

    /// The value is not what it must be.
    pub fn error(&self, expected: impl std::fmt::Display) -> TableError {
        let found = quoted(self.source.text.get(self.value.span()).unwrap_or_default());
        self.source.error(self.line(), format!("{}: expected {expected}, found {found}", self.name))
    }

    /// A table with these keys, named `name` in errors.
    pub fn table(&self, name: String, keys: &[&str]) -> Result<Entry<'a>, TableError> {
        let DeValue::Table(table) = self.value.get_ref() else {
            return Err(self.error(format!("a table {name}")));
        };
        Entry { source: self.source, name, line: self.line(), table }.with_keys(keys)
    }

    /// As [`table`](Self::table), of a value that may be of another kind: none then.
    pub fn inner_table(&self, keys: &[&str]) -> Result<Option<Entry<'a>>, TableError> {
        let is_table = matches!(self.value.get_ref(), DeValue::Table(_));
        is_table.then(|| self.table(self.name.clone(), keys)).transpose()
    }

    /// A finite number.
    pub fn number(&self) -> Result<f64, TableError> {
        let number: Option<f64> = match self.value.get_ref() {
            DeValue::Float(float) => float.as_str().parse().ok(),
            DeValue::Integer(i) => i64::from_str_radix(i.as_str(), i.radix()).ok().map(|i| i as f64),
            _ => None,
        };
        number.filter(|v| v.is_finite()).ok_or_else(|| self.error("a number"))
    }

    /// A number within a bound.
    pub fn bounded(&self, bound: Bound) -> Result<f64, TableError> {
        let checked = bound.check(self.number()?);
        checked.map_err(|e| self.source.error(self.line(), format!("{}: {e}", self.name)))
    }

    /// A whole number from 0.
    pub fn index(&self) -> Result<usize, TableError> {
        let DeValue::Integer(i) = self.value.get_ref() else { return Err(self.error("a whole number")) };
        usize::from_str_radix(i.as_str(), i.radix()).map_err(|_| self.error("a whole number"))
    }

    /// true or false.
    pub fn boolean(&self) -> Result<bool, TableError> {
        self.value.get_ref().as_bool().ok_or_else(|| self.error("true or false"))
    }

    /// A text that is not empty.
    pub fn text(&self, expected: &str) -> Result<&'a str, TableError> {
        self.value.get_ref().as_str().filter(|t| !t.is_empty()).ok_or_else(|| self.error(expected))
    }

    /// One of `words`.
    pub fn word<T: Copy>(&self, words: &[(&str, T)]) -> Result<T, TableError> {
        let found = self.value.get_ref().as_str().and_then(|text| words.iter().find(|(w, _)| *w == text));
        let expected = || words.iter().map(|(w, _)| format!("\"{w}\"")).collect::<Vec<_>>().join(" or ");
        found.map(|(_, value)| *value).ok_or_else(|| self.error(expected()))
    }

    /// Its elements, if it is an array.
    pub fn elements(&self) -> Option<Vec<Field<'a>>> {
        let DeValue::Array(all) = self.value.get_ref() else { return None };
        Some(all.iter().map(|value| Field { value, ..self.clone() }).collect())
    }

    /// An array of two.
    pub fn pair(&self, expected: &str) -> Result<[Field<'a>; 2], TableError> {
        let two = self.elements().and_then(|all| <[Field<'a>; 2]>::try_from(all).ok());
        two.ok_or_else(|| self.error(expected))
    }

    /// A list of finite numbers; none if the value is no list.
    pub fn numbers(&self) -> Result<Option<Vec<f64>>, TableError> {
        match self.value.get_ref() {
            DeValue::Array(all) if all.len() > MAX_LIST => {
                Err(self.error(format!("at most {MAX_LIST} numbers")))
            }
            _ => {
                let numbers = |all: Vec<Field<'a>>| all.iter().map(Field::number).collect();
                self.elements().map(numbers).transpose().map_err(|_| self.error("a list of numbers"))
            }
        }
    }

    /// A list of `count` finite numbers.
    pub fn numbers_of(&self, count: usize) -> Result<Vec<f64>, TableError> {
        let numbers = self.numbers()?.filter(|numbers| numbers.len() == count);
        numbers.ok_or_else(|| self.error(format!("a list of {count} numbers")))
    }

    /// A list of texts, or one text.
    pub fn texts(&self, expected: &str) -> Result<Vec<&'a str>, TableError> {
        let Some(all) = self.elements() else { return Ok(vec![self.text(expected)?]) };
        let texts: Option<Vec<&str>> = all.iter().map(|one| one.text(expected).ok()).collect();
        texts.filter(|t| !t.is_empty()).ok_or_else(|| self.error(expected))
    }
}

/// The first characters of `text`, on one line.
fn quoted(text: &str) -> String {
    let quote: String = text.chars().take(MAX_QUOTE_CHARS).collect();
    quote.split_whitespace().collect::<Vec<_>>().join(" ")
}
