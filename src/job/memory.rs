//! The memory plan of a run, made before the first pixel: fixed demand, and how the rest is divided between the two caches.
//!
//! Fixed: buffers of the workers, contributions not yet added, shards being added to and encoded, kernels and tables of the bands in
//! flight, chunks being decoded. Each stage, queue and reader reports its own part; lens tables, the process and GPU drivers are estimated
//! here, where all parts are added. Where GPUs compute,
//! page-locked memory replaces the buffers of the workers. The rest is for node spectra (those of a shard first), shards that wait for
//! the disk, and decoded chart chunks (up to what a row of shards reads, or two rows of a GPU's tiles). Nothing here changes a pixel.

mod depth;
pub mod least;
mod spectra;

use crate::args::BinArg;
use crate::job::lens::psf_readers;
use crate::job::stretch::RemapStretch;
use crate::job::veil::VEIL;
use crate::machine::MemoryLimit;
use crate::progress::mib;
use anyhow::Result;
use formats::chart::ChunkMemory;
use formats::film::FilmSpec;
use pipeline::band::{BandPlan, Options};
use pipeline::cuda::memory::BandNeeds;
use pipeline::executor::memory::{self as queues, Walk};
use pipeline::geometry::{Frame, Size};
use pipeline::layer::Layer;
use pipeline::psf::spectra::SpectrumCache;
use pipeline::remap::{Remap, memory as remap};
use pipeline::stages::{self, described};
use pipeline::tiling::FilmRegion;
use spectra::{largest_psf, largest_spectrum, psfs_on_demand};

/// The program itself, its threads' stacks, metadata of the stores.
const PROCESS_BYTES: usize = 40 << 20;
/// Host memory that the driver allocates per GPU.
const DRIVER_BYTES: usize = 160 << 20;
/// Of each worker: its allocation arena, small buffers of codecs.
const WORKER_BYTES: usize = 1 << 20;
/// Of each worker beside GPUs: the same, and a shard's codec.
const GPU_WORKER_BYTES: usize = 8 << 20;
/// Share of the limit that is kept for the allocator's fragmentation.
const FRAGMENTATION_SHARE: f64 = 0.08;
/// Bands whose kernels and tables are in memory at a time: of tiles in flight, of the next tiles, and being prepared.
const BANDS_IN_MEMORY: usize = 3;
/// Chart cache per worker below which neighbouring tiles decode the same chunks again.
const MIN_CHART_CACHE: usize = 16 << 20;
/// Memory per byte of decoded chunks in the cache: all threads allocate and free them, and the allocator keeps what it cannot reuse. 199 MiB of
/// them took 70 MiB more.
const CHART_CACHE_OVERHEAD: f64 = 1.4;
/// Cache of a run over the spectra of its largest band: base kernels of bands that are done may have half of it, more would keep their spectra as well.
const OF_A_BAND: usize = 2;
/// Spectra per worker below which every block would compute its spectra again.
const MIN_SPECTRA: usize = 24;
/// PSFs of depth nodes per worker below which every kernel would read its PSF again: two heights of two nodes.
const MIN_PSFS: usize = 4;
/// The same for the sets of PSFs of heights.
const MIN_SETS: usize = 2;

/// How a run's memory is divided, bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Memory {
    /// The limit (`--memory`).
    pub limit: usize,
    /// Expected peak of a run: at most the limit, less where the caches need less.
    pub planned: usize,
    /// Cache of decoded chart chunks.
    pub chart_cache: usize,
    /// Cache of node spectra of all bands.
    pub spectra: usize,
    /// Cache of node spectra of a run, which computes one band after the other: at most [`OF_A_BAND`] times those of the largest band.
    pub spectra_in_turn: usize,
    /// Page-locked memory of each GPU queue.
    pub pinned: usize,
    /// Encoded shards at a time.
    pub encoded_shards: usize,
    /// Threads that decode chunks of the chart while its bands are written to a temporary file.
    pub decoders: usize,
}

/// Page-locked memory for GPU queues, bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GpuDemand {
    queues: usize,
    /// Minimum per queue.
    min_pinned: usize,
    /// Maximum that a queue can use.
    max_pinned: usize,
    /// Chart under the largest tile.
    chart_area: usize,
}

impl GpuDemand {
    /// For `queues` queues that compute `bands`; no queues: the CPU computes.
    pub fn new(queues: usize, bands: &[BandNeeds]) -> Self {
        let needs = bands.iter().copied().fold(BandNeeds::default(), BandNeeds::max);
        let (min_pinned, max_pinned) = (needs.min_host_bytes(), needs.max_host_bytes());
        Self { queues, min_pinned, max_pinned, chart_area: 4 * needs.chart_px }
    }
}

/// What the demand for memory depends on.
pub struct MemoryInputs<'a> {
    /// Limit, bytes.
    pub limit: MemoryLimit,
    /// Film, axis, chart.
    pub frame: &'a Frame,
    /// Accuracy and stages.
    pub options: &'a Options,
    /// Bands of the job.
    pub bands: &'a [BandPlan],
    /// Regions of the film to compute.
    pub regions: &'a [FilmRegion],
    /// Layout of the film.
    pub film: &'a FilmSpec,
    /// Worker threads.
    pub threads: usize,
    /// Shards written concurrently.
    pub writers: usize,
    /// Decoded bytes of chart under tiles of so many chart rows.
    pub chart_rows: &'a dyn Fn(usize) -> usize,
    /// Chunks of the chart.
    pub chunks: ChunkMemory,
    /// Order of the tiles of the first band with each tiling.
    pub walks: &'a [(usize, Walk)],
    /// Stretch of the remap.
    pub stretch: &'a RemapStretch,
    /// Bytes, beside the samples, of reading a band's PSFs.
    pub psf_reading: &'a dyn Fn(&BandPlan) -> usize,
    /// Bytes of reading the PSFs of any band of the lens.
    pub max_psf_reading: usize,
    /// Bytes while a layer of light is computed; of one at a time.
    pub layer_making: usize,
    /// Surfaces at several distances; 0 for a flat chart.
    pub surfaces: usize,
    /// Caches of decoded chunks of their arrays.
    pub surface_caches: usize,
}

/// Demand for memory, bytes.
#[derive(Debug)]
struct Demand {
    /// Everything but the caches and page-locked memory.
    fixed: usize,
    /// Of `fixed`, chart under the tiles of all workers.
    chart_area: usize,
    /// Of `fixed`, chunks being decoded.
    decoding: usize,
    /// Chunks in use by the workers.
    chunks: usize,
    /// Chart cache: minimum, and maximum of use.
    chart_cache: (usize, usize),
    /// Cache of spectra: minimum, and maximum of use.
    spectra: (usize, usize),
    /// Spectra that the tiles of a shard use.
    shard_spectra: usize,
    /// Spectra of the band with the most, times [`OF_A_BAND`].
    band_spectra: usize,
    /// An encoded shard, and how many are useful beyond those of `fixed`.
    encoded: (usize, usize),
}

impl MemoryInputs<'_> {
    /// The bands with tilings of their own, and the order of their tiles.
    fn walks(&self) -> impl Iterator<Item = (&BandPlan, &Walk)> {
        self.walks.iter().map(|(band, walk)| (&self.bands[*band], walk))
    }

    /// The largest `bytes` of any band.
    fn max(&self, bytes: impl Fn(&BandPlan) -> usize) -> usize {
        self.bands.iter().map(bytes).max().unwrap_or(0)
    }

    /// Scratch of the workers, and of it the chart under their tiles.
    fn workers(&self, gpus: &GpuDemand) -> (usize, usize) {
        if gpus.queues > 0 {
            let area = gpus.chart_area.saturating_mul(self.threads);
            return (area.saturating_add(gpus.queues * DRIVER_BYTES + self.threads * GPU_WORKER_BYTES), area);
        }
        let chart: Size = self.frame.chart;
        let remap = |plan: &BandPlan| {
            let Options { stages, interpolation, simd, .. } = *self.options;
            Remap::new(self.frame, &plan.lens, stages, interpolation, 1.0, simd)
        };
        let area = self.max(|p| remap(p).chart_area_bytes(&p.tiling, chart)).saturating_mul(self.threads);
        let scratch = self.max(|p| {
            if let Some(depth) = &p.depth {
                return self.depth_scratch(p, depth);
            }
            let coordinates = remap(p).scratch_bytes(&p.tiling, chart);
            let of_stages =
                described(self.options.stages).map(|stage| (stage.scratch_bytes)(p)).sum::<usize>();
            of_stages.saturating_add(stages::remapped_bytes(p)).saturating_add(coordinates)
        });
        let contributions = self.walks().map(|(plan, walk)| {
            queues::contributions_bytes(walk, stages::contribution_bytes(plan), self.threads)
        });
        let contributions = contributions.max().unwrap_or(0);
        let all = (scratch.saturating_add(WORKER_BYTES)).saturating_mul(self.threads);
        (all.saturating_add(contributions), area)
    }

    /// Film rows that a tile with its tail covers.
    fn reach_px(&self) -> usize {
        let reach = |p: &BandPlan| described(self.options.stages).map(|stage| (stage.reach_px)(p)).max();
        self.max(|p| p.tiling.tile() + 2 * reach(p).unwrap_or(0))
    }

    /// Pixels of the film in all bands.
    fn all_pixels(&self) -> usize {
        self.regions.iter().map(|w| w.rect.size().pixels()).sum::<usize>() * self.bands.len()
    }

    /// Shards being added to, waiting, being encoded, and as many encoded ones as are required.
    fn shards(&self, gpus: &GpuDemand) -> usize {
        let all = self.all_pixels();
        let largest = queues::max_shard_pixels(self.regions);
        let open = match gpus.queues {
            0 => {
                self.walks().map(|(_, walk)| queues::open_shard_pixels(walk, self.threads)).max().unwrap_or(0)
            }
            queues => queues::open_shard_pixels_of_gpus(self.regions, self.threads, queues),
        };
        let pixels = open + self.threads * largest;
        4 * pixels.min(all)
            + self.film.encoded_bytes((queues::MIN_ENCODED_SHARDS * largest).min(all))
            + self.threads * self.film.encode_scratch_bytes()
    }

    /// Bytes of an encoded shard, and how many are useful beyond those required.
    fn encoded(&self) -> (usize, usize) {
        let largest = queues::max_shard_pixels(self.regions);
        let useful = queues::useful_encoded_shards(self.threads, self.writers);
        let useful = useful.min(self.all_pixels().div_ceil(largest.max(1)));
        (self.film.encoded_bytes(largest), useful.saturating_sub(queues::MIN_ENCODED_SHARDS))
    }

    /// Kernels and tables of the bands in flight, base kernels for GPUs, and PSFs being read.
    fn lens(&self, gpus: &GpuDemand) -> usize {
        // A queue is at two bands, and one is prepared.
        let bands_in_memory = BANDS_IN_MEMORY.max(1 + 2 * gpus.queues);
        // One for about four nodes.
        let base_kernels = |p: &BandPlan| {
            let nodes = p.grid.as_ref().map_or(0, |grid| grid.len() / 4 + grid.psf_sets());
            4 * nodes * p.blocks.map_or(0, |blocks| blocks.window.pow(2))
        };
        let of_stages =
            |p: &BandPlan| described(self.options.stages).map(|stage| (stage.table_bytes)(p)).sum::<usize>();
        let reading = |p: &BandPlan| {
            if let Some(depth) = &p.depth {
                // Every worker reads PSFs on demand: samples, and what is kept of them, before they are in the cache.
                return self.threads
                    * (4 * depth.max_samples() + depth.max_psf_bytes() + (self.psf_reading)(p));
            }
            if p.reads_on_demand() {
                // By all threads, one set at a time: samples, and what is kept of them.
                return 2 * p.largest_set_bytes() + self.threads * (self.psf_reading)(p);
            }
            let reading = (self.psf_reading)(p);
            let readers = if p.is_coarse() { psf_readers(self.threads, reading) } else { 1 };
            let read = p.reading_bytes(readers);
            // Interpolated PSFs beside those of two bands.
            let read = match p.lens_bands.second {
                Some(_) if p.is_coarse() => read + 2 * p.kernels_bytes(),
                Some(_) => 3 * read,
                None => read,
            };
            if p.grid.is_some() { read + readers * reading } else { 0 }
        };
        // While the last of some consecutive bands is read.
        let kernels = (1..=self.bands.len()).map(|end| {
            let bands = &self.bands[end.saturating_sub(bands_in_memory)..end];
            bands.iter().map(of_stages).sum::<usize>() + reading(&self.bands[end - 1])
        });
        let kernels = kernels.max().unwrap_or(0);
        let tables = self.bands.iter().map(|p| p.lens.table_bytes()).sum::<usize>();
        kernels.max(self.max_psf_reading)
            + tables
            + bands_in_memory * self.max(|p| remap::table_bytes(&p.lens))
            + gpus.queues * self.max(base_kernels)
    }

    /// Layers of light of the bands in flight, and one being computed.
    fn layers(&self) -> usize {
        let of_layer = |layer: usize| {
            let bands = 0..self.film.wavelengths_nm.len();
            bands.map(|band| Layer::bytes(&self.film.layer_grid(layer, band))).max().unwrap_or(0)
        };
        let stored: usize = (0..self.film.layers.len()).map(of_layer).sum();
        BANDS_IN_MEMORY * stored + self.layer_making
    }

    /// Cache of decoded chunks: minimum, and what a row of shards uses, or two rows of tiles of each GPU queue.
    fn chart_cache(&self, chunks: usize, gpus: &GpuDemand) -> (usize, usize) {
        let shard = self.regions.iter().map(|w| w.shard.height.min(w.rect.height)).max().unwrap_or(0);
        let rows = self.reach_px() + 64 + if gpus.queues == 0 { shard } else { 0 };
        let scale = self.frame.scale.0.min(self.frame.scale.1);
        let rows = rows as f64 * self.stretch.range.1.max(1.0) / scale.min(1.0);
        let useful = (self.chart_rows)(rows as usize).saturating_mul(gpus.queues.max(1));
        // Without chunks (a drawn chart) the cache may be absent.
        let min = if chunks > 0 { useful.min(self.threads * MIN_CHART_CACHE) } else { 0 };
        (with_overhead(min, chunks), with_overhead(useful, chunks))
    }

    /// Cache of spectra: minimum, those that the tiles of the outermost shard use, those of all nodes of a band, and of all bands.
    fn spectra(&self, gpus: &GpuDemand) -> [usize; 4] {
        if gpus.queues > 0 {
            return [0; 4];
        }
        let nodes = |p: &BandPlan| self.spectra_of(p, p.tiling.grown());
        let of_shard = |p: &BandPlan| {
            let shard = self.regions.first().map(|region| region.shard_rect(0, 0));
            shard.map_or(0, |rect| self.spectra_of(p, rect.grown(p.tiling.margin() + p.tiling.tile())))
        };
        let psfs_on_demand = |p: &BandPlan| psfs_on_demand(p, self.frame);
        let min_psfs = |p: &BandPlan| largest_psf(p) * if p.depth.is_some() { MIN_PSFS } else { MIN_SETS };
        let (psfs, min_psfs) = (self.max(psfs_on_demand), self.max(min_psfs));
        let min = self.max(nodes).min(self.threads * MIN_SPECTRA * self.max(largest_spectrum));
        let min = min + (self.threads * min_psfs).min(psfs);
        // Kernels that are kept need no PSFs any more.
        let kept = SpectrumCache::bytes_to_keep(self.max(BandPlan::kept_bytes));
        let all = |p: &BandPlan| nodes(p) + psfs_on_demand(p);
        let of_shard = self.max(of_shard).max(min).max(kept);
        let of_band = self.max(all).saturating_mul(OF_A_BAND);
        [min, of_shard, of_band.max(of_shard), self.bands.iter().map(all).sum()]
    }

    fn demand(&self, gpus: &GpuDemand) -> Demand {
        let (workers, chart_area) = self.workers(gpus);
        let ChunkMemory { count, decoding, values, read_ahead, .. } = self.chunks;
        let at_once = self.threads.min(count);
        let (decoding, chunks) = (at_once.saturating_mul(decoding), at_once.saturating_mul(values));
        let fixed = PROCESS_BYTES + self.shards(gpus) + self.lens(gpus);
        let fixed = fixed.saturating_add(workers).saturating_add(decoding).saturating_add(read_ahead);
        let fixed = fixed.saturating_add(self.surface_caches).saturating_add(self.layers());
        let chart_cache = self.chart_cache(chunks, gpus);
        let [min, shard_spectra, band_spectra, max] = self.spectra(gpus);
        let (spectra, encoded) = ((min, max), self.encoded());
        Demand {
            fixed,
            chart_area,
            decoding,
            chunks,
            chart_cache,
            spectra,
            shard_spectra,
            band_spectra,
            encoded,
        }
    }

    /// Why `demand` exceeds the limit by `missing` bytes, and the remedy; `min` is the smallest sufficient limit.
    fn explain(&self, demand: &Demand, missing: usize, min: usize) -> String {
        let of_chart = demand.decoding.saturating_add(demand.chunks);
        let (threads, min) = (self.threads, mib(min));
        if demand.chart_area >= missing && demand.chart_area >= of_chart {
            return format!(
                "each of {threads} threads needs {} for the chart under a tile, because at {} nm the ideal heights of the lens table \
                 grow by up to {:.3e} mm per mm of REAL height (--scale {}): {}; or use fewer --threads",
                mib(demand.chart_area / threads.max(1)),
                self.stretch.wavelength_nm,
                self.stretch.range.1,
                self.frame.scale.0.min(self.frame.scale.1),
                self.stretch.cause(),
            );
        }
        if of_chart >= missing {
            return format!(
                "{} chunks of the chart at a time, {} each when decoded, require {min}; raise the limit, use fewer --threads, or \
                 re-chunk the chart, e.g. into (1, 512, 512)",
                threads.min(self.chunks.count),
                mib(self.chunks.values),
            );
        }
        let largest = BinArg::LARGEST_PX;
        let finer =
            self.film.layers.iter().any(|l| l.name == VEIL && l.bin_px.iter().any(|px| *px < largest));
        if finer && self.layers() >= missing {
            return format!(
                "light that spreads over the film takes {} while it is computed, all together at least {min}; raise the limit, or compute it on \
                 larger bins, --veil-bin {largest}",
                mib(self.layers())
            );
        }
        format!(
            "{threads} threads, PSFs and shards of this film require at least {min}; raise the limit, use fewer --threads, or a \
             smaller --shard"
        )
    }
}

impl Memory {
    /// Divides the limit of `inputs`.
    ///
    /// # Errors
    /// Usage: the limit is too small; with the cause and the remedy.
    pub fn plan(inputs: &MemoryInputs<'_>, gpus: GpuDemand) -> Result<Self> {
        let limit = usize::try_from(inputs.limit.bytes).unwrap_or(usize::MAX);
        let usable = (limit as f64 * (1.0 - FRAGMENTATION_SHARE)) as usize;
        let with_slack = |bytes: usize| (bytes as f64 / (1.0 - FRAGMENTATION_SHARE)) as usize;
        let demand = inputs.demand(&gpus);
        let min_pinned = gpus.queues * gpus.min_pinned;
        let caches = demand.spectra.0.saturating_add(demand.chart_cache.0);
        let min = demand.fixed.saturating_add(caches).saturating_add(min_pinned);
        if min > usable {
            let why = inputs.explain(&demand, min - usable, with_slack(min));
            return Err(inputs.limit.too_small(why));
        }
        // Nothing else is allocated while bands are written to a temporary file.
        let rechunking = inputs.chunks.rechunking;
        let decoders = usable.saturating_sub(PROCESS_BYTES) / rechunking.max(1);
        if decoders == 0 {
            return Err(inputs.limit.too_small(format!(
                "sorting the chart by band requires {} per chunk; raise the limit, or re-chunk the chart, e.g. into (1, 512, 512)",
                mib(with_slack(PROCESS_BYTES.saturating_add(rechunking))),
            )));
        }
        let pinned = (gpus.queues * gpus.max_pinned).min((usable - min) / 2 + min_pinned);
        let rest = usable - demand.fixed - pinned;
        let spectra = demand.shard_spectra.min(rest - demand.chart_cache.0);
        let (encoded_bytes, useful) = demand.encoded;
        let extra = ((rest - demand.chart_cache.0 - spectra) / encoded_bytes.max(1)).min(useful);
        let rest = rest - extra * encoded_bytes;
        let chart_cache = demand.chart_cache.1.min(rest - spectra).max(demand.chart_cache.0);
        let spectra = rest - chart_cache;
        let spectra_in_turn = spectra.min(demand.band_spectra);
        let used = demand.fixed
            + pinned
            + extra * encoded_bytes
            + chart_cache
            + spectra_in_turn.min(demand.spectra.1);
        Ok(Self {
            limit,
            planned: with_slack(used).min(limit),
            chart_cache: without_overhead(chart_cache, demand.chunks),
            spectra,
            spectra_in_turn,
            pinned: pinned / gpus.queues.max(1),
            encoded_shards: queues::MIN_ENCODED_SHARDS + extra,
            decoders: decoders.min(inputs.threads),
        })
    }
}

/// Memory of a chart cache of `bytes`, of which `chunks` are of the chunks in use.
fn with_overhead(bytes: usize, chunks: usize) -> usize {
    chunks.saturating_add((bytes.saturating_sub(chunks) as f64 * CHART_CACHE_OVERHEAD) as usize)
}

/// The inverse of [`with_overhead`].
fn without_overhead(memory: usize, chunks: usize) -> usize {
    chunks + (memory.saturating_sub(chunks) as f64 / CHART_CACHE_OVERHEAD) as usize
}
