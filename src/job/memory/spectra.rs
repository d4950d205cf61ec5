//! Bytes of one spectrum, and of PSFs that are read on demand.

use pipeline::band::BandPlan;
use pipeline::depth::plan::DepthPlan;
use pipeline::geometry::Frame;

/// Bytes of the largest spectrum of `plan`.
pub(super) fn largest_spectrum(plan: &BandPlan) -> usize {
    let flat = plan.blocks.map_or(0, |b| b.spectrum_bytes());
    let nodes = plan.depth.iter().flat_map(DepthPlan::used);
    nodes.map(|n| n.blocks.spectrum_bytes()).fold(flat, usize::max)
}

/// Bytes of the PSFs of `plan` that are read together, ready for kernels: a depth node's largest, or those of a height.
pub(super) fn largest_psf(plan: &BandPlan) -> usize {
    let of_height = if plan.reads_on_demand() { plan.largest_set_bytes() } else { 0 };
    plan.depth.as_ref().map_or(of_height, DepthPlan::max_psf_bytes)
}

/// Bytes of all PSFs of `plan` that the film of `frame` reads on demand, ready for kernels.
pub(super) fn psfs_on_demand(plan: &BandPlan, frame: &Frame) -> usize {
    let of_band = if plan.reads_on_demand() { plan.kernels_bytes() } else { 0 };
    let of_nodes = |depth: &DepthPlan| {
        let read = plan.tiling.grown().grown(depth.margin());
        depth.kernels_bytes(frame.farthest_mm(read) / frame.pitch_mm())
    };
    plan.depth.as_ref().map_or(of_band, of_nodes)
}
