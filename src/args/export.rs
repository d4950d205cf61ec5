//! `lenscube export`.

use super::values::threads;
use clap::Args;
use std::path::PathBuf;

/// `lenscube export`
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  lenscube export film.zarr film.png\n  \
lenscube export film.zarr//roi_0 corner.png\n  lenscube export film.zarr band.png --band 450")]
pub struct ExportArgs {
    /// A film or chart: PATH, URL, either with //array, or gen:KIND?…
    #[arg(value_name = "FILM")]
    pub film: String,
    /// The picture to write
    #[arg(value_name = "OUT.png")]
    pub out: PathBuf,
    /// One band as 16-bit linear grey, by its wavelength in nm
    #[arg(long, value_name = "NM")]
    pub band: Option<f64>,
    /// Longest side of the picture in pixels; larger films are area-averaged
    #[arg(long, value_name = "PX", default_value_t = 2048)]
    pub max_side: usize,
    /// What is shown as white: D65, A or E
    #[arg(long, value_name = "NAME", default_value = "D65")]
    pub white: String,
    /// Factor on the values, or auto
    #[arg(long, default_value = "auto")]
    pub exposure: String,
    /// Wavelengths where the store has none
    #[arg(long, value_name = "NM")]
    pub wavelengths: Option<String>,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = threads)]
    pub threads: Option<usize>,
}
