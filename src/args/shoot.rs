//! `lenscube shoot`.

use super::choices::{DEMOSAIC, one_of};
use super::depth::DepthArgs;
use super::tracing::TracingArgs;
use super::values::{bytes, percent_or_share, pitch, positive, size, threads, unit};
use super::veil::VeilArgs;
use clap::Args;
use formats::chart::AxisOrder;
use pipeline::develop::Demosaic;
use pipeline::geometry::Size;
use std::path::PathBuf;

/// `lenscube shoot`
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  lenscube shoot 'gen:checker?size=2000' picture.png --lens double-gauss-28 --sensor example-2um\n  \
lenscube shoot chart.zarr negative.dng --lens MY.zmx --sensor sony-a7r2 --exposure 10ms --keep shot\n  \
lenscube shoot photo.jpg picture.png --film-pitch-um 2 --lens double-gauss-28 --sensor example-2um\n  \
lenscube shoot scene.zarr picture.png --lens phone --focus-m 1 --depth depth.npy --sensor example-2um\n\
The same as `lenscube run CHART DIR/film.zarr`, `lenscube sensor DIR/film.zarr DIR/raw.zarr` and `lenscube develop DIR/raw.zarr OUT`; those\n\
commands have more options. Without --keep, DIR is OUT.shot and removed at the end. The same command resumes after an interruption, also with --overwrite."
)]
pub struct ShootArgs {
    /// Chart, as for `lenscube run`; or a picture in colour (PNG, JPEG, WebP, TIFF, OpenEXR), as for `lenscube chart image`
    #[arg(value_name = "CHART")]
    pub chart: String,
    /// Picture to write: .png, .tif or .exr; or .dng
    #[arg(value_name = "OUT")]
    pub out: PathBuf,
    /// Lens, as for `lenscube run`
    #[arg(long, value_name = "LENS")]
    pub lens: String,
    /// Sensor, as for `lenscube sensor`
    #[arg(long, value_name = "NAME|FILE")]
    pub sensor: String,
    /// Array of the chart, as for `lenscube run`
    #[arg(long, value_name = "NAME")]
    pub var: Option<String>,
    /// Axes of the chart's array, as for `lenscube run`
    #[arg(long, value_name = "AXES")]
    pub axes: Option<AxisOrder>,
    /// Wavelengths of the chart's bands in nm where it has none; of a picture those of its spectra [default: 400:700:10]
    #[arg(long, value_name = "NM")]
    pub wavelengths: Option<String>,
    /// Error of the colours of a picture's spectra, as for `lenscube chart image`
    #[arg(long, value_name = "SHARE", value_parser = percent_or_share)]
    pub max_colour_error: Option<f64>,
    /// Unit of the chart's values, as for `lenscube run`
    #[arg(long, value_name = "UNIT", value_parser = unit)]
    pub chart_units: Option<String>,
    /// Identify the chart by the content of its files, as for `lenscube run`
    #[arg(long)]
    pub check_input: bool,
    /// Film size in pixels: N or WxH, as for `lenscube run`
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub film_size: Option<Size>,
    /// Film pitch where the chart has none
    #[arg(long, value_name = "UM", value_parser = pitch)]
    pub film_pitch_um: Option<f64>,
    /// Exposure time, or auto
    #[arg(long, value_name = "TIME", default_value = "auto")]
    pub exposure: String,
    /// Gain of the converter
    #[arg(long, value_parser = positive, conflicts_with = "iso")]
    pub gain: Option<f64>,
    /// Gain as ISO over the sensor's base ISO
    #[arg(long, value_parser = positive)]
    pub iso: Option<f64>,
    /// Seed of the noise of each frame
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Light that becomes neutral, as for `lenscube develop`; of a .dng as for `lenscube sensor`
    #[arg(long, value_name = "LIGHT")]
    pub white: Option<String>,
    /// Interpolation of the planes
    #[arg(long, value_parser = one_of(DEMOSAIC))]
    pub demosaic: Option<Demosaic>,
    /// Division by the lens's relative illumination
    #[arg(long)]
    pub even_light: bool,
    /// Keep film and raw in this directory
    #[arg(long, value_name = "DIR")]
    pub keep: Option<PathBuf>,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = threads)]
    pub threads: Option<usize>,
    /// Maximum memory of each step, e.g. 1GiB
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    pub memory: Option<u64>,
    /// Replace an existing picture, and film and raw of other jobs; those of this job are resumed
    #[arg(long)]
    pub overwrite: bool,
    /// Surfaces at several distances, and the lens's focus, as for `lenscube run`.
    #[command(flatten)]
    pub surfaces: DepthArgs,
    /// How a design is traced, as for `lenscube run`.
    #[command(flatten)]
    pub tracing: TracingArgs,
    /// Light that spreads far over the film, as for `lenscube run`.
    #[command(flatten)]
    pub veil: VeilArgs,
}
