//! Memory planned before the first pixel: what a run needs whatever happens, and what is left for its two caches.
//!
//! Fixed: buffers of the workers, shards being added to, shards being encoded and written, PSFs of the present and the
//! next band; where GPUs compute, instead of the workers' buffers, page-locked memory for what goes up and comes down. The rest goes to the chart's decoded chunks (as much as two rows of tiles touch) and to node spectra.
//! Nothing here changes a pixel.

use crate::failure::usage;
use anyhow::Result;
use pipeline::band::BandPlan;
use pipeline::cuda::memory::BandNeeds;
use pipeline::executor::{AHEAD, QUEUE};
use pipeline::plan::Window;

/// The program itself, its threads' stacks, the allocator's slack.
const BASE: usize = 48 << 20;
/// What the driver keeps of the host's memory for a GPU.
const DRIVER: usize = 160 << 20;
/// Share of the limit kept for what the allocator holds back between sizes.
const SLACK: f64 = 0.08;

/// How a run's memory is spent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Memory {
    /// All of it, bytes.
    pub limit: usize,
    /// What is needed whatever the caches.
    pub fixed: usize,
    /// Decoded chart chunks.
    pub chart_cache: usize,
    /// Node spectra.
    pub spectra: usize,
    /// Page-locked memory of each queue of a GPU.
    pub pinned: usize,
}

/// What queues of GPUs want of the host's memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OnDevices {
    /// How many.
    queues: usize,
    /// Page-locked bytes without which one cannot work.
    least: usize,
    /// What one can make use of.
    useful: usize,
}

impl OnDevices {
    /// The processor computes.
    pub const NONE: Self = Self { queues: 0, least: 0, useful: 0 };

    /// For `queues` queues and what each band needs.
    pub fn new(queues: usize, bands: &[BandNeeds]) -> Self {
        let most = |f: fn(&BandNeeds) -> usize| bands.iter().map(f).max().unwrap_or(0);
        let (least, useful) = (most(BandNeeds::least_host_bytes), most(BandNeeds::useful_host_bytes));
        Self { queues, least, useful }
    }
}

/// What the plan depends on.
pub struct Needs<'a> {
    /// Bytes to stay within.
    pub limit: u64,
    /// Bands of the job.
    pub plans: &'a [BandPlan],
    /// Outputs.
    pub windows: &'a [Window],
    /// Worker threads.
    pub threads: usize,
    /// Shards written at once.
    pub writers: usize,
    /// Decoded bytes of chart that tiles of so many rows touch.
    pub chart_rows: &'a dyn Fn(usize) -> usize,
    /// Film pixels per chart pixel, the smaller.
    pub scale: f64,
}

impl Memory {
    /// Plans within the limit; `devices` compute.
    ///
    /// # Errors
    /// What is missing, and the way out.
    pub fn plan(needs: &Needs<'_>, devices: &OnDevices) -> Result<Self> {
        let limit = usize::try_from(needs.limit).unwrap_or(usize::MAX);
        let most = |f: &dyn Fn(&BandPlan) -> usize| needs.plans.iter().map(f).max().unwrap_or(0);
        let worker = most(&|p| {
            let tile = p.tiling.tile();
            let fft = p.blocks.map_or(0, |b| b.fft);
            let light = 4 * (tile + fft) * (tile + fft + 16);
            let engine = 3 * p.blocks.map_or(0, |b| b.spectrum_bytes()) + 8 * tile * tile;
            4 * tile * tile + (AHEAD + 1) * light + 2 * engine + (8 << 20)
        });
        let psf = most(&|p| {
            let samples = p.lens.psf_height_mm.len() * p.lens.psf_size * p.lens.psf_size;
            if p.grid.is_some() { 2 * 3 * 4 * samples } else { 0 }
        });
        let tables: usize = needs.plans.iter().map(|p| 24 * p.lens.ideal_height_mm.len()).sum();
        let reach = most(&|p| p.tiling.tile() + 2 * p.tiling.margin());
        let shard = |w: &Window| 4 * w.shard.pixels();
        let open: usize = needs
            .windows
            .iter()
            .map(|w| {
                let (rows, cols) = w.count();
                rows.min(reach.div_ceil(w.shard.height) + 1) * cols * shard(w)
            })
            .sum();
        let largest = needs.windows.iter().map(shard).max().unwrap_or(0);
        let encode = (2 * needs.threads + QUEUE + needs.writers) * largest;
        let workers = match devices.queues {
            0 => needs.threads * worker,
            // Of the driver for each GPU and of its kernels; the workers only read and encode.
            queues => queues * DRIVER + needs.threads * (8 << 20),
        };
        let fixed = BASE + workers + psf + tables + open + encode;
        let usable = (limit as f64 * (1.0 - SLACK)) as usize;
        let chart_rows = (needs.chart_rows)(((reach + 64) as f64 / needs.scale.min(1.0)) as usize);
        let spectrum = |p: &BandPlan| p.blocks.map_or(0, |b| b.spectrum_bytes());
        let nodes = most(&|p| p.grid.as_ref().map_or(0, |g| g.len() * spectrum(p)));
        // Below this every block would build its spectra anew.
        let least_spectra = match devices.queues {
            0 => nodes.min(needs.threads * 24 * most(&spectrum)),
            _ => 0,
        };
        let least_pinned = devices.queues * devices.least;
        let least_chart = chart_rows.min(needs.threads * (16 << 20));
        let least = fixed + least_spectra + least_chart + least_pinned;
        if least > usable {
            let wanted = (least as f64 / (1.0 - SLACK)) as usize;
            return Err(usage(format!(
                "--memory {} cannot work: {} threads, PSFs and shards of this film need at least {}; give that much, or \
                 fewer --threads, or a smaller --shard",
                mib(limit),
                needs.threads,
                mib(wanted),
            )));
        }
        let pinned = (devices.queues * devices.useful).min((usable - least) / 2 + least_pinned);
        let rest = usable - fixed - pinned;
        let chart_cache = chart_rows.min(rest - least_spectra).max(least_chart);
        let pinned = pinned / devices.queues.max(1);
        Ok(Self { limit, fixed, chart_cache, spectra: rest - chart_cache, pinned })
    }
}

/// Bytes in MiB, for people.
pub fn mib(bytes: usize) -> String {
    format!("{}MiB", bytes.div_ceil(1 << 20))
}

/// Half of the memory available now, at most 4 GiB.
pub fn default_limit() -> u64 {
    let available = std::fs::read_to_string("/proc/meminfo").ok().and_then(|text| {
        let line = text.lines().find(|l| l.starts_with("MemAvailable:"))?;
        line.split_whitespace().nth(1)?.parse::<u64>().ok()
    });
    available.map_or(2 << 30, |kib| kib * 512).min(4 << 30)
}

/// Peak resident memory of this process so far, bytes, where the system tells.
pub fn peak_resident() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find(|l| l.starts_with("VmHWM:"))?;
    Some(line.split_whitespace().nth(1)?.parse::<u64>().ok()? << 10)
}
