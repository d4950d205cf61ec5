//! Core seconds of the tiles of a band, on a 2.2 GHz Xeon with AVX-512.

use pipeline::band::BandPlan;
use pipeline::depth::plan::{DepthPlan, NodePlan};
use pipeline::stage::Stages;
use pipeline::stages::described;

/// Reading and decoding, remap, overlap-add, encoding, writing: 50.7 + 18.4 + 7.6 + 22.2 + 4.1 core seconds for
/// 31 bands of 14141² px, store to store, a chart with 1 % noise.
const OTHER_STAGES_NS: f64 = 16.6;
/// Pixels of `tiles`.
fn pixels(plan: &BandPlan, tiles: &[(usize, usize)]) -> usize {
    tiles.iter().map(|&t| plan.tiling.rect(t).size().pixels()).sum()
}

/// Convolutions of a tile of one slab: its light and share on two nodes, and e of both. At one distance the light alone is computed.
const ONE_SLAB: f64 = 6.0;
/// Share of the transforms of a model of all FFT blocks that are computed: others are 0, or nothing behind is visible. As counted on a scene of a phone
/// (scripts/bench, depth).
const COMPUTED: f64 = 0.64;
/// Convolutions of each of several slabs in an FFT block that has surfaces of it: light and share on two nodes.
const OWN_SLAB: f64 = 4.0 * COMPUTED;
/// In a block that reaches pixels where the slab is needed: known and missing share, e of a node.
const REACHED_SLAB: f64 = 3.0 * COMPUTED;
/// Chart and distances of a slab, remapped, ns per pixel of a tile with its margin.
const REMAP_OF_A_SLAB_NS: f64 = 22.0;
/// Invented surfaces, ns per pixel of a tile with its margin.
const INVENTED_NS: f64 = 220.0;
/// Correction of two surfaces out of focus, ns per pixel of a tile and slab that it sees.
const CORRECTED_SLAB_NS: f64 = 700.0;

/// Core seconds of a tile of a depth stage: convolutions at the mean cost of the nodes, with their kernels; remap; correction.
fn depth_tile_s(plan: &BandPlan, depth: &DepthPlan, tile: (usize, usize)) -> f64 {
    let pixels = plan.tiling.rect(tile).size().pixels() as f64;
    let grown = plan.tiling.rect(tile).grown(depth.margin()).size().pixels() as f64;
    let of_node = |n: &NodePlan| n.blocks.cost_ns(&n.grid);
    let convolution_ns = depth.used().map(of_node).sum::<f64>() / depth.used().count() as f64;
    let work = depth.tile_work[tile.0 * plan.tiling.count().1 + tile.1];
    let convolutions = match work.slabs {
        0 | 1 => ONE_SLAB,
        _ => OWN_SLAB * work.own + REACHED_SLAB * work.reached,
    };
    let invented_ns = if work.may_invent { INVENTED_NS } else { 0.0 };
    let remap_ns = REMAP_OF_A_SLAB_NS * work.slabs as f64 + invented_ns;
    1e-9 * ((convolutions * convolution_ns + remap_ns) * grown + OTHER_STAGES_NS * pixels)
        + tile_correction_s(plan, depth, tile)
}

/// Core seconds of the correction of a tile.
fn tile_correction_s(plan: &BandPlan, depth: &DepthPlan, tile: (usize, usize)) -> f64 {
    let work = depth.tile_work[tile.0 * plan.tiling.count().1 + tile.1];
    1e-9 * CORRECTED_SLAB_NS * work.corrected * plan.tiling.rect(tile).size().pixels() as f64
}

/// The part of [`core_s`] that corrects surfaces out of focus.
pub fn correction_s(plan: &BandPlan, tiles: &[(usize, usize)]) -> f64 {
    plan.depth.iter().flat_map(|depth| tiles.iter().map(|tile| tile_correction_s(plan, depth, *tile))).sum()
}

/// Seconds of one core with `stages`.
pub fn core_s(plan: &BandPlan, stages: Stages, tiles: &[(usize, usize)]) -> f64 {
    if let Some(depth) = &plan.depth {
        return tiles.iter().map(|tile| depth_tile_s(plan, depth, *tile)).sum();
    }
    let costs = || described(stages).map(|stage| (stage.cost)(plan));
    let (pixel_ns, band_s) =
        (costs().map(|c| c.pixel_ns).sum::<f64>(), costs().map(|c| c.band_s).sum::<f64>());
    pixels(plan, tiles) as f64 * (pixel_ns + OTHER_STAGES_NS) * 1e-9 + band_s
}
