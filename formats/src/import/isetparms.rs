//! ISETPARMS.TXT: assignments in MATLAB syntax, parsed and never evaluated.
//!
//! ```text
//! % comment                     also after a statement
//! lensFile='EO54852.ZMX';       text in single quotes, '' is one quote; the semicolon is optional
//! wave=400:50:700;              a range with both ends, or [400 550 700]
//! efl=5.999968;                 a number
//! ```
//! Anything else (calls, operators, other names on the right) is an error.

use super::matrix::short;
use super::text::number;
use super::{ImportError, MAX_COUNT};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A value.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// Quoted text.
    Text(String),
    /// One number, a range or a list in brackets.
    Numbers(Vec<f64>),
}

/// Assignments by lower-case name, with their lines.
#[derive(Clone, Debug)]
pub struct Parameters {
    path: PathBuf,
    values: BTreeMap<String, (usize, Value)>,
}

impl Parameters {
    /// Parses the text of `path`.
    ///
    /// # Errors
    /// [`ImportError::Line`].
    pub fn parse(path: &Path, text: &str) -> Result<Self, ImportError> {
        let mut values = BTreeMap::new();
        for (i, line) in text.lines().enumerate() {
            let bad = |problem: String| ImportError::line(path, i + 1, problem);
            for statement in statements(line).map_err(bad)? {
                let Some((name, right)) = statement.split_once('=') else {
                    return Err(bad(format!("`{}` is not an assignment `name=value`", short(&statement))));
                };
                let name = name.trim();
                if name.is_empty() || !name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_') {
                    return Err(bad(format!("`{}` is not a valid name", short(name))));
                }
                let value = value(right.trim()).map_err(bad)?;
                if values.insert(name.to_ascii_lowercase(), (i + 1, value)).is_some() {
                    return Err(bad(format!("`{name}` is given twice")));
                }
            }
        }
        Ok(Self { path: path.into(), values })
    }

    /// The value and its line.
    pub fn get(&self, name: &str) -> Option<&(usize, Value)> {
        self.values.get(&name.to_ascii_lowercase())
    }

    /// A required list of numbers, and its line.
    ///
    /// # Errors
    /// The value is missing, or is text.
    pub fn list(&self, name: &str) -> Result<(usize, &[f64]), ImportError> {
        match self.get(name) {
            Some((line, Value::Numbers(list))) => Ok((*line, list)),
            Some((line, Value::Text(_))) => {
                Err(ImportError::line(&self.path, *line, format!("`{name}` is text, expected numbers")))
            }
            None => Err(ImportError::file(&self.path, format!("has no line `{name}=…;`"))),
        }
    }

    /// A required number.
    ///
    /// # Errors
    /// The value is missing, or is not one number.
    pub fn number(&self, name: &str) -> Result<f64, ImportError> {
        let (line, list) = self.list(name)?;
        match list {
            [one] => Ok(*one),
            _ => Err(ImportError::line(
                &self.path,
                line,
                format!("`{name}` has {} numbers, expected 1", list.len()),
            )),
        }
    }

    /// A number that may be missing.
    ///
    /// # Errors
    /// The value is not one number.
    pub fn optional_number(&self, name: &str) -> Result<Option<f64>, ImportError> {
        self.get(name).map(|_| self.number(name)).transpose()
    }

    /// A required whole number of at least `min`.
    ///
    /// # Errors
    /// The value is missing, or is another number.
    pub fn count(&self, name: &str, min: usize) -> Result<usize, ImportError> {
        let v = self.number(name)?;
        if v.fract() == 0.0 && v >= min as f64 && v <= MAX_COUNT as f64 {
            return Ok(v as usize);
        }
        let line = self.get(name).map_or(0, |(line, _)| *line);
        Err(ImportError::line(
            &self.path,
            line,
            format!("`{name}` is {v}, expected a whole number from {min} to {MAX_COUNT}"),
        ))
    }

    /// An optional text.
    pub fn text(&self, name: &str) -> Option<&str> {
        match self.get(name) {
            Some((_, Value::Text(text))) => Some(text),
            _ => None,
        }
    }
}

/// Splits at `;` and drops comments from `%`, both only outside quotes.
fn statements(line: &str) -> Result<Vec<String>, String> {
    let (mut out, mut statement, mut quoted) = (Vec::new(), String::new(), false);
    for c in line.chars().filter(|c| *c != '\0') {
        match c {
            '\'' => quoted = !quoted,
            '%' if !quoted => break,
            ';' if !quoted => {
                out.push(std::mem::take(&mut statement));
                continue;
            }
            _ => {}
        }
        statement.push(c);
    }
    if quoted {
        return Err("a quote is not closed".into());
    }
    out.push(statement);
    out.retain(|s| !s.trim().is_empty());
    Ok(out)
}

fn value(text: &str) -> Result<Value, String> {
    let invalid =
        || format!("`{}` is neither a number, a range a:step:b, a list [a b c] nor 'text'", short(text));
    if let Some(inner) = text.strip_prefix('\'') {
        let inner = inner.strip_suffix('\'').ok_or_else(invalid)?;
        let plain = inner.replace("''", "");
        return if plain.contains('\'') { Err(invalid()) } else { Ok(Value::Text(inner.replace("''", "'"))) };
    }
    if let Some(inner) = text.strip_prefix('[') {
        let inner = inner.strip_suffix(']').ok_or_else(invalid)?;
        // In a list a comma is a separator, never a decimal comma.
        let numbers = inner.split([' ', '\t', ',']).filter(|n| !n.is_empty());
        let list: Option<Vec<f64>> = numbers.map(number).collect();
        return match list.ok_or_else(invalid)? {
            list if list.is_empty() || list.len() > MAX_COUNT => Err(invalid()),
            list => Ok(Value::Numbers(list)),
        };
    }
    let parts: Option<Vec<f64>> = text.split(':').map(|w| number(w.trim())).collect();
    let (first, step, last) = match parts.ok_or_else(invalid)?[..] {
        [one] => return Ok(Value::Numbers(vec![one])),
        [first, last] => (first, 1.0, last),
        [first, step, last] => (first, step, last),
        _ => return Err(invalid()),
    };
    let steps = ((last - first) / step + 1e-6).floor();
    if !(steps >= 0.0 && steps < MAX_COUNT as f64) {
        return Err(format!("range `{}` has no numbers, or more than {MAX_COUNT}", short(text)));
    }
    Ok(Value::Numbers((0..=steps as usize).map(|i| first + i as f64 * step).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Parameters, String> {
        Parameters::parse(Path::new("P"), text).map_err(|e| e.to_string())
    }

    #[test]
    fn text_numbers_ranges_lists_and_comments_are_parsed() {
        let p = parse(
            "% head\nlensFile='a%b;c.ZMX' % name\nwave=400:75:700; % nm\nmag=-0.02; efl=5,5\nx=[1 2,3]",
        )
        .unwrap();
        assert_eq!(p.text("lensfile"), Some("a%b;c.ZMX"));
        assert_eq!(p.list("wave").unwrap().1, [400.0, 475.0, 550.0, 625.0, 700.0]);
        assert_eq!((p.number("mag").unwrap(), p.number("efl").unwrap()), (-0.02, 5.5));
        assert_eq!(p.list("x").unwrap(), (5, &[1.0, 2.0, 3.0][..]));
    }

    #[test]
    fn optional_number_may_be_missing_but_not_be_malformed() {
        let p = parse("efl=[1 2]\nfnumber='four'\nmag=-0.5").unwrap();
        assert_eq!(p.optional_number("mag").unwrap(), Some(-0.5));
        assert_eq!(p.optional_number("psfSpacing").unwrap(), None);
        for (name, word) in [("efl", "2 numbers"), ("fnumber", "is text")] {
            let error = p.optional_number(name).unwrap_err().to_string();
            assert!(error.contains(word), "{error}");
        }
    }

    #[test]
    fn expressions_and_invalid_values_are_errors() {
        for text in [
            "wave=ones(3)",
            "system('ls')",
            "efl=1+1",
            "wave=1:0:2",
            "wave=0:1e-300:1",
            "a='b",
            "a=1\na=2",
            "efl=nan",
        ] {
            assert!(parse(text).is_err(), "{text}");
        }
    }
}
