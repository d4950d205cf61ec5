//! Glasses by name: the user's catalogues, the catalogues that a design names, the built-in table.
//!
//! A name alone is not unique (F2, SF5 and some fifty others belong to several makers), so [`GlassLibrary::find`] looks in this order:
//! 1. the catalogues that the design names (`GCAT`), in its order: the user's of that name, else the built-in maker of that name;
//! 2. the user's other catalogues, in the order given;
//! 3. crystals, plastics and liquids of the built-in table, then its makers;
//! 4. glass codes ([`model_glass`](super::model_glass));
//! 5. the built-in list of old names (of a maker that the design names: before 3), by a documented equivalent or by the old glass's own n_d and V_d.
//!
//! What is not certain comes back as a note for the user: a maker that the design does not name, an equivalent with its Δn_d and ΔV_d.
//!
//! Built-in table: 1,888 glasses of the refractiveindex.info database and 698 more of makers' catalogues (`data/SOURCES.md`).

use super::error::DesignError;
use super::glass::{Dispersion, Glass, GlassCatalog};
use super::model_glass::{LINES_UM, glass_code, model_glass};
use crate::words::edit_distance;
use std::sync::LazyLock;

/// Makers of the built-in table in the order in which a name without catalogue is looked up.
const MAKERS: [&str; 16] = [
    "MISC",
    "SCHOTT",
    "OHARA",
    "HOYA",
    "HIKARI",
    "CDGM",
    "SUMITA",
    "LZOS",
    "CORNING",
    "AMI",
    "BARBERINI",
    "CARGILLE",
    "VITRON",
    "LIGHTPATH",
    "NHG",
    "RPO",
];

struct Row {
    maker: &'static str,
    aliases: &'static str,
    glass: Glass,
}

struct Equivalent {
    old_maker: &'static str,
    old_name: &'static str,
    maker: &'static str,
    name: &'static str,
    relation: &'static str,
    /// n_d and V_d of the old glass.
    old: Option<(f64, f64)>,
    differences: Option<(f64, f64)>,
}

static ROWS: LazyLock<Vec<Row>> = LazyLock::new(|| {
    let row = |line: &'static str| {
        let mut cells = line.split(',');
        let mut next = || cells.next().unwrap_or_default();
        let (maker, name, aliases) = (next(), next(), next());
        let formula = next().parse().expect("the built-in table holds formula numbers");
        let number = |s: &str| s.parse::<f64>().expect("the built-in table holds numbers");
        let coefficients: Vec<f64> = next().split(' ').map(number).collect();
        let range_um = (number(next()), number(next()));
        let dispersion =
            Dispersion::new(formula, &coefficients).expect("the built-in table holds known formulas");
        Row { maker, aliases, glass: Glass::new(name.to_owned(), dispersion, range_um) }
    };
    let tables =
        [include_str!("../../../data/glasses.csv"), include_str!("../../../data/glasses-of-makers.csv")];
    tables.into_iter().flat_map(|table| table.lines().skip(1)).map(row).collect()
});

static EQUIVALENTS: LazyLock<Vec<Equivalent>> = LazyLock::new(|| {
    let row = |line: &'static str| {
        let mut cells = line.split(',');
        let mut next = || cells.next().unwrap_or_default();
        let [old_maker, old_name, maker, name, relation] = [(); 5].map(|()| next());
        let mut pair = || next().parse().ok().zip(next().parse().ok());
        let (old, differences) = (pair(), pair());
        Equivalent { old_maker, old_name, maker, name, relation, old, differences }
    };
    include_str!("../../../data/glass-equivalents.csv").lines().skip(1).map(row).collect()
});

impl Row {
    /// Whether `name` is the glass's name, one of its aliases, or one with the maker before or behind it. `name` is in upper case.
    fn is_called(&self, name: &str) -> bool {
        if self.glass.name == name || self.aliases.split(';').any(|a| a == name) {
            return true;
        }
        let maker = self.maker;
        let bare = name
            .strip_prefix(maker)
            .and_then(|n| n.strip_prefix('_'))
            .or_else(|| name.strip_suffix(maker).and_then(|n| n.strip_suffix('_')));
        bare.is_some_and(|n| n == self.glass.name || n == self.glass.name.replace('-', ""))
    }
}

/// Catalogues to look glasses up in.
#[derive(Clone, Debug, Default)]
pub struct GlassLibrary {
    /// The user's, by upper-case name.
    catalogues: Vec<(String, GlassCatalog)>,
}

impl GlassLibrary {
    /// The built-in table alone.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a catalogue of the user's; `name` as designs name it (`SCHOTT`).
    pub fn add(&mut self, name: &str, catalogue: GlassCatalog) {
        self.catalogues.push((name.to_ascii_uppercase(), catalogue));
    }

    /// The glass of that name, letter case aside, for a design that names the catalogues `preferred`; and what the user should know of
    /// the choice.
    ///
    /// # Errors
    /// [`DesignError::UnknownGlass`] with the nearest names.
    pub fn find(&self, name: &str, preferred: &[String]) -> Result<(Glass, Option<String>), DesignError> {
        let upper = name.to_ascii_uppercase();
        for catalogue in preferred.iter().map(|c| c.to_ascii_uppercase()) {
            let users = self.catalogues.iter().filter(|(n, _)| *n == catalogue);
            if let Some(glass) = users.filter_map(|(_, c)| c.get(&upper)).next() {
                return Ok((glass.clone(), None));
            }
            if let Some(row) = maker_of(&catalogue).and_then(|maker| builtin(maker, &upper)) {
                return Ok((row.glass.clone(), None));
            }
        }
        if let Some(glass) = self.catalogues.iter().find_map(|(_, c)| c.get(&upper)) {
            return Ok((glass.clone(), None));
        }
        // An old glass of a maker that the design names comes before another maker's glass of that name.
        if let Some(found) = equivalent(name, &upper, preferred, true) {
            return found;
        }
        let found: Vec<&Row> = MAKERS.iter().filter_map(|maker| builtin(maker, &upper)).collect();
        if let Some(first) = found.first() {
            return Ok((first.glass.clone(), choice_note(name, &found, preferred)));
        }
        if let Some((n_d, v_d)) = glass_code(name) {
            let glass = model_glass(name, n_d, v_d, 0.0)?;
            return Ok((glass, Some(format!("glass code {name}: model glass of n_d = {n_d}, V_d = {v_d}"))));
        }
        equivalent(name, &upper, preferred, false).unwrap_or_else(|| Err(self.unknown(name, &upper)))
    }

    fn unknown(&self, name: &str, upper: &str) -> DesignError {
        let users = self.catalogues.iter().flat_map(|(_, c)| c.glasses()).map(|g| g.name.as_str());
        let mut by_distance: Vec<(usize, &str)> = ROWS
            .iter()
            .map(|r| r.glass.name.as_str())
            .chain(users)
            .map(|known| (distance(upper, &known.to_ascii_uppercase()), known))
            .filter(|(distance, _)| *distance <= 2)
            .collect();
        by_distance.sort();
        by_distance.dedup();
        let nearest = by_distance.iter().take(3).map(|(_, n)| (*n).to_owned()).collect();
        DesignError::UnknownGlass { name: name.to_owned(), nearest }
    }
}

/// The built-in maker that a design program's catalogue name means (`SCHOTT_2000`, `NIKON-HIKARI`, `INFRARED`).
fn maker_of(catalogue: &str) -> Option<&'static str> {
    const ALSO_MISC: [&str; 11] = [
        "INFRARED",
        "PLASTIC",
        "BIREFRINGENT",
        "CRYSTAL",
        "LIQUID",
        "ZEON",
        "ARTON",
        "TOPAS",
        "HERAEUS",
        "ISUZU",
        "OSAKA",
    ];
    if ALSO_MISC.iter().any(|n| catalogue.starts_with(n)) {
        return Some("MISC");
    }
    if catalogue.starts_with("NIKON") {
        return Some("HIKARI");
    }
    MAKERS.into_iter().find(|maker| catalogue.starts_with(maker))
}

/// The maker of a built-in glass; none for another glass.
pub fn maker_of_glass(glass: &Glass) -> Option<&'static str> {
    maker_and_name(glass).map(|(maker, _)| maker)
}

/// Maker of a built-in glass and its name there; none for another glass.
pub(super) fn maker_and_name(glass: &Glass) -> Option<(&'static str, &'static str)> {
    let is_it = |row: &&Row| {
        row.glass.name == glass.name
            && row.glass.range_um == glass.range_um
            && row.glass.dispersion == glass.dispersion
    };
    ROWS.iter().find(is_it).map(|row| (row.maker, row.glass.name.as_str()))
}

fn builtin(maker: &str, upper: &str) -> Option<&'static Row> {
    ROWS.iter().find(|row| row.maker == maker && row.is_called(upper))
}

/// What to say of a built-in glass whose maker the design does not name; nothing if the name is unique or names its maker.
fn choice_note(name: &str, found: &[&Row], preferred: &[String]) -> Option<String> {
    let (first, others) = found.split_first()?;
    let differs = |other: &&&Row| {
        let apart = |um| (other.glass.dispersion.index(um) - first.glass.dispersion.index(um)).abs();
        LINES_UM.into_iter().any(|um| apart(um) > 1e-6)
    };
    let others: Vec<&str> = others.iter().filter(differs).map(|row| row.maker).collect();
    let several =
        if others.is_empty() { String::new() } else { format!("; {} has another one", others.join(", ")) };
    match (preferred.is_empty(), several.is_empty()) {
        (true, true) => None,
        (true, false) => Some(format!("glass {name}: taken from {}{several}", first.maker)),
        (false, _) => Some(format!(
            "glass {name}: taken from {}, it is not in the design's catalogues ({}){several}",
            first.maker,
            preferred.join(", ")
        )),
    }
}

/// The glass that stands for an old name.
fn equivalent(
    name: &str,
    upper: &str,
    preferred: &[String],
    of_named_makers: bool,
) -> Option<Result<(Glass, Option<String>), DesignError>> {
    let makers: Vec<&str> = preferred.iter().filter_map(|c| maker_of(&c.to_ascii_uppercase())).collect();
    let is_it = |e: &&Equivalent| {
        let (maker, old) = (e.old_maker, e.old_name);
        upper == old || upper == format!("{maker}_{old}") || upper == format!("{old}_{maker}")
    };
    let rank = |e: &&Equivalent| makers.iter().position(|m| *m == e.old_maker).unwrap_or(makers.len());
    let found = EQUIVALENTS.iter().filter(is_it).min_by_key(rank)?;
    if of_named_makers && !makers.contains(&found.old_maker) {
        return None;
    }
    let (maker, relation) = (found.old_maker, found.relation);
    if let Some(row) = builtin(found.maker, found.name) {
        let differences = found.differences.map_or_else(
            || "n_d and V_d of the old glass are not known".to_owned(),
            |(n, v)| format!("Δn_d = {n:+.5}, ΔV_d = {v:+.2}"),
        );
        let note = format!(
            "glass {name} ({maker}): {} of {} is used, {relation}; {differences}",
            found.name, found.maker
        );
        return Some(Ok((row.glass.clone(), Some(note))));
    }
    let (n, v) = found.old?;
    let note = format!("glass {name} ({maker}): a model glass of its n_d = {n}, V_d = {v} is used");
    Some(model_glass(name, n, v, 0.0).map(|glass| (glass, Some(note))))
}

/// Edits between two names; a leading `N-` (lead-free successor) costs one.
fn distance(a: &str, b: &str) -> usize {
    let plain = |s: &str| s.strip_prefix("N-").map_or(s.to_owned(), str::to_owned);
    let (p, q) = (plain(a), plain(b));
    let successor = usize::from(a.starts_with("N-") != b.starts_with("N-"));
    edit_distance(a, b).min(edit_distance(&p, &q) + successor)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn n_d(name: &str, preferred: &[&str]) -> (f64, Option<String>) {
        let preferred: Vec<String> = preferred.iter().map(|s| (*s).to_owned()).collect();
        let (glass, note) = GlassLibrary::new().find(name, &preferred).unwrap_or_else(|e| panic!("{e}"));
        (glass.dispersion.index(LINES_UM[1]), note)
    }

    #[test]
    fn builtin_indices_match_the_design_program() {
        // Indices that the design program prints for its sample lens at 0.5876 µm.
        for (name, n) in [("N-SK2", 1.607_378_858_6), ("n-sk16", 1.620_407_933_1), ("F5", 1.603_417_178_2)] {
            let (glass, _) = GlassLibrary::new().find(name, &["SCHOTT".to_owned()]).unwrap();
            let got = glass.index(0.587_6).unwrap();
            assert!((got - n).abs() < 2e-9, "{name}: {got} against {n}");
            assert!(glass.index(5.0).is_err());
        }
    }

    #[test]
    fn every_builtin_row_has_a_finite_index_in_its_range() {
        assert_eq!(ROWS.len(), 2586);
        for row in ROWS.iter() {
            let (first, last) = row.glass.range_um;
            for um in [first, (first * last).sqrt(), last] {
                let n = row.glass.dispersion.index(um);
                assert!((1.0..7.0).contains(&n), "{} {}: n({um}) = {n}", row.maker, row.glass.name);
            }
            assert!(MAKERS.contains(&row.maker), "{}", row.maker);
        }
        assert!(EQUIVALENTS.iter().all(|e| e.old.is_some() || builtin(e.maker, e.name).is_some()));
    }

    #[test]
    fn names_of_several_makers_follow_the_designs_catalogues() {
        let (schott, none) = n_d("F2", &["SCHOTT"]);
        let (cdgm, _) = n_d("F2", &["CDGM", "SCHOTT"]);
        assert!(none.is_none() && (schott - 1.620_04).abs() < 1e-5 && (cdgm - schott).abs() > 1e-3);
        let (_, note) = n_d("F2", &[]);
        assert!(note.unwrap().contains("CDGM"));
        // Another maker has a glass of this name.
        let (_, note) = n_d("SK16", &["SCHOTT"]);
        assert!(note.unwrap().contains("N-SK16"));
        let (_, note) = n_d("S-BSL7", &["SCHOTT"]);
        assert!(note.unwrap().contains("taken from OHARA"));
    }

    #[test]
    fn prefixes_suffixes_and_missing_hyphens_are_understood() {
        for name in ["N-BK7", "NBK7", "SCHOTT_N-BK7", "N-BK7_SCHOTT", "NBK7_SCHOTT", "nbk7_schott"] {
            assert!((n_d(name, &[]).0 - 1.516_800).abs() < 1e-6, "{name}");
        }
        assert!(
            (n_d("PMMA", &[]).0 - 1.492).abs() < 2e-3 && (n_d("SILICA", &["MISC"]).0 - 1.458_46).abs() < 1e-5
        );
    }

    #[test]
    fn old_names_give_an_equivalent_and_a_note() {
        let (n, note) = n_d("BK7", &["SCHOTT"]);
        let note = note.unwrap();
        assert!((n - 1.516_80).abs() < 1e-5 && note.contains("N-BK7") && note.contains("ΔV_d"), "{note}");
        let (n, note) = n_d("BAF12", &[]);
        assert!((n - 1.639_30).abs() < 1e-5 && note.unwrap().contains("model glass"));
    }

    #[test]
    fn unknown_glass_names_its_neighbours() {
        let error = |name| GlassLibrary::new().find(name, &[]).unwrap_err();
        let DesignError::UnknownGlass { nearest, .. } = error("N-SK22") else { panic!() };
        assert!(nearest.contains(&"N-SK2".to_owned()), "{nearest:?}");
        assert!(
            matches!(error("no such glass at all"), DesignError::UnknownGlass { nearest, .. } if nearest.is_empty())
        );
    }

    #[test]
    fn users_catalogue_of_the_named_maker_precedes_the_builtin_one() {
        let mut catalogue = GlassCatalog::default();
        let dispersion = Dispersion::constant(1.7);
        catalogue.add(Glass::new("N-BK7".into(), dispersion, (0.3, 1.0)));
        let mut library = GlassLibrary::new();
        library.add("special", catalogue);
        let index = |preferred: &[&str]| {
            let preferred: Vec<String> = preferred.iter().map(|s| (*s).to_owned()).collect();
            library.find("N-BK7", &preferred).unwrap().0.dispersion.index(0.55)
        };
        assert!((index(&["SPECIAL", "SCHOTT"]) - 1.7).abs() < 1e-12 && (index(&[]) - 1.7).abs() < 1e-12);
        assert!(index(&["SCHOTT", "SPECIAL"]) < 1.6);
    }
}
