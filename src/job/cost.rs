//! Estimated cost of the tiles of a band, for dividing a job into units and for schedulers.
//!
//! Core seconds on a 2.2 GHz Xeon with AVX-512: SVPSF by its cost model ([`pipeline::psf::blocks::Blocks::cost_ns`]), the other stages as
//! measured on the paper's job (scripts/bench). Bytes are those before compression.

use crate::job::Job;
use crate::job::layers::JobLayer;
pub use crate::job::tile_cost::core_s;
use pipeline::band::BandPlan;
use pipeline::remap::Remap;

/// Tiles on a GPU at a time: two batches.
const GPU_TILES: usize = 2 * 16;

/// Rounded to milliseconds, the precision of the estimate.
pub fn rounded(seconds: f64) -> f64 {
    (seconds * 1e3).round() / 1e3
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

/// Reading and decoding a chart pixel for a layer of light, ns: the 50.7 core seconds of `tile_cost`.
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
