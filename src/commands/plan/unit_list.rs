//! Lists of units as text: `7`, `3-9,12` (ends included), `env:NAME`.

use crate::failure::usage;
use anyhow::Result;
use std::collections::BTreeSet;

/// Parses `text`, units out of `count`; `env:NAME` reads the list from an environment variable. An empty text is an empty list, as `status --missing`
/// prints it of a complete film.
///
/// # Errors
/// Usage: variable not set, not a list, a unit beyond the last.
pub fn parse(text: &str, count: usize) -> Result<BTreeSet<usize>> {
    if text.trim().is_empty() {
        return Ok(BTreeSet::new());
    }
    let Some(name) = text.strip_prefix("env:") else {
        return parse_list(text, count).map_err(|e| usage(format!("--unit {text}: {e}")));
    };
    let value = std::env::var(name).map_err(|_| {
        usage(format!(
            "--unit {text}: the environment variable {name} is not set; outside an array job list the units: --unit 3-9"
        ))
    })?;
    parse_list(&value, count).map_err(|e| usage(format!("--unit {text}, which is `{value}`: {e}")))
}

fn parse_list(text: &str, count: usize) -> Result<BTreeSet<usize>, String> {
    let mut out = BTreeSet::new();
    for part in text.split(',') {
        let unit = |t: &str| match t.trim().parse::<usize>() {
            Ok(n) if n < count => Ok(n),
            Ok(n) => Err(format!("there is no unit {n}: the plan has units 0 to {}", count - 1)),
            Err(_) => Err(format!("`{t}` is not a unit; expected 7, or 3-9,12 (ends included)")),
        };
        match part.split_once('-') {
            None => {
                out.insert(unit(part)?);
            }
            Some((first, last)) => {
                let (first, last) = (unit(first)?, unit(last)?);
                if last < first {
                    return Err(format!("`{part}`: the first number must not exceed the last"));
                }
                out.extend(first..=last);
            }
        }
    }
    Ok(out)
}

/// Formats `units` for [`parse`] and `sbatch --array=`; empty for none.
pub fn format(units: &BTreeSet<usize>) -> String {
    let mut runs: Vec<(usize, usize)> = Vec::new();
    for &unit in units {
        match runs.last_mut() {
            Some((_, last)) if *last + 1 == unit => *last = unit,
            _ => runs.push((unit, unit)),
        }
    }
    let text = |&(first, last): &(usize, usize)| match first == last {
        true => first.to_string(),
        false => format!("{first}-{last}"),
    };
    runs.iter().map(text).collect::<Vec<_>>().join(",")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parsed_lists_are_formatted_shortest_and_parse_to_the_same_units() {
        for (text, formatted) in [
            ("7", "7"),
            ("3-9,12", "3-9,12"),
            ("12, 3-5,4 ,6", "3-6,12"),
            ("0-0", "0"),
            ("30", "30"),
            ("0,1", "0-1"),
        ] {
            let units = parse_list(text, 31).unwrap();
            assert_eq!(format(&units), formatted);
            assert_eq!(parse_list(&format(&units), 31).unwrap(), units);
        }
        assert_eq!(format(&BTreeSet::new()), "");
        for wrong in ["", "31", "3-31", "9-3", "x", "-1", "1-", "1,,2", "1:3", "0x3", "1-2-3"] {
            assert!(parse_list(wrong, 31).is_err(), "{wrong}");
        }
    }
}
