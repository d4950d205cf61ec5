//! `lenscube bench`.

use super::values::{bytes, threads};
use super::{Device, EngineArg};
use clap::Args;
use std::path::PathBuf;

/// `lenscube bench`
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  lenscube bench\n  lenscube bench --dir /scratch --bands 4 --json > bench.json\n\
Takes about two minutes and 7 GB of disk, which it gives back; other work on the machine spoils the figures."
)]
pub struct BenchArgs {
    /// Film side of the job in pixels; it always spans the paper's 28.282 mm
    #[arg(long, value_name = "PX", default_value_t = 14141, value_parser = clap::value_parser!(u32).range(512..=100_000))]
    pub size: u32,
    /// Bands of the job, spread over 400-700 nm
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=31))]
    pub bands: u32,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = threads)]
    pub threads: Option<usize>,
    /// A lens pack (directory or .zip), a design (.zmx) or the name of a built-in lens
    #[arg(long, value_name = "NAME|PACK|DESIGN", default_value = "double-gauss-28")]
    pub lens: String,
    /// Where the chart and the film of the job go; they are removed at the end
    #[arg(long, default_value = ".")]
    pub dir: PathBuf,
    /// Memory of the job
    #[arg(long, value_name = "BYTES", value_parser = bytes, default_value = "1GiB")]
    pub memory: u64,
    /// Each figure is the median of so many rounds
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=99))]
    pub rounds: u32,
    /// What computes: cpu; or cuda, cuda:0,2: the first GPU's kernels and copies alone, and the job on all of them
    #[arg(long, value_name = "DEVICE", default_value_t = Device::Cpu)]
    pub device: Device,
    /// Implementation of the arithmetic: avx512, avx2 or portable (processor), cuda-sm_90 (GPUs of that compute capability)
    /// [default: the fastest]
    #[arg(long, value_name = "ENGINE", default_value_t = EngineArg::Auto, hide_default_value = true)]
    pub engine: EngineArg,
    /// As JSON
    #[arg(long)]
    pub json: bool,
}
