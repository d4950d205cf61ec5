//! `lenscube compare`.

use super::measure::four;
use super::values::{roi, threads};
use clap::Args;
use pipeline::geometry::Rect;
use std::path::PathBuf;

/// `lenscube compare`
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  lenscube compare lens-a.raw.zarr lens-b.raw.zarr --out compared\n  \
lenscube compare f2.raw.zarr f4.raw.zarr --out compared --edge 1020,900,1034,1060 --patch 300,300,40,40\n  \
lenscube compare film-a.zarr film-b.zarr --out compared --edge 1020,900,1034,1060\n\
Raws of one --seed and --die have the same noise: their difference is that of lens, aperture or film alone. The directory gets report.html,\n\
difference.png, figures and tables (CSV, JSON). Films are compared band by band, in their unit. Positions are pixels of the raw or film, of films of other pixels the common ones.")]
pub struct CompareArgs {
    /// First raw or film, PATH or PATH//roi_0
    #[arg(value_name = "A")]
    pub first: String,
    /// Second one: a raw of the same pixels and filters, or of another sensor (each by itself, in the same places), or a film; of films of other pixels both are compared at the coarser ones
    #[arg(value_name = "B")]
    pub second: String,
    /// Directory for the report
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Frame of both raws, from 0; films have none
    #[arg(long, default_value_t = 0)]
    pub frame: usize,
    /// Regions along each side
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=64))]
    pub grid: u32,
    /// MTF of the edge near this line (e-SFR, ISO 12233), of each plane and of luminance, of films in each band; repeatable
    #[arg(long, value_name = "X0,Y0,X1,Y1", value_parser = four, allow_hyphen_values = true)]
    pub edge: Vec<[f64; 4]>,
    /// Half width of the region around an edge, px
    #[arg(long, value_name = "PX", default_value_t = 24, value_parser = clap::value_parser!(u32).range(4..=1000))]
    pub half_px: u32,
    /// Colour difference (ΔE2000) of this patch of raws; repeatable. 24 patches are those of a ColorChecker, row by row
    #[arg(long, value_name = "X,Y,W,H", value_parser = roi)]
    pub patch: Vec<Rect>,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = threads)]
    pub threads: Option<usize>,
    /// Replace the files of an earlier comparison
    #[arg(long)]
    pub overwrite: bool,
}
