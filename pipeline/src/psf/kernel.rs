//! Kernels: the PSF of each node, turned to its azimuth and integrated over the film pixel, ONCE.
//!
//! The stack holds PSFs of field points on +x. Node (k, j) is P_k turned by θ_j = 2πj/J_k about the chief ray (row down:
//! a tail on +x points down at 90°):  P_kj(x, y) = P_k(x cos θ + y sin θ, −x sin θ + y cos θ).
//! Turning interpolates by a cubic B-spline. Then
//!   *point* samples: film pixel i takes ∫ of the interpolant over its width;
//!   *integrated* samples: differences of the spline through the cumulative sum, which is exact at sample edges; at film
//!   pitch that is the sample itself, so such a stack is used as it is at quarter turns.
//! Every kernel sums to 1. Quarter turns are permutations: kernel(j + J/4) is kernel(j) turned by 90°, bit for bit. Where
//! the PSFs are their own mirror images about the meridian (checked by number) and J is a multiple of 8, kernel(J/4 − j) is
//! kernel(j) with rows and columns exchanged. So one *seed* makes four kernels, or eight.
//! Seeds are computed in f64, or in f32 lanes (`simd::turn`), which agree within 1e-6 of the kernel's peak.
//! What is lost: light that a turned square window pushes out of the film window's corners (normalised away), and, for
//! integrated samples between quarter turns, the turned pixel square ([`NodeKernels::turning_error`] estimates it).

use crate::lens::{PsfSample, PsfStack};
use crate::psf::grid::{Node, NodeGrid};
#[cfg(target_arch = "x86_64")]
use crate::psf::simd::turn::{Integrate as IntegrateLanes, Transpose, Turn};
use crate::psf::spline;
use crate::real;
#[cfg(target_arch = "x86_64")]
use crate::simd::lanes::{Gate, Lanes, WIDEST};
#[cfg(target_arch = "x86_64")]
use crate::simd::{Avx2, Avx512};
use crate::simd::{Isa, Simd};

/// Kernels of one band at the film's pitch.
#[derive(Debug)]
pub struct NodeKernels {
    size: usize,
    samples: usize,
    coefficients: Vec<f32>,
    base: Vec<f32>,
    energy: Vec<f64>,
    integrate: Option<Integrate>,
    mirrored: bool,
    simd: Simd,
}

/// Zeros around a PSF's coefficients: as far as a spline beside them reaches.
pub(super) const MARGIN: usize = 4;

/// Samples of a PSF below this are none (their sum is 1): a spline's ringing into the dark ends in denormals, which made
/// kernels ten times slower.
pub(super) const DARK: f32 = 1e-20;

/// PSFs count as their own mirror images if those differ by no more than this share of the light: so much may a film then
/// differ, of its peak, and it may by 2e-6.
const MIRROR_TOLERANCE: f64 = 5e-7;

/// Which seed makes a node's kernel, and how: exchange rows and columns first, then quarter turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Making {
    /// The seed: its height, and its azimuth index in the first quadrant (or octant); at 0 it is the PSF itself.
    pub seed: Node,
    /// Whether rows and columns are exchanged.
    pub exchanged: bool,
    /// Quarter turns.
    pub quarter: usize,
}

/// Buffers of one worker; no allocation after the first kernel.
#[derive(Debug, Default)]
pub struct KernelScratch {
    turned: Vec<f64>,
    half: Vec<f64>,
    film: Vec<f64>,
    seed: Vec<f32>,
    #[cfg(target_arch = "x86_64")]
    lanes: [Vec<f32>; 4],
}

impl NodeKernels {
    /// Prepares the kernels of `stack` for a film of `film_pitch_um`; `window` crops them to that many film pixels (odd).
    /// `simd` is what they are computed with.
    pub fn new(stack: &PsfStack, film_pitch_um: f64, window: Option<usize>, simd: Simd) -> Self {
        let n = stack.size;
        let ratio = stack.pitch_um / film_pitch_um;
        let as_is = used_as_it_is(stack.pitch_um, film_pitch_um, stack.sample);
        let whole = film_window(n, stack.pitch_um, film_pitch_um, stack.sample);
        let size = window.map_or(whole, |w| w.min(whole));
        let mut kernels = Self {
            size,
            samples: n,
            coefficients: Vec::with_capacity(stack.heights() * (n + 2 * MARGIN).pow(2)),
            base: Vec::with_capacity(stack.heights() * size * size),
            energy: Vec::new(),
            integrate: (!as_is).then(|| Integrate::new(n, ratio, size, stack.sample)),
            mirrored: (0..stack.heights()).all(|k| asymmetry(stack.window(k), n) <= MIRROR_TOLERANCE),
            simd,
        };
        let mut scratch = KernelScratch::default();
        for k in 0..stack.heights() {
            let window = stack.window(k);
            kernels.coefficients.extend(with_margins(&spline::coefficients_2d(window, n), n));
            let sum = match as_is {
                true => {
                    let edge = (n - size) / 2;
                    scratch.film.clear();
                    for y in 0..size {
                        let row = &window[(y + edge) * n + edge..][..size];
                        scratch.film.extend(row.iter().map(|&v| f64::from(v)));
                    }
                    scratch.film.iter().sum::<f64>()
                }
                false => {
                    scratch.turned.clear();
                    scratch.turned.extend(window.iter().map(|&v| f64::from(v)));
                    kernels.integrate(&mut scratch)
                }
            };
            let total: f64 = window.iter().map(|&v| f64::from(v)).sum();
            kernels.energy.push(sum / total);
            // A whole window of sum 1 is kept bit for bit.
            let norm = if as_is && size == n && (sum - 1.0).abs() < 1e-6 { 1.0 } else { 1.0 / sum };
            kernels.base.extend(scratch.film.iter().map(|v| (v * norm) as f32));
        }
        kernels
    }

    /// Side of a kernel in film pixels, odd.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Share of the stack's window (sum 1) that the film window holds, per height.
    pub fn energy(&self) -> &[f64] {
        &self.energy
    }

    /// The kernel of height `k`, not turned.
    pub fn upright(&self, k: usize) -> &[f32] {
        let n = self.size * self.size;
        &self.base[k * n..][..n]
    }

    /// Which seed makes the kernel of `node`.
    pub fn making(&self, grid: &NodeGrid, node: Node) -> Making {
        let count = grid.azimuths()[node.k];
        if count == 1 {
            return Making { seed: node, exchanged: false, quarter: 0 };
        }
        assert!(count.is_multiple_of(4), "azimuth counts are checked at the door");
        let (quarter, j) = (node.j / (count / 4), node.j % (count / 4));
        // At azimuth π/2 − θ stands the mirror image of what stands at θ.
        let exchanged = self.mirrored && count.is_multiple_of(8) && j > count / 8;
        let j = if exchanged { count / 4 - j } else { j };
        Making { seed: Node { k: node.k, j }, exchanged, quarter }
    }

    /// The kernel of `seed`, a [`Making::seed`], row down.
    pub fn seed<'a>(&'a self, grid: &NodeGrid, seed: Node, s: &'a mut KernelScratch) -> &'a [f32] {
        let n = self.size;
        if seed.j == 0 {
            return &self.base[seed.k * n * n..][..n * n];
        }
        let azimuth = grid.azimuth_rad(seed);
        match self.simd.isa() {
            Isa::Portable => self.turned(seed.k, azimuth, s),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => self.turned_in_lanes::<Avx512>(seed.k, azimuth, s),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => self.turned_in_lanes::<Avx2>(seed.k, azimuth, s),
            #[cfg(not(target_arch = "x86_64"))]
            Isa::Avx512 | Isa::Avx2 => unreachable!("a choice this machine can run"),
        }
        &s.seed
    }

    /// `seed` as `making` tells, into `out` (size × size, row down).
    pub fn lay(&self, making: &Making, seed: &[f32], out: &mut [f32]) {
        quarter_turns(seed, self.size, making.exchanged, making.quarter, out);
    }

    /// The kernel of `node` into `out` (size × size, row down).
    pub fn kernel(&self, grid: &NodeGrid, node: Node, s: &mut KernelScratch, out: &mut [f32]) {
        let making = self.making(grid, node);
        self.lay(&making, self.seed(grid, making.seed, s), out);
    }

    /// P_k turned by `azimuth_rad` into `s.seed`: plain f64 sums, what the lanes answer to.
    fn turned(&self, k: usize, azimuth_rad: f64, s: &mut KernelScratch) {
        self.turn(k, azimuth_rad, &mut s.turned);
        let sum: f64 = match self.integrate {
            Some(_) => self.integrate(s),
            None => {
                let edge = (self.samples - self.size) / 2;
                s.film.clear();
                for y in 0..self.size {
                    s.film.extend_from_slice(&s.turned[(y + edge) * self.samples + edge..][..self.size]);
                }
                s.film.iter().sum()
            }
        };
        s.seed.clear();
        s.seed.extend(s.film.iter().map(|v| (v / sum) as f32));
    }

    /// The same in lanes.
    #[cfg(target_arch = "x86_64")]
    fn turned_in_lanes<V: Lanes>(&self, k: usize, azimuth_rad: f64, s: &mut KernelScratch) {
        let (n, size, gate) = (self.samples, self.size, Gate::<V>::open(self.simd));
        let (across, film) = (n.next_multiple_of(WIDEST), size.next_multiple_of(WIDEST));
        let [turned, half, exchanged, columns] = &mut s.lanes;
        turned.resize(n * across, 0.0);
        let coefficients = self.window(k);
        gate.run(Turn { coefficients, n, azimuth_rad, to: turned, stride: across });
        s.seed.clear();
        match &self.integrate {
            None => {
                let edge = (n - size) / 2;
                for y in 0..size {
                    s.seed.extend_from_slice(&turned[(y + edge) * across + edge..][..size]);
                }
            }
            Some(Integrate { rows: pixels }) => {
                half.resize(film * across, 0.0);
                exchanged.resize(across * film, 0.0);
                columns.resize(size * film, 0.0);
                gate.run(IntegrateLanes { pixels, from: turned, to: half, stride: across });
                gate.run(Transpose { from: half, from_stride: across, to: exchanged, to_stride: film });
                gate.run(IntegrateLanes { pixels, from: exchanged, to: columns, stride: film });
                for y in 0..size {
                    s.seed.extend(columns.chunks_exact(film).map(|column| column[y]));
                }
            }
        }
        let sum: f64 = s.seed.iter().map(|&v| f64::from(v)).sum();
        let per_sum = (1.0 / sum) as f32;
        s.seed.iter_mut().for_each(|v| *v *= per_sum);
    }

    /// Coefficients of the k-th PSF, with their margins.
    fn window(&self, k: usize) -> &[f32] {
        let n = self.samples + 2 * MARGIN;
        &self.coefficients[k * n * n..][..n * n]
    }

    /// Estimated L1 error of turning, worst over heights: a window turned by 45° and back against itself, over √2 because
    /// two turns made it. Meaningful for integrated samples, whose pitch is too coarse for their turning to be exact.
    pub fn turning_error(&self) -> f64 {
        let n = self.samples;
        let mut worst = 0.0f64;
        let (mut there, mut back) = (Vec::new(), Vec::new());
        for k in 0..self.energy.len() {
            self.turn(k, std::f64::consts::FRAC_PI_4, &mut there);
            let there: Vec<f32> = there.iter().map(|&v| v as f32).collect();
            turn(
                &with_margins(&spline::coefficients_2d(&there, n), n),
                n,
                -std::f64::consts::FRAC_PI_4,
                &mut back,
            );
            let mut original = Vec::new();
            turn(self.window(k), n, 0.0, &mut original);
            let l1: f64 = original.iter().zip(&back).map(|(a, b)| (a - b).abs()).sum();
            worst = worst.max(l1 / original.iter().sum::<f64>() / std::f64::consts::SQRT_2);
        }
        worst
    }

    fn turn(&self, k: usize, azimuth_rad: f64, out: &mut Vec<f64>) {
        turn(self.window(k), self.samples, azimuth_rad, out);
    }

    /// Integrates `s.turned` (samples²) over the film pixels into `s.film` (size²); returns its sum.
    fn integrate(&self, s: &mut KernelScratch) -> f64 {
        let rows = self.integrate.as_ref().expect("only for stacks that need it");
        let (m, n) = (self.samples, self.size);
        s.half.clear();
        s.half.resize(n * m, 0.0);
        for (row, half) in rows.rows.iter().zip(s.half.chunks_exact_mut(m)) {
            for (w, line) in row.weights.iter().zip(s.turned[row.first * m..].chunks_exact(m)) {
                half.iter_mut().zip(line).for_each(|(h, v)| *h += w * v);
            }
        }
        s.film.clear();
        for half in s.half.chunks_exact(m) {
            s.film.extend(
                rows.rows
                    .iter()
                    .map(|row| row.weights.iter().zip(&half[row.first..]).map(|(w, v)| w * v).sum::<f64>()),
            );
        }
        debug_assert_eq!(s.film.len(), n * n);
        s.film.iter().sum()
    }
}

fn used_as_it_is(psf_pitch_um: f64, film_pitch_um: f64, sample: PsfSample) -> bool {
    sample == PsfSample::Integrated && (psf_pitch_um / film_pitch_um - 1.0).abs() < 1e-9
}

/// Side in film pixels, odd, of the kernels made from windows of `samples` samples.
pub fn film_window(samples: usize, psf_pitch_um: f64, film_pitch_um: f64, sample: PsfSample) -> usize {
    if used_as_it_is(psf_pitch_um, film_pitch_um, sample) {
        return samples;
    }
    let covering = (samples as f64 * psf_pitch_um / film_pitch_um - 1e-9).ceil().max(1.0) as usize;
    covering + usize::from(covering.is_multiple_of(2))
}

/// An n × n image with margins of zeros.
fn with_margins(image: &[f32], n: usize) -> Vec<f32> {
    let width = n + 2 * MARGIN;
    let mut out = vec![0.0; width * width];
    for (to, from) in out[MARGIN * width..].chunks_exact_mut(width).zip(image.chunks_exact(n)) {
        for (to, from) in to[MARGIN..MARGIN + n].iter_mut().zip(from) {
            *to = if from.abs() < DARK { 0.0 } else { *from };
        }
    }
    out
}

/// Share of the light by which an n × n PSF differs from its image mirrored about the meridian.
fn asymmetry(window: &[f32], n: usize) -> f64 {
    let rows = window.chunks_exact(n).zip(window.chunks_exact(n).rev());
    let differ = rows.flat_map(|(a, b)| a.iter().zip(b)).map(|(a, b)| f64::from((a - b).abs())).sum::<f64>();
    differ / window.iter().map(|&v| f64::from(v)).sum::<f64>()
}

/// The spline of `coefficients` (n × n with margins) read at positions turned by −`azimuth_rad` about the centre.
fn turn(coefficients: &[f32], n: usize, azimuth_rad: f64, out: &mut Vec<f64>) {
    let (sin, cos) = real::sin_cos(azimuth_rad);
    let c = (n as f64 - 1.0) / 2.0;
    let width = n + 2 * MARGIN;
    out.clear();
    for row in 0..n {
        let y = row as f64 - c;
        for col in 0..n {
            let x = col as f64 - c;
            let (u, v) = (c + x * cos + y * sin, c - x * sin + y * cos);
            let (iu, iv) = (u.floor(), v.floor());
            let (wu, wv) = (spline::weights(u - iu), spline::weights(v - iv));
            // Farther out, among the zeros.
            let first = |i: f64| (i.clamp(-3.0, n as f64 + 1.0) + (MARGIN - 1) as f64) as usize;
            let from = &coefficients[first(iv) * width + first(iu)..];
            let mut sum = 0.0;
            for (line, wy) in from.chunks(width).zip(&wv) {
                for (c, wx) in line.iter().zip(&wu) {
                    sum += wy * wx * f64::from(*c);
                }
            }
            out.push(sum);
        }
    }
}

/// `kernel`, rows and columns `exchanged` or not, turned by `quarter` × 90° (+x → +y, down): exact.
fn quarter_turns(kernel: &[f32], n: usize, exchanged: bool, quarter: usize, out: &mut [f32]) {
    let last = n - 1;
    for (y, to) in out.chunks_exact_mut(n).enumerate() {
        for (x, to) in to.iter_mut().enumerate() {
            let (sy, sx) = match quarter {
                0 => (y, x),
                1 => (last - x, y),
                2 => (last - y, last - x),
                _ => (x, last - y),
            };
            *to = kernel[if exchanged { sx * n + sy } else { sy * n + sx }];
        }
    }
}

/// Weights of the samples in each film pixel, along one direction.
#[derive(Debug)]
struct Integrate {
    rows: Vec<Weights>,
}

/// Weights of the samples from `first` on.
#[derive(Debug)]
pub(super) struct Weights {
    first: usize,
    weights: Vec<f64>,
    /// Fewer of them, for sums in f32.
    #[cfg(target_arch = "x86_64")]
    pub(super) narrow: (usize, Vec<f32>),
}

/// Weights below this share are dropped: they fall by 0.27 a sample away from the pixel's edge.
const NEGLIGIBLE: f64 = 1e-12;
/// The same for sums in f32: under its resolution, summed over all that is dropped.
#[cfg(target_arch = "x86_64")]
const NEGLIGIBLE_F32: f64 = 5e-9;

/// Where the first weight above `limit` lies, and the end of the last.
fn above(weights: &[f64], limit: f64) -> (usize, usize) {
    let first = weights.iter().position(|w| w.abs() > limit).unwrap_or(0);
    (first, weights.iter().rposition(|w| w.abs() > limit).map_or(first, |e| e + 1))
}

impl Integrate {
    /// `samples` of `ratio` film pixels each, centre on centre, to `size` film pixels.
    fn new(samples: usize, ratio: f64, size: usize, kind: PsfSample) -> Self {
        // Keeps the spline's zero boundary two film pixels and 24 samples (0.27^24 = 2e-14) away from the window.
        let margin = 24 + (2.0 / ratio).ceil() as usize;
        let n = samples + 2 * margin;
        let centre = (samples as f64 - 1.0) / 2.0;
        let mut upper = vec![0.0; n + 1];
        let rows = (0..size).map(|i| {
            let middle = i as f64 - (size as f64 - 1.0) / 2.0;
            let (a, b) = (centre + (middle - 0.5) / ratio, centre + (middle + 0.5) / ratio);
            let mut w = vec![0.0; n + 1];
            match kind {
                PsfSample::Point => {
                    for (s, w) in w[..n].iter_mut().enumerate() {
                        let t = s as f64 - margin as f64;
                        *w = spline::cumulative(b - t) - spline::cumulative(a - t);
                    }
                    // B is symmetric: the weights of the values are B⁻¹ times those of the coefficients.
                    spline::coefficients(&mut w, 0, 1, n, &mut upper);
                }
                PsfSample::Integrated => {
                    // Edge e lies half a sample before sample e; the cumulative sum at it is Σ_{s<e} F_s.
                    let mut at = |edge: f64, sign: f64| {
                        let t = edge + 0.5 + margin as f64;
                        let cell = t.floor();
                        for (k, v) in spline::weights(t - cell).iter().enumerate() {
                            let e = cell as isize - 1 + k as isize;
                            if (0..=n as isize).contains(&e) {
                                w[e as usize] += sign * v;
                            }
                        }
                    };
                    at(b, 1.0);
                    at(a, -1.0);
                    spline::coefficients(&mut w, 0, 1, n + 1, &mut upper);
                    // From weights of the cumulative sums to weights of the samples: Σ over the edges beyond.
                    let mut beyond = w[n];
                    for s in (0..n).rev() {
                        beyond += std::mem::replace(&mut w[s], beyond);
                    }
                }
            }
            let inside = &w[margin..margin + samples];
            let (first, end) = above(inside, NEGLIGIBLE);
            Weights {
                first,
                weights: inside[first..end].to_vec(),
                #[cfg(target_arch = "x86_64")]
                narrow: {
                    let (first, end) = above(inside, NEGLIGIBLE_F32);
                    (first, inside[first..end].iter().map(|&w| w as f32).collect())
                },
            }
        });
        Self { rows: rows.collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn fine_points_turn_and_integrate_within_3_permille() {
        let grid = NodeGrid::new(&[0.0, 1.0], &[1, 72], 2e-3);
        for pitch in [0.5, 0.6, 0.4] {
            let stack = stack((4.0 * 13.0 / pitch / 2.0) as usize * 2 + 1, pitch, PsfSample::Point, 2.0);
            let kernels = NodeKernels::new(&stack, 2.0, None, Simd::detect());
            let n = kernels.size();
            let mut out = vec![0.0; n * n];
            for j in [0, 1, 5, 9, 17, 18, 31, 54, 70] {
                let node = Node { k: 1, j };
                kernels.kernel(&grid, node, &mut KernelScratch::default(), &mut out);
                let want = exact(n, grid.azimuth_rad(node));
                let l1: f64 = out.iter().zip(&want).map(|(a, b)| (f64::from(*a) - b).abs()).sum();
                assert!(l1 < 3e-3, "pitch {pitch}, azimuth {j} of 72: L1 {l1:.1e}");
                let sum: f64 = out.iter().map(|&v| f64::from(v)).sum();
                assert!((sum - 1.0).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn integrated_stacks_at_film_pitch_are_used_as_they_are() {
        let stack = stack(15, 2.0, PsfSample::Integrated, 2.0);
        let kernels = NodeKernels::new(&stack, 2.0, None, Simd::PORTABLE);
        let grid = NodeGrid::new(&[0.0, 1.0], &[1, 8], 2e-3);
        let mut out = vec![0.0; 225];
        kernels.kernel(&grid, Node { k: 1, j: 0 }, &mut KernelScratch::default(), &mut out);
        assert_eq!(out, stack.window(1));
        kernels.kernel(&grid, Node { k: 1, j: 2 }, &mut KernelScratch::default(), &mut out);
        // +x turns to +y, down: what lay 3 right of the centre lies 3 below it.
        assert_eq!(out[10 * 15 + 7], stack.window(1)[7 * 15 + 10]);
        assert!((kernels.energy()[1] - 1.0).abs() < 1e-12);
    }

    #[test]
    fn integrated_samples_add_up_to_a_coarser_pitch() {
        let fine = stack(45, 2.0, PsfSample::Integrated, 6.0);
        let kernels = NodeKernels::new(&fine, 6.0, None, Simd::PORTABLE);
        assert_eq!(kernels.size(), 15);
        let grid = NodeGrid::new(&[0.0, 1.0], &[1, 4], 6e-3);
        let mut out = vec![0.0; 225];
        kernels.kernel(&grid, Node { k: 1, j: 0 }, &mut KernelScratch::default(), &mut out);
        for y in 0..15 {
            for x in 0..15 {
                let want: f32 = (0..9).map(|s| fine.samples[(3 * y + s / 3) * 45 + 3 * x + s % 3]).sum();
                assert!((out[y * 15 + x] - want).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn a_cropped_window_is_normalised_and_its_share_recorded() {
        let stack = stack(15, 2.0, PsfSample::Integrated, 2.0);
        let kernels = NodeKernels::new(&stack, 2.0, Some(5), Simd::PORTABLE);
        assert_eq!(kernels.size(), 5);
        let share: f32 = (0..25).map(|i| stack.samples[(5 + i / 5) * 15 + 5 + i % 5]).sum();
        assert!((kernels.energy()[0] - f64::from(share)).abs() < 1e-6);
        assert!(share < 0.99);
    }

    /// A comet: an elliptical Gaussian and a fainter one farther out, `skew` times off the meridian.
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

    #[test]
    fn mirror_images_are_made_of_one_seed_and_others_are_not() {
        let grid = NodeGrid::new(&[0.0, 1.0], &[1, 72], 2e-3);
        let seeds = |skew: f64| {
            let kernels = NodeKernels::new(&comet(121, 0.5, skew), 2.0, None, Simd::PORTABLE);
            let seeds: Vec<Node> = (0..72).map(|j| kernels.making(&grid, Node { k: 1, j }).seed).collect();
            for j in [7, 11, 13, 20, 34, 47, 52, 65] {
                let mut plain = KernelScratch::default();
                kernels.turned(1, grid.azimuth_rad(Node { k: 1, j }), &mut plain);
                let made = kernel_of(&kernels, &grid, j);
                let l1: f32 = made.iter().zip(&plain.seed).map(|(a, b)| (a - b).abs()).sum();
                assert!(l1 < 2e-6, "azimuth {j} of 72: L1 {l1:.1e}");
            }
            seeds.into_iter().collect::<std::collections::BTreeSet<_>>().len()
        };
        assert_eq!((seeds(0.0), seeds(0.01)), (10, 18));
    }
}
