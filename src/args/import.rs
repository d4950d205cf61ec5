//! `lenscube lens import`.

use super::choices::{EVEN_WINDOW, FROM, PSF_OUTWARD, PSF_ROWS, PSF_SAMPLE, one_of};
use super::values::{azimuths, bounded};
use clap::Args;
use formats::import::Format;
use formats::import::window::{EvenWindow, Outward, RowOrder};
use pipeline::bounds;
use pipeline::lens::PsfSample;
use std::path::PathBuf;

/// `lenscube lens import`
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  lenscube lens import iset-folder/ asphere.lens.zarr\n  \
lenscube lens import listings/ my.lens.zarr --primary-nm 587.5618 --efl-mm 99.5 --f-number 2.985\n  \
lenscube lens import tables.npz my.lens.zip --psf-sample integrated --psf-outward down --f-number 3 --primary-nm 550\n\
lenscube lens import --template my-lens && lenscube lens import my-lens my.lens.zarr\n  \
lenscube lens import FIELD.toml unit17.lens.zarr\n\
What the source does not contain must be given by a flag; nothing is guessed. Any program can write the tables of a folder:\n  \
lens.csv     key,value: name, distortion_focal_length_mm, effective_focal_length_mm, f_number, primary_wavelength_nm,\n               \
object_distance_mm (a number with magnification, or infinity), psf_sample point|integrated,\n               \
psf_outward right|left|up|down, for windows of even size even_window pad|crop|shift\n  \
heights.csv  wavelength_nm,ideal_height_mm,image_height_mm,relative_illumination, and cra_deg for sensors that depend on angles: wavelengths ascend, heights from 0\n  \
psf.csv      wavelength_nm,image_height_mm,psf_pitch_um,psf_energy,file,index: a row a window\n  \
*.npy        windows, f4 or f8: (windows, rows, columns)\n\
--template writes such a folder, with a README.\n\
FIELD.toml describes PSFs measured over the film, of a lens without symmetry: places, windows (NPY, NPZ, FITS), map, flat field; see\n\
`lenscube help lenses`.")]
pub struct ImportArgs {
    /// Folder (ISET macros, OpticStudio listings, CSV tables with NPY windows), an .npz archive, or a FIELD.toml
    #[arg(value_name = "SOURCE", required_unless_present = "template")]
    pub source: Option<PathBuf>,
    /// Lens pack to write, a directory or a .zip
    #[arg(value_name = "OUT.lens.zarr", required_unless_present = "template")]
    pub out: Option<PathBuf>,
    /// Write a folder of CSV tables and NPY windows to begin with, which `lens import` reads, and end
    #[arg(long, value_name = "DIR", conflicts_with_all = ["source", "out"])]
    pub template: Option<PathBuf>,
    /// Format of the source [default: by file names]
    #[arg(long, value_parser = one_of(FROM))]
    pub from: Option<Format>,
    /// Name of the lens [default: from the source]
    #[arg(long)]
    pub name: Option<String>,
    /// Meaning of a PSF sample: value at a point, or mean over its square [default: from the source]
    #[arg(long, value_parser = one_of(PSF_SAMPLE))]
    pub psf_sample: Option<PsfSample>,
    /// Chief ray in a window of even size [default: from the source, else pad]
    #[arg(long, value_parser = one_of(EVEN_WINDOW))]
    pub even_window: Option<EvenWindow>,
    /// First row of a window in a file: top (largest y, as in OpticStudio) or bottom
    #[arg(long, value_parser = one_of(PSF_ROWS), default_value = "top")]
    pub psf_rows: RowOrder,
    /// Side of a window (top row first) that points away from the optical axis [default: from the source]
    #[arg(long, value_parser = one_of(PSF_OUTWARD))]
    pub psf_outward: Option<Outward>,
    /// Symmetrise windows about the meridional plane, as for a centred lens
    #[arg(long)]
    pub symmetric_psf: bool,
    /// Import without PSFs (an ideal point instead): for sources that have none
    #[arg(long)]
    pub without_psf: bool,
    /// Wavelengths to import: indices and half-open ranges, 0,5,10:15 [default: all]
    #[arg(long)]
    pub bands: Option<String>,
    /// Heights whose PSFs are imported, by their numbers from 1 in the file names (ISET): 1,11,21 [default: all]
    #[arg(long, value_name = "N,N…", value_delimiter = ',')]
    pub psf_heights: Option<Vec<usize>>,
    /// Azimuths of every height except the axis
    #[arg(long, value_name = "J", value_parser = azimuths, default_value = "72")]
    pub azimuths: usize,
    /// Focal length f of ideal height = f·tan(field angle): slope of the paraxial chief ray in the image plane [default: from the source]
    #[arg(long, value_name = "MM", value_parser = bounded(bounds::FOCAL_LENGTH_MM))]
    pub distortion_focal_mm: Option<f64>,
    /// Effective focal length [default: from the source]
    #[arg(long, value_name = "MM", value_parser = bounded(bounds::FOCAL_LENGTH_MM))]
    pub efl_mm: Option<f64>,
    /// Image-space F-number [default: from the source]
    #[arg(long, value_parser = bounded(bounds::F_NUMBER), conflicts_with = "entrance_pupil_mm")]
    pub f_number: Option<f64>,
    /// Entrance pupil diameter, instead of the F-number
    #[arg(long, value_name = "MM", value_parser = bounded(bounds::PUPIL_MM))]
    pub entrance_pupil_mm: Option<f64>,
    /// Primary wavelength [default: from the source]
    #[arg(long, value_name = "NM", value_parser = bounded(bounds::WAVELENGTH_NM))]
    pub primary_nm: Option<f64>,
}
