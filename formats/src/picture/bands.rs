//! Curves of several wavelengths: a few have a name, a colour and a dash pattern each; more of them share a colour bar.

use super::plot::{Legend, Series};
use super::style::{Colour, PALETTE};

/// Whether wavelengths are few enough for a legend.
fn in_legend(nm: &[f64]) -> bool {
    nm.len() < PALETTE
}

/// The curve of wavelength `i` of `nm` (ascending).
pub fn band_series(nm: &[f64], i: usize, points: Vec<(f64, f64)>) -> Series {
    // At most four decimals, without trailing zeros.
    let digits = format!("{:.4}", nm[i]);
    let name = format!("{} nm", digits.trim_end_matches('0').trim_end_matches('.'));
    if in_legend(nm) {
        return Series::distinct(name, points, i);
    }
    let (first, last) = (nm[0], nm[nm.len() - 1]);
    Series::line(name, points, Colour::Scale((nm[i] - first) / (last - first)))
}

/// Legend of the colours of [`band_series`].
pub fn band_key(nm: &[f64]) -> Legend {
    match nm {
        [first, .., last] if !in_legend(nm) => Legend::Bar("wavelength λ (nm)".into(), *first, *last),
        _ => Legend::Names,
    }
}
