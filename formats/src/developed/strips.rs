//! TIFF 6.0 of one page in uncompressed strips, made on all threads: developed pictures, and DNG.
//!
//! Classic TIFF where the file stays below 4 GiB, else BigTIFF.

use std::borrow::Cow;
use std::io::{BufWriter, Seek, Write};
use std::ops::Range;
use std::path::Path;

use ::tiff::TiffError;
use ::tiff::encoder::{Rational, SRational, TiffEncoder, TiffKind, TiffKindBig, TiffKindStandard, TiffValue};
use ::tiff::tags::{Tag, Type};
use pipeline::geometry::Size;

use super::Developed;
use crate::durable::{AtomicFile, DurableError};
use crate::export::ExportError;
use crate::export::in_order::in_order;
use crate::parallel::Progress;

/// Bytes that a classic TIFF may have, a margin for tags left.
const CLASSIC_BYTES: u64 = (1 << 32) - (1 << 24);

/// Value of a tag.
pub(crate) enum Value {
    Byte(Vec<u8>),
    Opaque(Vec<u8>),
    Short(Vec<u16>),
    Long(Vec<u32>),
    Text(String),
    Rational(Vec<f64>),
    SignedRational(Vec<f64>),
    Double(Vec<f64>),
}

/// Bytes of the type UNDEFINED.
struct Opaque<'a>(&'a [u8]);

impl TiffValue for Opaque<'_> {
    const BYTE_LEN: u8 = 1;
    const FIELD_TYPE: Type = Type::UNDEFINED;

    fn count(&self) -> usize {
        self.0.len()
    }

    fn data(&self) -> Cow<'_, [u8]> {
        Cow::Borrowed(self.0)
    }
}

/// A page.
pub(crate) struct Page<'a> {
    pub(crate) path: &'a Path,
    pub(crate) size: Size,
    /// Samples of a pixel, and bytes of a sample.
    pub(crate) samples: (usize, usize),
    pub(crate) rows: usize,
    pub(crate) threads: usize,
    /// Tags besides those of size and strips.
    pub(crate) tags: Vec<(u16, Value)>,
}

/// Writes a TIFF; `make` gives the samples (codes of the depth) of a strip of rows.
///
/// # Errors
/// [`ExportError`] of the file, or the caller's; no file is created then.
pub fn write_tiff<E: From<ExportError> + Send>(
    picture: &Developed<'_>,
    progress: Progress<'_>,
    make: impl Fn(Range<usize>) -> Result<Vec<u16>, E> + Sync,
) -> Result<(), E> {
    picture.check("TIFF", u32::MAX as usize)?;
    let page = Page {
        path: picture.path,
        size: picture.size,
        samples: (picture.channels, picture.depth as usize / 8),
        rows: picture.rows,
        threads: picture.threads,
        tags: vec![
            (262, Value::Short(vec![if picture.channels == 3 { 2 } else { 1 }])),
            (270, Value::Text(picture.comment.into())),
            (305, Value::Text(concat!("lenscube ", env!("CARGO_PKG_VERSION")).into())),
        ],
    };
    page.write(progress, |rows| {
        let samples = make(rows)?;
        Ok(match picture.depth {
            8 => samples.iter().map(|v| *v as u8).collect(),
            _ => samples.iter().flat_map(|v| v.to_ne_bytes()).collect(),
        })
    })
}

impl Page<'_> {
    fn bytes(&self) -> u64 {
        (self.size.pixels() * self.samples.0 * self.samples.1) as u64
    }

    /// Whether a classic TIFF holds it.
    pub(crate) fn is_classic(&self) -> bool {
        self.bytes() < CLASSIC_BYTES
    }

    /// Writes the file; `make` gives the bytes of a strip of rows.
    pub(crate) fn write<E: From<ExportError> + Send>(
        &self,
        progress: Progress<'_>,
        make: impl Fn(Range<usize>) -> Result<Vec<u8>, E> + Sync,
    ) -> Result<(), E> {
        let file = AtomicFile::create(self.path).map_err(ExportError::from)?;
        let mut out = BufWriter::with_capacity(1 << 20, file.writer());
        match self.is_classic() {
            true => {
                let encoder = TiffEncoder::new_generic(&mut out).map_err(|e| failed(self.path, e))?;
                self.strips::<_, TiffKindStandard, E>(encoder, progress, make)?;
            }
            false => {
                let encoder = TiffEncoder::new_generic(&mut out).map_err(|e| failed(self.path, e))?;
                self.strips::<_, TiffKindBig, E>(encoder, progress, make)?;
            }
        }
        let flushed = out.into_inner().map_err(|e| DurableError::io("write", self.path, 0, e.into_error()));
        flushed.map_err(ExportError::from)?;
        Ok(file.finish().map_err(ExportError::from)?)
    }

    fn strips<W: Write + Seek + Send, K: TiffKind + Send, E: From<ExportError> + Send>(
        &self,
        mut encoder: TiffEncoder<W, K>,
        progress: Progress<'_>,
        make: impl Fn(Range<usize>) -> Result<Vec<u8>, E> + Sync,
    ) -> Result<(), E> {
        let fail = |e| failed(self.path, e);
        let mut page = encoder.image_directory().map_err(fail)?;
        let count = self.size.height.div_ceil(self.rows);
        let rows = |k: usize| k * self.rows..((k + 1) * self.rows).min(self.size.height);
        let mut strips: Vec<(u64, u64)> = Vec::with_capacity(count);
        in_order(
            count,
            self.threads,
            |k| make(rows(k)),
            |k, bytes: Vec<u8>| {
                let offset = page.write_data(&bytes[..]).map_err(fail)?;
                strips.push((offset, bytes.len() as u64));
                progress(rows(k).end as u64, self.size.height as u64);
                Ok(())
            },
        )?;
        let (samples, sample_bytes) = self.samples;
        let bits = vec![8 * sample_bytes as u16; samples];
        let own = [
            (256, Value::Long(vec![self.size.width as u32])),
            (257, Value::Long(vec![self.size.height as u32])),
            (258, Value::Short(bits)),
            (259, Value::Short(vec![1])),
            (274, Value::Short(vec![1])),
            (277, Value::Short(vec![samples as u16])),
            (278, Value::Long(vec![self.rows.min(self.size.height) as u32])),
            (284, Value::Short(vec![1])),
        ];
        for (tag, value) in own.iter().chain(&self.tags) {
            let tag = Tag::from_u16_exhaustive(*tag);
            match value {
                Value::Byte(v) => page.write_tag(tag, &v[..]),
                Value::Opaque(v) => page.write_tag(tag, Opaque(v)),
                Value::Short(v) => page.write_tag(tag, &v[..]),
                Value::Long(v) => page.write_tag(tag, &v[..]),
                Value::Text(v) => page.write_tag(tag, ascii(v).as_str()),
                Value::Double(v) => page.write_tag(tag, &v[..]),
                Value::Rational(v) => {
                    page.write_tag(tag, &v.iter().map(|v| rational(*v)).collect::<Vec<_>>()[..])
                }
                Value::SignedRational(v) => {
                    page.write_tag(tag, &v.iter().map(|v| signed(*v)).collect::<Vec<_>>()[..])
                }
            }
            .map_err(fail)?;
        }
        let narrow = |v: fn(&(u64, u64)) -> u64| strips.iter().map(|s| v(s) as u32).collect::<Vec<_>>();
        let wide = |v: fn(&(u64, u64)) -> u64| strips.iter().map(v).collect::<Vec<_>>();
        for (tag, of) in
            [(Tag::StripOffsets, (|s| s.0) as fn(&(u64, u64)) -> u64), (Tag::StripByteCounts, |s| s.1)]
        {
            match self.is_classic() {
                true => page.write_tag(tag, &narrow(of)[..]),
                false => page.write_tag(tag, &wide(of)[..]),
            }
            .map_err(fail)?;
        }
        page.finish().map_err(fail)?;
        Ok(())
    }
}

/// TIFF's text is ASCII.
fn ascii(text: &str) -> String {
    text.replace('µ', "u").chars().map(|c| if c.is_ascii() && c != '\0' { c } else { '?' }).collect()
}

/// The largest denominator, a power of ten, with which a number fits.
fn denominator(v: f64) -> f64 {
    [1e9, 1e8, 1e7, 1e6, 1e5, 1e4, 1e3, 1e2, 1e1].into_iter().find(|d| v.abs() * d < 2e9).unwrap_or(1.0)
}

fn rational(v: f64) -> Rational {
    let d = denominator(v);
    Rational { n: (v * d).round() as u32, d: d as u32 }
}

fn signed(v: f64) -> SRational {
    let d = denominator(v);
    SRational { n: (v * d).round() as i32, d: d as i32 }
}

fn failed(path: &Path, error: TiffError) -> ExportError {
    match error {
        TiffError::IoError(e) => DurableError::io("write", path, 0, e).into(),
        other => ExportError::Format {
            path: path.into(),
            what: "encoding",
            expected: "supported by TIFF".into(),
            found: other.to_string(),
        },
    }
}
