//! Arguments of a job (`lenscube run`, `lenscube plan`).

use super::built::BuiltArgs;
use super::choices::{
    CODEC, DTYPE, INTERP, NAN, OUTSIDE, SURROUND, default_stages, one_of, stage, stages_help,
};
use super::depth::DepthArgs;
use super::design::DESIGN_FILES;
use super::device::{Device, EngineArg};
use super::placement::PlacementArgs;
use super::tracing::TracingArgs;
use super::values::{azimuths, bytes, keep_bits, odd, positive, roi, storage, threads, unit};
use super::veil::VeilArgs;
use clap::{Args, ValueEnum};
use formats::chart::AxisOrder;
use formats::chart::NanPolicy;
use formats::film::{Codec, FilmSpec, SampleType};
use pipeline::field::Outside;
use pipeline::geometry::Rect;
use pipeline::resample::{Interp, Surround};
use pipeline::stage::Stage;
use pipeline::stages::{self, described};
use std::path::PathBuf;

/// A job: the arguments shared by `lenscube run` and `lenscube plan`, which commands that make a film request by [`RunArgs::new`].
#[derive(Clone, Debug, PartialEq, Args)]
pub struct RunArgs {
    /// Chart: PATH or PATH//array of a Zarr store, local or at a URL; HDF5, NetCDF-4 or .mat (cube.mat//rad); .npy; ENVI (.hdr); TIFF of several bands; spectral .exr; folder or
    /// '*.png' of grey pictures, one per band; raw samples; or gen:KIND?size=14141&…; a scene, or of `run` a mesh (.glb, .gltf, .obj, .ply)
    #[arg(value_name = "CHART")]
    pub chart: String,
    /// Film to write, a Zarr v3 group, local or at s3://BUCKET/PREFIX
    #[arg(value_name = "FILM")]
    pub film: PathBuf,
    /// Lens pack, design to trace at the chart's wavelengths, or name of a built-in lens.
    #[arg(long, value_name = "NAME|PACK|DESIGN", default_value = DEFAULT_LENS, help_heading = "Lens", help = format!(
        "Lens pack (directory or .zip, also at a URL), design ({DESIGN_FILES}) to trace at the chart's wavelengths, or name of a built-in lens. \
         A file with the name of a built-in lens is given as ./NAME"
    ))]
    pub lens: String,
    /// How a design is traced.
    #[command(flatten)]
    pub tracing: TracingArgs,
    /// Manufacturing errors of a design.
    #[command(flatten)]
    pub built: BuiltArgs,
    /// Array of the chart's file or store, the same as CHART//NAME
    #[arg(long, value_name = "NAME", conflicts_with = "chart_shape", help_heading = "Chart")]
    pub var: Option<String>,
    /// Shape of a raw chart, stored band after band, or in the order of --axes
    #[arg(long, value_name = "BANDS,ROWS,COLUMNS", requires = "chart_dtype", help_heading = "Chart")]
    pub chart_shape: Option<String>,
    /// Sample type of a raw chart: u8, u16, f16, f32 or f64; prefix `>` for big-endian; or NumPy's u1, u2, u4, i2, i4, f2, f4, f8
    #[arg(long, value_name = "TYPE", requires = "chart_shape", help_heading = "Chart")]
    pub chart_dtype: Option<String>,
    /// Axes of the chart's array, slowest first, where names of dimensions do not give them: y,x,wavelength (Zarr, HDF5, .npy, raw; of a
    /// .mat file as MATLAB shows them)
    #[arg(long, value_name = "AXES", help_heading = "Chart")]
    pub axes: Option<AxisOrder>,
    /// Factor of all chart values, e.g. 1e-4 for reflectance stored as integers to 10000 [default: 1]
    #[arg(long, value_name = "FACTOR", value_parser = positive, help_heading = "Chart")]
    pub chart_scale: Option<f64>,
    /// Unit of the chart's values, e.g. 'W m-2 sr-1 nm-1' [default: that of its metadata]; the values are not changed
    #[arg(long, value_name = "UNIT", value_parser = unit, help_heading = "Chart")]
    pub chart_units: Option<String>,
    /// Wavelengths in nm of the bands of the chart, in place of those of its store, if it has some: 400:700:10 (both ends included) or 450,550
    #[arg(long, value_name = "NM", help_heading = "Chart")]
    pub wavelengths: Option<String>,
    /// Bands to compute: wavelengths in nm, 550 or 450:650 (both ends included), or indices, '#0:5' [default: all]
    #[arg(long, help_heading = "Chart")]
    pub bands: Option<String>,
    /// Surfaces at several distances.
    #[command(flatten)]
    pub surfaces: DepthArgs,
    /// Stages to apply
    #[arg(
        long,
        help = stages_help(),
        value_parser = stage(),
        value_delimiter = ',',
        default_value = default_stages(),
        help_heading = "Lens"
    )]
    pub stages: Vec<Stage>,
    /// Compute regions of the film only, in film pixels, each stored as an array roi_N; repeatable
    #[arg(long, value_name = "X,Y,W,H", value_parser = roi, help_heading = "Film")]
    pub roi: Vec<Rect>,
    /// Azimuths per PSF height, a multiple of 4 [default: those of the lens]
    #[arg(long, value_name = "J", value_parser = azimuths, help_heading = "Lens")]
    pub azimuths: Option<usize>,
    /// Crop PSFs to N x N film pixels (N odd) and scale each to sum 1 [default: the lens's window]
    #[arg(long, value_name = "N", value_parser = odd, help_heading = "Lens")]
    pub psf_window: Option<usize>,
    /// Interpolate PSFs between the lens's wavelengths (between bands 20 nm apart the kernel error can be 30 to 100 % (L1) in the blue)
    #[arg(long, help_heading = "Lens")]
    pub interpolate_psf: bool,
    /// Size of the film, place of the chart.
    #[command(flatten)]
    pub placement: PlacementArgs,
    /// Light that spreads far over the film.
    #[command(flatten)]
    pub veil: VeilArgs,
    /// Interpolation between chart pixels (bilinear reduces sharpness)
    #[arg(long, value_parser = one_of(INTERP), default_value = "bicubic", help_heading = "Placement")]
    pub interp: Interp,
    /// Values outside the chart
    #[arg(long, value_parser = one_of(SURROUND), default_value = "edge", help_heading = "Placement")]
    pub surround: Surround,
    /// Film beyond the lens's tables: error, or clamp to the last values
    #[arg(long, value_parser = one_of(OUTSIDE), default_value = "error", help_heading = "Lens")]
    pub outside: Outside,
    /// NaN, infinity and declared fill values in the chart: error, or read as zero and count
    #[arg(long, value_parser = one_of(NAN), default_value = "error", help_heading = "Chart")]
    pub nan: NanPolicy,
    /// relative: chart values x relative illumination; irradiance: W m-2 nm-1, from a radiance chart; photons: per s, nm and pixel
    #[arg(long, value_enum, default_value_t = FilmUnits::Relative, help_heading = "Film")]
    pub film_units: FilmUnits,
    /// Sample type of the film
    #[arg(long, value_parser = one_of(DTYPE), default_value = "f32", help_heading = "Film")]
    pub dtype: SampleType,
    /// Shard side in pixels, a multiple of the chunk
    #[arg(long, default_value_t = FilmSpec::SHARD, value_parser = storage, help_heading = "Film")]
    pub shard: usize,
    /// Inner chunk side in pixels
    #[arg(long, default_value_t = FilmSpec::CHUNK, value_parser = storage, help_heading = "Film")]
    pub chunk: usize,
    /// Compression of the film; zstd, smaller and slower, for slow or costly storage [default: that of the film if it exists, else lz4]
    #[arg(long, value_parser = one_of(CODEC), help_heading = "Film")]
    pub codec: Option<Codec>,
    /// Round samples to N bits of mantissa, so that they compress better: a relative error of at most 2^-(N+1) [default: all, 23 of
    /// f32 and 10 of f16]
    #[arg(long, value_name = "N", value_parser = keep_bits, help_heading = "Film")]
    pub keep_bits: Option<u32>,
    /// Device: cpu; cuda (all GPUs) or cuda:0,2 (one queue per entry); auto (GPUs if usable, else cpu)
    #[arg(long, value_name = "DEVICE", default_value_t = Device::Auto, help_heading = "Machine")]
    pub device: Device,
    /// Implementation of the arithmetic: avx512, avx2 or portable (CPU), cuda-sm_90 (GPUs of that compute capability)
    /// [default: that of the film if it exists and this machine has it, else the fastest]
    #[arg(long, value_name = "ENGINE", default_value_t = EngineArg::Auto, hide_default_value = true, help_heading = "Machine")]
    pub engine: EngineArg,
    /// Continue a film that was created with another engine; values of engines differ by up to 2e-6 of the peak
    #[arg(long, help_heading = "Machine")]
    pub mixed_engines: bool,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = threads, help_heading = "Machine")]
    pub threads: Option<usize>,
    /// Maximum memory, e.g. 1GiB [default: half of the available memory, at most 4 GiB]
    #[arg(long, value_name = "BYTES", value_parser = bytes, help_heading = "Machine")]
    pub memory: Option<u64>,
    /// Do not wait for the disk after each shard: faster, but a power failure may lose shards
    #[arg(long, help_heading = "Machine")]
    pub no_fsync: bool,
    /// Resume although the chart's files have new modification times; names and sizes must be unchanged
    #[arg(long, help_heading = "Existing film")]
    pub trust_input: bool,
    /// Identify the chart by the content of its files (not at URLs), which are read once more before and after the run, instead of their
    /// modification times [default: as the film was created]
    #[arg(long, help_heading = "Existing film")]
    pub check_input: bool,
    /// Make the pyramid afterwards, as `lenscube pyramid` does
    #[arg(long, help_heading = "Film")]
    pub pyramid: bool,
    /// After an error finish all shards that do not depend on it
    #[arg(long, help_heading = "Existing film")]
    pub keep_going: bool,
    /// Flags that a plan does not store.
    #[command(flatten)]
    pub process: ProcessArgs,
}

/// Default of `--lens`.
const DEFAULT_LENS: &str = "double-gauss-28";

impl RunArgs {
    /// The job of `lenscube run CHART FILM` without flags.
    pub fn new(chart: impl Into<String>, film: impl Into<PathBuf>) -> Self {
        Self {
            chart: chart.into(),
            film: film.into(),
            lens: DEFAULT_LENS.into(),
            tracing: TracingArgs::default(),
            built: BuiltArgs::default(),
            var: None,
            chart_shape: None,
            chart_dtype: None,
            axes: None,
            chart_scale: None,
            chart_units: None,
            wavelengths: None,
            bands: None,
            surfaces: DepthArgs::default(),
            stages: described(stages::default_stages()).map(|d| d.stage).collect(),
            roi: Vec::new(),
            azimuths: None,
            psf_window: None,
            interpolate_psf: false,
            placement: PlacementArgs::default(),
            veil: VeilArgs::default(),
            interp: Interp::Bicubic,
            surround: Surround::Edge,
            outside: Outside::Error,
            nan: NanPolicy::Error,
            film_units: FilmUnits::Relative,
            dtype: SampleType::F32,
            shard: FilmSpec::SHARD,
            chunk: FilmSpec::CHUNK,
            codec: None,
            keep_bits: None,
            device: Device::Auto,
            engine: EngineArg::Auto,
            mixed_engines: false,
            threads: None,
            memory: None,
            no_fsync: false,
            trust_input: false,
            check_input: false,
            pyramid: false,
            keep_going: false,
            process: ProcessArgs::default(),
        }
    }
}

/// Flags of one process: they do not belong to the job, and a plan does not store them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Args)]
pub struct ProcessArgs {
    /// Remove an existing film and start again
    #[arg(long, help_heading = "Existing film")]
    pub overwrite: bool,
    /// Start although the disk is too small for the film
    #[arg(long, help_heading = "Existing film")]
    pub force: bool,
    /// Take over a stale lock held by another host
    #[arg(long, help_heading = "Existing film")]
    pub take_over: bool,
}

/// `--film-units`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FilmUnits {
    /// Chart values times relative illumination, convolved with the PSF
    Relative,
    /// Spectral irradiance, W m-2 nm-1
    Irradiance,
    /// Photons per second, nm and pixel
    Photons,
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::{Command, FromArgMatches};

    #[test]
    fn request_has_the_defaults_of_the_flags() {
        let matches = RunArgs::augment_args(Command::new("run")).get_matches_from(["run", "chart", "film"]);
        assert_eq!(RunArgs::from_arg_matches(&matches).unwrap(), RunArgs::new("chart", "film"));
    }
}
