//! Writer: numbers, texts and structs, not compressed. Sizes are known before anything is written, so that no array is copied.

use std::io::{self, Write};

use super::{CHAR_CLASS, DOUBLE, DOUBLE_CLASS, HEADER, INT8, INT32, MATRIX, STRUCT_CLASS, UINT16, UINT32};

/// Bytes of a field's name, with its end.
const NAME_BYTES: usize = 32;
/// Bytes of numbers that are converted at a time.
const BUFFER: usize = 1 << 16;

/// A value.
#[derive(Debug)]
pub(crate) enum MatValue {
    /// A row of characters.
    Text(String),
    /// Numbers of class double, the first dimension fastest.
    Numbers {
        /// Two or more dimensions.
        shape: Vec<usize>,
        values: Vec<f64>,
    },
    /// The same of many values.
    Floats { shape: Vec<usize>, values: Vec<f32> },
    /// A struct of 1 × 1 and its fields.
    Struct(Vec<(&'static str, MatValue)>),
}

impl MatValue {
    /// One number.
    pub(crate) fn number(value: f64) -> Self {
        Self::Numbers { shape: vec![1, 1], values: vec![value] }
    }

    /// A column of numbers.
    pub(crate) fn column(values: &[f64]) -> Self {
        Self::Numbers { shape: vec![values.len(), 1], values: values.to_vec() }
    }

    /// Bytes of its array with the name `name`, without the tag.
    fn bytes(&self, name: &str) -> usize {
        let head = |dimensions: usize| element(8) + element(4 * dimensions) + element(name.len());
        match self {
            Self::Text(text) => head(2) + element(2 * text.encode_utf16().count()),
            Self::Numbers { shape, values } => head(shape.len()) + element(8 * values.len()),
            Self::Floats { shape, values } => head(shape.len()) + element(8 * values.len()),
            Self::Struct(fields) => {
                let of_fields: usize = fields.iter().map(|(_, value)| 8 + value.bytes("")).sum();
                head(2) + 8 + element(NAME_BYTES * fields.len()) + of_fields
            }
        }
    }

    fn write(&self, name: &str, out: &mut dyn Write) -> io::Result<()> {
        tag(out, MATRIX, self.bytes(name))?;
        let (class, shape) = match self {
            Self::Text(text) => (CHAR_CLASS, vec![1, text.encode_utf16().count()]),
            Self::Numbers { shape, .. } | Self::Floats { shape, .. } => (DOUBLE_CLASS, shape.clone()),
            Self::Struct(_) => (STRUCT_CLASS, vec![1, 1]),
        };
        whole(out, UINT32, [class, 0].into_iter().flat_map(u32::to_le_bytes).collect())?;
        whole(out, INT32, shape.iter().flat_map(|n| (*n as i32).to_le_bytes()).collect())?;
        whole(out, INT8, name.as_bytes().to_vec())?;
        match self {
            Self::Text(text) => whole(out, UINT16, text.encode_utf16().flat_map(u16::to_le_bytes).collect()),
            Self::Numbers { values, .. } => numbers(out, values),
            Self::Floats { values, .. } => numbers(out, values),
            Self::Struct(fields) => {
                // A small element: the length of the names.
                out.write_all(&[INT32 as u8, 0, 4, 0, NAME_BYTES as u8, 0, 0, 0])?;
                let names = fields.iter().flat_map(|(name, _)| {
                    let end = NAME_BYTES - name.len();
                    name.bytes().chain(std::iter::repeat_n(0, end))
                });
                whole(out, INT8, names.collect())?;
                fields.iter().try_for_each(|(_, value)| value.write("", out))
            }
        }
    }
}

/// Bytes of an element with `bytes` of data, its tag and padding.
fn element(bytes: usize) -> usize {
    8 + bytes.next_multiple_of(8)
}

fn tag(out: &mut dyn Write, kind: u32, bytes: usize) -> io::Result<()> {
    let bytes = u32::try_from(bytes).map_err(|_| io::Error::other("an array of more than 4 GiB"))?;
    out.write_all(&kind.to_le_bytes())?;
    out.write_all(&bytes.to_le_bytes())
}

/// An element with all of its data.
fn whole(out: &mut dyn Write, kind: u32, data: Vec<u8>) -> io::Result<()> {
    tag(out, kind, data.len())?;
    out.write_all(&data)?;
    out.write_all(&vec![0; data.len().next_multiple_of(8) - data.len()])
}

/// An element of doubles.
fn numbers<T: Copy + Into<f64>>(out: &mut dyn Write, values: &[T]) -> io::Result<()> {
    tag(out, DOUBLE, 8 * values.len())?;
    for part in values.chunks(BUFFER / 8) {
        let bytes: Vec<u8> = part.iter().flat_map(|v| (*v).into().to_le_bytes()).collect();
        out.write_all(&bytes)?;
    }
    Ok(())
}

/// Writes a file with the variable `value` of the name `name`.
///
/// # Errors
/// Those of `out`; an array of more than 4 GiB.
pub(crate) fn file(out: &mut dyn Write, name: &str, value: &MatValue) -> io::Result<()> {
    let text = concat!("MATLAB 5.0 MAT-file, written by lenscube ", env!("CARGO_PKG_VERSION"));
    let mut header = format!("{text:<116}").into_bytes();
    header.extend([0; 8]);
    header.extend(0x0100_u16.to_le_bytes());
    header.extend(b"IM");
    debug_assert_eq!(header.len(), HEADER);
    out.write_all(&header)?;
    value.write(name, out)
}
