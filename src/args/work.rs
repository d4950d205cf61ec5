//! `lenscube plan`, and the arguments of `lenscube run` beside those of the job.

use super::run::RunArgs;
use super::scene::MeshArgs;
use super::values::{shard_rows, units};
use clap::builder::ArgPredicate;
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// `lenscube run`
#[derive(Debug, Args, Clone)]
#[command(
    mut_arg("chart", from_plan),
    mut_arg("film", from_plan),
    mut_arg("overwrite", |a| a.conflicts_with("plan")),
    after_help = "Examples:\n  lenscube run chart.zarr film.zarr --lens double-gauss-28\n  \
lenscube run 'gen:composite?size=14141' film.zarr --memory 1GiB\n  \
lenscube run chart.zarr corner.zarr --roi 13100,13100,1024,1024 --bands 450:650\n  \
lenscube run --plan job.json --unit env:SLURM_ARRAY_TASK_ID --progress jsonl\n\
The same command again resumes an interrupted run.\n\
CHART, FILM and a lens pack may be s3://BUCKET/PREFIX, with AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_REGION and, for \
other stores than AWS, AWS_ENDPOINT_URL (AWS_ALLOW_HTTP=true if it is http); CHART and the pack also http(s)://…, read-only. There \
are no locks at a URL: two runs of one film compute the same shards twice, with the same bytes."
)]
pub struct RunCommand {
    /// The job.
    #[command(flatten)]
    pub job: RunArgs,
    /// Print what would be read and written, bytes, time, memory and free space, and end; a design's bands are traced into the cache
    #[arg(long, conflicts_with = "plan")]
    pub dry_run: bool,
    /// Units of a plan, and the interface to schedulers.
    #[command(flatten)]
    pub work: WorkArgs,
    /// Of a mesh.
    #[command(flatten)]
    pub mesh: MeshArgs,
}

/// Optional with a plan, which contains chart and film.
fn from_plan(arg: clap::Arg) -> clap::Arg {
    arg.required(false).required_unless_present("plan").default_value_if("plan", ArgPredicate::IsPresent, "-")
}

/// Arguments of a worker.
#[derive(Debug, Args, Clone)]
#[command(next_help_heading = "Distributed work")]
pub struct WorkArgs {
    /// Compute units of this plan (`lenscube plan`), which contains chart, film, lens and flags; flags given here replace those of the
    /// plan. Give CHART and FILM only if their paths differ on this machine. Workers, hosts and repetitions do not change the bytes
    #[arg(long, value_name = "job.json")]
    pub plan: Option<PathBuf>,
    /// Units to compute, both ends included: 7, or 3-9,12, or env:NAME for an environment variable such as SLURM_ARRAY_TASK_ID or
    /// JOB_COMPLETION_INDEX; an empty list computes nothing [default: all]
    #[arg(long, value_name = "UNITS", requires = "plan")]
    pub unit: Option<String>,
    /// Progress: auto (on stderr: a bar on a terminal, else plain), bar, plain (a line every ten seconds), jsonl (on stdout: one JSON object
    /// per line) or none
    #[arg(long, value_enum, default_value_t = ProgressArg::Auto)]
    pub progress: ProgressArg,
    /// Kill this process when its parent ends (Linux only); the film can be resumed
    #[arg(long)]
    pub die_with_parent: bool,
}

/// `--progress`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs, reason = "the variants are the values of the flag")]
pub enum ProgressArg {
    Auto,
    Bar,
    Plain,
    Jsonl,
    None,
}

/// `lenscube plan`
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  lenscube plan chart.zarr film.zarr -o job.json\n  \
sbatch --array=0-30 --wrap 'lenscube run --plan job.json --unit env:SLURM_ARRAY_TASK_ID'\n  \
lenscube run --plan job.json --unit $(lenscube status --plan job.json --missing)\n\
A plan is not changed once written: units may be computed in any order, on any host, more than once. A design (a file, or a \
built-in lens) is traced here for all bands, into XDG_CACHE_HOME or ~/.cache; workers without this \
directory trace the bands of their units again, about half a second each. --lens-pack stores the traced bands in a file instead.")]
pub struct PlanArgs {
    /// The job.
    #[command(flatten)]
    pub job: RunArgs,
    /// Plan file to write; in a directory it is named plan-DIGEST.json
    #[arg(short, long, value_name = "job.json", default_value = ".")]
    pub output: PathBuf,
    /// Divide into at least N units, as equal as bands and shard rows allow [default: a unit for each band; of jobs of many core seconds and few
    /// bands more, at least 24]
    #[arg(long, value_name = "N", value_parser = units, conflicts_with = "unit_rows")]
    pub units: Option<usize>,
    /// Shard rows per unit [default: those of complete bands]
    #[arg(long, value_name = "N", value_parser = shard_rows)]
    pub unit_rows: Option<usize>,
    /// Trace a design into this lens pack (directory or .zip) and use it in the plan, so that workers need no trace cache
    #[arg(long, value_name = "OUT.lens.zarr")]
    pub lens_pack: Option<PathBuf>,
}
