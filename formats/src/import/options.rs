//! Options of an import: properties of an export that its files do not state.

use super::error::ImportError;
use super::window::{EvenWindow, Layout, Outward, RowOrder};
use pipeline::lens::PsfSample;
use std::f64::consts::PI;
use std::path::Path;

/// Maximum number of wavelengths, and of heights.
pub(super) const MAX_COUNT: usize = 4096;
/// Format of an export.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Folder of the ISET macros.
    Iset,
    /// Folder of OpticStudio listings.
    Listings,
    /// Folder of CSV tables and NPY windows.
    Tables,
    /// NumPy archive.
    Npz,
}

/// Properties of an export. `None`: as the files state; an error if they do not.
#[derive(Clone, Debug, PartialEq)]
pub struct ImportOptions {
    /// The format, if it is not recognised by the file names.
    pub format: Option<Format>,
    /// Name of the lens.
    pub name: Option<String>,
    /// Whether a sample is a point value or a mean over its square.
    pub sample: Option<PsfSample>,
    /// Position of the chief ray in an even window.
    pub even_window: Option<EvenWindow>,
    /// Order of the rows in a file. Default: top row (largest y) first, as OpticStudio writes them.
    pub rows: RowOrder,
    /// Side of the chief ray that points away from the axis, in a window with its top row first.
    pub outward: Option<Outward>,
    /// Whether windows are made exactly symmetric about the meridian, as for a centred lens.
    pub symmetric: bool,
    /// Whether the PSFs are replaced by an ideal point, for a source without PSFs.
    pub without_psf: bool,
    /// Wavelengths to import, by index from 0. `None`: all.
    pub bands: Option<Vec<usize>>,
    /// Heights with PSFs, by number from 1 as in the file names (ISET). `None`: all.
    pub psf_heights: Option<Vec<usize>>,
    /// Number of azimuths J_k at every height off axis; a multiple of 4.
    pub azimuths: usize,
    /// Number of field points of the dense tables.
    pub field_points: usize,
    /// Distortion focal length, mm.
    pub distortion_focal_length_mm: Option<f64>,
    /// Effective focal length, mm.
    pub effective_focal_length_mm: Option<f64>,
    /// Image-space F-number.
    pub f_number: Option<f64>,
    /// Entrance pupil diameter, mm: instead of the F-number, for an object at infinity.
    pub entrance_pupil_mm: Option<f64>,
    /// Primary wavelength, nm.
    pub primary_wavelength_nm: Option<f64>,
}

impl Default for ImportOptions {
    fn default() -> Self {
        Self {
            format: None,
            name: None,
            sample: None,
            even_window: None,
            rows: RowOrder::Top,
            outward: None,
            symmetric: false,
            without_psf: false,
            bands: None,
            psf_heights: None,
            azimuths: 72,
            field_points: 1001,
            distortion_focal_length_mm: None,
            effective_focal_length_mm: None,
            f_number: None,
            entrance_pupil_mm: None,
            primary_wavelength_nm: None,
        }
    }
}

impl ImportOptions {
    pub(super) fn layout(&self, outward: Outward) -> Layout {
        Layout { rows: self.rows, outward, even: self.even_window, symmetric: self.symmetric }
    }

    /// Effective focal length, mm: the option, else that of the files.
    pub(super) fn focal_length(&self, path: &Path, found: Option<f64>) -> Result<f64, ImportError> {
        positive(path, self.effective_focal_length_mm.or(found), "the focal length", "--efl-mm")
    }

    /// Distortion focal length at the primary wavelength, mm: the option, else that of the files.
    pub(super) fn distortion_focal(&self, path: &Path, found: Option<f64>) -> Result<f64, ImportError> {
        let what = "the distortion focal length at the primary wavelength";
        positive(path, self.distortion_focal_length_mm.or(found), what, "--distortion-focal-mm")
    }

    /// Primary wavelength, nm: the option, else that of the files.
    pub(super) fn primary_nm(&self, path: &Path, found: Option<f64>) -> Result<f64, ImportError> {
        positive(path, self.primary_wavelength_nm.or(found), "the primary wavelength", "--primary-nm")
    }

    /// Side of the field point, for formats that do not state it.
    pub(super) fn required_outward(&self, path: &Path) -> Result<Outward, ImportError> {
        self.outward.ok_or(ImportError::MissingOption {
            path: path.into(),
            what: "on which side of a window its field point lies",
            option: "--psf-outward",
        })
    }

    /// Meaning of a sample, for formats that do not state it.
    pub(super) fn required_sample(&self, path: &Path) -> Result<PsfSample, ImportError> {
        match (self.sample, self.without_psf) {
            (Some(sample), _) => Ok(sample),
            (None, true) => Ok(PsfSample::Integrated),
            (None, false) => Err(ImportError::MissingOption {
                path: path.into(),
                what: "whether a PSF sample is a point or the mean over its square",
                option: "--psf-sample",
            }),
        }
    }

    /// F-number and, where the entrance pupil is given, the solid angle π·NA² by Abbe's sine condition.
    pub(super) fn aperture(
        &self,
        path: &Path,
        efl_mm: f64,
        f_number: Option<f64>,
    ) -> Result<(f64, Option<f64>), ImportError> {
        match (self.f_number, self.entrance_pupil_mm, f_number) {
            (Some(_), Some(_), _) => Err(ImportError::Option {
                option: "--entrance-pupil-mm",
                problem: "cannot be combined with `--f-number`".into(),
            }),
            (None, Some(pupil), _) => {
                let na = pupil / 2.0 / efl_mm;
                Ok((efl_mm / pupil, Some(PI * na * na)))
            }
            (Some(n), None, _) => Ok((n, None)),
            (None, None, found) => Ok((positive(path, found, "the F-number", "--f-number")?, None)),
        }
    }

    /// The selected indices of `count` wavelengths.
    pub(super) fn selected_bands(&self, count: usize) -> Result<Vec<usize>, ImportError> {
        let Some(bands) = &self.bands else { return Ok((0..count).collect()) };
        match bands.iter().find(|&&b| b >= count) {
            Some(b) => Err(ImportError::Option {
                option: "--bands",
                problem: format!("{b} is beyond the last of {count} wavelengths"),
            }),
            None => Ok(bands.clone()),
        }
    }
}

/// A positive number, if any.
fn positive(
    path: &Path,
    value: Option<f64>,
    what: &'static str,
    option: &'static str,
) -> Result<f64, ImportError> {
    let value = value.ok_or(ImportError::MissingOption { path: path.into(), what, option })?;
    match value.is_finite() && value > 0.0 {
        true => Ok(value),
        false => Err(ImportError::file(path, format!("{what} is {value}, expected a positive number"))),
    }
}
