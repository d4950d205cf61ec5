//! Conversion of stored samples to chart values: no-data samples, scale and offset, maximum magnitude.
//!
//! ```text
//! value = raw · scale + offset        in f64, then rounded to f32
//! ```
//!
//! A raw sample stands for no data if it is NaN or infinite, equals a declared fill value, or lies outside the declared valid
//! range; raw samples are compared before they are scaled (CF conventions 1.11, sections 2.5.1 and 8.1).
//! [`NanPolicy`] determines its treatment. A value beyond [`MAX_VALUE`] is an error under every policy except [`NanPolicy::Keep`]: sums
//! over an FFT block would exceed f32 and spread NaN over the entire block.

use std::path::PathBuf;

use serde_json::{Value, json};

use super::error::ChartError;
use super::options::NanPolicy;

/// Maximum magnitude of a chart value times the gain. A transform of 4096 x 4096 such values stays below 2·10³⁷; the largest f32 is
/// 3.4·10³⁸.
pub const MAX_VALUE: f32 = 1e30;

/// Conversion of raw samples to values.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Values {
    /// Raw samples that stand for no data.
    pub(super) no_data: Vec<f64>,
    /// Valid range of raw samples.
    pub(super) valid: (f64, f64),
    /// (scale, offset): empty, one for all bands, or one per band.
    pub(super) scaling: Vec<(f64, f64)>,
    /// Maximum magnitude of a value.
    pub(super) max_magnitude: f32,
}

impl Default for Values {
    fn default() -> Self {
        Self {
            no_data: Vec::new(),
            valid: (f64::NEG_INFINITY, f64::INFINITY),
            scaling: Vec::new(),
            max_magnitude: MAX_VALUE,
        }
    }
}

/// A sample without a valid value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum InvalidSample {
    /// NaN or infinite.
    NotFinite(f64),
    /// A declared fill value, or a raw sample outside the declared valid range.
    NoData(f64),
    /// A value beyond the maximum magnitude.
    TooLarge(f64),
}

impl InvalidSample {
    /// The error for this sample at (band, row, column) of the chart at `path`; `largest` is the maximum magnitude.
    pub(super) fn into_error(
        self,
        path: PathBuf,
        (band, row, column): (usize, usize, usize),
        largest: f32,
    ) -> ChartError {
        match self {
            Self::NotFinite(value) => ChartError::NotFinite { path, band, row, column, value },
            Self::NoData(value) => ChartError::NoData { path, band, row, column, value },
            Self::TooLarge(value) => ChartError::TooLarge { path, band, row, column, value, largest },
        }
    }
}

/// Result of the check of a row.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Checked {
    /// First error and its column in the row.
    pub(super) error: Option<(usize, InvalidSample)>,
    /// Samples without data that were replaced by 0.
    pub(super) replaced: u64,
}

impl Values {
    /// Whether a value is its raw sample converted to f32.
    pub(super) fn is_identity(&self) -> bool {
        !self.declares_no_data() && self.scaling.is_empty()
    }

    /// Whether some finite samples stand for no data.
    pub(super) fn declares_no_data(&self) -> bool {
        !self.no_data.is_empty() || self.valid != Self::default().valid
    }

    /// All parameters of the conversion, for the chart's identity. Exact: bits of the numbers.
    pub(super) fn identity(&self) -> Value {
        let bits = |v: f64| format!("{:016x}", v.to_bits());
        json!({
            "no_data": self.no_data.iter().map(|v| bits(*v)).collect::<Vec<_>>(),
            "valid": [bits(self.valid.0), bits(self.valid.1)],
            "scaling": self.scaling.iter().map(|s| [bits(s.0), bits(s.1)]).collect::<Vec<_>>(),
        })
    }

    /// Multiplies all values by `scale`, a finite number other than 0.
    pub(super) fn multiply(&mut self, scale: f64) {
        match self.scaling.is_empty() {
            true if scale == 1.0 => {}
            true => self.scaling = vec![(scale, 0.0)],
            false => self.scaling.iter_mut().for_each(|s| *s = (s.0 * scale, s.1 * scale)),
        }
    }

    fn scaling(&self, band: usize) -> (f64, f64) {
        self.scaling.get(band).or(self.scaling.first()).copied().unwrap_or((1.0, 0.0))
    }

    /// Whether a raw sample stands for no data by the attributes.
    pub(super) fn is_no_data(&self, raw: f64) -> bool {
        raw < self.valid.0 || raw > self.valid.1 || self.no_data.contains(&raw)
    }

    /// The conversion of raw samples of `band`; NaN for no data.
    pub(super) fn converter(&self, band: usize) -> impl Fn(f64) -> f32 {
        let (scale, offset) = self.scaling(band);
        move |raw| if self.is_no_data(raw) { f32::NAN } else { (raw * scale + offset) as f32 }
    }

    /// The defect of a raw sample of `band`; `None` if its value is valid.
    fn defect(&self, band: usize, raw: f64) -> Option<InvalidSample> {
        let (scale, offset) = self.scaling(band);
        let value = raw * scale + offset;
        if !raw.is_finite() {
            Some(InvalidSample::NotFinite(raw))
        } else if self.is_no_data(raw) {
            Some(InvalidSample::NoData(raw))
        } else if value.is_nan() || (value as f32).abs() > self.max_magnitude {
            Some(InvalidSample::TooLarge(value))
        } else {
            None
        }
    }

    /// Checks a row of values of `band`, converted from the raw samples `raw(0)`, `raw(1)`, …; replaces those without data by 0 under
    /// [`NanPolicy::Zero`].
    pub(super) fn check(
        &self,
        band: usize,
        line: &mut [f32],
        raw: impl Fn(usize) -> f64,
        nan: NanPolicy,
    ) -> Checked {
        let mut checked = Checked::default();
        if nan == NanPolicy::Keep || self.all_valid(line) {
            return checked;
        }
        for (k, value) in line.iter_mut().enumerate() {
            match self.defect(band, raw(k)) {
                None => (),
                Some(InvalidSample::NotFinite(_) | InvalidSample::NoData(_)) if nan == NanPolicy::Zero => {
                    *value = 0.0;
                    checked.replaced += 1;
                }
                Some(error) => {
                    checked.error.get_or_insert((k, error));
                }
            }
        }
        checked
    }

    /// Whether no value is NaN, infinite or too large. A branch-free pass, which the compiler vectorizes: magnitudes of floats compare
    /// like their bits, and NaN compares larger than infinity.
    fn all_valid(&self, line: &[f32]) -> bool {
        line.iter().map(|v| v.to_bits() & 0x7fff_ffff).fold(0, u32::max) <= self.max_magnitude.to_bits()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nan_infinity_fill_and_too_large_values_are_distinguished() {
        let values = Values { no_data: vec![-9999.0], valid: (-1e4, 1e35), ..Values::default() };
        let raw = [1.0, f64::NAN, -9999.0, -2e4, 2e30, f64::INFINITY];
        let line = || raw.map(values.converter(0));
        let found: Vec<_> = raw.iter().map(|r| values.defect(0, *r)).collect();
        assert_eq!(found[0], None);
        assert!(matches!(found[1], Some(InvalidSample::NotFinite(v)) if v.is_nan()));
        assert_eq!(found[2], Some(InvalidSample::NoData(-9999.0)));
        assert_eq!(found[3], Some(InvalidSample::NoData(-2e4)));
        assert_eq!(found[4], Some(InvalidSample::TooLarge(2e30)));
        assert_eq!(found[5], Some(InvalidSample::NotFinite(f64::INFINITY)));
        let mut zeroed = line();
        let checked = values.check(0, &mut zeroed, |k| raw[k], NanPolicy::Zero);
        assert_eq!(checked, Checked { error: Some((4, InvalidSample::TooLarge(2e30))), replaced: 4 });
        assert_eq!(zeroed[..4], [1.0, 0.0, 0.0, 0.0]);
        let checked = values.check(0, &mut line(), |k| raw[k], NanPolicy::Error);
        assert!(matches!(checked, Checked { error: Some((1, InvalidSample::NotFinite(_))), replaced: 0 }));
        assert_eq!(values.check(0, &mut line(), |k| raw[k], NanPolicy::Keep), Checked::default());
    }

    #[test]
    fn fill_value_is_compared_before_scaling() {
        let values = Values { no_data: vec![65535.0], scaling: vec![(2e-5, -0.1)], ..Values::default() };
        let value = values.converter(3);
        assert_eq!((value(0.0), value(50000.0)), (-0.1, 0.9));
        assert!(value(65535.0).is_nan());
    }

    #[test]
    fn maximum_value_is_valid_and_the_next_larger_is_not() {
        let values = Values::default();
        for (raw, valid) in
            [(1e30, true), (-1e30, true), (1.000_001e30, false), (1e300, false), (-3.4e38, false)]
        {
            let mut line = [raw as f32];
            let checked = values.check(0, &mut line, |_| raw, NanPolicy::Zero);
            assert_eq!(checked.error.is_none(), valid, "{raw}");
        }
    }
}
