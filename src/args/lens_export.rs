//! `lenscube lens export`.

use super::choices::{Choices, one_of};
use super::design::{DESIGN_FILES, DesignArgs, focus_m};
use super::values::{bounded, pitch, positive, size};
use clap::Args;
use pipeline::bounds;
use pipeline::geometry::Size;
use std::path::PathBuf;

/// `lenscube lens export`
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  lenscube lens export phone phone.yml --as opencv --film-size 3600x2700 --film-pitch-um 1\n  \
lenscube lens export fisheye-170 --as ftheta --film-pitch-um 3\n  \
lenscube lens export my.lens.zarr my.xml --as lensfun --film-size 6000x4000 --film-pitch-um 4\n  \
lenscube lens export double-gauss-28 map.csv --as lut\n\
Coefficients are fitted over the area of the film, from ideal to REAL image heights, as these programs distort; the residual in film pixels is printed. \
The focal length is not fitted: a picture that is corrected with them is the ideal image plane, on which charts lie."
)]
pub struct LensExportArgs {
    /// Lens pack, design file, or name of a built-in lens
    #[arg(value_name = "LENS", help = format!("Lens pack (also at a URL), design file ({DESIGN_FILES}), or name of a built-in lens"))]
    pub lens: String,
    /// File to write [default: standard output]
    #[arg(value_name = "OUT")]
    pub out: Option<PathBuf>,
    /// Model, and the format of its file
    #[arg(long = "as", value_name = "MODEL", value_parser = one_of(MODEL))]
    pub model: ModelArg,
    /// Wavelength, nm; of a pack that of a band [default: the primary wavelength of the lens]
    #[arg(long, value_name = "NM", value_parser = bounded(bounds::WAVELENGTH_NM))]
    pub band: Option<f64>,
    /// Wavelengths of red, green and blue, nm, of lensfun [default: 620,540,460; of a pack its bands next to them]
    #[arg(long, value_name = "R,G,B", value_parser = bands, conflicts_with = "band")]
    pub bands: Option<Bands>,
    /// Size of the film in pixels, N or WxH [default: the square around the image circle of the lens, fitted within the circle]
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
}

impl ModelArg {
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

/// Three wavelengths, descending: red, green, blue.
fn bands(text: &str) -> Result<Bands, String> {
    let one = bounded(bounds::WAVELENGTH_NM);
    let all: Vec<f64> = text.split(',').map(one).collect::<Result<_, _>>()?;
    match all[..] {
        [red, green, blue] if red > green && green > blue => Ok([red, green, blue]),
        _ => Err("expected three wavelengths R,G,B in nm, the longest first, e.g. 620,540,460".to_owned()),
    }
}
