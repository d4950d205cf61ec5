//! The point spread function of a field point: a Huygens sum of plane wavelets, one per ray.
//!
//! ```text
//! U(X) = ∫∫ √(Φ J / N) e^{ik(W + L X + M Y)} dp dq      PSF = |U|²,   k = 2π/λ
//! W = path − L (x − x₀) − M (y − y₀)      X, Y relative to the intersection (x₀, y₀) of the chief ray with the film; (x, y) that of the ray
//! J = |d(L, M)/d(p, q)|,   Φ = flux per dp dq,   (L, M, N) optical direction cosines in image space,
//! times its index where the film lies in a glass
//! ```
//! Amplitude: |A|² N dL dM is the power of the wavelets in dL dM, which passes through dp dq; so A dL dM = √(Φ J / N) dp dq.
//! A plain FFT of the pupil assumes constant J and N and a round pupil: 5-14 % wrong off axis for a Double Gauss.
//! Total energy: ∫∫ |U|² dX dY = λ² ∫∫ (Φ/N) dp dq (Parseval), so the share inside any window is known without a larger one.
//! Method: W, L, M and the amplitude are smooth over the pupil, so they are interpolated from a few hundred rays
//! ([`PupilFunction`]); the integrand oscillates, so the density of its quadrature follows from the window; the sum
//! over its nodes is a nonuniform FFT ([`super::nufft`]). Tests: the same sum without FFT.
//! Source: Welford, chapter 4 (path); Goodman, Introduction to Fourier Optics, 3.10 (angular spectrum). Scalar; one polarisation.

use std::f64::consts::TAU;

use rustfft::num_complex::Complex;

use super::nufft::{Accuracy, Nufft, NufftScratch, Point};
use super::wavelets::Wavelet;
use crate::design::pupil::function::PupilFunction;
use crate::real;

/// Computes PSFs on a window of n × n samples at one pitch.
#[derive(Debug)]
pub struct PsfGrid {
    nufft: Nufft,
    pitch_um: f64,
    /// Wavelength of the light over that of the pupil functions: more than 1 for light of a longer wavelength with the same paths.
    longer: f64,
}

/// Buffers of one worker.
#[derive(Default)]
pub struct PsfScratch {
    wavelets: Vec<Wavelet>,
    sum: NufftScratch,
}

impl PsfGrid {
    /// Windows of `2·half + 1` samples of `pitch_um`.
    pub fn new(half: usize, pitch_um: f64) -> Self {
        Self { nufft: Nufft::new(half, Accuracy::Film), pitch_um, longer: 1.0 }
    }

    /// The same for PSFs whose light or kernels are compared, not kept, of light whose wavelength is `longer` times that of the pupil functions.
    pub(in crate::design) fn for_comparison(half: usize, pitch_um: f64, longer: f64) -> Self {
        Self { nufft: Nufft::new(half, Accuracy::Comparison), pitch_um, longer }
    }

    /// Samples per side.
    pub fn size(&self) -> usize {
        self.nufft.size()
    }

    /// Sample pitch, µm.
    pub fn pitch_um(&self) -> f64 {
        self.pitch_um
    }

    /// Time for a PSF of `f`, in that for a sample: a point of the sum takes as long as ten samples, and three of four PSFs need both halves
    /// of the pupil.
    pub(in crate::design) fn work(&self, f: &PupilFunction) -> f64 {
        let mut wavelets = Vec::new();
        self.wavelets_into(f, 0.0, &mut wavelets);
        self.size().pow(2) as f64 + 17.5 * wavelets.len() as f64
    }

    /// Wavelength of the light of `f`, µm.
    fn wavelength_um(&self, f: &PupilFunction) -> f64 {
        self.longer * f.wavelength_um
    }

    /// The wavelets of `f` for samples that are up to `farther_um` from the window.
    fn wavelets_into(&self, f: &PupilFunction, farther_um: f64, out: &mut Vec<Wavelet>) {
        f.wavelets_into(self.reach_um() + farther_um, self.wavelength_um(f), out);
    }

    /// Half a side of the window, µm.
    pub(super) fn reach_um(&self) -> f64 {
        self.pitch_um * (self.size() / 2) as f64
    }

    /// The PSF rotated by `azimuth_rad` (row down: from +x towards +y), as shares of the total energy per sample.
    pub fn psf(&self, f: &PupilFunction, azimuth_rad: f64, scratch: &mut PsfScratch) -> Vec<f64> {
        let mut out = Vec::new();
        self.psf_into(f, azimuth_rad, scratch, &mut out);
        out.into_iter().map(f64::from).collect()
    }

    /// [`PsfGrid::psf`] into `out`.
    pub fn psf_into(
        &self,
        f: &PupilFunction,
        azimuth_rad: f64,
        scratch: &mut PsfScratch,
        out: &mut Vec<f32>,
    ) {
        self.wavelets_into(f, 0.0, &mut scratch.wavelets);
        self.sum(f, azimuth_rad, scratch, out);
    }

    /// The PSF rotated by each of `azimuths_rad`, in `buffers`, passed to `each` one by one.
    pub(in crate::design) fn rotations(
        &self,
        f: &PupilFunction,
        azimuths_rad: impl Iterator<Item = f64>,
        (scratch, psf): &mut (PsfScratch, Vec<f32>),
        mut each: impl FnMut(&[f32]),
    ) {
        self.wavelets_into(f, 0.0, &mut scratch.wavelets);
        for azimuth_rad in azimuths_rad {
            self.sum(f, azimuth_rad, scratch, psf);
            each(psf);
        }
    }

    /// [`PsfGrid::psf_into`] without rotation, and whether the samples are finer than the Nyquist pitch, or 2 % coarser: that of a pupil function is from its
    /// points, between which its directions are interpolated. If not, the PSF is not computed.
    pub(super) fn resolved_into(
        &self,
        f: &PupilFunction,
        scratch: &mut PsfScratch,
        out: &mut Vec<f32>,
    ) -> bool {
        self.wavelets_into(f, 0.0, &mut scratch.wavelets);
        let most = scratch.wavelets.iter().fold(0.0_f64, |most, w| most.max(w.l.abs()).max(w.m.abs()));
        let is_resolved = 2.0 * self.pitch_um * most <= 1.02 * self.wavelength_um(f);
        if is_resolved {
            self.sum(f, 0.0, scratch, out);
        }
        is_resolved
    }

    /// The PSF shifted by `shift_um` along +x, as shares of the total energy per sample, into `out`.
    pub(in crate::design) fn shifted_into(
        &self,
        f: &PupilFunction,
        shift_um: f64,
        scratch: &mut PsfScratch,
        out: &mut Vec<f32>,
    ) {
        let k = TAU / self.wavelength_um(f);
        // The samples see the pupil from this much farther.
        self.wavelets_into(f, shift_um.abs(), &mut scratch.wavelets);
        for wavelet in &mut scratch.wavelets {
            let (sin, cos) = real::sin_cos(-k * wavelet.l * shift_um);
            wavelet.c *= Complex::new(cos, sin);
        }
        self.sum(f, 0.0, scratch, out);
    }

    /// The PSF of the wavelets of `f` in `scratch`, rotated by `azimuth_rad`, into `out`.
    fn sum(&self, f: &PupilFunction, azimuth_rad: f64, scratch: &mut PsfScratch, out: &mut Vec<f32>) {
        let PsfScratch { wavelets, sum } = scratch;
        let (scale, share) = (self.pitch_um / self.wavelength_um(f), f.share(self.pitch_um / self.longer));
        let point = |l: f64, m: f64, c| Point { s: l * scale, t: m * scale, c };
        if azimuth_rad == 0.0 {
            // Without rotation the two halves of a symmetric pupil are mirror images, and one is enough.
            let points = wavelets.iter().map(|w| point(w.l, w.m, w.c));
            return self.nufft.power(points, !f.is_whole, share, sum, out);
        }
        let (sin, cos) = real::sin_cos(azimuth_rad);
        let halves = if f.is_whole { 1 } else { 2 };
        let rotated = |Wavelet { l, m, c }: &Wavelet| {
            let both = [
                point(l * cos - m * sin, l * sin + m * cos, *c),
                point(l * cos + m * sin, l * sin - m * cos, *c),
            ];
            both.into_iter().take(halves)
        };
        self.nufft.power(wavelets.iter().flat_map(rotated), false, share, sum, out);
    }
}

#[cfg(test)]
pub(in crate::design) mod tests;
