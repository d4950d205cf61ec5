//! Memory planned before the first pixel: what a run needs whatever happens, and what is left for its two caches.
//!
//! Fixed: buffers of the workers, among them the chart area that a tile is made from, which follows from the lens's height tables
//! and the scale; chunks of the chart being decoded; shards being added to, encoded and written; PSFs of the present and the next
//! band, read and resampled; the tables. Where GPUs compute, instead of the workers' buffers, page-locked memory for what goes up
//! and comes down. The rest goes to the chart's decoded chunks (as much as two rows of tiles touch) and to node spectra.
//! Nothing here changes a pixel.

use crate::failure::usage;
use anyhow::Result;
use pipeline::band::{BandPlan, Options};
use pipeline::cuda::memory::BandNeeds;
use pipeline::executor::{AHEAD, QUEUE};
use pipeline::geometry::Frame;
use pipeline::plan::Window;
use pipeline::remap::Remap;

/// The program itself, its threads' stacks, the allocator's slack.
const BASE: usize = 48 << 20;
/// What the driver keeps of the host's memory for a GPU.
const DRIVER: usize = 160 << 20;
/// Of each worker, for what else it holds: the chart area of a usual tile, a usual chunk on its way, kernels of a usual window.
const WORKER: usize = 8 << 20;
/// Of that, for the chart area.
const USUAL_AREA: usize = 2 << 20;
/// Of that, for a chunk on its way.
const USUAL_CHUNK: usize = 3 << 20;
/// Of that, for a kernel in the making.
const USUAL_KERNEL: usize = 2 << 20;
/// Stretch of the remap, or its inverse, beyond which the user is told.
const USUAL_STRETCH: f64 = 4.0;
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
    /// Threads that may decode chunks of the chart at once while its bands are laid out.
    pub decoders: usize,
}

/// What a chart's chunks take in memory, bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Chunks {
    /// Chunks of a band.
    pub count: usize,
    /// One on its way: encoded and decoded bytes.
    pub loading: usize,
    /// One as f32.
    pub values: usize,
    /// One whose bands are laid out apart, all of it.
    pub splitting: usize,
}

/// What the lens's tables do to the chart, of the band that they do most in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RemapNeeds {
    /// The most chart pixels that a worker holds at a time.
    pub chart_px: u64,
    /// Ideal over REAL lengths, the least and the greatest.
    pub stretch: (f64, f64),
    /// Ideal over REAL height beside the axis.
    pub near_axis: f64,
    /// Wavelength of the band with the greatest stretch.
    pub wavelength_nm: f64,
}

impl RemapNeeds {
    /// Of the bands `plans` on the film of `frame`.
    pub fn new(frame: &Frame, plans: &[BandPlan], options: &Options) -> Self {
        let none = Self { chart_px: 0, stretch: (1.0, 1.0), near_axis: 1.0, wavelength_nm: 0.0 };
        plans.iter().fold(none, |all, plan| {
            let remap = Remap::new(frame, &plan.lens, options.stages, options.reading, 1.0, options.simd);
            let own = remap.stretch(&plan.tiling);
            let (ideal, real) = (&plan.lens.ideal_height_mm, &plan.lens.image_height_mm);
            let chart_px = all.chart_px.max(remap.most_chart_px(&plan.tiling));
            let stretch = (all.stretch.0.min(own.least), all.stretch.1.max(own.greatest));
            match stretch == all.stretch {
                true => Self { chart_px, ..all },
                false => {
                    let wavelength_nm = plan.lens.wavelength_nm;
                    Self { chart_px, stretch, near_axis: ideal[1] / real[1], wavelength_nm }
                }
            }
        })
    }

    /// What the user should know of a remap that no camera lens has.
    pub fn note(&self) -> Option<String> {
        let (least, greatest) = self.stretch;
        let usual = greatest <= USUAL_STRETCH && least >= 1.0 / USUAL_STRETCH;
        (!usual).then(|| {
            format!(
                "warning: at {} nm the lens's ideal heights change by {least:.3e} to {greatest:.3e} times its REAL heights \
                 (chart pixels per film pixel at --scale 1); {}",
                self.wavelength_nm,
                self.cause()
            )
        })
    }

    /// The likely cause.
    fn cause(&self) -> String {
        let near = |factor: f64| (self.near_axis / factor).ln().abs() < 0.4;
        let slip = |ideal: &str, real: &str| {
            format!("ideal_height is probably in {ideal} or image_height in {real}, expected mm for both")
        };
        match self.near_axis {
            _ if near(1e3) => slip("µm", "m"),
            _ if near(1e-3) => slip("m", "µm"),
            _ if near(10.0) => slip("tenths of a mm", "cm"),
            _ if near(0.1) => slip("cm", "tenths of a mm"),
            _ => {
                "check ideal_height and image_height of the lens, expected mm for both (`lenscube lens show`)"
                    .into()
            }
        }
    }
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
    /// Bytes of chart of the largest tile.
    area: usize,
}

impl OnDevices {
    /// The processor computes.
    pub const NONE: Self = Self { queues: 0, least: 0, useful: 0, area: 0 };

    /// For `queues` queues and what each band needs.
    pub fn new(queues: usize, bands: &[BandNeeds]) -> Self {
        let most = |f: fn(&BandNeeds) -> usize| bands.iter().map(f).max().unwrap_or(0);
        let (least, useful) = (most(BandNeeds::least_host_bytes), most(BandNeeds::useful_host_bytes));
        Self { queues, least, useful, area: 4 * most(|b| b.chart_px) }
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
    /// Chunks of the chart.
    pub chunks: Chunks,
    /// What the lens's tables do to the chart.
    pub remap: RemapNeeds,
    /// Size of the chart in pixels.
    pub chart_px: usize,
    /// Bytes of a pack's PSFs while they are read, beside the samples, by band of the job.
    pub psf_reading: &'a dyn Fn(&BandPlan) -> usize,
    /// Bytes that reading any one band of the lens takes.
    pub lens_reading: usize,
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
            let (n, size) = (p.lens.psf_size, p.blocks.map_or(0, |b| b.window));
            let kernel = 8 * n * n + 12 * n * size + 12 * size * size;
            let kernel = if p.grid.is_some() { kernel.saturating_sub(USUAL_KERNEL) } else { 0 };
            4 * tile * tile + (AHEAD + 1) * light + 2 * engine + kernel + WORKER
        });
        let psf = most(&|p| {
            let (heights, n) = (p.lens.psf_height_mm.len(), p.lens.psf_size);
            let (samples, size) = (heights * n * n, p.blocks.map_or(0, |b| b.window));
            // Samples while read (both neighbours and their mean between two wavelengths), spline, kernels at film pitch.
            let stacks = if p.choice.second.is_some() { 3 } else { 1 };
            let kept = samples + heights * size * size;
            let reading = (needs.psf_reading)(p);
            let of_bands = 2 * 4 * (2 * samples + kept) + 4 * (stacks - 1) * samples;
            if p.grid.is_some() { of_bands + reading } else { 0 }
        });
        let psf = psf.max(needs.lens_reading);
        let field_points = |p: &BandPlan| p.lens.ideal_height_mm.len();
        // Each band's own, and of two bands what the remap makes of them.
        let tables =
            needs.plans.iter().map(|p| 24 * field_points(p)).sum::<usize>() + 2 * 160 * most(&field_points);
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
        // The area itself, and the part of it inside the chart where it is larger than that.
        let area = match devices.queues {
            0 => {
                let (all, inside) = (needs.remap.chart_px, needs.remap.chart_px.min(needs.chart_px as u64));
                all.saturating_add(inside).saturating_mul(4) as usize
            }
            _ => devices.area,
        };
        let area = area.saturating_sub(USUAL_AREA).saturating_mul(needs.threads);
        let workers = match devices.queues {
            0 => needs.threads * worker,
            // Of the driver for each GPU and of its kernels; the workers only read and encode.
            queues => queues * DRIVER + needs.threads * WORKER,
        };
        let Chunks { count, loading, values, splitting } = needs.chunks;
        let at_once = needs.threads.min(count);
        let loading = at_once.saturating_mul(loading.saturating_sub(USUAL_CHUNK));
        let fixed = BASE + workers + psf + tables + open + encode;
        let fixed = fixed.saturating_add(area).saturating_add(loading);
        let usable = (limit as f64 * (1.0 - SLACK)) as usize;
        let rows = (reach + 64) as f64 * needs.remap.stretch.1.max(1.0) / needs.scale.min(1.0);
        let chart_rows = (needs.chart_rows)(rows as usize);
        let spectrum = |p: &BandPlan| p.blocks.map_or(0, |b| b.spectrum_bytes());
        let nodes = most(&|p| p.grid.as_ref().map_or(0, |g| g.len() * spectrum(p)));
        // Below this every block would build its spectra anew.
        let least_spectra = match devices.queues {
            0 => nodes.min(needs.threads * 24 * most(&spectrum)),
            _ => 0,
        };
        let least_pinned = devices.queues * devices.least;
        // A chunk stays as long as a worker reads from it.
        let chunks = at_once.saturating_mul(values);
        let least_chart = chart_rows.min(needs.threads * (16 << 20)).max(chunks);
        let least = fixed.saturating_add(least_spectra + least_pinned).saturating_add(least_chart);
        let in_limit = |bytes: usize| (bytes as f64 / (1.0 - SLACK)) as usize;
        if least > usable {
            let of_chart = loading.saturating_add(chunks);
            let why = match least.saturating_sub(usable) {
                short if area >= short && area >= of_chart => format!(
                    "a tile is made from {} of chart on each of {} threads, since at {} nm the lens's ideal heights change by up \
                     to {:.3e} times its REAL heights (--scale {}): {}; or fewer --threads",
                    mib(area / needs.threads.max(1)),
                    needs.threads,
                    needs.remap.wavelength_nm,
                    needs.remap.stretch.1,
                    needs.scale,
                    needs.remap.cause(),
                ),
                short if of_chart >= short => format!(
                    "{at_once} chunks of the chart at once, {} each when decoded, need {}; give that much, or fewer --threads, or \
                     re-chunk the chart, e.g. into (1, 512, 512)",
                    mib(values),
                    mib(in_limit(least)),
                ),
                _ => format!(
                    "{} threads, PSFs and shards of this film need at least {}; give that much, or fewer --threads, or a smaller \
                     --shard",
                    needs.threads,
                    mib(in_limit(least)),
                ),
            };
            return Err(usage(format!("--memory {} cannot work: {why}", mib(limit))));
        }
        // While bands are laid out nothing else is held.
        let decoders = usable.saturating_sub(BASE) / splitting.max(1);
        if decoders == 0 {
            return Err(usage(format!(
                "--memory {} cannot work: laying the chart's bands out takes {} for a chunk; give that much, or re-chunk the \
                 chart, e.g. into (1, 512, 512)",
                mib(limit),
                mib(in_limit(BASE.saturating_add(splitting))),
            )));
        }
        let pinned = (devices.queues * devices.useful).min((usable - least) / 2 + least_pinned);
        let rest = usable - fixed - pinned;
        let chart_cache = chart_rows.min(rest - least_spectra).max(least_chart);
        let pinned = pinned / devices.queues.max(1);
        let decoders = decoders.min(needs.threads);
        Ok(Self { limit, fixed, chart_cache, spectra: rest - chart_cache, pinned, decoders })
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
