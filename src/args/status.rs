//! `lenscube status` and `lenscube verify`: looking at a film.

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
    /// The film, PATH or URL [default: that of the plan]
    #[arg(value_name = "FILM", required_unless_present = "plan")]
    pub film: Option<PathBuf>,
    /// Of this plan's film, and of its units
    #[arg(long, value_name = "job.json")]
    pub plan: Option<PathBuf>,
    /// Only the units to do, as a list for `run --unit` or `sbatch --array=`; nothing when all are done
    #[arg(long, requires = "plan", conflicts_with = "json")]
    pub missing: bool,
    /// Exit with 4 if shards are missing
    #[arg(long)]
    pub check: bool,
    /// For programs
    #[arg(long)]
    pub json: bool,
}

/// `lenscube verify`
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  lenscube verify film.zarr\n  \
lenscube verify film.zarr --repair; lenscube run chart.zarr film.zarr     # makes bad shards again\n\
Exit codes: 0 all is well, 4 something is wrong or missing")]
pub struct VerifyArgs {
    /// The film: PATH or URL
    #[arg(value_name = "FILM")]
    pub film: PathBuf,
    /// Remove bad shards and all temp files, so that the same `run` makes the shards again
    #[arg(long)]
    pub repair: bool,
    /// With --repair: although a run of another host has locked the film
    #[arg(long, requires = "repair")]
    pub take_over: bool,
    /// For programs
    #[arg(long)]
    pub json: bool,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = threads)]
    pub threads: Option<usize>,
}
