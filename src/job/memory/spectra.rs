//! Bytes of one spectrum, and of PSFs of depth nodes.

use pipeline::band::BandPlan;
use pipeline::depth::plan::DepthPlan;

/// Bytes of the largest spectrum of `plan`.
pub(super) fn largest_spectrum(plan: &BandPlan) -> usize {
    let flat = plan.blocks.map_or(0, |b| b.spectrum_bytes());
    let nodes = plan.depth.iter().flat_map(DepthPlan::used);
    nodes.map(|n| n.blocks.spectrum_bytes()).fold(flat, usize::max)
}

/// Bytes of the largest PSF of a depth node of `plan`, ready for kernels.
pub(super) fn largest_psf(plan: &BandPlan) -> usize {
    plan.depth.as_ref().map_or(0, DepthPlan::max_psf_bytes)
}

/// Bytes of all PSFs of depth nodes of `plan`, ready for kernels.
pub(super) fn psfs_on_demand(plan: &BandPlan) -> usize {
    plan.depth.as_ref().map_or(0, DepthPlan::kernels_bytes)
}
