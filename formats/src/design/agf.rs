//! Reader of AGF glass catalogues: the text format that glass makers publish for design programs.
//!
//! ```text
//! NM <name> <formula> …      CD <coefficients>      LD <min µm> <max µm>      IT <µm> <transmittance> <thickness mm>
//! ```
//! Names consist of letters, digits and signs, without blanks. Lines with other keywords (comments, cost, thermal and chemical data) do not
//! change index and absorption at 20 °C and 1 atm and are skipped. ASCII, Latin-1, UTF-8 or UTF-16LE with BOM.

use super::error::LensFileError;
use super::text::{decode, number};
use super::writing::number as decimal;
use pipeline::design::absorption::Absorption;
use pipeline::design::glass::{Dispersion, Glass, GlassCatalog};
use pipeline::design::model_glass::LINES_UM;

/// Keywords that do not change the index at 20 °C.
const SKIPPED: [&str; 7] = ["CC", "GC", "ED", "TD", "OD", "BD", "MD"];

/// Reads a catalogue.
///
/// # Errors
/// [`LensFileError::Catalogue`] with the line.
pub fn parse(bytes: &[u8]) -> Result<GlassCatalog, LensFileError> {
    let (catalog, problems) = parse_usable(bytes);
    match problems.into_iter().next() {
        Some(problem) => Err(problem),
        None if catalog.glasses().is_empty() => {
            Err(LensFileError::Catalogue { line: 1, problem: "it has no glass (no NM line)".to_owned() })
        }
        None => Ok(catalog),
    }
}

/// Reads the glasses of a catalogue that are valid, and the problems of its other lines.
pub fn parse_usable(bytes: &[u8]) -> (GlassCatalog, Vec<LensFileError>) {
    let (mut catalog, mut problems) = (GlassCatalog::default(), Vec::new());
    let mut open: Option<Draft> = None;
    for (i, text) in decode(bytes).lines().enumerate() {
        let mut words = text.split_whitespace();
        let Some(key) = words.next() else { continue };
        if key == "NM"
            && let Some(Err(problem)) = open.take().map(|draft| draft.finish(&mut catalog))
        {
            problems.push(problem);
        }
        if let Err(problem) = read_line(i + 1, key, words, &mut open) {
            problems.push(LensFileError::Catalogue { line: i + 1, problem });
            // A text line does not invalidate a glass.
            open = open.filter(|_| !matches!(key, "NM" | "CD" | "LD"));
        }
    }
    if let Some(Err(problem)) = open.map(|draft| draft.finish(&mut catalog)) {
        problems.push(problem);
    }
    (catalog, problems)
}

/// Reads a line into the open glass.
fn read_line<'a>(
    line: usize,
    key: &str,
    mut words: impl Iterator<Item = &'a str>,
    open: &mut Option<Draft>,
) -> Result<(), String> {
    match key {
        "NM" => {
            let name = words.next().ok_or("NM without a name")?.to_owned();
            let formula = words.next().and_then(number).filter(|f| (1.0..14.0).contains(f));
            let formula = formula.ok_or_else(|| format!("{name} has no dispersion formula of 1..13"))? as u8;
            *open = Some(Draft { line, name, formula, c: None, range: None, absorption: Vec::new() });
        }
        "CD" | "LD" => {
            // After an entry that is not used there is no open glass.
            let Some(draft) = open.as_mut() else { return Ok(()) };
            let values: Option<Vec<f64>> = words.map(number).collect();
            let values =
                values.ok_or_else(|| format!("{key} of {} has a value that is not a number", draft.name))?;
            match (key, &values[..]) {
                ("CD", _) => draft.c = Some(values),
                (_, [a, b, ..]) if *a > 0.0 && b >= a => draft.range = Some((*a, *b)),
                _ => return Err(format!("LD of {} is not an ascending range of µm", draft.name)),
            }
        }
        "IT" => {
            let Some(draft) = open.as_mut() else { return Ok(()) };
            let values: Option<Vec<f64>> = words.map(number).collect();
            // Records without a thickness are place holders; a glass without any other is one of unknown absorption.
            if let Some([um, transmittance, thickness_mm, ..]) = values.as_deref()
                && *um > 0.0
                && (0.0..=1.0).contains(transmittance)
                && *thickness_mm > 0.0
            {
                draft.absorption.push(Absorption::entry(*um, *transmittance, *thickness_mm));
            }
        }
        _ if SKIPPED.contains(&key) || open.is_none() => {}
        _ => return Err(format!("`{key}` is not a keyword of the AGF format")),
    }
    Ok(())
}

/// The text of a catalogue.
///
/// # Errors
/// [`LensFileError::Catalogue`] for a glass whose formula the format does not have.
pub fn write(catalogue: &GlassCatalog) -> Result<String, LensFileError> {
    let mut text = String::new();
    for (i, glass) in catalogue.glasses().iter().enumerate() {
        let Some((formula, coefficients)) = glass.dispersion.agf_formula() else {
            let problem = format!(
                "the AGF format has no formula for glass {}, a table of more than four indices",
                glass.name
            );
            return Err(LensFileError::Catalogue { line: i + 1, problem });
        };
        let [f, d, c, _] = LINES_UM.map(|um| glass.dispersion.index(um));
        let name = written_name(glass);
        let values: Vec<String> = coefficients.iter().map(|c| decimal(*c)).collect();
        text += &format!("NM {name} {formula} 0 {d:.6} {:.4} 0\n", (d - 1.0) / (f - c));
        text += &format!("CD {}\n", values.join(" "));
        text += &format!("LD {} {}\n", decimal(glass.range_um.0), decimal(glass.range_um.1));
    }
    Ok(text)
}

/// The name of a glass in the text of a catalogue: one word.
pub(super) fn written_name(glass: &Glass) -> String {
    glass.name.chars().map(|c| if c.is_whitespace() { '_' } else { c }).collect()
}

struct Draft {
    line: usize,
    name: String,
    formula: u8,
    c: Option<Vec<f64>>,
    range: Option<(f64, f64)>,
    absorption: Vec<(f64, f64)>,
}

impl Draft {
    fn finish(self, catalog: &mut GlassCatalog) -> Result<(), LensFileError> {
        let bad = |problem: String| LensFileError::Catalogue { line: self.line, problem };
        let c = self.c.as_ref().ok_or_else(|| bad(format!("{} has no coefficients (CD)", self.name)))?;
        let range_um =
            self.range.ok_or_else(|| bad(format!("{} has no wavelength range (LD)", self.name)))?;
        let dispersion = Dispersion::new(self.formula, c).map_err(|p| bad(format!("{}: {p}", self.name)))?;
        let absorption = Absorption::new(self.absorption);
        catalog.add(Glass { absorption, ..Glass::new(self.name, dispersion, range_um) });
        Ok(())
    }
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
        let per_mm = c.get("N-BK7").unwrap().absorption.as_ref().unwrap().per_mm(0.3);
        assert!((per_mm - -f64::ln(0.05) / 25.0).abs() < 1e-12);
        assert!(c.get("OLD").unwrap().absorption.is_none());
    }

    #[test]
    fn wrong_line_is_an_error_with_its_number() {
        for (from, to, line) in
            [("LD 0.4 0.7", "LD 0.7", 11), ("CD 2.25", "CD x", 10), ("OLD 1", "OLD 14", 9), ("IT", "QQ", 8)]
        {
            let e = parse(TWO.replace(from, to).as_bytes()).unwrap_err();
            assert!(matches!(e, LensFileError::Catalogue { line: l, .. } if l == line), "{e}");
        }
        assert!(parse(b"").is_err());
        // A text line and a bad glass leave the others usable.
        let (catalog, problems) =
            parse_usable(TWO.replace("IT", "!The text").replace("LD 0.4", "LD 0 0").as_bytes());
        assert_eq!((catalog.glasses().len(), problems.len()), (1, 2));
        let (catalog, problems) = parse_usable(TWO.replace("LD 0.4", "LD 0 0").as_bytes());
        assert_eq!((catalog.glasses().len(), problems.len()), (1, 1));
    }
}
