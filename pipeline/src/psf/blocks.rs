//! Partition of the film for SVPSF: FFT size F, block side v = F − n + 1, tile side.
//!
//! Functions of the window n and the node grid only, never of memory, threads or timing, so the film has the same bits however it
//! is computed.

use crate::geometry::Size;
use crate::psf::grid::{NodeGrid, PolarNodes, Positions};

/// FFT sizes, multiples of 32 (16 columns per register, halves of the right-angle transform) with factors 2, 3 and 5, and the cost of
/// one transformed pixel in ns: per node (weight, forward, multiply, accumulate) for a block that fills the transform, and per block
/// (pack, inverse, add). Measured with AVX-512 on a 2.2 GHz Xeon: the minimum over many runs of one block that touches two nodes,
/// and four. Above 256 a group of rows exceeds L1, above 896 a spectrum exceeds L2. The figures of 192 and 256 include 8 % and that
/// of 384 4 % found on complete films, where spectra are read from beyond L2.
const FFT_SIDES: [(usize, f64, f64); 15] = [
    (64, 0.63, 0.95),
    (96, 0.70, 0.95),
    (128, 0.70, 1.15),
    (160, 0.88, 1.35),
    (192, 0.86, 1.20),
    (256, 0.98, 1.40),
    (320, 1.27, 1.40),
    (384, 1.50, 1.60),
    (480, 1.68, 1.90),
    (512, 1.68, 1.90),
    (640, 2.10, 2.20),
    (768, 2.15, 2.30),
    (960, 2.30, 3.70),
    (1024, 2.40, 3.90),
    (1280, 2.90, 4.10),
];

/// Share of a node's cost that is proportional to the columns of the block (weighting, transform along y).
const ALONG_Y: f64 = 0.55;

/// Cost of a node's spectrum relative to one pass of a node over a transform: measured 0.76 at F = 128, 0.50 at 320. A spectrum is
/// built about once per film; a fine grid has one per 60,000 pixels. (The cost of a kernel does not depend on F.)
const SPECTRUM: f64 = 0.7;

/// Upper bound of a tile's side, px, unless one block is larger: the buffers of a tile stay in the caches.
pub(super) const TILE_SIDE: usize = 512;

/// Bytes of the copies of a block, each with the weights of a node, that a SIMD engine transforms together: with its other buffers in an L2 of 512 KiB.
/// Measured with AVX-512 and a node per 15,000 px: 81 Mpx/s with one node at a time, 88 with 256 KiB, 86 with 512 KiB and 1 MiB.
pub(super) const BATCH_BYTES: usize = 256 << 10;

/// The partition of one band.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Blocks {
    /// Side n of the kernels, odd.
    pub window: usize,
    /// FFT size F.
    pub fft: usize,
    /// Block side v = F − n + 1: remapped pixels per FFT.
    pub block: usize,
    /// Tile side, a multiple of `block`.
    pub tile: usize,
}

impl Blocks {
    /// The partition of least cost for kernels of `window` pixels, at most [`Blocks::widest_window`], on `grid`, averaged over the disc
    /// of the grid's heights, or its rectangle. A window of 1 needs no transform and has F = 0.
    pub fn choose(window: usize, grid: &NodeGrid) -> Self {
        if window == 1 {
            return Self { window, fft: 0, block: TILE_SIDE, tile: TILE_SIDE };
        }
        Self::cheapest(window, |side| cost_ns(window, grid, side))
    }

    /// The partition of least cost for sums of `images` images, each with its kernel of `window` pixels, of blocks of all of `areas`.
    ///
    /// # Panics
    /// A window above [`Blocks::widest_window`].
    pub fn of_images(window: usize, images: usize, areas: &[Size]) -> Self {
        let cost = |&(fft, image, once): &(usize, f64, f64)| {
            let block = fft - window + 1;
            let blocks: usize =
                areas.iter().map(|area| area.height.div_ceil(block) * area.width.div_ceil(block)).sum();
            (blocks * fft * fft) as f64 * (images as f64 * image + once)
        };
        Self::cheapest(window, cost)
    }

    /// The partition for kernels of `window` pixels with the FFT size, of those that are wide enough, of least `cost`.
    fn cheapest(window: usize, cost: impl Fn(&(usize, f64, f64)) -> f64) -> Self {
        let wide_enough = FFT_SIDES.iter().filter(|(fft, ..)| *fft >= 2 * window);
        let cheapest = wide_enough.min_by(|a, b| cost(a).total_cmp(&cost(b)));
        let fft = cheapest.expect("BandPlan::new checks the window").0;
        let block = fft - window + 1;
        Self { window, fft, block, tile: block * (TILE_SIDE / block).max(1) }
    }

    /// Mean cost of a remapped pixel on one core over the disc of `grid`'s heights, or its rectangle, ns, spectra included.
    pub fn cost_ns(&self, grid: &NodeGrid) -> f64 {
        // A window of 1 is a copy: negligible beside the other stages.
        FFT_SIDES
            .iter()
            .find(|(fft, ..)| *fft == self.fft)
            .map_or(0.0, |side| cost_ns(self.window, grid, side))
    }

    /// The largest window that has an FFT size, px.
    pub const fn widest_window() -> usize {
        FFT_SIDES[FFT_SIDES.len() - 1].0 / 2 - 1
    }

    /// Bytes of one node's spectrum in the larger layout, that of the portable engine: F × (F/2 + 1) complex f32.
    pub const fn spectrum_bytes(&self) -> usize {
        8 * self.fft * (self.fft / 2 + 1)
    }
}

/// Cost of a remapped pixel with the FFT size and costs `side`, ns.
fn cost_ns(window: usize, grid: &NodeGrid, &(fft, node, once): &(usize, f64, f64)) -> f64 {
    let density = match grid {
        NodeGrid::Polar(nodes) => {
            let heights = nodes.heights_px();
            grid.len() as f64 / (std::f64::consts::PI * heights[heights.len() - 1].powi(2))
        }
        NodeGrid::Cartesian(nodes) => 1.0 / (nodes.x().step_px() * nodes.y().step_px()),
    };
    let (block, area) = ((fft - window + 1) as f64, (fft * fft) as f64);
    let weighed = node * (1.0 - ALONG_Y + ALONG_Y * block / fft as f64);
    let scattering = (mean_nodes(grid, block) * weighed + once) * area / (block * block);
    scattering + density * SPECTRUM * node * area
}

/// Mean number of nodes whose weight is above 0 in a square of `side` px: an interval of length s meets s/d + 2 nodes of spacing d.
fn mean_nodes(grid: &NodeGrid, side: f64) -> f64 {
    match grid {
        NodeGrid::Polar(nodes) => mean_polar_nodes(nodes, side),
        NodeGrid::Cartesian(nodes) => {
            let along = |nodes: &Positions| (side / nodes.step_px() + 2.0).min(nodes.count() as f64);
            along(nodes.x()) * along(nodes.y())
        }
    }
}

/// The mean over the disc by area with eight rings per height step; s = 1.27 side is the mean width of a square over all directions.
fn mean_polar_nodes(nodes: &PolarNodes, side: f64) -> f64 {
    let heights = nodes.heights_px();
    let width = 1.27 * side;
    let (mut sum, mut area) = (0.0, 0.0);
    for k in 1..heights.len() {
        let step = heights[k] - heights[k - 1];
        let count = nodes.azimuths()[k] as f64;
        for i in 0..8 {
            let r = heights[k - 1] + step * (f64::from(i) + 0.5) / 8.0;
            let radial = (width / step + 2.0).min(heights.len() as f64);
            let spacing = std::f64::consts::TAU * r / count;
            let around = (width / spacing + 2.0).min(count);
            sum += radial * around * r * step;
            area += r * step;
        }
    }
    sum / area
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fft_size_grows_with_the_window_and_falls_with_grid_density() {
        let fft = |window: usize, heights: usize, azimuths: usize| {
            let height_mm: Vec<f64> = (0..heights).map(|k| 20.0 * k as f64 / (heights - 1) as f64).collect();
            let mut counts = vec![azimuths; heights];
            counts[0] = 1;
            Blocks::choose(window, &NodeGrid::new(&height_mm, &counts, 2e-3)).fft
        };
        let sides = [11, 25, 51, 101, 151, 401].map(|window| fft(window, 21, 36));
        assert_eq!(sides, [64, 128, 192, 256, 320, 960]);
        let finer = [(21, 36), (41, 72), (81, 144)].map(|(heights, azimuths)| fft(51, heights, azimuths));
        assert_eq!(finer, [192, 128, 128]);
    }

    #[test]
    fn tile_side_is_a_multiple_of_the_block_side() {
        let grid = NodeGrid::new(&[0.0, 20.0], &[1, 4], 2e-3);
        for window in 1..=401 {
            let blocks = Blocks::choose(window, &grid);
            assert!(blocks.tile.is_multiple_of(blocks.block) && blocks.fft.is_multiple_of(32));
        }
    }
}
