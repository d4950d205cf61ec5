//! Lists of wavelengths in words: `400:700:10` (first:last:step in nm, BOTH ends included), `450,550,650`, or both
//! mixed, `400:700:10,850`. Order is kept, as a store's bands may lie in any order; no wavelength comes twice.

use crate::bounds::{BANDS, WAVELENGTH_NM};

/// Longest list that is read.
pub const MAX_BANDS: usize = BANDS.most as usize;

/// Why a list of wavelengths cannot be read.
#[derive(Debug, thiserror::Error, PartialEq)]
#[non_exhaustive]
pub enum WavelengthError {
    /// Not a number, or not one that light has.
    #[error(
        "wavelength '{word}' in '{list}' is not a number from {WAVELENGTH_NM}; write 450,550,650 or 400:700:10"
    )]
    NotAWavelength {
        /// The piece at fault.
        word: String,
        /// The whole list.
        list: String,
    },
    /// Neither a number nor first:last:step.
    #[error(
        "'{word}' is not a range of wavelengths: write first:last:step in nm, both ends included, as in 400:700:10"
    )]
    NotARange {
        /// The piece at fault.
        word: String,
    },
    /// A range that never arrives.
    #[error("range '{word}' needs a step above 0 and a last wavelength not below the first")]
    Backwards {
        /// The range at fault.
        word: String,
    },
    /// A range whose last wavelength is no whole number of steps from the first.
    #[error(
        "range '{word}' includes both ends, but {last_nm} nm is not a whole number of steps from the first: its last step is {reached_nm} nm"
    )]
    MissesEnd {
        /// The range at fault.
        word: String,
        /// The end asked for.
        last_nm: f64,
        /// The last wavelength the steps reach.
        reached_nm: f64,
    },
    /// More wavelengths than [`MAX_BANDS`].
    #[error("'{list}' holds more than {MAX_BANDS} wavelengths; take a longer step")]
    TooMany {
        /// The whole list.
        list: String,
    },
    /// The same wavelength twice.
    #[error("'{list}' holds {wavelength_nm} nm twice; give every band its own wavelength")]
    Twice {
        /// The whole list.
        list: String,
        /// The wavelength that comes twice.
        wavelength_nm: f64,
    },
}

/// Reads a list of wavelengths in nm.
///
/// # Errors
/// If a piece is no wavelength or range, a range never ends where it says, or the list is too long or repeats itself.
pub fn parse(list: &str) -> Result<Vec<f64>, WavelengthError> {
    let mut all = Vec::new();
    for word in list.split(',') {
        let word = word.trim();
        if word.contains(':') {
            all.extend(range(word, list)?);
        } else {
            all.push(number(word, list)?);
        }
        if all.len() > MAX_BANDS {
            return Err(WavelengthError::TooMany { list: list.into() });
        }
    }
    let mut sorted = all.clone();
    sorted.sort_by(f64::total_cmp);
    match sorted.windows(2).find(|w| w[0] == w[1]) {
        Some(w) => Err(WavelengthError::Twice { list: list.into(), wavelength_nm: w[0] }),
        None => Ok(all),
    }
}

/// Writes a list so that [`parse`] reads the same numbers: a range where the steps are even, else one by one.
pub fn format(wavelengths_nm: &[f64]) -> String {
    if let [first, second, .., last] = wavelengths_nm {
        let short = format!("{first}:{last}:{}", second - first);
        if parse(&short).is_ok_and(|read| read == wavelengths_nm) {
            return short;
        }
    }
    wavelengths_nm.iter().map(f64::to_string).collect::<Vec<_>>().join(",")
}

fn number(word: &str, list: &str) -> Result<f64, WavelengthError> {
    match word.trim().parse::<f64>() {
        Ok(nm) if WAVELENGTH_NM.holds(nm) => Ok(nm),
        _ => Err(WavelengthError::NotAWavelength { word: word.trim().into(), list: list.into() }),
    }
}

fn range(word: &str, list: &str) -> Result<Vec<f64>, WavelengthError> {
    let parts: Vec<_> = word.split(':').collect();
    let &[first, last, step] = parts.as_slice() else {
        return Err(WavelengthError::NotARange { word: word.into() });
    };
    let (first, last) = (number(first, list)?, number(last, list)?);
    let step: f64 = step.trim().parse().map_err(|_| WavelengthError::NotARange { word: word.into() })?;
    // Written so that a NaN step is refused too.
    if !(step > 0.0 && last >= first) {
        return Err(WavelengthError::Backwards { word: word.into() });
    }
    let steps = (last - first) / step;
    if steps >= MAX_BANDS as f64 {
        return Err(WavelengthError::TooMany { list: list.into() });
    }
    // Decimal steps are not exact in binary: a millionth of a step is rounding, not intent.
    let whole = steps.round();
    if (steps - whole).abs() > 1e-6 {
        let reached_nm = first + steps.floor() * step;
        return Err(WavelengthError::MissesEnd { word: word.into(), last_nm: last, reached_nm });
    }
    let count = whole as usize;
    Ok((0..=count).map(|i| if i == count { last } else { first + i as f64 * step }).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_includes_both_ends() {
        let nm = parse("400:700:10").unwrap();
        assert_eq!((nm.len(), nm[0], nm[1], nm[30]), (31, 400.0, 410.0, 700.0));
        assert_eq!(parse("500:500:10").unwrap(), [500.0]);
        assert_eq!(parse("400:401:0.1").unwrap().len(), 11);
    }

    #[test]
    fn lists_keep_their_order_and_mix_with_ranges() {
        assert_eq!(parse("650, 550,450").unwrap(), [650.0, 550.0, 450.0]);
        assert_eq!(parse("400:420:10,850").unwrap(), [400.0, 410.0, 420.0, 850.0]);
    }

    #[test]
    fn nonsense_is_refused_in_words() {
        for bad in [
            "",
            "nan",
            "inf",
            "-5",
            "0",
            "400:700",
            "400:700:10:1",
            "400:700:0",
            "400:700:-10",
            "400:700:nan",
            "700:400:10",
            "400:nan:10",
            "400:700:1e-300",
            "400:700:0.001",
            "400:700:7",
            "450,450",
            "450,,550",
            "1:1e400:1",
        ] {
            let error = parse(bad).expect_err(bad).to_string();
            assert!(error.len() > 20, "{bad}: {error}");
        }
    }

    #[test]
    fn what_is_written_reads_the_same() {
        for list in ["400:700:10", "450,550,650", "450", "410,470.5,700", "400:401:0.1"] {
            let nm = parse(list).unwrap();
            assert_eq!(parse(&format(&nm)).unwrap(), nm);
        }
        assert_eq!(format(&parse("400:700:10").unwrap()), "400:700:10");
    }
}
