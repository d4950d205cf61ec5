//! Quantiles of the normal and of Poisson's distribution, from + − × ÷ √ and bit patterns alone: the same bits on every machine.
//!
//! Normal: z with Φ(z) = u by M. J. Wichura, algorithm AS 241 (PPND16), Applied Statistics 37 (1988); relative error 10⁻¹⁶.
//! Poisson: the u-quantile. For a mean below 32 the sum of probabilities, exact to 2⁻⁵²; from 32 on the asymptotic quantile of third order of
//! M. B. Giles (algorithm 955, ACM Transactions on Mathematical Software 42, 2016): cumulative probability within 4·10⁻⁶, mean within 10⁻¹⁰,
//! variance within 3·10⁻⁵, falling as 1/mean. One uniform number a pixel and no rejection: more light never gives fewer electrons.
//!
//! Nothing here may be fused (× and + to one rounding) or replaced by a function of a C library: results are the contract, bit for bit.

#![allow(clippy::excessive_precision, reason = "coefficients as published")]

use std::f64::consts::LN_2;

/// Pixels of a row that are computed together.
pub const LANES: usize = 128;

/// Means from here on use the asymptotic quantile.
const POISSON_EXACT_BELOW: f64 = 32.0;
/// The sum of probabilities ends, past the mode, with a term below this.
const POISSON_LAST: f64 = 1.0 / 18_014_398_509_481_984.0;
/// Half of the width of the middle branch of AS 241.
const MIDDLE: f64 = 0.425;

/// ln x of a normal x > 0: x = m·2^e with m in [√½, √2), ln m = 2 artanh((m − 1)/(m + 1)). At most 2 units in the last place off.
#[inline(always)]
pub fn ln(x: f64) -> f64 {
    let bits = x.to_bits();
    let m = f64::from_bits(bits & 0x000f_ffff_ffff_ffff | 0x3fe0_0000_0000_0000);
    let e = f64::from_bits(0x4330_0000_0000_0000 | bits >> 52) - (4_503_599_627_370_496.0 + 1022.0);
    let low = m < std::f64::consts::FRAC_1_SQRT_2;
    let (m, e) = (if low { m * 2.0 } else { m }, if low { e - 1.0 } else { e });
    let s = (m - 1.0) / (m + 1.0);
    let z = s * s;
    // z ≤ 0.0295: the next term is below 1e-17.
    let mut p = 1.0 / 23.0;
    for c in [
        1.0 / 21.0,
        1.0 / 19.0,
        1.0 / 17.0,
        1.0 / 15.0,
        1.0 / 13.0,
        1.0 / 11.0,
        1.0 / 9.0,
        1.0 / 7.0,
        1.0 / 5.0,
        1.0 / 3.0,
        1.0,
    ] {
        p = p * z + c;
    }
    (2.0 * s) * p + e * LN_2
}

/// eˣ for |x| < 700: x = n ln 2 + r with ln 2 in two parts, Taylor's sum up to r¹³.
pub fn exp(x: f64) -> f64 {
    let n = (x * std::f64::consts::LOG2_E + 0.5).floor();
    let r = (x - n * 6.931_471_803_691_238_164_90e-1) - n * 1.908_214_929_270_587_700_02e-10;
    let mut p = 1.0 / 6_227_020_800.0;
    for f in [
        479_001_600.0,
        39_916_800.0,
        3_628_800.0,
        362_880.0,
        40_320.0,
        5040.0,
        720.0,
        120.0,
        24.0,
        6.0,
        2.0,
        1.0,
        1.0,
    ] {
        p = p * r + 1.0 / f;
    }
    // |n| ≤ 1010, so 2^n is a normal number.
    p * f64::from_bits(((n as i64 + 1023) as u64) << 52)
}

type Polynomial = [f64; 8];
const A: Polynomial = [
    2509.0809287301226727,
    33430.575583588128105,
    67265.770927008700853,
    45921.953931549871457,
    13731.693765509461125,
    1971.5909503065514427,
    133.14166789178437745,
    3.3871328727963666080,
];
const B: Polynomial = [
    5226.4952788528545610,
    28729.085735721942674,
    39307.895800092710610,
    21213.794301586595867,
    5394.1960214247511077,
    687.18700749205790830,
    42.313330701600911252,
    1.0,
];
const C: Polynomial = [
    7.74545014278341407640e-4,
    0.0227238449892691845833,
    0.241780725177450611770,
    1.27045825245236838258,
    3.64784832476320460504,
    5.76949722146069140550,
    4.63033784615654529590,
    1.42343711074968357734,
];
const D: Polynomial = [
    1.05075007164441684324e-9,
    5.47593808499534494600e-4,
    0.0151986665636164571966,
    0.148103976427480074590,
    0.689767334985100004550,
    1.67638483018380384940,
    2.05319162663775882187,
    1.0,
];
const E: Polynomial = [
    2.01033439929228813265e-7,
    2.71155556874348757815e-5,
    0.00124266094738807843860,
    0.0265321895265761230930,
    0.296560571828504891230,
    1.78482653991729133580,
    5.46378491116411436990,
    6.65790464350110377720,
];
const F: Polynomial = [
    2.04426310338993978564e-15,
    1.42151175831644588870e-7,
    1.84631831751005468180e-5,
    7.86869131145613259100e-4,
    0.0148753612908506148525,
    0.136929880922735805310,
    0.599832206555887937690,
    1.0,
];

#[inline(always)]
fn horner(c: &Polynomial, x: f64) -> f64 {
    c[1..].iter().fold(c[0], |p, k| p * x + k)
}

#[inline(always)]
fn middle(q: f64) -> f64 {
    let r = 0.180625 - q * q;
    q * horner(&A, r) / horner(&B, r)
}

/// Beyond the middle: √(−ln of the distance from the nearer end) up to 5.
#[inline(always)]
fn tail(t: f64) -> f64 {
    let a = t - 1.6;
    horner(&C, a) / horner(&D, a)
}

/// The same above 5, where u is within 1.4·10⁻¹¹ of an end.
fn far_tail(t: f64) -> f64 {
    let b = t - 5.0;
    horner(&E, b) / horner(&F, b)
}

/// z with Φ(z) = u, 0 < u < 1.
pub fn normal_quantile(u: f64) -> f64 {
    let q = u - 0.5;
    if q.abs() <= MIDDLE {
        return middle(q);
    }
    let t = (-ln(if q < 0.0 { u } else { 1.0 - u })).sqrt();
    let z = if t <= 5.0 { tail(t) } else { far_tail(t) };
    if q < 0.0 { -z } else { z }
}

/// [`normal_quantile`] of many numbers: the middle of all, then the tails (15 % of them) collected.
#[inline(always)]
pub fn normal_quantiles(u: &[f64; LANES]) -> [f64; LANES] {
    let mut z = u.map(|u| middle(u - 0.5));
    let (mut place, mut count) = ([0usize; LANES], 0);
    for (i, u) in u.iter().enumerate() {
        place[count] = i;
        count += usize::from((u - 0.5).abs() > MIDDLE);
    }
    let mut t = [1.0; LANES];
    for (t, &i) in std::iter::zip(&mut t, &place[..count]) {
        *t = if u[i] < 0.5 { u[i] } else { 1.0 - u[i] };
    }
    // Whole groups of eight: the padding is computed and discarded.
    let end = count.next_multiple_of(8).min(LANES);
    let mut tails = [0.0; LANES];
    for (z, t) in std::iter::zip(&mut tails[..end], &mut t[..end]) {
        *t = (-ln(*t)).sqrt();
        *z = tail(*t);
    }
    for k in 0..count {
        let i = place[k];
        let size = if t[k] <= 5.0 { tails[k] } else { far_tail(t[k]) };
        z[i] = if u[i] < 0.5 { -size } else { size };
    }
    z
}

/// The quantile of Poisson's distribution from 32 on, `w` the normal quantile of the same probability.
#[inline(always)]
fn poisson_asymptotic(mean: f64, w: f64) -> f64 {
    let root = mean.sqrt();
    let w2 = w * w;
    let x = mean + root * w;
    let x = x + (w2 / 6.0 + 1.0 / 3.0);
    let x = x + (w * (-1.0 / 36.0 - w2 / 72.0)) / root;
    let x = x + ((w2 / 270.0 + 7.0 / 810.0) * w2 - 8.0 / 405.0) / mean;
    let whole = x.floor();
    if whole > 0.0 { whole } else { 0.0 }
}

/// The quantile below a mean of 32: probabilities are added until they exceed `u`.
fn poisson_summed(mean: f64, u: f64) -> f64 {
    let mut p = exp(-mean);
    let (mut s, mut n) = (p, 0.0);
    while u > s && p > POISSON_LAST && n < 128.0 {
        n += 1.0;
        p *= mean / n;
        s += p;
    }
    n
}

/// The `u`-quantile of Poisson's distribution.
pub fn poisson(mean: f64, u: f64) -> f64 {
    match mean < POISSON_EXACT_BELOW {
        true => poisson_summed(mean, u),
        false => poisson_asymptotic(mean, normal_quantile(u)),
    }
}

/// [`poisson`] of many means and numbers.
#[inline(always)]
pub fn poissons(mean: &[f64; LANES], u: &[f64; LANES]) -> [f64; LANES] {
    let small = mean.iter().filter(|m| **m < POISSON_EXACT_BELOW).count();
    let mut n = [0.0; LANES];
    if small < LANES {
        let w = normal_quantiles(u);
        for (n, (mean, w)) in std::iter::zip(&mut n, std::iter::zip(mean, &w)) {
            let mean = if *mean < POISSON_EXACT_BELOW { POISSON_EXACT_BELOW } else { *mean };
            *n = poisson_asymptotic(mean, *w);
        }
    }
    if small > 0 {
        for (n, (mean, u)) in std::iter::zip(&mut n, std::iter::zip(mean, u)) {
            if *mean < POISSON_EXACT_BELOW {
                *n = poisson_summed(*mean, *u);
            }
        }
    }
    n
}

#[cfg(test)]
mod tests;
