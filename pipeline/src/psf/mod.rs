//! Stage 3, the spatially variant PSF: every pixel of the remapped image scatters a PSF of its own onto the film.
//!
//!     film[y + dy, x + dx] += remapped[y, x] · P(r, θ)[dy, dx]
//! P is linear between the nodes of a polar grid ([`grid`]), so that
//!     film = Σ_nodes (w_node · remapped) ∗ P_node
//! exactly: a weighted copy of each block per node that touches it, a convolution by FFT with that node's kernel
//! ([`kernel`]), one inverse transform, overlap-add. Nothing is approximated, there are no patches and no seams.
//! Source: DESIGN of the project; kin of Maeda, Catrysse, Wandell, Proc. SPIE 5678 (2005), without their sampling.
//! A uniform remapped R gives R·(1 − div c) on the film, c = the PSF's centroid from the chief ray (1e-3 for a Double
//! Gauss): light is moved, none is lost.

pub mod blocks;
pub mod cuda;
mod engine;
pub mod grid;
pub mod kernel;
pub mod polar;
pub mod portable;
#[cfg(target_arch = "x86_64")]
mod simd;
pub mod spectra;
mod spline;

use crate::buffer::{AlignedBuf, TileBuffer};
use crate::geometry::{Frame, Rect};
use crate::simd::Simd;
use blocks::Blocks;
use engine::{Engine, EngineScratch};
use grid::{Node, NodeGrid};
use kernel::{KernelScratch, NodeKernels};
use polar::BlockPlace;
use spectra::SpectrumCache;
use std::sync::{Arc, Mutex};

/// Pixels of a block of the remapped image inside a larger buffer.
#[derive(Clone, Copy, Debug)]
pub struct BlockView<'a> {
    /// From the block's first pixel on.
    pub pixels: &'a [f32],
    /// Pixels from one row to the next.
    pub stride: usize,
    /// Where the block lies about the axis, and its size.
    pub place: BlockPlace,
}

/// Where an engine gets the spectrum of a node from.
pub trait Spectra {
    /// The spectrum, in the engine's own layout.
    fn get(&self, node: Node) -> Arc<AlignedBuf>;
}

/// The PSF stage of one band.
#[derive(Debug)]
pub struct BandPsf {
    band: usize,
    grid: NodeGrid,
    kernels: Arc<NodeKernels>,
    blocks: Blocks,
    engine: Option<Engine>,
    builders: Mutex<Vec<Builder>>,
}

/// What a worker needs while it builds a spectrum in the middle of a block.
#[derive(Debug)]
struct Builder {
    kernel: Vec<f32>,
    scratch: KernelScratch,
    engine: EngineScratch,
}

/// Buffers of one worker: no allocation after the first tile of a band.
#[derive(Debug, Default)]
pub struct PsfScratch {
    engine: Option<(usize, EngineScratch)>,
}

impl BandPsf {
    /// The stage for band `band` of the job, computed with `simd`.
    pub fn new(band: usize, grid: NodeGrid, kernels: NodeKernels, simd: Simd) -> Self {
        let blocks = Blocks::choose(kernels.size(), &grid);
        let engine = (blocks.fft > 0).then(|| Engine::new(&blocks, simd));
        Self { band, grid, kernels: Arc::new(kernels), blocks, engine, builders: Mutex::default() }
    }

    /// How the film is cut.
    pub fn blocks(&self) -> &Blocks {
        &self.blocks
    }

    /// The node grid.
    pub fn grid(&self) -> &NodeGrid {
        &self.grid
    }

    /// The kernels.
    pub fn kernels(&self) -> &NodeKernels {
        &self.kernels
    }

    /// The kernels, to be kept beyond the stage.
    pub(crate) fn shared_kernels(&self) -> Arc<NodeKernels> {
        Arc::clone(&self.kernels)
    }

    /// Half the window: how far light is scattered, in film pixels.
    pub fn margin(&self) -> usize {
        self.blocks.window / 2
    }

    /// The film rectangle that the rectangle of the remapped image `tile` reaches.
    pub fn reaches(&self, tile: Rect) -> Rect {
        tile.grown(self.margin())
    }

    /// Scatters `remapped` (the pixels of `tile`, row-major) into `out`, which becomes [`BandPsf::reaches`] of it.
    pub fn scatter(
        &self,
        frame: &Frame,
        tile: Rect,
        remapped: &[f32],
        cache: &SpectrumCache,
        out: &mut TileBuffer,
        s: &mut PsfScratch,
    ) {
        let Some(engine) = &self.engine else {
            return out.copy(remapped, tile.width);
        };
        // Engines add whole strips of up to 16 columns, the last one partly zeros.
        let tail = self.blocks.window - 1;
        out.stride = (tile.width + tail + 15).next_multiple_of(16);
        out.data.reset(out.stride * (tile.height + tail));
        if s.engine.as_ref().is_none_or(|(band, _)| *band != self.band) {
            s.engine = Some((self.band, engine.scratch()));
        }
        let (_, scratch) = s.engine.as_mut().expect("just made");
        let spectra = CachedSpectra { psf: self, engine, cache };
        for block in tile.tiles(self.blocks.block, self.blocks.block) {
            let (y, x) = ((block.y - tile.y) as usize, (block.x - tile.x) as usize);
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
        }
    }

    /// Builds the spectrum of `node` unless it is in `cache`.
    pub fn prepare(&self, node: Node, cache: &SpectrumCache) {
        if let Some(engine) = &self.engine {
            self.spectrum(engine, node, cache);
        }
    }

    fn spectrum(&self, engine: &Engine, node: Node, cache: &SpectrumCache) -> Arc<AlignedBuf> {
        let bytes = engine.spectrum_len() * size_of::<f32>();
        cache.get((self.band, self.grid.id(node)), bytes, |buffer| {
            let pooled = self.builders.lock().expect("no panic while held").pop();
            let mut b = pooled.unwrap_or_else(|| Builder {
                kernel: vec![0.0; self.blocks.window * self.blocks.window],
                scratch: KernelScratch::default(),
                engine: engine.scratch(),
            });
            let making = self.kernels.making(&self.grid, node);
            let seed = (self.band, self.grid.id(making.seed));
            let seed = cache.seed(seed, size_of_val(&b.kernel[..]), |mut buffer| {
                buffer.reset(b.kernel.len());
                buffer.copy_from_slice(self.kernels.seed(&self.grid, making.seed, &mut b.scratch));
                buffer
            });
            self.kernels.lay(&making, &seed, &mut b.kernel);
            let spectrum = engine.spectrum(&b.kernel, &mut b.engine, buffer);
            self.builders.lock().expect("no panic while held").push(b);
            spectrum
        })
    }
}

/// The cache as an engine sees it.
struct CachedSpectra<'a> {
    psf: &'a BandPsf,
    engine: &'a Engine,
    cache: &'a SpectrumCache,
}

impl Spectra for CachedSpectra<'_> {
    fn get(&self, node: Node) -> Arc<AlignedBuf> {
        self.psf.spectrum(self.engine, node, self.cache)
    }
}
