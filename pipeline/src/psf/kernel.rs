//! Kernels: the PSF of each node, rotated to its azimuth and integrated over the film pixel, once.
//!
//! The stack holds PSFs of field points on +x. Node (k, j) is P_k rotated by θ_j = 2πj/J_k about the chief ray (row down: a tail
//! on +x points down at 90°):
//! ```text
//! P_kj(x, y) = P_k(x cos θ + y sin θ, −x sin θ + y cos θ)
//! ```
//! Of a lens with errors the stack holds A_k PSFs a height, each of the field point at azimuth φ_a as seen in the frame that is rotated by φ_a
//! about the film's centre: its +x points away from the axis. P_k is then Q_k(θ_j), interpolated in azimuth (`azimuth`). PSFs of a
//! Cartesian grid are those of the nodes, not rotated.
//! interpolated by a cubic B-spline (`rotation`), integrated over film pixels (`integration`) and normalised to sum 1. A stack of
//! integrated samples at film pitch is not integrated again, and its kernels at quarter turns are its samples.
//! One *base kernel* expands to four or eight kernels by exact permutations (`symmetry`). Base kernels are computed in f64, or in
//! f32 with SIMD (`simd`); the two agree within 1e-6 of the kernel's peak.
//! Not modelled: light that rotation moves beyond the square film window (removed by the normalisation) and, for integrated samples
//! between quarter turns, the rotation of the sample's own square ([`NodeKernels::rotation_error`] estimates it).

mod azimuth;
mod integration;
pub mod on_demand;
mod resampler;
mod rotation;
#[cfg(target_arch = "x86_64")]
mod simd;
mod symmetry;

pub(super) use azimuth::BaseGroup;
pub(super) use rotation::NEGLIGIBLE_SAMPLE;
pub use symmetry::KernelSymmetry;

use crate::lens::middle::core_share;
use crate::lens::tail::{BandTail, RowBasis};
use crate::lens::{PsfSample, PsfStack};
use crate::psf::grid::{Node, NodeGrid};
use crate::simd::Simd;
use integration::PixelWeights;
use resampler::{Prepared, PreparedPsf, Resampler};
use rotation::rotation_error;
use std::sync::{Mutex, OnceLock};
use symmetry::{MIRROR_TOLERANCE, asymmetry, base_rotation_rad};

/// Kernels of one band at the film's pitch. A PSF is prepared when a kernel of its height is first computed.
#[derive(Debug)]
pub struct NodeKernels {
    resampler: Resampler,
    /// The rows of the stack ([`NodeGrid::psf_rows`]).
    psfs: Vec<Psf>,
    energy: Vec<f64>,
    /// Sum of the kernels of each row of the stack; 1 if none.
    shares: Option<Vec<f64>>,
}

/// A PSF of the stack.
#[derive(Debug)]
struct Psf {
    /// Whether it is symmetric about the meridian.
    is_mirrored: bool,
    /// Its samples until it is prepared, then empty.
    window: Mutex<Vec<f32>>,
    prepared: OnceLock<Prepared>,
}

/// Buffers of one worker; no allocation after the first kernel.
#[derive(Debug, Default)]
pub struct KernelScratch {
    rotated: Vec<f64>,
    half: Vec<f64>,
    film: Vec<f64>,
    base: Vec<f32>,
    kernel: Vec<f32>,
    /// Spline coefficients of PSFs between azimuths.
    interpolated: Vec<f32>,
    #[cfg(target_arch = "x86_64")]
    simd: simd::Buffers,
}

impl NodeKernels {
    /// Prepares the kernels of `stack`, which may have the first rows alone, for a film of `film_pitch_um`; `window` crops them to that many film
    /// pixels (odd).
    pub fn new(stack: &PsfStack, film_pitch_um: f64, window: Option<usize>, simd: Simd) -> Self {
        Self::of(stack.clone(), film_pitch_um, window, simd)
    }

    /// As [`NodeKernels::new`], in the memory of `stack`.
    pub fn of(stack: PsfStack, film_pitch_um: f64, window: Option<usize>, simd: Simd) -> Self {
        let n = stack.size;
        let resampler = Resampler::new((n, stack.pitch_um, stack.sample), film_pitch_um, window, simd);
        let share = film_share(resampler.pixels(), n, resampler.size());
        let all = stack.into_windows();
        let windows = || all.iter().map(|window| &window[..]);
        let light: Vec<f64> = windows().map(|window| lane_sum(window, window, |v, _| f64::from(v))).collect();
        let energy = |(window, light): (&[f32], &f64)| {
            let rows = window.chunks_exact(n).zip(&share);
            let inside: f64 = rows.map(|(row, w)| w * lane_sum(row, &share, |v, w| f64::from(v) * w)).sum();
            inside / light
        };
        let energy = windows().zip(&light).map(energy).collect();
        let psf = |(window, light): (Vec<f32>, &f64)| Psf {
            is_mirrored: is_mirrored(&window, n, *light),
            window: Mutex::new(window),
            prepared: OnceLock::new(),
        };
        Self { resampler, energy, psfs: all.into_iter().zip(&light).map(psf).collect(), shares: None }
    }

    /// The near kernels of `stack`, whose light beyond the windows is `tail`: p − T inside the window, of a PSF with a middle part times τ ([`crate::lens::middle`]), p with its share
    /// `energy` of the light at each height. `shares` are the sums of the kernels, all light less that of T on the film: they differ from the sums of p − T by what
    /// sampling and the interpolation of T between heights leave (below 1e-3).
    pub fn near(
        stack: PsfStack,
        (tail, height_mm, energy): (&BandTail, &[f64], &[f64]),
        shares: Vec<f64>,
        film_pitch_um: f64,
        simd: Simd,
    ) -> Self {
        let near = near_samples(stack, tail, height_mm, energy);
        Self::with_shares(near, shares, film_pitch_um, simd)
    }

    /// As [`NodeKernels::new`], each kernel with the sum of its row of the stack in `shares`.
    pub(crate) fn with_shares(stack: PsfStack, shares: Vec<f64>, film_pitch_um: f64, simd: Simd) -> Self {
        Self { shares: Some(shares), ..Self::of(stack, film_pitch_um, None, simd) }
    }

    /// Side of a kernel in film pixels, odd.
    pub fn size(&self) -> usize {
        self.resampler.size()
    }

    /// Share of the stack's window (sum 1) inside the film window, per row of the stack.
    pub fn energy(&self) -> &[f64] {
        &self.energy
    }

    /// The kernel of the PSF in row `row` of the stack, not rotated.
    pub fn unrotated(&self, row: usize, s: &mut KernelScratch) -> &[f32] {
        &self.prepared(row, s).unrotated
    }

    fn prepared(&self, row: usize, s: &mut KernelScratch) -> &Prepared {
        let Psf { window, prepared, .. } = &self.psfs[row];
        prepared.get_or_init(|| {
            let window = std::mem::take(&mut *window.lock().expect("no panic while held"));
            let mut prepared = self.resampler.prepare(&window, s);
            self.scale(row, &mut prepared.unrotated);
            prepared
        })
    }

    /// How the kernel of `node` follows from a base kernel.
    pub fn symmetry_of(&self, grid: &NodeGrid, node: Node) -> KernelSymmetry {
        let row = grid.psf_rows(grid.psf_set(node)).start;
        KernelSymmetry::new(grid, node, self.psfs[row].is_mirrored)
    }

    /// The kernel of the node `base` (see [`KernelSymmetry::base`]), row down.
    pub fn base_kernel<'a>(&self, grid: &NodeGrid, base: Node, s: &'a mut KernelScratch) -> &'a [f32] {
        let mut kernel = std::mem::take(&mut s.kernel);
        kernel.resize(self.size() * self.size(), 0.0);
        self.base_kernels(grid, &BaseGroup::single(base), s, &mut kernel);
        s.kernel = kernel;
        &s.kernel
    }

    /// The kernels of `group`, one after another into `out`.
    pub(super) fn base_kernels(
        &self,
        grid: &NodeGrid,
        group: &BaseGroup,
        s: &mut KernelScratch,
        out: &mut [f32],
    ) {
        let rows = grid.psf_rows(grid.psf_set(group.first));
        for row in rows.clone() {
            self.prepared(row, s);
        }
        let psf = |a: usize| {
            let prepared = self.psfs[rows.start + a].prepared.get().expect("prepared above");
            PreparedPsf { coefficients: &prepared.coefficients, unrotated: &prepared.unrotated }
        };
        self.resampler.base_kernels(grid, group, psf, s, out);
        // A PSF that is not rotated has its share.
        if base_rotation_rad(grid, group.first) != 0.0 {
            self.scale(rows.start, out);
        }
    }

    /// Gives a kernel of the PSF in row `row`, of sum 1, its share of the light.
    fn scale(&self, row: usize, kernel: &mut [f32]) {
        if let Some(shares) = &self.shares {
            kernel.iter_mut().for_each(|v| *v = (f64::from(*v) * shares[row]) as f32);
        }
    }

    /// Permutes `base`, the base kernel of `symmetry`, into `out` (size × size, row down).
    pub fn expand(&self, symmetry: &KernelSymmetry, base: &[f32], out: &mut [f32]) {
        symmetry.expand(base, self.size(), out);
    }

    /// The kernel of `node` into `out` (size × size, row down).
    pub fn kernel(&self, grid: &NodeGrid, node: Node, s: &mut KernelScratch, out: &mut [f32]) {
        let symmetry = self.symmetry_of(grid, node);
        self.expand(&symmetry, self.base_kernel(grid, symmetry.base, s), out);
    }

    /// Estimated L1 error of a rotation, relative to the light, the largest over all heights. Meaningful for integrated samples,
    /// whose pitch is too coarse for exact rotation.
    pub fn rotation_error(&self) -> f64 {
        let mut s = KernelScratch::default();
        let errors = (0..self.energy.len())
            .map(|k| rotation_error(&self.prepared(k, &mut s).coefficients, self.resampler.samples()));
        errors.fold(0.0, f64::max)
    }
}

/// p − T at the samples of `stack`, as shares of all light; of PSFs with a middle part times τ.
fn near_samples(mut stack: PsfStack, tail: &BandTail, height_mm: &[f64], energy: &[f64]) -> PsfStack {
    let n = stack.size;
    let (pitch, half) = (1e-3 * stack.pitch_um, n / 2);
    let coefficients: Vec<_> = height_mm.iter().map(|h| tail.at(*h)).collect();
    let samples = &mut stack.samples;
    let (mut basis, mut tails) = (RowBasis::default(), Vec::new());
    let half_mm = 0.5 * n as f64 * pitch;
    // T is the same in the rows above and below the chief ray.
    for off in 0..=half {
        let at = |i: usize| (i as f64 - half as f64) * pitch;
        let y_mm = off as f64 * pitch;
        basis.set(tail.inner_mm, (0..n).map(at), y_mm);
        let core: Option<Vec<f64>> = tail
            .middle
            .as_ref()
            .map(|_| (0..n).map(|i| core_share((at(i) * at(i) + y_mm * y_mm).sqrt(), half_mm)).collect());
        for ((window, c), energy) in samples.chunks_exact_mut(n * n).zip(&coefficients).zip(energy) {
            basis.values(c, &mut tails);
            let below = (off > 0 && half + off < n).then_some(half + off);
            for y in [Some(half - off), below].into_iter().flatten() {
                for (v, tail) in window[y * n..][..n].iter_mut().zip(&tails) {
                    *v = (f64::from(*v) * energy - tail * pitch * pitch) as f32;
                }
                for (v, core) in window[y * n..][..n].iter_mut().zip(core.iter().flatten()) {
                    *v = (f64::from(*v) * core) as f32;
                }
            }
        }
    }
    stack
}

/// Whether the PSF of `n` × `n` samples, with `light` in all, is its own mirror image about the meridian.
fn is_mirrored(psf: &[f32], n: usize, light: f64) -> bool {
    asymmetry(psf, n) <= MIRROR_TOLERANCE * light
}

/// Share of each sample of a row (or column) that lies inside the film window of `size` pixels.
fn film_share(pixels: Option<&[PixelWeights]>, samples: usize, size: usize) -> Vec<f64> {
    let mut share = vec![0.0; samples];
    match pixels {
        None => share[(samples - size) / 2..][..size].fill(1.0),
        Some(pixels) => {
            for pixel in pixels {
                share[pixel.first..].iter_mut().zip(&pixel.weights).for_each(|(s, w)| *s += w);
            }
        }
    }
    share
}

/// Σ f(a_i, b_i) in eight interleaved partial sums.
fn lane_sum<T: Copy>(a: &[f32], b: &[T], f: impl Fn(f32, T) -> f64) -> f64 {
    let mut sums = [0.0; 8];
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    for (a, b) in a.iter().zip(b) {
        for lane in 0..8 {
            sums[lane] += f(a[lane], b[lane]);
        }
    }
    sums.iter().sum::<f64>() + a_rest.iter().zip(b_rest).map(|(&a, &b)| f(a, b)).sum::<f64>()
}

/// Whether PSF samples are means over film pixels.
fn is_at_film_pitch(psf_pitch_um: f64, film_pitch_um: f64, sample: PsfSample) -> bool {
    sample == PsfSample::Integrated && (psf_pitch_um / film_pitch_um - 1.0).abs() < 1e-9
}

/// Side in film pixels, odd, of the kernels of PSF windows of `samples` samples.
pub fn film_window(samples: usize, psf_pitch_um: f64, film_pitch_um: f64, sample: PsfSample) -> usize {
    if is_at_film_pitch(psf_pitch_um, film_pitch_um, sample) {
        return samples;
    }
    let covering = (samples as f64 * psf_pitch_um / film_pitch_um - 1e-9).ceil().max(1.0) as usize;
    covering + usize::from(covering.is_multiple_of(2))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::tail::value;

    /// An elliptical Gaussian about (cx, 0), axes `a` along +x and `b` across, in film pixels.
    fn gaussian(x: f64, y: f64, azimuth: f64) -> f64 {
        let (sin, cos) = azimuth.sin_cos();
        let (u, v) = (x * cos + y * sin - 0.7, -x * sin + y * cos);
        (-(u * u / (2.0 * 1.9 * 1.9) + v * v / (2.0 * 0.9 * 0.9))).exp()
    }

    fn stack(n: usize, pitch_um: f64, sample: PsfSample, film_pitch_um: f64) -> PsfStack {
        let c = (n as f64 - 1.0) / 2.0;
        let step = pitch_um / film_pitch_um;
        let one: Vec<f64> = (0..n * n)
            .map(|i| gaussian((((i % n) as f64) - c) * step, ((i / n) as f64 - c) * step, 0.0))
            .collect();
        let sum: f64 = one.iter().sum();
        let one: Vec<f32> = one.iter().map(|v| (v / sum) as f32).collect();
        PsfStack { size: n, pitch_um, sample, samples: [one.clone(), one].concat() }
    }

    /// The exact mean over each film pixel, by 16 × 16 midpoints.
    fn exact(n: usize, azimuth: f64) -> Vec<f64> {
        let c = (n as f64 - 1.0) / 2.0;
        let mut k: Vec<f64> = (0..n * n)
            .map(|i| {
                let (y, x) = ((i / n) as f64 - c, (i % n) as f64 - c);
                let at = |s: usize| (s as f64 + 0.5) / 16.0 - 0.5;
                (0..256).map(|s| gaussian(x + at(s % 16), y + at(s / 16), azimuth)).sum()
            })
            .collect();
        let sum: f64 = k.iter().sum();
        k.iter_mut().for_each(|v| *v /= sum);
        k
    }

    #[test]
    fn rotated_point_samples_integrate_within_3_permille() {
        let grid = NodeGrid::new(&[0.0, 1.0], &[1, 72], 2e-3);
        for pitch in [0.5, 0.6, 0.4] {
            let stack = stack((4.0 * 13.0 / pitch / 2.0) as usize * 2 + 1, pitch, PsfSample::Point, 2.0);
            let kernels = NodeKernels::new(&stack, 2.0, None, Simd::detect());
            let n = kernels.size();
            let mut out = vec![0.0; n * n];
            for j in [0, 1, 5, 9, 17, 18, 31, 54, 70] {
                let node = Node { k: 1, j };
                kernels.kernel(&grid, node, &mut KernelScratch::default(), &mut out);
                let expected = exact(n, grid.azimuth_rad(node));
                let l1: f64 = out.iter().zip(&expected).map(|(a, b)| (f64::from(*a) - b).abs()).sum();
                assert!(l1 < 3e-3, "pitch {pitch}, azimuth {j} of 72: L1 {l1:.1e}");
                let sum: f64 = out.iter().map(|&v| f64::from(v)).sum();
                assert!((sum - 1.0).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn integrated_stack_at_film_pitch_keeps_its_samples_at_quarter_turns() {
        let stack = stack(15, 2.0, PsfSample::Integrated, 2.0);
        let kernels = NodeKernels::new(&stack, 2.0, None, Simd::PORTABLE);
        let grid = NodeGrid::new(&[0.0, 1.0], &[1, 8], 2e-3);
        let mut out = vec![0.0; 225];
        kernels.kernel(&grid, Node { k: 1, j: 0 }, &mut KernelScratch::default(), &mut out);
        assert_eq!(out, stack.window(1));
        kernels.kernel(&grid, Node { k: 1, j: 2 }, &mut KernelScratch::default(), &mut out);
        // +x rotates to +y, down: the pixel 3 right of the centre moves 3 below it.
        assert_eq!(out[10 * 15 + 7], stack.window(1)[7 * 15 + 10]);
        assert!((kernels.energy()[1] - 1.0).abs() < 1e-12);
    }

    #[test]
    fn integrated_samples_sum_to_a_coarser_film_pitch() {
        let fine = stack(45, 2.0, PsfSample::Integrated, 6.0);
        let kernels = NodeKernels::new(&fine, 6.0, None, Simd::PORTABLE);
        assert_eq!(kernels.size(), 15);
        let grid = NodeGrid::new(&[0.0, 1.0], &[1, 4], 6e-3);
        let mut out = vec![0.0; 225];
        kernels.kernel(&grid, Node { k: 1, j: 0 }, &mut KernelScratch::default(), &mut out);
        for y in 0..15 {
            for x in 0..15 {
                let expected: f32 = (0..9).map(|s| fine.samples[(3 * y + s / 3) * 45 + 3 * x + s % 3]).sum();
                assert!((out[y * 15 + x] - expected).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn cropped_window_is_normalised_and_its_energy_recorded() {
        let stack = stack(15, 2.0, PsfSample::Integrated, 2.0);
        let kernels = NodeKernels::new(&stack, 2.0, Some(5), Simd::PORTABLE);
        assert_eq!(kernels.size(), 5);
        let share: f32 = (0..25).map(|i| stack.samples[(5 + i / 5) * 15 + 5 + i % 5]).sum();
        assert!((kernels.energy()[0] - f64::from(share)).abs() < 1e-6);
        assert!(share < 0.99);
    }

    /// A comet: an elliptical Gaussian and a fainter one farther out, the second `skew` µm off the meridian.
    fn comet(n: usize, pitch_um: f64, skew: f64) -> PsfStack {
        let c = (n as f64 - 1.0) / 2.0;
        let one = (0..n * n).map(|i| {
            let (y, x) = (((i / n) as f64 - c) * pitch_um, ((i % n) as f64 - c) * pitch_um);
            let spot = |cx: f64, cy: f64, a: f64, b: f64| {
                (-((x - cx).powi(2) / (2.0 * a * a) + (y - cy).powi(2) / (2.0 * b * b))).exp()
            };
            spot(0.4, 0.0, 1.3, 0.9) + 0.2 * spot(6.0, skew, 4.0, 2.0)
        });
        let one: Vec<f64> = one.collect();
        let sum: f64 = one.iter().sum();
        let one: Vec<f32> = one.iter().map(|v| (v / sum) as f32).collect();
        PsfStack { size: n, pitch_um, sample: PsfSample::Point, samples: [one.clone(), one].concat() }
    }

    fn kernel_of(kernels: &NodeKernels, grid: &NodeGrid, j: usize) -> Vec<f32> {
        let mut out = vec![0.0; kernels.size() * kernels.size()];
        kernels.kernel(grid, Node { k: 1, j }, &mut KernelScratch::default(), &mut out);
        out
    }

    /// A core, and 1 % of the light beyond 20 film pixels as a tail with harmonics: T and the near kernels are the PSF again.
    #[test]
    fn near_kernels_and_the_tail_are_the_psf() {
        let (n, pitch_um, film_um) = (123, 2.0 / 3.0, 2.0);
        let inner_mm = 0.5 * n as f64 * pitch_um * 1e-3;
        let c = 2.65e-2 * film_um * 1e-3;
        let mut coefficients = [[0.0; 2]; 5];
        (coefficients[0], coefficients[1], coefficients[2]) = ([c, 1e-8], [0.0, 2e-9], [0.3 * c, 0.0]);
        let tail = BandTail {
            inner_mm,
            height_mm: vec![0.0, 1.0],
            coefficients: vec![coefficients; 2],
            middle: None,
        };
        let beyond = crate::lens::tail::light(&coefficients, inner_mm);
        let at = |i: usize| (i as f64 - (n / 2) as f64) * pitch_um * 1e-3;
        let step = (1e-3 * pitch_um).powi(2);
        // The core has the light that T leaves.
        let core = |x: f64, y: f64| {
            (-(x * x + y * y) / (2.0 * 3e-3 * 3e-3)).exp() / (2.0 * std::f64::consts::PI * 3e-3 * 3e-3)
        };
        let psf = |x: f64, y: f64| (1.0 - beyond) * core(x, y) + value(&coefficients, inner_mm, x, y);
        let raw: Vec<f64> = (0..n * n).map(|i| psf(at(i % n), at(i / n)) * step).collect();
        let energy: f64 = raw.iter().sum();
        let one: Vec<f32> = raw.iter().map(|v| (v / energy) as f32).collect();
        let stack =
            PsfStack { size: n, pitch_um, sample: PsfSample::Point, samples: [one.clone(), one].concat() };
        let tables = (&tail, &[0.0, 1.0][..], &[energy, energy][..]);
        let kernels = NodeKernels::near(stack, tables, vec![1.0 - beyond; 2], film_um, Simd::detect());
        let grid = NodeGrid::new(&[0.0, 1.0], &[1, 72], 2e-3);
        for j in [0, 5, 31] {
            let kernel = kernel_of(&kernels, &grid, j);
            let size = kernels.size();
            let sum: f64 = kernel.iter().map(|v| f64::from(*v)).sum();
            assert!((sum - (1.0 - beyond)).abs() < 1e-6, "{sum}");
            // Of the core alone: what a near kernel is here, but for rounding and resampling.
            let expected = |i: usize| {
                let place = |i: usize| (i as f64 - (size / 2) as f64) * film_um * 1e-3;
                let fine = |s: usize| (s as f64 / 8.0 - 0.4375) * film_um * 1e-3;
                let parts =
                    (0..64).map(|s| core(place(i % size) + fine(s % 8), place(i / size) + fine(s / 8)));
                (1.0 - beyond) * parts.sum::<f64>() / 64.0 * (film_um * 1e-3).powi(2)
            };
            let l1: f64 = kernel.iter().enumerate().map(|(i, v)| (f64::from(*v) - expected(i)).abs()).sum();
            assert!(l1 < 1e-3, "azimuth {j}: L1 {l1:.1e}");
        }
    }

    #[test]
    fn symmetric_psfs_need_10_base_kernels_of_72_and_others_18() {
        let grid = NodeGrid::new(&[0.0, 1.0], &[1, 72], 2e-3);
        let base_kernels = |skew: f64| {
            let kernels = NodeKernels::new(&comet(121, 0.5, skew), 2.0, None, Simd::PORTABLE);
            let bases = (0..72).map(|j| kernels.symmetry_of(&grid, Node { k: 1, j }).base);
            for j in [7, 11, 13, 20, 34, 47, 52, 65] {
                let mut direct = KernelScratch::default();
                let coefficients = kernels.prepared(1, &mut direct).coefficients.clone();
                kernels.resampler.rotated(&coefficients, grid.azimuth_rad(Node { k: 1, j }), &mut direct);
                let expanded = kernel_of(&kernels, &grid, j);
                let l1: f32 = expanded.iter().zip(&direct.base).map(|(a, b)| (a - b).abs()).sum();
                assert!(l1 < 2e-6, "azimuth {j} of 72: L1 {l1:.1e}");
            }
            bases.collect::<std::collections::BTreeSet<_>>().len()
        };
        assert_eq!((base_kernels(0.0), base_kernels(0.01)), (10, 18));
    }
}
