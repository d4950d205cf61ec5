//! `lenscube run`.

use super::values::{
    azimuths, bounded, bytes, odd, pair, pair_mm, pitch, roi, scale, size, storage, threads,
};
use super::{CodecArg, Device, EngineArg};
use clap::{Args, ValueEnum};
use pipeline::bounds;
use pipeline::geometry::{Rect, Size};
use std::path::PathBuf;

/// A job: what `lenscube run` makes and `lenscube plan` cuts.
#[derive(Debug, Args, Clone)]
pub struct RunArgs {
    /// PATH or PATH//array of a Zarr store, here or at a URL; .npy; ENVI (.hdr); raw samples; or gen:KIND?size=14141&…
    #[arg(value_name = "CHART")]
    pub chart: String,
    /// The film to write, a Zarr v3 group, here or at s3://BUCKET/PREFIX
    #[arg(value_name = "FILM")]
    pub film: PathBuf,
    /// A lens pack (directory or .zip, also at a URL), a design (.zmx) to trace for the chart's wavelengths, or the name of a built-in
    /// lens; that name always means the built-in lens, a file so named is ./NAME
    #[arg(long, value_name = "NAME|PACK|DESIGN", default_value = "double-gauss-28")]
    pub lens: String,
    /// Raw samples: the chart's shape, band after band
    #[arg(long, value_name = "BANDS,ROWS,COLUMNS", requires = "chart_dtype")]
    pub chart_shape: Option<String>,
    /// Raw samples: their type, u1, u2, f2, f4 or f8; `>` before it for highest byte first
    #[arg(long, value_name = "TYPE", requires = "chart_shape")]
    pub chart_dtype: Option<String>,
    /// Wavelengths of the chart's bands where the store has none: 400:700:10 (both ends) or 450,550
    #[arg(long, value_name = "NM")]
    pub wavelengths: Option<String>,
    /// Bands to make: indices and ranges without their end, 0,5,10:15
    #[arg(long)]
    pub bands: Option<String>,
    /// Which of ri, distortion, svpsf to apply
    #[arg(long, value_enum, value_delimiter = ',', default_value = "ri,distortion,svpsf")]
    pub stages: Vec<Stage>,
    /// Compute windows of the film only, each an array roi_N; may be repeated
    #[arg(long, value_name = "X,Y,W,H", value_parser = roi)]
    pub roi: Vec<Rect>,
    /// Azimuths per PSF height instead of the lens's own, a multiple of 4
    #[arg(long, value_name = "J", value_parser = azimuths)]
    pub azimuths: Option<usize>,
    /// Crop PSFs to N x N film pixels, odd; they are normalised again
    #[arg(long, value_name = "N", value_parser = odd)]
    pub psf_window: Option<usize>,
    /// Interpolate PSFs between the lens's wavelengths (it can be wrong by 30-100 % over 20 nm in the blue)
    #[arg(long)]
    pub interpolate_psf: bool,
    /// Film size in pixels: N or HxW [default: the chart's film_size, else its size times the scale]
    #[arg(long, value_name = "HxW", value_parser = size)]
    pub film_size: Option<Size>,
    /// Film pixel pitch in µm [default: the chart's pitch_um]
    #[arg(long, value_name = "UM", value_parser = pitch)]
    pub film_pitch_um: Option<f64>,
    /// Optical axis in film pixels [default: the middle]
    #[arg(long, value_name = "X,Y", value_parser = pair, allow_hyphen_values = true)]
    pub axis: Option<(f64, f64)>,
    /// Film pixels per chart pixel
    #[arg(long, value_name = "SX[,SY]", value_parser = scale, default_value = "1")]
    pub scale: (f64, f64),
    /// Pitch of the chart's pixels in object space, instead of --scale: with a lens for that object's distance the scale is
    /// |magnification| x this / the film's pitch
    #[arg(long, value_name = "MM", value_parser = bounded(bounds::OBJECT_PITCH_MM), conflicts_with = "scale")]
    pub chart_pitch_mm: Option<f64>,
    /// Centre of the chart in mm from the axis
    #[arg(long, value_name = "X,Y", value_parser = pair_mm, default_value = "0,0", allow_hyphen_values = true)]
    pub center: (f64, f64),
    /// Interpolation between chart pixels (bilinear blurs)
    #[arg(long, value_enum, default_value_t = InterpArg::Bicubic)]
    pub interp: InterpArg,
    /// What lies around the chart
    #[arg(long, value_enum, default_value_t = SurroundArg::Edge)]
    pub surround: SurroundArg,
    /// Film beyond the lens's tables: refuse, or go on with the last values
    #[arg(long, value_enum, default_value_t = OutsideArg::Error)]
    pub outside: OutsideArg,
    /// NaN, infinity and declared fill values in the chart: refuse, or read as zero and count
    #[arg(long, value_enum, default_value_t = NanArg::Error)]
    pub nan: NanArg,
    /// relative (chart values x RI), irradiance (W m-2 nm-1 of a radiance chart) or photons (per s, nm, pixel)
    #[arg(long, value_enum, default_value_t = FilmUnits::Relative)]
    pub film_units: FilmUnits,
    /// Sample type of the film
    #[arg(long, value_enum, default_value_t = DtypeArg::F32)]
    pub dtype: DtypeArg,
    /// Shard side in pixels, a multiple of the chunk
    #[arg(long, default_value_t = 2048, value_parser = storage)]
    pub shard: usize,
    /// Inner chunk side in pixels
    #[arg(long, default_value_t = 512, value_parser = storage)]
    pub chunk: usize,
    /// Compression of the film
    #[arg(long, value_enum, default_value_t = CodecArg::Zstd)]
    pub codec: CodecArg,
    /// What computes: cpu; cuda (all GPUs) or cuda:0,2 (a queue for each mention); auto (GPUs if they work, else cpu)
    #[arg(long, value_name = "DEVICE", default_value_t = Device::Auto)]
    pub device: Device,
    /// Implementation of the arithmetic: avx512, avx2 or portable (processor), cuda-sm_90 (GPUs of that compute capability)
    /// [default: that of the film if it exists and this machine has it, else the fastest]
    #[arg(long, value_name = "ENGINE", default_value_t = EngineArg::Auto, hide_default_value = true)]
    pub engine: EngineArg,
    /// Continue a film that another engine began; values of engines differ by up to 2e-6 of the peak
    #[arg(long)]
    pub mixed_engines: bool,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = threads)]
    pub threads: Option<usize>,
    /// Memory to stay within, e.g. 1GiB [default: half of what is available, at most 4 GiB]
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    pub memory: Option<u64>,
    /// Do not wait for the disk after each shard: faster, unsafe against power cuts
    #[arg(long)]
    pub no_fsync: bool,
    /// Start anew if the film exists
    #[arg(long)]
    pub overwrite: bool,
    /// Resume although the chart's files were touched; names and sizes must still be the same
    #[arg(long)]
    pub trust_input: bool,
    /// Make the film's pyramid when it is complete, as `lenscube pyramid` does
    #[arg(long)]
    pub pyramid: bool,
    /// After a fault finish all shards that do not depend on it
    #[arg(long)]
    pub keep_going: bool,
    /// Although a run of another host has locked the film: that run has ended
    #[arg(long)]
    pub take_over: bool,
}

/// One of the three effects.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Stage {
    /// Relative illumination
    Ri,
    /// Radial distortion
    Distortion,
    /// Spatially variant PSF
    Svpsf,
}

/// Interpolation words.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs, reason = "they are what they say")]
pub enum InterpArg {
    Bicubic,
    Bilinear,
}

/// Surround words.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs, reason = "they are what they say")]
pub enum SurroundArg {
    Edge,
    Black,
    Mirror,
}

/// Outside words.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs, reason = "they are what they say")]
pub enum OutsideArg {
    Error,
    Clamp,
}

/// NaN words.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs, reason = "they are what they say")]
pub enum NanArg {
    Error,
    Zero,
}

/// Units of the film.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FilmUnits {
    /// Chart values times relative illumination, blurred
    Relative,
    /// Spectral irradiance, W m-2 nm-1
    Irradiance,
    /// Photons per second, nm and pixel
    Photons,
}

/// Sample types of the film.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs, reason = "they are what they say")]
pub enum DtypeArg {
    F32,
    F16,
}
