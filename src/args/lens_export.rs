//! `lenscube lens export`.

use super::choices::{Choices, one_of};
use super::design::{DESIGN_FILES, DesignArgs, focus_m};
use super::values::{bounded, odd, pitch, positive, size};
use clap::Args;
use pipeline::bounds;
use pipeline::figures::effective_psf::MAX_OVERSAMPLE;
use pipeline::geometry::Size;
use std::path::PathBuf;

/// `lenscube lens export`
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  lenscube lens export phone phone.yml --as opencv --film-size 3600x2700 --film-pitch-um 1\n  \
lenscube lens export fisheye-170 --as ftheta --film-pitch-um 3\n  \
lenscube lens export my.lens.zarr my.xml --as lensfun --film-size 6000x4000 --film-pitch-um 4\n  \
lenscube lens export double-gauss-28 map.csv --as lut\n  \
lenscube lens export phone psf.fits --as psf-fits --band 550 --film-size 4000x3000 --film-pitch-um 1.4 --grid 5x5\n\
Coefficients are fitted over the area of the film, from ideal to REAL image heights, as these programs distort; the residual in film pixels is printed. \
The focal length is not fitted: a picture that is corrected with them is the ideal image plane, on which charts lie.\n\
PSFs: each sample is the light in the film pixel about it, over all light of the point; places are the pixels of the corners and evenly between."
)]
pub struct LensExportArgs {
    /// Lens pack, design file, or name of a built-in lens
    #[arg(value_name = "LENS", help = format!("Lens pack (also at a URL), design file ({DESIGN_FILES}), or name of a built-in lens"))]
    pub lens: String,
    /// File to write, of psf-fits with --wavelengths a folder [default: standard output, of all but PSFs]
    #[arg(value_name = "OUT")]
    pub out: Option<PathBuf>,
    /// Model or PSFs, and the format of the file
    #[arg(long = "as", value_name = "FORMAT", value_parser = one_of(MODEL))]
    pub model: ModelArg,
    /// Wavelength, nm; of a pack that of a band [default: the primary wavelength of the lens]
    #[arg(long, value_name = "NM", value_parser = bounded(bounds::WAVELENGTH_NM))]
    pub band: Option<f64>,
    /// Several wavelengths of PSFs, nm: 450:650:50 (both ends included) or 450,550 [default of isetcam: 400:700:50, all bands of a pack]; psf-fits writes a file of each into the folder OUT, psf-450nm.fits
    #[arg(long, value_name = "NM", conflicts_with_all = ["band", "bands"])]
    pub wavelengths: Option<String>,
    /// Wavelengths of red, green and blue, nm, of lensfun [default: 620,540,460; of a pack its bands next to them]
    #[arg(long, value_name = "R,G,B", value_parser = bands, conflicts_with = "band")]
    pub bands: Option<Bands>,
    /// Size of the film in pixels, N or WxH [default: the square around the image circle of the lens, fitted within the circle; of PSFs the square within it, of a design 0.95 of that]
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub film_size: Option<Size>,
    /// Film pixel pitch in µm
    #[arg(long, value_name = "UM", value_parser = pitch, default_value = "2")]
    pub film_pitch_um: f64,
    /// Coefficients of opencv: k1, k2, p1, p2, k3, or with k4, k5, k6 of the denominator; p1 and p2 are 0
    #[arg(long, value_name = "N", value_parser = one_of(TERMS), default_value = "5")]
    pub terms: Terms,
    /// Camera model of colmap
    #[arg(long, value_name = "MODEL", value_parser = one_of(COLMAP), default_value = "OPENCV")]
    pub colmap_model: ColmapModel,
    /// Maximum residual in film pixels: above it the exit code is 4 and nothing is written
    #[arg(long, value_name = "PX", value_parser = positive)]
    pub max_residual: Option<f64>,
    /// Places of PSFs on the film, N or columns x rows, the outermost in the pixels of the corners [default: 5x5]; of isetcam the number of field heights
    /// [default: 21]
    #[arg(long, value_name = "NxM", value_parser = size)]
    pub grid: Option<Size>,
    /// Samples of PSFs a film pixel along each side, 1 to 16 [default: 5; of isetcam 2]
    #[arg(long, value_name = "N", value_parser = oversample)]
    pub oversample: Option<usize>,
    /// Side of the PSFs, an odd number of film pixels [default: that of the PSF windows of the lens]
    #[arg(long, value_name = "N", value_parser = odd)]
    pub psf_window: Option<usize>,
    /// Object distance in focus, m from the entrance pupil, or inf [default: the film of the design]
    #[arg(long, value_name = "M", value_parser = focus_m, conflicts_with = "object_distance_mm")]
    pub focus_m: Option<f64>,
    /// Print coefficients and residuals as JSON
    #[arg(long)]
    pub json: bool,
    /// Replace an existing file
    #[arg(long, requires = "out")]
    pub overwrite: bool,
    /// Parameters of the design.
    #[command(flatten)]
    pub parameters: DesignArgs,
}

/// Wavelengths of red, green and blue, nm.
pub type Bands = [f64; 3];

const MODEL: Choices<ModelArg> = &[
    ("opencv", "OpenCV, YAML: polynomial of tan θ", ModelArg::OpenCv),
    ("opencv-fisheye", "OpenCV's fisheye model, YAML: polynomial of the angle θ", ModelArg::OpenCvFisheye),
    ("ftheta", "NVIDIA's f-theta model, JSON of a rig: polynomial of θ, and its inverse", ModelArg::FTheta),
    ("lut", "CSV: field angle, ideal height, REAL height, relative illumination", ModelArg::Lut),
    ("lensfun", "XML: distortion, lateral colour, relative illumination", ModelArg::Lensfun),
    ("colmap", "cameras.txt", ModelArg::Colmap),
    ("psf-fits", "FITS of PSFs: GriddedPSFModel of photutils, STPSF", ModelArg::PsfFits),
    ("psf-npy", "NPY of PSFs, and a JSON beside it", ModelArg::PsfNpy),
    ("psf-zarr", "Zarr group of PSFs", ModelArg::PsfZarr),
    ("isetcam", "MAT-file of optics for ISETCam's ray-trace model", ModelArg::IsetCam),
];
const TERMS: Choices<Terms> = &[("5", "", Terms::Five), ("8", "", Terms::Eight)];
const COLMAP: Choices<ColmapModel> = &[
    ("OPENCV", "", ColmapModel::OpenCv),
    ("FULL_OPENCV", "", ColmapModel::FullOpenCv),
    ("OPENCV_FISHEYE", "", ColmapModel::OpenCvFisheye),
    ("RADIAL", "", ColmapModel::Radial),
];

/// `--as`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "the variants are the values of the flag")]
pub enum ModelArg {
    OpenCv,
    OpenCvFisheye,
    FTheta,
    Lut,
    Lensfun,
    Colmap,
    PsfFits,
    PsfNpy,
    PsfZarr,
    IsetCam,
}

impl ModelArg {
    /// Whether it has PSFs, not distortion.
    pub fn has_psfs(self) -> bool {
        matches!(self, Self::PsfFits | Self::PsfNpy | Self::PsfZarr | Self::IsetCam)
    }

    /// Its value of the flag.
    pub fn name(self) -> &'static str {
        MODEL.iter().find(|(_, _, model)| *model == self).map_or("", |(name, ..)| name)
    }
}

/// `--terms`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "the variants are the values of the flag")]
pub enum Terms {
    Five,
    Eight,
}

/// `--colmap-model`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "the variants are the values of the flag")]
pub enum ColmapModel {
    OpenCv,
    FullOpenCv,
    OpenCvFisheye,
    Radial,
}

/// Samples a film pixel.
fn oversample(text: &str) -> Result<usize, String> {
    let number = text.trim().parse().ok().filter(|n| (1..=MAX_OVERSAMPLE).contains(n));
    number.ok_or_else(|| format!("expected a number from 1 to {MAX_OVERSAMPLE}"))
}

/// Three wavelengths, descending: red, green, blue.
fn bands(text: &str) -> Result<Bands, String> {
    let one = bounded(bounds::WAVELENGTH_NM);
    let all: Vec<f64> = text.split(',').map(one).collect::<Result<_, _>>()?;
    match all[..] {
        [red, green, blue] if red > green && green > blue => Ok([red, green, blue]),
        _ => Err("expected three wavelengths R,G,B in nm, the longest first, e.g. 620,540,460".to_owned()),
    }
}
