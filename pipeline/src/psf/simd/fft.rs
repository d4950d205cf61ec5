//! Complex FFTs of any size 2^a·3^b·5^c, one per lane: element i holds sample i of all of them.
//!
//! ```text
//! forward  Z_k = Σ_i z_i exp(−2πi·ik/n),   inverse  z_i = Σ_k Z_k exp(+2πi·ik/n)   (not scaled)
//! ```
//! Mixed radix 2, 3, 4, 5, 6, 8. Forward by decimation in frequency (natural order in, digits of k reversed out), inverse by
//! decimation in time (digits reversed in, natural order out); products of spectra are independent of the order, so it is never
//! restored. A stage of radix R works on sections of R·m elements, R arms of length m:
//! ```text
//! y_q(j) = w^{jq} Σ_p x_p(j) exp(−2πi·pq/R),   w = exp(−2πi/(R·m))
//! ```
//! The last forward stage (m = 1) can multiply by a spectrum and accumulate instead of storing.
//! Source: Cooley and Tukey, Math. Comp. 19 (1965) 297; radix 6 as 2 × 3 by Good's prime factors (no twiddles).
#![allow(unsafe_code, reason = "bounds are checked once per stage, not once per element")]

use super::complex::Complex;
use crate::real;
use crate::simd::lanes::{Dispatch, Lanes, SimdOp};
use bytemuck::{Zeroable, cast_slice};
use std::f64::consts::TAU;
use std::ops::Range;

/// FFTs of one size.
#[derive(Debug)]
pub(super) struct Fft<V> {
    dispatch: Dispatch<V>,
    stages: Vec<Stage>,
}

/// A stage: its radix, the length m of an arm, and w^{jq} for q = 1.. of each j.
#[derive(Debug)]
struct Stage {
    radix: usize,
    arm: usize,
    twiddles: Vec<[f32; 2]>,
}

/// Radices and the approximate cost of a stage per element: 1 for the pass through memory, the rest for arithmetic.
const RADICES: [(usize, f64); 6] = [(2, 1.0), (3, 1.15), (4, 1.1), (5, 1.45), (6, 1.4), (8, 1.4)];

/// Cost and list of the cheapest radices whose product is `n`, ascending: large ones last, where arms are short and twiddles few.
fn radices(n: usize) -> (f64, Vec<usize>) {
    if n == 1 {
        return (0.0, Vec::new());
    }
    let divisors = RADICES.iter().filter(|(radix, _)| n.is_multiple_of(*radix));
    let candidates = divisors.map(|(radix, cost)| {
        let (rest, mut radices) = radices(n / radix);
        radices.push(*radix);
        radices.sort_unstable();
        (rest + cost, radices)
    });
    candidates.min_by(|a, b| a.0.total_cmp(&b.0)).expect("FFT sizes have the factors 2, 3 and 5 only")
}

impl<V: Lanes> Fft<V> {
    pub(super) fn new(n: usize, dispatch: Dispatch<V>) -> Self {
        let mut arm = n;
        let stages = radices(n).1.into_iter().map(|radix| {
            let len = arm;
            arm /= radix;
            let power = |jq: usize| {
                let (sin, cos) = real::sin_cos(-TAU * jq as f64 / len as f64);
                [cos as f32, sin as f32]
            };
            let twiddles = (0..arm).flat_map(|j| (1..radix).map(move |q| power(j * q))).collect();
            Stage { radix, arm, twiddles }
        });
        Self { dispatch, stages: stages.collect() }
    }

    /// In place; output in digit-reversed order.
    pub(super) fn forward(&self, data: &mut [Complex<V>]) {
        for stage in &self.stages {
            self.butterflies::<false>(stage, data);
        }
    }

    /// The transform of `from`, then zeros, to `line`; output in digit-reversed order.
    pub(super) fn forward_from(&self, from: &[Complex<V>], line: &mut [Complex<V>]) {
        let (opening, stages) = self.stages.split_first().expect("FFT sizes are 64 and more");
        self.first_butterflies(opening, from, line);
        for stage in stages {
            self.butterflies::<false>(stage, line);
        }
    }

    /// In place; input in digit-reversed order.
    pub(super) fn inverse(&self, data: &mut [Complex<V>]) {
        for stage in self.stages.iter().rev() {
            self.butterflies::<true>(stage, data);
        }
    }

    /// `sum` += (transform of `from`, then zeros) · `spectrum`, or `sum` = that product if `first`. `line` holds what is between the stages. `next`, as long as `spectrum` or empty, is prefetched.
    pub(super) fn forward_onto(
        &self,
        from: &[Complex<V>],
        line: &mut [Complex<V>],
        (spectrum, next): (&[Complex<V>], &[Complex<V>]),
        sum: &mut [Complex<V>],
        first: bool,
    ) {
        let [opening, stages @ .., last] = &self.stages[..] else {
            unreachable!("FFT sizes are 64 and more")
        };
        self.first_butterflies(opening, from, line);
        macro_rules! run {
            ($data:ident, $spectrum:ident, $next:ident, $sum:ident: $($r:literal)*) => {
                match (last.radix, first) {
                    $(($r, true) => self.dispatch.run(Accumulate::<V, $r, true> { data: $data, spectrum: $spectrum, next: $next, sum: $sum }),
                      ($r, false) => self.dispatch.run(Accumulate::<V, $r, false> { data: $data, spectrum: $spectrum, next: $next, sum: $sum }),)*
                    _ => unreachable!("radices"),
                }
            };
        }
        // Section by section of the first stage: its elements are in L1 for the stages that follow.
        let sections = line.chunks_exact_mut(opening.arm).zip(spectrum.chunks_exact(opening.arm));
        let mut next = next.chunks_exact(opening.arm);
        for ((data, spectrum), sum) in sections.zip(sum.chunks_exact_mut(opening.arm)) {
            let next = next.next().unwrap_or_default();
            for stage in stages {
                self.butterflies::<false>(stage, data);
            }
            run!(data, spectrum, next, sum: 2 3 4 5 6 8);
        }
    }

    fn first_butterflies(&self, stage: &Stage, from: &[Complex<V>], to: &mut [Complex<V>]) {
        let (arm, twiddles) = (stage.arm, &stage.twiddles[..]);
        macro_rules! run {
            ($($r:literal)*) => {
                match stage.radix {
                    $($r => self.dispatch.run(Opening::<V, $r> { from, to, arm, twiddles }),)*
                    _ => unreachable!("radices"),
                }
            };
        }
        run!(2 3 4 5 6 8);
    }

    fn butterflies<const INVERSE: bool>(&self, stage: &Stage, data: &mut [Complex<V>]) {
        let (arm, twiddles) = (stage.arm, &stage.twiddles[..]);
        macro_rules! run {
            ($($r:literal)*) => {
                match (stage.radix, arm) {
                    $(($r, 1) => self.dispatch.run(Butterflies::<V, $r, INVERSE, false> { data, arm, twiddles }),
                      ($r, _) => self.dispatch.run(Butterflies::<V, $r, INVERSE, true> { data, arm, twiddles }),)*
                    _ => unreachable!("radices"),
                }
            };
        }
        run!(2 3 4 5 6 8);
    }
}

/// One stage; `TWIDDLE` if there are twiddle factors other than 1.
struct Butterflies<'a, V, const R: usize, const INVERSE: bool, const TWIDDLE: bool> {
    data: &'a mut [Complex<V>],
    arm: usize,
    twiddles: &'a [[f32; 2]],
}

impl<V: Lanes, const R: usize, const INVERSE: bool, const TWIDDLE: bool> SimdOp<V>
    for Butterflies<'_, V, R, INVERSE, TWIDDLE>
{
    #[inline(always)]
    fn run(self) {
        let arm = if TWIDDLE { self.arm } else { 1 };
        let mut x = [Complex::zeroed(); R];
        for section in self.data.chunks_exact_mut(R * arm) {
            for (j, w) in self.twiddles.chunks_exact(R - 1).take(arm).enumerate() {
                for q in 0..R {
                    // SAFETY: q < R and j < arm, so it lies in the R·arm elements of the section.
                    x[q] = unsafe { *section.get_unchecked(q * arm + j) };
                    if TWIDDLE && INVERSE && q > 0 {
                        x[q] = x[q].times_conjugate(w[q - 1]);
                    }
                }
                butterfly::<V, R, INVERSE>(&mut x);
                for q in 0..R {
                    if TWIDDLE && !INVERSE && q > 0 {
                        x[q] = x[q].times(w[q - 1]);
                    }
                    // SAFETY: as above.
                    unsafe { *section.get_unchecked_mut(q * arm + j) = x[q] };
                }
            }
        }
    }
}

/// The first forward stage of data that is 0 beyond `from`.
struct Opening<'a, V, const R: usize> {
    from: &'a [Complex<V>],
    to: &'a mut [Complex<V>],
    arm: usize,
    twiddles: &'a [[f32; 2]],
}

impl<V: Lanes, const R: usize> SimdOp<V> for Opening<'_, V, R> {
    #[inline(always)]
    fn run(mut self) {
        let (full, rest) = (self.from.len() / self.arm, self.from.len() % self.arm);
        self.butterflies(full + 1, 0..rest);
        self.butterflies(full, rest..self.arm);
    }
}

impl<V: Lanes, const R: usize> Opening<'_, V, R> {
    /// Those of the elements `range` of the arms, of which the first `arms` have data.
    #[inline(always)]
    fn butterflies(&mut self, arms: usize, range: Range<usize>) {
        macro_rules! run {
            ($($n:literal)*) => {
                match arms {
                    0 => self.of_arms::<0>(range),
                    $($n if $n <= R => self.of_arms::<$n>(range),)*
                    _ => unreachable!("there are R arms"),
                }
            };
        }
        if !range.is_empty() {
            run!(1 2 3 4 5 6 7 8);
        }
    }

    #[inline(always)]
    fn of_arms<const N: usize>(&mut self, range: Range<usize>) {
        let (from, to) = (self.from, &mut self.to[..R * self.arm]);
        let is_filled = N == 0 || from.len() >= (N - 1) * self.arm + range.end;
        assert!(is_filled && range.end <= self.arm, "the first arms have data");
        let twiddles = &self.twiddles[range.start * (R - 1)..range.end * (R - 1)];
        for (j, w) in range.zip(twiddles.chunks_exact(R - 1)) {
            let mut x = [Complex::zeroed(); R];
            for (q, x) in x.iter_mut().enumerate().take(N) {
                // SAFETY: checked above.
                *x = unsafe { *from.get_unchecked(q * self.arm + j) };
            }
            butterfly::<V, R, false>(&mut x);
            for q in 0..R {
                let y = if q > 0 { x[q].times(w[q - 1]) } else { x[q] };
                // SAFETY: q < R and j < arm, so it lies in the R·arm elements of `to`.
                unsafe { *to.get_unchecked_mut(q * self.arm + j) = y };
            }
        }
    }
}

/// The last forward stage, multiplied by a spectrum and accumulated; `FIRST` if it is the first term of the sum.
struct Accumulate<'a, V, const R: usize, const FIRST: bool> {
    data: &'a [Complex<V>],
    spectrum: &'a [Complex<V>],
    next: &'a [Complex<V>],
    sum: &'a mut [Complex<V>],
}

impl<V: Lanes, const R: usize, const FIRST: bool> SimdOp<V> for Accumulate<'_, V, R, FIRST> {
    #[inline(always)]
    fn run(self) {
        let len = self.sum.len();
        let (data, spectrum) = (&self.data[..len], &self.spectrum[..len]);
        let next: &[f32] = cast_slice(self.next);
        let mut x = [Complex::zeroed(); R];
        for first in (0..len / R).map(|section| section * R) {
            for (q, x) in x.iter_mut().enumerate() {
                // SAFETY: first + q < R · ⌊len/R⌋ ≤ len, the length of all three.
                *x = unsafe { *data.get_unchecked(first + q) };
            }
            if !next.is_empty() {
                prefetch::<V>(next, first, R);
            }
            butterfly::<V, R, false>(&mut x);
            for q in 0..R {
                // SAFETY: as above.
                let (x, k) = (x[q], unsafe { spectrum.get_unchecked(first + q) });
                // SAFETY: as above.
                let sum = unsafe { self.sum.get_unchecked_mut(first + q) };
                *sum = match FIRST {
                    true => {
                        Complex { re: x.re.mul_sub(k.re, x.im * k.im), im: x.re.mul_add(k.im, x.im * k.re) }
                    }
                    false => Complex {
                        re: x.im.neg_mul_add(k.im, x.re.mul_add(k.re, sum.re)),
                        im: x.im.mul_add(k.re, x.re.mul_add(k.im, sum.im)),
                    },
                };
            }
        }
    }
}

/// Prefetches `count` elements from the element `first` on into L2.
#[inline(always)]
fn prefetch<V: Lanes>(from: &[f32], first: usize, count: usize) {
    const LINE: usize = 16;
    let (start, end) = (first * 2 * V::LANES, (first + count) * 2 * V::LANES);
    for at in (start..end).step_by(LINE) {
        V::prefetch_l2(from, at);
    }
}

/// Prefetches elements that are read soon.
pub(super) struct Prefetch<'a, V>(pub(super) &'a [Complex<V>]);

impl<V: Lanes> SimdOp<V> for Prefetch<'_, V> {
    #[inline(always)]
    fn run(self) {
        prefetch::<V>(cast_slice(self.0), 0, self.0.len());
    }
}

/// A DFT of R elements, in place.
#[inline(always)]
fn butterfly<V: Lanes, const R: usize, const INVERSE: bool>(x: &mut [Complex<V>; R]) {
    match R {
        2 => (x[0], x[1]) = (x[0] + x[1], x[0] - x[1]),
        3 => [x[0], x[1], x[2]] = dft3::<V, INVERSE>([x[0], x[1], x[2]]),
        4 => [x[0], x[1], x[2], x[3]] = dft4::<V, INVERSE>([x[0], x[1], x[2], x[3]]),
        5 => [x[0], x[1], x[2], x[3], x[4]] = dft5::<V, INVERSE>([x[0], x[1], x[2], x[3], x[4]]),
        6 => {
            let a = dft3::<V, INVERSE>([x[0], x[2], x[4]]);
            let b = dft3::<V, INVERSE>([x[3], x[5], x[1]]);
            (x[0], x[1], x[2]) = (a[0] + b[0], a[1] - b[1], a[2] + b[2]);
            (x[3], x[4], x[5]) = (a[0] - b[0], a[1] + b[1], a[2] - b[2]);
        }
        8 => {
            let a = dft4::<V, INVERSE>([x[0], x[2], x[4], x[6]]);
            let b = dft4::<V, INVERSE>([x[1], x[3], x[5], x[7]]);
            let b1 = sub_i_times::<V, INVERSE>(b[1], b[1]); // b·(1 ∓ i) = √2 · b·exp(∓iπ/4)
            let b3 = add_i_times::<V, INVERSE>(b[3], b[3]); // b·(1 ± i) = √2 · b·exp(±iπ/4) = ±√2i · b·exp(∓3iπ/4)
            let r = V::splat(std::f32::consts::FRAC_1_SQRT_2);
            (x[0], x[4]) = (a[0] + b[0], a[0] - b[0]);
            (x[1], x[5]) = (scaled_add(a[1], b1, r), scaled_sub(a[1], b1, r));
            (x[2], x[6]) = (sub_i_times::<V, INVERSE>(a[2], b[2]), add_i_times::<V, INVERSE>(a[2], b[2]));
            (x[3], x[7]) = (scaled_sub(a[3], b3, r), scaled_add(a[3], b3, r));
        }
        _ => unreachable!("radices"),
    }
}

/// a − i·b, or a + i·b in the inverse.
#[inline(always)]
fn sub_i_times<V: Lanes, const INVERSE: bool>(a: Complex<V>, b: Complex<V>) -> Complex<V> {
    match INVERSE {
        true => Complex { re: a.re - b.im, im: a.im + b.re },
        false => Complex { re: a.re + b.im, im: a.im - b.re },
    }
}

/// a + i·b, or a − i·b in the inverse.
#[inline(always)]
fn add_i_times<V: Lanes, const INVERSE: bool>(a: Complex<V>, b: Complex<V>) -> Complex<V> {
    match INVERSE {
        true => sub_i_times::<V, false>(a, b),
        false => sub_i_times::<V, true>(a, b),
    }
}

/// a + r·b.
#[inline(always)]
fn scaled_add<V: Lanes>(a: Complex<V>, b: Complex<V>, r: V) -> Complex<V> {
    Complex { re: b.re.mul_add(r, a.re), im: b.im.mul_add(r, a.im) }
}

/// a − r·b.
#[inline(always)]
fn scaled_sub<V: Lanes>(a: Complex<V>, b: Complex<V>, r: V) -> Complex<V> {
    Complex { re: b.re.neg_mul_add(r, a.re), im: b.im.neg_mul_add(r, a.im) }
}

#[inline(always)]
fn dft3<V: Lanes, const INVERSE: bool>([a, b, c]: [Complex<V>; 3]) -> [Complex<V>; 3] {
    let (sum, difference) = (b + c, b - c);
    let middle = scaled_sub(a, sum, V::splat(0.5));
    // sin 2π/3; product with ±i·s and sum with one rounding.
    let s = V::splat(0.866_025_4);
    let plus =
        Complex { re: difference.im.mul_add(s, middle.re), im: difference.re.neg_mul_add(s, middle.im) };
    let minus =
        Complex { re: difference.im.neg_mul_add(s, middle.re), im: difference.re.mul_add(s, middle.im) };
    match INVERSE {
        true => [a + sum, minus, plus],
        false => [a + sum, plus, minus],
    }
}

#[inline(always)]
fn dft4<V: Lanes, const INVERSE: bool>([a, b, c, d]: [Complex<V>; 4]) -> [Complex<V>; 4] {
    let (even, odd) = (a + c, b + d);
    let (even2, odd2) = (a - c, b - d);
    [even + odd, sub_i_times::<V, INVERSE>(even2, odd2), even - odd, add_i_times::<V, INVERSE>(even2, odd2)]
}

#[inline(always)]
fn dft5<V: Lanes, const INVERSE: bool>([x, b, c, d, e]: [Complex<V>; 5]) -> [Complex<V>; 5] {
    // cos and sin of 2π/5 and 4π/5.
    let (c1, c2) = (V::splat(0.309_017), V::splat(-0.809_017));
    let (s1, s2) = (V::splat(0.951_056_5), V::splat(0.587_785_25));
    let (sum1, sum2, difference1, difference2) = (b + e, c + d, b - e, c - d);
    let middle1 = scaled_add(scaled_add(x, sum1, c1), sum2, c2);
    let middle2 = scaled_add(scaled_add(x, sum1, c2), sum2, c1);
    let side1 = Complex {
        re: difference2.re.mul_add(s2, difference1.re * s1),
        im: difference2.im.mul_add(s2, difference1.im * s1),
    };
    let side2 = Complex {
        re: difference1.re.mul_sub(s2, difference2.re * s1),
        im: difference1.im.mul_sub(s2, difference2.im * s1),
    };
    [
        x + (sum1 + sum2),
        sub_i_times::<V, INVERSE>(middle1, side1),
        sub_i_times::<V, INVERSE>(middle2, side2),
        add_i_times::<V, INVERSE>(middle2, side2),
        add_i_times::<V, INVERSE>(middle1, side1),
    ]
}
