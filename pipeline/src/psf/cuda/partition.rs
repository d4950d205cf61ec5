//! Partition of kernels and tiles on the GPU: a fixed function of the window, so that sums depend on nothing else.
//!
//! A transform has a side of 128 (one thread block) or of 256 (four thread blocks, a slice of the spectrum each: `psf.cu`). A
//! kernel too wide for them is divided into `parts` × `parts`, each of which acts as a separate kernel whose output is offset
//! down and right. The partition with the fewest warp instructions is taken; these were counted in the machine code for compute
//! capability 9.0, for each stage between two barriers. There are no direct sums: with the shares given they take 4·n² multiply-adds
//! a pixel, n²/8 warp instructions, more than the 16 of a 51-px window's transforms from n = 11 on; below n = 11 the transforms
//! (8 a pixel and more) are limited by the transfer.

use crate::psf::blocks::{Blocks, TILE_SIDE};
use crate::real;
use std::f64::consts::TAU;

/// Threads of a transform.
pub(super) const THREADS: u32 = 512;
/// Source rows that a thread fetches at once; the height of a packed block is a multiple of 8 of them.
pub(super) const ROW_GROUP: usize = 5;
/// Complex values of a slice.
const POINTS: usize = 8192;

/// Nodes of a block assumed by the cost: 4.6 at 78 px on 21 heights × 36 azimuths.
const NODES: f64 = 5.0;

/// The partition of a band into tiles for a GPU, where `blocks` is that of the CPU: the side of a tile is a multiple of the GPU's block, so
/// that all blocks are full but those at the border of the film.
pub fn gpu_blocks(blocks: &Blocks) -> Blocks {
    match Partition::for_window(blocks.window) {
        Partition { side: 0, .. } => *blocks,
        Partition { block, .. } => Blocks { tile: block * (TILE_SIDE / block).max(1), ..*blocks },
    }
}

/// The partition for one window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Partition {
    /// Side n of the kernels.
    pub window: usize,
    /// Side of a transform; 0 for a window of 1, which needs none.
    pub side: usize,
    /// Kernel parts in either direction.
    pub parts: usize,
    /// Side of a part; the last ones may be smaller.
    pub part: usize,
    /// Maximum side of a block of remapped pixels: `side` − `part` + 1.
    pub block: usize,
}

impl Partition {
    /// The partition with the fewest instructions for kernels of `window` pixels.
    pub fn for_window(window: usize) -> Self {
        if window == 1 {
            return Self { window, side: 0, parts: 1, part: 1, block: 1 };
        }
        let candidates = [128, 256].into_iter().flat_map(|side| {
            let parts = (1..=window.min(8)).filter(move |parts| window.div_ceil(*parts) <= side * 7 / 8);
            parts.map(move |parts| Self::new(window, side, parts))
        });
        let cheapest = candidates.min_by(|a, b| a.instructions().total_cmp(&b.instructions()));
        cheapest.expect("windows are checked before: at most 8 parts of 224")
    }

    fn new(window: usize, side: usize, parts: usize) -> Self {
        let part = window.div_ceil(parts);
        Self { window, side, parts: window.div_ceil(part), part, block: side - part + 1 }
    }

    /// Warp instructions per remapped pixel, in blocks of maximum side.
    pub fn instructions(&self) -> f64 {
        // Instructions of a warp in each stage: weighting (constant, and per source row), remaining stages along y, along x, last stage
        // with product; stages of the inverse.
        let (weight, row, along_y, along_x, product, inverse) = match self.side {
            128 => (193.0, 12.0, 91.0, 310.0, 230.0, [125.0, 275.0, 86.0, 173.0]),
            _ => (109.0, 12.0, 90.0, 310.0, 255.0, [190.0, 275.0, 86.0, 91.0]),
        };
        let (width, rows) = (packed_width(self.block) as f64, (self.height(self.block) / 8) as f64);
        let (columns, first) = (width / 4.0, (POINTS / self.side / 8) as f64);
        let node =
            columns * (weight + row * rows) + columns * first / 8.0 * along_y + 16.0 * (along_x + product);
        let inverse =
            16.0 * (inverse[0] + inverse[1]) + 32.0 * inverse[2] + (self.side / 4) as f64 * inverse[3];
        let all = (self.slices() * self.images()) as f64 * (NODES * node + inverse);
        all / (self.block * self.block) as f64
    }

    /// Thread blocks that share a transform.
    pub(super) fn slices(&self) -> usize {
        if self.side == 128 { 1 } else { 4 }
    }

    /// Number of kernel parts, and so of images of a node group and of spectra of a node.
    pub(super) fn images(&self) -> usize {
        self.parts * self.parts
    }

    /// Values of an image.
    pub(super) fn image_len(&self) -> usize {
        self.side * self.side
    }

    /// Values of a node's spectra, all parts.
    pub(super) fn spectrum_len(&self) -> usize {
        if self.side == 0 { 0 } else { 2 * POINTS * self.slices() * self.images() }
    }

    /// Dynamic shared memory of a transform: `Shared` in `transform.cuh`.
    pub(super) fn shared_bytes(&self) -> u32 {
        let (rows, last, fold) = (POINTS / self.side, self.side / 16, self.side / 8);
        let complex = rows * (self.side + self.side / 16) + last * 18 + rows + fold;
        (8 * complex + 32 * 3) as u32
    }

    /// Rows of a packed block of `rows` rows.
    pub(super) fn height(&self, rows: usize) -> usize {
        rows.next_multiple_of(8 * ROW_GROUP).min(self.side)
    }

    /// Division of `length` pixels of a tile into equal blocks: their number and side (the last may be smaller).
    pub(super) fn blocks(&self, length: usize) -> (usize, usize) {
        let side = length.div_ceil(length.div_ceil(self.block));
        (length.div_ceil(side), side)
    }

    /// Roots of unity in the order that `transform.cuh` reads: along_y and fold of every slice, then along_x; (cos, sin) each.
    pub(super) fn tables(&self) -> Vec<f32> {
        let side = self.side as f64;
        let mut table = Vec::new();
        let mut root = |cycles: f64| {
            let (sin, cos) = real::sin_cos(-TAU * cycles);
            table.extend([cos as f32, sin as f32]);
        };
        let first = POINTS / self.side / 8;
        for slice in 0..self.slices() {
            let row = |k: usize| 2.0 * (self.slices() * k + slice) as f64 - 0.5;
            for j in 0..8 {
                (0..first).for_each(|k| root(j as f64 * row(k) / side));
            }
            (0..self.side / 8).for_each(|i| root((8 * i) as f64 * row(0) / side));
        }
        for j in 0..self.side / 16 {
            (0..16).for_each(|p| root((j * p) as f64 / side));
        }
        table
    }
}

/// Columns of a packed block of `cols` columns: each half warp then stays within a row, without bank conflicts.
pub(super) fn packed_width(cols: usize) -> usize {
    cols.next_multiple_of(16)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn partitions_of_common_windows_equal_the_counted_choice() {
        let partitions = [3, 51, 101, 151, 201, 401, 639].map(|n| {
            let partition = Partition::for_window(n);
            (partition.side, partition.parts, partition.block)
        });
        let expected = [
            (128, 1, 126),
            (128, 1, 78),
            (256, 1, 156),
            (256, 1, 106),
            (256, 2, 156),
            (256, 3, 123),
            (256, 4, 97),
        ];
        assert_eq!(partitions, expected);
    }

    #[test]
    fn tiles_of_a_gpu_are_multiples_of_its_block() {
        let tile = |window| gpu_blocks(&Blocks { window, fft: 192, block: 142, tile: 426 }).tile;
        assert_eq!([51, 151, 401].map(tile), [6 * 78, 4 * 106, 4 * 123]);
        let copied = Blocks { window: 1, fft: 0, block: 512, tile: 512 };
        assert_eq!(gpu_blocks(&copied), copied);
    }

    /// The numbers of `static_assert` in `transform.cuh`.
    #[test]
    fn shared_memory_is_the_size_of_shared_in_transform_cuh() {
        assert_eq!([51, 101].map(|n| Partition::for_window(n).shared_bytes()), [71_520, 72_544]);
    }

    #[test]
    fn every_window_has_a_partition_that_fits_the_transform() {
        for window in 2..=crate::psf::blocks::Blocks::widest_window() {
            let partition = Partition::for_window(window);
            assert!(
                partition.block + partition.part - 1 <= partition.side
                    && partition.height(partition.block) >= partition.block
            );
            assert!(
                partition.parts * partition.part >= window && (partition.parts - 1) * partition.part < window,
                "{partition:?}"
            );
            for length in [1, 100, partition.block, 511] {
                let (count, side) = partition.blocks(length);
                assert!(side <= partition.block && count * side >= length && (count - 1) * side < length);
            }
        }
    }
}
