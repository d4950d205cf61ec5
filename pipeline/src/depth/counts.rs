//! Transforms of the depth stage, counted, and those of its model.
//!
//! ```text
//! model per FFT block of K nodes:  2 K + 1 for a tile at one distance,  5 K + 3 for each slab of the other tiles
//! ```
//! light on two nodes with one inverse; light, share and known light with an inverse each.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Counts of one worker or of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Tiles with surfaces.
    pub tiles: u64,
    /// Their slabs.
    pub slabs: u64,
    /// Forward transforms: one per block and node.
    pub forward: u64,
    /// Inverse transforms: one per block.
    pub inverse: u64,
    /// FFT blocks of tiles at one distance.
    pub blocks_of_one: u64,
    /// FFT blocks of the other tiles, each times the slabs of its tile.
    pub blocks_of_several: u64,
}

impl Counts {
    /// Nodes of a block, the mean.
    pub fn nodes(&self) -> f64 {
        self.forward as f64 / (self.inverse as f64).max(1.0)
    }

    /// Transforms as a share of those of the model.
    pub fn of_model(&self) -> f64 {
        let k = self.nodes();
        let model =
            self.blocks_of_one as f64 * (2.0 * k + 1.0) + self.blocks_of_several as f64 * (5.0 * k + 3.0);
        (self.forward + self.inverse) as f64 / model.max(1.0)
    }

    /// Slabs of a tile, the mean.
    pub fn slabs_of_a_tile(&self) -> f64 {
        self.slabs as f64 / (self.tiles as f64).max(1.0)
    }
}

/// Counts that workers add to.
#[derive(Debug, Default)]
pub struct SharedCounts([AtomicU64; 6]);

impl SharedCounts {
    /// Adds the counts of a tile.
    pub(super) fn add(&self, c: Counts) {
        let values = [c.tiles, c.slabs, c.forward, c.inverse, c.blocks_of_one, c.blocks_of_several];
        for (sum, value) in std::iter::zip(&self.0, values) {
            sum.fetch_add(value, Relaxed);
        }
    }

    /// The sums.
    pub fn sum(&self) -> Counts {
        let [tiles, slabs, forward, inverse, blocks_of_one, blocks_of_several] =
            std::array::from_fn(|i| self.0[i].load(Relaxed));
        Counts { tiles, slabs, forward, inverse, blocks_of_one, blocks_of_several }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_model_of_four_nodes() {
        let counts =
            Counts { tiles: 2, slabs: 3, forward: 80, inverse: 20, blocks_of_one: 1, blocks_of_several: 4 };
        assert_eq!(counts.nodes(), 4.0);
        assert!((counts.of_model() - 100.0 / (9.0 + 4.0 * 23.0)).abs() < 1e-12);
        let shared = SharedCounts::default();
        (0..2).for_each(|_| shared.add(counts));
        assert_eq!((shared.sum().forward, shared.sum().slabs_of_a_tile()), (160, 1.5));
    }
}
