//! `lenscube lens`.

use super::built::BuiltArgs;
use super::camera::CameraArgs;
use super::choices::{BORESIGHT, STYLE, SWITCH, one_of};
use super::design::{DESIGN_FILES, Depths, DesignArgs, depths, focus_m};
use super::ghosts::GhostArgs;
use super::import::ImportArgs;
use super::lens_export::LensExportArgs;
use super::light::LightArgs;
use super::tolerance::ToleranceArgs;
use super::values::{bounded, figures, film_point, pitch, positive, share, size, window_px};
use clap::{ArgAction, Args, Subcommand, ValueEnum};
use formats::design::{endings_written, names_read, names_written};
use formats::picture::style::Style;
use pipeline::bounds;
use pipeline::design::tolerance::Boresight;
use pipeline::design::trace::TraceOptions;
use pipeline::design::wavefront::SAMPLES;
use pipeline::geometry::Size;
use std::path::PathBuf;

/// Most characters of the name of a sealed lens.
const MAX_NAME: usize = 120;

/// `lenscube lens`
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  lenscube lens list\n  lenscube lens show double-gauss-28 --plot pictures"
)]
pub struct LensArgs {
    /// Command to run.
    #[command(subcommand)]
    pub command: LensCommand,
}

/// The lens commands.
#[derive(Debug, Subcommand)]
pub enum LensCommand {
    /// Show the data of a lens and, with --plot, figures
    Show(Box<ShowArgs>),
    /// Compute the PSF of a design at a point of the film: an array, sections
    Psf(Box<PsfArgs>),
    /// Compare two lenses
    Diff(Box<DiffArgs>),
    /// Trace a design into a lens pack: heights, relative illumination and PSFs
    Trace(Box<TraceArgs>),
    /// Draw lenses within manufacturing tolerances, focus and judge them: yield, statistics, sensitivities
    Tolerance(Box<ToleranceArgs>),
    /// Print the pinhole camera whose picture is the chart of a film, for a renderer
    Camera(Box<CameraArgs>),
    /// Write the distortion of a lens as the camera model of another program: OpenCV, f-theta, lensfun, COLMAP, CSV
    Export(Box<LensExportArgs>),
    /// Print what a lens leaves of the light: transmission, reflectance of each surface
    Light(Box<LightArgs>),
    /// List the built-in lenses with their sources
    List(ListArgs),
    #[command(
        about = format!("Write a design in another format: {}", names_written()),
        after_help = "Examples:\n  lenscube lens convert patent.csv patent.zmx\n  lenscube lens convert my.zar my.json\n\
Glasses that are not built in are written into a catalogue OUT.agf beside a .zmx or .csv. What a format cannot hold is an error or a note."
    )]
    Convert(Box<ConvertArgs>),
    /// Import a lens into a lens pack: ISET macros, OpticStudio listings, tables, NPZ, measured PSF fields
    Import(Box<ImportArgs>),
}

/// `lenscube lens list`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  lenscube lens list --json | jq -r '.designs[].name'\n  lenscube lens list --plot pictures"
)]
pub struct ListArgs {
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    /// Write a cross-section of each lens with rays into this directory: NAME.svg and NAME.png
    #[arg(long, value_name = "DIR", value_parser = figures())]
    pub plot: Option<PathBuf>,
    /// Replace existing figures
    #[arg(long, requires = "plot")]
    pub overwrite: bool,
}

/// `lenscube lens convert`
#[derive(Debug, Args)]
pub struct ConvertArgs {
    /// Design file, or name of a built-in design
    #[arg(value_name = "DESIGN")]
    pub design: String,
    /// File to write.
    #[arg(value_name = "OUT", help = format!("File to write: {}", endings_written()))]
    pub out: PathBuf,
    /// Replace existing files
    #[arg(long)]
    pub overwrite: bool,
    /// Parameters of the design.
    #[command(flatten)]
    pub parameters: DesignArgs,
}

/// `lenscube lens show`
#[derive(Debug, Args)]
#[command(after_help = format!("Examples:\n  lenscube lens show double-gauss-28 --plot pictures\n  \
lenscube lens show my.lens.zarr --all-bands\n  lenscube lens show my.zmx --wavelengths 450:650:50 --json\n\
A design ({}, or a built-in name) is traced; of a pack the tables are shown. `run` traces double-gauss-28 at the \
wavelengths of the chart; the built-in pack double-gauss-28-npz has tables of the same lens made with other software.", names_read()))]
pub struct ShowArgs {
    /// Lens pack, design file, or name of a built-in lens
    #[arg(value_name = "PACK|DESIGN", help = format!("Lens pack (directory or .zip, also at a URL), design file ({DESIGN_FILES}), or name of a built-in lens"))]
    pub lens: String,
    /// Wavelengths to show, nm [default: those of the design; some of those of the pack]
    #[arg(long, value_name = "NM")]
    pub wavelengths: Option<String>,
    /// REAL image heights to show, 0:20:5 or 0,3,7.5 [default: five, up to the edge of the field]
    #[arg(long, value_name = "MM")]
    pub heights: Option<String>,
    /// Show all bands of a pack
    #[arg(long)]
    pub all_bands: bool,
    /// Print JSON, with the tables
    #[arg(long)]
    pub json: bool,
    /// Write the tables into this directory, a file NAME.csv each
    #[arg(long, value_name = "DIR")]
    pub csv: Option<PathBuf>,
    /// Write figures (SVG and PNG) into this directory: RI, distortion, lateral colour, MTF, PSFs, encircled energy, nodes; of a design
    /// also spots, ray and OPD fans, field curvature, MTF through focus, cross-section; of a pack without rotational symmetry map, PSFs,
    /// nodes, errors
    #[arg(long, value_name = "DIR", value_parser = figures())]
    pub plot: Option<PathBuf>,
    /// Replace existing figures and tables
    #[arg(long)]
    pub overwrite: bool,
    /// Colours of figures
    #[arg(long, value_parser = one_of(STYLE), default_value = "light")]
    pub style: Style,
    /// Spatial frequencies of the MTF, line pairs per mm; of the MTF through focus the middle one
    #[arg(long, value_name = "F,…", value_parser = bounded(bounds::FREQUENCY_LP_MM), value_delimiter = ',', default_value = "10,20,40")]
    pub lp_mm: Vec<f64>,
    /// Tables of --json and --csv [default: all but wavefront-map]
    #[arg(long, value_name = "NAME,…", value_enum, value_delimiter = ',', hide_possible_values = true, help_heading = "Tables",
        help = format!("Tables of --json and --csv, of {} [default: all but wavefront-map]", TableName::list()))]
    pub tables: Option<Vec<TableName>>,
    /// Rings of the spots: 6 k rays on ring k, one in the middle
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=200), default_value = "6", help_heading = "Tables")]
    pub rings: u16,
    /// Side of the grid of rays of the wavefront, an even number
    #[arg(long, value_name = "N", value_parser = wavefront_samples, default_value = "64", help_heading = "Tables")]
    pub wavefront_samples: usize,
    /// Azimuth of the field points on the film, degrees from x to y: x and y of the wavefront are those of the film
    #[arg(long, value_name = "DEG", value_parser = bounded(bounds::AZIMUTH_DEG), default_value_t = 0.0, allow_hyphen_values = true, help_heading = "Tables")]
    pub azimuth_deg: f64,
    /// Film positions of the MTF through focus, mm, -0.1:0.1:0.02 or a list [default: 11, to twice the depth of the middle frequency]
    #[arg(long, value_name = "MM", allow_hyphen_values = true, help_heading = "Tables")]
    pub focus_mm: Option<String>,
    /// Radii of the encircled energy, µm [default: 14 from 0.5 to 100]
    #[arg(long, value_name = "UM,…", value_parser = bounded(bounds::RADIUS_UM), value_delimiter = ',', help_heading = "Tables")]
    pub radii_um: Option<Vec<f64>>,
    /// Parameters of a design.
    #[command(flatten)]
    pub design: DesignArgs,
}

/// A table of `lens show`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs, reason = "the variants are the values of the flag")]
pub enum TableName {
    FirstOrder,
    CardinalPoints,
    ParaxialRays,
    Seidel,
    RealRays,
    Fields,
    FieldCurvature,
    Spots,
    Wavefront,
    ZernikeStandard,
    ZernikeFringe,
    WavefrontMap,
    Mtf,
    MtfPolychromatic,
    MtfThroughFocus,
    EncircledEnergy,
}

impl TableName {
    /// Its value of the flag, which is the name of its file.
    pub fn name(self) -> String {
        self.to_possible_value().map_or_else(String::new, |v| v.get_name().to_owned())
    }

    fn list() -> String {
        Self::value_variants().iter().map(|v| v.name()).collect::<Vec<_>>().join(", ")
    }
}

/// The side of the grid of a wavefront.
fn wavefront_samples(text: &str) -> Result<usize, String> {
    let (min, max) = SAMPLES;
    let side = text.trim().parse().ok().filter(|n: &usize| n.is_multiple_of(2) && (min..=max).contains(n));
    side.ok_or_else(|| format!("expected an even number from {min} to {max}"))
}

/// `lenscube lens psf`
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  lenscube lens psf double-gauss-28 --at 0,10 --wavelength 550\n  \
lenscube lens psf my.zmx psf.npy --at 12,-8 --pitch-um 2 --integrate --normalise peak --sections psf.csv")]
pub struct PsfArgs {
    /// Design file, or name of a built-in design
    #[arg(value_name = "DESIGN", help = format!("Design file ({DESIGN_FILES}), or name of a built-in design (`lens list`)"))]
    pub design: String,
    /// Array to write: .npy (float32, rows by columns) or .csv (x_um,y_um,psf)
    #[arg(value_name = "OUT")]
    pub out: Option<PathBuf>,
    /// REAL image point X,Y on the film, mm from the axis; rows of the film run towards +Y
    #[arg(long, value_name = "X,Y", value_parser = film_point, default_value = "0,0", allow_hyphen_values = true)]
    pub at: (f64, f64),
    /// Wavelength, nm [default: primary wavelength of the design]
    #[arg(long, value_name = "NM", value_parser = bounded(bounds::WAVELENGTH_NM))]
    pub wavelength: Option<f64>,
    /// Pitch of samples or pixels, µm [default: half of the Nyquist pitch]
    #[arg(long, value_name = "UM", value_parser = pitch)]
    pub pitch_um: Option<f64>,
    /// Samples or pixels a side, an odd number: the chief ray is in the middle of the middle one
    #[arg(long, value_name = "N", value_parser = psf_size, default_value = "129")]
    pub size: usize,
    /// Integrate over pixels of the pitch instead of point samples
    #[arg(long)]
    pub integrate: bool,
    /// What the values are
    #[arg(long, value_enum, default_value_t = Normalise::Light)]
    pub normalise: Normalise,
    /// Write sections and line spread functions through the chief ray along x and y of the film as CSV
    #[arg(long, value_name = "FILE.csv")]
    pub sections: Option<PathBuf>,
    /// Print JSON, with the sections
    #[arg(long)]
    pub json: bool,
    /// Replace existing files
    #[arg(long)]
    pub overwrite: bool,
    /// Parameters of the design.
    #[command(flatten)]
    pub parameters: DesignArgs,
}

/// Normalisation of a PSF.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Normalise {
    /// Share of all the light of the field point on the area of a sample: the sum is the light in the window
    Light,
    /// Sum 1 in the window
    Sum,
    /// Largest value 1
    Peak,
    /// Over the peak of the same pupil without aberrations: the value at the chief ray is the Strehl ratio
    Strehl,
}

impl Normalise {
    /// Its value of the flag.
    pub fn name(self) -> String {
        self.to_possible_value().map_or_else(String::new, |v| v.get_name().to_owned())
    }
}

/// The side of a PSF.
fn psf_size(text: &str) -> Result<usize, String> {
    let side = text.trim().parse().ok().filter(|n: &usize| n % 2 == 1 && (3..=2049).contains(n));
    side.ok_or_else(|| "expected an odd number from 3 to 2049".into())
}

/// `lenscube lens diff`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  lenscube lens diff double-gauss-28 double-gauss-28-npz --wavelengths 450,550,650\n  \
lenscube lens diff built-7.lens.zarr double-gauss-28 --boresight remove"
)]
pub struct DiffArgs {
    /// Lens pack, design file, or name of a built-in lens
    #[arg(value_name = "A", help = format!("Lens pack (also at a URL), design file ({DESIGN_FILES}), or name of a built-in lens"))]
    pub a: String,
    /// The other lens
    #[arg(value_name = "B")]
    pub b: String,
    /// Wavelengths to compare, nm [default: those of both; of two designs, those of A]
    #[arg(long, value_name = "NM")]
    pub wavelengths: Option<String>,
    /// REAL image heights to compare, of lenses with rotational symmetry [default: five, up to the edge of the smaller field]
    #[arg(long, value_name = "MM")]
    pub heights: Option<String>,
    /// Origin of the film places at which lenses without rotational symmetry are compared
    #[arg(long, value_parser = one_of(BORESIGHT), default_value = "keep")]
    pub boresight: Boresight,
    /// Film pitch at which kernels are compared, µm
    #[arg(long, value_name = "UM", value_parser = pitch, default_value = "2")]
    pub film_pitch_um: f64,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    /// Parameters of designs.
    #[command(flatten)]
    pub design: DesignArgs,
}

/// `lenscube lens trace`
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  lenscube lens trace double-gauss-28 dg.lens.zarr\n  \
lenscube lens trace my.zmx my.lens.zarr --wavelengths 450:650:50 --max-height-mm 21.6 --image-plane rms")]
pub struct TraceArgs {
    /// Design file, or name of a built-in design
    #[arg(value_name = "DESIGN", help = format!("Design file ({DESIGN_FILES}), or name of a built-in design (`lens list`)"))]
    pub design: String,
    /// Lens pack to write, a directory or a .zip
    #[arg(value_name = "OUT.lens.zarr")]
    pub out: PathBuf,
    /// Bands in nm: 400:700:10 (both ends included) or 450,550
    #[arg(long, value_name = "NM", default_value = "400:700:10")]
    pub wavelengths: String,
    /// Largest REAL image height of the tables, mm: the film's corner and the PSF's margin [default: that of the design's outermost
    /// field point; 20.5 of double-gauss-28]
    #[arg(long, value_name = "MM", value_parser = bounded(bounds::REACH_MM))]
    pub max_height_mm: Option<f64>,
    /// REAL image heights of the PSFs in mm, 0:20.5:0.5 or 0,3,7.5 [default: as many as --psf-tolerance needs]
    #[arg(long, value_name = "MM")]
    pub heights: Option<String>,
    /// Minimum share of the energy inside every PSF window
    #[arg(long, value_name = "SHARE", value_parser = share, default_value = "0.99")]
    pub energy: f64,
    /// Maximum PSF window, an odd number of film pixels [default: 401; 639 with --depths-m]
    #[arg(long, value_name = "N", value_parser = |text: &str| window_px(text, TraceOptions::WIDEST_PX))]
    pub max_window_px: Option<usize>,
    /// Whether the pack has the light of PSFs beyond their windows (its attribute `extras` then lists `tail`); windows are larger where it needs them
    #[arg(long, value_parser = one_of(SWITCH), action = ArgAction::Set, default_value = "on")]
    pub tails: bool,
    /// Give the pack the chief rays and cones of the light at the film (its attribute `extras` then lists `cones`), for sensors whose response depends on the angle of incidence
    #[arg(long, conflicts_with = "depths_m")]
    pub cones: bool,
    /// Ghosts, of which the pack then has the operators (its attribute `extras` lists `ghost`).
    #[command(flatten)]
    pub ghosts: GhostArgs,
    /// Maximum error of a kernel between nodes: L1 at film pixels, and five times the error of an edge in a film; a band that misses one that is given is an error [default: 0.01, and 0.02 where that takes
    /// more than a sixth of --max-nodes]
    #[arg(long, value_parser = positive)]
    pub psf_tolerance: Option<f64>,
    /// Maximum number of PSF nodes (heights times azimuths) of a band: beyond it the error grows above that of --psf-tolerance, and is printed
    #[arg(long, value_name = "N", default_value_t = pipeline::design::trace::MAX_NODES)]
    pub max_nodes: usize,
    /// Pitch of the PSF samples, µm [default: finer than Nyquist]
    #[arg(long, value_name = "UM", value_parser = pitch)]
    pub psf_pitch_um: Option<f64>,
    /// Pitch of the film that the pack is made for, µm
    #[arg(long, value_name = "UM", value_parser = pitch, default_value = "2")]
    pub film_pitch_um: f64,
    /// Size of the film in pixels, N or WxH, that the map of a lens without rotational symmetry covers: with --tolerances, or by design
    /// [default: the square within --max-height-mm]
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub film_size: Option<Size>,
    /// What the pack has of the PSFs: their samples, or the pupil functions they are computed from when the pack is read, a hundredth of the bytes
    /// [default: psfs up to 1 GB uncompressed and 300 MB a band, else pupils]
    #[arg(long, value_enum, conflicts_with = "depths_m")]
    pub store: Option<Store>,
    /// Make a pack for others, without the design: no names of files, glasses and coatings, no title, no drawn errors, no place of the film in the design; `lenscube help
    /// lenses` lists what it still reveals
    #[arg(long, help_heading = "Sealed packs")]
    pub sealed: bool,
    /// Name of the lens in a sealed pack and in films made with it
    #[arg(long, value_name = "NAME", value_parser = lens_name, default_value = "sealed lens", requires = "sealed", help_heading = "Sealed packs")]
    pub name: String,
    /// Object distance in focus, m from the entrance pupil: the film moves there. `--image-plane design` keeps its distance from the paraxial
    /// image [default: the film and object distance of the design]
    #[arg(long, value_name = "M", value_parser = focus_m, conflicts_with = "object_distance_mm", help_heading = "Depth")]
    pub focus_m: Option<f64>,
    /// Make a pack with depth nodes, for surfaces at NEAR to FAR m from the entrance pupil (`inf` allowed), for `run --depth`
    #[arg(long, value_name = "NEAR:FAR", value_parser = depths, help_heading = "Depth")]
    pub depths_m: Option<Depths>,
    /// Maximum error of a kernel half-way between depth nodes, L1 at film pixels
    #[arg(long, value_parser = bounded(bounds::DEPTH_TOLERANCE), default_value = "0.02", requires = "depths_m", help_heading = "Depth")]
    pub depth_tolerance: f64,
    /// Largest pack with depth nodes, GB uncompressed, as estimated before it is traced
    #[arg(long, value_name = "GB", value_parser = positive, default_value = "16", requires = "depths_m", help_heading = "Depth")]
    pub max_gb: f64,
    /// Manufacturing errors of the design.
    #[command(flatten)]
    pub built: BuiltArgs,
    /// Parameters of the design.
    #[command(flatten)]
    pub parameters: DesignArgs,
}

/// The name of a lens.
fn lens_name(text: &str) -> Result<String, String> {
    let is_valid =
        |text: &str| !text.is_empty() && text.chars().count() <= MAX_NAME && !text.contains(char::is_control);
    Some(text.trim())
        .filter(|text| is_valid(text))
        .map(str::to_owned)
        .ok_or_else(|| format!("expected a name of 1 to {MAX_NAME} characters on one line"))
}

/// What a pack has of its PSFs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs, reason = "the variants are the values of the flag")]
pub enum Store {
    Psfs,
    Pupils,
}
