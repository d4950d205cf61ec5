//! How the GPU cuts kernels and tiles: a fixed function of the window, so that sums depend on nothing else.
//!
//! A transform has a side of 128 (one thread block) or of 256 (four thread blocks, a slice of the spectrum each: `psf.cu`). A
//! kernel too wide for them is cut into `parts` × `parts`, each of which acts as a kernel of its own whose light lands farther
//! down and right. The cheapest by counted warp instructions is taken; these were read from the machine code for compute capability
//! 9.0, a stage between two barriers at a time. Direct sums would take 4·n² multiply-adds a pixel, n²/8 warp instructions with the
//! shares ready: more than the 16 of a 51-px window's transforms from n = 11 on, and less below only where the transforms
//! (8 a pixel and more) already outrun any bus, so there are none.

use crate::real;
use std::f64::consts::TAU;

/// Threads of a transform.
pub(super) const THREADS: u32 = 512;
/// Source rows that a thread fetches together; the height of a packed block is a multiple of 8 of them.
pub(super) const GROUP: usize = 5;
/// Complex values of a slice.
const POINTS: usize = 8192;

/// Nodes of a block that the rule reckons with: 4.6 at 78 px on 21 heights × 36 azimuths.
const NODES: f64 = 5.0;

/// The cut for one window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cut {
    /// Side n of the kernels.
    pub window: usize,
    /// Side of a transform; 0 for a window of 1, which scatters nothing.
    pub side: usize,
    /// Kernel parts in either direction.
    pub parts: usize,
    /// Side of a part; the last ones may be smaller.
    pub part: usize,
    /// The largest block of the remapped image: `side` − `part` + 1.
    pub block: usize,
}

impl Cut {
    /// The cheapest cut for kernels of `window` pixels.
    pub fn choose(window: usize) -> Self {
        if window == 1 {
            return Self { window, side: 0, parts: 1, part: 1, block: 1 };
        }
        let candidates = [128, 256].into_iter().flat_map(|side| {
            let parts = (1..=window.min(8)).filter(move |parts| window.div_ceil(*parts) <= side * 7 / 8);
            parts.map(move |parts| Self::of(window, side, parts))
        });
        let cheapest = candidates.min_by(|a, b| a.instructions().total_cmp(&b.instructions()));
        cheapest.expect("windows are checked at the door: at most 8 parts of 224")
    }

    fn of(window: usize, side: usize, parts: usize) -> Self {
        let part = window.div_ceil(parts);
        Self { window, side, parts: window.div_ceil(part), part, block: side - part + 1 }
    }

    /// Warp instructions a pixel of remapped, if blocks are whole.
    pub fn instructions(&self) -> f64 {
        // Of a warp in each stage: weighing (without and per source row), the rest along y, along x, last with product; back.
        let (weigh, row, along_y, along_x, product, back) = match self.side {
            128 => (193.0, 12.0, 91.0, 310.0, 230.0, [125.0, 275.0, 86.0, 173.0]),
            _ => (109.0, 12.0, 90.0, 310.0, 255.0, [190.0, 275.0, 86.0, 91.0]),
        };
        let (width, rows) = (packed_width(self.block) as f64, (self.height(self.block) / 8) as f64);
        let (columns, first) = (width / 4.0, (POINTS / self.side / 8) as f64);
        let node =
            columns * (weigh + row * rows) + columns * first / 8.0 * along_y + 16.0 * (along_x + product);
        let inverse = 16.0 * (back[0] + back[1]) + 32.0 * back[2] + (self.side / 4) as f64 * back[3];
        let all = (self.slices() * self.images()) as f64 * (NODES * node + inverse);
        all / (self.block * self.block) as f64
    }

    /// Thread blocks that share a transform.
    pub(super) fn slices(&self) -> usize {
        if self.side == 128 { 1 } else { 4 }
    }

    /// Kernel parts, each of which has an image and a spectrum of its own.
    pub(super) fn images(&self) -> usize {
        self.parts * self.parts
    }

    /// Values of an image.
    pub(super) fn image_len(&self) -> usize {
        self.side * self.side
    }

    /// Values of a node's spectrum, all parts.
    pub(super) fn spectrum_len(&self) -> usize {
        if self.side == 0 { 0 } else { 2 * POINTS * self.slices() * self.images() }
    }

    /// Dynamic shared memory of a transform: `Shared` in `psf.cu`.
    pub(super) fn shared_bytes(&self) -> u32 {
        let (rows, last, fold) = (POINTS / self.side, self.side / 16, self.side / 8);
        let complex = rows * (self.side + self.side / 16) + last * 18 + rows + fold;
        (8 * complex + 32 * 3) as u32
    }

    /// Rows of a packed block of `rows` rows.
    pub(super) fn height(&self, rows: usize) -> usize {
        rows.next_multiple_of(8 * GROUP).min(self.side)
    }

    /// A tile's side of `length` pixels as equal blocks: how many, and their side (the last may be smaller).
    pub(super) fn blocks(&self, length: usize) -> (usize, usize) {
        let side = length.div_ceil(length.div_ceil(self.block));
        (length.div_ceil(side), side)
    }

    /// Roots of unity as `psf.cu` reads them: along_y and fold of every slice, along_x; (cos, sin) each.
    pub(super) fn tables(&self) -> Vec<f32> {
        let side = self.side as f64;
        let mut table = Vec::new();
        let mut root = |turns: f64| {
            let (sin, cos) = real::sin_cos(-TAU * turns);
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

/// Columns of a packed block of `cols` columns: half warps then stay within a row, and out of one another's banks.
pub(super) fn packed_width(cols: usize) -> usize {
    cols.next_multiple_of(16)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cuts_follow_the_window() {
        let cuts = [3, 51, 101, 151, 201, 401, 639].map(|n| {
            let cut = Cut::choose(n);
            (cut.side, cut.parts, cut.block)
        });
        let want = [
            (128, 1, 126),
            (128, 1, 78),
            (256, 1, 156),
            (256, 1, 106),
            (256, 2, 156),
            (256, 3, 123),
            (256, 4, 97),
        ];
        assert_eq!(cuts, want);
    }

    #[test]
    fn every_window_has_a_cut_whose_light_fits_the_transform() {
        for window in 2..=crate::psf::blocks::Blocks::widest_window() {
            let cut = Cut::choose(window);
            assert!(cut.block + cut.part - 1 <= cut.side && cut.height(cut.block) >= cut.block);
            assert!(cut.parts * cut.part >= window && (cut.parts - 1) * cut.part < window, "{cut:?}");
            for length in [1, 100, cut.block, 511] {
                let (count, side) = cut.blocks(length);
                assert!(side <= cut.block && count * side >= length && (count - 1) * side < length);
            }
        }
    }
}
