//! Charts from images: PNG, JPEG, WebP, TIFF (decoders: module `image`) and OpenEXR ([`super::exr`]), as bands of linear samples in a temporary file.
//!
//! | file | samples | transfer function |
//! |---|---|---|
//! | PNG, JPEG, WebP, TIFF | integers | sRGB (IEC 61966-2-1), or linear on request ([`Transfer`]) |
//! | OpenEXR | R, G, B or Y, half or float | linear |
//!
//! The format is detected from the first bytes. Rows are decoded one by one into the temporary file, so memory does not grow with
//! the image, except of JPEG and WebP ([`ImageFile::decoder_bytes`]).

use std::io::Read;
use std::path::{Path, PathBuf};

use pipeline::colour::srgb_decode;
use pipeline::flow::ChartSource;
use pipeline::geometry::{Rect, Size};

use super::error::ChartError;
use super::exr::{self, ExrContent, ExrFile};
use super::header::open_regular;
use super::options::NanPolicy;
use super::raster::RasterChart;
use super::raster::bands::BandFile;
use super::values::Values;
use crate::durable::DurableError;
use crate::image::header::{ALPHA_NOTE, ImageHeader, RowSink, header_error, transparent_error};
use crate::image::whole::WholeImage;
use crate::image::{png, tiff, whole};
use crate::parallel::Progress;
use crate::sample::{RasterSample, Sample};

/// Transfer function of integer samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Transfer {
    /// sRGB: samples are display values.
    #[default]
    Srgb,
    /// Samples are proportional to light.
    Linear,
}

/// An image file whose header has been read.
pub struct ImageFile {
    path: PathBuf,
    header: ImageHeader,
    decoder: Decoder,
}

enum Decoder {
    Png(Box<png::PngRows>),
    Tiff(Box<tiff::TiffRows>),
    Whole(Box<WholeImage>),
    Exr(Box<ExrFile>),
}

impl ImageFile {
    /// Reads the header.
    ///
    /// # Errors
    /// [`ChartError`] if the format is unknown, or the header is invalid or not supported.
    pub fn open(path: &Path) -> Result<Self, ChartError> {
        let mut first = Vec::new();
        let file = match open_regular(path) {
            Err(ChartError::NotFound { .. }) => {
                return Err(header_error(
                    path,
                    "file",
                    "a PNG, JPEG, WebP, TIFF or OpenEXR image",
                    "no such file",
                )
                .into());
            }
            other => other?,
        };
        file.take(12).read_to_end(&mut first).map_err(|e| DurableError::io("read", path, 0, e))?;
        let (header, decoder) = match &first[..] {
            [0x89, b'P', b'N', b'G', ..] => {
                let (header, rows) = png::open(path)?;
                (header, Decoder::Png(Box::new(rows)))
            }
            [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..] => {
                let (header, rows) = tiff::open(path)?;
                (header, Decoder::Tiff(Box::new(rows)))
            }
            [0xff, 0xd8, 0xff, ..] => {
                let (header, image) = whole::open_jpeg(path)?;
                (header, Decoder::Whole(Box::new(image)))
            }
            [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P'] => {
                let (header, image) = whole::open_webp(path)?;
                (header, Decoder::Whole(Box::new(image)))
            }
            [0x76, 0x2f, 0x31, 0x01, ..] => {
                let exr = exr::open(path, NanPolicy::Error)?;
                let channels = if exr.content == ExrContent::Rgb { 3 } else { 1 };
                let size = exr.chart.size();
                let mut notes = exr.chart.notes().to_vec();
                notes.extend(exr.alpha.is_some().then(|| ALPHA_NOTE.to_owned()));
                (ImageHeader { size, channels, white: 0, notes }, Decoder::Exr(Box::new(exr)))
            }
            _ => {
                let expected = "those of a PNG, JPEG, WebP, TIFF or OpenEXR image";
                return Err(header_error(path, "first bytes", expected, "something else").into());
            }
        };
        Ok(Self { path: path.into(), header, decoder })
    }

    /// Size in pixels.
    pub fn size(&self) -> Size {
        self.header.size
    }

    /// Whether it has one channel rather than three.
    pub fn is_grey(&self) -> bool {
        self.header.channels == 1
    }

    /// The integer that is white; 0 of floats.
    pub fn white(&self) -> u16 {
        self.header.white
    }

    /// Memory of decoding a format that is decoded as a whole; 0 for the others.
    pub fn decoder_bytes(&self) -> usize {
        match &self.decoder {
            Decoder::Whole(image) => image.decoder_bytes(),
            _ => 0,
        }
    }

    /// Remarks for the user.
    pub fn notes(&self) -> &[String] {
        &self.header.notes
    }

    /// The file as a spectral chart; `None` if its channels are colours.
    pub fn spectral(&self) -> Option<&ExrFile> {
        match &self.decoder {
            Decoder::Exr(exr) if matches!(exr.content, ExrContent::Spectral { .. }) => Some(exr),
            _ => None,
        }
    }

    /// Decodes the image and keeps the pixels of `part` in memory: its channels as bands of linear samples, white being 1.
    ///
    /// # Errors
    /// [`ChartError`] if the file does not decode.
    ///
    /// # Panics
    /// `part` is not inside the image.
    pub fn linear_part(self, transfer: Transfer, part: Rect) -> Result<Vec<f32>, ChartError> {
        assert!(self.size().rect().contains(part), "{part} of {}", self.size());
        let Self { path, header, decoder } = self;
        let pixels = part.size().pixels();
        let mut out = vec![0.0; header.channels * pixels];
        if let Decoder::Exr(exr) = decoder {
            if let Some(alpha) = &exr.alpha {
                check_opaque(&path, alpha, &std::env::temp_dir(), 1)?;
            }
            for (band, to) in out.chunks_exact_mut(pixels.max(1)).enumerate() {
                exr.chart.read_rect(band, part, to)?;
            }
            return Ok(out);
        }
        let linear = transfer.table(header.white);
        decoder.for_each_row(&path, &header, &mut |row, samples| {
            if (part.y..part.bottom()).contains(&(row as i64)) {
                let first = (row - part.y as usize) * part.width;
                for band in 0..header.channels {
                    let line = &mut out[band * pixels + first..][..part.width];
                    let channel = samples.iter().skip(part.x as usize * header.channels + band);
                    let channel = channel.step_by(header.channels);
                    line.iter_mut().zip(channel).for_each(|(to, &v)| *to = linear[usize::from(v)]);
                }
            }
            Ok(())
        })?;
        Ok(out)
    }

    /// Decodes the image into a temporary file in `directory` and returns its channels as bands of linear samples, white being 1.
    /// `progress` receives the number of pixels (OpenEXR) or rows done, and the total.
    ///
    /// # Errors
    /// [`ChartError::Space`] if the disk is too small; [`ChartError`] if the file does not decode.
    pub fn linear(
        self,
        transfer: Transfer,
        directory: &Path,
        threads: usize,
        progress: Progress<'_>,
    ) -> Result<Box<dyn ChartSource>, ChartError> {
        let Self { path, header, decoder } = self;
        if let Decoder::Exr(exr) = decoder {
            if let Some(alpha) = &exr.alpha {
                check_opaque(&path, alpha, directory, threads)?;
            }
            let chart = exr.chart;
            let bands: Vec<usize> = (0..chart.bands()).collect();
            chart.copy_bands(&bands, directory, threads, progress)?;
            return Ok(Box::new(chart));
        }
        let Size { height, width } = header.size;
        let channels: Vec<usize> = (0..header.channels).collect();
        let shape = [header.channels, height, width];
        let out = BandFile::create(directory, &path, &channels, shape, RasterSample::Plain(Sample::F32))?;
        let linear = transfer.table(header.white);
        let mut line = vec![0.0; width];
        let mut done = 0;
        decoder.for_each_row(&path, &header, &mut |row, samples| {
            for &band in &channels {
                let channel = samples.iter().skip(band).step_by(header.channels);
                line.iter_mut().zip(channel).for_each(|(to, &v)| *to = linear[usize::from(v)]);
                out.write(band, row, 0, &line)?;
            }
            done += 1;
            progress(done, height as u64);
            Ok(())
        })?;
        Ok(Box::new(RasterChart::from_band_file(&path, out, NanPolicy::Error, None, Values::default())?))
    }
}

impl Transfer {
    /// Linear values of the integers up to `white`, which is 1.
    fn table(self, white: u16) -> Vec<f32> {
        let share = |v: u16| f64::from(v) / f64::from(white);
        let of = |v: u16| match self {
            Self::Srgb => srgb_decode(share(v)) as f32,
            Self::Linear => share(v) as f32,
        };
        (0..=white).map(of).collect()
    }
}

impl Decoder {
    /// Gives all rows of integers to `sink`, pixel by pixel.
    fn for_each_row(
        self,
        path: &Path,
        header: &ImageHeader,
        sink: RowSink<'_, ChartError>,
    ) -> Result<(), ChartError> {
        let mut rows = 0;
        let mut counted = |row: usize, samples: &[u16]| {
            rows += 1;
            sink(row, samples)
        };
        match self {
            Self::Png(rows) => rows.for_each_row(path, header, &mut counted)?,
            Self::Tiff(rows) => rows.for_each_row(path, header, &mut counted)?,
            Self::Whole(image) => image.for_each_row(path, header, &mut counted)?,
            Self::Exr(_) => unreachable!("it has no integers"),
        }
        match rows == header.size.height {
            true => Ok(()),
            false => {
                let reason = format!("it holds {rows} rows of {}", header.size.height);
                Err(ChartError::Damaged { path: path.into(), reason })
            }
        }
    }
}

/// Fails unless the channel `alpha` is 1 everywhere.
fn check_opaque(path: &Path, alpha: &str, directory: &Path, threads: usize) -> Result<(), ChartError> {
    let channel = exr::open_channel(path, &[alpha], NanPolicy::Error)?;
    channel.copy_bands(&[0], directory, threads, &|_, _| ())?;
    let Size { height, width } = channel.size();
    let mut line = vec![0.0; width];
    for row in 0..height {
        channel.read_rect(0, Rect::new(row as i64, 0, 1, width), &mut line)?;
        if let Some(column) = line.iter().position(|v| *v != 1.0) {
            return Err(transparent_error(path, row, column).into());
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
