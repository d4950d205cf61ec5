//! Exposure: the value that becomes white.
//!
//!   displayed = exposure · value,   1 = white
//! [`Exposure::Auto`] makes the 99th percentile of the LIT pixels white: a few bright pixels do not darken the rest, and a black
//! background does not count. Lit: above 1e-5 of the brightest pixel, which is below the steps of 16 bits and above the
//! rounding noise of an FFT around its peak. A picture with no lit pixel (all zero, negative or missing) has exposure 1.
//! Percentiles come from a histogram in steps of 2⁻¹⁰ (0.1 %) of the value: memory does not grow with the picture, and the
//! result does not depend on the order of the pixels.

use super::{PictureError, Progress};

/// Factor from values to display values.
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

/// Lit pixels exceed this share of the brightest.
const LIT_SHARE: f32 = 1e-5;
/// Bits of an f32 dropped for its histogram step: 13 of 23 fraction bits leave steps of 2⁻¹⁰.
const DROPPED_BITS: u32 = 13;

impl Exposure {
    /// The factor, measured by `pass` over the source unless it is given. That pass is the first half of the progress.
    pub(super) fn measure(
        self,
        progress: Progress<'_>,
        pass: impl FnOnce(&mut Levels, Progress<'_>) -> Result<u64, PictureError>,
    ) -> Result<f64, PictureError> {
        let mut levels = Levels::default();
        if !matches!(self, Self::Factor(_)) {
            pass(&mut levels, &|done, total| progress(done, 2 * total))?;
        }
        Ok(self.factor(&levels))
    }

    /// Progress of the pass after [`Exposure::measure`].
    pub(super) fn progress_after_measuring(self, progress: Progress<'_>) -> impl Fn(u64, u64) + Sync {
        move |done, total| match self {
            Self::Factor(_) => progress(done, total),
            Self::Auto | Self::Percentile(_) => progress(done + total, 2 * total),
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

    /// A factor must be finite and positive, a percentile in 0..=100.
    pub(super) fn check(self) -> Result<(), PictureError> {
        let problem = match self {
            Self::Factor(f) if !(f.is_finite() && f > 0.0) => {
                format!("the factor {f} is not a positive number")
            }
            Self::Percentile(p) if !(0.0..=100.0).contains(&p) => {
                format!("the percentile {p} is not in 0..100")
            }
            _ => return Ok(()),
        };
        Err(PictureError::Setting { setting: "exposure", problem })
    }
}

impl std::str::FromStr for Exposure {
    type Err = String;

    /// Parses `auto`, a percentile `99.5%` or a factor `1.8`.
    fn from_str(text: &str) -> Result<Self, String> {
        let text = text.trim();
        let number = |text: &str| text.trim().parse::<f64>().ok();
        let parsed = match text.strip_suffix('%') {
            _ if text.eq_ignore_ascii_case("auto") => Some(Self::Auto),
            Some(percent) => number(percent).map(Self::Percentile),
            None => number(text).map(Self::Factor),
        };
        let expected = "expected auto, a percentile of the lit pixels, e.g. 99.5%, or a factor above 0";
        parsed.filter(|e| e.check().is_ok()).ok_or_else(|| expected.to_owned())
    }
}

/// Histogram of positive values, in steps of 0.1 %.
pub struct Levels(Vec<u64>);

impl Default for Levels {
    fn default() -> Self {
        Self(vec![0; (f32::INFINITY.to_bits() >> DROPPED_BITS) as usize])
    }
}

impl Levels {
    /// Counts a value unless it is zero, negative or not finite.
    pub fn add(&mut self, value: f32) {
        if value > 0.0 && value.is_finite() {
            self.0[(value.to_bits() >> DROPPED_BITS) as usize] += 1;
        }
    }

    /// The value below which `percent` of the lit values lie; `None` if no value is lit.
    pub fn percentile(&self, percent: f64) -> Option<f64> {
        // Upper end of a step: a uniform picture, all in one step, must not be overexposed.
        let upper = |step: usize| f32::from_bits((step as u32 + 1) << DROPPED_BITS);
        let brightest = self.0.iter().rposition(|&n| n > 0)?;
        let first = (LIT_SHARE * upper(brightest).min(f32::MAX)).to_bits() >> DROPPED_BITS;
        let lit = &self.0[first as usize..=brightest];
        let target = (lit.iter().sum::<u64>() as f64 * percent / 100.0).ceil().max(1.0) as u64;
        let mut below = 0;
        let step = lit.iter().position(|&n| {
            below += n;
            below >= target
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
    fn one_bright_pixel_in_a_thousand_does_not_change_the_exposure() {
        let picture = levels((0..1000).map(|i| if i == 7 { 50.0 } else { 0.25 }));
        assert!((Exposure::Auto.factor(&picture) / 4.0 - 1.0).abs() < 2e-3);
        assert_eq!(Exposure::Factor(3.0).factor(&picture), 3.0);
    }

    #[test]
    fn pixels_below_1e_5_of_the_peak_are_not_counted() {
        let picture = levels((0..100_000).map(|i| if i < 50 { 2.0 } else { 1e-7 }));
        assert!((Exposure::Auto.factor(&picture) / 0.5 - 1.0).abs() < 2e-3);
    }

    #[test]
    fn exposure_is_1_without_a_lit_pixel() {
        for values in [vec![], vec![0.0; 9], vec![-1.0, f32::NAN, f32::INFINITY]] {
            assert_eq!(Exposure::Auto.factor(&levels(values)), 1.0);
        }
        let huge = Exposure::Auto.factor(&levels([f32::MAX]));
        assert!(huge.is_finite() && huge > 0.0);
    }

    #[test]
    fn percentiles_are_within_two_steps() {
        let picture = levels((1..=1000).map(|i| i as f32));
        for percent in [1.0, 50.0, 99.0, 100.0] {
            let level = picture.percentile(percent).unwrap();
            assert!((level / (10.0 * percent) - 1.0).abs() < 2e-3, "{percent}: {level}");
        }
    }

    #[test]
    fn exposure_texts_are_parsed_and_others_are_errors() {
        assert_eq!("auto".parse(), Ok(Exposure::Auto));
        assert_eq!("99.5%".parse(), Ok(Exposure::Percentile(99.5)));
        assert_eq!("1.8".parse(), Ok(Exposure::Factor(1.8)));
        for bad in ["", "0", "-1", "nan", "101%", "bright"] {
            assert!(bad.parse::<Exposure>().unwrap_err().contains("99.5%"), "{bad}");
        }
    }
}
