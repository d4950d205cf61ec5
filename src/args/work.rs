//! Work beyond one machine: `lenscube plan`, and what `lenscube run` takes besides the job's own flags.

use super::RunArgs;
use super::values::shard_rows;
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
lenscube run chart.zarr corner.zarr --roi 13100,13100,1024,1024 --bands 0:5\n  \
lenscube run --plan job.json --unit env:SLURM_ARRAY_TASK_ID --progress jsonl\n\
The same command again resumes an interrupted run.\n\
CHART, FILM and a lens pack may be s3://BUCKET/PREFIX, with AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_REGION and, for \
other stores than AWS, AWS_ENDPOINT_URL (AWS_ALLOW_HTTP=true if it is http); CHART and the pack also http(s)://…, to read. There \
are no locks at a URL: two runs of one film do the same work twice, and no harm."
)]
pub struct RunCommand {
    /// The job.
    #[command(flatten)]
    pub job: RunArgs,
    /// Which part of it, and for whom.
    #[command(flatten)]
    pub work: WorkArgs,
}

/// With a plan, chart and film are where it says, unless they are mounted elsewhere.
fn from_plan(arg: clap::Arg) -> clap::Arg {
    arg.required(false).required_unless_present("plan").default_value_if("plan", ArgPredicate::IsPresent, "-")
}

/// What a worker takes besides a job.
#[derive(Debug, Args, Clone)]
#[command(next_help_heading = "Work beyond one machine")]
pub struct WorkArgs {
    /// Do units of this plan (`lenscube plan`), which holds chart, film, lens and all flags; those given here come on top.
    /// CHART and FILM may be given where they are mounted elsewhere. Any number of workers, hosts and repeats: same bytes
    #[arg(long, value_name = "job.json")]
    pub plan: Option<PathBuf>,
    /// Units to do, ends included: 7, or 3-9,12, or env:NAME to take them from a variable such as SLURM_ARRAY_TASK_ID or
    /// JOB_COMPLETION_INDEX [default: all]
    #[arg(long, value_name = "UNITS", requires = "plan")]
    pub unit: Option<String>,
    /// auto: a bar on a terminal, lines elsewhere, on stderr; jsonl: objects on stdout, one a line, for programs
    #[arg(long, value_enum, default_value_t = ProgressArg::Auto)]
    pub progress: ProgressArg,
    /// Die (SIGKILL) when the thread that started this program ends; the film survives that. Linux only
    #[arg(long)]
    pub die_with_parent: bool,
}

/// How progress is told.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs, reason = "they are what they say")]
pub enum ProgressArg {
    Auto,
    Jsonl,
}

/// `lenscube plan`
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  lenscube plan chart.zarr film.zarr -o job.json\n  \
sbatch --array=0-30 --wrap 'lenscube run --plan job.json --unit env:SLURM_ARRAY_TASK_ID'\n  \
lenscube run --plan job.json --unit $(lenscube status --plan job.json --missing)\n\
The plan does not change once written: units may be done in any order, on any host, more than once. A design (.zmx, or a \
built-in lens) is traced here for all bands, into XDG_CACHE_HOME or ~/.cache; workers that share that directory find its \
bands there, others trace the bands of their own units again, about a second each; --lens-pack makes them independent of it.")]
pub struct PlanArgs {
    /// The job.
    #[command(flatten)]
    pub job: RunArgs,
    /// The plan to write; in a directory it is called plan-DIGEST.json
    #[arg(short, long, value_name = "job.json", default_value = ".")]
    pub output: PathBuf,
    /// Rows of shards in a unit [default: whole bands, cut where that makes too few units and computes little twice]
    #[arg(long, value_name = "N", value_parser = shard_rows)]
    pub unit_rows: Option<usize>,
    /// Trace a design into this lens pack (directory or .zip) and plan with it: workers then need no cache
    #[arg(long, value_name = "OUT.lens.zarr")]
    pub lens_pack: Option<PathBuf>,
}
