//! Order of work of a round: uploads and transforms of kernels whose spectra are not in their pool, and jobs.

use super::descriptors::KernelPart;
use super::lru_pool::LruPool;
use super::partition::Partition;
use super::round::Round;
use crate::psf::grid::{Node, NodeGrid};
use crate::psf::kernel::NodeKernels;
use std::ops::Range;

/// A step of a round.
#[derive(Debug)]
pub(super) enum ScheduleStep {
    /// Upload of base kernels to these entries of their pool.
    UploadBaseKernels(Vec<(usize, Node)>),
    /// Transform of a range of kernel parts.
    Transform(Range<usize>),
    /// A range of jobs.
    Scatter(Range<usize>),
}

/// Schedule of one round.
#[derive(Debug)]
pub(super) struct Schedule<'a> {
    pub(super) grid: &'a NodeGrid,
    pub(super) kernels: &'a NodeKernels,
    pub(super) partition: &'a Partition,
    pub(super) spectrum_pool: &'a mut LruPool,
    pub(super) base_kernel_pool: &'a mut LruPool,
    /// Steps in order.
    pub(super) steps: Vec<ScheduleStep>,
    /// Kernel parts to be transformed.
    pub(super) parts: Vec<KernelPart>,
}

impl Schedule<'_> {
    /// Assigns pool entries to the spectra of `round` and appends its steps.
    pub(super) fn add(&mut self, round: &mut Round) {
        let (mut jobs, mut new) = (0..0, Vec::new());
        self.spectrum_pool.unpin_all();
        for i in 0..round.groups.len() {
            let (group_jobs, weights) = round.group(i);
            if !self.acquire_spectra(round, weights.clone(), &mut new) {
                self.push_transforms(&mut new);
                self.steps.push(ScheduleStep::Scatter(jobs.clone()));
                jobs = group_jobs.start..group_jobs.start;
                self.spectrum_pool.unpin_all();
                let acquired = self.acquire_spectra(round, weights, &mut new);
                assert!(acquired, "the pool holds at least one node group");
            }
            jobs.end = group_jobs.end;
        }
        self.push_transforms(&mut new);
        self.steps.push(ScheduleStep::Scatter(jobs));
    }

    /// Pool entries for the nodes of `weights`; false if too few are free. Appends nodes with a new entry to `new`.
    fn acquire_spectra(
        &mut self,
        round: &mut Round,
        weights: Range<usize>,
        new: &mut Vec<(Node, usize)>,
    ) -> bool {
        for i in weights {
            let node = round.nodes[i];
            let Some(entry) = self.spectrum_pool.acquire(self.grid.id(node)) else { return false };
            round.weights[i].spectrum = (entry.index * self.partition.images()) as u32;
            if entry.is_new {
                new.push((node, entry.index));
            }
        }
        true
    }

    /// Appends the steps that compute the spectra of `new`, and their kernel parts.
    fn push_transforms(&mut self, new: &mut Vec<(Node, usize)>) {
        let Partition { window, parts, part, .. } = *self.partition;
        let images = self.partition.images();
        let (mut base_kernels, mut start) = (Vec::new(), self.parts.len());
        self.base_kernel_pool.unpin_all();
        for (node, index) in new.drain(..) {
            let symmetry = self.kernels.symmetry_of(self.grid, node);
            let id = self.grid.id(symmetry.base);
            let entry = self.base_kernel_pool.acquire(id).unwrap_or_else(|| {
                self.steps.push(ScheduleStep::UploadBaseKernels(std::mem::take(&mut base_kernels)));
                self.steps.push(ScheduleStep::Transform(start..self.parts.len()));
                start = self.parts.len();
                self.base_kernel_pool.unpin_all();
                self.base_kernel_pool.acquire(id).expect("the pool holds at least one base kernel")
            });
            if entry.is_new {
                base_kernels.push((entry.index, symmetry.base));
            }
            self.parts.extend((0..images).map(|i| KernelPart {
                base: (entry.index * window * window) as u32,
                transposed: symmetry.transposed.into(),
                quarter_turns: symmetry.quarter_turns as u32,
                y: (i / parts * part) as u32,
                x: (i % parts * part) as u32,
                rows: part.min(window - i / parts * part) as u32,
                cols: part.min(window - i % parts * part) as u32,
                spectrum: (index * images + i) as u32,
            }));
        }
        if start < self.parts.len() {
            let transform = ScheduleStep::Transform(start..self.parts.len());
            self.steps.extend([ScheduleStep::UploadBaseKernels(base_kernels), transform]);
        }
    }
}
