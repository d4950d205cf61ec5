//! OpenEXR of linear light: channels R, G, B (Rec. 709 primaries, D65) or Y, f32, scan lines in ZIP blocks of 16.

use std::io::BufWriter;
use std::ops::Range;

use ::exr::block::writer::ChunksWriter;
use ::exr::block::{BlockIndex, UncompressedBlock};
use ::exr::meta::attribute::{ChannelDescription, LineOrder, SampleType, Text};
use ::exr::meta::header::{Header, LayerAttributes};
use ::exr::meta::{BlockDescription, MetaData};
use ::exr::prelude::{Compression, SmallVec, Vec2};

use super::Developed;
use crate::durable::{AtomicFile, DurableError};
use crate::export::ExportError;
use crate::export::in_order::in_order;
use crate::parallel::Progress;

/// Lines of a block of this compression.
const LINES: usize = 16;

/// Writes an OpenEXR file; `make` gives the linear values of a strip of rows, pixel by pixel.
///
/// # Errors
/// [`ExportError`] of the file, or the caller's; no file is created then.
pub fn write_exr<E: From<ExportError> + Send>(
    picture: &Developed<'_>,
    progress: Progress<'_>,
    make: impl Fn(Range<usize>) -> Result<Vec<f32>, E> + Sync,
) -> Result<(), E> {
    picture.check("OpenEXR", i32::MAX as usize)?;
    let file = AtomicFile::create(picture.path).map_err(ExportError::from)?;
    let out = BufWriter::with_capacity(1 << 20, file.writer());
    // The encoder's error type cannot carry the caller's: it is stored here.
    let mut first_error = None;
    let headers = SmallVec::from_vec(vec![header(picture)]);
    let result = ::exr::block::write(out, headers, true, |meta, writer| {
        blocks(picture, &meta, writer, progress, &make).map_err(|e| {
            first_error = Some(e);
            ::exr::error::Error::Aborted
        })
    });
    if let Some(error) = first_error {
        return Err(error);
    }
    result.map_err(|e| failed(picture, e))?;
    Ok(file.finish().map_err(ExportError::from)?)
}

fn header(p: &Developed<'_>) -> Header {
    let names: &[&str] = if p.channels == 3 { &["B", "G", "R"] } else { &["Y"] };
    let channels = names.iter().map(|n| ChannelDescription::new(*n, SampleType::F32, true));
    let latin = |c: char| if c.is_ascii() { c } else { '?' };
    let comments = Some(Text::new_or_panic(p.comment.chars().map(latin).collect::<String>()));
    Header::new(Text::new_or_panic("picture"), Vec2(p.size.width, p.size.height), channels.collect())
        .with_encoding(Compression::ZIP16, BlockDescription::ScanLines, LineOrder::Increasing)
        .with_attributes(LayerAttributes { comments, ..LayerAttributes::default() })
}

fn blocks<E: From<ExportError> + Send>(
    p: &Developed<'_>,
    meta: &MetaData,
    writer: &mut (impl ChunksWriter + Send),
    progress: Progress<'_>,
    make: &(impl Fn(Range<usize>) -> Result<Vec<f32>, E> + Sync),
) -> Result<(), E> {
    let encode = |k: usize| {
        let rows = p.strip(k);
        let values = make(rows.clone())?;
        let lines = values.chunks(LINES * p.size.width * p.channels);
        let block = |(i, values): (usize, &[f32])| {
            let y = rows.start + i * LINES;
            let mut data = Vec::with_capacity(values.len() * 4);
            for line in values.chunks(p.size.width * p.channels) {
                // Channels by name: B, G, R.
                for c in (0..p.channels).rev() {
                    for pixel in line.chunks_exact(p.channels) {
                        data.extend_from_slice(&pixel[c].to_ne_bytes());
                    }
                }
            }
            let index = BlockIndex {
                layer: 0,
                pixel_position: Vec2(0, y),
                pixel_size: Vec2(p.size.width, data.len() / (4 * p.channels * p.size.width)),
                level: Vec2(0, 0),
            };
            let chunk = UncompressedBlock { index, data }.compress_to_chunk(&meta.headers);
            Ok::<_, E>((y / LINES, chunk.map_err(|e| failed(p, e))?))
        };
        lines.enumerate().map(block).collect::<Result<Vec<_>, E>>()
    };
    in_order(p.strips(), p.threads, encode, |k, chunks| {
        for (index, chunk) in chunks {
            writer.write_chunk(index, chunk).map_err(|e| failed(p, e))?;
        }
        progress(p.strip(k).end as u64, p.size.height as u64);
        Ok(())
    })
}

fn failed(p: &Developed<'_>, error: ::exr::error::Error) -> ExportError {
    match error {
        ::exr::error::Error::Io(e) => DurableError::io("write", p.path, 0, e).into(),
        other => ExportError::Format {
            path: p.path.into(),
            what: "encoding",
            expected: "supported by EXR".into(),
            found: other.to_string(),
        },
    }
}
