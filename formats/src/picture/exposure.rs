//! Which value becomes white.
//!
//!   shown = exposure · value,   1 = white
//! [`Exposure::Auto`] makes the 99th percentile of the LIT pixels of the picture white: one bright spot among a hundred
//! pixels does not darken the rest, and a chart of few lights on black is not judged by its black. Lit is what exceeds
//! 1e-5 of the brightest pixel: below what 16 bits tell apart, and above the rounding that an FFT leaves around its peak.
//! A picture with nothing lit (all zero, negative or missing) gets 1.
//! Percentiles come from counts in steps of 2⁻¹⁰ (0.1 %) of the value, so memory does not grow with the picture and the
//! answer does not depend on any order.

/// How values become display values.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub enum Exposure {
    /// The 99th percentile of lit pixels becomes white.
    #[default]
    Auto,
    /// The given percentile (0 to 100) of lit pixels becomes white.
    Percentile(f64),
    /// Values are multiplied by this.
    Factor(f64),
}

/// Share of the brightest value below which a pixel is not lit.
const LIT: f32 = 1e-5;
/// Bits of an f32 dropped to get its step: 13 of 23 fraction bits leave steps of 2⁻¹⁰.
const DROPPED: u32 = 13;

impl Exposure {
    /// The factor, if it needs no picture to be known.
    pub fn fixed(self) -> Option<f64> {
        match self {
            Self::Factor(factor) => Some(factor),
            Self::Auto | Self::Percentile(_) => None,
        }
    }

    /// The factor for a picture of these values.
    pub fn factor(self, values: &Levels) -> f64 {
        let percent = match self {
            Self::Factor(factor) => return factor,
            Self::Percentile(percent) => percent,
            Self::Auto => 99.0,
        };
        values.percentile(percent).map_or(1.0, |level| 1.0 / level)
    }

    /// What is wrong with it, if anything.
    pub(super) fn problem(self) -> Option<String> {
        match self {
            Self::Factor(f) if !(f.is_finite() && f > 0.0) => {
                Some(format!("the factor {f} is not a positive number"))
            }
            Self::Percentile(p) if !(0.0..=100.0).contains(&p) => {
                Some(format!("the percentile {p} is not in 0..100"))
            }
            _ => None,
        }
    }
}

impl std::str::FromStr for Exposure {
    type Err = String;

    /// Reads `auto`, a percentile `99.5%` or a factor `1.8`.
    fn from_str(word: &str) -> Result<Self, String> {
        let word = word.trim();
        let number = |text: &str| text.trim().parse::<f64>().ok();
        let read = match word.strip_suffix('%') {
            _ if word.eq_ignore_ascii_case("auto") => Some(Self::Auto),
            Some(percent) => number(percent).map(Self::Percentile),
            None => number(word).map(Self::Factor),
        };
        read.filter(|e| e.problem().is_none()).ok_or_else(|| {
            format!("'{word}' is no exposure: write auto, a percentile as in 99%, or a factor above 0")
        })
    }
}

/// Counts of positive values, in steps of 0.1 %.
pub struct Levels {
    counts: Vec<u64>,
}

impl Default for Levels {
    fn default() -> Self {
        Self { counts: vec![0; (f32::INFINITY.to_bits() >> DROPPED) as usize] }
    }
}

impl Levels {
    /// Counts a value; zero, negative and missing ones are left out.
    pub fn add(&mut self, value: f32) {
        if value > 0.0 && value.is_finite() {
            self.counts[(value.to_bits() >> DROPPED) as usize] += 1;
        }
    }

    /// The value below which `percent` of the lit ones lie; `None` if nothing is lit.
    pub fn percentile(&self, percent: f64) -> Option<f64> {
        // A step's upper end: white paper, all of it in one step, must not be overexposed.
        let upper = |step: usize| f32::from_bits((step as u32 + 1) << DROPPED);
        let brightest = self.counts.iter().rposition(|&n| n > 0)?;
        let first = (LIT * upper(brightest).min(f32::MAX)).to_bits() >> DROPPED;
        let lit = &self.counts[first as usize..=brightest];
        let wanted = (lit.iter().sum::<u64>() as f64 * percent / 100.0).ceil().max(1.0) as u64;
        let mut below = 0;
        let step = lit.iter().position(|&n| {
            below += n;
            below >= wanted
        })?;
        Some(f64::from(upper(first as usize + step)).min(f64::from(f32::MAX)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn levels(values: impl IntoIterator<Item = f32>) -> Levels {
        let mut levels = Levels::default();
        values.into_iter().for_each(|v| levels.add(v));
        levels
    }

    #[test]
    fn one_bright_spot_does_not_darken_the_rest() {
        let picture = levels((0..1000).map(|i| if i == 7 { 50.0 } else { 0.25 }));
        assert!((Exposure::Auto.factor(&picture) / 4.0 - 1.0).abs() < 2e-3);
        assert_eq!(Exposure::Factor(3.0).factor(&picture), 3.0);
    }

    #[test]
    fn black_around_lights_does_not_count() {
        let picture = levels((0..100_000).map(|i| if i < 50 { 2.0 } else { 1e-7 }));
        assert!((Exposure::Auto.factor(&picture) / 0.5 - 1.0).abs() < 2e-3);
    }

    #[test]
    fn nothing_lit_is_left_alone() {
        for values in [vec![], vec![0.0; 9], vec![-1.0, f32::NAN, f32::INFINITY]] {
            assert_eq!(Exposure::Auto.factor(&levels(values)), 1.0);
        }
        let huge = Exposure::Auto.factor(&levels([f32::MAX]));
        assert!(huge.is_finite() && huge > 0.0);
    }

    #[test]
    fn percentiles_are_those_of_the_values() {
        let picture = levels((1..=1000).map(|i| i as f32));
        for percent in [1.0, 50.0, 99.0, 100.0] {
            let level = picture.percentile(percent).unwrap();
            assert!((level / (10.0 * percent) - 1.0).abs() < 2e-3, "{percent}: {level}");
        }
    }

    #[test]
    fn exposures_are_read_from_words() {
        assert_eq!("auto".parse(), Ok(Exposure::Auto));
        assert_eq!("99.5%".parse(), Ok(Exposure::Percentile(99.5)));
        assert_eq!("1.8".parse(), Ok(Exposure::Factor(1.8)));
        for bad in ["", "0", "-1", "nan", "101%", "bright"] {
            assert!(bad.parse::<Exposure>().unwrap_err().contains("99%"), "{bad}");
        }
    }
}
