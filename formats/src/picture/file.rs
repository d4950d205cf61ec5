//! Atomic writing of PNG and TIFF files: temporary name in the same folder → write → fsync → rename.

use std::io::{BufWriter, Write};
use std::path::Path;

use super::PictureError;
use crate::durable::{AtomicFile, FileWriter};
use pipeline::geometry::Size;
use tiff::encoder::colortype::ColorType;

/// Bytes of a PNG data chunk: more than the encoder's default of 4 KiB, for fewer chunk headers and checksums.
const CHUNK_BYTES: usize = 1 << 16;

/// A temporary file filled by `fill`; [`AtomicFile::finish`] renames it.
fn temporary_file<T>(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<FileWriter<'_>>) -> Result<T, PictureError>,
) -> Result<(AtomicFile, T), PictureError> {
    let file = AtomicFile::create(path)?;
    let mut out = BufWriter::new(file.writer());
    let filled = fill(&mut out).and_then(|done| {
        out.flush().map_err(|source| PictureError::Write { path: path.to_owned(), source }).map(|()| done)
    });
    // The error of the system first: encoders make a text of it.
    let error = out.get_ref().error(path);
    drop(out);
    match (filled, error) {
        (Ok(done), _) => Ok((file, done)),
        (Err(_), Some(error)) => Err(error.into()),
        (Err(error), None) => Err(error),
    }
}

/// A side in pixels, at most `max`.
fn side(pixels: usize, max: u32, format: &str) -> Result<u32, PictureError> {
    u32::try_from(pixels).ok().filter(|&n| n <= max).ok_or_else(|| PictureError::Setting {
        setting: "max_side",
        problem: format!("a {format} has at most {max} pixels a side, not {pixels}"),
    })
}

/// Sample format of a PNG.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Samples {
    /// Three bytes, sRGB-encoded; marked by an sRGB chunk.
    Srgb8,
    /// Two bytes, big-endian, linear; marked by a gAMA chunk of 1.
    LinearGrey16,
}

/// A PNG under a temporary name; `fill` writes exactly the picture's bytes, row by row.
pub(super) fn png_file<T>(
    path: &Path,
    size: Size,
    samples: Samples,
    comment: &str,
    fill: impl FnOnce(&mut (dyn Write + Send)) -> Result<T, PictureError>,
) -> Result<(AtomicFile, T), PictureError> {
    let encode = |source| match source {
        png::EncodingError::IoError(source) => PictureError::Write { path: path.to_owned(), source },
        source => PictureError::Encode { path: path.to_owned(), source: source.into() },
    };
    let [width, height] = [size.width, size.height].map(|n| side(n, i32::MAX as u32, "PNG"));
    let (width, height) = (width?, height?);
    temporary_file(path, |out| {
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
                // 400 MB at full size: level 1 takes a tenth of the time and hardly more space.
                encoder.set_filter(png::Filter::Up);
                encoder.set_deflate_compression(png::DeflateCompression::Level(1));
            }
        }
        // Plain text of a PNG is Latin-1.
        match comment.chars().all(|c| c <= '\u{ff}') {
            true => encoder.add_text_chunk("Comment".into(), comment.into()),
            false => encoder.add_itxt_chunk("Comment".into(), comment.into()),
        }
        .map_err(encode)?;
        let mut writer = encoder.write_header().map_err(encode)?;
        let mut stream = writer.stream_writer_with_size(CHUNK_BYTES).map_err(encode)?;
        let done = fill(&mut stream)?;
        stream.finish().map_err(encode)?;
        writer.finish().map_err(encode)?;
        Ok(done)
    })
}

/// A BigTIFF of 16-bit samples under a temporary name; `fill` passes one row of samples at a time.
pub(super) fn tiff_file<C: ColorType<Inner = u16> + Send, T>(
    path: &Path,
    size: Size,
    comment: &str,
    fill: impl FnOnce(&mut (dyn FnMut(&[u16]) -> Result<(), PictureError> + Send)) -> Result<T, PictureError>,
) -> Result<(AtomicFile, T), PictureError> {
    let encode = |source| match source {
        tiff::TiffError::IoError(source) => PictureError::Write { path: path.to_owned(), source },
        source => PictureError::Encode { path: path.to_owned(), source: source.into() },
    };
    let [width, height] = [size.width, size.height].map(|n| side(n, u32::MAX, "TIFF"));
    let (width, height) = (width?, height?);
    temporary_file(path, |out| {
        let mut encoder = tiff::encoder::TiffEncoder::new_big(out).map_err(encode)?;
        let mut image = encoder.new_image::<C>(width, height).map_err(encode)?;
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
    fn failed_write_keeps_the_old_file_and_leaves_no_temporary_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        fs::write(&path, b"before").unwrap();
        let short = png_file(&path, Size::new(2, 2), Samples::Srgb8, "", |out| {
            out.write_all(&[0; 5]).map_err(|source| PictureError::Write { path: path.clone(), source })
        });
        assert!(matches!(short, Err(PictureError::Encode { .. })));
        assert_eq!(fs::read(&path).unwrap(), b"before");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn missing_folder_is_an_error_that_names_the_path() {
        let error =
            temporary_file(Path::new("/nowhere/at/all.png"), |_| Ok(())).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains("/nowhere/at/all.png"), "{error}");
    }
}
