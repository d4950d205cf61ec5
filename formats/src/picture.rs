//! Pictures of charts, films and lenses: PNG (and SVG) for viewing, never a data format.
//!
//! [`preview`] shows a stack of bands in colour ([`streamed`]: of any size), [`grey`] one band. Both read any [`ChartSource`] once
//! (twice where the exposure is measured) in strips of rows, averaging over area (`area.rs`), so that memory holds the picture or
//! only some of its rows, never the cube. [`exposure`] chooses the value that becomes white, [`tone`] converts values to bytes.
//! Figures are SVG documents ([`figure`]) in a light or dark [`style`], and PNG files drawn from the same documents:
//! [`mod@plot`] draws curves and shapes on axes, [`bands`] gives wavelengths their colours, [`curve`] plots the tables of a lens,
//! [`contact_sheet`] places crops side by side. Files are written under a temporary name and renamed when complete (`file.rs`).
//!
//! Pixels that are NaN or infinite (shards not yet written) are MISSING: averages leave them out, a picture's pixel
//! without any sample shows as a grey chequer, and both are counted. For colour, a pixel is missing if any band is: a colour
//! from half the bands would be wrong.

mod area;
mod axes;
pub mod bands;
pub mod contact_sheet;
pub mod curve;
pub mod exposure;
pub mod figure;
mod file;
pub mod grey;
pub mod image;
mod legend;
pub mod plot;
pub mod preview;
pub mod series;
mod spectral;
pub mod streamed;
pub mod style;
pub mod text;
pub mod tone;

use std::path::PathBuf;

use pipeline::flow::{ChartSource, SourceSinkError};
use pipeline::geometry::{Rect, Size};
use pipeline::wavelengths;

/// Maximum distance of a band from the requested wavelength, nm.
pub const BAND_TOLERANCE_NM: f64 = 0.5;

/// Errors of drawing or writing a picture.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PictureError {
    /// The source cannot be read.
    #[error("reading band {band}, {rect}: {source}")]
    Read {
        /// The band.
        band: usize,
        /// The rectangle being read.
        rect: Rect,
        /// Error of the source.
        source: SourceSinkError,
    },
    /// The file cannot be written.
    #[error("writing the picture {}: {source}", path.display())]
    Write {
        /// The picture file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The PNG or TIFF cannot be encoded.
    #[error("encoding the picture {}: {source}", path.display())]
    Encode {
        /// The picture file.
        path: PathBuf,
        /// Error of the encoder.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// The file cannot be created, flushed or renamed.
    #[error("writing the picture: {0}")]
    Storage(#[from] crate::durable::DurableError),
    /// No band at the requested wavelength.
    #[error(
        "no band within {BAND_TOLERANCE_NM} nm of {wavelength_nm} nm; the nearest is {nearest_nm} nm, and there are {} nm",
        wavelengths::format(bands_nm)
    )]
    NoBand {
        /// The requested wavelength.
        wavelength_nm: f64,
        /// The band nearest to it.
        nearest_nm: f64,
        /// All bands.
        bands_nm: Vec<f64>,
    },
    /// Bands outside the visible range.
    #[error(
        "the bands at {} nm have no colour under {white}; export one band as grey with --band",
        wavelengths::format(bands_nm)
    )]
    Invisible {
        /// All bands.
        bands_nm: Vec<f64>,
        /// Name of the white.
        white: &'static str,
    },
    /// An invalid setting.
    #[error("picture setting {setting}: {problem}")]
    Setting {
        /// The setting.
        setting: &'static str,
        /// The invalid value and the accepted ones.
        problem: String,
    },
}

/// Region that is shown, size of the picture, number of threads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// The part of the source to show; `None`: all.
    pub region: Option<Rect>,
    /// Maximum side of the picture in pixels; smaller sources keep their size. `None`: every pixel.
    pub max_side: Option<usize>,
    /// Threads that read and average; the picture is the same for any number.
    pub threads: usize,
}

impl Default for View {
    /// All of the source at up to 2048 pixels a side, on every core.
    fn default() -> Self {
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        Self { region: None, max_side: Some(2048), threads }
    }
}

impl View {
    /// The region of a source, checked.
    fn region(&self, source: Size) -> Result<Rect, PictureError> {
        let region = self.region.unwrap_or(source.rect());
        if region.is_empty() || !source.rect().contains(region) {
            let problem = format!("{region} is not a part of an image of {source}");
            return Err(PictureError::Setting { setting: "region", problem });
        }
        if self.max_side == Some(0) {
            let problem = "is 0; it must be at least 1 pixel".to_owned();
            return Err(PictureError::Setting { setting: "max_side", problem });
        }
        Ok(region)
    }
}

/// Size, exposure and missing samples of a picture, for the report to the user.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PictureSummary {
    /// Size of the picture.
    pub size: Size,
    /// The factor that was applied; the same factor makes pictures comparable.
    pub exposure: f64,
    /// Missing samples of the source, in all bands read.
    pub missing_samples: u64,
    /// Pixels of the picture without any sample.
    pub missing_pixels: u64,
}

pub use crate::parallel::Progress;

/// Index of the band nearest to `wavelength_nm`.
///
/// # Errors
/// [`PictureError::NoBand`] if it is more than [`BAND_TOLERANCE_NM`] away.
pub fn nearest_band(bands_nm: &[f64], wavelength_nm: f64) -> Result<usize, PictureError> {
    let distance = |band: usize| (bands_nm[band] - wavelength_nm).abs();
    let nearest = (0..bands_nm.len()).min_by(|&a, &b| distance(a).total_cmp(&distance(b)));
    match nearest {
        Some(band) if distance(band) <= BAND_TOLERANCE_NM => Ok(band),
        _ => Err(PictureError::NoBand {
            wavelength_nm,
            nearest_nm: nearest.map_or(f64::NAN, |band| bands_nm[band]),
            bands_nm: bands_nm.to_vec(),
        }),
    }
}

#[cfg(test)]
mod tests;
