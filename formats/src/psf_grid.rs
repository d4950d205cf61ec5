//! Effective PSFs of a lens on a grid of places of the film ([`pipeline::figures::effective_psf`]), for other programs.
//!
//! | format | of several wavelengths | |
//! |---|---|---|
//! | FITS | a file each | `(place, y, x)`: `photutils.psf.GriddedPSFModel`, `stpsf` ([`mod@fits`]) |
//! | NPY + JSON | an axis | `(wavelength, place_y, place_x, y, x)`, and what they are ([`mod@npy`]) |
//! | Zarr v3 | an axis | the same with coordinates, as `xarray.open_zarr` reads them ([`mod@zarr`]) |
//!
//! The film is W × H pixels with their centres at 0 … W − 1, 0 … H − 1, the axis of the lens at ((W − 1)/2, (H − 1)/2), y down. Files get their names when
//! they are complete and what was written has been read again.

pub mod fits;
pub mod npy;
pub mod zarr;

use std::io::Write;
use std::path::{Path, PathBuf};

use pipeline::geometry::Size;
use serde_json::{Value, json};

use crate::durable::{AtomicFile, DurableError, FileWriter};

/// Schema of the description.
const SCHEMA: &str = "lenscube/psf-grid/1";

/// What the PSFs are.
#[derive(Clone, Debug)]
pub struct PsfGrid {
    /// Name of the lens.
    pub lens: String,
    /// Wavelengths, nm.
    pub wavelengths_nm: Vec<f64>,
    /// Film in pixels.
    pub film: Size,
    /// Pitch of its pixels, µm.
    pub pitch_um: f64,
    /// Columns of the places, film pixels, ascending.
    pub x_px: Vec<f64>,
    /// Rows of the places, film pixels, ascending.
    pub y_px: Vec<f64>,
    /// Samples a film pixel.
    pub oversample: usize,
    /// Side of the PSFs, film pixels.
    pub window_px: usize,
    /// Image-space F-number.
    pub f_number: f64,
    /// Object distance, mm; none: infinity.
    pub object_distance_mm: Option<f64>,
}

/// The PSFs of one wavelength.
#[derive(Debug)]
pub struct BandPsfs {
    /// Share of all light in each PSF, row of places after row.
    pub energy: Vec<f64>,
    /// Their samples, one PSF after another.
    pub samples: Vec<f32>,
}

/// PSFs could not be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PsfGridError {
    /// Storage.
    #[error(transparent)]
    Storage(#[from] DurableError),
    /// What was read again is not what was written.
    #[error("{path}: the bytes read again differ from those written; the disk or its driver is faulty, and nothing was kept", path = path.display())]
    Differs {
        /// The file.
        path: PathBuf,
    },
    /// Something else exists at the path.
    #[error("{path} exists and is no group of PSFs of this program: give another name", path = path.display())]
    Foreign {
        /// The path.
        path: PathBuf,
    },
}

impl PsfGrid {
    /// Number of places.
    pub fn places(&self) -> usize {
        self.x_px.len() * self.y_px.len()
    }

    /// Samples a side of a PSF.
    pub fn side(&self) -> usize {
        self.window_px * self.oversample
    }

    /// Distance of film pixel `px` of `count` from the axis, mm.
    fn mm(&self, px: f64, count: usize) -> f64 {
        (px - (count - 1) as f64 / 2.0) * 1e-3 * self.pitch_um
    }

    /// Columns of the places, mm from the axis.
    pub fn x_mm(&self) -> Vec<f64> {
        self.x_px.iter().map(|px| self.mm(*px, self.film.width)).collect()
    }

    /// Rows of the places, mm below the axis.
    pub fn y_mm(&self) -> Vec<f64> {
        self.y_px.iter().map(|px| self.mm(*px, self.film.height)).collect()
    }

    /// Samples of a PSF from its chief ray, µm.
    fn at_um(&self) -> Vec<f64> {
        let n = self.side();
        (0..n).map(|i| (i as f64 - (n - 1) as f64 / 2.0) * self.pitch_um / self.oversample as f64).collect()
    }

    /// What the PSFs are, for people and programs.
    fn description(&self) -> Value {
        json!({
            "schema": SCHEMA,
            "generator": concat!("lenscube ", env!("CARGO_PKG_VERSION")),
            "lens": self.lens,
            "f_number": self.f_number,
            "object_distance_mm": self.object_distance_mm,
            "width_px": self.film.width,
            "height_px": self.film.height,
            "film_pitch_um": self.pitch_um,
            "axis_px": [(self.film.width - 1) as f64 / 2.0, (self.film.height - 1) as f64 / 2.0],
            "oversample": self.oversample,
            "window_px": self.window_px,
            "integrated_over": "one film pixel about each sample",
            "normalisation": "share of all light of the point in a film pixel: the sum of a PSF is oversample^2 * energy",
            "orientation": "rows towards +y of the film (down), columns towards +x; the chief ray in the middle of the array",
        })
    }
}

/// Writes `bytes`, which also go into `digest`.
fn write(
    out: &mut FileWriter<'_>,
    digest: &mut blake3::Hasher,
    path: &Path,
    bytes: &[u8],
) -> Result<(), DurableError> {
    digest.update(bytes);
    out.write_all(bytes).map_err(|e| DurableError::io("write", path, bytes.len() as u64, e))
}

/// Reads `file` again and compares it with `written`.
fn verify(file: &AtomicFile, path: &Path, written: &blake3::Hasher) -> Result<(), PsfGridError> {
    match file.reads_as(written.finalize())? {
        true => Ok(()),
        false => Err(PsfGridError::Differs { path: path.into() }),
    }
}

#[cfg(test)]
mod tests;
