//! Elementary functions with the same bits on every machine: those of the `libm` crate.
//!
//! The methods of `f64` call the C library of the host, whose last bit differs between versions and, in glibc, between processors with
//! and without fused multiply-add. Lens tables, PSFs, drawn charts and films are computed with the functions here (clippy's
//! `disallowed_methods` rejects the others in this crate); + − × ÷, the square root and rounding are exact in IEEE 754. One exception
//! depends on the host: the roots of unity of rustfft, computed in f64; the PSF stage rounds them to f32.

pub use libm::{
    asin, atan, atan2, cbrt, cos, erfc, exp, expm1, hypot, log, log1p, log2, log10, pow, sin,
    sincos as sin_cos, tan,
};

/// The modified Bessel function I₀ of x ≥ 0 below about 20, by its power series.
pub fn bessel_i0(x: f64) -> f64 {
    let (mut term, mut sum) = (1.0, 1.0);
    for k in 1..40 {
        term *= (x / (2.0 * f64::from(k))).powi(2);
        sum += term;
        // All further terms are smaller.
        if term < 1e-17 * sum && f64::from(k) > x {
            break;
        }
    }
    sum
}

/// sinc(u) times a Kaiser window.
#[derive(Clone, Copy, Debug)]
pub struct KaiserSinc {
    half: f64,
    shape: f64,
    at_zero: f64,
}

impl KaiserSinc {
    /// With a window of half-width `half` and shape `shape`.
    pub fn new(half: f64, shape: f64) -> Self {
        Self { half, shape, at_zero: bessel_i0(shape) }
    }

    /// The value at `u`, 0 beyond the window.
    pub fn at(&self, u: f64) -> f64 {
        let x = u / self.half;
        if x.abs() >= 1.0 {
            return 0.0;
        }
        let pi_u = std::f64::consts::PI * u;
        let sinc = if u == 0.0 { 1.0 } else { sin(pi_u) / pi_u };
        sinc * bessel_i0(self.shape * (1.0 - x * x).sqrt()) / self.at_zero
    }
}

/// 1.5 · 2^52: sums with it are rounded to whole numbers, which their last bits are, without a conversion; for numbers below 2^50.
pub const WHOLE: f64 = 6_755_399_441_055_744.0;

/// Cosine and sine of a number of turns below 2^50, by their power series within an eighth of a turn: errors below 4e-15, beside that of the number. Without branches,
/// so that loops of it are vectorised.
#[inline(always)]
pub fn cos_sin_of_turns(turns: f64) -> [f64; 2] {
    let turn = turns - ((turns + WHOLE) - WHOLE);
    let quarters = (4.0 * turn + WHOLE) - WHOLE;
    let x = std::f64::consts::TAU * (turn - 0.25 * quarters);
    let x2 = x * x;
    let even = [
        1.0,
        -1.0 / 2.0,
        1.0 / 24.0,
        -1.0 / 720.0,
        1.0 / 40_320.0,
        -1.0 / 3_628_800.0,
        1.0 / 479_001_600.0,
        -1.0 / 87_178_291_200.0,
    ];
    let odd = [
        1.0,
        -1.0 / 6.0,
        1.0 / 120.0,
        -1.0 / 5040.0,
        1.0 / 362_880.0,
        -1.0 / 39_916_800.0,
        1.0 / 6_227_020_800.0,
        -1.0 / 1_307_674_368_000.0,
    ];
    let series = |terms: [f64; 8]| terms.iter().rev().fold(0.0, |sum, term| sum * x2 + term);
    let (cos, sin) = (series(even), x * series(odd));
    // The quarters, −2 to 2: their cosine and sine are −1, 0 or 1.
    let side = 1.0 - quarters.abs();
    let up = quarters * (1.0 + side);
    [cos * side - sin * up, sin * side + cos * up]
}

#[cfg(test)]
mod tests {
    /// rustfft's own instruction detection is not compiled in.
    #[test]
    fn rustfft_has_no_simd_paths() {
        assert!(rustfft::FftPlannerAvx::<f32>::new().is_err());
        assert!(rustfft::FftPlannerSse::<f32>::new().is_err());
        assert!(rustfft::FftPlannerNeon::<f32>::new().is_err());
    }

    /// Bits of `libm` on any host; its exp(1) is one unit in the last place above the correctly rounded value.
    #[test]
    fn values_have_fixed_bits() {
        assert_eq!(super::sin(1.0).to_bits(), 0x3fea_ed54_8f09_0cee);
        assert_eq!(super::exp(1.0).to_bits(), 0x4005_bf0a_8b14_576a);
        assert_eq!(super::atan2(1.0, 1.0), std::f64::consts::FRAC_PI_4);
        assert_eq!(super::pow(2.0, 0.5), std::f64::consts::SQRT_2);
    }

    #[test]
    fn cosine_and_sine_of_turns_are_those_of_libm() {
        let near = [-2.0, -0.5, -0.375, -0.25, -0.125, 0.0, 0.125, 0.25, 0.5, 0.75, 1.0, 7.5];
        let places = near.into_iter().flat_map(|turns| [turns - 1e-9, turns, turns + 1e-9]);
        for turns in places.chain((0..2000).map(|i| f64::from(i) * 0.618_034 - 600.0)) {
            let part = turns - turns.floor();
            let (sin, cos) = super::sin_cos(std::f64::consts::TAU * part);
            let [found_cos, found_sin] = super::cos_sin_of_turns(turns);
            assert!((found_cos - cos).abs() < 4e-15 && (found_sin - sin).abs() < 4e-15, "{turns}");
        }
    }
}
