//! Estimated cost of the tiles of a band, for dividing a job into units and for schedulers.
//!
//! Core seconds on a 2.2 GHz Xeon with AVX-512: SVPSF by its cost model ([`pipeline::psf::blocks::Blocks::cost_ns`]), the other stages as
//! measured on the paper's job (scripts/bench). Bytes are those before compression.

use crate::job::Job;
use crate::job::layers::JobLayer;
use pipeline::band::BandPlan;
use pipeline::depth::plan::{DepthPlan, NodePlan};
use pipeline::remap::Remap;
use pipeline::stage::Stages;
use pipeline::stages::described;

/// Reading and decoding, remap, overlap-add, encoding, writing: 50.7 + 18.4 + 7.6 + 22.2 + 4.1 core seconds for
/// 31 bands of 14141² px, store to store, a chart with 1 % noise.
const OTHER_STAGES_NS: f64 = 16.6;
/// Tiles on a GPU at a time: two batches.
const GPU_TILES: usize = 2 * 16;

/// Rounded to milliseconds, the precision of the estimate.
pub fn rounded(seconds: f64) -> f64 {
    (seconds * 1e3).round() / 1e3
}

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

/// Core seconds of a tile of a depth stage: convolutions at the mean cost of the nodes, with their kernels; remap.
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

/// Bytes of chart read for `tiles` (row by row); what two rows of tiles share is counted once.
pub fn bytes_read(job: &Job, band: usize, tiles: &[(usize, usize)]) -> u64 {
    let sample = job.chart.sample_bytes();
    let plan = &job.plans[band];
    let options = &job.options;
    let remap = Remap::new(
        &job.frame,
        &plan.lens,
        options.stages,
        options.interpolation,
        job.gains[band],
        options.simd,
    );
    let (mut all, mut end) = (0, 0);
    for row in tiles.chunk_by(|a, b| a.0 == b.0) {
        let of = |tile| remap.approx_chart_rect(job.chart.size(), plan.tiling.rect(tile));
        let (first, last) = (of(row[0]), of(row[row.len() - 1]));
        let rows = first.y.min(last.y).max(end)..first.bottom().max(last.bottom());
        let width = (last.right() - first.x.min(last.x)).max(0);
        all += (rows.end - rows.start).max(0) * width;
        end = rows.end.max(end);
    }
    all as u64 * sample as u64
}

/// Reading and decoding a chart pixel for a layer of light, ns: the 50.7 core seconds above.
const READING_NS: f64 = 8.2;

/// Bytes of chart that the layers of a band read before its tiles, and core seconds of computing them.
pub fn layers(job: &Job) -> (u64, f64) {
    let pixels = job.chart.size().pixels();
    let of = |layer: &dyn JobLayer| layer.making_s() + 1e-9 * READING_NS * pixels as f64;
    let core_s = job.layers.iter().map(|layer| of(layer.as_ref())).sum();
    ((job.layers.len() * pixels * job.chart.sample_bytes()) as u64, core_s)
}

/// Bytes on a GPU: the spectra of all nodes near the tiles, and two batches with chart, remapped image and contribution.
pub fn gpu_bytes(plan: &BandPlan, tiles: &[(usize, usize)]) -> u64 {
    let (down, across) = plan.tiling.count();
    let share = tiles.len() as f64 / (down * across) as f64;
    let spectra = plan.blocks.zip(plan.grid.as_ref()).map_or(0, |(b, g)| b.spectrum_bytes() * g.len());
    let side = plan.tiling.tile() + 2 * plan.tiling.margin();
    let tile = 4 * (side * side + 2 * plan.tiling.tile().pow(2));
    (share * spectra as f64) as u64 + (GPU_TILES.min(tiles.len()) * tile) as u64
}
