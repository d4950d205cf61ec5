//! `lenscube bench`.

use super::device::{Device, EngineArg};
use super::values::{bytes, threads};
use clap::Args;
use std::path::PathBuf;

/// `lenscube bench`
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  lenscube bench\n  lenscube bench --dir /scratch --bands 4 --json > bench.json\n  \
lenscube bench --compare laptop.json server.json\n\
Takes about three minutes and 7 GB of temporary disk space. Run it on an otherwise idle machine."
)]
pub struct BenchArgs {
    /// Film side of the job in pixels; the film is always 28.282 mm wide, as in the paper
    #[arg(long, alias = "size", value_name = "PX", default_value_t = 14141, value_parser = clap::value_parser!(u32).range(512..=100_000))]
    pub film_size: u32,
    /// Bands of the job, spread over 400-700 nm
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=31))]
    pub bands: u32,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = threads)]
    pub threads: Option<usize>,
    /// Lens pack (directory or .zip), design file or name of a built-in lens
    #[arg(long, value_name = "NAME|PACK|DESIGN", default_value = "double-gauss-28")]
    pub lens: String,
    /// Directory for the job's chart and film, which are removed at the end
    #[arg(long, default_value = ".")]
    pub dir: PathBuf,
    /// Maximum memory of the job
    #[arg(long, value_name = "BYTES", value_parser = bytes, default_value = "1GiB")]
    pub memory: u64,
    /// Rounds per figure; the median is reported
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=99))]
    pub rounds: u32,
    /// Device: cpu; or cuda (all GPUs), cuda:0,2, auto (as cuda): kernels and copies are measured on the first GPU, the job on all of them
    #[arg(long, value_name = "DEVICE", default_value_t = Device::Cpu)]
    pub device: Device,
    /// Implementation of the arithmetic: avx512, avx2 or portable (CPU), cuda-sm_90 (GPUs of that compute capability)
    /// [default: the fastest]
    #[arg(long, value_name = "ENGINE", default_value_t = EngineArg::Auto, hide_default_value = true)]
    pub engine: EngineArg,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    /// Measure nothing: print two reports of --json side by side, and forecast A's job on the machine of B
    #[arg(long, value_names = ["A.json", "B.json"], num_args = 2, conflicts_with_all = ["film_size", "bands", "threads", "lens", "memory", "rounds", "device", "engine", "json"])]
    pub compare: Option<Vec<PathBuf>>,
}
