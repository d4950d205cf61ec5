//! The levels of a band's tails, and the light that is left for its kernels.

use super::convolution::row_stride;
use super::harmonics::{KERNELS, on_axis};
use super::middle;
use super::{BINS_IN_LEVEL, GROWTH, MAX_BIN_PX, OUT_MARGIN};
use crate::geometry::{Frame, Size};
use crate::layer::BinGrid;
use crate::lens::LensBand;
use crate::lens::PsfStack;
use crate::lens::linear;
use crate::lens::middle::Middle;
use crate::lens::tail::{BandTail, Coefficients, TERMS, radial};
use crate::psf::blocks::Blocks;
use crate::psf::kernel::NodeKernels;
use crate::real;
use crate::simd::Simd;

/// The inner radius of the power laws in bins of level 0, at least.
const BINS_IN_RADIUS: f64 = 2.5;
/// Smallest bin, film pixels: that of layers.
const MIN_BIN_PX: usize = 2;

/// Mean over the places u of a bin of (u + 1) u (u − 1) (u − 2)/24: what the interpolation of a function between bins, or its transpose, takes from it in units of its fourth
/// derivative.
const MEAN_BLUR: f64 = 11.0 / 720.0;

/// The tails of a band on a film.
#[derive(Clone, Debug)]
pub struct TailPlan {
    /// The tails at the heights of the near kernels, linear between them as these are: so the light of both adds up to that of the PSF.
    tail: BandTail,
    /// Their heights in film pixels, and their coefficients, lengths in film pixels; without harmonics on the axis.
    height_px: Vec<f64>,
    coefficients: Vec<Coefficients>,
    /// The middle part that level 0 has in place of T, and its heights, mm.
    middle: Option<(Vec<f64>, Middle)>,
    /// Inner radius of level 0, film pixels.
    pub(super) inner_px: f64,
    /// Bin of level 0, film pixels.
    pub(super) bin_px: usize,
    /// Radius of level 1 over that of level 0.
    first_growth: usize,
    /// Number of levels.
    pub(super) levels: usize,
    /// [`blur`].
    blur: [f64; 2],
    film: Size,
    pitch_mm: f64,
}

impl TailPlan {
    /// The tails of `band` on the film of `frame`; none if the band has none, or if its window has fewer pixels than bins need.
    pub fn new(frame: &Frame, band: &LensBand) -> Option<Self> {
        let tail = band.tail.as_ref()?;
        let pitch_mm = frame.pitch_mm();
        let inner_px = tail.inner_mm / pitch_mm;
        let half_px = 0.5e-3 * band.psf_size as f64 * band.psf_pitch_um / pitch_mm;
        let bin_px = match &tail.middle {
            None => Self::bin_px_of(inner_px)?,
            Some(_) => middle::bin_px(half_px, inner_px, (MIN_BIN_PX, MAX_BIN_PX), GROWTH)?,
        };
        let middle = tail.middle.clone().map(|middle| (tail.height_mm.clone(), middle));
        let diagonal = real::hypot(frame.film.height as f64, frame.film.width as f64);
        let first_growth = match &middle {
            None => ((BINS_IN_LEVEL * GROWTH * bin_px) as f64 / inner_px).ceil().max(2.0) as usize,
            Some(_) => 1,
        };
        let mut levels = 1;
        while inner_px * (first_growth * GROWTH.pow(levels as u32 - 1)) as f64 <= diagonal {
            levels += 1;
        }
        let height_mm = band.psf_height_mm.clone();
        let coefficients = height_mm.iter().map(|h| tail.at(*h)).collect();
        let tail = BandTail { inner_mm: tail.inner_mm, height_mm, coefficients, middle: tail.middle.clone() };
        let mut coefficients: Vec<_> = tail.coefficients.iter().map(|c| in_pixels(c, pitch_mm)).collect();
        coefficients[0] = on_axis(coefficients[0]);
        Some(Self {
            height_px: tail.height_mm.iter().map(|mm| mm / pitch_mm).collect(),
            coefficients,
            middle,
            tail,
            inner_px,
            bin_px,
            first_growth,
            levels,
            blur: blur(frame, bin_px),
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

    /// The same in mm.
    pub(super) fn bin_mm(&self) -> f64 {
        self.bin_px as f64 * self.pitch_mm
    }

    /// Heights in mm and images of the middle part that level 0 has in place of T, if there is one.
    pub(super) fn middle(&self) -> Option<(&[f64], &Middle)> {
        self.middle.as_ref().map(|(height_mm, middle)| (&height_mm[..], middle))
    }

    /// Levels with kernels of their own for T, of the first two.
    pub(super) fn of_tails(&self) -> std::ops::Range<usize> {
        usize::from(self.middle.is_some())..self.levels.min(2)
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

    /// Coefficients by height, the last twice.
    pub(super) fn coefficients(&self) -> impl Iterator<Item = &Coefficients> {
        self.coefficients.iter().chain(self.coefficients.last())
    }

    /// The height below `r_px` film pixels from the axis, by its index in [`TailPlan::coefficients`]. `near`: that of a place nearby.
    #[inline(always)]
    pub(super) fn below(&self, r_px: f64, near: usize) -> usize {
        let h = &self.height_px;
        let last = h.len() - 1;
        if r_px >= h[last] {
            return last;
        }
        let mut k = near.min(last - 1);
        while h[k + 1] <= r_px {
            k += 1;
        }
        while k > 0 && h[k] > r_px {
            k -= 1;
        }
        k
    }

    /// Replaces distances from the axis, film pixels, by the share of the height above, where `below` is the height below.
    #[inline(always)]
    pub(super) fn shares(&self, below: usize, places: &mut [f64]) {
        match self.height_px[below..] {
            [this, next, ..] => places.iter_mut().for_each(|r| *r = (*r - this) / (next - this)),
            _ => places.fill(0.0),
        }
    }

    /// Factor of the power law `j` of level `level` over that of the last level with kernels of its own, 0 or 1.
    pub(super) fn factor(level: usize, j: usize) -> f64 {
        // Area of the bins over the power q = 3 + 2 j of the distance.
        (GROWTH as f64).powi((2 - 3 - 2 * j as i32) * level.saturating_sub(1) as i32)
    }

    /// Light of the kernels C_0j of level `level`, 0 or 1; 0 of a level 0 that has the middle part.
    fn sums(&self, level: usize) -> [f64; TERMS] {
        if level == 0 && self.middle.is_some() {
            return [0.0; TERMS];
        }
        std::array::from_fn(|j| self.kernels(level, 0, j).map(|(even, _)| even).sum())
    }

    /// The kernels C_mj and S_mj of level `level`, 0 or 1, row by row of bins: with what interpolation takes from them on average, from fourth differences.
    pub(super) fn kernels(&self, level: usize, m: usize, j: usize) -> impl Iterator<Item = (f64, f64)> {
        /// Bins beyond a kernel that fourth differences read.
        const BESIDE: i64 = 2;
        let b = self.bins(level).bin_px as f64;
        let at = |(y, x): (i64, i64)| {
            let (y, x) = (y as f64, x as f64);
            let r = (y * y + x * x).sqrt();
            let (sin, cos) = if r > 0.0 { (y / r, x / r) } else { (0.0, 1.0) };
            // (cos + i sin)^m
            let (mut re, mut im) = (1.0, 0.0);
            for _ in 0..m {
                (re, im) = (re * cos - im * sin, re * sin + im * cos);
            }
            let value = b * b * self.compact(level, b * r, m, j);
            [value * re, value * im]
        };
        let (half, blur) = (self.half() as i64, self.blur[level] * MEAN_BLUR);
        let places = |half: i64| (-half..=half).flat_map(move |y| (-half..=half).map(move |x| (y, x)));
        let (around, side) = (half + BESIDE, 2 * (half + BESIDE) + 1);
        let values: Vec<[f64; 2]> = places(around).map(at).collect();
        places(half).map(move |(y, x)| {
            let at = |y: i64, x: i64| values[((y + around) * side + x + around) as usize];
            let mut sum = at(y, x);
            for (n, w) in (-BESIDE..=BESIDE).zip([1.0, -4.0, 6.0, -4.0, 1.0]) {
                for of in [at(y + n, x), at(y, x + n)] {
                    sum.iter_mut().zip(of).for_each(|(sum, v)| *sum += blur * w * v);
                }
            }
            (sum[0], sum[1])
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

    /// Share of the light of a field point with coefficients `c` from level `first` on, 1 or more; `sums` are those of level 1.
    fn share_from(c: &Coefficients, first: usize, sums: &[f64; TERMS]) -> f64 {
        // A geometric series over the levels.
        (0..TERMS).map(|j| c[0][j] * sums[j] * Self::factor(first, j) / (1.0 - Self::factor(2, j))).sum()
    }

    /// Sums of the near kernels at the heights of the band's PSFs: all light less that of T and of the middle part.
    pub fn near_shares(&self) -> Vec<f64> {
        let (of_first, of_others) = (self.sums(0), self.sums(1));
        let middle = self.middle().map(|(height_mm, middle)| (height_mm, middle.shares()));
        let share = |(c, h): (&Coefficients, &f64)| {
            let c = in_pixels(c, self.pitch_mm);
            let first: f64 = (0..TERMS).map(|j| c[0][j] * of_first[j]).sum();
            let middle = middle.as_ref().map_or(0.0, |(height_mm, shares)| {
                linear(height_mm, shares, h.min(height_mm[height_mm.len() - 1]))
            });
            1.0 - first - Self::share_from(&c, 1, &of_others) - middle
        };
        self.tail.coefficients.iter().zip(&self.tail.height_mm).map(share).collect()
    }

    /// The near kernels of the PSFs `stack` of `band`, which this plan is of.
    pub fn near_kernels(&self, stack: PsfStack, band: &LensBand, simd: Simd) -> NodeKernels {
        let tables = (&self.tail, &band.psf_height_mm[..], &band.psf_energy[..]);
        NodeKernels::near(stack, tables, self.near_shares(), 1e3 * self.pitch_mm, simd)
    }

    /// FFT blocks of all levels: their kernels have the same size.
    pub(super) fn blocks(&self) -> Blocks {
        let levels: Vec<Size> =
            (self.of_tails().start..self.levels).map(|level| self.bins(level).size()).collect();
        Blocks::of_images(2 * self.half() + 1, KERNELS, &levels)
    }

    /// Bytes of the light of all levels.
    pub(super) fn light_bytes(&self) -> usize {
        let finest = self.bins(0).size().pixels();
        4 * finest * GROWTH.pow(2) / (GROWTH.pow(2) - 1)
    }

    /// Bytes of [`TailKernels`](super::TailKernels): spectra of levels 0 and 1, and the images of the middle part.
    pub fn kernel_bytes(&self) -> usize {
        let images = self.middle().map_or(0, |(_, middle)| size_of_val(&middle.samples[..]));
        self.of_tails().len() * KERNELS * self.blocks().spectrum_bytes() + 2 * images
    }

    /// Bytes while the layer is computed from the light on `threads` threads, its result included.
    pub(super) fn making_bytes(&self, threads: usize) -> usize {
        let (blocks, half, size) = (self.blocks(), self.half(), self.bins(0).size());
        // Images of each thread.
        let spectra = self.kernel_bytes();
        let images = 2 * KERNELS * threads * 4 * blocks.block * row_stride(blocks.block, 0);
        // The result of a level, the sum of blocks, and what the threads add to it.
        let rows = |rows: usize| (rows + 2 * half) * row_stride(size.width, half);
        let sums = size.pixels() + rows(size.height) + threads * rows(blocks.block);
        // Spectra of the middle part, and its strips of blocks, which may be those of the largest transform.
        let middle = self.middle().map_or(0, |_| middle::CACHE_BYTES + threads * 4 * rows(middle::MAX_BLOCK));
        self.light_bytes() + 4 * sums + spectra + images + middle
    }

    /// Core seconds of the layer, about, without the reading of the light: 200 ns a bin of level 0, with a middle part 1 µs.
    pub fn making_s(&self) -> f64 {
        let bin_s = if self.middle.is_some() { 1e-6 } else { 200e-9 };
        bin_s * self.bins(0).size().pixels() as f64
    }

    /// Share of the light beyond the last level, on the axis.
    pub(super) fn rest(&self) -> f64 {
        Self::share_from(&self.coefficients[0], self.levels, &self.sums(1))
    }
}

/// Interpolations and transposed ones between a point of the chart and a film pixel at levels 0 and 1, whose errors add up: as many as on the bins of the level would
/// have the same error; one on bins of a share s of them counts as s⁴. The chart's cells have one of each, the bins of a level one of each.
fn blur(frame: &Frame, bin_px: usize) -> [f64; 2] {
    let (rows, columns) = TailPlan::cells_px_of(frame, bin_px);
    let cell_px = 0.5 * (rows as f64 * frame.scale.0 + columns as f64 * frame.scale.1);
    let of_cells = 2.0 * (cell_px / bin_px as f64).powi(4);
    let of_first = 2.0 + of_cells;
    [of_first, 2.0 + of_first / (GROWTH as f64).powi(4)]
}

/// Coefficients in mm and mm³ as those in pixels.
fn in_pixels(c: &Coefficients, pitch_mm: f64) -> Coefficients {
    c.map(|[third, fifth]| [third / pitch_mm, fifth / pitch_mm.powi(3)])
}
