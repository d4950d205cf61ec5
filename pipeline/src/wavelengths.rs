//! Lists of wavelengths as text: `400:700:10` (first:last:step in nm, both ends included), `450,550,650`, or mixed,
//! `400:700:10,850`. The order is kept, as bands of a store may have any order; wavelengths are distinct.

use crate::bounds::{BANDS, WAVELENGTH_NM};

/// Maximum length of a list.
pub const MAX_BANDS: usize = BANDS.max as usize;

/// An invalid list of wavelengths.
#[derive(Debug, thiserror::Error, PartialEq)]
#[non_exhaustive]
pub enum WavelengthError {
    /// Not a number, or out of range.
    #[error(
        "wavelength '{item}' in '{list}' is not a number from {WAVELENGTH_NM}; {}", way_out(.item)
    )]
    NotAWavelength {
        /// The item.
        item: String,
        /// The list.
        list: String,
    },
    /// Neither a number nor first:last:step.
    #[error(
        "'{item}' is not a range of wavelengths: write first:last:step in nm, both ends included, as in 400:700:10"
    )]
    NotARange {
        /// The item.
        item: String,
    },
    /// A range with a step of the wrong sign.
    #[error("range '{item}' needs a step above 0 and a last wavelength not below the first")]
    Backwards {
        /// The range.
        item: String,
    },
    /// A range that is not an integer number of steps long.
    #[error(
        "range '{item}' includes both ends, but {last_nm} nm is not a whole number of steps from the first: its last step is {reached_nm} nm"
    )]
    MissesEnd {
        /// The range.
        item: String,
        /// The given end.
        last_nm: f64,
        /// The last wavelength on the steps.
        reached_nm: f64,
    },
    /// More wavelengths than [`MAX_BANDS`].
    #[error("'{list}' contains more than {MAX_BANDS} wavelengths; take a longer step")]
    TooMany {
        /// The list.
        list: String,
    },
    /// A repeated wavelength.
    #[error("'{list}' contains {wavelength_nm} nm twice; wavelengths must be distinct")]
    Twice {
        /// The list.
        list: String,
        /// The wavelength.
        wavelength_nm: f64,
    },
}

/// Parses a list of wavelengths in nm.
///
/// # Errors
/// [`WavelengthError`] for an item that is not a wavelength or range, a range that misses its end, or a list that is too long or
/// repeats a wavelength.
pub fn parse(list: &str) -> Result<Vec<f64>, WavelengthError> {
    let mut all = Vec::new();
    for item in list.split(',') {
        let item = item.trim();
        if item.contains(':') {
            all.extend(range(item, list)?);
        } else {
            all.push(number(item, list)?);
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

/// Formats a list so that [`parse`] returns the same numbers: a range if the steps are equal, else one by one.
pub fn format(wavelengths_nm: &[f64]) -> String {
    if let [first, second, .., last] = wavelengths_nm {
        let short = format!("{first}:{last}:{}", second - first);
        if parse(&short).is_ok_and(|parsed| parsed == wavelengths_nm) {
            return short;
        }
    }
    wavelengths_nm.iter().map(f64::to_string).collect::<Vec<_>>().join(",")
}

/// How a wavelength that is out of range is written; light in another unit is asked for.
fn way_out(item: &str) -> String {
    let light = |v: f64| (100.0..20_000.0).contains(&v);
    let units = [("µm", 1e3), ("m", 1e9)];
    let number = item.parse::<f64>().ok();
    let meant =
        number.and_then(|v| units.iter().find(|(_, nm)| light(v * nm)).map(|(unit, nm)| (unit, v * nm)));
    match meant {
        Some((unit, nm)) => {
            format!(
                "was it meant in {unit}? Then it is {} nm, as in 450,550,650 or 400:700:10",
                (nm * 1e6).round() / 1e6
            )
        }
        None => "write 450,550,650 or 400:700:10".to_owned(),
    }
}

fn number(item: &str, list: &str) -> Result<f64, WavelengthError> {
    match item.trim().parse::<f64>() {
        Ok(nm) if WAVELENGTH_NM.contains(nm) => Ok(nm),
        _ => Err(WavelengthError::NotAWavelength { item: item.trim().into(), list: list.into() }),
    }
}

fn range(item: &str, list: &str) -> Result<Vec<f64>, WavelengthError> {
    let parts: Vec<_> = item.split(':').collect();
    let &[first, last, step] = parts.as_slice() else {
        return Err(WavelengthError::NotARange { item: item.into() });
    };
    let (first, last) = (number(first, list)?, number(last, list)?);
    let step: f64 = step.trim().parse().map_err(|_| WavelengthError::NotARange { item: item.into() })?;
    // Also rejects a NaN step.
    if !(step > 0.0 && last >= first) {
        return Err(WavelengthError::Backwards { item: item.into() });
    }
    let steps = (last - first) / step;
    if steps >= MAX_BANDS as f64 {
        return Err(WavelengthError::TooMany { list: list.into() });
    }
    // Decimal steps are not exact in binary: differences up to a millionth of a step are rounding.
    let rounded = steps.round();
    if (steps - rounded).abs() > 1e-6 {
        let reached_nm = first + steps.floor() * step;
        return Err(WavelengthError::MissesEnd { item: item.into(), last_nm: last, reached_nm });
    }
    let count = rounded as usize;
    // To 1e-9 nm: 400.2, not 400.20000000000005.
    let at = |i: usize| ((first + i as f64 * step) * 1e9).round() / 1e9;
    let of = |i: usize| match i {
        0 => first,
        _ if i == count => last,
        _ => at(i),
    };
    Ok((0..=count).map(of).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn range_includes_both_ends() {
        let nm = parse("400:700:10").unwrap();
        assert_eq!((nm.len(), nm[0], nm[1], nm[30]), (31, 400.0, 410.0, 700.0));
        assert_eq!(parse("500:500:10").unwrap(), [500.0]);
        assert_eq!(parse("400.1:400.7:0.1").unwrap(), [400.1, 400.2, 400.3, 400.4, 400.5, 400.6, 400.7]);
    }

    #[test]
    fn lists_keep_their_order_and_mix_with_ranges() {
        assert_eq!(parse("650, 550,450").unwrap(), [650.0, 550.0, 450.0]);
        assert_eq!(parse("400:420:10,850").unwrap(), [400.0, 410.0, 420.0, 850.0]);
    }

    #[test]
    fn invalid_lists_are_errors() {
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
    fn wavelengths_in_another_unit_are_asked_for() {
        let error = |list: &str| parse(list).unwrap_err().to_string();
        assert!(error("0.4:0.7:0.1").contains("in µm? Then it is 400 nm"), "{}", error("0.4:0.7:0.1"));
        assert!(error("550e-9").contains("in m? Then it is 550 nm"), "{}", error("550e-9"));
        assert!(!error("0").contains("meant"));
    }

    #[test]
    fn formatted_lists_round_trip() {
        for list in ["400:700:10", "450,550,650", "450", "410,470.5,700", "400:401:0.1"] {
            let nm = parse(list).unwrap();
            assert_eq!(parse(&format(&nm)).unwrap(), nm);
        }
        assert_eq!(format(&parse("400:700:10").unwrap()), "400:700:10");
    }
}
