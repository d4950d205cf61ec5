//! Order of file names with numbers, and wavelengths in them.

use std::cmp::Ordering;
use std::ops::RangeInclusive;

/// Numbers that may be wavelengths in nm.
const WAVELENGTHS_NM: RangeInclusive<f64> = 200.0..=2500.0;

/// A number in a name.
#[derive(Clone, Debug, PartialEq)]
struct Number {
    value: f64,
    /// Whether `nm` follows.
    has_unit: bool,
    has_leading_zero: bool,
}

/// Order of names in which runs of digits compare by value: `b2` before `b10`.
pub(super) fn natural_order(a: &str, b: &str) -> Ordering {
    let (mut x, mut y) = (a, b);
    loop {
        match (x.chars().next(), y.chars().next()) {
            (None, None) => return a.cmp(b),
            (None, _) => return Ordering::Less,
            (_, None) => return Ordering::Greater,
            (Some(p), Some(q)) if p.is_ascii_digit() && q.is_ascii_digit() => {
                let (digits_x, rest_x) = split_digits(x);
                let (digits_y, rest_y) = split_digits(y);
                let significant = |d: &str| d.trim_start_matches('0').to_owned();
                let (s, t) = (significant(digits_x), significant(digits_y));
                match s.len().cmp(&t.len()).then_with(|| s.cmp(&t)) {
                    Ordering::Equal => (x, y) = (rest_x, rest_y),
                    other => return other,
                }
            }
            (Some(p), Some(q)) if p == q => (x, y) = (&x[p.len_utf8()..], &y[q.len_utf8()..]),
            (Some(p), Some(q)) => return p.cmp(&q),
        }
    }
}

fn split_digits(s: &str) -> (&str, &str) {
    s.split_at(s.bytes().take_while(u8::is_ascii_digit).count())
}

/// The numbers in a file name without its extension.
fn numbers(name: &str) -> Vec<Number> {
    let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
    let mut found = Vec::new();
    let mut rest = stem;
    while let Some(start) = rest.find(|c: char| c.is_ascii_digit()) {
        let (whole, mut after) = split_digits(&rest[start..]);
        let mut text = whole.to_owned();
        if let Some(fraction) = after.strip_prefix('.').map(|f| split_digits(f).0).filter(|f| !f.is_empty()) {
            text = format!("{whole}.{fraction}");
            after = &after[1 + fraction.len()..];
        }
        let unit: String =
            after.trim_start_matches(['_', '-', ' ']).chars().take_while(|c| c.is_alphabetic()).collect();
        found.push(Number {
            value: text.parse().unwrap_or(f64::INFINITY),
            has_unit: unit.eq_ignore_ascii_case("nm"),
            has_leading_zero: whole.len() > 1 && whole.starts_with('0'),
        });
        rest = after;
    }
    found
}

/// The number that is a wavelength, and its index among the numbers of the name: the only one followed by `nm`, else the only one of 200
/// to 2500 without leading zeros (a counter has these).
fn wavelength(name: &str) -> Option<(usize, f64)> {
    let numbers = numbers(name);
    let only = |is: &dyn Fn(&Number) -> bool| {
        let mut found =
            numbers.iter().enumerate().filter(|(_, n)| WAVELENGTHS_NM.contains(&n.value) && is(n));
        found.next().filter(|_| found.next().is_none()).map(|(k, n)| (k, n.value))
    };
    match numbers.iter().any(|n| n.has_unit) {
        true => only(&|n| n.has_unit),
        false => only(&|n| !n.has_leading_zero),
    }
}

/// Wavelengths in nm, if every name holds one at the same position and no two are equal.
pub(super) fn wavelengths(names: &[String]) -> Option<Vec<f64>> {
    let found: Vec<(usize, f64)> = names.iter().map(|n| wavelength(n)).collect::<Option<_>>()?;
    let mut sorted: Vec<f64> = found.iter().map(|f| f.1).collect();
    sorted.sort_by(f64::total_cmp);
    let distinct = sorted.windows(2).all(|w| w[0] < w[1]);
    let same_place = found.iter().all(|f| f.0 == found[0].0);
    (distinct && same_place).then(|| found.into_iter().map(|f| f.1).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_names_sort_by_value() {
        let sorted = ["b1.png", "b2.png", "b010.png", "b10.png", "b11a2.png", "b11a10.png", "c"];
        for (i, a) in sorted.iter().enumerate() {
            for (j, b) in sorted.iter().enumerate() {
                assert_eq!(natural_order(a, b), i.cmp(&j), "{a} {b}");
            }
        }
    }

    #[test]
    fn wavelengths_are_the_only_number_in_range_at_one_position() {
        let cases: [(&[&str], Option<&[f64]>); 10] = [
            (&["450.png", "550.png"], Some(&[450.0, 550.0])),
            (&["band_400.5nm_v2.tif", "band_410 nm_v2.tif"], Some(&[400.5, 410.0])),
            (&["s512_1_450nm.png", "s512_2_550nm.png"], Some(&[450.0, 550.0])),
            (&["ms_01.png", "ms_31.png"], None),
            (&["IMG_0400.png", "IMG_0410.png"], None),
            (&["512_450.png", "512_550.png"], None),
            (&["a450.png", "1a550.png"], None),
            (&["450.png", "preview.png"], None),
            (&["450_1.png", "450_2.png"], None),
            (&["450nm_550nm.png"], None),
        ];
        for (names, expected) in cases {
            let names: Vec<String> = names.iter().map(|n| (*n).to_owned()).collect();
            assert_eq!(wavelengths(&names).as_deref(), expected, "{names:?}");
        }
    }
}
