//! `lenscube lens import`.

use super::values::{azimuths, bounded};
use clap::{Args, ValueEnum};
use pipeline::bounds;
use std::path::PathBuf;

/// `lenscube lens import`
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  lenscube lens import iset-folder/ asphere.lens.zarr\n  \
lenscube lens import listings/ my.lens.zarr --primary-nm 587.5618 --efl-mm 99.5 --f-number 2.985\n  \
lenscube lens import tables.npz my.lens.zip --psf-sample integrated --psf-outward down --f-number 3 --primary-nm 550\n\
What a source does not tell is asked for by name; nothing is guessed. Plain tables (CSV + NPY) for any other program:\n\
formats/tests/data/tables-example is a worked example.")]
pub struct ImportArgs {
    /// A folder (ISET macros, OpticStudio listings, CSV tables with NPY windows) or an .npz archive
    #[arg(value_name = "SOURCE")]
    pub source: PathBuf,
    /// The lens pack to write, a directory or a .zip
    #[arg(value_name = "OUT.lens.zarr")]
    pub out: PathBuf,
    /// Format [default: by the names of the files]
    #[arg(long, value_enum)]
    pub from: Option<FormatArg>,
    /// Name of the lens [default: as the source says]
    #[arg(long)]
    pub name: Option<String>,
    /// What a PSF sample is: the value at a point, or the mean over its square [default: as the source says]
    #[arg(long, value_enum)]
    pub psf_sample: Option<SampleArg>,
    /// Where the chief ray is in an even window: on sample N/2 from 0 (pad by a dark row, or crop the first), or between the four
    /// middle samples (shift by half a sample) [default: as the source says, padded]
    #[arg(long, value_enum)]
    pub even_window: Option<EvenArg>,
    /// Which row of a window comes first in a file: the top one, of largest y, as OpticStudio prints, or the bottom one
    #[arg(long, value_enum, default_value_t = RowsArg::Top)]
    pub psf_rows: RowsArg,
    /// Side of a window, top row on top, that points away from the optical axis [default: as the source says]
    #[arg(long, value_enum)]
    pub psf_outward: Option<OutwardArg>,
    /// Make windows exactly symmetric about the meridian, as those of a centred lens are
    #[arg(long)]
    pub symmetric_psf: bool,
    /// Take no PSFs but an ideal point: for sources that have none
    #[arg(long)]
    pub without_psf: bool,
    /// Only these of the source's wavelengths: indices and ranges without their end, 0,5,10:15
    #[arg(long)]
    pub bands: Option<String>,
    /// Only these heights' PSFs, by their numbers from 1 in the files' names (ISET): 1,11,21
    #[arg(long, value_name = "N,N…", value_delimiter = ',')]
    pub psf_heights: Option<Vec<usize>>,
    /// Azimuths of every height but the axis
    #[arg(long, value_name = "J", value_parser = azimuths, default_value = "72")]
    pub azimuths: usize,
    /// f of ideal height = f·tan(field): slope of the paraxial chief ray in the image plane [default: as the source says]
    #[arg(long, value_name = "MM", value_parser = bounded(bounds::FOCAL_LENGTH_MM))]
    pub distortion_focal_mm: Option<f64>,
    /// Effective focal length [default: as the source says]
    #[arg(long, value_name = "MM", value_parser = bounded(bounds::FOCAL_LENGTH_MM))]
    pub efl_mm: Option<f64>,
    /// Image-space F-number [default: as the source says]
    #[arg(long, value_parser = bounded(bounds::F_NUMBER), conflicts_with = "entrance_pupil_mm")]
    pub f_number: Option<f64>,
    /// Entrance pupil diameter, instead of the F-number
    #[arg(long, value_name = "MM", value_parser = bounded(bounds::PUPIL_MM))]
    pub entrance_pupil_mm: Option<f64>,
    /// Primary wavelength [default: as the source says]
    #[arg(long, value_name = "NM", value_parser = bounded(bounds::WAVELENGTH_NM))]
    pub primary_nm: Option<f64>,
}

/// Formats.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FormatArg {
    /// Folder written by the ISET macros for Zemax or Code V
    Iset,
    /// Folder of OpticStudio text listings
    Listings,
    /// Folder of CSV tables and NPY windows
    Tables,
    /// NumPy archive
    Npz,
}

/// What a sample stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs, reason = "they are what they say")]
pub enum SampleArg {
    Point,
    Integrated,
}

/// Even windows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs, reason = "they are what they say")]
pub enum EvenArg {
    Pad,
    Crop,
    Shift,
}

/// Row order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs, reason = "they are what they say")]
pub enum RowsArg {
    Top,
    Bottom,
}

/// Sides.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs, reason = "they are what they say")]
pub enum OutwardArg {
    Right,
    Down,
    Left,
    Up,
}
