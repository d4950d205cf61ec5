//! `lenscube chart`.

use super::CodecArg;
use super::values::threads;
use clap::Args;
use std::path::PathBuf;

/// `lenscube chart`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:  lenscube chart slanted-edge edges.zarr --size 14141 --grid 5 --angle-deg 5\n\
Without a store:  lenscube run 'gen:composite?size=14141' film.zarr"
)]
pub struct ChartArgs {
    /// uniform, points, slanted-edge, iso12233-esfr, dot-grid, siemens, checker or composite
    #[arg(value_name = "KIND")]
    pub kind: String,
    /// The store to write, here or at s3://BUCKET/PREFIX
    #[arg(value_name = "OUT.zarr")]
    pub out: PathBuf,
    /// FILM size in pixels: N or HxW; the chart is larger by the overscan
    #[arg(long, value_name = "HxW")]
    pub size: Option<String>,
    /// Bands in nm: 400:700:10 (both ends) or 450,550
    #[arg(long, value_name = "NM")]
    pub wavelengths: Option<String>,
    /// Pixel pitch in µm
    #[arg(long, value_name = "UM")]
    pub pitch_um: Option<String>,
    /// Chart pixels beyond the film on every side [default: 1 % of the longer side + 64]
    #[arg(long, value_name = "PX")]
    pub overscan: Option<String>,
    /// Light on the chart: D65, A or E
    #[arg(long, value_name = "NAME")]
    pub illuminant: Option<String>,
    /// Relative standard deviation of a fixed pattern of noise, 0 to 0.28
    #[arg(long, value_name = "SIGMA")]
    pub noise: Option<String>,
    /// uniform: the value of every pixel
    #[arg(long, allow_hyphen_values = true)]
    pub value: Option<String>,
    /// points, dot-grid: blobs or dots per row and column
    #[arg(long)]
    pub count: Option<String>,
    /// points: gaussian or disc
    #[arg(long)]
    pub blob: Option<String>,
    /// points, dot-grid: width of a blob or dot in pixels
    #[arg(long)]
    pub width_px: Option<String>,
    /// slanted-edge, iso12233-esfr: angle from the vertical
    #[arg(long, allow_hyphen_values = true)]
    pub angle_deg: Option<String>,
    /// slanted-edge, iso12233-esfr: light over dark; ISO 12233 asks for 4
    #[arg(long)]
    pub contrast: Option<String>,
    /// slanted-edge, iso12233-esfr, siemens: places per row and column
    #[arg(long)]
    pub grid: Option<String>,
    /// slanted-edge: places X,Y;X,Y in film pixels
    #[arg(long, value_name = "X,Y;…", allow_hyphen_values = true)]
    pub centers: Option<String>,
    /// slanted-edge: side of a patch in pixels
    #[arg(long)]
    pub patch_px: Option<String>,
    /// siemens: pairs of dark and bright spokes
    #[arg(long)]
    pub spokes: Option<String>,
    /// Compression of the store
    #[arg(long, value_enum, default_value_t = CodecArg::Zstd)]
    pub codec: CodecArg,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = threads)]
    pub threads: Option<usize>,
    /// Replace an existing chart
    #[arg(long)]
    pub overwrite: bool,
}
