//! The PSF stage of one band on a GPU: the sums of [`crate::psf`], computed by the kernels of `psf.cu`.
//!
//! Input are remapped tiles, output are contributions (tile and tail), both in device memory. The tiles of a batch share launches; the
//! contribution of a tile depends on that tile alone (`round`). The CPU computes *base kernels* as for its own transforms, one for
//! four or eight nodes; the device mirrors and transposes them for the other nodes, transforms them, and keeps base kernels and spectra in two
//! pools (`lru_pool`). Where memory is short, a batch is processed in rounds of fewer tiles, and these in steps of fewer nodes: the same sums
//! in the same order. All that the CPU computes for a batch is in its plan (`plan`); a launch only uploads and enqueues.
//!
//! Cost, counted in the machine code for compute capability 9.0 (see `scripts/bench`): 16 warp instructions a pixel at 51 px, 38 at 151 px.

mod budget;
mod descriptors;
mod launch;
mod lru_pool;
mod partition;
mod plan;
mod round;
mod schedule;
mod tile;
mod touching;

pub use partition::{Partition, gpu_blocks};
pub use plan::{PsfPlan, PsfPlanner};
pub use tile::PsfTile;

use crate::cuda::handle::CudaStream;
use crate::cuda::kernel_timer::KernelTimer;
use crate::cuda::memory::MAX_TILES;
use crate::cuda::slice::{CudaSlice, CudaViewMut, DeviceMemory, DeviceMemoryMut};
use crate::cuda::upload_ring::UploadRing;
use crate::cuda::{CudaError, Device};
use crate::geometry::Frame;
use crate::psf::BandPsf;
use crate::psf::blocks::Blocks;
use crate::psf::grid::NodeGrid;
use crate::psf::polar::{ATAN, SECANT};
use budget::Budget;
use launch::{Functions, Launcher};
use plan::{PlannedRound, PlannedStep};
use std::ops::Range;
use std::sync::Arc;

/// Kernels and tables of one band on one GPU.
#[derive(Debug)]
pub struct PsfOnDevice {
    device: Arc<Device>,
    partition: Partition,
    functions: Functions,
    tables: CudaSlice<f32>,
    polynomials: CudaSlice<f32>,
}

/// Device memory of the stage for the bands of one stream: spectra, base kernels, and the blocks, images and lists of a round; with the
/// ring for uploads.
#[derive(Debug)]
pub struct PsfMemory {
    words: CudaSlice<u32>,
    ring: UploadRing,
}

impl PsfMemory {
    /// `bytes` of device memory.
    ///
    /// # Errors
    /// Out of memory, or another error of the driver.
    pub fn new(device: &Device, stream: &Arc<CudaStream>, bytes: usize) -> Result<Self, CudaError> {
        let words = device.allocate(stream, (bytes / 4).max(1), "spectra, kernels and blocks")?;
        Ok(Self { words, ring: UploadRing::new(device)? })
    }
}

impl PsfOnDevice {
    /// Minimum of device memory, in bytes, for tiles of `tile_side`.
    pub fn min_bytes(blocks: &Blocks, grid: &NodeGrid, tile_side: usize) -> usize {
        let partition = Partition::for_window(blocks.window);
        Budget::min(&partition, grid, tile_side).bytes(&partition)
    }

    /// Device memory, in bytes, beyond which more has no effect for batches of `tiles` tiles of `tile_side`.
    pub fn max_bytes(blocks: &Blocks, grid: &NodeGrid, tile_side: usize, tiles: usize) -> usize {
        Budget::max_bytes(&Partition::for_window(blocks.window), grid, tile_side, tiles)
    }

    /// The stage of `psf` on `device`; its tables are uploaded when this returns.
    ///
    /// # Errors
    /// An error of the driver.
    pub fn new(device: &Arc<Device>, psf: &BandPsf) -> Result<Self, CudaError> {
        let partition = Partition::for_window(psf.blocks().window);
        let stream = device.context.default_stream();
        let upload = |values: &[f32], what| {
            let mut to = device.allocate::<f32>(&stream, values.len(), what)?;
            stream.memcpy_htod(values, &mut to).map_err(device.failed("uploading tables"))?;
            Ok(to)
        };
        let tables = if partition.side == 0 { vec![0.0] } else { partition.tables() };
        let this = Self {
            functions: Functions::load(device, &partition)?,
            tables: upload(&tables, "roots of unity")?,
            polynomials: upload(&[&ATAN[..], &SECANT[..]].concat(), "polynomials")?,
            device: Arc::clone(device),
            partition,
        };
        stream.synchronize().map_err(device.failed("uploading tables"))?;
        Ok(this)
    }

    /// Computes the `contributions` of the tiles of `plan` from their `remapped` values, in the order of `stream`, which must be the same for
    /// all launches with this `memory`; `timer` times the kernels. Every value of a contribution is set.
    ///
    /// # Errors
    /// An error of the driver; the memory must not be used after it.
    ///
    /// # Panics
    /// If a tile lies beyond `remapped` or `contributions`, or the plan takes more memory.
    pub fn launch(
        &self,
        stream: &Arc<CudaStream>,
        plan: &PsfPlan,
        memory: &mut PsfMemory,
        remapped: &CudaSlice<f32>,
        contributions: &mut CudaSlice<f32>,
        timer: &mut KernelTimer<'_>,
    ) -> Result<(), CudaError> {
        assert!(plan.remapped_len <= remapped.len() && plan.contributions_len <= contributions.len());
        plan.rounds.iter().try_for_each(|round| {
            self.run(stream, round, &plan.budget, memory, (remapped, contributions), timer)
        })
    }

    fn run(
        &self,
        stream: &Arc<CudaStream>,
        round: &PlannedRound,
        budget: &Budget,
        memory: &mut PsfMemory,
        (remapped, contributions): (&CudaSlice<f32>, &mut CudaSlice<f32>),
        timer: &mut KernelTimer<'_>,
    ) -> Result<(), CudaError> {
        let (device, partition) = (&self.device, &self.partition);
        let PsfMemory { words, ring } = memory;
        let (mut spectra, mut rest) = words.split_at_mut(budget.spectra_words(partition));
        let (mut base_kernels, mut rest) = rest.split_at_mut(budget.base_kernel_words(partition));
        let (mut packed, mut rest) = rest.split_at_mut(round.packed_len);
        let (mut images, mut rest) = rest.split_at_mut(round.images_len);
        ring.upload(device, stream, &round.words, &mut rest, "uploading lists")?;
        let launcher =
            Launcher { device, stream, partition, functions: &self.functions, tables: &self.tables };
        let list = |range: &Range<usize>| rest.slice(range.clone());
        let (rows, cols) = round.max_contribution;
        let (tiles, blocks, jobs) = round.count;
        let tile_grid = (cols.div_ceil(32), rows.div_ceil(8), tiles as u32);
        timer.start()?;
        if partition.side == 0 {
            launcher.copy(tile_grid, &list(&round.tiles), remapped, contributions)?;
            return timer.stop();
        }
        launcher.pack(blocks, &list(&round.blocks), remapped, &self.polynomials, &mut packed)?;
        for step in &round.steps {
            match step {
                PlannedStep::UploadBaseKernels(kernels) => {
                    timer.stop()?;
                    upload_base_kernels(&launcher, kernels, &mut base_kernels, ring)?;
                    timer.start()?;
                }
                PlannedStep::Transform(count, parts) => {
                    launcher.spectra(*count, &list(parts), &base_kernels, &mut spectra)?;
                }
                PlannedStep::Scatter(range, words) => {
                    let images = &mut images.slice_mut(range.start * partition.image_len()..);
                    launcher.scatter(
                        range.len(),
                        (&list(words), &list(&round.weights)),
                        &packed,
                        &spectra,
                        images,
                    )?;
                }
            }
        }
        launcher.unfold(jobs, &mut images)?;
        launcher.add(tile_grid, (&list(&round.tiles), &list(&round.block_images)), &images, contributions)?;
        timer.stop()
    }
}

/// Uploads base kernels to their pool entries, those of consecutive entries by one copy.
fn upload_base_kernels(
    launcher: &Launcher<'_>,
    kernels: &[(usize, Vec<f32>)],
    to: &mut CudaViewMut<'_, u32>,
    ring: &mut UploadRing,
) -> Result<(), CudaError> {
    let len = launcher.partition.window * launcher.partition.window;
    for (first, kernels) in kernels {
        let entries = &mut to.slice_mut(first * len..first * len + kernels.len());
        let words: &[u32] = bytemuck::cast_slice(kernels);
        ring.upload(launcher.device, launcher.stream, words, entries, "uploading kernels")?;
    }
    Ok(())
}

/// The PSF stage of one band with memory of its own, which plans a batch at its launch: for benchmarks and tests.
#[derive(Debug)]
pub struct PsfStage {
    stage: PsfOnDevice,
    planner: PsfPlanner,
    memory: PsfMemory,
}

impl PsfStage {
    /// The stage of `psf` on `device`, in at most `bytes` of its memory.
    ///
    /// # Errors
    /// Less than [`PsfOnDevice::min_bytes`], or an error of the driver.
    pub fn new(device: &Arc<Device>, frame: &Frame, psf: &BandPsf, bytes: usize) -> Result<Self, CudaError> {
        let tile = psf.blocks().tile;
        let bytes = bytes.min(PsfOnDevice::max_bytes(psf.blocks(), psf.grid(), tile, MAX_TILES));
        let planner = PsfPlanner::new(device.index(), frame, psf, tile, bytes)?;
        let stream = device.context.default_stream();
        let memory = PsfMemory::new(device, &stream, bytes)?;
        Ok(Self { stage: PsfOnDevice::new(device, psf)?, planner, memory })
    }

    /// As [`PsfOnDevice::launch`].
    ///
    /// # Errors
    /// An error of the driver; the stage must not be used after it.
    pub fn launch(
        &mut self,
        stream: &Arc<CudaStream>,
        tiles: &[PsfTile],
        remapped: &CudaSlice<f32>,
        contributions: &mut CudaSlice<f32>,
        timer: &mut KernelTimer<'_>,
    ) -> Result<(), CudaError> {
        let plan = self.planner.plan(tiles)?;
        self.stage.launch(stream, &plan, &mut self.memory, remapped, contributions, timer)
    }
}
