//! The PSF stage of one band on a GPU: the sums of [`crate::psf`], computed by the kernels of `psf.cu`.
//!
//! Input are remapped tiles, output are contributions (tile and tail), both in device memory. The tiles of a batch share launches; the
//! contribution of a tile depends on that tile alone (`round`). The CPU computes *base kernels* as for its own transforms, one for
//! four or eight nodes; the device mirrors and transposes them for the other nodes, transforms them, and keeps base kernels and spectra in two pools (`lru_pool`). Where
//! memory is short, a batch is processed in rounds of fewer tiles, and these in steps of fewer nodes: the same sums in the same order.
//!
//! Cost, counted in the machine code for compute capability 9.0 (see `scripts/bench`): 16 warp instructions a pixel at 51 px, 38 at 151 px.

mod budget;
mod descriptors;
mod launch;
mod lru_pool;
mod partition;
mod round;
mod schedule;
mod touching;

pub use partition::Partition;

use crate::cuda::handle::CudaStream;
use crate::cuda::kernel_timer::{KernelTimer, timed};
use crate::cuda::slice::{CudaSlice, DeviceMemory, DeviceMemoryMut};
use crate::cuda::upload_ring::UploadRing;
use crate::cuda::{CudaError, Device};
use crate::geometry::{Frame, Rect};
use crate::psf::BandPsf;
use crate::psf::blocks::Blocks;
use crate::psf::grid::{Node, NodeGrid};
use crate::psf::kernel::{KernelScratch, NodeKernels};
use crate::psf::polar::{ATAN, SECANT};
use budget::Budget;
use descriptors::{Job, KernelPart};
use launch::{Functions, Launcher, Lists, grow};
use lru_pool::LruPool;
use rayon::prelude::*;
use round::Round;
use schedule::{Schedule, ScheduleStep};
use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

/// Base kernels computed by the CPU before their upload.
const BASE_KERNELS_AT_ONCE: usize = 64;

/// One tile of a batch, with the places of its input and output.
#[derive(Clone, Copy, Debug)]
pub struct PsfTile {
    /// On the film.
    pub rect: Rect,
    /// Index of its first value in the remapped tiles; its rows follow one another.
    pub remapped_offset: usize,
    /// Index of the first value of its contribution, whose size is that of [`BandPsf::reaches`].
    pub contribution_offset: usize,
    /// Values from one row of the contribution to the next.
    pub contribution_stride: usize,
}

/// The PSF stage of one band on one GPU, for one stream at a time.
#[derive(Debug)]
pub struct PsfOnDevice {
    device: Arc<Device>,
    frame: Frame,
    grid: NodeGrid,
    kernels: Arc<NodeKernels>,
    partition: Partition,
    budget: Budget,
    functions: Functions,
    tables: CudaSlice<f32>,
    polynomials: CudaSlice<f32>,
    spectra: CudaSlice<f32>,
    base_kernels: CudaSlice<f32>,
    spectrum_pool: LruPool,
    base_kernel_pool: LruPool,
    /// Packed blocks, images, lists.
    scratch: CudaSlice<u32>,
    ring: UploadRing,
}

impl PsfOnDevice {
    /// Minimum of device memory, in bytes, for tiles of `tile_side`.
    pub fn min_bytes(blocks: &Blocks, grid: &NodeGrid, tile_side: usize) -> usize {
        let partition = Partition::for_window(blocks.window);
        Budget::min(&partition, grid, tile_side).bytes(&partition)
    }

    /// The stage of `psf` on `device`, in at most `bytes` of its memory.
    ///
    /// # Errors
    /// Less than [`PsfOnDevice::min_bytes`], or an error of the driver.
    pub fn new(device: &Arc<Device>, frame: &Frame, psf: &BandPsf, bytes: usize) -> Result<Self, CudaError> {
        let (grid, partition) = (psf.grid(), Partition::for_window(psf.blocks().window));
        let budget = Budget::within(bytes, &partition, grid, psf.blocks().tile).map_err(|min| {
            let what = "the PSF stage of one tile".to_owned();
            let (requested_bytes, free_bytes) = (min.bytes(&partition) as u64, bytes as u64);
            let (device, total_bytes) = (device.index(), free_bytes);
            CudaError::OutOfMemory { device, what, requested_bytes, free_bytes, total_bytes }
        })?;
        let stream = device.context.default_stream();
        let allocate = |len: usize, what| device.allocate::<f32>(&stream, len.max(1), what);
        let upload = |values: &[f32], what| {
            let mut to = allocate(values.len(), what)?;
            stream.memcpy_htod(values, &mut to).map_err(device.failed("uploading tables"))?;
            Ok(to)
        };
        let tables = if partition.side == 0 { vec![0.0] } else { partition.tables() };
        let base_kernel_len = partition.window * partition.window;
        let this = Self {
            functions: Functions::load(device, &partition)?,
            tables: upload(&tables, "roots of unity")?,
            polynomials: upload(&[&ATAN[..], &SECANT[..]].concat(), "polynomials")?,
            spectra: allocate(budget.spectra * partition.spectrum_len(), "spectra")?,
            base_kernels: allocate(budget.base_kernels * base_kernel_len, "kernels")?,
            scratch: device.allocate(&stream, 1, "blocks")?,
            ring: UploadRing::new(device)?,
            spectrum_pool: LruPool::new(budget.spectra),
            base_kernel_pool: LruPool::new(budget.base_kernels),
            device: Arc::clone(device),
            frame: *frame,
            grid: grid.clone(),
            kernels: psf.shared_kernels(),
            partition,
            budget,
        };
        stream.synchronize().map_err(device.failed("uploading tables"))?;
        Ok(this)
    }

    /// Computes the `contributions` of `tiles` from their `remapped` values, in the order of `stream`, which must be the same for
    /// all launches of this stage; `timer` times the kernels. Every value of a contribution is set.
    ///
    /// # Errors
    /// An error of the driver; the stage must not be used after it.
    ///
    /// # Panics
    /// If a tile lies beyond `remapped` or `contributions`.
    pub fn launch(
        &mut self,
        stream: &Arc<CudaStream>,
        tiles: &[PsfTile],
        remapped: &CudaSlice<f32>,
        contributions: &mut CudaSlice<f32>,
        timer: &mut KernelTimer<'_>,
    ) -> Result<(), CudaError> {
        for tile in tiles {
            let reach = tile.rect.grown(self.partition.window / 2);
            assert!(
                !tile.rect.is_empty() && tile.remapped_offset + tile.rect.size().pixels() <= remapped.len()
            );
            let last = tile.contribution_offset + (reach.height - 1) * tile.contribution_stride + reach.width;
            assert!(tile.contribution_stride >= reach.width && last <= contributions.len());
        }
        let mut rest = tiles;
        while !rest.is_empty() {
            let start = Instant::now();
            let mut round = self.next_round(rest)?;
            rest = &rest[round.tiles.len()..];
            self.run(stream, &mut round, remapped, contributions, (timer, start))?;
        }
        Ok(())
    }

    /// As many of `tiles` as fit in the scratch memory.
    fn next_round(&self, tiles: &[PsfTile]) -> Result<Round, CudaError> {
        let mut round = Round::default();
        for (i, tile) in tiles.iter().enumerate() {
            round.add(tile, &self.frame, &self.grid, &self.partition);
            let (requested, available) = (round.bytes(&self.partition), self.budget.scratch);
            if requested > available && i == 0 {
                let (device, what) =
                    (self.device.index(), format!("the PSF stage of the tile {}", tile.rect));
                let (requested_bytes, free_bytes) = (requested as u64, available as u64);
                let total_bytes = self.device.info.memory_bytes;
                return Err(CudaError::OutOfMemory {
                    device,
                    what,
                    requested_bytes,
                    free_bytes,
                    total_bytes,
                });
            }
            if requested > available {
                round.truncate(i);
                break;
            }
        }
        Ok(round)
    }

    fn run(
        &mut self,
        stream: &Arc<CudaStream>,
        round: &mut Round,
        remapped: &CudaSlice<f32>,
        contributions: &mut CudaSlice<f32>,
        (timer, start): (&mut KernelTimer<'_>, Instant),
    ) -> Result<(), CudaError> {
        let mut schedule = Schedule {
            grid: &self.grid,
            kernels: &self.kernels,
            partition: &self.partition,
            spectrum_pool: &mut self.spectrum_pool,
            base_kernel_pool: &mut self.base_kernel_pool,
            steps: Vec::new(),
            parts: Vec::new(),
        };
        schedule.add(round);
        let Schedule { steps, parts, .. } = schedule;
        let mut lists = Lists::default();
        let [tiles, blocks, block_images, jobs, weights] = [
            lists.push(&round.tiles),
            lists.push(&round.blocks),
            lists.push(&round.block_images),
            lists.push(&round.jobs),
            lists.push(&round.weights),
        ];
        let parts = lists.push(&parts);
        let (device, partition) = (&self.device, &self.partition);
        let packed_len = round.packed_len(partition);
        let images_len = round.jobs.len() * partition.image_len();
        grow(device, stream, &mut self.scratch, packed_len + images_len + lists.words.len())?;
        let (mut packed, mut rest) = self.scratch.split_at_mut(packed_len);
        let (mut images, mut rest) = rest.split_at_mut(images_len);
        self.ring.upload(device, stream, &lists.words, &mut rest, "uploading lists")?;
        timer.host.descriptors_s += start.elapsed().as_secs_f64();

        let launcher =
            Launcher { device, stream, partition, functions: &self.functions, tables: &self.tables };
        let list = |range: &Range<usize>| rest.slice(range.clone());
        let (rows, cols) = round.max_contribution;
        let tile_grid = (cols.div_ceil(32), rows.div_ceil(8), round.tiles.len() as u32);
        timer.start()?;
        if partition.side == 0 {
            launcher.copy(tile_grid, &list(&tiles), remapped, contributions)?;
            return timer.stop();
        }
        launcher.pack(round.blocks.len(), &list(&blocks), remapped, &self.polynomials, &mut packed)?;
        for step in steps {
            match step {
                ScheduleStep::UploadBaseKernels(nodes) => {
                    timer.stop()?;
                    let (kernels, to) = ((&*self.kernels, &self.grid), &mut self.base_kernels);
                    let upload = || upload_base_kernels(&launcher, kernels, &nodes, to, &mut self.ring);
                    timed(&mut timer.host.base_kernels_s, upload)?;
                    timer.start()?;
                }
                ScheduleStep::Transform(range) => {
                    let parts = list(&sublist::<KernelPart>(&parts, &range));
                    launcher.spectra(range.len(), &parts, &self.base_kernels, &mut self.spectra)?;
                }
                ScheduleStep::Scatter(range) => {
                    let jobs = list(&sublist::<Job>(&jobs, &range));
                    let images = &mut images.slice_mut(range.start * partition.image_len()..);
                    launcher.scatter(
                        range.len(),
                        (&jobs, &list(&weights)),
                        &packed,
                        &self.spectra,
                        images,
                    )?;
                }
            }
        }
        launcher.unfold(round.jobs.len(), &mut images)?;
        launcher.add(tile_grid, (&list(&tiles), &list(&block_images)), &images, contributions)?;
        timer.stop()
    }
}

/// The words of the entries `range` of `list`.
fn sublist<T>(list: &Range<usize>, range: &Range<usize>) -> Range<usize> {
    let words = size_of::<T>() / 4;
    list.start + range.start * words..list.start + range.end * words
}

/// Computes base kernels on all cores and uploads them to their pool entries.
fn upload_base_kernels(
    launcher: &Launcher<'_>,
    (kernels, grid): (&NodeKernels, &NodeGrid),
    nodes: &[(usize, Node)],
    to: &mut CudaSlice<f32>,
    ring: &mut UploadRing,
) -> Result<(), CudaError> {
    let len = launcher.partition.window * launcher.partition.window;
    for nodes in nodes.chunks(BASE_KERNELS_AT_ONCE) {
        let compute =
            |s: &mut KernelScratch, (_, node): &(usize, Node)| kernels.base_kernel(grid, *node, s).to_vec();
        let computed: Vec<Vec<f32>> = nodes.par_iter().map_init(KernelScratch::default, compute).collect();
        for ((entry, _), kernel) in nodes.iter().zip(&computed) {
            let entry = &mut to.slice_mut(entry * len..(entry + 1) * len);
            ring.upload(launcher.device, launcher.stream, kernel, entry, "uploading kernels")?;
        }
    }
    Ok(())
}
