//! Laws: how an error is distributed between its limits.
//!
//! With s in −1..1 from the uniform number u of the error, and low and high its limits, which need not be symmetric,
//!
//!   value = (low + high)/2 + s (high − low)/2
//!
//! | law | density of s | s(u) | variance of s |
//! |---|---|---|---|
//! | normal | normal, 2σ at the limits, truncated there | Φ⁻¹(Φ(−2) + u (1 − 2Φ(−2)))/2 | (1 − 4φ(2)/(1 − 2Φ(−2)))/4 = 0.19344 |
//! | uniform | 1/2 | 2u − 1 | 1/3 |
//! | two-point | at the limits | −1 for u < 1/2, else 1 | 1 |
//! | parabolic | 3s²/2: parts at their limits | sgn(2u − 1) ∛∣2u − 1∣ | 3/5 |
//!
//! φ, Φ: density and cumulative distribution of the standard normal distribution. No number is rejected and drawn again, so each
//! error takes one u. Source of Φ⁻¹: Wichura, algorithm AS 241 (PPND16), Applied Statistics 37 (1988) 477.

use crate::real;

/// Φ(−2).
const TAIL: f64 = 0.02275013194817921;

/// The distribution of an error between its limits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Law {
    /// Normal; the limits are ±2σ, where it is truncated.
    #[default]
    Normal,
    /// Uniform.
    Uniform,
    /// At one limit or the other.
    TwoPoint,
    /// Density 3s²/2: most parts are near their limits.
    Parabolic,
}

impl Law {
    /// All laws.
    pub const ALL: [Self; 4] = [Self::Normal, Self::Uniform, Self::TwoPoint, Self::Parabolic];

    /// Its name in descriptions.
    pub fn name(self) -> &'static str {
        match self {
            Self::Normal => "normal",
            Self::Uniform => "uniform",
            Self::TwoPoint => "two-point",
            Self::Parabolic => "parabolic",
        }
    }
}

/// Limits of an error, with its law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Lower limit.
    pub low: f64,
    /// Upper limit.
    pub high: f64,
    /// Distribution between them.
    pub law: Law,
}

impl Limits {
    /// Limits ± `size`.
    pub fn symmetric(size: f64, law: Law) -> Self {
        Self { low: -size, high: size, law }
    }

    /// The value of the uniform number `u`.
    pub fn value(&self, u: f64) -> f64 {
        let (low, high) = (self.low, self.high);
        let (mid, half) = ((low + high) / 2.0, (high - low) / 2.0);
        let s = 2.0 * u - 1.0;
        let value = match self.law {
            Law::Normal => mid + half / 2.0 * normal_quantile(TAIL + u * (1.0 - 2.0 * TAIL)),
            Law::Uniform => mid + half * s,
            Law::TwoPoint => return if u < 0.5 { low } else { high },
            Law::Parabolic => mid + half * real::cbrt(s),
        };
        // Rounding may pass a limit by a bit.
        value.clamp(low, high)
    }
}

/// Φ⁻¹(p) for p from 2e-11 to 1 − 2e-11: AS 241 without its branch for the tails beyond.
fn normal_quantile(p: f64) -> f64 {
    // Numerators and denominators, the highest power first; the constants of the denominators are 1.
    const CENTRE: [[f64; 8]; 2] = [
        [
            2.509_080_928_730_122_7e3,
            3.343_057_558_358_813e4,
            6.726_577_092_700_87e4,
            4.592_195_393_154_987e4,
            1.373_169_376_550_946e4,
            1.971_590_950_306_551_3e3,
            1.331_416_678_917_843_8e2,
            3.387_132_872_796_366_5,
        ],
        [
            5.226_495_278_852_854e3,
            2.872_908_573_572_194_3e4,
            3.930_789_580_009_271e4,
            2.121_379_430_158_659_7e4,
            5.394_196_021_424_751e3,
            6.871_870_074_920_579e2,
            4.231_333_070_160_091e1,
            1.0,
        ],
    ];
    const TAILS: [[f64; 8]; 2] = [
        [
            7.745_450_142_783_414e-4,
            2.272_384_498_926_918_4e-2,
            2.417_807_251_774_506e-1,
            1.270_458_252_452_368_4,
            3.647_848_324_763_204_5,
            5.769_497_221_460_691,
            4.630_337_846_156_546,
            1.423_437_110_749_683_5,
        ],
        [
            1.050_750_071_644_416_9e-9,
            5.475_938_084_995_345e-4,
            1.519_866_656_361_645_7e-2,
            1.481_039_764_274_800_8e-1,
            6.897_673_349_851e-1,
            1.676_384_830_183_803_8,
            2.053_191_626_637_759,
            1.0,
        ],
    ];
    let ratio = |[above, below]: [[f64; 8]; 2], x: f64| {
        let horner = |c: [f64; 8]| c.into_iter().fold(0.0, |sum, c| sum * x + c);
        horner(above) / horner(below)
    };
    let q = p - 0.5;
    if q.abs() <= 0.425 {
        return q * ratio(CENTRE, 0.425 * 0.425 - q * q);
    }
    let r = (-real::log(p.min(1.0 - p))).sqrt();
    ratio(TAILS, r - 1.6).copysign(q)
}

#[cfg(test)]
mod tests {
    use super::super::draw::uniform;
    use super::*;

    /// `statistics.NormalDist().inv_cdf` of Python 3.11, which is AS 241.
    #[test]
    fn quantile_is_that_of_python() {
        let golden = [
            (1e-6, -4.753424308822899),
            (0.001, -3.090232306167813),
            (0.0228, -1.9990772149717695),
            (0.074, -1.4466320671589785),
            (0.0755, -1.4360082279441817),
            (0.1, -1.2815515655446008),
            (0.3, -0.5244005127080407),
            (0.5, 0.0),
            (0.6, 0.2533471031357998),
            (0.925, 1.439531470938456),
            (0.926, 1.4466320671589785),
            (0.9772, 1.9990772149717688),
        ];
        for (p, expected) in golden {
            let found = normal_quantile(p);
            assert!((found - expected).abs() <= 1e-15 * expected.abs(), "{p}: {found}, {expected}");
        }
        assert!((normal_quantile(TAIL) + 2.0).abs() < 2e-15);
    }

    /// `drawn(1, k, "gap 3/thickness", -20.0, 35.0, law)` of fields_reference.py, k = 0 to 3.
    #[test]
    fn values_are_those_of_the_reference() {
        let golden = [
            (Law::Normal, [17.355514403475787, -7.26852239784238, 17.123164379615346, 10.867787401975416]),
            (Law::Uniform, [22.66838457889936, -13.163486787550898, 22.366118622295346, 13.0746033824433]),
            (Law::TwoPoint, [35.0, -20.0, 35.0, 35.0]),
            (
                Law::Parabolic,
                [30.052857351041492, -17.500939635661815, 29.902044753891545, 23.654485116952518],
            ),
        ];
        for (law, values) in golden {
            for (k, expected) in (0..).zip(values) {
                let found = Limits { low: -20.0, high: 35.0, law }.value(uniform(1, k, "gap 3/thickness"));
                assert!((found - expected).abs() < 1e-13, "{law:?} {k}: {found}, {expected}");
            }
        }
    }

    /// Mean and variance of 10⁵ draws with limits −2 and 4 against the closed forms: within four deviations
    /// of the mean, and 1.5 % of the variance.
    #[test]
    fn moments_are_the_closed_forms() {
        let n = 100_000_u64;
        let phi_2 = (-2.0_f64).exp() / (2.0 * std::f64::consts::PI).sqrt();
        let normal = (1.0 - 4.0 * phi_2 / (1.0 - 2.0 * TAIL)) / 4.0;
        assert!((normal - 0.193_435).abs() < 1e-6, "{normal}");
        for (law, variance) in
            [(Law::Normal, normal), (Law::Uniform, 1.0 / 3.0), (Law::TwoPoint, 1.0), (Law::Parabolic, 0.6)]
        {
            let limits = Limits { low: -2.0, high: 4.0, law };
            let values: Vec<f64> = (0..n).map(|k| limits.value(uniform(11, k, "surface 1/tilt_x"))).collect();
            let mean = values.iter().sum::<f64>() / n as f64;
            let found = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / n as f64 / 9.0;
            assert!((mean - 1.0).abs() < 4.0 * 3.0 * (variance / n as f64).sqrt(), "{law:?}: mean {mean}");
            assert!((found / variance - 1.0).abs() < 0.015, "{law:?}: variance {found}, {variance}");
            assert!(values.iter().all(|v| (-2.0..=4.0).contains(v)), "{law:?}");
        }
    }

    #[test]
    fn ends_are_the_limits() {
        for law in Law::ALL {
            let limits = Limits { low: -1.0, high: 7.0, law };
            let (first, last) = (limits.value(1e-300), limits.value(1.0));
            assert!((first + 1.0).abs() < 1e-14 && (last - 7.0).abs() < 1e-14, "{law:?}: {first} {last}");
            assert_eq!(Limits::symmetric(0.0, law).value(0.3), 0.0);
        }
    }
}
