//! PNG (ISO/IEC 15948).

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use ::png::{BitDepth, ColorType, Decoder, Limits, Reader, Transformations};
use pipeline::geometry::Size;

use super::header::{
    ImageError, ImageHeader, MAX_DECODED_BYTES, RowSink, alpha_error, guarded, header_error,
};
use crate::durable::DurableError;

/// A file whose header has been read, positioned at its first row.
pub(crate) struct PngRows(Reader<BufReader<File>>);

/// Reads the header.
pub(crate) fn open(path: &Path) -> Result<(ImageHeader, PngRows), ImageError> {
    let file = File::open(path).map_err(|e| DurableError::io("open", path, 0, e))?;
    let reader = guarded(path, || {
        let limits = Limits { bytes: MAX_DECODED_BYTES };
        let mut decoder = Decoder::new_with_limits(BufReader::with_capacity(1 << 20, file), limits);
        // Palettes are converted to RGB, 1 to 4 bits to 8, transparent colours to an alpha channel.
        decoder.set_transformations(Transformations::EXPAND);
        decoder.read_info()
    })?;
    let info = reader.info();
    if info.interlaced {
        return Err(header_error(
            path,
            "rows",
            "one after the other; save it without interlacing",
            "interlaced rows",
        ));
    }
    let (colour, depth) = reader.output_color_type();
    let channels = match colour {
        ColorType::Grayscale => 1,
        ColorType::Rgb => 3,
        _ => return Err(alpha_error(path)),
    };
    let white = if depth == BitDepth::Sixteen { u16::MAX } else { 255 };
    let mut notes = Vec::new();
    if info.icc_profile.is_some() {
        notes.push(
            "it has a colour profile, which is not applied: its samples are interpreted as sRGB".into(),
        );
    }
    if let Some(gamma) = info.gama_chunk.map(::png::ScaledFloat::into_value)
        && info.srgb.is_none()
        && (gamma - 0.45455).abs() > 0.01
    {
        notes.push(format!(
            "it has gamma {gamma}, which is not applied; --linear interprets its samples as linear"
        ));
    }
    let size = Size::new(info.height as usize, info.width as usize);
    Ok((ImageHeader { size, channels, white, notes }, PngRows(reader)))
}

impl PngRows {
    /// Decodes all rows; stops without an error where the file has no more.
    pub(crate) fn for_each_row<E: From<ImageError>>(
        mut self,
        path: &Path,
        header: &ImageHeader,
        sink: RowSink<'_, E>,
    ) -> Result<(), E> {
        let mut samples = Vec::with_capacity(header.size.width * header.channels);
        for row in 0..header.size.height {
            let found = guarded(path, || {
                samples.clear();
                self.0.next_row().map(|row| {
                    row.is_some_and(|row| {
                        match header.white {
                            255 => samples.extend(row.data().iter().map(|&v| u16::from(v))),
                            _ => samples
                                .extend(row.data().as_chunks().0.iter().map(|&b| u16::from_be_bytes(b))),
                        }
                        true
                    })
                })
            })?;
            if !found || samples.len() != header.size.width * header.channels {
                return Ok(());
            }
            sink(row, &samples)?;
        }
        Ok(())
    }
}
