//! Tables of a description: known keys, and values with their lines.

use crate::import::ImportError;
use crate::toml_error::{line, located};
use pipeline::bounds::Bound;
use pipeline::words::edit_distance;
use std::path::Path;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Characters of a value that errors quote.
const MAX_QUOTE_CHARS: usize = 40;
/// Maximum numbers of a list.
const MAX_LIST: usize = 65_536;

/// The text of a description.
#[derive(Clone, Copy)]
pub(super) struct Source<'a> {
    pub path: &'a Path,
    pub text: &'a str,
}

/// A table with its name as the text has it: `[psf]`.
pub(super) struct Entry<'a> {
    source: Source<'a>,
    name: String,
    /// Line of its head.
    line: usize,
    table: &'a DeTable<'a>,
}

/// A value with its key.
#[derive(Clone)]
pub(super) struct Field<'a> {
    source: Source<'a>,
    name: String,
    value: &'a Spanned<DeValue<'a>>,
}

impl<'a> Source<'a> {
    /// The tables of the text.
    pub fn parse(self) -> Result<Spanned<DeTable<'a>>, ImportError> {
        DeTable::parse(self.text).map_err(|e| ImportError::file(self.path, located(&e, self.text)))
    }

    /// The whole text as a table with these keys.
    pub fn root(self, root: &'a Spanned<DeTable<'a>>, keys: &[&str]) -> Result<Entry<'a>, ImportError> {
        Entry { source: self, name: "the file".into(), line: 1, table: root.get_ref() }.with_keys(keys)
    }
}

impl<'a> Entry<'a> {
    /// Itself, if it has no other keys.
    fn with_keys(self, keys: &[&str]) -> Result<Self, ImportError> {
        let unknown = self.table.iter().find(|(key, _)| !keys.contains(&key.get_ref().as_ref()));
        let Some((key, _)) = unknown else { return Ok(self) };
        let name = key.get_ref();
        let nearest = keys.iter().min_by_key(|known| edit_distance(name, known)).copied().unwrap_or_default();
        let quoted: String = name.chars().take(MAX_QUOTE_CHARS).collect();
        Err(ImportError::line(
            self.source.path,
            line(self.source.text, &key.span()),
            format!(
                "{} has no key `{quoted}`; did you mean `{nearest}`? Keys: {}",
                self.name,
                keys.join(", ")
            ),
        ))
    }

    /// An error of the table as a whole.
    pub fn error(&self, problem: impl std::fmt::Display) -> ImportError {
        ImportError::line(self.source.path, self.line, format!("{} {problem}", self.name))
    }

    /// The value of `key`.
    pub fn field(&self, key: &str) -> Option<Field<'a>> {
        let value = self.table.get(key)?;
        Some(Field { source: self.source, name: key.to_owned(), value })
    }

    /// The value of `key`, which must be there.
    pub fn required(&self, key: &str, expected: &str) -> Result<Field<'a>, ImportError> {
        self.field(key).ok_or_else(|| self.error(format!("has no key `{key}`: {expected}")))
    }

    /// The table `key`, which may be absent.
    pub fn table(&self, key: &str, keys: &[&str]) -> Result<Option<Entry<'a>>, ImportError> {
        self.field(key).map(|field| field.table(format!("[{key}]"), keys)).transpose()
    }

    /// A number within a bound, if given.
    pub fn bounded(&self, key: &str, bound: Bound) -> Result<Option<f64>, ImportError> {
        self.field(key).map(|field| field.bounded(bound)).transpose()
    }

    /// true or false; absent: false.
    pub fn flag(&self, key: &str) -> Result<bool, ImportError> {
        match self.field(key) {
            None => Ok(false),
            Some(field) => field.value.get_ref().as_bool().ok_or_else(|| field.error("true or false")),
        }
    }
}

impl<'a> Field<'a> {
    /// The line of the value.
    pub fn line(&self) -> usize {
        line(self.source.text, &self.value.span())
    }

    /// The value is not what it must be.
    pub fn error(&self, expected: impl std::fmt::Display) -> ImportError {
        let text = self.source.text.get(self.value.span()).unwrap_or_default();
        let quote: String = text.chars().take(MAX_QUOTE_CHARS).collect();
        let quote = quote.split_whitespace().collect::<Vec<_>>().join(" ");
        let problem = format!("{}: expected {expected}, found {quote}", self.name);
        ImportError::line(self.source.path, self.line(), problem)
    }

    /// A table with these keys.
    pub fn table(&self, name: String, keys: &[&str]) -> Result<Entry<'a>, ImportError> {
        let DeValue::Table(table) = self.value.get_ref() else {
            return Err(self.error(format!("a table {name}")));
        };
        Entry { source: self.source, name, line: self.line(), table }.with_keys(keys)
    }

    /// A finite number.
    pub fn number(&self) -> Result<f64, ImportError> {
        number(self.value.get_ref()).ok_or_else(|| self.error("a number"))
    }

    /// A number within a bound.
    pub fn bounded(&self, bound: Bound) -> Result<f64, ImportError> {
        let value = self.number()?;
        super::check_number(self.source.path, self.line(), &self.name, bound, value)
    }

    /// A list of finite numbers; none if the value is no list.
    pub fn numbers(&self) -> Result<Option<Vec<f64>>, ImportError> {
        let DeValue::Array(all) = self.value.get_ref() else { return Ok(None) };
        if all.len() > MAX_LIST {
            return Err(self.error(format!("at most {MAX_LIST} numbers")));
        }
        let numbers: Option<Vec<f64>> = all.iter().map(|v| number(v.get_ref())).collect();
        numbers.map(Some).ok_or_else(|| self.error("a list of numbers"))
    }

    /// A list of `count` finite numbers.
    pub fn numbers_of(&self, count: usize) -> Result<Vec<f64>, ImportError> {
        let numbers = self.numbers()?.filter(|numbers| numbers.len() == count);
        numbers.ok_or_else(|| self.error(format!("a list of {count} numbers")))
    }

    /// A text that is not empty.
    pub fn text(&self, expected: &str) -> Result<&'a str, ImportError> {
        self.value.get_ref().as_str().filter(|t| !t.is_empty()).ok_or_else(|| self.error(expected))
    }

    /// A list of texts, or one text.
    pub fn texts(&self, expected: &str) -> Result<Vec<&'a str>, ImportError> {
        let DeValue::Array(all) = self.value.get_ref() else { return Ok(vec![self.text(expected)?]) };
        let texts: Option<Vec<&str>> =
            all.iter().map(|v| v.get_ref().as_str().filter(|t| !t.is_empty())).collect();
        texts.filter(|t| !t.is_empty()).ok_or_else(|| self.error(expected))
    }

    /// One of `words`.
    pub fn word<T: Copy>(&self, words: &[(&str, T)]) -> Result<T, ImportError> {
        let found = self.value.get_ref().as_str().and_then(|text| words.iter().find(|(w, _)| *w == text));
        let expected = || words.iter().map(|(w, _)| format!("\"{w}\"")).collect::<Vec<_>>().join(" or ");
        found.map(|(_, value)| *value).ok_or_else(|| self.error(expected()))
    }
}

fn number(value: &DeValue<'_>) -> Option<f64> {
    let number: Option<f64> = match value {
        DeValue::Float(float) => float.as_str().parse().ok(),
        DeValue::Integer(i) => i64::from_str_radix(i.as_str(), i.radix()).ok().map(|i| i as f64),
        _ => None,
    };
    number.filter(|v| v.is_finite())
}
