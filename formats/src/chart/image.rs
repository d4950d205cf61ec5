//! Pictures that charts are made of: PNG, TIFF and OpenEXR, row by row, as linear samples in a temporary file.
//!
//! | file | samples | taken as |
//! |---|---|---|
//! | PNG | grey, RGB or palette of up to 16 bits, not interlaced | sRGB-encoded (IEC 61966-2-1) |
//! | TIFF, BigTIFF | grey or RGB of 8 or 16 bits, strips or tiles, chunky | sRGB-encoded |
//! | OpenEXR | R, G, B or Y, half or float | linear |
//!
//! [`Transfer::Linear`] takes whole numbers as linear too. Transparency is refused: what lies behind is not told. Files are known by
//! their first bytes. A row is decoded at a time, a strip or tile of a compressed TIFF (at most 256 MiB); its rows go linear into a
//! file of bands, so memory does not grow with the picture. Headers are bounded before anything is allocated, and a decoder that
//! breaks is an error of the file.
//! Left out: colour profiles and gamma chunks (told as a note), further pages of a TIFF, other colour models.

mod png;
mod tiff;

use std::fs::File;
use std::io::Read;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use pipeline::colour::srgb_decode;
use pipeline::flow::ChartSource;
use pipeline::geometry::Size;

use super::exr::{ExrChart, ExrContent};
use super::raster::bands::BandFile;
use super::{ChartError, MAX_VALUE, NanPolicy, RasterChart};
use crate::durable::DurableError;

/// Most bytes that a decoder may hold.
const MAX_DECODED: usize = 256 << 20;

/// What whole numbers of a picture mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Transfer {
    /// Display values.
    #[default]
    Srgb,
    /// Amounts of light.
    Linear,
}

/// A picture whose header has been read.
pub struct ImageFile {
    path: PathBuf,
    head: Head,
    source: Source,
}

enum Source {
    Png(Box<png::Rows>),
    Tiff(Box<tiff::Rows>),
    Exr(Box<ExrChart>),
}

/// What a header tells.
#[derive(Clone, Debug, PartialEq)]
struct Head {
    size: Size,
    /// 1 or 3.
    channels: usize,
    /// Largest sample.
    white: u16,
    notes: Vec<String>,
}

/// Takes row after row of samples, channels side by side.
type Take<'a> = &'a mut dyn FnMut(usize, &[u16]) -> Result<(), ChartError>;

impl ImageFile {
    /// Reads the header.
    ///
    /// # Errors
    /// [`ChartError`]: another kind of file, or one of what is left out, or whose header cannot be true.
    pub fn open(path: &Path) -> Result<Self, ChartError> {
        let mut first = Vec::new();
        let file = match File::open(path) {
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
                return Err(wrong(path, "file", "a PNG, TIFF or OpenEXR image", "nothing there"));
            }
            other => other.map_err(|e| DurableError::io("open", path, 0, e))?,
        };
        file.take(8).read_to_end(&mut first).map_err(|e| DurableError::io("read", path, 0, e))?;
        let (head, source) = match &first[..] {
            [0x89, b'P', b'N', b'G', ..] => {
                let (head, rows) = png::open(path)?;
                (head, Source::Png(Box::new(rows)))
            }
            [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..] => {
                let (head, rows) = tiff::open(path)?;
                (head, Source::Tiff(Box::new(rows)))
            }
            [0x76, 0x2f, 0x31, 0x01, ..] => {
                let exr = ExrChart::open(path, NanPolicy::Error)?;
                if exr.has_alpha() {
                    return Err(alpha(path));
                }
                let channels = if exr.content() == &ExrContent::Rgb { 3 } else { 1 };
                let head = Head { size: ChartSource::size(&exr), channels, white: 0, notes: Vec::new() };
                (head, Source::Exr(Box::new(exr)))
            }
            _ => {
                let expected = "those of a PNG, TIFF or OpenEXR image";
                return Err(wrong(path, "first bytes", expected, "something else"));
            }
        };
        Ok(Self { path: path.into(), head, source })
    }

    /// Size in pixels.
    pub fn size(&self) -> Size {
        self.head.size
    }

    /// Whether it is grey: one channel rather than three.
    pub fn is_grey(&self) -> bool {
        self.head.channels == 1
    }

    /// What its reader should know.
    pub fn notes(&self) -> &[String] {
        &self.head.notes
    }

    /// The file, if it holds a band for each of many wavelengths.
    pub fn spectral(&self) -> Option<&ExrChart> {
        match &self.source {
            Source::Exr(exr) if matches!(exr.content(), ExrContent::Spectral { .. }) => Some(exr),
            _ => None,
        }
    }

    /// Its channels as bands of linear samples, white being 1, in a temporary file in `directory`. `progress` is told pixels or rows
    /// done and in all.
    ///
    /// # Errors
    /// [`ChartError`]: no room, or a file that does not decode.
    pub fn linear(
        self,
        transfer: Transfer,
        directory: &Path,
        threads: usize,
        progress: &(dyn Fn(u64, u64) + Sync),
    ) -> Result<Box<dyn ChartSource>, ChartError> {
        let Self { path, head, source } = self;
        if let Source::Exr(exr) = source {
            let all: Vec<usize> = (0..exr.bands()).collect();
            exr.lay_out(&all, directory, threads, progress)?;
            return Ok(exr);
        }
        let Size { height, width } = head.size;
        let channels: Vec<usize> = (0..head.channels).collect();
        let out = BandFile::create(directory, &path, &channels, [head.channels, height, width])?;
        let white = f64::from(head.white);
        let linear: Vec<f32> = (0..=head.white)
            .map(|v| match transfer {
                Transfer::Srgb => srgb_decode(f64::from(v) / white) as f32,
                Transfer::Linear => (f64::from(v) / white) as f32,
            })
            .collect();
        let mut line = vec![0.0; width];
        let mut rows = 0;
        let mut take = |row: usize, samples: &[u16]| -> Result<(), ChartError> {
            for &band in &channels {
                let own = samples.iter().skip(band).step_by(head.channels);
                line.iter_mut().zip(own).for_each(|(to, &v)| *to = linear[usize::from(v)]);
                out.write(band, row, 0, &line)?;
            }
            rows += 1;
            progress(rows, height as u64);
            Ok(())
        };
        match source {
            Source::Png(reader) => reader.each(&path, &head, &mut take)?,
            Source::Tiff(reader) => reader.each(&path, &head, &mut take)?,
            Source::Exr(_) => unreachable!("returned above"),
        }
        if rows != height as u64 {
            let reason = format!("it holds {rows} rows of {height}");
            return Err(ChartError::Damaged { path, reason });
        }
        Ok(Box::new(RasterChart::laid_out(&path, out, NanPolicy::Error, None, MAX_VALUE)?))
    }
}

fn wrong(
    path: &Path,
    what: &'static str,
    expected: impl Into<String>,
    found: impl Into<String>,
) -> ChartError {
    ChartError::Header { path: path.into(), what, expected: expected.into(), found: found.into() }
}

fn alpha(path: &Path) -> ChartError {
    wrong(path, "channels", "no transparency; flatten the image onto its background", "an alpha channel")
}

/// Runs a decoder; if it breaks, the file is damaged.
fn guarded<T, E: std::fmt::Display>(
    path: &Path,
    run: impl FnOnce() -> Result<T, E>,
) -> Result<T, ChartError> {
    let damaged = |reason: String| ChartError::Damaged { path: path.into(), reason };
    match catch_unwind(AssertUnwindSafe(run)) {
        Ok(done) => done.map_err(|e| damaged(e.to_string())),
        Err(_) => Err(damaged("its decoder breaks on it".into())),
    }
}

#[cfg(test)]
mod tests;
