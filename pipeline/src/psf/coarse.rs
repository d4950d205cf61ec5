//! Fewer samples of wide, finely sampled PSFs, of which kernels take a fraction of the time and the memory.
//!
//! The light of a fast lens away from its best focus falls on more than a hundred pixels, with fringes that need four to eight samples a
//! pixel (Nyquist). A kernel integrates over pixels of pitch p, which passes at most 0.22 of what lies above 1/p. Its samples are
//! therefore low-passed, along x and along y:
//! ```text
//! c_i = Σ_j h((x_i − x_j)/q) v_j,     q = p/4, p/3 or as the band states,     h(u) = sinc(u)·K(u/8),     Σ_i h = 1
//! ```
//! v_j are shares of the light per sample, c_i those per coarse sample, K is a Kaiser window of shape 8; a sample beyond the last coarse one, whose weights are next to
//! nothing, belongs to that one. Lost are frequencies above 1/(2q). Of samples up to
//! four a pixel p/3 loses little, as the cutoff of the lens is then at most 1.8/p; they are reduced only where all PSFs together are large.
//! A band of many PSFs may state a larger q, whose loss was measured when it was traced ([`LensBand::kernel_pitch_um`](crate::lens::LensBand)): fringes of a PSF far
//! out of focus are wide.
//! L1 difference of kernels by default, worst of five PSFs of each of the built-in fast lenses: 0.03 to 0.6 % at 400 nm, up to 0.5 % at 550 nm (`scripts/bench/2026-11-29-nodes`).

use crate::lens::{PsfSample, PsfStack};
use crate::parts::for_each_part;
use crate::psf::kernel::film_window;
use crate::real::KaiserSinc;
use crate::spline::tensor::transposed;
use std::convert::Infallible;
use std::ops::Range;

/// Coarse samples a film pixel, along one direction, of finely sampled PSFs and of others.
const PER_PIXEL: (f64, f64) = (4.0, 3.0);
/// Samples a film pixel above which PSFs are finely sampled, and above which others are reduced.
const FINE: (f64, f64) = (4.5, 3.5);
/// Samples of all PSFs of a band above which others are reduced.
const LARGE: usize = 3 << 23;
/// Samples a film pixel of a band that has even more samples, each with the samples a pixel of PSFs above which they are coarser.
const FEWER: [(f64, f64); 3] = [(3.0, 4.5), (2.0, 2.5), (1.5, 1.75)];
/// Least samples a film pixel. On pixels smaller than those it was traced for, the loss of those that a band states is not known, as the errors of its nodes are not.
const LEAST: f64 = FEWER[2].0;
/// Windows from which on PSFs are reduced, film pixels: kernels of smaller ones take little time.
const WIDE_PX: usize = 101;
/// Least sum of the weights of a sample that is scaled to 1.
const LEAST_SUM: f64 = 0.5;
/// Half-width of h, coarse samples, and the shape of its Kaiser window.
const HALF: f64 = 8.0;
const SHAPE: f64 = 8.0;

/// The samples that kernels are made from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KernelSamples {
    /// Samples a side.
    pub size: usize,
    /// Pitch, µm.
    pub pitch_um: f64,
    /// Pitch of the film, µm.
    pub film_pitch_um: f64,
}

impl KernelSamples {
    /// Those of PSFs with `size` samples a side of `pitch_um`, on a film of `film_pitch_um`.
    pub fn all(size: usize, pitch_um: f64, film_pitch_um: f64) -> Self {
        Self { size, pitch_um, film_pitch_um }
    }

    /// Those of `count` PSFs with `size` samples a side of `pitch_um`, on a film of `film_pitch_um`: coarse if they are wide and finely
    /// sampled, and at least at the pitch `stated_um` that the band states.
    pub fn of(
        (count, size, pitch_um): (usize, usize, f64),
        film_pitch_um: f64,
        sample: PsfSample,
        stated_um: Option<f64>,
    ) -> Self {
        let all = Self::all(size, pitch_um, film_pitch_um);
        if sample != PsfSample::Point {
            return all;
        }
        let default = all.by_default(count);
        match stated_um.map(|pitch_um| (film_pitch_um / pitch_um).max(LEAST)) {
            Some(per_pixel) if per_pixel < default.per_pixel() => all.coarse(per_pixel),
            _ => default,
        }
    }

    /// Those of point samples of `count` PSFs with all of these, of a band that states none.
    fn by_default(self, count: usize) -> Self {
        let per_pixel = self.per_pixel();
        if self.window() < WIDE_PX {
            return self;
        }
        if per_pixel > FINE.0 {
            return self.coarse(PER_PIXEL.0);
        }
        let is_large = count * self.size.pow(2) > LARGE;
        if per_pixel > FINE.1 && is_large { self.coarse(PER_PIXEL.1) } else { self }
    }

    /// Of point samples, of which these are all: those of many PSFs by default, then the fewer ones that a band may state.
    pub fn steps(self) -> Vec<Self> {
        let first = self.by_default(usize::MAX / self.size.pow(2));
        if self.window() < WIDE_PX {
            return vec![first];
        }
        let is_fewer = |(to, above): &&(f64, f64)| self.per_pixel() > *above && *to < first.per_pixel();
        let fewer = FEWER.iter().filter(is_fewer).map(|(to, _)| self.coarse(*to));
        std::iter::once(first).chain(fewer).collect()
    }

    /// Samples a film pixel, along one direction.
    pub fn per_pixel(&self) -> f64 {
        self.film_pitch_um / self.pitch_um
    }

    /// Window of kernels of point samples, film pixels.
    pub fn window(&self) -> usize {
        film_window(self.size, self.pitch_um, self.film_pitch_um, PsfSample::Point)
    }

    /// Samples at `per_pixel` a film pixel in the window of these.
    fn coarse(self, per_pixel: f64) -> Self {
        let window = self.window();
        // The largest odd number within the window.
        let size = 2 * ((per_pixel * window as f64 - 1.0) / 2.0) as usize + 1;
        Self { size, pitch_um: self.film_pitch_um / per_pixel, ..self }
    }

    /// The first `psfs` PSFs at these coarse samples: `read` reads consecutive ones, `readers` at a time, which as many threads reduce.
    ///
    /// # Errors
    /// Errors of `read`.
    pub fn read<E>(
        self,
        psfs: usize,
        readers: usize,
        mut read: impl FnMut(Range<usize>) -> Result<PsfStack, E>,
    ) -> Result<PsfStack, E> {
        let mut part = |first: usize| read(first..psfs.min(first + readers));
        let fine = part(0)?;
        let reduction = self.reduction(fine.size, fine.pitch_um);
        let mut all = reduction.reduced(&fine, readers);
        for first in (readers..psfs).step_by(readers) {
            all.samples.extend_from_slice(&reduction.reduced(&part(first)?, readers).samples);
        }
        Ok(all)
    }

    /// The reduction to these of PSFs with `size` samples a side of `pitch_um`: those that these are of, or those of a band with another window.
    fn reduction(self, size: usize, pitch_um: f64) -> CoarseSamples {
        let of_window = Self { size, pitch_um, ..self }.coarse(self.film_pitch_um / self.pitch_um);
        CoarseSamples::new((size, pitch_um), of_window)
    }
}

/// The reduction of PSFs of one size and pitch.
#[derive(Clone, Debug)]
struct CoarseSamples {
    /// Samples a side before.
    from: usize,
    pitch_um: f64,
    /// Of each coarse sample, the first sample in its reach and the weights from there on.
    weights: Vec<(usize, Vec<f32>)>,
}

impl CoarseSamples {
    /// Of PSFs with `samples` a side of `pitch_um` to the samples `coarse`.
    fn new((samples, pitch_um): (usize, f64), coarse: KernelSamples) -> Self {
        let (to, to_pitch_um) = (coarse.size, coarse.pitch_um);
        let ratio = to_pitch_um / pitch_um;
        let (middle, to_middle) = ((samples / 2) as f64, (to / 2) as f64);
        let kernel = KaiserSinc::new(HALF, SHAPE);
        let of = |i: usize| {
            let at = middle + (i as f64 - to_middle) * ratio;
            let first = (at - HALF * ratio).ceil().max(0.0);
            let last = (at + HALF * ratio).floor().min(samples as f64 - 1.0);
            let reach = first as usize..(last + 1.0).max(first) as usize;
            (first as usize, reach.map(|j| kernel.at((j as f64 - at) / ratio)).collect())
        };
        let rows: Vec<(usize, Vec<f64>)> = (0..to).map(of).collect();
        // The weights of a sample in all coarse ones have the sum 1.
        let mut sums = vec![0.0; samples];
        for (first, weights) in &rows {
            weights.iter().zip(&mut sums[*first..]).for_each(|(w, sum)| *sum += w);
        }
        let normalised = |(row, (first, weights)): (usize, (usize, Vec<f64>))| {
            let weight = |(j, w): (usize, &f64)| match sums[j] > LEAST_SUM {
                true => (w / sums[j]) as f32,
                false => f32::from(row == if j < samples / 2 { 0 } else { to - 1 }),
            };
            (first, (first..).zip(&weights).map(weight).collect())
        };
        let weights = rows.into_iter().enumerate().map(normalised).collect();
        Self { from: samples, pitch_um: to_pitch_um, weights }
    }

    /// The PSFs of `stack`, reduced on `threads` threads.
    ///
    /// # Panics
    /// PSFs of another size.
    fn reduced(&self, stack: &PsfStack, threads: usize) -> PsfStack {
        let (n, size) = (self.from, self.weights.len());
        assert_eq!(stack.size, n, "PSFs of the size that the reduction is of");
        let mut samples = vec![0.0; stack.heights() * size * size];
        let parts = stack.samples.chunks_exact(n * n).zip(samples.chunks_exact_mut(size * size));
        let Ok(()) = for_each_part(threads, parts, Vec::new, |rows: &mut Vec<f32>, (psf, out)| {
            rows.clear();
            rows.resize(size * n, 0.0);
            self.sum_rows(psf, n, rows);
            let columns = transposed(rows, n);
            let mut reduced = vec![0.0; size * size];
            self.sum_rows(&columns, size, &mut reduced);
            out.copy_from_slice(&transposed(&reduced, size));
            Ok::<_, Infallible>(())
        });
        PsfStack { size, pitch_um: self.pitch_um, sample: stack.sample, samples }
    }

    /// Weighted sums of rows of `width` values of `from`, one after another into `to`.
    fn sum_rows(&self, from: &[f32], width: usize, to: &mut [f32]) {
        for ((first, weights), to) in self.weights.iter().zip(to.chunks_exact_mut(width)) {
            for (w, row) in weights.iter().zip(from[first * width..].chunks_exact(width)) {
                to.iter_mut().zip(row).for_each(|(to, v)| *to += w * v);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::psf::kernel::{KernelScratch, NodeKernels};
    use crate::real;
    use crate::simd::Simd;
    use std::f64::consts::PI;

    /// Fringes of a period of `period_um` under a wide envelope, off the middle, with a film of 2 µm.
    fn fringes(n: usize, pitch_um: f64, period_um: f64) -> PsfStack {
        let at = |i: usize| (i as f64 - (n / 2) as f64) * pitch_um;
        let value = |i: usize| {
            let (y, x) = (at(i / n) + 3.0, at(i % n) - 7.0);
            let fringe = 1.0 + 0.9 * real::cos(2.0 * PI * (0.8 * x + 0.6 * y) / period_um);
            real::exp(-(x * x + y * y) / 1500.0) * fringe
        };
        let samples: Vec<f64> = (0..n * n).map(value).collect();
        let sum: f64 = samples.iter().sum();
        let samples = samples.iter().map(|v| (v / sum) as f32).collect();
        PsfStack { size: n, pitch_um, sample: PsfSample::Point, samples }
    }

    /// The PSF of `one`, `count` times.
    fn stack_of(one: &PsfStack, count: usize) -> PsfStack {
        PsfStack { samples: one.samples.repeat(count), ..one.clone() }
    }

    #[test]
    fn wide_finely_sampled_psfs_alone_are_reduced() {
        let of = |count, n, pitch_um, sample| {
            let samples = KernelSamples::of((count, n, pitch_um), 2.0, sample, None);
            (samples.size, samples.per_pixel())
        };
        assert_eq!(of(1, 1025, 1.0 / 3.0, PsfSample::Point), (683, 4.0), "171 pixels");
        assert_eq!(of(33, 755, 0.5, PsfSample::Point), (755, 4.0), "four a pixel");
        assert_eq!(of(58, 755, 0.5, PsfSample::Point), (567, 3.0), "many of them");
        assert_eq!(of(99, 401, 1.0 / 3.0, PsfSample::Point), (401, 6.0), "67 pixels");
        assert_eq!(of(99, 1025, 0.4, PsfSample::Integrated), (1025, 5.0));
    }

    #[test]
    fn a_band_states_the_pitch_of_fewer_samples_for_films_of_its_pixels_and_of_larger_ones() {
        let of = |film_pitch_um, stated_um| {
            let psfs = (99, 1133, 1.0 / 3.0);
            let samples = KernelSamples::of(psfs, film_pitch_um, PsfSample::Point, Some(stated_um));
            (samples.size, samples.per_pixel())
        };
        assert_eq!(of(2.0, 1.0), (377, 2.0), "189 pixels");
        assert_eq!(of(4.0, 1.0), (379, 4.0), "95 pixels");
        assert_eq!(of(1.25, 1.0).1, 1.5, "smaller pixels");
        assert_eq!(of(2.0, 0.4).1, 4.0, "the default has fewer");
        assert_eq!(of(2.0, 0.25).1, 4.0, "more than there are");
        let steps = |n: usize, pitch_um| -> Vec<f64> {
            KernelSamples::all(n, pitch_um, 2.0).steps().iter().map(KernelSamples::per_pixel).collect()
        };
        let all = [steps(1133, 1.0 / 3.0), steps(755, 0.5), steps(567, 2.0 / 3.0), steps(401, 1.0 / 3.0)];
        assert_eq!(all, [vec![4.0, 3.0, 2.0, 1.5], vec![3.0, 2.0, 1.5], vec![3.0, 2.0, 1.5], vec![6.0]]);
    }

    #[test]
    fn samples_at_the_edge_have_small_weights() {
        for (n, pitch_um) in [(309, 2.0 / 3.0), (321, 2.0 / 3.0), (1051, 1.0 / 3.0), (1133, 1.0 / 3.0)] {
            for per_pixel in [1.5, 1.6, 2.0, 2.25, 3.0] {
                let samples = KernelSamples::all(n, pitch_um, 2.0).coarse(per_pixel);
                let reduction = CoarseSamples::new((n, pitch_um), samples);
                let (mut sums, mut sizes) = (vec![0.0; n], vec![0.0; n]);
                for (first, weights) in &reduction.weights {
                    for (j, w) in (*first..).zip(weights) {
                        sums[j] += w;
                        sizes[j] += w.abs();
                    }
                }
                let (sum, size) = (sums.iter().map(|s| (s - 1.0).abs()), sizes.iter().copied());
                let (sum, size) = (sum.fold(0.0, f32::max), size.fold(0.0, f32::max));
                assert!(sum < 1e-5 && size < 2.5, "{n}, {per_pixel} a pixel: {sum:.1e}, {size}");
            }
        }
    }

    #[test]
    fn kernels_of_coarse_samples_are_those_of_the_fine_ones() {
        let (n, pitch_um) = (607, 1.0 / 3.0);
        // Coarse samples resolve periods from 1.14 µm on; in a kernel fringes of 1 µm are at most 0.01 × 0.9 of their light.
        for (period_um, limit) in [(1.0, 0.02), (1.5, 3e-3), (6.0, 1e-4)] {
            let fine = fringes(n, pitch_um, period_um);
            let samples = KernelSamples::of((1, n, pitch_um), 2.0, PsfSample::Point, None);
            let reduction = samples.reduction(n, pitch_um);
            let coarse = reduction.reduced(&fine, 2);
            assert!(coarse.size == samples.size && coarse == reduction.reduced(&fine, 1));
            let in_parts = samples.read(5, 2, |psfs| Ok::<_, ()>(stack_of(&fine, psfs.len()))).unwrap();
            assert_eq!(in_parts.samples, coarse.samples.repeat(5));
            let sum: f64 = coarse.samples.iter().map(|v| f64::from(*v)).sum();
            assert!((sum - 1.0).abs() < 1e-5, "{sum}");
            let kernel = |stack: &PsfStack| {
                let kernels = NodeKernels::new(stack, 2.0, None, Simd::PORTABLE);
                kernels.unrotated(0, &mut KernelScratch::default()).to_vec()
            };
            let (a, b) = (kernel(&fine), kernel(&coarse));
            assert_eq!(a.len(), b.len());
            let l1: f32 = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).sum();
            assert!(f64::from(l1) < limit, "period of {period_um} µm: L1 {l1:.1e}");
        }
    }
}
