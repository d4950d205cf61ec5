//! Complex FFTs of [`LANES`] sequences at once, in f32: sample i of all of them lie side by side.
//!
//! ```text
//! Z_k = Σ_i z_i exp(+2πi·ik/n)        (not scaled), n = 2^a·3^b·5^c
//! ```
//! Stockham's self-sorting form with radices 2, 3, 4 and 5. Sums and products are separate operations in a fixed order, and the roots of
//! unity are those of [`crate::real`]: the same bits on every machine, whatever instructions the compiler chooses.
//! Source: Van Loan, Computational Frameworks for the Fast Fourier Transform, section 1.7; radix 5: Nussbaumer, section 5.2.

use std::f64::consts::TAU;

use crate::real;

/// Sequences that are transformed together.
pub(super) const LANES: usize = 16;

/// A block of [`LANES`] sequences: real and imaginary parts, sample by sample.
#[derive(Clone, Debug, Default)]
pub(super) struct Block {
    pub(super) re: Vec<f32>,
    pub(super) im: Vec<f32>,
}

impl Block {
    fn resize(&mut self, samples: usize) {
        self.re.resize(samples * LANES, 0.0);
        self.im.resize(samples * LANES, 0.0);
    }
}

/// FFTs of one size.
#[derive(Debug)]
pub(super) struct Fft {
    n: usize,
    stages: Vec<Stage>,
}

/// A stage: its radix R, the number m of its twiddle factors, and w^{pk} for k = 1..R of each p < m.
#[derive(Debug)]
struct Stage {
    radix: usize,
    arm: usize,
    twiddles: Vec<[f32; 2]>,
}

/// The next even number with factors 2, 3, 5 only.
pub(super) fn good_size(min: usize) -> usize {
    let smooth = |mut n: usize| {
        for p in [2, 3, 5] {
            while n.is_multiple_of(p) {
                n /= p;
            }
        }
        n == 1
    };
    (min.next_multiple_of(2)..).step_by(2).find(|n| smooth(*n)).expect("there is always a larger one")
}

impl Fft {
    /// Transforms of `n` samples; n has the factors 2, 3 and 5 only.
    pub(super) fn new(n: usize) -> Self {
        let (mut rest, mut stages) = (n, Vec::new());
        while rest > 1 {
            let radix = [4, 5, 3, 2].into_iter().find(|r| rest.is_multiple_of(*r)).expect("smooth size");
            let arm = rest / radix;
            let power = |pk: usize| {
                let (sin, cos) = real::sin_cos(TAU * pk as f64 / rest as f64);
                [cos as f32, sin as f32]
            };
            let twiddles = (0..arm).flat_map(|p| (1..radix).map(move |k| power(p * k))).collect();
            stages.push(Stage { radix, arm, twiddles });
            rest = arm;
        }
        Self { n, stages }
    }

    /// Transforms the sequences of `data`, whose first `filled` samples are given; the others are taken as 0.
    #[inline(always)]
    pub(super) fn process(&self, data: &mut Block, filled: usize, buffer: &mut Block) {
        data.resize(filled);
        data.resize(self.n);
        buffer.resize(self.n);
        let mut stride = LANES;
        for stage in &self.stages {
            match stage.radix {
                2 => stage.run::<2>(data, buffer, stride, butterfly2),
                3 => stage.run::<3>(data, buffer, stride, butterfly3),
                4 => stage.run::<4>(data, buffer, stride, butterfly4),
                _ => stage.run::<5>(data, buffer, stride, butterfly5),
            }
            std::mem::swap(data, buffer);
            stride *= stage.radix;
        }
    }
}

/// Values that one operation works on: a part of [`LANES`] that the compiler keeps in registers.
const WIDTH: usize = 8;

type Vector = [f32; WIDTH];
type Complex = (Vector, Vector);

impl Stage {
    #[inline(always)]
    fn run<const R: usize>(
        &self,
        from: &Block,
        to: &mut Block,
        stride: usize,
        butterfly: impl Fn([Complex; R]) -> [Complex; R],
    ) {
        let vectors = stride / WIDTH;
        let (from_re, from_im) = (from.re.as_chunks::<WIDTH>().0, from.im.as_chunks::<WIDTH>().0);
        let to_re = to.re.as_chunks_mut::<WIDTH>().0.chunks_exact_mut(R * vectors);
        let to_im = to.im.as_chunks_mut::<WIDTH>().0.chunks_exact_mut(R * vectors);
        for (p, (to_re, to_im)) in to_re.zip(to_im).enumerate() {
            let w: [[f32; 2]; R] =
                std::array::from_fn(|k| if k == 0 { [1.0, 0.0] } else { self.twiddles[p * (R - 1) + k - 1] });
            let part = |k: usize| (p + k * self.arm) * vectors..(p + k * self.arm + 1) * vectors;
            let re: [&[Vector]; R] = std::array::from_fn(|k| &from_re[part(k)]);
            let im: [&[Vector]; R] = std::array::from_fn(|k| &from_im[part(k)]);
            for i in 0..vectors {
                let y = butterfly(std::array::from_fn(|k| (re[k][i], im[k][i])));
                for k in 0..R {
                    let (a, b) = if k == 0 { y[0] } else { times(y[k], w[k]) };
                    to_re[k * vectors + i] = a;
                    to_im[k * vectors + i] = b;
                }
            }
        }
    }
}

#[inline(always)]
fn combine(a: Vector, b: Vector, f: impl Fn(f32, f32) -> f32) -> Vector {
    std::array::from_fn(|i| f(a[i], b[i]))
}

#[inline(always)]
fn add(a: Complex, b: Complex) -> Complex {
    (combine(a.0, b.0, |a, b| a + b), combine(a.1, b.1, |a, b| a + b))
}

#[inline(always)]
fn sub(a: Complex, b: Complex) -> Complex {
    (combine(a.0, b.0, |a, b| a - b), combine(a.1, b.1, |a, b| a - b))
}

/// a·w.
#[inline(always)]
fn times(a: Complex, [c, s]: [f32; 2]) -> Complex {
    (combine(a.0, a.1, |re, im| re * c - im * s), combine(a.0, a.1, |re, im| re * s + im * c))
}

/// a + s·b for real s.
#[inline(always)]
fn scaled(a: Complex, b: Complex, s: f32) -> Complex {
    (combine(a.0, b.0, |a, b| a + s * b), combine(a.1, b.1, |a, b| a + s * b))
}

/// s·a + t·b for real s and t.
#[inline(always)]
fn weighted(a: Complex, b: Complex, s: f32, t: f32) -> Complex {
    (combine(a.0, b.0, |a, b| s * a + t * b), combine(a.1, b.1, |a, b| s * a + t * b))
}

/// a + i·b and a − i·b.
#[inline(always)]
fn around(a: Complex, b: Complex) -> (Complex, Complex) {
    let plus = (combine(a.0, b.1, |a, b| a - b), combine(a.1, b.0, |a, b| a + b));
    let minus = (combine(a.0, b.1, |a, b| a + b), combine(a.1, b.0, |a, b| a - b));
    (plus, minus)
}

#[inline(always)]
fn butterfly2([a, b]: [Complex; 2]) -> [Complex; 2] {
    [add(a, b), sub(a, b)]
}

#[inline(always)]
fn butterfly3([a, b, c]: [Complex; 3]) -> [Complex; 3] {
    let sum = add(b, c);
    let side = weighted(b, c, 0.866_025_4, -0.866_025_4);
    let (plus, minus) = around(scaled(a, sum, -0.5), side);
    [add(a, sum), plus, minus]
}

#[inline(always)]
fn butterfly4([a, b, c, d]: [Complex; 4]) -> [Complex; 4] {
    let (even, odd) = (add(a, c), add(b, d));
    let (plus, minus) = around(sub(a, c), sub(b, d));
    [add(even, odd), plus, sub(even, odd), minus]
}

#[inline(always)]
fn butterfly5([a, b, c, d, e]: [Complex; 5]) -> [Complex; 5] {
    // cos and sin of 2π/5 and 4π/5.
    const C: [f32; 2] = [0.309_017, -0.809_017];
    const S: [f32; 2] = [0.951_056_5, 0.587_785_25];
    let (sum1, sum2, difference1, difference2) = (add(b, e), add(c, d), sub(b, e), sub(c, d));
    let middle1 = scaled(scaled(a, sum1, C[0]), sum2, C[1]);
    let middle2 = scaled(scaled(a, sum1, C[1]), sum2, C[0]);
    let (first, fourth) = around(middle1, weighted(difference1, difference2, S[0], S[1]));
    let (second, third) = around(middle2, weighted(difference1, difference2, S[1], -S[0]));
    [add(a, add(sum1, sum2)), first, second, third, fourth]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transform_equals_the_sum() {
        for n in [24_usize, 30, 64, 90, 250, 432] {
            let fft = Fft::new(n);
            let filled = n * 2 / 3;
            let value = |i: usize| {
                let x = (i as f32 * 0.618_034).fract() - 0.5;
                if i / LANES < filled { x } else { 0.0 }
            };
            let mut data = Block {
                re: (0..filled * LANES).map(value).collect(),
                im: (0..filled * LANES).map(|i| value(7 * i + 3)).collect(),
            };
            let given = data.clone();
            fft.process(&mut data, filled, &mut Block::default());
            for k in 0..n {
                for lane in [0, 5, LANES - 1] {
                    let (mut re, mut im) = (0.0, 0.0);
                    for i in 0..filled {
                        let (s, c) = real::sin_cos(TAU * (i * k % n) as f64 / n as f64);
                        let (a, b) =
                            (f64::from(given.re[i * LANES + lane]), f64::from(given.im[i * LANES + lane]));
                        re += a * c - b * s;
                        im += a * s + b * c;
                    }
                    let error = real::hypot(
                        f64::from(data.re[k * LANES + lane]) - re,
                        f64::from(data.im[k * LANES + lane]) - im,
                    );
                    assert!(error < 2e-6 * (n as f64).sqrt(), "{n}: {error:e}");
                }
            }
        }
    }
}
