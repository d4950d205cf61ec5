//! `lenscube restore`.

use super::values::{positive, roi, threads};
use clap::{Args, ValueEnum};
use pipeline::geometry::Rect;
use std::path::PathBuf;

/// `lenscube restore`
#[derive(Clone, Debug, PartialEq, Args)]
#[command(after_help = "Examples:\n  lenscube restore film.zarr restored.zarr\n  \
lenscube restore film.zarr restored.zarr --noise 0.002 --bands 550\n  \
lenscube restore film.zarr restored.zarr --method richardson-lucy --iterations 30\n\
OUT is a chart, which `lenscube run`, `export` and `measure` read. `lenscube help restoration` has methods and limits.")]
pub struct RestoreArgs {
    /// Film of `lenscube run` of a flat chart, here or at s3://BUCKET/PREFIX, or raw of `lenscube sensor` of one
    #[arg(value_name = "FILM")]
    pub film: PathBuf,
    /// Chart to write, a Zarr store
    #[arg(value_name = "OUT")]
    pub out: PathBuf,
    /// How to restore
    #[arg(long, value_enum, default_value_t = RestoreMethod::Tikhonov)]
    pub method: RestoreMethod,
    /// Of a raw: the film that it was made of, whose record names the lens
    #[arg(long = "film", value_name = "FILM")]
    pub of_film: Option<PathBuf>,
    /// Of a raw: the frame
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub frame: usize,
    /// RMS noise of a film pixel, in the film's unit [default: estimated from each band; of a raw, its sensor's]
    #[arg(long, value_name = "SIGMA", value_parser = positive)]
    pub noise: Option<f64>,
    /// Iterations of richardson-lucy [default: until the residual is that of the noise, at most 200]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub iterations: Option<u32>,
    /// Lens, where the one that the film records lies elsewhere now: a built-in lens, a pack or a design
    #[arg(long, value_name = "LENS")]
    pub lens: Option<String>,
    /// Bands to restore: wavelengths in nm, 550 or 450:650 (both ends included), or indices, '#0:5' [default: all]
    #[arg(long)]
    pub bands: Option<String>,
    /// Only this rectangle of the restored picture, in film pixels
    #[arg(long, value_name = "X,Y,W,H", value_parser = roi)]
    pub roi: Option<Rect>,
    /// Side of a tile, px
    #[arg(long, value_name = "PX", default_value_t = 512, hide = true, value_parser = clap::value_parser!(u32).range(64..=4096))]
    pub tile: u32,
    /// Print the report as JSON
    #[arg(long)]
    pub json: bool,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = threads)]
    pub threads: Option<usize>,
    /// Replace an existing chart
    #[arg(long)]
    pub overwrite: bool,
}

/// `--method`
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum RestoreMethod {
    /// The smoothest chart that agrees with the film within its noise
    Tikhonov,
    /// The chart of plateaus and edges that agrees with the film within its noise; slower
    TotalVariation,
    /// Non-negative, for films of photons
    RichardsonLucy,
}
