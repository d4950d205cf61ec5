//! `lenscube depth`.

use super::choices::{OUTSIDE, STYLE, one_of};
use super::depth::DepthArgs;
use super::placement::PlacementArgs;
use super::tracing::TracingArgs;
use super::values::{bytes, figure, threads};
use clap::Args;
use formats::picture::style::Style;
use pipeline::field::Outside;
use std::path::PathBuf;

/// `lenscube depth`
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  lenscube depth scene.exr//Z --lens phone --focus-m 2 --film-pitch-um 1 --plot depth.png\n  \
lenscube depth scene.zarr --lens MY.zmx --focus-m 2 --json\n  \
lenscube depth chart.npy --depth depth.raw --depth-dtype f16 --lens phone.lens.zarr --film-pitch-um 1\n\
The distances are read once, in strips of rows; no PSF of a design is traced: its windows and the number of its kernels are estimated from rays, \
depth nodes are placed as by a run, for the film's border and its axis at the primary wavelength. Exit code 4: `lenscube run` would not take these distances."
)]
pub struct DepthReportArgs {
    /// Distances as for `lenscube run --depth`, an array or one that lies in a chart's group; gen:depth-scene; or any chart, with --depth
    #[arg(value_name = "DEPTH")]
    pub scene: String,
    /// Lens pack, design, or name of a built-in lens, as for `lenscube run`
    #[arg(long, value_name = "NAME|PACK|DESIGN", help_heading = "Lens")]
    pub lens: String,
    /// Film, and place of the chart.
    #[command(flatten)]
    pub placement: PlacementArgs,
    /// Film or distances beyond the lens's tables: an error of a run, or clamp to the last values
    #[arg(long, value_parser = one_of(OUTSIDE), default_value = "error", help_heading = "Lens")]
    pub outside: Outside,
    /// Worker threads of the run [default: all cores]
    #[arg(long, value_parser = threads, help_heading = "Machine")]
    pub threads: Option<usize>,
    /// Maximum memory of the run, e.g. 1GiB [default: as for `lenscube run`]
    #[arg(long, value_name = "BYTES", value_parser = bytes, help_heading = "Machine")]
    pub memory: Option<u64>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    /// Draw depth, blur radius, and slabs of each tile into this file: .png or .svg
    #[arg(long, value_name = "FILE", value_parser = figure())]
    pub plot: Option<PathBuf>,
    /// Replace an existing figure
    #[arg(long, requires = "plot")]
    pub overwrite: bool,
    /// Colours of the figure
    #[arg(long, value_parser = one_of(STYLE), default_value = "light")]
    pub style: Style,
    /// Surfaces at several distances.
    #[command(flatten)]
    pub surfaces: DepthArgs,
    /// How a run traces a design.
    #[command(flatten)]
    pub tracing: TracingArgs,
}
