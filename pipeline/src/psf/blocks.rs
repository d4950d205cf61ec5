//! How the film is cut for SVPSF: FFT side F, block side v = F − n + 1, tile side. Fixed functions of the window n, the
//! node grid and the film, never of memory, threads or timing: so the film has the same bits however it is made.

use crate::psf::grid::NodeGrid;

/// FFT sides: multiples of 32 (16 columns in lanes, halves of the right-angle transform) with factors 2, 3, 5, and what
/// one transformed pixel costs, in ns: once per node (weigh, forward, multiply, accumulate) if the block filled the
/// transform, and once per block (pack, inverse, add). Measured with AVX-512 on a 2.2 GHz Xeon: the least of many runs
/// of one block that meets two nodes, and four. Past 256 a group of rows outgrows L1, past 896 a spectrum L2.
/// 192 and 256 carry 8 % more than that, 384 4 %, by what whole films showed: there spectra come from beyond L2.
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

/// The part of a node's cost that falls with the columns that a block leaves empty: weighing and the transform along y.
const ALONG_Y: f64 = 0.55;

/// What a node's spectrum costs, in passes of a node over a whole transform: measured 0.76 at F = 128, 0.50 at 320. Each is
/// built once or so for the whole film; a fine grid has one for every 60,000 pixels. (A kernel's cost is the same for all F.)
const SPECTRUM: f64 = 0.7;

/// Tiles are whole blocks, as many as fit in this side (at least one): their buffers stay in the caches.
const TILE_SIDE: usize = 512;

/// The cut of one band.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Blocks {
    /// Side n of the kernels, odd.
    pub window: usize,
    /// FFT side F.
    pub fft: usize,
    /// Block side v = F − n + 1: source pixels of one FFT.
    pub block: usize,
    /// Tile side, a multiple of `block`.
    pub tile: usize,
}

impl Blocks {
    /// The cheapest cut for kernels of `window` pixels on `grid`, judged over the whole disc of the grid's heights.
    /// Windows up to [`Blocks::widest_window`] have one; a window of 1 needs no transform and has F = 0.
    pub fn choose(window: usize, grid: &NodeGrid) -> Self {
        if window == 1 {
            return Self { window, fft: 0, block: TILE_SIDE, tile: TILE_SIDE };
        }
        let cost = |side: &&(usize, f64, f64)| cost_ns(window, grid, side);
        let wide_enough = FFT_SIDES.iter().filter(|(fft, ..)| *fft >= 2 * window);
        let cheapest = wide_enough.min_by(|a, b| cost(a).total_cmp(&cost(b)));
        let fft = cheapest.expect("windows are checked at the door").0;
        let block = fft - window + 1;
        Self { window, fft, block, tile: block * (TILE_SIDE / block).max(1) }
    }

    /// What a source pixel costs on one core, ns, spectra included: the mean over the disc of `grid`'s heights.
    pub fn cost_ns(&self, grid: &NodeGrid) -> f64 {
        // A window of 1 is one multiplication, nothing beside the other stages.
        FFT_SIDES
            .iter()
            .find(|(fft, ..)| *fft == self.fft)
            .map_or(0.0, |side| cost_ns(self.window, grid, side))
    }

    /// The widest kernel that has an FFT side.
    pub const fn widest_window() -> usize {
        FFT_SIDES[FFT_SIDES.len() - 1].0 / 2 - 1
    }

    /// Bytes of one node's spectrum in the larger layout, the portable one: F × (F/2 + 1) complex f32.
    pub const fn spectrum_bytes(&self) -> usize {
        8 * self.fft * (self.fft / 2 + 1)
    }
}

/// What a source pixel costs with the FFT side `side`, ns.
fn cost_ns(window: usize, grid: &NodeGrid, &(fft, node, once): &(usize, f64, f64)) -> f64 {
    let heights = grid.heights_px();
    let density = grid.len() as f64 / (std::f64::consts::PI * heights[heights.len() - 1].powi(2));
    let (block, area) = ((fft - window + 1) as f64, (fft * fft) as f64);
    let weighed = node * (1.0 - ALONG_Y + ALONG_Y * block / fft as f64);
    let scattering = (mean_nodes(grid, block) * weighed + once) * area / (block * block);
    scattering + density * SPECTRUM * node * area
}

/// Mean number of nodes that have a share in a square of `side` px: an interval of length s touches s/d + 2 tents of
/// spacing d; averaged over the disc by area, eight rings per height step; s = 1.27 side is a square's mean shadow.
fn mean_nodes(grid: &NodeGrid, side: f64) -> f64 {
    let heights = grid.heights_px();
    let shadow = 1.27 * side;
    let (mut sum, mut area) = (0.0, 0.0);
    for k in 1..heights.len() {
        let step = heights[k] - heights[k - 1];
        let count = grid.azimuths()[k] as f64;
        for i in 0..8 {
            let r = heights[k - 1] + step * (f64::from(i) + 0.5) / 8.0;
            let radial = (shadow / step + 2.0).min(heights.len() as f64);
            let spacing = std::f64::consts::TAU * r / count;
            let around = (shadow / spacing + 2.0).min(count);
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
    fn sides_follow_window_and_grid() {
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
    fn tiles_are_whole_blocks() {
        let grid = NodeGrid::new(&[0.0, 20.0], &[1, 4], 2e-3);
        for window in 1..=401 {
            let blocks = Blocks::choose(window, &grid);
            assert!(blocks.tile.is_multiple_of(blocks.block) && blocks.fft.is_multiple_of(32));
        }
    }
}
