//! Reader of AGF glass catalogues: the text format that glass makers publish for design programs.
//!
//!     NM <name> <formula> …      CD <coefficients>      LD <min µm> <max µm>
//! Names consist of letters, digits and signs, without blanks. Lines with other keywords (comments, cost, thermal and chemical data,
//! internal transmission) do not change the index at 20 °C and 1 atm and are skipped. ASCII, Latin-1, UTF-8 or UTF-16LE with BOM.

use super::error::DesignError;
use super::glass::{Dispersion, Glass, GlassCatalog};
use super::text::decode;

/// Keywords that do not change the index at 20 °C.
const SKIPPED: [&str; 8] = ["CC", "GC", "ED", "TD", "OD", "IT", "BD", "MD"];

/// Reads a catalogue.
///
/// # Errors
/// [`DesignError::Catalogue`] with the line.
pub fn parse(bytes: &[u8]) -> Result<GlassCatalog, DesignError> {
    let mut catalog = GlassCatalog::default();
    let mut open: Option<Draft> = None;
    for (i, text) in decode(bytes).lines().enumerate() {
        let line = i + 1;
        let bad = |problem: String| DesignError::Catalogue { line, problem };
        let mut words = text.split_whitespace();
        let Some(key) = words.next() else { continue };
        match key {
            "NM" => {
                finish(&mut catalog, open.take())?;
                let name = words.next().ok_or_else(|| bad("NM without a name".to_owned()))?;
                let formula = words.next().and_then(number).filter(|f| (1.0..14.0).contains(f));
                let formula =
                    formula.ok_or_else(|| bad(format!("{name} has no dispersion formula of 1..13")))?;
                open =
                    Some(Draft { line, name: name.to_owned(), formula: formula as u8, c: None, range: None });
            }
            "CD" | "LD" => {
                let draft = open.as_mut().ok_or_else(|| bad(format!("{key} before any NM")))?;
                let values: Option<Vec<f64>> = words.map(number).collect();
                let values = values.ok_or_else(|| {
                    bad(format!("{key} of {} has a value that is not a number", draft.name))
                })?;
                if key == "CD" {
                    draft.c = Some(values);
                } else {
                    match values[..] {
                        [a, b, ..] if a > 0.0 && b >= a => draft.range = Some((a, b)),
                        _ => {
                            return Err(bad(format!("LD of {} is not an ascending range of µm", draft.name)));
                        }
                    }
                }
            }
            _ if SKIPPED.contains(&key) => {}
            _ if open.is_none() => {}
            _ => return Err(bad(format!("`{key}` is not a keyword of the AGF format"))),
        }
    }
    finish(&mut catalog, open)?;
    if catalog.glasses().is_empty() {
        return Err(DesignError::Catalogue { line: 1, problem: "it has no glass (no NM line)".to_owned() });
    }
    Ok(catalog)
}

struct Draft {
    line: usize,
    name: String,
    formula: u8,
    c: Option<Vec<f64>>,
    range: Option<(f64, f64)>,
}

fn finish(catalog: &mut GlassCatalog, draft: Option<Draft>) -> Result<(), DesignError> {
    let Some(d) = draft else { return Ok(()) };
    let bad = |problem: String| DesignError::Catalogue { line: d.line, problem };
    let c = d.c.ok_or_else(|| bad(format!("{} has no coefficients (CD)", d.name)))?;
    let range_um = d.range.ok_or_else(|| bad(format!("{} has no wavelength range (LD)", d.name)))?;
    let dispersion = Dispersion::new(d.formula, &c).map_err(|p| bad(format!("{}: {p}", d.name)))?;
    catalog.add(Glass { name: d.name, dispersion, range_um });
    Ok(())
}

fn number(word: &str) -> Option<f64> {
    word.parse().ok().filter(|v: &f64| v.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    const TWO: &str = "CC a comment\nNM N-BK7 2 517642.251 1.5168 64.17 0 1 1\nED 7.1 8.3 2.51 -0.0009 0\n\
        CD 1.03961212E+000 6.00069867E-003 2.31792344E-001 2.00179144E-002 1.01046945E+000 1.03560653E+002 0 0 0 0\n\
        TD 0 0 0 0 0 0 20\nOD -1 2.3 1 2.3 1 2.3\nLD 3.0E-001 2.5E+000\nIT 3.0E-001 5.0E-002 25\n\
        NM OLD 1 0 1.5 60\nCD 2.25 0 0 0 0 0\nLD 0.4 0.7\n";

    #[test]
    fn names_formulas_and_ranges_are_read() {
        let c = parse(TWO.as_bytes()).unwrap();
        assert_eq!(c.glasses().len(), 2);
        assert!((c.get("N-BK7").unwrap().index(0.587_561_8).unwrap() - 1.516_800).abs() < 1e-6);
        assert!((c.get("OLD").unwrap().index(0.5).unwrap() - 1.5).abs() < 1e-15);
    }

    #[test]
    fn wrong_line_is_an_error_with_its_number() {
        for (from, to, line) in
            [("LD 0.4 0.7", "LD 0.7", 11), ("CD 2.25", "CD x", 10), ("OLD 1", "OLD 14", 9), ("IT", "QQ", 8)]
        {
            let e = parse(TWO.replace(from, to).as_bytes()).unwrap_err();
            assert!(matches!(e, DesignError::Catalogue { line: l, .. } if l == line), "{e}");
        }
        assert!(parse(b"").is_err());
    }
}
