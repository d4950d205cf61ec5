//! From stored samples to chart values: what stands for no data, scale and offset, and the range that can be computed with.
//!
//!     value = raw · scale + offset        in f64, then rounded to f32
//!
//! A raw sample stands for no data if it is NaN or infinite, equals a declared fill value, or lies outside the declared valid
//! range; raw samples are compared before they are scaled (CF conventions 1.11, sections 2.5.1 and 8.1).
//! [`NanPolicy`] decides what becomes of it. A value beyond [`MAX_VALUE`] is an error under every policy that checks
//! values: sums over an FFT block would exceed f32 and spread NaN over the whole block.

use std::path::PathBuf;

use serde_json::{Value, json};

use super::{ChartError, NanPolicy};

/// Largest magnitude of a chart value times the gain. A transform of 4096 x 4096 such values stays below 2·10³⁷; f32 ends at
/// 3.4·10³⁸.
pub const MAX_VALUE: f32 = 1e30;

/// How raw samples become values.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Values {
    /// Raw samples that stand for no data.
    pub(super) no_data: Vec<f64>,
    /// Smallest and largest raw sample that is data.
    pub(super) valid: (f64, f64),
    /// (scale, offset): none, one for all bands, or one per band.
    pub(super) scaling: Vec<(f64, f64)>,
    /// Largest magnitude of a value.
    pub(super) largest: f32,
}

impl Default for Values {
    fn default() -> Self {
        Self {
            no_data: Vec::new(),
            valid: (f64::NEG_INFINITY, f64::INFINITY),
            scaling: Vec::new(),
            largest: MAX_VALUE,
        }
    }
}

/// A sample that is no usable value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Unusable {
    /// NaN or infinite.
    NotFinite(f64),
    /// A declared fill value, or a raw sample outside the declared valid range.
    NoData(f64),
    /// A value that is too large.
    TooLarge(f64),
}

impl Unusable {
    /// The error of this sample at (band, row, column) of the chart at `path`, whose values may be `largest`.
    pub(super) fn at(self, path: PathBuf, place: (usize, usize, usize), largest: f32) -> ChartError {
        let (band, row, column) = place;
        match self {
            Self::NotFinite(value) => ChartError::NotFinite { path, band, row, column, value },
            Self::NoData(value) => ChartError::NoData { path, band, row, column, value },
            Self::TooLarge(value) => ChartError::TooLarge { path, band, row, column, value, largest },
        }
    }
}

/// What a check of a line has found.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Checked {
    /// Column in the line of the first error.
    pub(super) error: Option<(usize, Unusable)>,
    /// Samples without data that were replaced by 0.
    pub(super) replaced: u64,
}

impl Values {
    /// Whether a value is its raw sample converted to f32.
    pub(super) fn are_raw(&self) -> bool {
        self.no_data.is_empty() && self.scaling.is_empty() && self.valid == Self::default().valid
    }

    /// All that the values of given samples follow from, for the chart's identity. Exact: bits of the numbers.
    pub(super) fn identity(&self) -> Value {
        let bits = |v: f64| format!("{:016x}", v.to_bits());
        json!({
            "no_data": self.no_data.iter().map(|v| bits(*v)).collect::<Vec<_>>(),
            "valid": [bits(self.valid.0), bits(self.valid.1)],
            "scaling": self.scaling.iter().map(|s| [bits(s.0), bits(s.1)]).collect::<Vec<_>>(),
        })
    }

    fn scaling(&self, band: usize) -> (f64, f64) {
        self.scaling.get(band).or(self.scaling.first()).copied().unwrap_or((1.0, 0.0))
    }

    fn is_no_data(&self, raw: f64) -> bool {
        raw < self.valid.0 || raw > self.valid.1 || self.no_data.contains(&raw)
    }

    /// The value of raw samples of `band`, NaN for no data.
    pub(super) fn of_raw(&self, band: usize) -> impl Fn(f64) -> f32 {
        let (scale, offset) = self.scaling(band);
        move |raw| if self.is_no_data(raw) { f32::NAN } else { (raw * scale + offset) as f32 }
    }

    /// What keeps a raw sample of `band` from being used; `None` if nothing does.
    pub(super) fn unusable(&self, band: usize, raw: f64) -> Option<Unusable> {
        let (scale, offset) = self.scaling(band);
        let value = raw * scale + offset;
        if !raw.is_finite() {
            Some(Unusable::NotFinite(raw))
        } else if self.is_no_data(raw) {
            Some(Unusable::NoData(raw))
        } else if value.is_nan() || (value as f32).abs() > self.largest {
            Some(Unusable::TooLarge(value))
        } else {
            None
        }
    }

    /// Checks values of `band`, converted from the raw samples `raw(0)`, `raw(1)`, …
    pub(super) fn check(
        &self,
        band: usize,
        line: &mut [f32],
        raw: impl Fn(usize) -> f64,
        nan: NanPolicy,
    ) -> Checked {
        let mut checked = Checked::default();
        if nan == NanPolicy::Keep || self.all_usable(line) {
            return checked;
        }
        for (k, value) in line.iter_mut().enumerate() {
            match self.unusable(band, raw(k)) {
                None => (),
                Some(Unusable::NotFinite(_) | Unusable::NoData(_)) if nan == NanPolicy::Zero => {
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

    /// Whether no value is NaN, infinite or too large. One pass without branches, which the compiler vectorizes: magnitudes
    /// of floats compare like their bits, and those of NaN are larger than those of infinity.
    fn all_usable(&self, line: &[f32]) -> bool {
        line.iter().map(|v| v.to_bits() & 0x7fff_ffff).fold(0, u32::max) <= self.largest.to_bits()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nan_infinity_fill_and_huge_values_are_told_apart() {
        let values = Values { no_data: vec![-9999.0], valid: (-1e4, 1e35), ..Values::default() };
        let raw = [1.0, f64::NAN, -9999.0, -2e4, 2e30, f64::INFINITY];
        let line = || raw.map(values.of_raw(0));
        let found: Vec<_> = raw.iter().map(|r| values.unusable(0, *r)).collect();
        assert_eq!(found[0], None);
        assert!(matches!(found[1], Some(Unusable::NotFinite(v)) if v.is_nan()));
        assert_eq!(found[2], Some(Unusable::NoData(-9999.0)));
        assert_eq!(found[3], Some(Unusable::NoData(-2e4)));
        assert_eq!(found[4], Some(Unusable::TooLarge(2e30)));
        assert_eq!(found[5], Some(Unusable::NotFinite(f64::INFINITY)));
        let mut zeroed = line();
        let checked = values.check(0, &mut zeroed, |k| raw[k], NanPolicy::Zero);
        assert_eq!(checked, Checked { error: Some((4, Unusable::TooLarge(2e30))), replaced: 4 });
        assert_eq!(zeroed[..4], [1.0, 0.0, 0.0, 0.0]);
        let checked = values.check(0, &mut line(), |k| raw[k], NanPolicy::Error);
        assert!(matches!(checked, Checked { error: Some((1, Unusable::NotFinite(_))), replaced: 0 }));
        assert_eq!(values.check(0, &mut line(), |k| raw[k], NanPolicy::Keep), Checked::default());
    }

    #[test]
    fn a_scale_applies_after_the_fill_value_is_compared() {
        let values = Values { no_data: vec![65535.0], scaling: vec![(2e-5, -0.1)], ..Values::default() };
        let value = values.of_raw(3);
        assert_eq!((value(0.0), value(50000.0)), (-0.1, 0.9));
        assert!(value(65535.0).is_nan());
    }

    #[test]
    fn the_largest_value_itself_is_usable() {
        let values = Values::default();
        for (raw, usable) in
            [(1e30, true), (-1e30, true), (1.000_001e30, false), (1e300, false), (-3.4e38, false)]
        {
            let mut line = [raw as f32];
            let checked = values.check(0, &mut line, |_| raw, NanPolicy::Zero);
            assert_eq!(checked.error.is_none(), usable, "{raw}");
        }
    }
}
