//! `lenscube pyramid` and `lenscube view`.

use super::values::{bytes, threads};
use clap::Args;
use formats::chart::AxisOrder;
use std::path::PathBuf;

/// `lenscube pyramid`
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  lenscube pyramid film.zarr && lenscube view film.zarr\n\
Levels follow OME-Zarr 0.5 and are stored in the film's group; the film itself is unchanged. The same command again resumes.\n\
A level of a raw is a mosaic of the same pattern: means over pixels of one filter, in digital numbers.\n\
Exit codes: 0 complete, 4 the film or raw is incomplete")]
pub struct PyramidArgs {
    /// Film or raw; it must be complete
    #[arg(value_name = "FILM")]
    pub film: PathBuf,
    /// Take over a stale lock held by another host
    #[arg(long)]
    pub take_over: bool,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = threads)]
    pub threads: Option<usize>,
    /// Maximum memory, e.g. 1GiB [default: half of the available memory, at most 4 GiB]
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    pub memory: Option<u64>,
}

/// `lenscube view`
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  lenscube view film.zarr --open\n  lenscube view film.zarr --chart chart.zarr\n  \
lenscube view film.zarr//roi_1 --port 8123\n  lenscube view raw.zarr\n\
A raw is shown developed or as its mosaic, a pixel in electrons and digital numbers.\n\
The page is served on 127.0.0.1 until Ctrl-C. `lenscube pyramid FILM` speeds up low zoom levels of a large film or raw."
)]
pub struct ViewArgs {
    /// Film, raw or chart: PATH, PATH//array or gen:KIND?…
    #[arg(value_name = "FILM")]
    pub film: String,
    /// Chart of the film, for comparison [default: the generated chart recorded in the film]
    #[arg(long, value_name = "CHART")]
    pub chart: Option<String>,
    /// Axes of the array of --chart, or of a chart as FILM, slowest first, as for `lenscube run`
    #[arg(long, value_name = "AXES")]
    pub axes: Option<AxisOrder>,
    /// Lens: pack, design file or built-in lens [default: the built-in lens recorded in the film]
    #[arg(long, value_name = "LENS")]
    pub lens: Option<String>,
    /// Port on 127.0.0.1; 0: any free port
    #[arg(long, default_value_t = 0)]
    pub port: u16,
    /// Open the page in the browser
    #[arg(long)]
    pub open: bool,
    /// Wavelengths in nm, in place of those of the store, if it has some
    #[arg(long, value_name = "NM")]
    pub wavelengths: Option<String>,
    /// Threads for reading and rendering [default: all cores, at most 4]
    #[arg(long, value_parser = threads)]
    pub threads: Option<usize>,
}
