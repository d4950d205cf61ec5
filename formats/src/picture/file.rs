//! A picture appears whole or not at all: temp name in the same folder → write → fsync → rename.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use super::PictureError;
use crate::durable::WholeFile;
use pipeline::geometry::Size;

/// Bytes collected before they become a chunk of the PNG: at the encoder's own 4 KiB a third of the chunks' headers
/// and checks would be waste.
const CHUNK_BYTES: usize = 1 << 16;

/// Writes a file by `fill`, atomically.
pub(super) fn write_atomic<T>(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<&File>) -> Result<T, PictureError>,
) -> Result<T, PictureError> {
    let (whole, done) = whole_file(path, fill)?;
    whole.finish()?;
    Ok(done)
}

/// A file filled by `fill` that has not got its name yet.
fn whole_file<T>(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<&File>) -> Result<T, PictureError>,
) -> Result<(WholeFile, T), PictureError> {
    let failed = |source| PictureError::Write { path: path.to_owned(), source };
    let whole = WholeFile::create(path)?;
    let mut out = BufWriter::new(whole.file());
    let done = fill(&mut out)?;
    out.into_inner().map_err(|e| failed(e.into_error()))?;
    Ok((whole, done))
}

/// What the samples of a PNG are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Samples {
    /// Three bytes, sRGB-encoded; says so by an sRGB chunk.
    Srgb8,
    /// Two bytes, big-endian, linear; says so by a gAMA chunk of 1.
    LinearGrey16,
}

/// Writes a PNG row by row: `fill` gets a writer that takes exactly the picture's bytes.
pub(super) fn write_png<T>(
    path: &Path,
    size: Size,
    samples: Samples,
    comment: &str,
    fill: impl FnOnce(&mut (dyn Write + Send)) -> Result<T, PictureError>,
) -> Result<T, PictureError> {
    let (whole, done) = png_file(path, size, samples, comment, fill)?;
    whole.finish()?;
    Ok(done)
}

/// As [`write_png`], a file that has not got its name yet.
pub(super) fn png_file<T>(
    path: &Path,
    size: Size,
    samples: Samples,
    comment: &str,
    fill: impl FnOnce(&mut (dyn Write + Send)) -> Result<T, PictureError>,
) -> Result<(WholeFile, T), PictureError> {
    let encode = |source| match source {
        png::EncodingError::IoError(source) => PictureError::Write { path: path.to_owned(), source },
        source => PictureError::Encode { path: path.to_owned(), source },
    };
    let side = |n: usize| {
        u32::try_from(n).ok().filter(|&n| n <= i32::MAX as u32).ok_or_else(|| PictureError::Setting {
            setting: "max_side",
            problem: format!("a PNG has at most {} pixels a side, not {n}", i32::MAX),
        })
    };
    let (width, height) = (side(size.width)?, side(size.height)?);
    whole_file(path, |out| {
        let mut encoder = png::Encoder::new(out, width, height);
        match samples {
            Samples::Srgb8 => {
                encoder.set_color(png::ColorType::Rgb);
                encoder.set_depth(png::BitDepth::Eight);
                encoder.set_source_srgb(png::SrgbRenderingIntent::RelativeColorimetric);
                encoder.set_filter(png::Filter::Adaptive);
                encoder.set_deflate_compression(png::DeflateCompression::Level(6));
            }
            Samples::LinearGrey16 => {
                encoder.set_color(png::ColorType::Grayscale);
                encoder.set_depth(png::BitDepth::Sixteen);
                encoder.set_source_gamma(png::ScaledFloat::new(1.0));
                // 400 MB at full size: the fast way costs a tenth of the time and little room.
                encoder.set_filter(png::Filter::Up);
                encoder.set_deflate_compression(png::DeflateCompression::Level(1));
            }
        }
        encoder.add_text_chunk("Comment".into(), comment.into()).map_err(encode)?;
        let mut writer = encoder.write_header().map_err(encode)?;
        let mut stream = writer.stream_writer_with_size(CHUNK_BYTES).map_err(encode)?;
        let done = fill(&mut stream)?;
        stream.finish().map_err(encode)?;
        writer.finish().map_err(encode)?;
        Ok(done)
    })
}

/// Writes a BigTIFF of three 16-bit samples a pixel, sRGB-encoded, row by row: `fill` gets what takes one row of samples.
pub(super) fn write_tiff<T>(
    path: &Path,
    size: Size,
    comment: &str,
    fill: impl FnOnce(&mut (dyn FnMut(&[u16]) -> Result<(), PictureError> + Send)) -> Result<T, PictureError>,
) -> Result<T, PictureError> {
    let encode = |source| match source {
        tiff::TiffError::IoError(source) => PictureError::Write { path: path.to_owned(), source },
        source => PictureError::Tiff { path: path.to_owned(), source },
    };
    let side = |n: usize| {
        u32::try_from(n).map_err(|_| PictureError::Setting {
            setting: "max_side",
            problem: format!("a TIFF has at most {} pixels a side, not {n}", u32::MAX),
        })
    };
    let (width, height) = (side(size.width)?, side(size.height)?);
    write_atomic(path, |out| {
        let mut encoder = tiff::encoder::TiffEncoder::new_big(out).map_err(encode)?;
        let mut image =
            encoder.new_image::<tiff::encoder::colortype::RGB16>(width, height).map_err(encode)?;
        image.encoder().write_tag(tiff::tags::Tag::ImageDescription, comment).map_err(encode)?;
        let mut strip = Vec::new();
        let done = fill(&mut |row: &[u16]| {
            strip.extend_from_slice(row);
            if strip.len() as u64 == image.next_strip_sample_count() {
                image.write_strip(&strip).map_err(encode)?;
                strip.clear();
            }
            Ok(())
        })?;
        image.finish().map_err(encode)?;
        Ok(done)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn a_picture_that_fails_leaves_nothing_behind() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        fs::write(&path, b"before").unwrap();
        let short = write_png(&path, Size::new(2, 2), Samples::Srgb8, "", |out| {
            out.write_all(&[0; 5]).map_err(|source| PictureError::Write { path: path.clone(), source })
        });
        assert!(matches!(short, Err(PictureError::Encode { .. })), "{short:?}");
        assert_eq!(fs::read(&path).unwrap(), b"before");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_folder_that_is_not_there_is_named() {
        let error = write_atomic(Path::new("/nowhere/at/all.png"), |_| Ok(())).unwrap_err().to_string();
        assert!(error.contains("/nowhere/at/all.png"), "{error}");
    }
}
