//! `--exposure`: times, a bracket, or automatic.

use crate::failure::usage;
use anyhow::Result;
use pipeline::sensor::flicker::Flicker;

/// Longest exposure, s.
pub(super) const MAX_SECONDS: f64 = 3600.0;

/// Frequencies of a light's power, Hz.
const FLICKER_HZ: (f64, f64) = (1e-3, 1e6);

/// What the exposure is.
#[derive(Clone, Debug, PartialEq)]
pub enum Times {
    /// Given times, s.
    Given(Vec<f64>),
    /// The time for which a percentile of the pixels stays below a share of saturation.
    Auto {
        /// Share of saturation.
        fill: f64,
        /// Percentile of the pixels.
        percentile: f64,
    },
}

/// Seconds of a time such as 10ms, 1/60s, 2.5.
fn parsed(word: &str) -> Option<f64> {
    let word = word.trim();
    let units = [("ms", 1e-3), ("us", 1e-6), ("µs", 1e-6), ("s", 1.0)];
    let (text, unit) =
        units.iter().find_map(|(name, unit)| Some((word.strip_suffix(name)?, *unit))).unwrap_or((word, 1.0));
    let number = |t: &str| t.trim().parse::<f64>().ok().filter(|v| v.is_finite());
    let value = match text.split_once('/') {
        Some((above, below)) => number(above).zip(number(below)).map(|(a, b)| a / b),
        None => number(text),
    };
    value.map(|v| v * unit)
}

/// A time above 0 such as 10ms, 1/60s, 2.5.
fn seconds(word: &str) -> Result<f64, String> {
    match parsed(word) {
        Some(s) if s > 0.0 && s <= MAX_SECONDS => Ok(s),
        Some(s) if s.is_finite() => Err(format!("expected above 0, at most {MAX_SECONDS} s, found {s} s")),
        _ => Err(format!("`{}` is no time such as 10ms, 1/60s or 2.5", word.trim())),
    }
}

/// As [`time`], or 0.
pub fn time_or_zero(flag: &str, text: &str) -> Result<f64> {
    match parsed(text) {
        Some(0.0) => Ok(0.0),
        _ => time(flag, text),
    }
}

/// The time that a flag gives, s.
pub fn time(flag: &str, text: &str) -> Result<f64> {
    seconds(text).map_err(|e| usage(format!("{flag} {text}: {e}")))
}

/// The light of `--flicker HZ:M[:TIME]`.
pub(super) fn flicker(text: &str) -> Result<Flicker> {
    let fail = |e: String| usage(format!("--flicker {text}: {e}"));
    let mut words = text.splitn(3, ':');
    let mut number = |what: &str, (low, high): (f64, f64)| {
        let word = words.next().unwrap_or_default().trim();
        let value = word.parse::<f64>().ok().filter(|v| (low..=high).contains(v));
        value
            .ok_or_else(|| fail(format!("expected {what} of {low} to {high}, found `{word}`, as in 100:0.4")))
    };
    let frequency_hz = number("a frequency in Hz", FLICKER_HZ)?;
    let modulation = number("a modulation", (0.0, 1.0))?;
    let start_s = words.next().map_or(Ok(0.0), seconds).map_err(fail)?;
    Ok(Flicker { frequency_hz, modulation, start_s })
}

impl Times {
    /// From the value of `--exposure`.
    pub fn parse(text: &str) -> Result<Self> {
        let fail = |e: String| usage(format!("--exposure {text}: {e}"));
        if let Some(rest) = text.strip_prefix("auto") {
            return auto(rest).map_err(fail);
        }
        let times: Result<Vec<f64>, String> = text.split(',').map(seconds).collect();
        times.map(Self::Given).map_err(fail)
    }
}

/// `[:FILL[@PERCENTILE]]`.
fn auto(rest: &str) -> Result<Times, String> {
    let (mut fill, mut percentile) = (0.9, 99.9);
    if let Some(words) = rest.strip_prefix(':') {
        let (first, second) = words.split_once('@').map_or((words, None), |(a, b)| (a, Some(b)));
        let number = |t: &str, max: f64, what: &str| match t.trim().parse::<f64>() {
            Ok(v) if v > 0.0 && v <= max => Ok(v),
            _ => Err(format!("expected {what} above 0, at most {max}, found `{t}`")),
        };
        fill = number(first, 1.0, "a share of saturation")?;
        if let Some(word) = second {
            percentile = number(word, 100.0, "a percentile")?;
        }
    } else if !rest.is_empty() {
        return Err("expected auto, auto:FILL or auto:FILL@PERCENTILE".into());
    }
    Ok(Times::Auto { fill, percentile })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_parsed_with_their_units() {
        let given = |text| Times::parse(text).unwrap();
        assert_eq!(given("1ms,4ms,0.016"), Times::Given(vec![0.001, 0.004, 0.016]));
        assert_eq!(given("1/50s"), Times::Given(vec![0.02]));
        assert_eq!(given("250us"), Times::Given(vec![250e-6]));
        assert_eq!(given("auto"), Times::Auto { fill: 0.9, percentile: 99.9 });
        assert_eq!(given("auto:0.5@50"), Times::Auto { fill: 0.5, percentile: 50.0 });
    }

    #[test]
    fn invalid_exposure_is_an_error() {
        for text in [
            "",
            "0",
            "-1ms",
            "1/0",
            "4000",
            "inf",
            "nan",
            "10 minutes",
            "1ms,,2ms",
            "auto:0",
            "auto:1.5",
            "auto:0.9@101",
            "automatic",
        ] {
            assert!(Times::parse(text).unwrap_err().to_string().contains("--exposure"), "{text}");
        }
    }
}
