//! Bounds of the stages in memory, and the share of them that is reached.
//!
//! Remap: every pixel is read and written at least once, bound [px/s] = rate of copying [B/s] / 8 B, measured on buffers larger than the
//! caches. SVPSF: one real transform forward and one back per block of v² pixels, 2 · 2.5 F² log₂ F² operations (the usual count of a
//! radix-2 transform, half of it for real input), at the multiply-add peak of all threads. The weights and products of the nodes are left
//! out, which are most of the work where a block meets many nodes, and so is the peak's second operation that a transform cannot use.

use super::{Bench, median};
use anyhow::Result;
use pipeline::psf::blocks::Blocks;
use std::time::Instant;

/// Bytes copied per thread and round.
const COPY_BYTES: usize = 128 << 20;
/// Bytes read and written per pixel.
const PIXEL_BYTES: f64 = 8.0;

/// Adds the rate of copying and the shares of the bounds that remap and SVPSF reach; `blocks` are those of the lens.
pub(super) fn measure(bench: &mut Bench<'_>, blocks: &Blocks) -> Result<()> {
    let rate = copy_mb_s(bench);
    bench.add_number("memory_mb_s", rate, "MB/s", "memory, copying on all threads: read and written");
    let share = bench.get("remap_mpx_s") * PIXEL_BYTES / rate;
    bench.add_number("remap_of_bound", share, "", "  RI + distortion remap, share of that bound");
    if blocks.fft > 0 {
        let (area, kept) = ((blocks.fft as f64).powi(2), (blocks.block as f64).powi(2));
        let per_pixel = 2.0 * 2.5 * area * area.log2() / kept;
        let bound = bench.get("fma_gflop_s") * 1e3 * bench.threads as f64 / per_pixel;
        let share = bench.get("svpsf_lens_mpx_s") / bound;
        bench.add_number(
            "svpsf_of_bound",
            share,
            "",
            "  SVPSF of the lens, share of its transforms at the peak",
        );
    }
    Ok(())
}

fn copy_mb_s(bench: &Bench<'_>) -> f64 {
    let megabytes = 2.0 * (bench.threads * COPY_BYTES) as f64 * 1e-6;
    let mut buffers: Vec<(Vec<u8>, Vec<u8>)> =
        (0..bench.threads).map(|_| (vec![1; COPY_BYTES], vec![2; COPY_BYTES])).collect();
    let rates = (0..bench.rounds).map(|_| {
        let start = Instant::now();
        std::thread::scope(|scope| {
            for (from, to) in &mut buffers {
                scope.spawn(|| to.copy_from_slice(std::hint::black_box(from)));
            }
        });
        megabytes / start.elapsed().as_secs_f64()
    });
    median(rates.collect())
}
