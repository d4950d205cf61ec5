//! The header: `ply`, the encoding, elements with their number of rows and properties, `end_header`.
//!
//! Lines end as the first one does: LF, CR LF or CR. Comments, `obj_info`, blank and unknown lines are skipped; the last with a note.

use super::super::context::Context;
use super::super::error::MeshError;
use super::super::text::{keyword, name, quote};

/// How rows are written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Encoding {
    Ascii,
    Little,
    Big,
}

/// Type of a number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Type {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Type {
    fn of(name: &[u8]) -> Option<Self> {
        Some(match name {
            b"char" | b"int8" => Self::I8,
            b"uchar" | b"uint8" => Self::U8,
            b"short" | b"int16" => Self::I16,
            b"ushort" | b"uint16" => Self::U16,
            b"int" | b"int32" => Self::I32,
            b"uint" | b"uint32" => Self::U32,
            b"float" | b"float32" => Self::F32,
            b"double" | b"float64" => Self::F64,
            _ => return None,
        })
    }

    /// Size in bytes.
    pub fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    pub fn is_integer(self) -> bool {
        !matches!(self, Self::F32 | Self::F64)
    }

    /// Smallest and largest value of an integer type.
    pub fn range(self) -> (i64, i64) {
        match self {
            Self::I8 => (-128, 127),
            Self::U8 => (0, 255),
            Self::I16 => (-32_768, 32_767),
            Self::U16 => (0, 65_535),
            Self::I32 => (i64::from(i32::MIN), i64::from(i32::MAX)),
            Self::U32 => (0, i64::from(u32::MAX)),
            Self::F32 | Self::F64 => (i64::MIN, i64::MAX),
        }
    }
}

/// A property of an element.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Property {
    pub name: String,
    /// Of the number, or of the items of a list.
    pub of: Type,
    /// Of the number of items of a list; `None` for one number.
    pub count: Option<Type>,
}

/// An element: rows of the same properties.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Element {
    pub name: String,
    pub rows: u64,
    pub properties: Vec<Property>,
}

/// A header.
#[derive(Debug, PartialEq)]
pub(super) struct Header {
    pub encoding: Encoding,
    pub elements: Vec<Element>,
    /// Bytes before the first row.
    pub body: usize,
    /// Lines before the first row.
    pub lines: u64,
}

/// What a line of a property must be.
const PROPERTY: &str = "property TYPE NAME or property list TYPE TYPE NAME; a type is char, uchar, short, ushort, int, uint, float or \
                        double, a count an integer";

impl Header {
    pub fn read(context: &Context<'_>, bytes: &[u8]) -> Result<Self, MeshError> {
        let Some((magic, _)) = bytes.split_at_checked(3).filter(|(magic, _)| magic == b"ply") else {
            return Err(context.invalid("line 1", "ply", quote(&bytes[..bytes.len().min(16)])));
        };
        let is_cr = bytes.get(magic.len()) == Some(&b'\r') && bytes.get(magic.len() + 1) != Some(&b'\n');
        let end = if is_cr { b'\r' } else { b'\n' };
        let (mut encoding, mut elements) = (None, Vec::<Element>::new());
        let (mut at, mut line) = (0, 0u64);
        loop {
            let Some(length) = bytes[at..].iter().position(|&b| b == end) else {
                return Err(context.invalid(
                    format!("line {}", line + 1),
                    "end_header",
                    "the end of the file",
                ));
            };
            let text = bytes[at..at + length].trim_ascii();
            (at, line) = (at + length + 1, line + 1);
            let wrong = |expected: &str| context.invalid(format!("line {line}"), expected, quote(text));
            let (word, rest) = keyword(text);
            match word {
                b"end_header" => break,
                b"format" => {
                    encoding = Some(match rest {
                        b"ascii 1.0" => Encoding::Ascii,
                        b"binary_little_endian 1.0" => Encoding::Little,
                        b"binary_big_endian 1.0" => Encoding::Big,
                        _ => {
                            return Err(wrong(
                                "format ascii, binary_little_endian or binary_big_endian, and 1.0",
                            ));
                        }
                    });
                }
                b"element" => {
                    context.charge(256 + text.len() as u64 * 4, || "header".into())?;
                    let (element, rows) = keyword(rest);
                    let rows = std::str::from_utf8(rows).ok().and_then(|rows| rows.parse().ok());
                    let Some(rows) = rows else { return Err(wrong("element NAME ROWS")) };
                    let name = name(element);
                    if matches!(name.as_str(), "vertex" | "face") && elements.iter().any(|e| e.name == name) {
                        return Err(wrong("one element vertex and one element face"));
                    }
                    elements.push(Element { name, rows, properties: Vec::new() });
                }
                b"property" => {
                    context.charge(256 + text.len() as u64 * 4, || "header".into())?;
                    let property = property(rest).ok_or_else(|| wrong(PROPERTY))?;
                    let element = elements.last_mut().ok_or_else(|| wrong("element before property"))?;
                    element.properties.push(property);
                }
                b"comment" if keyword(rest).0 == b"TextureFile" => {
                    context.note("the texture of a comment TextureFile is not read");
                }
                b"comment" | b"obj_info" | b"" => {}
                b"ply" if line == 1 => {}
                _ => context.note("the header has lines of unknown meaning, which are skipped"),
            }
        }
        let encoding = encoding.ok_or_else(|| {
            context.invalid(format!("line {line}"), "a line `format` before it", "end_header")
        })?;
        Ok(Self { encoding, elements, body: at, lines: line })
    }
}

fn property(text: &[u8]) -> Option<Property> {
    let (first, rest) = keyword(text);
    if first != b"list" {
        return Some(Property { name: name(rest), of: Type::of(first)?, count: None });
    }
    let (count, rest) = keyword(rest);
    let (of, rest) = keyword(rest);
    let count = Type::of(count).filter(|count| count.is_integer())?;
    Some(Property { name: name(rest), of: Type::of(of)?, count: Some(count) })
}
