//! Share of a film's light that comes from invented surfaces ([`super::hidden`]), per block of pixels.
//!
//! ```text
//! share = Σ invented light/Σ light                     over the pixels of a block of a shard, 0 where there is no light
//! ```
//! Tiles add their invented light; a shard's light is that of its pixels when it is complete. The sum over the tiles of a block is in their order, so its bits do
//! not depend on threads.

use crate::buffer::ShardPixels;
use crate::geometry::{Rect, Size};
use crate::tiling::{FilmRegion, ShardId};
use std::collections::BTreeMap;
use std::sync::Mutex;

/// Side of a block, px, unless shards have a side that it does not divide.
const BLOCK_PX: usize = 64;

/// Invented light of tiles whose shards are not complete.
#[derive(Debug)]
pub struct InventedLight {
    regions: Vec<FilmRegion>,
    shards: Mutex<BTreeMap<ShardId, Sums>>,
}

/// Sums of light by block of the shard, and first row and column of the tile.
type Sums = BTreeMap<(usize, i64, i64), f64>;

/// Light of a shard.
#[derive(Clone, Debug, PartialEq)]
pub struct InventedShares {
    /// Invented share of every block, row by row.
    pub shares: Vec<f32>,
    /// Sum of the shard's pixels.
    pub light: f64,
    /// Of it, invented.
    pub invented: f64,
}

/// Side of the blocks of an array with shards of `shard` px.
pub fn block_px(shard: Size) -> usize {
    let divisor = |a: usize, b: usize| (1..=a).rev().find(|d| a.is_multiple_of(*d) && b.is_multiple_of(*d));
    divisor(BLOCK_PX, shard.height).and_then(|side| divisor(side, shard.width)).unwrap_or(1)
}

impl InventedLight {
    /// Of the film regions `regions`.
    pub fn new(regions: &[FilmRegion]) -> Self {
        Self { regions: regions.to_vec(), shards: Mutex::default() }
    }

    /// Adds the invented light of `tile` of the band at `position` of the job.
    pub(super) fn add(&self, position: usize, tile: Rect, light: &[f32]) {
        for (region, of_region) in self.regions.iter().enumerate() {
            let side = block_px(of_region.shard);
            let common = of_region.rect.intersect(tile);
            if common.is_empty() {
                continue;
            }
            let mut sums: BTreeMap<ShardId, BTreeMap<usize, f64>> = BTreeMap::new();
            for y in common.y..common.bottom() {
                for x in common.x..common.right() {
                    let v = light[(y - tile.y) as usize * tile.width + (x - tile.x) as usize];
                    if v == 0.0 {
                        continue;
                    }
                    let (row, col) = ((y - of_region.rect.y) as usize, (x - of_region.rect.x) as usize);
                    let shard = of_region.shard;
                    let id = ShardId { position, region, row: row / shard.height, col: col / shard.width };
                    let width = of_region.shard_rect(id.row, id.col).width.div_ceil(side);
                    let block = row % shard.height / side * width + col % shard.width / side;
                    *sums.entry(id).or_default().entry(block).or_default() += f64::from(v);
                }
            }
            let mut shards = self.shards.lock().expect("no panic while held");
            for (id, blocks) in sums {
                let of_shard = shards.entry(id).or_default();
                of_shard.extend(blocks.into_iter().map(|(block, sum)| ((block, tile.y, tile.x), sum)));
            }
        }
    }

    /// The light of shard `id`, which is complete and has `pixels`; its sums are removed.
    pub fn of_shard(&self, id: ShardId, pixels: &ShardPixels) -> InventedShares {
        let sums = self.shards.lock().expect("no panic while held").remove(&id).unwrap_or_default();
        let side = block_px(self.regions[id.region].shard);
        let size = pixels.size();
        let (rows, columns) = (size.height.div_ceil(side), size.width.div_ceil(side));
        let mut light = vec![0f64; rows * columns];
        for y in 0..size.height {
            for (x, part) in pixels.row(y).chunks(side).enumerate() {
                light[y / side * columns + x] += part.iter().map(|v| f64::from(*v)).sum::<f64>();
            }
        }
        let mut invented = vec![0f64; rows * columns];
        for ((block, _, _), sum) in sums {
            invented[block] += sum;
        }
        let share = |(light, invented): (&f64, &f64)| {
            // Sums over FFT blocks leave rounding of either sign where there is none.
            if *light == 0.0 { 0.0 } else { (invented / light).max(0.0) as f32 }
        };
        let shares = std::iter::zip(&light, &invented).map(share).collect();
        InventedShares { shares, light: light.iter().sum(), invented: invented.iter().sum() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_divide_shards() {
        let side = |h, w| block_px(Size::new(h, w));
        assert_eq!([side(2048, 2048), side(256, 96), side(100, 200), side(101, 64)], [64, 32, 4, 1]);
    }

    #[test]
    fn shares_are_those_of_the_blocks_of_a_region() {
        // A region whose blocks two tiles share.
        let region = FilmRegion { rect: Rect::new(30, 40, 100, 130), shard: Size::new(64, 128) };
        let light = InventedLight::new(&[region]);
        for tile in [Rect::new(0, 64, 64, 128), Rect::new(0, 0, 64, 64)] {
            light.add(3, tile, &vec![0.5; tile.size().pixels()]);
        }
        let id = |row, col| ShardId { position: 3, region: 0, row, col };
        let of = |row, col, value: f32| {
            let size = region.shard_rect(row, col).size();
            let mut pixels = ShardPixels::new(size);
            pixels.reach(size.height, Vec::new);
            (0..size.height).for_each(|y| pixels.row_mut(y).fill(value));
            light.of_shard(id(row, col), &pixels)
        };
        // Film rows 30 to 63 of rows 30 to 93; all columns.
        let first = of(0, 0, 2.0);
        let share = 0.25 * 34.0 / 64.0;
        assert_eq!(first.shares, [share as f32; 2]);
        assert_eq!((first.invented, first.light), (0.5 * 34.0 * 128.0, 2.0 * 64.0 * 128.0));
        assert_eq!(of(0, 1, 1.0).shares, [(0.5 * 34.0 / 64.0) as f32]);
        assert_eq!(of(1, 0, 1.0).shares, [0.0; 2]);
        assert_eq!(of(0, 0, 2.0).shares, [0.0; 2], "removed");
    }
}
