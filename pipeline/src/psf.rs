//! PSF stage (SVPSF, spatially variant point spread function): every pixel of the remapped image scatters its own PSF onto the film.
//!
//! ```text
//! film[v, u] = Σ_{y, x} remapped[y, x] · P(r, θ)[v − y, u − x]
//! ```
//! with (r, θ) the REAL image height and azimuth of pixel (y, x) and P of sum 1 over its window of film pixels. Between the nodes
//! of a polar grid, or of a Cartesian one ([`grid`]), P is interpolated linearly, P(r, θ) = Σ_node w_node(r, θ)·P_node, so the sum is,
//! without further approximation, a sum of convolutions:
//! ```text
//! film = Σ_node (w_node · remapped) ∗ P_node
//! ```
//! Per block ([`blocks`]) and node that touches it: pixels × weight ([`polar`], coordinates of the pixels), forward FFT, product with the spectrum of the node's
//! kernel ([`kernel`], [`spectra`]), accumulate; per block one inverse FFT, overlap-add. [`portable`] does this with library
//! transforms, the SIMD engines with transforms of their own; the plain sum is in `tests/oracle`.
//! The remapped image extends half a window beyond the film on every side, so the film is exact up to its border.
//! The transpose, which gathers, is in `gather`.
//! A uniform remapped image R gives R·(1 − div c) on the film, c the centroid of the PSF from the chief ray (of order 1e-3 for a
//! Double Gauss): the PSF redistributes energy; the total is constant.
//! Related: Maeda, Catrysse, Wandell, "Integrating lens design with digital camera simulation", Proc. SPIE 5678 (2005), which
//! samples the field.

mod block_view;
pub mod blocks;
pub mod coarse;
pub mod cuda;
mod engine;
pub(crate) mod gather;
pub mod grid;
pub mod kernel;
pub mod memory;
pub mod polar;
pub mod portable;
pub(crate) mod simd;
pub mod spectra;

pub use block_view::{BlockView, Spectra};

use crate::buffer::{AlignedBuf, TileBuffer};
use crate::geometry::{Frame, Rect};
use crate::simd::Simd;
use blocks::Blocks;
use engine::{Engine, EngineScratch};
use grid::{Node, NodeGrid};
use kernel::on_demand::{KernelsOnDemand, PsfReadError};
use kernel::{BaseGroup, KernelScratch, KernelSymmetry, NodeKernels};
use polar::BlockPlace;
use spectra::SpectrumCache;
use std::cell::Cell;
use std::sync::{Arc, Mutex};

/// The PSF stage of one band.
#[derive(Debug)]
pub struct BandPsf {
    band: usize,
    /// Id of the first node in the cache of spectra.
    first_id: usize,
    grid: NodeGrid,
    kernels: Kernels,
    blocks: Blocks,
    engine: Option<Engine>,
    builders: Builders,
    /// Bytes of its base kernels, if all are to be kept; those of a lens with rotational symmetry are few, and stay for its film at another place.
    kept_bytes: usize,
}

const NOT_IN_MEMORY: &str = "kernels that are read on demand are used by this stage alone";

/// Where a stage's kernels come from.
#[derive(Debug)]
enum Kernels {
    InMemory(Arc<NodeKernels>),
    OnDemand(KernelsOnDemand),
}

/// Buffers for building spectra while blocks are being computed, as many as are in use at a time; the stages of a band's depth nodes share them.
#[derive(Clone, Debug, Default)]
pub(crate) struct Builders(Arc<Mutex<Vec<Builder>>>);

#[derive(Debug, Default)]
struct Builder {
    kernel: Vec<f32>,
    scratch: KernelScratch,
    engine: Option<(Blocks, EngineScratch)>,
}

impl Builders {
    /// Calls `build` with buffers for `blocks` of `engine`: those of a kernel, to compute kernels, and of the engine.
    fn with<T>(
        &self,
        blocks: &Blocks,
        engine: &Engine,
        build: impl FnOnce(&mut Vec<f32>, &mut KernelScratch, &mut EngineScratch) -> T,
    ) -> T {
        let mut builder = self.0.lock().expect("no panic while held").pop().unwrap_or_default();
        let Builder { kernel, scratch, engine: of_engine } = &mut builder;
        kernel.resize(blocks.window * blocks.window, 0.0);
        if of_engine.as_ref().is_none_or(|(known, _)| known != blocks) {
            *of_engine = Some((*blocks, engine.scratch()));
        }
        let (_, of_engine) = of_engine.as_mut().expect("assigned above");
        let built = build(kernel, scratch, of_engine);
        self.0.lock().expect("no panic while held").push(builder);
        built
    }
}

/// Buffers of one worker; no allocation after the first tile of a band.
#[derive(Debug, Default)]
pub struct PsfScratch {
    engine: Option<((usize, usize), EngineScratch)>,
    /// Transforms so far: forward, inverse.
    pub(crate) transforms: (u64, u64),
}

impl BandPsf {
    /// The stage of band `band` of the job.
    pub fn new(band: usize, grid: NodeGrid, kernels: NodeKernels, simd: Simd) -> Self {
        let blocks = Blocks::choose(kernels.size(), &grid);
        let kernels = Kernels::InMemory(Arc::new(kernels));
        Self::with_kernels((band, 0), grid, kernels, blocks, (simd, Builders::default()))
    }

    /// The stage of band `band` of the job, whose PSFs are read when they are needed.
    pub fn on_demand(band: usize, grid: NodeGrid, kernels: KernelsOnDemand, simd: Simd) -> Self {
        Self::of_depth_node((band, 0), grid, kernels, simd, &Builders::default())
    }

    /// The stage of a depth node of band `band`, with node ids from `first_id` on: the stages of its depth nodes have spectra of their own.
    pub(crate) fn of_depth_node(
        (band, first_id): (usize, usize),
        grid: NodeGrid,
        kernels: KernelsOnDemand,
        simd: Simd,
        builders: &Builders,
    ) -> Self {
        let blocks = Blocks::choose(kernels.size(), &grid);
        let kernels = Kernels::OnDemand(kernels);
        Self::with_kernels((band, first_id), grid, kernels, blocks, (simd, builders.clone()))
    }

    fn with_kernels(
        (band, first_id): (usize, usize),
        grid: NodeGrid,
        kernels: Kernels,
        blocks: Blocks,
        (simd, builders): (Simd, Builders),
    ) -> Self {
        let engine = (blocks.fft > 0).then(|| Engine::new(&blocks, simd));
        let kept_bytes =
            if grid.is_symmetric() { usize::MAX } else { memory::all_kernels_bytes(&blocks, &grid) };
        Self { band, first_id, grid, kernels, blocks, engine, builders, kept_bytes }
    }

    /// FFT size, block and tile side.
    pub fn blocks(&self) -> &Blocks {
        &self.blocks
    }

    /// The node grid.
    pub fn grid(&self) -> &NodeGrid {
        &self.grid
    }

    /// The kernels of a stage of [`BandPsf::new`].
    ///
    /// # Panics
    /// The PSFs of the stage are read on demand.
    pub fn kernels(&self) -> &NodeKernels {
        match &self.kernels {
            Kernels::InMemory(kernels) => kernels,
            Kernels::OnDemand(_) => unreachable!("{NOT_IN_MEMORY}"),
        }
    }

    /// The kernels, shared; as [`BandPsf::kernels`].
    pub(crate) fn shared_kernels(&self) -> Arc<NodeKernels> {
        match &self.kernels {
            Kernels::InMemory(kernels) => Arc::clone(kernels),
            Kernels::OnDemand(_) => unreachable!("{NOT_IN_MEMORY}"),
        }
    }

    /// Fails if a PSF that was read on demand could not be read; what was computed since is then not valid.
    ///
    /// # Errors
    /// The first error of the reader.
    pub(crate) fn check_read(&self) -> Result<(), PsfReadError> {
        match &self.kernels {
            Kernels::InMemory(_) => Ok(()),
            Kernels::OnDemand(kernels) => kernels.check_read(),
        }
    }

    /// Whether its kernels are in memory.
    pub fn is_in_memory(&self) -> bool {
        matches!(self.kernels, Kernels::InMemory(_))
    }

    /// Half the window, film pixels: the distance over which a pixel contributes.
    pub fn margin(&self) -> usize {
        self.blocks.window / 2
    }

    /// The film rectangle that receives contributions from `tile` of the remapped image.
    pub fn reaches(&self, tile: Rect) -> Rect {
        tile.grown(self.margin())
    }

    /// Computes the contribution of `tile`, whose pixels are `remapped` (row-major), to the film rectangle [`BandPsf::reaches`]: `out`.
    pub fn scatter(
        &self,
        frame: &Frame,
        tile: Rect,
        remapped: &[f32],
        cache: &SpectrumCache,
        out: &mut TileBuffer,
        s: &mut PsfScratch,
    ) {
        self.scatter_blocks(frame, tile, remapped, cache, out, s, |_| true);
    }

    /// As [`BandPsf::scatter`], of the blocks for which `is_wanted` is true. Blocks of zeros contribute nothing and are skipped.
    #[allow(clippy::too_many_arguments, reason = "as of scatter")]
    pub(crate) fn scatter_blocks(
        &self,
        frame: &Frame,
        tile: Rect,
        remapped: &[f32],
        cache: &SpectrumCache,
        out: &mut TileBuffer,
        s: &mut PsfScratch,
        mut is_wanted: impl FnMut(Rect) -> bool,
    ) {
        let Some(engine) = &self.engine else {
            out.copy(remapped, tile.width);
            if !is_wanted(tile) {
                out.data.fill(0.0);
            }
            return;
        };
        // Engines add panels of up to 16 columns, the last one partly zeros.
        let tail = self.blocks.window - 1;
        out.stride = (tile.width + tail + 15).next_multiple_of(16);
        out.data.reset(out.stride * (tile.height + tail));
        let stage = (self.band, self.first_id);
        if s.engine.as_ref().is_none_or(|(other, _)| *other != stage) {
            s.engine = Some((stage, engine.scratch()));
        }
        let (_, scratch) = s.engine.as_mut().expect("assigned above");
        let spectra = CachedSpectra { psf: self, engine, cache, forward: Cell::new(0) };
        for block in tile.tiles(self.blocks.block, self.blocks.block) {
            let (y, x) = ((block.y - tile.y) as usize, (block.x - tile.x) as usize);
            let rows = remapped.chunks(tile.width).skip(y).take(block.height);
            let is_zero = || rows.clone().all(|row| row[x..x + block.width].iter().all(|v| *v == 0.0));
            if !is_wanted(block) || is_zero() {
                continue;
            }
            let place = BlockPlace {
                dy_px: block.y as f64 - frame.axis_px.0,
                dx_px: block.x as f64 - frame.axis_px.1,
                rows: block.height,
                cols: block.width,
            };
            let view = BlockView { pixels: &remapped[y * tile.width + x..], stride: tile.width, place };
            let stride = out.stride;
            let to = &mut out.data[y * stride + x..];
            engine.scatter(&view, &self.grid, &spectra, to, stride, scratch);
            s.transforms.1 += 1;
        }
        s.transforms.0 += spectra.forward.get();
    }

    /// Adds the spectrum of `node` to `cache` if absent.
    pub fn prepare(&self, node: Node, cache: &SpectrumCache) {
        if let Some(engine) = &self.engine {
            self.spectrum(engine, node, cache);
        }
    }

    fn spectrum(&self, engine: &Engine, node: Node, cache: &SpectrumCache) -> Arc<AlignedBuf> {
        let bytes = engine.spectrum_len() * size_of::<f32>();
        cache.get((self.band, self.first_id + self.grid.id(node)), bytes, |buffer| {
            self.builders.with(&self.blocks, engine, |kernel, scratch, of_engine| {
                let symmetry = self.symmetry_of(node, cache, scratch);
                let (kernels, at) = self.kernels_with(symmetry.base, cache, scratch);
                let base = &kernels[at * kernel.len()..][..kernel.len()];
                symmetry.expand(base, self.blocks.window, kernel);
                engine.spectrum(kernel, of_engine, buffer)
            })
        })
    }
}

impl BandPsf {
    fn symmetry_of(&self, node: Node, cache: &SpectrumCache, s: &mut KernelScratch) -> KernelSymmetry {
        match &self.kernels {
            Kernels::InMemory(kernels) => kernels.symmetry_of(&self.grid, node),
            Kernels::OnDemand(kernels) => kernels.symmetry_of(&self.grid, node, || {
                self.psfs(kernels, node, cache, s);
            }),
        }
    }

    /// Kernels with that of `base`, and its place among them. Where `cache` keeps all of the band, those whose PSFs are read together: PSFs, which take more memory, are then read once.
    fn kernels_with(
        &self,
        base: Node,
        cache: &SpectrumCache,
        s: &mut KernelScratch,
    ) -> (Arc<AlignedBuf>, usize) {
        let is_read_once =
            !self.is_in_memory() && !self.grid.is_symmetric_at(base) && cache.keeps(self.kept_bytes);
        let group = match is_read_once {
            true => BaseGroup::read_together(&self.grid, base),
            false => BaseGroup::of(&self.grid, base),
        };
        let values = group.count * self.blocks.window * self.blocks.window;
        let id = |node: Node| self.first_id + self.grid.id(node);
        let kernels =
            cache.base_kernel((self.band, id(group.first)), (4 * values, self.kept_bytes), |mut buffer| {
                buffer.reset(values);
                match &self.kernels {
                    Kernels::InMemory(kernels) => kernels.base_kernels(&self.grid, &group, s, &mut buffer),
                    Kernels::OnDemand(kernels) if is_read_once => {
                        kernels.kernels_together(&self.grid, &group, &mut buffer);
                    }
                    Kernels::OnDemand(kernels) => {
                        let psfs = self.psfs(kernels, group.first, cache, s);
                        kernels.base_kernels(&self.grid, &group, &psfs, s, &mut buffer);
                    }
                }
                buffer
            });
        (kernels, id(base) - id(group.first))
    }

    /// The prepared PSFs of the set of `node`.
    fn psfs(
        &self,
        kernels: &KernelsOnDemand,
        node: Node,
        cache: &SpectrumCache,
        s: &mut KernelScratch,
    ) -> Arc<AlignedBuf> {
        let set = self.grid.psf_set(node);
        let bytes = kernels.psf_bytes(self.grid.psf_rows(set).len());
        cache.psf((self.band, self.first_id + set), bytes, |buffer| {
            kernels.prepare(&self.grid, set, buffer, s)
        })
    }
}

/// The cache as a source of spectra for an engine.
struct CachedSpectra<'a> {
    psf: &'a BandPsf,
    engine: &'a Engine,
    cache: &'a SpectrumCache,
    /// Spectra used: transforms of blocks.
    forward: Cell<u64>,
}

impl Spectra for CachedSpectra<'_> {
    fn get(&self, node: Node) -> Arc<AlignedBuf> {
        self.forward.set(self.forward.get() + 1);
        self.psf.spectrum(self.engine, node, self.cache)
    }
}
