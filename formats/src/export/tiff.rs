//! BigTIFF: one picture with a sample per band, f32, planar, uncompressed: a raster of several bands in GDAL.
//!
//! TIFF 6.0 with 64-bit offsets (BigTIFF, magic 43), PlanarConfiguration 2, SampleFormat 3 (IEEE floating point), strips of about a
//! megabyte. Readers present it as (bands, rows, columns). Wavelengths and unit are items of GDAL's metadata (tag 42112), which
//! [`crate::chart`] reads as well. For colour previews see [`crate::picture::preview`].

use std::fmt::Write as _;
use std::io::{BufWriter, Seek, Write};
use std::path::Path;

use ::tiff::TiffResult;
use ::tiff::encoder::{DirectoryEncoder, Rational, TiffEncoder, TiffKindBig};
use ::tiff::tags::Tag;
use pipeline::geometry::Rect;

use super::in_order::in_order;
use super::{ExportError, Progress, Samples, Written};
use crate::durable::{AtomicFile, DurableError};

/// Tags XPosition, YPosition, GDAL_METADATA.
const X_POSITION: u16 = 286;
const Y_POSITION: u16 = 287;
const GDAL_METADATA: u16 = 42112;
/// Size of a strip, unless there would be more than [`MAX_STRIPS`].
const STRIP_BYTES: usize = 1 << 20;
const MAX_STRIPS: usize = 1 << 16;

/// Writes every band as a plane.
///
/// # Errors
/// [`ExportError`]; no file is created then.
pub fn write_bands(
    path: &Path,
    samples: &Samples<'_>,
    progress: Progress<'_>,
) -> Result<Written, ExportError> {
    let (all, bands) = (samples.rect, samples.bands());
    let at_most = |what, value: usize, max: u32| match u32::try_from(value) {
        Ok(v) if v <= max => Ok(v),
        _ => Err(ExportError::Format {
            path: path.into(),
            what,
            expected: format!("at most {max}"),
            found: value.to_string(),
        }),
    };
    let (width, height) =
        (at_most("side in pixels", all.width, u32::MAX)?, at_most("side in pixels", all.height, u32::MAX)?);
    at_most("bands", bands, u16::MAX.into())?;
    let strip_rows = (STRIP_BYTES / (4 * all.width).max(1))
        .max((all.height * bands).div_ceil(MAX_STRIPS))
        .clamp(1, all.height.max(1));
    let file = AtomicFile::create(path)?;
    let mut out = BufWriter::with_capacity(1 << 20, file.writer());
    let mut encoder = TiffEncoder::new_big(&mut out).map_err(|e| failed(path, e))?;
    let mut picture = encoder.image_directory().map_err(|e| failed(path, e))?;
    let read_strips = samples.strips();
    let total = (bands * all.size().pixels()) as u64;
    let mut written = Written::default();
    let (mut done, mut offsets, mut counts) = (0, Vec::<u64>::new(), Vec::<u64>::new());
    for band in 0..bands {
        let make = |unit: usize| {
            let rows = &read_strips[unit];
            let rect = Rect::new(rows.start, all.x, (rows.end - rows.start) as usize, all.width);
            let mut pixels = vec![0.0; rect.size().pixels()];
            let missing = samples.read(band, rect, &mut pixels)?;
            Ok::<_, ExportError>((pixels, missing))
        };
        // The file's strips end at other rows than those that are read.
        let mut pending: Vec<f32> = Vec::new();
        in_order(read_strips.len(), samples.threads, make, |unit, (pixels, missing)| {
            written.missing += missing;
            done += pixels.len() as u64;
            pending.extend(pixels);
            let is_last = unit + 1 == read_strips.len();
            let whole = pending.len() / (strip_rows * all.width) * strip_rows * all.width;
            let end = if is_last { pending.len() } else { whole };
            for strip in pending[..end].chunks(strip_rows * all.width) {
                offsets.push(picture.write_data(strip).map_err(|e| failed(path, e))?);
                counts.push(4 * strip.len() as u64);
            }
            pending.drain(..end);
            progress(done, total);
            Ok::<_, ExportError>(())
        })?;
    }
    let tags = |picture: &mut DirectoryEncoder<'_, _, TiffKindBig>| {
        picture.write_tag(Tag::ImageWidth, width)?;
        picture.write_tag(Tag::ImageLength, height)?;
        picture.write_tag(Tag::BitsPerSample, &vec![32u16; bands][..])?;
        picture.write_tag(Tag::Compression, 1u16)?;
        // Grey with black as 0; the other samples are of unspecified kind.
        picture.write_tag(Tag::PhotometricInterpretation, 1u16)?;
        if bands > 1 {
            picture.write_tag(Tag::ExtraSamples, &vec![0u16; bands - 1][..])?;
        }
        picture.write_tag(Tag::SamplesPerPixel, bands as u16)?;
        picture.write_tag(Tag::PlanarConfiguration, 2u16)?;
        picture.write_tag(Tag::SampleFormat, &vec![3u16; bands][..])?;
        picture.write_tag(Tag::RowsPerStrip, strip_rows as u32)?;
        picture.write_tag(Tag::StripOffsets, &offsets[..])?;
        picture.write_tag(Tag::StripByteCounts, &counts[..])?;
        picture.write_tag(Tag::ImageDescription, ascii(samples.description).as_str())?;
        picture.write_tag(Tag::Unknown(GDAL_METADATA), gdal_metadata(samples).as_str())?;
        match samples.pitch_um {
            Some(pitch_um) => write_place(picture, samples, pitch_um),
            None => Ok(()),
        }
    };
    tags(&mut picture).and_then(|()| picture.finish()).map_err(|e| failed(path, e))?;
    out.into_inner().map_err(|e| DurableError::io("write", path, 0, e.into_error()))?;
    written.bytes = file.file().metadata().map_err(|e| DurableError::io("look up", path, 0, e))?.len();
    file.finish()?;
    Ok(written)
}

/// Writes resolution and position, in pixels per cm and cm.
fn write_place<W: Write + Seek>(
    picture: &mut DirectoryEncoder<'_, W, TiffKindBig>,
    samples: &Samples<'_>,
    pitch_um: f64,
) -> TiffResult<()> {
    picture.write_tag(Tag::ResolutionUnit, 3u16)?;
    picture.write_tag(Tag::XResolution, rational(1e4 / pitch_um))?;
    picture.write_tag(Tag::YResolution, rational(1e4 / pitch_um))?;
    let cm = |px: i64| rational(px as f64 * pitch_um * 1e-4);
    picture.write_tag(Tag::Unknown(X_POSITION), cm(samples.rect.x))?;
    picture.write_tag(Tag::Unknown(Y_POSITION), cm(samples.rect.y))
}

/// The fraction nearest to a number that is not negative, with the largest power of ten up to 1000 as denominator that fits.
fn rational(v: f64) -> Rational {
    let d = [1000u32, 100, 10, 1].into_iter().find(|d| v * f64::from(*d) <= f64::from(u32::MAX)).unwrap_or(1);
    Rational { n: (v * f64::from(d)).round() as u32, d }
}

/// Wavelengths, descriptions and unit of the bands as GDAL's XML.
fn gdal_metadata(samples: &Samples<'_>) -> String {
    let mut xml = String::from("<GDALMetadata>\n");
    for (band, nm) in samples.wavelengths_nm.iter().enumerate() {
        let mut item = |name: &str, role: &str, text: &str| {
            // Writing to a string does not fail.
            let _ = writeln!(xml, "  <Item name=\"{name}\" sample=\"{band}\"{role}>{text}</Item>");
        };
        item("wavelength", "", &nm.to_string());
        item("wavelength_units", "", "Nanometers");
        item("DESCRIPTION", " role=\"description\"", &format!("{nm} nm"));
        if let Some(units) = samples.units {
            let units = units.replace('&', "&amp;").replace('<', "&lt;");
            item("UNITTYPE", " role=\"unittype\"", &ascii(&units));
        }
    }
    xml + "</GDALMetadata>\n"
}

/// TIFF's text is ASCII.
fn ascii(text: &str) -> String {
    text.replace('µ', "u").chars().map(|c| if c.is_ascii() && c != '\0' { c } else { '?' }).collect()
}

fn failed(path: &Path, error: ::tiff::TiffError) -> ExportError {
    match error {
        ::tiff::TiffError::IoError(e) => DurableError::io("write", path, 0, e).into(),
        other => ExportError::Format {
            path: path.into(),
            what: "encoding",
            expected: "supported by TIFF".into(),
            found: other.to_string(),
        },
    }
}
