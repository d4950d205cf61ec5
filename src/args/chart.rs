//! `lenscube chart`.

use super::choices::{CODEC, one_of};
use super::values::{bytes, percent_or_share, pitch, positive, threads};
use clap::{Args, Subcommand};
use formats::film::Codec;
use std::path::PathBuf;

/// `lenscube chart`
#[derive(Debug, Args)]
#[command(
    args_conflicts_with_subcommands = true,
    subcommand_negates_reqs = true,
    disable_help_subcommand = true,
    after_help = "Examples:\n  lenscube chart slanted-edge edges.zarr --film-size 14141 --grid 5 --angle-deg 5\n  \
lenscube chart image photo.png chart.zarr --film-pitch-um 2\n  \
lenscube chart motion chart.zarr moved.zarr --motion motion.csv --exposure 4ms\n  \
lenscube chart depth-scene scene.zarr --film-size 1500x1000 --near-m 0.1 --far-m inf    # with distances and hidden surfaces\n  \
lenscube run 'gen:composite?size=14141' film.zarr     # without a store"
)]
pub struct ChartArgs {
    /// Conversion of a file.
    #[command(subcommand)]
    pub convert: Option<ChartCommand>,
    /// A generated chart.
    #[command(flatten)]
    pub generated: Option<GeneratedArgs>,
}

/// Charts converted from files and other charts.
#[derive(Debug, Subcommand)]
pub enum ChartCommand {
    /// Convert a picture (PNG, JPEG, WebP, TIFF or OpenEXR) to a chart: colours become spectra of reflected light
    Image(ImageArgs),
    /// Move a flat chart during an exposure: its mean over the time, of which `run` makes the film of the moving chart
    Motion(MotionArgs),
}

/// `lenscube chart motion`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  lenscube chart motion chart.zarr moved.zarr --motion motion.csv --exposure 4ms\n\
motion.csv: time_s from the start of the exposure; x_um and y_um, the shift of the chart to the right and down; rotation_deg about its middle, clockwise. All are on the ideal image plane, where the \
chart's pixel pitch is; linear between rows."
)]
pub struct MotionArgs {
    /// Chart, as for `lenscube run`
    #[arg(value_name = "CHART")]
    pub chart: String,
    /// Zarr store to write, local or at s3://BUCKET/PREFIX
    #[arg(value_name = "OUT.zarr")]
    pub out: PathBuf,
    /// Motion of the chart, a CSV: time_s, x_um, y_um, rotation_deg
    #[arg(long, value_name = "FILE.csv")]
    pub motion: PathBuf,
    /// Exposure time: 4ms, 1/60s
    #[arg(long, value_name = "TIME")]
    pub exposure: String,
    /// Pixel pitch in µm [default: the chart's]
    #[arg(long = "film-pitch-um", alias = "pitch-um", value_name = "UM", value_parser = pitch)]
    pub pitch_um: Option<f64>,
    /// Wavelengths in nm of the bands of the chart, in place of those of its store, if it has some: 400:700:10 (both ends included) or 450,550
    #[arg(long, value_name = "NM")]
    pub wavelengths: Option<String>,
    /// Compression of the store; zstd is smaller and slower
    #[arg(long, value_parser = one_of(CODEC), default_value = "lz4")]
    pub codec: Codec,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = threads)]
    pub threads: Option<usize>,
    /// Maximum memory, e.g. 1GiB; a small limit reduces the threads [default: half of the available memory, at most 4 GiB]
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    pub memory: Option<u64>,
    /// Replace an existing chart
    #[arg(long)]
    pub overwrite: bool,
}

/// `lenscube chart image`
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  lenscube chart image photo.png chart.zarr --film-pitch-um 2\n  \
lenscube chart image render.exr chart.zarr --film-pitch-um 2 --scale-to 300\n\
PNG and TIFF of 8 or 16 bits, JPEG and WebP are decoded as sRGB, OpenEXR as linear or, with channels S0.…nm, band by band. A colour becomes the \
mixture of three smooth reflectances that has this colour under the illuminant; the chart's preview shows the same colours:\n  \
lenscube export chart.zarr back.png --white D65 --exposure 1")]
pub struct ImageArgs {
    /// Picture: PNG, JPEG, WebP, TIFF (also BigTIFF) or OpenEXR, without transparent pixels
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// Zarr store to write
    #[arg(value_name = "OUT.zarr")]
    pub out: PathBuf,
    /// Pixel pitch in µm, stored with the chart
    #[arg(long = "film-pitch-um", alias = "pitch-um", value_name = "UM", value_parser = pitch)]
    pub pitch_um: Option<f64>,
    /// Bands in nm, at most 20 nm apart over 400 to 700, or fewer with --max-colour-error [default: 400:700:10]
    #[arg(long, value_name = "NM")]
    pub wavelengths: Option<String>,
    /// Error that red, green and blue may have where the bands cannot represent them, a share of white: 0.1 or 10%; the nearest colours are taken [default: 0.01%]
    #[arg(long, value_name = "SHARE", value_parser = percent_or_share)]
    pub max_colour_error: Option<f64>,
    /// Illuminant: D65, A or E
    #[arg(long, value_name = "NAME", default_value = "D65")]
    pub illuminant: String,
    /// Luminance of the picture's white in cd/m²; the chart is then spectral radiance in W m-2 sr-1 nm-1 [default: relative values;
    /// the illuminant is 1 at 560 nm]
    #[arg(long, value_name = "CD_PER_M2", value_parser = positive)]
    pub scale_to: Option<f64>,
    /// Decode integer samples as linear instead of sRGB
    #[arg(long)]
    pub linear: bool,
    /// Compression of the store; zstd is smaller and slower
    #[arg(long, value_parser = one_of(CODEC), default_value = "lz4")]
    pub codec: Codec,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = threads)]
    pub threads: Option<usize>,
    /// Maximum memory, e.g. 1GiB; a small limit reduces the threads [default: half of the available memory, at most 4 GiB]
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    pub memory: Option<u64>,
    /// Replace an existing chart
    #[arg(long)]
    pub overwrite: bool,
}

impl ImageArgs {
    /// The picture `file` as the chart `out`, without flags.
    pub fn new(file: impl Into<PathBuf>, out: impl Into<PathBuf>) -> Self {
        Self {
            file: file.into(),
            out: out.into(),
            pitch_um: None,
            wavelengths: None,
            max_colour_error: None,
            illuminant: "D65".into(),
            scale_to: None,
            linear: false,
            codec: Codec::Lz4,
            threads: None,
            memory: None,
            overwrite: false,
        }
    }
}

/// `lenscube chart KIND`
#[derive(Debug, Args)]
pub struct GeneratedArgs {
    /// uniform, points, slanted-edge, iso12233-esfr, dot-grid, black-spots, lamp, siemens, dead-leaves, oecf, checker, composite or depth-scene; or image, for a picture, motion, for a chart that moves
    #[arg(value_name = "KIND")]
    pub kind: String,
    /// Zarr store to write, local or at s3://BUCKET/PREFIX
    #[arg(value_name = "OUT.zarr")]
    pub out: PathBuf,
    /// Size of the FILM in pixels, N or WxH; the chart is larger by the overscan
    #[arg(long = "film-size", alias = "size", value_name = "WxH")]
    pub size: Option<String>,
    /// Bands in nm: 400:700:10 (both ends included) or 450,550
    #[arg(long, value_name = "NM")]
    pub wavelengths: Option<String>,
    /// Pixel pitch in µm
    #[arg(long = "film-pitch-um", alias = "pitch-um", value_name = "UM")]
    pub pitch_um: Option<String>,
    /// Chart pixels beyond the film on each side [default: 1 % of the longer side + 64]
    #[arg(long, value_name = "PX")]
    pub overscan: Option<String>,
    /// Illuminant: D65, A or E
    #[arg(long, value_name = "NAME")]
    pub illuminant: Option<String>,
    /// Relative standard deviation of a fixed noise pattern, 0 to 0.28
    #[arg(long, value_name = "SIGMA")]
    pub noise: Option<String>,
    /// Side in pixels of four marks in the film's corners, by which `lenscube report` finds the chart in a picture; 21 and more, 0 without [default: 0]
    #[arg(long, value_name = "PX")]
    pub fiducials: Option<String>,
    /// uniform: the value of every pixel
    #[arg(long, allow_hyphen_values = true)]
    pub value: Option<String>,
    /// points, dot-grid: spots per row and column
    #[arg(long)]
    pub count: Option<String>,
    /// points: shape of a spot, gaussian or disc
    #[arg(long)]
    pub blob: Option<String>,
    /// points, dot-grid: width of a spot in pixels
    #[arg(long)]
    pub width_px: Option<String>,
    /// slanted-edge, iso12233-esfr: angle from the vertical
    #[arg(long, allow_hyphen_values = true)]
    pub angle_deg: Option<String>,
    /// slanted-edge, iso12233-esfr, dead-leaves: ratio of bright to dark; 4 in ISO 12233
    #[arg(long)]
    pub contrast: Option<String>,
    /// slanted-edge, iso12233-esfr, siemens: edge regions, squares or stars per row and column
    #[arg(long)]
    pub grid: Option<String>,
    /// slanted-edge: positions X,Y;X,Y in film pixels
    #[arg(long, value_name = "X,Y;…", allow_hyphen_values = true)]
    pub centers: Option<String>,
    /// slanted-edge: side of an edge region in pixels
    #[arg(long)]
    pub patch_px: Option<String>,
    /// siemens: pairs of dark and bright spokes
    #[arg(long)]
    pub spokes: Option<String>,
    /// siemens: reflectance over the angle, square or sine (ISO 12233:2014) [default: square]
    #[arg(long)]
    pub profile: Option<String>,
    /// dead-leaves: seed of places, radii and greys [default: 0]
    #[arg(long)]
    pub seed: Option<String>,
    /// dead-leaves: smallest radius in pixels, 1 and more [default: 2]
    #[arg(long, value_name = "PX")]
    pub r_min_px: Option<String>,
    /// dead-leaves: largest radius in pixels [default: 128]
    #[arg(long, value_name = "PX")]
    pub r_max_px: Option<String>,
    /// oecf: number of grey patches, 2 to 64 [default: 20]
    #[arg(long)]
    pub patches: Option<String>,
    /// oecf: range of density of the patches, 0.1 to 5; 3 is a contrast of 1000 [default: 3]
    #[arg(long)]
    pub density: Option<String>,
    /// black-spots: number of black discs, a square: 9 are 3 x 3
    #[arg(long)]
    pub spots: Option<String>,
    /// black-spots: their diameter, a share of the film's height: 5%
    #[arg(long, value_name = "SHARE")]
    pub diameter: Option<String>,
    /// lamp: radius in pixels
    #[arg(long, value_name = "PX")]
    pub radius: Option<String>,
    /// lamp: its column in film pixels [default: the middle of the film]
    #[arg(long, allow_hyphen_values = true)]
    pub x: Option<String>,
    /// lamp: its row in film pixels [default: the middle of the film]
    #[arg(long, allow_hyphen_values = true)]
    pub y: Option<String>,
    /// depth-scene: distance of its disc and nearest floor, m
    #[arg(long, value_name = "M")]
    pub near_m: Option<String>,
    /// depth-scene: distance of its wall, m, or inf
    #[arg(long, value_name = "M")]
    pub far_m: Option<String>,
    /// Compression of the store; zstd is smaller and slower
    #[arg(long, value_parser = one_of(CODEC), default_value = "lz4")]
    pub codec: Codec,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = threads)]
    pub threads: Option<usize>,
    /// Replace an existing chart
    #[arg(long)]
    pub overwrite: bool,
}
