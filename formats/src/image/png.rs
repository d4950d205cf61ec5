//! PNG (ISO/IEC 15948).

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use ::png::{BitDepth, ColorType, Decoder, Limits, Reader, ScaledFloat, Transformations};
use pipeline::geometry::Size;

use super::header::{
    ALPHA_NOTE, ImageError, ImageHeader, MAX_DECODED_BYTES, PROFILE_NOTE, RowSink, guarded, header_error,
    primaries_note, without_alpha,
};
use crate::durable::DurableError;

/// A file whose header has been read, positioned at its first row.
pub(crate) struct PngRows {
    reader: Reader<BufReader<File>>,
    has_alpha: bool,
}

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
    let (channels, has_alpha) = match colour {
        ColorType::Grayscale => (1, false),
        ColorType::GrayscaleAlpha => (1, true),
        ColorType::Rgba => (3, true),
        ColorType::Rgb | ColorType::Indexed => (3, false),
    };
    let white = if depth == BitDepth::Sixteen { u16::MAX } else { 255 };
    let mut notes = Vec::new();
    if info.icc_profile.is_some() {
        notes.push(PROFILE_NOTE.into());
    }
    if let Some(code) = info.coding_independent_code_points
        && (code.color_primaries != 1 || !matches!(code.transfer_function, 1 | 13))
    {
        notes.push(format!(
            "its code points (cICP: colour primaries {}, transfer function {}) are not applied: its samples are interpreted as sRGB",
            code.color_primaries, code.transfer_function
        ));
    }
    if let Some(found) = info.chrm_chunk
        && info.srgb.is_none()
    {
        let xy = |(x, y): (ScaledFloat, ScaledFloat)| (x.into_value(), y.into_value());
        notes.extend(primaries_note([xy(found.red), xy(found.green), xy(found.blue), xy(found.white)]));
    }
    if has_alpha {
        notes.push(ALPHA_NOTE.into());
    }
    if let Some(gamma) = info.gama_chunk.map(ScaledFloat::into_value)
        && info.srgb.is_none()
        && (gamma - 0.45455).abs() > 0.01
    {
        notes.push(format!(
            "it has gamma {gamma}, which is not applied; --linear interprets its samples as linear"
        ));
    }
    let size = Size::new(info.height as usize, info.width as usize);
    Ok((ImageHeader { size, channels, white, notes }, PngRows { reader, has_alpha }))
}

impl PngRows {
    /// Decodes all rows; stops without an error where the file has no more.
    pub(crate) fn for_each_row<E: From<ImageError>>(
        mut self,
        path: &Path,
        header: &ImageHeader,
        sink: RowSink<'_, E>,
    ) -> Result<(), E> {
        let stored = header.size.width * (header.channels + usize::from(self.has_alpha));
        let mut samples = Vec::with_capacity(stored);
        for row in 0..header.size.height {
            let found = guarded(path, || {
                samples.clear();
                self.reader.next_row().map(|row| {
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
            if !found || samples.len() != stored {
                return Ok(());
            }
            if self.has_alpha {
                without_alpha(path, header, row, &mut samples)?;
            }
            sink(row, &samples)?;
        }
        Ok(())
    }
}
