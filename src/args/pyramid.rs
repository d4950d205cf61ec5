//! `lenscube pyramid` and `lenscube view`: films looked at from afar.

use super::values::{bytes, threads};
use clap::Args;
use std::path::PathBuf;

/// `lenscube pyramid`
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  lenscube pyramid film.zarr && lenscube view film.zarr\n\
Levels follow OME-Zarr 0.5 and lie in the film's own group; the film itself stays as it is. The same command again resumes.\n\
Exit codes: 0 complete, 4 the film is not")]
pub struct PyramidArgs {
    /// The film, which must be complete
    #[arg(value_name = "FILM")]
    pub film: PathBuf,
    /// Although a run of another host has locked the film
    #[arg(long)]
    pub take_over: bool,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = threads)]
    pub threads: Option<usize>,
    /// Memory to stay within, e.g. 1GiB [default: half of what is available, at most 4 GiB]
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    pub memory: Option<u64>,
}

/// `lenscube view`
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  lenscube view film.zarr --open\n  lenscube view film.zarr --chart chart.zarr\n  \
lenscube view film.zarr//roi_1 --port 8123\n\
The page is served to this machine alone, until Ctrl-C. `lenscube pyramid FILM` makes far views of a large film quick."
)]
pub struct ViewArgs {
    /// A film or chart: PATH, PATH//array or gen:KIND?…
    #[arg(value_name = "FILM")]
    pub film: String,
    /// What the film was made of, to be swiped against it [default: the drawn chart that the film tells of]
    #[arg(long, value_name = "CHART")]
    pub chart: Option<String>,
    /// The lens: a pack, a .zmx or a built-in [default: the built-in lens that the film tells of]
    #[arg(long, value_name = "LENS")]
    pub lens: Option<String>,
    /// Port on 127.0.0.1; 0 is any that is free
    #[arg(long, default_value_t = 0)]
    pub port: u16,
    /// Open the page in the browser
    #[arg(long)]
    pub open: bool,
    /// Wavelengths where the store has none
    #[arg(long, value_name = "NM")]
    pub wavelengths: Option<String>,
    /// Threads that read and render [default: all cores, at most 4]
    #[arg(long, value_parser = threads)]
    pub threads: Option<usize>,
}
