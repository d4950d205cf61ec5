//! Glasses: refractive index against wavelength.
//!
//!     n(λ), λ in µm, relative to air at 20 °C and 1 atm, as in glass makers' catalogues
//! The thirteen dispersion formulas of the AGF catalogue format by number: 1 Schott, 2/6/11 Sellmeier of 3/4/5
//! terms, 3 Herzberger, 4 Sellmeier 2, 5 Conrady, 7/8 Handbook of Optics, 9 Sellmeier 4, 10/12/13 extended power series.
//! Source: the format as described in glass makers' catalogues; Schott's technical note TIE-29 for Sellmeier 1.
//! Built in: Schott's Sellmeier table (`data/SOURCES.md`). Left out: temperature, pressure, absorption, birefringence.

use super::error::DesignError;
use crate::real;
use crate::words::edit_distance;

/// A dispersion formula with its coefficients, λ in µm.
#[derive(Clone, Debug, PartialEq)]
pub struct Dispersion {
    formula: u8,
    c: Vec<f64>,
}

/// Number of coefficients of each formula (0 is unused).
const COEFFICIENT_COUNTS: [usize; 14] = [0, 6, 6, 6, 5, 3, 8, 4, 4, 5, 8, 10, 8, 9];

impl Dispersion {
    /// Formula `number` (1..=13) with its coefficients in the catalogue's order; missing trailing ones are 0.
    ///
    /// # Errors
    /// A message, if there is no such formula or a coefficient is not finite.
    pub fn new(number: u8, coefficients: &[f64]) -> Result<Self, String> {
        let needed = match COEFFICIENT_COUNTS.get(usize::from(number)) {
            Some(&n) if n > 0 => n,
            _ => return Err(format!("dispersion formula {number} is not one of 1..13")),
        };
        if let Some(bad) = coefficients.iter().find(|c| !c.is_finite()) {
            return Err(format!("a dispersion coefficient is {bad}"));
        }
        let mut c: Vec<f64> = coefficients.iter().copied().take(needed).collect();
        c.resize(needed, 0.0);
        Ok(Self { formula: number, c })
    }

    /// A medium without dispersion.
    pub fn constant(n: f64) -> Self {
        Self { formula: 1, c: vec![n * n, 0.0, 0.0, 0.0, 0.0, 0.0] }
    }

    /// The index at `um`; NaN where the formula is not defined.
    pub fn index(&self, um: f64) -> f64 {
        let c = &self.c;
        let w = um * um;
        let sellmeier =
            |terms: usize| 1.0 + (0..terms).map(|i| c[2 * i] * w / (w - c[2 * i + 1])).sum::<f64>();
        // Even powers of λ: the first coefficient is the constant.
        let powers = |p: &[i32]| c[0] + p.iter().zip(&c[1..]).map(|(&e, a)| a * w.powi(e)).sum::<f64>();
        let squared = match self.formula {
            1 => powers(&[1, -1, -2, -3, -4]),
            2 => sellmeier(3),
            3 => {
                let l = 1.0 / (w - 0.028);
                return c[0] + c[1] * l + c[2] * l * l + c[3] * w + c[4] * w * w + c[5] * w * w * w;
            }
            4 => 1.0 + c[0] + c[1] * w / (w - c[2] * c[2]) + c[3] / (w - c[4] * c[4]),
            5 => return c[0] + c[1] / um + c[2] / real::pow(um, 3.5),
            6 => sellmeier(4),
            7 => c[0] + c[1] / (w - c[2]) - c[3] * w,
            8 => c[0] + c[1] * w / (w - c[2]) - c[3] * w,
            9 => c[0] + c[1] * w / (w - c[2]) + c[3] * w / (w - c[4]),
            10 => powers(&[1, -1, -2, -3, -4, -5, -6]),
            11 => sellmeier(5),
            12 => powers(&[1, -1, -2, -3, -4, 2, 3]),
            _ => powers(&[1, 2, -1, -2, -3, -4, -5, -6]),
        };
        squared.sqrt()
    }
}

/// A glass of a catalogue.
#[derive(Clone, Debug, PartialEq)]
pub struct Glass {
    /// Name as in its catalogue.
    pub name: String,
    /// Its formula.
    pub dispersion: Dispersion,
    /// Range of wavelengths of the formula, µm.
    pub range_um: (f64, f64),
}

impl Glass {
    /// The index at `um`.
    ///
    /// # Errors
    /// [`DesignError::Wavelength`] outside the glass's range.
    pub fn index(&self, um: f64) -> Result<f64, DesignError> {
        let n = self.dispersion.index(um);
        // Catalogues round their limits to about a nanometre.
        if um < self.range_um.0 - 1e-3 || um > self.range_um.1 + 1e-3 || !(n.is_finite() && n >= 1.0) {
            return Err(DesignError::Wavelength {
                glass: self.name.clone(),
                wavelength_um: um,
                first_um: self.range_um.0,
                last_um: self.range_um.1,
            });
        }
        Ok(n)
    }
}

/// Glasses by name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GlassCatalog {
    glasses: Vec<Glass>,
}

impl GlassCatalog {
    /// The built-in Schott table.
    pub fn schott() -> Self {
        let rows = include_str!("../../data/schott-sellmeier.csv").lines().skip(1);
        let glasses = rows.map(|row| {
            let mut cells = row.split(',');
            let name = cells.next().unwrap_or_default().to_owned();
            let v: Vec<f64> = cells.map(|c| c.parse().expect("the built-in table has numbers")).collect();
            let c = [v[0], v[3], v[1], v[4], v[2], v[5]];
            let dispersion = Dispersion::new(2, &c).expect("the built-in table is finite");
            Glass { name, dispersion, range_um: (v[6], v[7]) }
        });
        Self { glasses: glasses.collect() }
    }

    /// Adds a glass, which replaces one of the same name: a user's catalogue overrides the built-in table.
    pub fn add(&mut self, glass: Glass) {
        self.glasses.retain(|g| !g.name.eq_ignore_ascii_case(&glass.name));
        self.glasses.push(glass);
    }

    /// Adds all glasses of another catalogue.
    pub fn extend(&mut self, other: Self) {
        other.glasses.into_iter().for_each(|g| self.add(g));
    }

    /// The glasses.
    pub fn glasses(&self) -> &[Glass] {
        &self.glasses
    }

    /// The glass of that name, ignoring case.
    ///
    /// # Errors
    /// [`DesignError::UnknownGlass`] with the most similar names.
    pub fn find(&self, name: &str) -> Result<&Glass, DesignError> {
        self.glasses.iter().find(|g| g.name.eq_ignore_ascii_case(name)).ok_or_else(|| {
            let requested = name.to_ascii_uppercase();
            let mut by_distance: Vec<(usize, &str)> = self
                .glasses
                .iter()
                .map(|g| (distance(&requested, &g.name.to_ascii_uppercase()), &*g.name))
                .collect();
            by_distance.sort();
            let nearest = by_distance.iter().take(3).filter(|(d, _)| *d <= 3).map(|(_, n)| (*n).to_owned());
            DesignError::UnknownGlass { name: name.to_owned(), nearest: nearest.collect() }
        })
    }
}

/// Edit distance of two names; a leading `N-` (lead-free successor) counts one.
fn distance(a: &str, b: &str) -> usize {
    let plain = |s: &str| s.strip_prefix("N-").map_or(s.to_owned(), str::to_owned);
    let (p, q) = (plain(a), plain(b));
    let successor = usize::from(a.starts_with("N-") != b.starts_with("N-"));
    edit_distance(a, b).min(edit_distance(&p, &q) + successor)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn schott_indices_match_the_design_program() {
        let c = GlassCatalog::schott();
        // Indices the design program prints for its sample lens at 0.5876 µm.
        for (name, n) in [("N-SK2", 1.607_378_858_6), ("n-sk16", 1.620_407_933_1), ("F5", 1.603_417_178_2)] {
            let got = c.find(name).unwrap().index(0.587_6).unwrap();
            assert!((got - n).abs() < 2e-9, "{name}: {got} against {n}");
        }
        assert!(c.find("F5").unwrap().index(5.0).is_err());
    }

    #[test]
    fn unknown_glass_lists_similar_names() {
        let c = GlassCatalog::schott();
        let Err(DesignError::UnknownGlass { nearest, .. }) = c.find("SK2") else {
            panic!("SK2 is not built in")
        };
        assert!(nearest.contains(&"N-SK2".to_owned()), "{nearest:?}");
        assert!(
            matches!(c.find("no such glass at all"), Err(DesignError::UnknownGlass { nearest, .. }) if nearest.is_empty())
        );
    }

    #[test]
    fn formulas_agree_for_the_same_glass() {
        // The same one-term glass written as Sellmeier 1, 3, 5, 2, 4 and as Handbook 2.
        let (b, cc) = (1.1, 0.012);
        let um: f64 = 0.55;
        let expected = (1.0 + b * um * um / (um * um - cc)).sqrt();
        for (f, c) in [
            (2, vec![b, cc]),
            (6, vec![b, cc]),
            (11, vec![b, cc]),
            (4, vec![0.0, b, f64::sqrt(cc)]),
            (8, vec![1.0, b, cc]),
            (9, vec![1.0, b, cc]),
        ] {
            let n = Dispersion::new(f, &c).unwrap().index(um);
            assert!((n - expected).abs() < 1e-14, "formula {f}: {n}");
        }
        // Power series: each coefficient stands before its own power of λ.
        let w: f64 = 0.55 * 0.55;
        for (f, powers) in [
            (1, vec![0, 1, -1, -2, -3, -4]),
            (10, vec![0, 1, -1, -2, -3, -4, -5, -6]),
            (12, vec![0, 1, -1, -2, -3, -4, 2, 3]),
            (13, vec![0, 1, 2, -1, -2, -3, -4, -5, -6]),
        ] {
            for (i, p) in powers.iter().enumerate() {
                let mut c = vec![0.0; powers.len()];
                c[i] = 2.0;
                let n = Dispersion::new(f, &c).unwrap().index(um);
                assert!((n * n - 2.0 * w.powi(*p)).abs() < 1e-9, "formula {f} coefficient {i}");
            }
        }
        let l = 1.0 / (w - 0.028);
        let h = Dispersion::new(3, &[1.5, 0.01, 0.001, 0.02, 0.003, 0.0004]).unwrap().index(um);
        assert!(
            (h - (1.5 + 0.01 * l + 0.001 * l * l + 0.02 * w + 0.003 * w * w + 0.0004 * w * w * w)).abs()
                < 1e-14
        );
        let conrady = Dispersion::new(5, &[1.5, 0.01, 0.001]).unwrap().index(um);
        assert!((conrady - (1.5 + 0.01 / um + 0.001 / um.powf(3.5))).abs() < 1e-14);
        let handbook = Dispersion::new(7, &[2.3, 0.01, 0.02, 0.03]).unwrap().index(um);
        assert!((handbook - (2.3 + 0.01 / (w - 0.02) - 0.03 * w).sqrt()).abs() < 1e-14);
        assert!(Dispersion::new(0, &[]).is_err() && Dispersion::new(14, &[]).is_err());
    }
}
