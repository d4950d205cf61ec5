//! What a user says about an export, because its files do not.

use super::window::{EvenWindow, Outward, RowOrder};
use pipeline::lens::PsfSample;

/// Formats.
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

/// What a user says about an export. `None` everywhere: as the files tell, else an error.
#[derive(Clone, Debug, PartialEq)]
pub struct ImportOptions {
    /// The format, if not as the files' names tell.
    pub format: Option<Format>,
    /// The lens's name, if not as the files tell.
    pub name: Option<String>,
    /// What a sample stands for.
    pub sample: Option<PsfSample>,
    /// Where the chief ray is in an even window.
    pub even_window: Option<EvenWindow>,
    /// Which row of a window comes first in a file. Default: the top one (largest y), as OpticStudio prints.
    pub rows: RowOrder,
    /// Side of the chief ray on which the field point lies, away from the axis, in a window with its top row first.
    pub outward: Option<Outward>,
    /// Make windows exactly symmetric about the meridian, as those of a centred lens are.
    pub symmetric: bool,
    /// A point instead of PSFs, for a source that has none.
    pub without_psf: bool,
    /// Only these of the source's wavelengths, by index from 0.
    pub bands: Option<Vec<usize>>,
    /// Only these heights' PSFs, by number from 1 as in the files' names (ISET).
    pub psf_heights: Option<Vec<usize>>,
    /// Azimuths J_k of every height but the axis; a multiple of 4.
    pub azimuths: usize,
    /// Field points of the dense tables.
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
