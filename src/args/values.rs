//! Parsers of argument values.

use clap::builder::{PathBufValueParser, TypedValueParser};
use pipeline::bounds::{self, Bound};
use pipeline::geometry::{Rect, Size};
use std::path::{Path, PathBuf};

pub(super) fn number(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(v) if v.is_finite() => Ok(v),
        _ => Err(format!("`{text}` is not a number")),
    }
}

pub(super) fn positive(text: &str) -> Result<f64, String> {
    number(text).and_then(|v| if v > 0.0 { Ok(v) } else { Err(format!("{v} is not greater than 0")) })
}

/// A share of the whole, without 0 and 1.
pub(super) fn share(text: &str) -> Result<f64, String> {
    number(text).and_then(|v| match v > 0.0 && v < 1.0 {
        true => Ok(v),
        false => Err(format!("{v} is not a share between 0 and 1, both excluded")),
    })
}

/// A number, or one in percent: `10%` is 0.1.
pub(super) fn percent_or_number(text: &str) -> Result<f64, String> {
    match text.trim().strip_suffix('%') {
        Some(percent) => Ok(number(percent)? / 100.0),
        None => number(text),
    }
}

/// A share from 0 to 1, as `10%` or `0.1`.
pub(super) fn percent_or_share(text: &str) -> Result<f64, String> {
    let share = percent_or_number(text)?;
    match (0.0..=1.0).contains(&share) {
        true => Ok(share),
        false => Err(format!("{text} is not a share from 0 to 1 (100%)")),
    }
}

/// Side of the largest PSF window, at most `max` film pixels.
pub(super) fn window_px(text: &str, max: usize) -> Result<usize, String> {
    let side = text.trim().parse::<usize>().ok().filter(|n| n % 2 == 1 && (3..=max).contains(n));
    side.ok_or_else(|| format!("expected an odd number of film pixels from 3 to {max}"))
}

/// Parser of a number within `bound`.
pub(super) fn bounded(bound: Bound) -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync {
    move |text| bound.check(number(text)?).map_err(|e| e.to_string())
}

/// Two numbers `X,Y` within a bound.
pub(super) fn pair_within(bound: Bound, text: &str) -> Result<(f64, f64), String> {
    let (a, b) = text.split_once(',').ok_or("expected two numbers X,Y")?;
    let one = bounded(bound);
    Ok((one(a)?, one(b)?))
}

/// A position on the film, px.
pub(super) fn pair(text: &str) -> Result<(f64, f64), String> {
    pair_within(bounds::AXIS_PX, text)
}

/// A position on the film, mm from the axis.
pub(super) fn film_point(text: &str) -> Result<(f64, f64), String> {
    pair_within(bounds::FILM_POINT_MM, text)
}

/// A position on the ideal image plane, mm.
pub(super) fn pair_mm(text: &str) -> Result<(f64, f64), String> {
    pair_within(bounds::CENTER_MM, text)
}

pub(super) fn pitch(text: &str) -> Result<f64, String> {
    bounded(bounds::PITCH_UM)(text)
}

pub(super) fn scale(text: &str) -> Result<(f64, f64), String> {
    let (x, y) = text.split_once(',').unwrap_or((text, text));
    let one = bounded(bounds::SCALE);
    Ok((one(x)?, one(y)?))
}

/// A side of the film or a column or row, px.
pub(super) fn side(text: &str) -> Result<usize, String> {
    integer_within(bounds::FILM_SIDE_PX, text)
}

/// Side of a shard or chunk, px.
pub(super) fn storage(text: &str) -> Result<usize, String> {
    integer_within(bounds::SHARD_SIDE_PX, text)
}

fn integer_within(bound: Bound, text: &str) -> Result<usize, String> {
    let number = text.trim().parse::<usize>().ok().filter(|n| bound.check_count(*n).is_ok());
    number.ok_or_else(|| format!("`{text}` is not an integer from {bound}"))
}

/// `N` or `WxH`, px.
pub(super) fn size(text: &str) -> Result<Size, String> {
    let (w, h) = text.split_once(['x', 'X']).unwrap_or((text, text));
    Ok(Size::new(side(h)?, side(w)?))
}

/// A note on the order of a size that is not square, given as `argument`.
pub fn size_order_note(argument: &str, size: Size) -> Option<String> {
    (size.width != size.height).then(|| {
        format!("{argument} {size} is width x height; earlier versions read sizes as height x width")
    })
}

pub(super) fn roi(text: &str) -> Result<Rect, String> {
    let parts: Vec<&str> = text.split(',').collect();
    let [x, y, w, h] = parts[..] else { return Err("expected X,Y,W,H in pixels".into()) };
    let pixel = |t: &str| {
        t.trim().parse::<u32>().map(i64::from).map_err(|_| format!("`{t}` is not a pixel of the film"))
    };
    Ok(Rect::new(pixel(y)?, pixel(x)?, side(h)?, side(w)?))
}

pub(super) fn azimuths(text: &str) -> Result<usize, String> {
    match text.parse::<usize>() {
        Ok(n) if n.is_multiple_of(4) && bounds::AZIMUTHS.check_count(n).is_ok() => Ok(n),
        _ => Err(
            "expected a multiple of 4, at most 7200; with a multiple of 8, symmetric PSFs need fewer kernels"
                .into(),
        ),
    }
}

pub(super) fn unit(text: &str) -> Result<String, String> {
    match text.trim() {
        t if !t.is_empty() && t.chars().count() <= 64 && !t.contains(char::is_control) => Ok(t.into()),
        _ => Err("expected a unit of at most 64 characters, e.g. 'W m-2 sr-1 nm-1'".into()),
    }
}

pub(super) fn keep_bits(text: &str) -> Result<u32, String> {
    match text.parse::<u32>() {
        Ok(n) if (1..=23).contains(&n) => Ok(n),
        _ => Err("expected 1 to 23 bits of an f32's mantissa, 1 to 10 of an f16's".into()),
    }
}

pub(super) fn odd(text: &str) -> Result<usize, String> {
    match text.parse::<usize>() {
        Ok(n) if n % 2 == 1 && bounds::PSF_SIDE.check_count(n).is_ok() => Ok(n),
        _ => Err("expected an odd number of film pixels, at most 8191".into()),
    }
}

pub(super) fn threads(text: &str) -> Result<usize, String> {
    match text.parse::<usize>() {
        Ok(n) if (1..=1024).contains(&n) => Ok(n),
        _ => Err("expected 1 to 1024 threads".into()),
    }
}

/// A number of units.
pub(super) fn units(text: &str) -> Result<usize, String> {
    let number = text.trim().parse::<usize>().ok().filter(|n| (1..=1_000_000).contains(n));
    number.ok_or_else(|| "expected a number of units from 1 to 1000000".into())
}

pub(super) fn shard_rows(text: &str) -> Result<usize, String> {
    match text.parse::<usize>() {
        Ok(n) if n > 0 => Ok(n),
        _ => Err("expected a number of shard rows, 1 or more".into()),
    }
}

/// Endings of files of figures.
const FIGURES: [&str; 2] = ["png", "svg"];
/// Endings of files that are no directory of figures.
const FILES: [&str; 9] = ["png", "svg", "pdf", "eps", "jpg", "jpeg", "tif", "npy", "csv"];

fn ending(path: &Path) -> String {
    path.extension().map_or_else(String::new, |e| e.to_string_lossy().to_ascii_lowercase())
}

/// The file of a figure, .png or .svg.
pub(super) fn figure() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().try_map(|path| match FIGURES.contains(&&*ending(&path)) {
        true => Ok(path),
        false => Err("expected a name ending with .png or .svg (other programs convert .svg to .pdf)"),
    })
}

/// The directory of figures.
pub(super) fn figures() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().try_map(|path| match FILES.contains(&&*ending(&path)) && !path.is_dir() {
        true => Err("expected a directory, in which figures are written as .svg and .png"),
        false => Ok(path),
    })
}

/// `1GiB`, `512MiB`, `4G`: binary units with i, decimal without.
pub(super) fn bytes(text: &str) -> Result<u64, String> {
    let text = text.trim();
    let digits = text.len() - text.trim_start_matches(|c: char| c.is_ascii_digit() || c == '.').len();
    let unit = match text[digits..].trim().to_ascii_lowercase().as_str() {
        "" | "b" => 1u64,
        "k" | "kb" => 1000,
        "ki" | "kib" => 1 << 10,
        "m" | "mb" => 1_000_000,
        "mi" | "mib" => 1 << 20,
        "g" | "gb" => 1_000_000_000,
        "gi" | "gib" => 1 << 30,
        "t" | "tb" => 1_000_000_000_000,
        "ti" | "tib" => 1 << 40,
        other => {
            return Err(format!("`{other}` is not a unit of bytes (KiB, MiB, GiB, TiB, or kB, MB, GB, TB)"));
        }
    };
    match text[..digits].parse::<f64>() {
        Ok(v) if v > 0.0 => Ok((v * unit as f64) as u64),
        _ => Err(format!("`{text}` is not an amount of memory such as 1GiB")),
    }
}

/// Parses indices and half-open ranges, as in Python: `0,5,10:15`, `:5`, `::3`; the result is ascending and without duplicates.
///
/// # Errors
/// Not an index or range; an index not below `count`.
pub fn band_indices(text: &str, count: usize) -> Result<Vec<usize>, String> {
    let mut out = std::collections::BTreeSet::new();
    for part in text.split(',') {
        let fields: Vec<&str> = part.trim().split(':').collect();
        let index = |t: &str, default: usize| match t.trim() {
            "" => Ok(default),
            t => t.parse::<usize>().map_err(|_| format!("`{t}` is not a band index")),
        };
        let (first, end, step) = match fields[..] {
            [one] => {
                let i = one.parse::<usize>().map_err(|_| format!("`{one}` is not a band index"))?;
                if i >= count {
                    return Err(format!("band {i} is beyond the last of {count} bands"));
                }
                (i, i + 1, 1)
            }
            [a, b] => (index(a, 0)?, index(b, count)?, 1),
            [a, b, s] => (index(a, 0)?, index(b, count)?, index(s, 1)?),
            _ => return Err(format!("`{part}` is not a range of bands such as 10:15")),
        };
        if step == 0 {
            return Err(format!("`{part}` has a step of 0"));
        }
        if end > count {
            return Err(format!("range {part} ends beyond the chart's {count} bands"));
        }
        out.extend((first..end).step_by(step));
    }
    match out.is_empty() {
        true => Err(format!("`{text}` selects no band of {count}")),
        false => Ok(out.into_iter().collect()),
    }
}

#[cfg(test)]
#[path = "../../tests/fuzz_support/mod.rs"]
mod fuzz_support;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn valid_values_parse_and_others_are_errors() {
        assert_eq!(size("14141"), Ok(Size::new(14141, 14141)));
        assert_eq!(size("7x5"), Ok(Size::new(5, 7)));
        assert!(size("1e18").is_err() && size("0").is_err() && size("-3x4").is_err());
        assert_eq!(bytes("1GiB"), Ok(1 << 30));
        assert_eq!(bytes("1.5 MB"), Ok(1_500_000));
        assert!(bytes("one").is_err() && bytes("4QiB").is_err());
        assert_eq!(roi("3,5,10,20"), Ok(Rect::new(5, 3, 20, 10)));
        assert!(roi("1,2,3").is_err() && roi("-1,0,5,5").is_err() && roi("0,0,0,5").is_err());
        assert_eq!(band_indices("0,5,10:15", 31), Ok(vec![0, 5, 10, 11, 12, 13, 14]));
        assert_eq!(band_indices(":3", 31), Ok(vec![0, 1, 2]));
        assert_eq!(band_indices("::10", 31), Ok(vec![0, 10, 20, 30]));
        assert!(
            band_indices("31", 31).is_err()
                && band_indices("5:2", 31).is_err()
                && band_indices("x", 31).is_err()
        );
        // Found by the fuzz test below: no bands at all.
        assert!(
            band_indices("0", 0).unwrap_err().contains("last of 0 bands") && band_indices(":", 0).is_err()
        );
        assert_eq!(scale("2"), Ok((2.0, 2.0)));
        assert_eq!(scale("2,0.5"), Ok((2.0, 0.5)));
        assert!(scale("0").is_err() && scale("nan").is_err());
    }

    /// Any text gives a value within its bounds, or an error.
    #[test]
    fn any_text_gives_a_value_within_bounds_or_an_error() {
        use super::fuzz_support::extreme::{integer, magnitude, text};
        use super::fuzz_support::{Random, cases, print_row};
        use proptest::prelude::*;
        use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};
        let number = prop_oneof![
            any::<f64>().prop_map(|v| v.to_string()),
            any::<u64>().prop_map(|v| v.to_string()),
            any::<u64>().prop_map(|seed| magnitude(&mut Random(seed)).to_string()),
            any::<u64>().prop_map(|seed| integer(&mut Random(seed)).to_string()),
            any::<u64>().prop_map(|seed| text(&mut Random(seed))),
            (0u32..50).prop_map(|v| v.to_string()),
            prop::sample::select(vec![
                "",
                "nan",
                "inf",
                "1e999",
                "18446744073709551616",
                "-1",
                "+2",
                "1e-320",
                "µ",
                " 3 "
            ])
            .prop_map(String::from),
        ];
        let part =
            (number, prop::sample::select(vec!["", ",", ":", "::", "x", "X", " GiB", "kB", "µ", ",,", ";"]));
        let texts = prop::collection::vec(part, 0..5)
            .prop_map(|parts| parts.into_iter().map(|(n, s)| n + s).collect::<String>());
        let config = Config { cases: cases(2000) as u32, failure_persistence: None, ..Config::default() };
        let rng = TestRng::deterministic_rng(RngAlgorithm::ChaCha);
        let (start, used) = (std::time::Instant::now(), std::cell::Cell::new(0));
        let result = TestRunner::new_with_rng(config, rng).run(&(texts, 0usize..40), |(text, count)| {
            let is_positive = positive(&text).is_ok_and(|v| v.is_finite() && v > 0.0);
            let sides = size(&text).map_or(0, |s| s.height.max(s.width));
            prop_assert!(sides as f64 <= bounds::FILM_SIDE_PX.max && storage(&text).unwrap_or(1) <= 16384);
            prop_assert!(pitch(&text).is_ok_and(|p| p.is_finite()) <= is_positive);
            prop_assert!(scale(&text).map_or(1.0, |s| s.0 * s.1).is_finite());
            prop_assert!(pair(&text).map_or(0.0, |p| p.0 + p.1).is_finite());
            prop_assert!(azimuths(&text).unwrap_or(4).is_multiple_of(4));
            prop_assert!(!odd(&text).unwrap_or(1).is_multiple_of(2) && threads(&text).unwrap_or(1) >= 1);
            let any =
                size(&text).is_ok() || bytes(&text).is_ok() || roi(&text).is_ok() || pair(&text).is_ok();
            used.set(used.get() + usize::from(any || band_indices(&text, count).is_ok()));
            if let Ok(list) = band_indices(&text, count) {
                prop_assert!(!list.is_empty() && list.iter().all(|b| *b < count));
                prop_assert!(list.windows(2).all(|w| w[0] < w[1]));
            }
            Ok(())
        });
        let findings = usize::from(result.is_err());
        print_row("command-line values", cases(2000), start.elapsed().as_secs_f64(), findings, used.get());
        result.unwrap();
        assert!(used.get() > 0);
    }
}
