//! How the film is cut for SVPSF: FFT side F, block side v = F − n + 1, tile side. Fixed functions of the window n, the
//! node grid and the film, never of memory, threads or timing: so the film has the same bits however it is made.

use crate::psf::grid::NodeGrid;

/// FFT sides: multiples of 32 (16 columns in lanes, halves of the right-angle transform) with factors 2, 3, 5.
/// Second: relative cost of one transformed pixel, forward with multiply-accumulate; the inverse costs about 1.3 of it.
const FFT_SIDES: [(usize, f64); 15] = [
    (64, 1.00),
    (96, 1.02),
    (128, 1.03),
    (160, 1.05),
    (192, 1.05),
    (256, 1.15),
    (320, 1.30),
    (384, 1.40),
    (480, 1.60),
    (512, 1.65),
    (640, 1.80),
    (768, 1.90),
    (960, 2.10),
    (1024, 2.20),
    (1280, 2.50),
];

/// The inverse transform, in units of one node's forward transform and multiply-accumulate.
const INVERSE: f64 = 1.3;

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
    /// Windows up to 601 px have one; a window of 1 needs no transform and has F = 0.
    pub fn choose(window: usize, grid: &NodeGrid) -> Self {
        if window == 1 {
            return Self { window, fft: 0, block: TILE_SIDE, tile: TILE_SIDE };
        }
        let cost = |fft: usize, factor: f64| {
            let block = (fft - window + 1) as f64;
            let area = (fft * fft) as f64 / (block * block);
            (mean_nodes(grid, block) + INVERSE) * factor * area
        };
        let (fft, _) = FFT_SIDES
            .iter()
            .filter(|(fft, _)| *fft >= 2 * window)
            .min_by(|a, b| cost(a.0, a.1).total_cmp(&cost(b.0, b.1)))
            .expect("windows are checked at the door");
        let block = fft - window + 1;
        Self { window, fft: *fft, block, tile: block * (TILE_SIDE / block).max(1) }
    }

    /// The widest kernel that has an FFT side.
    pub const fn widest_window() -> usize {
        FFT_SIDES[FFT_SIDES.len() - 1].0 / 2 - 1
    }

    /// Multiply-adds of the direct sum per pixel over those of this cut: for the curious.
    pub fn f32s_of_spectrum(&self) -> usize {
        self.fft * (self.fft / 2) * 2
    }
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
