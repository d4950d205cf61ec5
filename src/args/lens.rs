//! `lenscube lens`.

use super::import::ImportArgs;
use super::style::StyleArg;
use super::values::{bounded, pitch, positive};
use clap::{Args, Subcommand, ValueEnum};
use pipeline::bounds;
use std::path::PathBuf;

/// `lenscube lens`
#[derive(Debug, Args)]
pub struct LensArgs {
    /// What to do with it.
    #[command(subcommand)]
    pub command: LensCommand,
}

/// The lens commands.
#[derive(Debug, Subcommand)]
pub enum LensCommand {
    /// Show a lens in numbers and, with --plot, in pictures
    Show(Box<ShowArgs>),
    /// Set two lenses side by side, with what differs
    Diff(Box<DiffArgs>),
    /// Make a lens pack from a prescription: heights, RI and PSFs by ray tracing
    Trace(Box<TraceArgs>),
    /// Make a lens pack from what a design program exported: ISET macros, OpticStudio listings, tables, NPZ
    Import(Box<ImportArgs>),
}

/// `lenscube lens show`
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  lenscube lens show double-gauss-28 --plot pictures\n  \
lenscube lens show my.lens.zarr --all-bands\n  lenscube lens show my.zmx --wavelengths 450:650:50 --json\n\
A design (.zmx, or double-gauss-28) is traced as it stands; a pack shows its tables. `run` traces double-gauss-28 band by \
band as charts need it; its tables made with other software are the pack double-gauss-28-npz.")]
pub struct ShowArgs {
    /// A lens pack (directory or .zip, also at a URL), a sequential .zmx file, or the name of a built-in lens
    #[arg(value_name = "PACK|DESIGN")]
    pub lens: String,
    /// Wavelengths to show [default: the design's own; some of the pack's]
    #[arg(long, value_name = "NM")]
    pub wavelengths: Option<String>,
    /// REAL image heights to show, 0:20:5 or 0,3,7.5 [default: five, to the edge of the field]
    #[arg(long, value_name = "MM")]
    pub heights: Option<String>,
    /// Every band of a pack, not just a few
    #[arg(long)]
    pub all_bands: bool,
    /// As JSON
    #[arg(long)]
    pub json: bool,
    /// Write figures (SVG and PNG) into this directory: RI, distortion, lateral colour, MTF, PSFs, nodes, a design's cross-section
    #[arg(long, value_name = "DIR")]
    pub plot: Option<PathBuf>,
    /// Colours of figures
    #[arg(long, value_enum, default_value_t)]
    pub style: StyleArg,
    /// Line pairs per mm of the MTF against field
    #[arg(long, value_name = "F,…", value_parser = bounded(bounds::FREQUENCY_LP_MM), value_delimiter = ',', default_value = "10,20,40")]
    pub lp_mm: Vec<f64>,
    /// How a design is taken.
    #[command(flatten)]
    pub design: DesignArgs,
}

/// `lenscube lens diff`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:  lenscube lens diff double-gauss-28 double-gauss-28-npz --wavelengths 450,550,650"
)]
pub struct DiffArgs {
    /// A lens pack (also at a URL), a sequential .zmx file, or the name of a built-in lens
    #[arg(value_name = "A")]
    pub a: String,
    /// Another
    #[arg(value_name = "B")]
    pub b: String,
    /// Wavelengths to compare [default: those both hold; of two designs, A's own]
    #[arg(long, value_name = "NM")]
    pub wavelengths: Option<String>,
    /// REAL image heights to compare [default: five, to the edge that both hold]
    #[arg(long, value_name = "MM")]
    pub heights: Option<String>,
    /// Film pitch at which kernels are compared
    #[arg(long, value_name = "UM", value_parser = pitch, default_value = "2")]
    pub film_pitch_um: f64,
    /// As JSON
    #[arg(long)]
    pub json: bool,
    /// How designs are taken.
    #[command(flatten)]
    pub design: DesignArgs,
}

/// How a design is taken: its film plane, conjugate, aiming and glasses.
#[derive(Clone, Debug, Default, PartialEq, Args)]
#[command(next_help_heading = "Designs")]
pub struct DesignArgs {
    /// Where the film lies
    #[arg(long, value_enum, default_value_t = ImagePlaneArg::Design)]
    pub image_plane: ImagePlaneArg,
    /// Wavelength of that focus [default: the design's primary]
    #[arg(long, value_name = "NM", value_parser = bounded(bounds::WAVELENGTH_NM))]
    pub focus_nm: Option<f64>,
    /// Film beyond that plane, away from the lens
    #[arg(long, value_name = "MM", value_parser = bounded(bounds::DEFOCUS_MM), default_value_t = 0.0, allow_hyphen_values = true)]
    pub defocus_mm: f64,
    /// Distance of the object from the first surface [default: as in the design]
    #[arg(long, value_name = "MM", value_parser = bounded(bounds::GIVEN_DISTANCE_MM))]
    pub object_distance_mm: Option<f64>,
    /// How rays are sent through the stop [default: as in the design]
    #[arg(long, value_enum)]
    pub aiming: Option<AimingArg>,
    /// Glass catalogue in AGF format, beside the built-in Schott glasses; may be repeated
    #[arg(long, value_name = "FILE.agf")]
    pub glass_catalog: Vec<PathBuf>,
}

/// `lenscube lens trace`
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  lenscube lens trace double-gauss-28 dg.lens.zarr\n  \
lenscube lens trace my.zmx my.lens.zarr --wavelengths 450:650:50 --max-height-mm 21.6 --image-plane rms")]
pub struct TraceArgs {
    /// A sequential .zmx file, or double-gauss-28
    #[arg(value_name = "DESIGN")]
    pub design: String,
    /// The lens pack to write, a directory or a .zip
    #[arg(value_name = "OUT.lens.zarr")]
    pub out: PathBuf,
    /// Bands in nm: 400:700:10 (both ends) or 450,550
    #[arg(long, value_name = "NM", default_value = "400:700:10")]
    pub wavelengths: String,
    /// REAL image height that the tables reach: the film's corner and the PSF's margin
    #[arg(long, value_name = "MM", value_parser = bounded(bounds::REACH_MM), default_value = "20.5")]
    pub max_height_mm: f64,
    /// REAL image heights of the PSFs in mm, 0:20.5:0.5 or 0,3,7.5 [default: chosen by error]
    #[arg(long, value_name = "MM")]
    pub heights: Option<String>,
    /// Share of the light that every window must hold
    #[arg(long, value_parser = positive, default_value = "0.99")]
    pub energy: f64,
    /// Error allowed of a kernel between nodes, L1 on the film pixel
    #[arg(long, value_parser = positive, default_value = "0.01")]
    pub psf_tolerance: f64,
    /// Pitch of the PSF samples [default: finer than Nyquist]
    #[arg(long, value_name = "UM", value_parser = pitch)]
    pub psf_pitch_um: Option<f64>,
    /// Pitch of the film that the pack is for
    #[arg(long, value_name = "UM", value_parser = pitch, default_value = "2")]
    pub film_pitch_um: f64,
    /// How the design is taken.
    #[command(flatten)]
    pub place: DesignArgs,
}

/// Where the film lies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum ImagePlaneArg {
    /// As in the design
    #[default]
    Design,
    /// At the paraxial focus
    Paraxial,
    /// Least RMS spot on the axis
    Rms,
    /// Highest Strehl ratio on the axis
    Strehl,
}

/// How rays are sent through the stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum AimingArg {
    /// So that they fill the stop
    Real,
    /// At the paraxial entrance pupil
    Paraxial,
}
