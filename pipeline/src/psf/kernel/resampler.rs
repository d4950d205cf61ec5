//! From the samples of the PSFs of a node to its kernel at the film's pitch: spline coefficients, interpolation in azimuth, rotation,
//! integration over film pixels.

use super::azimuth::{AzimuthPsf, BaseGroup, weighted_sums};
use super::integration::{PixelWeights, integrate, pixel_weights};
use super::rotation::{MARGIN, padded_coefficients, rotate};
#[cfg(target_arch = "x86_64")]
use super::simd;
use super::symmetry::base_rotation_rad;
use super::{KernelScratch, film_window, is_at_film_pitch};
use crate::lens::PsfSample;
use crate::psf::grid::NodeGrid;
#[cfg(target_arch = "x86_64")]
use crate::simd::{Avx2, Avx512};
use crate::simd::{Isa, Simd};

/// Computes kernels from PSFs of one window and pitch.
#[derive(Debug)]
pub(super) struct Resampler {
    /// Side of a kernel, film pixels.
    size: usize,
    /// Side of a PSF, samples.
    samples: usize,
    /// Weights of the samples in each film pixel; `None` if the samples are film pixels.
    pixels: Option<Vec<PixelWeights>>,
    simd: Simd,
}

/// A PSF, ready for kernels.
#[derive(Debug)]
pub(super) struct Prepared {
    /// Spline coefficients, with margins.
    pub(super) coefficients: Vec<f32>,
    /// The kernel at azimuth 0.
    pub(super) unrotated: Vec<f32>,
}

/// [`Prepared`], borrowed.
#[derive(Clone, Copy, Debug)]
pub(super) struct PreparedPsf<'a> {
    pub(super) coefficients: &'a [f32],
    pub(super) unrotated: &'a [f32],
}

impl Resampler {
    /// For PSFs of `psf` (side in samples, pitch in µm, kind of samples) on a film of `film_pitch_um`; `window` crops kernels to that many film
    /// pixels (odd).
    pub(super) fn new(
        (samples, pitch_um, sample): (usize, f64, PsfSample),
        film_pitch_um: f64,
        window: Option<usize>,
        simd: Simd,
    ) -> Self {
        let ratio = pitch_um / film_pitch_um;
        let full = film_window(samples, pitch_um, film_pitch_um, sample);
        let size = window.map_or(full, |w| w.min(full));
        let at_film_pitch = is_at_film_pitch(pitch_um, film_pitch_um, sample);
        let pixels = (!at_film_pitch).then(|| pixel_weights(samples, ratio, size, sample));
        Self { size, samples, pixels, simd }
    }

    pub(super) fn size(&self) -> usize {
        self.size
    }

    pub(super) fn samples(&self) -> usize {
        self.samples
    }

    pub(super) fn pixels(&self) -> Option<&[PixelWeights]> {
        self.pixels.as_deref()
    }

    /// Lengths of [`Prepared::coefficients`] and [`Prepared::unrotated`].
    pub(super) fn lengths(&self) -> (usize, usize) {
        ((self.samples + 2 * MARGIN).pow(2), self.size.pow(2))
    }

    pub(super) fn prepare(&self, window: &[f32], s: &mut KernelScratch) -> Prepared {
        Prepared { coefficients: self.coefficients(window, s), unrotated: self.unrotated(window, s) }
    }

    /// [`Prepared::coefficients`].
    pub(super) fn coefficients(&self, window: &[f32], s: &mut KernelScratch) -> Vec<f32> {
        padded_coefficients(window, self.samples, &mut s.rotated, &mut s.half)
    }

    /// [`Prepared::unrotated`].
    pub(super) fn unrotated(&self, window: &[f32], s: &mut KernelScratch) -> Vec<f32> {
        s.rotated.clear();
        s.rotated.extend(window.iter().map(|&v| f64::from(v)));
        let sum = self.to_film_pixels(s);
        // A complete window of sum 1 keeps its bits.
        let is_complete = self.pixels.is_none() && self.size == self.samples && (sum - 1.0).abs() < 1e-6;
        let norm = if is_complete { 1.0 } else { 1.0 / sum };
        s.film.iter().map(|v| (v * norm) as f32).collect()
    }

    /// The kernel of `coefficients` rotated by `azimuth_rad`.
    fn rotate<'a>(&self, coefficients: &[f32], azimuth_rad: f64, s: &'a mut KernelScratch) -> &'a [f32] {
        match self.simd.isa() {
            Isa::Portable => self.rotated(coefficients, azimuth_rad, s),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => {
                let rotation = self.rotation(coefficients, azimuth_rad);
                rotation.compute::<Avx512>(self.simd, &mut s.simd, &mut s.base);
            }
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => {
                let rotation = self.rotation(coefficients, azimuth_rad);
                rotation.compute::<Avx2>(self.simd, &mut s.simd, &mut s.base);
            }
            #[cfg(not(target_arch = "x86_64"))]
            Isa::Avx512 | Isa::Avx2 => unreachable!("Simd holds available instructions only"),
        }
        &s.base
    }

    /// The kernels of `group` of `grid`, `psf` the prepared PSFs of its set, into `out` (size² values each).
    pub(super) fn base_kernels<'a>(
        &self,
        grid: &NodeGrid,
        group: &BaseGroup,
        psf: impl Fn(usize) -> PreparedPsf<'a>,
        s: &mut KernelScratch,
        out: &mut [f32],
    ) {
        let sources: Vec<AzimuthPsf> = group.nodes().map(|base| AzimuthPsf::new(grid, base)).collect();
        let (length, area) = self.lengths();
        let weights: Vec<&[f64]> = sources.iter().filter_map(AzimuthPsf::weights).collect();
        let mut sums = std::mem::take(&mut s.interpolated);
        sums.resize(weights.len() * length, 0.0);
        if let Some(first) = weights.first() {
            let terms: Vec<&[f32]> = (0..first.len()).map(|a| psf(a).coefficients).collect();
            self.sums(&weights, &terms, &mut sums);
        }
        let mut sum = sums.chunks_exact(length);
        for ((base, source), out) in group.nodes().zip(&sources).zip(out.chunks_exact_mut(area)) {
            let rotation_rad = base_rotation_rad(grid, base);
            let coefficients = match source {
                AzimuthPsf::Sample(a) if rotation_rad == 0.0 => {
                    out.copy_from_slice(psf(*a).unrotated);
                    continue;
                }
                AzimuthPsf::Sample(a) => psf(*a).coefficients,
                AzimuthPsf::Sum(_) => sum.next().expect("a sum for each"),
            };
            out.copy_from_slice(self.rotate(coefficients, rotation_rad, s));
        }
        s.interpolated = sums;
    }

    /// Σ weight · term for each of `weights`, one after another into `to`.
    fn sums(&self, weights: &[&[f64]], terms: &[&[f32]], to: &mut [f32]) {
        match self.simd.isa() {
            Isa::Portable => weighted_sums(weights, terms, to),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => simd::weighted_sums::<Avx512>(self.simd, weights, terms, to),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => simd::weighted_sums::<Avx2>(self.simd, weights, terms, to),
            #[cfg(not(target_arch = "x86_64"))]
            Isa::Avx512 | Isa::Avx2 => unreachable!("Simd holds available instructions only"),
        }
    }

    /// The PSF of `coefficients` rotated by `azimuth_rad` into `s.base`: plain f64 sums, the reference for SIMD.
    pub(super) fn rotated(&self, coefficients: &[f32], azimuth_rad: f64, s: &mut KernelScratch) {
        rotate(coefficients, self.samples, azimuth_rad, &mut s.rotated);
        let sum = self.to_film_pixels(s);
        s.base.clear();
        s.base.extend(s.film.iter().map(|v| (v / sum) as f32));
    }

    /// The same with SIMD.
    #[cfg(target_arch = "x86_64")]
    fn rotation<'a>(&'a self, coefficients: &'a [f32], azimuth_rad: f64) -> simd::RotatedKernel<'a> {
        simd::RotatedKernel {
            coefficients,
            samples: self.samples,
            azimuth_rad,
            pixels: self.pixels.as_deref(),
            size: self.size,
        }
    }

    /// Integrates `s.rotated` (samples²) over the film pixels, or crops it to them, into `s.film` (size²); returns its sum.
    fn to_film_pixels(&self, s: &mut KernelScratch) -> f64 {
        match &self.pixels {
            Some(pixels) => integrate(pixels, &s.rotated, self.samples, &mut s.half, &mut s.film),
            None => {
                let edge = (self.samples - self.size) / 2;
                s.film.clear();
                for y in 0..self.size {
                    s.film.extend_from_slice(&s.rotated[(y + edge) * self.samples + edge..][..self.size]);
                }
                s.film.iter().sum()
            }
        }
    }
}
