//! What the device does for a batch, made before its launch by another thread: the lists of descriptors, the order of the kernels, and the
//! base kernels that are not in their pool.
//!
//! The pools of spectra and base kernels are followed on the host in the order of the batches, so batches must be launched in the order in
//! which they were planned. Descriptors of tiles and base kernels are computed on all cores.

use super::budget::Budget;
use super::descriptors::{Job, KernelPart};
use super::lru_pool::LruPool;
use super::partition::Partition;
use super::round::Round;
use super::schedule::{Schedule, ScheduleStep};
use super::tile::PsfTile;
use crate::cuda::CudaError;
use crate::cuda::kernel_timer::{HostTimes, timed};
use crate::geometry::Frame;
use crate::psf::BandPsf;
use crate::psf::grid::{Node, NodeGrid};
use crate::psf::kernel::{KernelScratch, NodeKernels};
use bytemuck::Pod;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// Plans the batches of one band on one GPU.
#[derive(Debug)]
pub struct PsfPlanner {
    /// Of the device.
    device: usize,
    frame: Frame,
    grid: NodeGrid,
    kernels: Arc<NodeKernels>,
    partition: Partition,
    budget: Budget,
    spectrum_pool: LruPool,
    base_kernel_pool: LruPool,
}

/// A planned batch.
#[derive(Debug)]
pub struct PsfPlan {
    pub(super) rounds: Vec<PlannedRound>,
    pub(super) budget: Budget,
    /// Number of remapped values and of values of contributions that the tiles take.
    pub(super) remapped_len: usize,
    pub(super) contributions_len: usize,
    /// Time of the host.
    pub host: HostTimes,
}

impl PsfPlan {
    /// Number of spectra of kernel parts that it builds.
    pub fn spectra(&self) -> u64 {
        let steps = self.rounds.iter().flat_map(|round| &round.steps);
        let built = |step: &PlannedStep| match step {
            PlannedStep::Transform(count, _) => *count as u64,
            _ => 0,
        };
        steps.map(built).sum()
    }
}

/// As many tiles of a batch as fit in the scratch memory.
#[derive(Debug)]
pub(super) struct PlannedRound {
    /// All lists, for one upload.
    pub(super) words: Vec<u32>,
    pub(super) tiles: Range<usize>,
    pub(super) blocks: Range<usize>,
    pub(super) block_images: Range<usize>,
    pub(super) weights: Range<usize>,
    pub(super) steps: Vec<PlannedStep>,
    /// Number of tiles, blocks and jobs.
    pub(super) count: (usize, usize, usize),
    /// Words of packed blocks and of images.
    pub(super) packed_len: usize,
    pub(super) images_len: usize,
    /// Maximum rows and columns of a contribution.
    pub(super) max_contribution: (u32, u32),
}

/// A step of a round.
#[derive(Debug)]
pub(super) enum PlannedStep {
    /// Uploads of base kernels, each to consecutive entries of their pool from this one on.
    UploadBaseKernels(Vec<(usize, Vec<f32>)>),
    /// Transform of so many kernel parts, which are in these words.
    Transform(usize, Range<usize>),
    /// A range of jobs, which are in these words.
    Scatter(Range<usize>, Range<usize>),
}

/// Lists of descriptors, concatenated for one upload. Each starts at a multiple of 16 bytes.
#[derive(Debug, Default)]
struct Lists {
    words: Vec<u32>,
}

impl Lists {
    /// Appends a list; its range of words.
    fn push<T: Pod>(&mut self, list: &[T]) -> Range<usize> {
        let start = self.words.len();
        self.words.extend_from_slice(bytemuck::cast_slice(list));
        let end = self.words.len();
        self.words.resize(end.next_multiple_of(4), 0);
        start..end
    }
}

impl PsfPlanner {
    /// For `psf` on the device of this index, tiles of `tile_side` at most, in at most `bytes` of its memory.
    ///
    /// # Errors
    /// Less than [`super::PsfOnDevice::min_bytes`].
    pub fn new(
        device: usize,
        frame: &Frame,
        psf: &BandPsf,
        tile_side: usize,
        bytes: usize,
    ) -> Result<Self, CudaError> {
        let (grid, partition) = (psf.grid(), Partition::for_window(psf.blocks().window));
        let budget = Budget::within(bytes, &partition, grid, tile_side)
            .map_err(|min| too_small(device, "the PSF stage of one tile", min.bytes(&partition), bytes))?;
        Ok(Self {
            device,
            frame: *frame,
            grid: grid.clone(),
            kernels: psf.shared_kernels(),
            partition,
            budget,
            spectrum_pool: LruPool::new(budget.spectra, grid.len()),
            base_kernel_pool: LruPool::new(budget.base_kernels, grid.len()),
        })
    }

    /// Plans a batch.
    ///
    /// # Errors
    /// A tile needs more memory than there is.
    pub fn plan(&mut self, tiles: &[PsfTile]) -> Result<PsfPlan, CudaError> {
        let tail = self.partition.window - 1;
        let (mut remapped_len, mut contributions_len) = (0, 0);
        for tile in tiles {
            let (rows, columns) = (tile.rect.height + tail, tile.rect.width + tail);
            assert!(!tile.rect.is_empty() && tile.contribution_stride >= columns);
            remapped_len = remapped_len.max(tile.remapped_offset + tile.rect.size().pixels());
            contributions_len = contributions_len
                .max(tile.contribution_offset + (rows - 1) * tile.contribution_stride + columns);
        }
        let mut host = HostTimes::default();
        let rounds = timed(&mut host.descriptors_s, || self.rounds(tiles))?;
        let rounds = rounds.into_iter().map(|round| self.schedule(round, &mut host)).collect();
        Ok(PsfPlan { rounds, budget: self.budget, remapped_len, contributions_len, host })
    }

    /// The tiles in rounds that fit in the scratch memory.
    fn rounds(&self, tiles: &[PsfTile]) -> Result<Vec<Round>, CudaError> {
        let round_of = |tile: &PsfTile| {
            let mut round = Round::default();
            round.add(tile, &self.frame, &self.grid, &self.partition);
            round
        };
        let of_tiles: Vec<Round> = tiles.par_iter().map(round_of).collect();
        let mut rounds: Vec<Round> = Vec::new();
        for (tile, round) in tiles.iter().zip(of_tiles) {
            let (bytes, available) = (round.bytes(&self.partition), self.budget.scratch);
            if bytes > available {
                let what = format!("the PSF stage of the tile {}", tile.rect);
                return Err(too_small(self.device, &what, bytes, available));
            }
            match rounds.last_mut() {
                Some(last) if last.bytes(&self.partition) + bytes <= available => last.append(round),
                _ => rounds.push(round),
            }
        }
        Ok(rounds)
    }

    /// Assigns entries of the pools, and computes the base kernels that are not in theirs.
    fn schedule(&mut self, mut round: Round, host: &mut HostTimes) -> PlannedRound {
        let (lists, steps) = timed(&mut host.descriptors_s, || {
            let mut schedule = Schedule {
                grid: &self.grid,
                kernels: &self.kernels,
                partition: &self.partition,
                spectrum_pool: &mut self.spectrum_pool,
                base_kernel_pool: &mut self.base_kernel_pool,
                steps: Vec::new(),
                parts: Vec::new(),
            };
            schedule.add(&mut round);
            let Schedule { steps, parts, .. } = schedule;
            let mut lists = Lists::default();
            let ranges = [
                lists.push(&round.tiles),
                lists.push(&round.blocks),
                lists.push(&round.block_images),
                lists.push(&round.jobs),
                lists.push(&round.weights),
                lists.push(&parts),
            ];
            ((lists.words, ranges), steps)
        });
        let (words, [tiles, blocks, block_images, jobs, weights, parts]) = lists;
        let mut planned = |step| match step {
            ScheduleStep::UploadBaseKernels(nodes) => {
                PlannedStep::UploadBaseKernels(timed(&mut host.base_kernels_s, || self.base_kernels(&nodes)))
            }
            ScheduleStep::Transform(range) => {
                PlannedStep::Transform(range.len(), sublist::<KernelPart>(&parts, &range))
            }
            ScheduleStep::Scatter(range) => {
                let words = sublist::<Job>(&jobs, &range);
                PlannedStep::Scatter(range, words)
            }
        };
        let steps = steps.into_iter().map(&mut planned).collect();
        PlannedRound {
            words,
            count: (round.tiles.len(), round.blocks.len(), round.jobs.len()),
            packed_len: round.packed_len(&self.partition),
            images_len: round.jobs.len() * self.partition.image_len(),
            max_contribution: round.max_contribution,
            tiles,
            blocks,
            block_images,
            weights,
            steps,
        }
    }

    /// The base kernels of `nodes`, each with its first entry.
    fn base_kernels(&self, nodes: &[(usize, Node)]) -> Vec<(usize, Vec<f32>)> {
        let compute = |s: &mut KernelScratch, &(entry, node): &(usize, Node)| {
            (entry, self.kernels.base_kernel(&self.grid, node, s).to_vec())
        };
        joined(nodes.par_iter().map_init(KernelScratch::default, compute).collect())
    }
}

/// `kernels` by their entries, those of consecutive entries as one: new entries follow one another until the pool is full, so that a batch has
/// one upload of base kernels.
fn joined(mut kernels: Vec<(usize, Vec<f32>)>) -> Vec<(usize, Vec<f32>)> {
    kernels.sort_unstable_by_key(|(entry, _)| *entry);
    let consecutive = kernels.chunk_by(|(a, _), (b, _)| a + 1 == *b);
    consecutive.map(|run| (run[0].0, run.iter().map(|(_, k)| &k[..]).collect::<Vec<_>>().concat())).collect()
}

/// `requested` bytes for `what`, of which there are `available`.
fn too_small(device: usize, what: &str, requested: usize, available: usize) -> CudaError {
    let (requested_bytes, free_bytes) = (requested as u64, available as u64);
    CudaError::OutOfMemory {
        device,
        what: what.to_owned(),
        requested_bytes,
        free_bytes,
        total_bytes: free_bytes,
    }
}

/// The words of the entries `range` of `list`.
fn sublist<T>(list: &Range<usize>, range: &Range<usize>) -> Range<usize> {
    let words = size_of::<T>() / 4;
    list.start + range.start * words..list.start + range.end * words
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kernels_of_consecutive_entries_are_one_upload() {
        let kernel = |entry: usize| (entry, vec![entry as f32, -(entry as f32)]);
        let all = joined([5, 3, 9, 4].map(kernel).to_vec());
        assert_eq!(all, [(3, vec![3.0, -3.0, 4.0, -4.0, 5.0, -5.0]), kernel(9)]);
        assert_eq!(joined(Vec::new()), []);
    }
}
