//! The levels of a band's tails, and the light that is left for its kernels.

use super::{AZIMUTHS, BINS_IN_LEVEL, GROWTH, MAX_BIN_PX, OUT_MARGIN};
use crate::geometry::{Frame, Size};
use crate::layer::BinGrid;
use crate::lens::LensBand;
use crate::lens::PsfStack;
use crate::lens::tail::{BandTail, Coefficients, TERMS, radial};
use crate::psf::blocks::Blocks;
use crate::psf::grid::NodeGrid;
use crate::psf::kernel::NodeKernels;
use crate::simd::Simd;

/// The inner radius of the power laws in bins of level 0, at least.
const BINS_IN_RADIUS: f64 = 2.5;
/// Smallest bin, film pixels: that of layers.
const MIN_BIN_PX: usize = 2;

/// The tails of a band on a film.
#[derive(Clone, Debug)]
pub struct TailPlan {
    /// Coefficients by height, lengths in film pixels: at the heights of the kernels, so that both shares of the light are linear between the same
    /// heights.
    pub(super) coefficients: Vec<Coefficients>,
    /// Heights of the coefficients, mm.
    pub(super) height_mm: Vec<f64>,
    /// Inner radius of level 0, film pixels.
    pub(super) inner_px: f64,
    /// Bin of level 0, film pixels.
    pub(super) bin_px: usize,
    /// Radius of level 1 over that of level 0.
    first_growth: usize,
    /// Number of levels.
    pub(super) levels: usize,
    film: Size,
    pitch_mm: f64,
}

impl TailPlan {
    /// The tails of `band` on the film of `frame`; none if the band has none, or if its window has fewer pixels than bins need.
    pub fn new(frame: &Frame, band: &LensBand) -> Option<Self> {
        let tail = band.tail.as_ref()?;
        let pitch_mm = frame.pitch_mm();
        let inner_px = tail.inner_mm / pitch_mm;
        let bin_px = Self::bin_px_of(inner_px)?;
        let diagonal = crate::real::hypot(frame.film.height as f64, frame.film.width as f64);
        let first_growth = ((BINS_IN_LEVEL * GROWTH * bin_px) as f64 / inner_px).ceil().max(2.0) as usize;
        let mut levels = 1;
        while inner_px * (first_growth * GROWTH.pow(levels as u32 - 1)) as f64 <= diagonal {
            levels += 1;
        }
        Some(Self {
            coefficients: band.psf_height_mm.iter().map(|h| in_pixels(&tail.at(*h), pitch_mm)).collect(),
            height_mm: band.psf_height_mm.clone(),
            inner_px,
            bin_px,
            first_growth,
            levels,
            film: frame.film,
            pitch_mm,
        })
    }

    /// Bin of level 0 for power laws from `inner_px` on, film pixels; none if it would be too small.
    pub fn bin_px_of(inner_px: f64) -> Option<usize> {
        let mut bin = MAX_BIN_PX;
        while bin >= MIN_BIN_PX {
            if BINS_IN_RADIUS * bin as f64 <= inner_px {
                return Some(bin);
            }
            bin /= 2;
        }
        None
    }

    /// Side of the bins of the layer, film pixels.
    pub fn bin_px(&self) -> usize {
        self.bin_px
    }

    /// Half a side of the kernels of a level, bins.
    pub(super) fn half(&self) -> usize {
        // T_l is 0 from R_{l+1} on, as many bins of each level.
        (self.first_growth as f64 * self.inner_px / self.bin_px as f64).ceil() as usize - 1
    }

    /// Bins of the light of level `level`.
    pub(super) fn bins(&self, level: usize) -> BinGrid {
        BinGrid::new(self.film, self.bin_px * GROWTH.pow(level as u32), self.half() + OUT_MARGIN)
    }

    /// Heights of the nodes of `level`, as indices of the table: all of level 0, every other one and the last of the others.
    pub(super) fn heights(&self, level: usize) -> Vec<usize> {
        let last = self.height_mm.len() - 1;
        (0..=last).filter(|k| level == 0 || k.is_multiple_of(2) || *k == last).collect()
    }

    /// The nodes of `level`.
    pub(super) fn grid(&self, level: usize) -> NodeGrid {
        let heights: Vec<f64> = self.heights(level).iter().map(|k| self.height_mm[*k]).collect();
        let azimuths: Vec<usize> = (0..heights.len()).map(|k| if k == 0 { 1 } else { AZIMUTHS }).collect();
        NodeGrid::new(&heights, &azimuths, self.pitch_mm * self.bins(level).bin_px as f64)
    }

    /// Factor of the power law `j` of level `level` over that of the last level with kernels of its own, 0 or 1.
    pub(super) fn factor(level: usize, j: usize) -> f64 {
        // Area of the bins over the power q = 3 + 2 j of the distance.
        (GROWTH as f64).powi((2 - 3 - 2 * j as i32) * level.saturating_sub(1) as i32)
    }

    /// Sums over the bins of level `level`, 0 or 1, of b² [B_0j(r; R_l) − B_0j(r; R_{l+1})].
    fn sums(&self, level: usize) -> [f64; TERMS] {
        let (half, b) = (self.half() as i64, self.bins(level).bin_px as f64);
        std::array::from_fn(|j| {
            let places = (-half..=half).flat_map(|y| (-half..=half).map(move |x| (y, x)));
            places
                .map(|(y, x)| {
                    let r = b * ((y * y + x * x) as f64).sqrt();
                    b * b * self.compact(level, r, 0, j)
                })
                .sum()
        })
    }

    /// B_mj(r; R_l) − B_mj(r; R_{l+1}) of level `level`, 0 or 1, at `r` film pixels.
    pub(super) fn compact(&self, level: usize, r: f64, m: usize, j: usize) -> f64 {
        let first = self.first_growth as f64 * self.inner_px;
        let (inner, outer) = if level == 0 { (self.inner_px, first) } else { (first, GROWTH as f64 * first) };
        if r >= outer {
            return 0.0;
        }
        radial(r, inner, m, j) - radial(r, outer, m, j)
    }

    /// Share of the light of a field point with coefficients `c` from level `first` on, 1 or more.
    fn share_from(&self, c: &Coefficients, first: usize) -> f64 {
        let sums = self.sums(1);
        // A geometric series over the levels.
        (0..TERMS).map(|j| c[0][j] * sums[j] * Self::factor(first, j) / (1.0 - Self::factor(2, j))).sum()
    }

    /// Sums of the near kernels at `height_mm`: all light less that of T.
    pub fn near_shares(&self, tail: &BandTail, height_mm: &[f64]) -> Vec<f64> {
        let of_first = self.sums(0);
        let share = |h: &f64| {
            let c = in_pixels(&tail.at(*h), self.pitch_mm);
            let first: f64 = (0..TERMS).map(|j| c[0][j] * of_first[j]).sum();
            1.0 - first - self.share_from(&c, 1)
        };
        height_mm.iter().map(share).collect()
    }

    /// The near kernels of the PSFs `stack` of `band`, which this plan is of.
    ///
    /// # Panics
    /// The band has no tail.
    pub fn near_kernels(&self, stack: &PsfStack, band: &LensBand, simd: Simd) -> NodeKernels {
        let tail = band.tail.as_ref().expect("the plan is of a band with a tail");
        let shares = self.near_shares(tail, &band.psf_height_mm);
        let tables = (tail, &band.psf_height_mm[..], &band.psf_energy[..]);
        NodeKernels::near(stack, tables, shares, 1e3 * self.pitch_mm, simd)
    }

    /// FFT blocks of all levels: their kernels have the same size.
    pub(super) fn blocks(&self) -> Blocks {
        Blocks::choose(2 * self.half() + 1, &self.grid(0))
    }

    /// Bytes while the layer is computed, its result included, without the source of its light.
    pub fn making_bytes(&self) -> usize {
        let nodes = |level: usize| self.grid(level).len();
        let spectra = self.blocks().spectrum_bytes() * nodes(0).max(3 * nodes(1));
        // Light, and sums over blocks, which are larger by a window.
        let light = self.bins(0).size().pixels();
        let ends = 2 * self.half();
        let size = self.bins(0).size();
        4 * (2 * light + (size.height + ends) * (size.width + ends)) + spectra
    }

    /// Core seconds of the layer, about, without the reading of the light: 25 ns a sample of the light and 60 a bin of level 0.
    pub fn making_s(&self) -> f64 {
        1e-9 * self.bins(0).size().pixels() as f64 * (4.0 * 25.0 + 60.0)
    }

    /// Share of the light beyond the last level, on the axis.
    pub(super) fn rest(&self) -> f64 {
        self.share_from(&self.coefficients[0], self.levels)
    }
}

/// Coefficients in mm and mm³ as those in pixels.
fn in_pixels(c: &Coefficients, pitch_mm: f64) -> Coefficients {
    c.map(|[third, fifth]| [third / pitch_mm, fifth / pitch_mm.powi(3)])
}
