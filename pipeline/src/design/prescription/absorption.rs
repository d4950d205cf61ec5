//! Absorption in glass: the share of the light that is left after a path.
//!
//! ```text
//! τ(path) = e^(−α path),    α(λ) = −ln τ_i / t [1/mm] of a catalogue's internal transmittance τ_i of a plate t thick
//! ```
//! α is linear in λ between entries and has the end values beyond them. The catalogue that a design names comes first, then the built-in table
//! (`data/glass-absorption.csv`: α = 4πk/λ of the refractiveindex.info database); a glass that neither has is taken as clear.

use super::glass::Glass;
use super::glass_library::maker_and_name;
use std::collections::HashMap;
use std::sync::LazyLock;

/// Least transmittance that is told from 0: an entry of 0 means "opaque at this thickness".
const LEAST_TRANSMITTANCE: f64 = 1e-10;

/// Absorption of a glass: wavelength in µm, ascending; α in 1/mm.
#[derive(Clone, Debug, PartialEq)]
pub struct Absorption(Vec<(f64, f64)>);

impl Absorption {
    /// From entries of wavelength in µm and α in 1/mm, in any order; none without entries.
    pub fn new(mut entries: Vec<(f64, f64)>) -> Option<Self> {
        entries.sort_by(|a, b| a.0.total_cmp(&b.0));
        entries.dedup_by(|a, b| a.0 == b.0);
        (!entries.is_empty()).then_some(Self(entries))
    }

    /// An entry from the internal transmittance of a plate: wavelength in µm, transmittance, thickness in mm.
    pub fn entry(um: f64, transmittance: f64, thickness_mm: f64) -> (f64, f64) {
        (um, -log(transmittance.clamp(LEAST_TRANSMITTANCE, 1.0)) / thickness_mm)
    }

    /// α at `um`, 1/mm.
    pub fn per_mm(&self, um: f64) -> f64 {
        let entries = &self.0;
        let i = entries.partition_point(|e| e.0 <= um);
        match i {
            0 => entries[0].1,
            _ if i == entries.len() => entries[i - 1].1,
            _ => {
                let ((a, low), (b, high)) = (entries[i - 1], entries[i]);
                low + (um - a) / (b - a) * (high - low)
            }
        }
    }

    /// That of the built-in table for a glass of the built-in catalogues; none if it has none.
    pub fn builtin(glass: &Glass) -> Option<Self> {
        static ROWS: LazyLock<HashMap<(&str, &str), &str>> = LazyLock::new(|| {
            let rows = include_str!("../../../data/glass-absorption.csv").lines().skip(1);
            let row = |line: &'static str| {
                let (maker, rest) = line.split_once(',')?;
                let (name, entries) = rest.split_once(',')?;
                Some(((maker, name), entries))
            };
            rows.filter_map(row).collect()
        });
        let (maker, name) = maker_and_name(glass)?;
        let number = |s: &str| s.parse().expect("the built-in table holds numbers");
        let entry = |word: &str| word.split_once(':').map(|(um, alpha)| (number(um), number(alpha)));
        Self::new(ROWS.get(&(maker, name))?.split(' ').filter_map(entry).collect())
    }
}

/// Natural logarithm with the same bits on every machine.
fn log(v: f64) -> f64 {
    libm::log(v)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::prescription::glass_library::GlassLibrary;
    use crate::real;

    #[test]
    fn plate_of_the_catalogue_keeps_its_transmittance() {
        let glass =
            Absorption::new(vec![Absorption::entry(0.5, 0.9, 25.0), Absorption::entry(0.4, 0.5, 10.0)]);
        let glass = glass.unwrap();
        assert!((real::exp(-glass.per_mm(0.5) * 25.0) - 0.9).abs() < 1e-12);
        assert!((real::exp(-glass.per_mm(0.4) * 10.0) - 0.5).abs() < 1e-12);
        assert_eq!(glass.per_mm(0.3), glass.per_mm(0.4));
        assert_eq!(glass.per_mm(0.45), 0.5 * (glass.per_mm(0.4) + glass.per_mm(0.5)));
        assert!(Absorption::entry(0.4, 0.0, 10.0).1.is_finite());
    }

    /// N-BK7, 10 mm at 400 nm: 0.997 in Schott's catalogue; SF5 absorbs more in the blue.
    #[test]
    fn builtin_glasses_have_their_makers_figures() {
        let find = |name: &str| GlassLibrary::new().find(name, &["SCHOTT".to_owned()]).unwrap().0;
        let transmittance =
            |name: &str, um: f64| real::exp(-10.0 * Absorption::builtin(&find(name)).unwrap().per_mm(um));
        let bk7 = transmittance("N-BK7", 0.4);
        assert!((bk7 - 0.997).abs() < 1e-3, "{bk7}");
        assert!(transmittance("SF6", 0.4) < 0.95 && transmittance("SF6", 0.7) > 0.99);
    }
}
