//! Pictures of charts, films and lenses: PNG (and SVG) for people to look at, never a data format.
//!
//! [`preview`] shows a stack of bands in colour ([`streamed`]: of any size), [`grey`] one band; both read any [`ChartSource`] once (twice where the
//! exposure of a grey picture is to be found) in strips, averaging over area on the way (`average.rs`), so that memory
//! holds the picture, or only a strip, never the cube. [`exposure`] says which value becomes white, [`tone`] how values become bytes.
//! Figures are SVG documents ([`figure`]) in a light or dark [`style`], and PNG files drawn from the same documents:
//! [`mod@plot`] draws curves and shapes on axes, [`bands`] gives wavelengths their colours, [`curve`] the tables of a lens, [`sheet`] crops side by side.
//! A file appears whole or not at all: `file.rs` writes under another name and renames.
//!
//! Pixels that are NaN or infinite (shards not yet written) are MISSING: averages leave them out, a picture's pixel with
//! nothing left shows as a grey chequer, and both are counted. For colour, a pixel is missing if any band is: a colour
//! made of half the bands would be a wrong one.

mod average;
mod axes;
pub mod bands;
pub mod curve;
pub mod exposure;
pub mod figure;
mod file;
pub mod grey;
pub mod image;
pub mod plot;
pub mod preview;
pub mod sheet;
pub mod streamed;
pub mod style;
pub mod text;
pub mod tone;

use std::path::PathBuf;

use pipeline::flow::{ChartSource, SourceSinkError};
use pipeline::geometry::{Rect, Size};
use pipeline::wavelengths;

/// How far a band may lie from the wavelength asked for, nm.
pub const BAND_TOLERANCE_NM: f64 = 0.5;

/// Why there is no picture.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PictureError {
    /// The source cannot be read.
    #[error("reading band {band}, {rect}: {source}")]
    Read {
        /// The band.
        band: usize,
        /// The strip being read.
        rect: Rect,
        /// The source's own words.
        source: SourceSinkError,
    },
    /// The file cannot be written.
    #[error("writing the picture {}: {source}", path.display())]
    Write {
        /// The file asked for.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The PNG cannot be encoded.
    #[error("encoding the picture {}: {source}", path.display())]
    Encode {
        /// The file asked for.
        path: PathBuf,
        /// What the encoder says.
        source: png::EncodingError,
    },
    /// The TIFF cannot be encoded.
    #[error("encoding the picture {}: {source}", path.display())]
    Tiff {
        /// The file asked for.
        path: PathBuf,
        /// What the encoder says.
        source: tiff::TiffError,
    },
    /// The file cannot be made, flushed or given its name.
    #[error("writing the picture: {0}")]
    Storage(#[from] crate::durable::DurableError),
    /// No band at the wavelength asked for.
    #[error(
        "no band within {BAND_TOLERANCE_NM} nm of {wanted_nm} nm; the nearest is {nearest_nm} nm, and there are {} nm",
        wavelengths::format(bands_nm)
    )]
    NoBand {
        /// The wavelength asked for.
        wanted_nm: f64,
        /// The band nearest to it.
        nearest_nm: f64,
        /// All bands.
        bands_nm: Vec<f64>,
    },
    /// Bands that no eye sees.
    #[error(
        "the bands at {} nm show nothing of the white light {white}: take a grey picture of one band instead",
        wavelengths::format(bands_nm)
    )]
    Invisible {
        /// All bands.
        bands_nm: Vec<f64>,
        /// Name of the white.
        white: &'static str,
    },
    /// A setting that cannot be met.
    #[error("picture setting {setting}: {problem}")]
    Setting {
        /// The setting.
        setting: &'static str,
        /// What is wrong with it, and what it takes.
        problem: String,
    },
}

/// What is read, how large it is shown and by how many threads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// The part of the source to show; `None`: all.
    pub window: Option<Rect>,
    /// Longest side of the picture in pixels; smaller sources keep their size. `None`: every pixel.
    pub max_side: Option<usize>,
    /// Threads that read and average; the picture is the same for any number.
    pub threads: usize,
}

impl Default for View {
    /// All of the source at up to 2048 pixels a side, on every core.
    fn default() -> Self {
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        Self { window: None, max_side: Some(2048), threads }
    }
}

impl View {
    /// The window of a source, checked.
    fn window(&self, source: Size) -> Result<Rect, PictureError> {
        let window = self.window.unwrap_or(source.rect());
        if window.is_empty() || !source.rect().contains(window) {
            let problem = format!("{window} is not a part of an image of {source}");
            return Err(PictureError::Setting { setting: "window", problem });
        }
        if self.max_side == Some(0) {
            let problem = "is 0; take at least 1 pixel".to_owned();
            return Err(PictureError::Setting { setting: "max_side", problem });
        }
        Ok(window)
    }
}

/// What a picture shows, to be told to its user.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shown {
    /// Size of the picture.
    pub size: Size,
    /// The factor that was applied: use it again to make pictures comparable.
    pub exposure: f64,
    /// Missing samples of the source, over all bands read.
    pub missing_samples: u64,
    /// Pixels of the picture with nothing to show.
    pub missing_pixels: u64,
}

/// Told how many of how many source samples have been read. In order, but from many threads.
pub type Progress<'a> = &'a (dyn Fn(u64, u64) + Sync);

/// Index of the band nearest to `wanted_nm`.
///
/// # Errors
/// [`PictureError::NoBand`] if it is more than [`BAND_TOLERANCE_NM`] away.
pub fn nearest_band(bands_nm: &[f64], wanted_nm: f64) -> Result<usize, PictureError> {
    let away = |nm: f64| (nm - wanted_nm).abs();
    let nearest = (0..bands_nm.len()).min_by(|&a, &b| away(bands_nm[a]).total_cmp(&away(bands_nm[b])));
    match nearest {
        Some(band) if away(bands_nm[band]) <= BAND_TOLERANCE_NM => Ok(band),
        _ => Err(PictureError::NoBand {
            wanted_nm,
            nearest_nm: nearest.map_or(f64::NAN, |band| bands_nm[band]),
            bands_nm: bands_nm.to_vec(),
        }),
    }
}

/// Display value 0..1 (sRGB-encoded) of the chequer that stands for missing pixels: squares of 8.
fn chequer(y: usize, x: usize) -> f64 {
    if (y / 8 + x / 8).is_multiple_of(2) { 0.4 } else { 0.6 }
}

#[cfg(test)]
mod tests;
