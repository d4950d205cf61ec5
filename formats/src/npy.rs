//! NumPy files (NEP 1): `\x93NUMPY`, version (1 to 3), header length (u16; u32 from version 2), a Python dict literal with the keys
//! `descr`, `fortran_order` and `shape`, then the samples. The literal is parsed, never evaluated.
//!
//! Supported: f2, f4, f8, u1, u2, u4, i2 and i4 of either byte order, at most 5 axes; readers restrict this further.

use crate::sample::{RasterSample, Sample};
use crate::shard::SampleType;

/// Bytes to read from the start of a file to parse its header.
pub(crate) const MAX_HEADER_BYTES: u64 = (1 << 16) + 12;
const MAX_AXES: usize = 5;

/// Property of a header, its expected and its found value.
pub(crate) type HeaderError = (&'static str, String, String);

/// A parsed header.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Header {
    pub(crate) sample: RasterSample,
    pub(crate) little_endian: bool,
    /// Sizes of the axes, slowest first.
    pub(crate) shape: Vec<usize>,
    /// Bytes before the first sample.
    pub(crate) offset: usize,
    /// Whether the first axis varies fastest.
    pub(crate) fortran: bool,
}

/// Parses the header in the first [`MAX_HEADER_BYTES`] of a file, or in all of a shorter one.
pub(crate) fn header(head: &[u8]) -> Result<Header, HeaderError> {
    let error = |what, expected: &str, found: String| (what, expected.to_owned(), found);
    let truncated = || error("NPY header", "a complete header", format!("{} bytes", head.len()));
    if !head.starts_with(b"\x93NUMPY") {
        return Err(error("first bytes", "\\x93NUMPY", "something else".into()));
    }
    let (&version, rest) = head.get(6).zip(head.get(8..)).ok_or_else(truncated)?;
    let (length, start) = match version {
        1 => (usize::from(u16::from_le_bytes(rest.first_chunk().copied().ok_or_else(truncated)?)), 10),
        2 | 3 => (u32::from_le_bytes(rest.first_chunk().copied().ok_or_else(truncated)?) as usize, 12),
        other => return Err(error("NPY version", "1 to 3", other.to_string())),
    };
    if (length + start) as u64 > MAX_HEADER_BYTES {
        return Err(error("NPY header", "at most 65536 bytes", format!("{length}")));
    }
    let text = head.get(start..).and_then(|h| h.get(..length)).ok_or_else(truncated)?;
    let text = std::str::from_utf8(text).map_err(|_| error("NPY header", "text", "other bytes".into()))?;
    let value_of = |key: &'static str| {
        let at = text.find(&format!("'{key}'")).map(|i| text[i + key.len() + 2..].trim_start());
        let value = at.and_then(|t| t.strip_prefix(':')).map(str::trim_start);
        value.ok_or_else(|| error("NPY header", "descr, fortran_order and shape", format!("no {key}")))
    };
    let descr = value_of("descr")?;
    let descr = descr.strip_prefix('\'').and_then(|d| d.split_once('\'')).map_or("", |d| d.0);
    let short = |t: &str| t.chars().take(40).collect::<String>();
    let (sample, little_endian) = parse_numpy_dtype(descr).ok_or_else(|| {
        error("samples", "f2, f4, f8, u1, u2, u4, i2 or i4 (numpy: astype)", format!("`{}`", short(descr)))
    })?;
    let order = value_of("fortran_order")?;
    let fortran = match (order.starts_with("True"), order.starts_with("False")) {
        (true, _) => true,
        (_, true) => false,
        _ => return Err(error("fortran_order", "True or False", short(order))),
    };
    let shape = value_of("shape")?;
    let inner = shape.strip_prefix('(').and_then(|s| s.split_once(')')).map_or("?", |s| s.0);
    let sides = inner.split(',').map(str::trim).filter(|n| !n.is_empty()).take(MAX_AXES + 1);
    match sides.map(|n| n.parse().ok()).collect::<Option<Vec<usize>>>() {
        Some(shape) if shape.len() <= MAX_AXES => {
            Ok(Header { sample, little_endian, shape, offset: start + length, fortran })
        }
        _ => Err(error("shape", "a list of up to 5 sizes", format!("({})", short(inner)))),
    }
}

/// [`header_of`] of f32 samples.
pub(crate) fn header_of_f32(shape: &[usize]) -> Vec<u8> {
    header_of(SampleType::F32, shape)
}

/// The header of an array of little-endian samples in C order, padded to a multiple of 64 bytes as NumPy does.
pub(crate) fn header_of(sample: SampleType, shape: &[usize]) -> Vec<u8> {
    let descr = match sample {
        SampleType::F16 => "<f2",
        SampleType::F32 => "<f4",
        SampleType::U16 => "<u2",
    };
    let sides: String = shape.iter().map(|n| format!("{n}, ")).collect();
    let mut text =
        format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({}), }}", sides.trim_end());
    text.push_str(&" ".repeat(63 - (10 + text.len()) % 64));
    text.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((text.len() as u16).to_le_bytes());
    bytes.extend(text.as_bytes());
    bytes
}

/// Sample type by its name, and whether it is little-endian (the default): bits (`u8`, `u16`, `f16`, `f32`, `f64`, prefix `>` for
/// big-endian) or a NumPy dtype (`<f4`, `>u2`, `|u1`, `f4`).
///
/// NumPy counts bytes. The names of more than one meaning are those of bits without prefix or with `>`; `<u8` and `>u8`, NumPy's
/// 64-bit integers, are not supported.
pub fn parse_dtype(name: &str) -> Option<(RasterSample, bool)> {
    let big_endian = name.strip_prefix('>');
    let sample = match big_endian.unwrap_or(name) {
        "u8" if big_endian.is_none() => Sample::U8,
        "u16" => Sample::U16,
        "f16" => Sample::F16,
        "f32" => Sample::F32,
        "f64" => Sample::F64,
        _ => return parse_numpy_dtype(name),
    };
    Some((RasterSample::Plain(sample), big_endian.is_none()))
}

/// Sample type of a NumPy dtype, and whether it is little-endian.
fn parse_numpy_dtype(dtype: &str) -> Option<(RasterSample, bool)> {
    let (little_endian, name) = match dtype.as_bytes().first()? {
        b'<' | b'|' => (true, &dtype[1..]),
        b'>' => (false, &dtype[1..]),
        b'=' => (cfg!(target_endian = "little"), &dtype[1..]),
        _ => (true, dtype),
    };
    let sample = match name {
        "i2" => return Some((RasterSample::I16, little_endian)),
        "i4" => return Some((RasterSample::I32, little_endian)),
        "u4" => return Some((RasterSample::U32, little_endian)),
        "u1" => Sample::U8,
        "u2" => Sample::U16,
        "f2" => Sample::F16,
        "f4" => Sample::F32,
        "f8" => Sample::F64,
        _ => return None,
    };
    Some((RasterSample::Plain(sample), little_endian))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn written_header_parses_to_the_same_shape_and_offset() {
        for shape in [&[3usize, 7, 5][..], &[14141, 14141], &[1], &[31, 14141, 14141]] {
            let bytes = header_of_f32(shape);
            assert_eq!(bytes.len() % 64, 0);
            let read = header(&bytes).unwrap();
            assert_eq!((read.shape.as_slice(), read.offset, read.little_endian), (shape, bytes.len(), true));
        }
    }

    #[test]
    fn sample_types_are_accepted_by_bits_and_by_numpy_name() {
        let plain = |sample, little_endian| Some((RasterSample::Plain(sample), little_endian));
        for (bits, numpy, sample) in [
            ("u8", "u1", Sample::U8),
            ("u16", "u2", Sample::U16),
            ("f16", "f2", Sample::F16),
            ("f32", "f4", Sample::F32),
            ("f64", "f8", Sample::F64),
        ] {
            assert_eq!(parse_dtype(bits), plain(sample, true), "{bits}");
            assert_eq!(parse_dtype(numpy), plain(sample, true), "{numpy}");
            assert_eq!(parse_dtype(&format!(">{numpy}")), plain(sample, false), ">{numpy}");
            assert_eq!(
                parse_dtype(&format!(">{bits}")),
                plain(sample, false).filter(|_| bits != "u8"),
                ">{bits}"
            );
        }
        for unsupported in ["", ">", "<u8", ">u8", "|u8", "<f16", "i8", "i16", "u32"] {
            assert_eq!(parse_dtype(unsupported), None, "{unsupported}");
        }
    }

    #[test]
    fn integers_of_numpy_are_sample_types() {
        let types = ["<i2", ">i4", "u4"].map(parse_dtype);
        assert_eq!(
            types,
            [
                Some((RasterSample::I16, true)),
                Some((RasterSample::I32, false)),
                Some((RasterSample::U32, true))
            ]
        );
    }

    #[test]
    fn header_with_a_type_named_by_bits_is_an_error() {
        let with_dtype = |dtype: &str| {
            let text =
                String::from_utf8(header_of_f32(&[3, 5, 7])[10..].to_vec()).unwrap().replace("<f4", dtype);
            let length = u16::try_from(text.len()).unwrap().to_le_bytes();
            header(&[&b"\x93NUMPY\x01\x00"[..], &length[..], text.as_bytes()].concat()).is_ok()
        };
        // In a header `u8` is a 64-bit integer and `f16` a long double.
        assert_eq!(
            ["<f4", ">u2", "<u8", "u8", "<f16", "u16"].map(with_dtype),
            [true, true, false, false, false, false]
        );
    }
}
