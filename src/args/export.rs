//! `lenscube export`.

use super::choices::{COMPRESSION, one_of};
use super::values::{bounded, bytes, roi, side, threads};
use clap::{Args, ValueEnum};
use formats::chart::AxisOrder;
use formats::export::exr::ExrCompression;
use pipeline::bounds;
use pipeline::geometry::Rect;
use std::path::{Path, PathBuf};

/// `lenscube export`
#[derive(Clone, Debug, Args)]
#[command(after_help = "Examples:\n  lenscube export film.zarr film.png\n  \
lenscube export film.zarr//roi_0 corner.png\n  lenscube export film.zarr band.png --band 450\n  \
lenscube export film.zarr film.exr --half --memory 1GiB\n  \
lenscube export film.zarr corner.hdr --crop 13000,13000,1141,1141 --bands 450:650\n\
Formats: png (colour preview, or with --band 16-bit grey), tiff (16-bit colour preview, or with --band grey), tiff-bands (one raster of 32-bit float bands), \
exr (one channel per band), envi (.hdr and BSQ data), npy")]
pub struct ExportArgs {
    /// Film or chart: PATH or URL, optionally with //array, a chart file as for `run`, or gen:KIND?…
    #[arg(value_name = "FILM")]
    pub film: String,
    /// File to write, format by extension: .png, .tif, .exr, .hdr (and .bsq, .img), .npy; `-`: standard output, a PNG unless --format is given
    #[arg(value_name = "OUT")]
    pub out: PathBuf,
    /// File format, overriding the extension
    #[arg(long, value_enum)]
    pub format: Option<ExportFormatArg>,
    /// Export only this rectangle, in film pixels
    #[arg(long, value_name = "X,Y,W,H", value_parser = roi, help_heading = "Selection")]
    pub crop: Option<Rect>,
    /// Bands to export: wavelengths in nm, 550 or 450:650 (both ends included), or indices, '#0:5' [default: all]
    #[arg(long, help_heading = "Selection")]
    pub bands: Option<String>,
    /// One band, by its wavelength in nm; in a PNG or TIFF picture as 16-bit linear grey
    #[arg(long, value_name = "NM", value_parser = bounded(bounds::WAVELENGTH_NM), conflicts_with = "bands", help_heading = "Selection")]
    pub band: Option<f64>,
    /// PNG, TIFF: longest side of the picture in pixels; larger films are averaged over areas [default: 2048 for PNG, all for TIFF]
    #[arg(long, value_name = "PX", value_parser = side, help_heading = "Pictures")]
    pub max_side: Option<usize>,
    /// PNG, TIFF: illuminant shown as white: D65, A, E or auto
    #[arg(long, value_name = "NAME", default_value = "D65", help_heading = "Pictures")]
    pub white: String,
    /// PNG, TIFF: multiplier of the values; the percentile of the lit pixels that becomes white, e.g. 99.5%; or auto, the 99th
    #[arg(long, default_value = "auto", help_heading = "Pictures")]
    pub exposure: String,
    /// EXR: 16-bit floats
    #[arg(long, help_heading = "OpenEXR")]
    pub half: bool,
    /// EXR: lossless compression [default: zip]
    #[arg(long, value_parser = one_of(COMPRESSION), help_heading = "OpenEXR")]
    pub compression: Option<ExrCompression>,
    /// Array of a chart's file or store, as for `lenscube run`
    #[arg(long, value_name = "NAME", help_heading = "Selection")]
    pub var: Option<String>,
    /// Axes of a chart's array, as for `lenscube run`
    #[arg(long, value_name = "AXES", help_heading = "Selection")]
    pub axes: Option<AxisOrder>,
    /// Wavelengths in nm, in place of those of the store, if it has some
    #[arg(long, value_name = "NM", help_heading = "Selection")]
    pub wavelengths: Option<String>,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = threads, help_heading = "Machine")]
    pub threads: Option<usize>,
    /// Maximum memory, e.g. 1GiB [default: half of the available memory, at most 4 GiB]
    #[arg(long, value_name = "BYTES", value_parser = bytes, help_heading = "Machine")]
    pub memory: Option<u64>,
    /// Replace an existing file
    #[arg(long)]
    pub overwrite: bool,
    /// File to write instead of `out`.
    #[arg(skip)]
    pub temporary: Option<PathBuf>,
}

impl ExportArgs {
    /// The file to write.
    pub fn target(&self) -> &Path {
        self.temporary.as_deref().unwrap_or(&self.out)
    }
}

/// `--format`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs, reason = "the variants are the values of the flag")]
pub enum ExportFormatArg {
    Png,
    Tiff,
    TiffBands,
    Exr,
    Envi,
    Npy,
}
