//! `lenscube lens`.

use super::import::ImportArgs;
use super::values::positive;
use clap::{Args, Subcommand, ValueEnum};
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
    /// Print what a lens pack holds and what its sampling implies
    #[command(after_help = "Example:  lenscube lens show double-gauss-28 --all-bands")]
    Show {
        /// A lens pack (directory or .zip) or the name of a built-in lens
        #[arg(value_name = "PACK")]
        lens: String,
        /// Every band, not just a few
        #[arg(long)]
        all_bands: bool,
        /// As JSON
        #[arg(long)]
        json: bool,
    },
    /// Make a lens pack from a prescription: heights, RI and PSFs by ray tracing
    Trace(Box<TraceArgs>),
    /// Make a lens pack from what a design program exported: ISET macros, OpticStudio listings, tables, NPZ
    Import(Box<ImportArgs>),
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
    #[arg(long, value_name = "MM", value_parser = positive, default_value = "20.5")]
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
    #[arg(long, value_name = "UM", value_parser = positive)]
    pub psf_pitch_um: Option<f64>,
    /// Pitch of the film that the pack is for
    #[arg(long, value_name = "UM", value_parser = positive, default_value = "2")]
    pub film_pitch_um: f64,
    /// Where the film lies
    #[arg(long, value_enum, default_value_t = ImagePlaneArg::Design)]
    pub image_plane: ImagePlaneArg,
    /// Wavelength of that focus [default: the design's primary]
    #[arg(long, value_name = "NM", value_parser = positive)]
    pub focus_nm: Option<f64>,
    /// Film beyond that plane, away from the lens
    #[arg(long, value_name = "MM", default_value_t = 0.0, allow_hyphen_values = true)]
    pub defocus_mm: f64,
    /// Distance of the object from the first surface [default: as in the design]
    #[arg(long, value_name = "MM", value_parser = positive)]
    pub object_distance_mm: Option<f64>,
    /// How rays are sent through the stop [default: as in the design]
    #[arg(long, value_enum)]
    pub aiming: Option<AimingArg>,
    /// Glass catalogue in AGF format, beside the built-in Schott glasses; may be repeated
    #[arg(long, value_name = "FILE.agf")]
    pub glass_catalog: Vec<PathBuf>,
}

/// Where the film lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ImagePlaneArg {
    /// As in the design
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
