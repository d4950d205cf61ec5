//! `--bands`: bands by wavelength in nm (`550`, `450:650`, `450:650:50`, both ends included) or by index (`#3`, `#0:5`, `#::2`, half-open as in
//! Python), in a list.
//!
//! Numbers without `#` that are all below [`MIN_NM`] are indices: the syntax of earlier versions.

use super::values::band_indices;
use std::collections::BTreeSet;

/// Smallest number that is a wavelength.
const MIN_NM: f64 = 200.0;
/// Difference within which a band has a given wavelength, nm.
const SAME_NM: f64 = 0.05;

/// Bands among those at `nm` that `text` selects, ascending, and a note if it has the syntax of earlier versions.
///
/// # Errors
/// No such band; not a list of bands.
pub fn bands(text: &str, nm: &[f64]) -> Result<(Vec<usize>, Option<String>), String> {
    let is_old = |part: &str| {
        let numbers = part.split(':').map(str::trim).filter(|t| !t.is_empty());
        !part.trim().starts_with('#') && numbers.clone().all(|t| t.parse::<f64>().is_ok_and(|v| v < MIN_NM))
    };
    if text.split(',').all(is_old) {
        let indexed = text.split(',').map(|part| format!("#{}", part.trim())).collect::<Vec<_>>().join(",");
        let note = format!(
            "--bands {text} selects by index, which is now written '{indexed}'; numbers from {MIN_NM} are wavelengths in nm"
        );
        return Ok((band_indices(text, nm.len())?, Some(note)));
    }
    let mut all = BTreeSet::new();
    for part in text.split(',').map(str::trim) {
        match part.strip_prefix('#') {
            Some(indices) => all.extend(band_indices(indices, nm.len())?),
            None => all.extend(at_wavelengths(part, nm)?),
        }
    }
    Ok((all.into_iter().collect(), None))
}

/// Bands at one wavelength, or from one to another, both included, or at equal steps.
fn at_wavelengths(part: &str, nm: &[f64]) -> Result<Vec<usize>, String> {
    let number =
        |t: &str, default: f64| match t.trim() {
            "" => Ok(default),
            t => t.parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(|| {
                format!("`{t}` is neither a wavelength in nm nor a band index such as '#0:5'")
            }),
        };
    let at = |wavelength: f64| {
        let found = nm.iter().position(|v| (v - wavelength).abs() <= SAME_NM);
        found.ok_or_else(|| {
            let nearest =
                nm.iter().copied().min_by(|a, b| (a - wavelength).abs().total_cmp(&(b - wavelength).abs()));
            let nearest = nearest.map_or("there are none".into(), |v| format!("the nearest is at {v} nm"));
            format!("no band at {wavelength} nm, {nearest}; a band index is written '#{wavelength}'")
        })
    };
    match part.split(':').collect::<Vec<_>>()[..] {
        [one] => Ok(vec![at(number(one, f64::NAN)?)?]),
        [first, last] => {
            let (first, last) = (number(first, f64::NEG_INFINITY)?, number(last, f64::INFINITY)?);
            let inside = |v: f64| first - SAME_NM <= v && v <= last + SAME_NM;
            let found: Vec<usize> = (0..nm.len()).filter(|&b| inside(nm[b])).collect();
            match (found.is_empty(), nm.iter().copied().reduce(f64::min), nm.iter().copied().reduce(f64::max))
            {
                (false, ..) => Ok(found),
                (true, Some(min), Some(max)) => {
                    Err(format!("no band in `{part}` nm; the bands are at {min} to {max} nm"))
                }
                _ => Err(format!("`{part}` selects none of 0 bands")),
            }
        }
        [_, _, _] => {
            pipeline::wavelengths::parse(part).map_err(|e| e.to_string())?.into_iter().map(at).collect()
        }
        _ => Err(format!("`{part}` is not a range such as 450:650 or '#0:5'")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NM: [f64; 4] = [400.0, 450.0, 500.0, 550.5];

    #[test]
    fn wavelengths_include_both_ends_and_indices_have_a_hash() {
        for (text, expected) in [
            ("450", &[1][..]),
            ("400:500", &[0, 1, 2]),
            ("450:", &[1, 2, 3]),
            (":450.02", &[0, 1]),
            ("400:500:50", &[0, 1, 2]),
            ("550.5,400", &[0, 3]),
            ("#3", &[3]),
            ("#0:2,500", &[0, 1, 2]),
            ("#::3", &[0, 3]),
        ] {
            assert_eq!(bands(text, &NM), Ok((expected.to_vec(), None)), "{text}");
        }
    }

    #[test]
    fn numbers_below_200_are_indices_with_a_note() {
        let (found, note) = bands("0,2:4", &NM).unwrap();
        assert_eq!(found, [0, 2, 3]);
        assert!(note.unwrap().contains("'#0,#2:4'"));
        assert_eq!(bands(":2", &NM).unwrap().0, [0, 1]);
    }

    #[test]
    fn missing_band_is_an_error_that_names_the_nearest() {
        for (text, words) in [
            ("551", "the nearest is at 550.5 nm"),
            ("600:700", "400 to 550.5 nm"),
            ("650:450", "no band"),
            ("red", "band index"),
            ("400:490:30", "no band at 430 nm"),
            ("#4", "beyond the last of 4 bands"),
            ("#2:1", "selects no band"),
            ("4", "beyond the last of 4 bands"),
            ("400:450:10:20", "not a range"),
            ("", "band index"),
        ] {
            let error = bands(text, &NM).unwrap_err();
            assert!(error.contains(words), "{text}: {error}");
        }
        assert!(bands("500", &[]).is_err() && bands("400:500", &[]).is_err());
    }
}
