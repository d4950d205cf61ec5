//! Tables of a description: known keys, and values with their lines.

use std::path::Path;

use pipeline::design::tolerance::{Law, Limits};
use pipeline::words::edit_distance;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::error::ToleranceFileError as Error;
use crate::toml_error::{line, located};

/// A value with its place.
type Placed<'a> = Spanned<DeValue<'a>>;

/// Characters of a value that errors quote.
const MAX_QUOTE_CHARS: usize = 40;

/// The text of a description.
#[derive(Clone, Copy)]
pub(super) struct Source<'a> {
    pub(super) path: &'a Path,
    pub(super) text: &'a str,
}

/// A table with its name as the text has it: `[[element]]`.
pub(super) struct Entry<'a> {
    source: Source<'a>,
    name: String,
    /// Line of its head.
    pub(super) line: usize,
    table: &'a DeTable<'a>,
}

/// A value with its table and key.
#[derive(Clone)]
pub(super) struct Field<'a> {
    source: Source<'a>,
    name: String,
    value: &'a Placed<'a>,
}

impl<'a> Source<'a> {
    /// The tables of the text.
    pub(super) fn parse(self) -> Result<Spanned<DeTable<'a>>, Error> {
        DeTable::parse(self.text)
            .map_err(|e| Error::Syntax { path: self.path.into(), message: located(&e, self.text) })
    }

    /// The whole text as a table with these keys.
    pub(super) fn root(
        self,
        root: &'a Spanned<DeTable<'a>>,
        keys: &[&'static str],
    ) -> Result<Entry<'a>, Error> {
        Entry { source: self, name: "the file".to_owned(), line: 1, table: root.get_ref() }.with_keys(keys)
    }

    fn line(self, spanned: &Placed<'_>) -> usize {
        line(self.text, &spanned.span())
    }
}

impl<'a> Entry<'a> {
    /// Itself, if it has no other keys.
    fn with_keys(self, keys: &[&'static str]) -> Result<Self, Error> {
        let unknown = self.table.iter().find(|(key, _)| !keys.contains(&key.get_ref().as_ref()));
        let Some((key, _)) = unknown else { return Ok(self) };
        let name = key.get_ref();
        Err(Error::Key {
            path: self.source.path.into(),
            line: line(self.source.text, &key.span()),
            nearest: keys.iter().min_by_key(|known| edit_distance(name, known)).copied().unwrap_or_default(),
            table: self.name,
            key: name.to_string(),
            known: keys.join(", "),
        })
    }

    /// The table `key` of it, which may be absent.
    pub(super) fn table(&self, key: &str, keys: &[&'static str]) -> Result<Option<Entry<'a>>, Error> {
        self.field(key).map(|field| field.table(format!("[{key}]"), keys)).transpose()
    }

    /// The tables `[[key]]`.
    pub(super) fn tables(&self, key: &str, keys: &[&'static str]) -> Result<Vec<Entry<'a>>, Error> {
        let Some(field) = self.field(key) else { return Ok(Vec::new()) };
        let name = format!("[[{key}]]");
        let DeValue::Array(all) = field.value.get_ref() else {
            return Err(field.error(format!("tables headed {name}")));
        };
        let one =
            |value| Field { source: self.source, name: key.to_owned(), value }.table(name.clone(), keys);
        all.iter().map(one).collect()
    }

    /// The value of `key`, which may be absent.
    pub(super) fn field(&self, key: &str) -> Option<Field<'a>> {
        let value = self.table.get(key)?;
        Some(Field { source: self.source, name: format!("{} {key}", self.name), value })
    }

    /// The value of `key`.
    pub(super) fn required(&self, key: &str, expected: &str) -> Result<Field<'a>, Error> {
        self.field(key).ok_or_else(|| self.error(key, expected, "nothing"))
    }

    /// An error of the table itself.
    pub(super) fn error(&self, key: &str, expected: impl Into<String>, found: impl Into<String>) -> Error {
        Error::Value {
            path: self.source.path.into(),
            line: self.line,
            field: format!("{} {key}", self.name).trim_end().to_owned(),
            expected: expected.into(),
            found: found.into(),
        }
    }
}

impl<'a> Field<'a> {
    /// Its line.
    pub(super) fn line(&self) -> usize {
        self.source.line(self.value)
    }

    /// The value is not what it must be.
    pub(super) fn error(&self, expected: impl Into<String>) -> Error {
        let text = self.source.text.get(self.value.span()).unwrap_or_default();
        let quote: String = text.chars().take(MAX_QUOTE_CHARS).collect();
        Error::Value {
            path: self.source.path.into(),
            line: self.line(),
            field: self.name.clone(),
            expected: expected.into(),
            found: quote.split_whitespace().collect::<Vec<_>>().join(" "),
        }
    }

    /// A table with these keys.
    pub(super) fn table(&self, name: String, keys: &[&'static str]) -> Result<Entry<'a>, Error> {
        let DeValue::Table(table) = self.value.get_ref() else {
            return Err(self.error(format!("a table {name}")));
        };
        Entry { source: self.source, name, line: self.line(), table }.with_keys(keys)
    }

    /// A finite number.
    pub(super) fn number(&self) -> Result<f64, Error> {
        let number = match self.value.get_ref() {
            DeValue::Float(float) => float.as_str().parse().ok(),
            DeValue::Integer(i) => i64::from_str_radix(i.as_str(), i.radix()).ok().map(|i| i as f64),
            _ => None,
        };
        number.filter(|v: &f64| v.is_finite()).ok_or_else(|| self.error("a number"))
    }

    /// The number of a surface, or of a Zernike term.
    pub(super) fn index(&self) -> Result<usize, Error> {
        let DeValue::Integer(i) = self.value.get_ref() else { return Err(self.error("a whole number")) };
        usize::from_str_radix(i.as_str(), i.radix()).map_err(|_| self.error("a whole number"))
    }

    /// true or false.
    pub(super) fn boolean(&self) -> Result<bool, Error> {
        self.value.get_ref().as_bool().ok_or_else(|| self.error("true or false"))
    }

    /// One of `words`.
    pub(super) fn word<T: Copy>(&self, words: &[(&str, T)]) -> Result<T, Error> {
        let found = self.value.get_ref().as_str().and_then(|text| words.iter().find(|(w, _)| *w == text));
        let expected = || words.iter().map(|(w, _)| format!("\"{w}\"")).collect::<Vec<_>>().join(" or ");
        found.map(|(_, value)| *value).ok_or_else(|| self.error(expected()))
    }

    /// Its elements, if it is an array.
    pub(super) fn elements(&self) -> Option<Vec<Field<'a>>> {
        let DeValue::Array(all) = self.value.get_ref() else { return None };
        Some(all.iter().map(|value| Field { value, ..self.clone() }).collect())
    }

    /// An array of two.
    pub(super) fn pair(&self, expected: &str) -> Result<[Field<'a>; 2], Error> {
        let two = self.elements().and_then(|all| <[Field<'a>; 2]>::try_from(all).ok());
        two.ok_or_else(|| self.error(expected))
    }

    /// Limits with the law of the description, or their own.
    pub(super) fn limits(&self, law: Law) -> Result<Limits, Error> {
        if matches!(self.value.get_ref(), DeValue::Table(_)) {
            let entry = self.table(self.name.clone(), &["limits", "law"])?;
            let law = entry.field("law").map_or(Ok(law), |field| field.law())?;
            return entry.required("limits", "[low, high] or a number")?.plain_limits(law);
        }
        self.plain_limits(law)
    }

    fn plain_limits(&self, law: Law) -> Result<Limits, Error> {
        if self.elements().is_some() {
            let [low, high] = self.pair("[low, high]")?;
            let limits = Limits { low: low.number()?, high: high.number()?, law };
            return match limits.low <= limits.high {
                true => Ok(limits),
                false => Err(self.error("the lower limit first")),
            };
        }
        let size =
            self.number().map_err(|_| self.error("a number (±), [low, high] or {limits = …, law = …}"))?;
        match size >= 0.0 {
            true => Ok(Limits::symmetric(size, law)),
            false => Err(self.error("a number that is not negative (it is ±), or [low, high]")),
        }
    }

    /// The name of a law.
    pub(super) fn law(&self) -> Result<Law, Error> {
        self.word(&Law::ALL.map(|law| (law.name(), law)))
    }
}
