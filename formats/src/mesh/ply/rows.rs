//! Numbers of rows, from text or from bytes.
//!
//! A row of an ascii file is a line with exactly the numbers of its properties; blank lines are skipped.

use super::super::text::{expected_number, quote};
use super::header::Type;

/// Why a number cannot be read.
#[derive(Debug, PartialEq)]
pub(super) enum Problem {
    /// The file ends.
    End,
    /// What is expected and found.
    Wrong(String, String),
}

fn wrong(expected: impl Into<String>, found: impl Into<String>) -> Problem {
    Problem::Wrong(expected.into(), found.into())
}

/// Source of the numbers of rows, in the order of the file.
pub(super) trait Rows {
    /// Starts a row.
    fn start(&mut self) -> Result<(), Problem>;
    /// The next number of the row; not checked to be finite.
    fn number(&mut self, of: Type) -> Result<f64, Problem>;
    /// Skips numbers of the row.
    fn skip(&mut self, of: Type, count: u64) -> Result<(), Problem>;
    /// Ends a row.
    fn end(&mut self) -> Result<(), Problem>;
    /// Numbers of a type that the rest of the row, or of the file, can have at most.
    fn numbers_left(&self, of: Type) -> u64;
    /// Rows of `numbers` numbers in at least `bytes` bytes that the rest of the file can have at most.
    fn rows_left(&self, numbers: u64, bytes: u64) -> u64;
    /// Whether a row of numbers, without lists, has always the same size.
    fn is_fixed_size(&self) -> bool;
    /// The place of the row, or of the number.
    fn place(&self) -> String;
    /// Whether there is more than white space.
    fn has_more(&self) -> bool;
}

/// Numbers in text.
pub(super) struct Ascii<'a> {
    rest: &'a [u8],
    row: &'a [u8],
    line: u64,
    end: u8,
}

impl<'a> Ascii<'a> {
    /// `lines`: those before `text`.
    pub fn new(text: &'a [u8], lines: u64) -> Self {
        let end = if text.contains(&b'\n') { b'\n' } else { b'\r' };
        Self { rest: text, row: &[], line: lines, end }
    }

    fn word(&mut self) -> Result<&'a [u8], Problem> {
        let row = self.row.trim_ascii_start();
        let length = row.iter().position(u8::is_ascii_whitespace).unwrap_or(row.len());
        let (word, rest) = row.split_at(length);
        self.row = rest;
        match word.is_empty() {
            true => Err(wrong("a number for each property", "the end of the line")),
            false => Ok(word),
        }
    }
}

impl Rows for Ascii<'_> {
    fn start(&mut self) -> Result<(), Problem> {
        while !self.rest.is_empty() {
            self.line += 1;
            let length = self.rest.iter().position(|&b| b == self.end).unwrap_or(self.rest.len());
            let (row, rest) = self.rest.split_at(length);
            (self.row, self.rest) = (row.trim_ascii(), rest.get(1..).unwrap_or_default());
            if !self.row.is_empty() {
                return Ok(());
            }
        }
        Err(Problem::End)
    }

    fn number(&mut self, of: Type) -> Result<f64, Problem> {
        let word = self.word()?;
        let text = std::str::from_utf8(word).unwrap_or_default();
        let (min, max) = of.range();
        let value = match of {
            Type::F32 => text.parse::<f32>().ok().filter(|v| v.is_finite()).map(f64::from),
            Type::F64 => text.parse::<f64>().ok().filter(|v| v.is_finite()),
            _ => {
                let value = text.parse::<i64>().ok().filter(|v| (min..=max).contains(v));
                return value
                    .map(|v| v as f64)
                    .ok_or_else(|| wrong(format!("a whole number of {min} to {max}"), quote(word)));
            }
        };
        value.ok_or_else(|| wrong(expected_number(word), quote(word)))
    }

    fn skip(&mut self, _of: Type, count: u64) -> Result<(), Problem> {
        (0..count).try_for_each(|_| self.word().map(drop))
    }

    fn end(&mut self) -> Result<(), Problem> {
        let left = self.row.trim_ascii();
        match left.is_empty() {
            true => Ok(()),
            false => Err(wrong("the end of the line after the last property", quote(left))),
        }
    }

    fn numbers_left(&self, _of: Type) -> u64 {
        self.row.len().div_ceil(2) as u64
    }

    fn rows_left(&self, numbers: u64, _bytes: u64) -> u64 {
        (self.rest.len() as u64 + 1) / (2 * numbers.max(1))
    }

    fn is_fixed_size(&self) -> bool {
        false
    }

    fn place(&self) -> String {
        format!("line {}", self.line)
    }

    fn has_more(&self) -> bool {
        !self.rest.trim_ascii().is_empty()
    }
}

/// Numbers in bytes.
pub(super) struct Binary<'a> {
    rest: &'a [u8],
    /// Bytes of the file.
    size: usize,
    is_little: bool,
}

impl<'a> Binary<'a> {
    /// `before`: bytes of the file before `bytes`.
    pub fn new(bytes: &'a [u8], before: usize, is_little: bool) -> Self {
        Self { rest: bytes, size: before + bytes.len(), is_little }
    }

    fn take<const N: usize>(&mut self) -> Result<[u8; N], Problem> {
        let (bytes, rest) = self.rest.split_first_chunk::<N>().ok_or(Problem::End)?;
        self.rest = rest;
        let mut bytes = *bytes;
        if !self.is_little {
            bytes.reverse();
        }
        Ok(bytes)
    }
}

impl Rows for Binary<'_> {
    fn start(&mut self) -> Result<(), Problem> {
        Ok(())
    }

    fn number(&mut self, of: Type) -> Result<f64, Problem> {
        Ok(match of {
            Type::I8 => i8::from_le_bytes(self.take()?).into(),
            Type::U8 => u8::from_le_bytes(self.take()?).into(),
            Type::I16 => i16::from_le_bytes(self.take()?).into(),
            Type::U16 => u16::from_le_bytes(self.take()?).into(),
            Type::I32 => i32::from_le_bytes(self.take()?).into(),
            Type::U32 => u32::from_le_bytes(self.take()?).into(),
            Type::F32 => f32::from_le_bytes(self.take()?).into(),
            Type::F64 => f64::from_le_bytes(self.take()?),
        })
    }

    fn skip(&mut self, of: Type, count: u64) -> Result<(), Problem> {
        let bytes = count.saturating_mul(of.bytes() as u64);
        let bytes = usize::try_from(bytes).map_err(|_| Problem::End)?;
        self.rest = self.rest.get(bytes..).ok_or(Problem::End)?;
        Ok(())
    }

    fn end(&mut self) -> Result<(), Problem> {
        Ok(())
    }

    fn numbers_left(&self, of: Type) -> u64 {
        (self.rest.len() / of.bytes()) as u64
    }

    fn rows_left(&self, _numbers: u64, bytes: u64) -> u64 {
        self.rest.len() as u64 / bytes.max(1)
    }

    fn is_fixed_size(&self) -> bool {
        true
    }

    fn place(&self) -> String {
        format!("byte {}", self.size - self.rest.len())
    }

    fn has_more(&self) -> bool {
        !self.rest.trim_ascii().is_empty()
    }
}
