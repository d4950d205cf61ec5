//! PNG (ISO/IEC 15948) row by row.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use ::png::{BitDepth, ColorType, Decoder, Limits, Reader, Transformations};
use pipeline::geometry::Size;

use super::{Head, MAX_DECODED, Take, alpha, guarded, wrong};
use crate::chart::ChartError;
use crate::durable::DurableError;

/// A file whose header has been read.
pub(super) struct Rows(Reader<BufReader<File>>);

pub(super) fn open(path: &Path) -> Result<(Head, Rows), ChartError> {
    let file = File::open(path).map_err(|e| DurableError::io("open", path, 0, e))?;
    let reader = guarded(path, || {
        let limits = Limits { bytes: MAX_DECODED };
        let mut decoder = Decoder::new_with_limits(BufReader::with_capacity(1 << 20, file), limits);
        // Palettes become RGB, few bits become eight, and transparent colours an alpha channel.
        decoder.set_transformations(Transformations::EXPAND);
        decoder.read_info()
    })?;
    let info = reader.info();
    if info.interlaced {
        return Err(wrong(
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
        _ => return Err(alpha(path)),
    };
    let white = if depth == BitDepth::Sixteen { u16::MAX } else { 255 };
    let mut notes = Vec::new();
    if info.icc_profile.is_some() {
        notes.push("it has a colour profile, which is not applied: its samples are taken as sRGB".into());
    }
    if let Some(gamma) = info.gama_chunk.map(::png::ScaledFloat::into_value)
        && info.srgb.is_none()
        && (gamma - 0.45455).abs() > 0.01
    {
        notes.push(format!(
            "it says gamma {gamma}, which is not applied; --linear takes its samples as linear"
        ));
    }
    let size = Size::new(info.height as usize, info.width as usize);
    Ok((Head { size, channels, white, notes }, Rows(reader)))
}

impl Rows {
    pub(super) fn each(mut self, path: &Path, head: &Head, take: Take<'_>) -> Result<(), ChartError> {
        let mut samples = Vec::with_capacity(head.size.width * head.channels);
        for row in 0..head.size.height {
            let found = guarded(path, || {
                samples.clear();
                self.0.next_row().map(|row| {
                    row.is_some_and(|row| {
                        match head.white {
                            255 => samples.extend(row.data().iter().map(|&v| u16::from(v))),
                            _ => samples
                                .extend(row.data().as_chunks().0.iter().map(|&b| u16::from_be_bytes(b))),
                        }
                        true
                    })
                })
            })?;
            if !found || samples.len() != head.size.width * head.channels {
                return Ok(());
            }
            take(row, &samples)?;
        }
        Ok(())
    }
}
