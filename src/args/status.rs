//! `lenscube status` and `lenscube verify`.

use super::values::threads;
use clap::Args;
use std::path::PathBuf;

/// `lenscube status`
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  lenscube status film.zarr\n  lenscube status film.zarr --check && echo done\n  \
lenscube status film.zarr --json | jq .missing\n  lenscube status --plan job.json --missing"
)]
pub struct StatusArgs {
    /// Film, raw or scene: PATH or URL [default: the film of the plan]
    #[arg(value_name = "FILM", required_unless_present = "plan")]
    pub film: Option<PathBuf>,
    /// Report the film of this plan, and its units
    #[arg(long, value_name = "job.json")]
    pub plan: Option<PathBuf>,
    /// Print only the units to compute, as a list for `run --unit` or `sbatch --array=`; empty if all are complete
    #[arg(long, requires = "plan", conflicts_with = "json")]
    pub missing: bool,
    /// Exit with 4 if shards are missing
    #[arg(long)]
    pub check: bool,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// `lenscube verify`
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  lenscube verify film.zarr\n  \
lenscube verify film.zarr --repair; lenscube run chart.zarr film.zarr     # computes bad shards again\n\
Exit codes: 0 all is correct, 4 parts are damaged or missing")]
pub struct VerifyArgs {
    /// Film, raw or scene: PATH or URL
    #[arg(value_name = "FILM")]
    pub film: PathBuf,
    /// Write metadata and coordinates again that are wrong; remove bad shards and temporary files: the same `run`, `sensor` or `scene` makes the shards again
    #[arg(long)]
    pub repair: bool,
    /// With --repair: take over a stale lock held by another host
    #[arg(long, requires = "repair")]
    pub take_over: bool,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = threads)]
    pub threads: Option<usize>,
}
