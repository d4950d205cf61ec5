//! Glasses: refractive index against wavelength.
//!
//! ```text
//! n(λ), λ in µm, relative to air at 20 °C and 1 atm, as in glass makers' catalogues
//! ```
//! The thirteen dispersion formulas of the AGF catalogue format by number: 1 Schott, 2/6/11 Sellmeier of 3/4/5
//! terms, 3 Herzberger, 4 Sellmeier 2, 5 Conrady, 7/8 Handbook of Optics, 9 Sellmeier 4, 10/12/13 extended power series.
//! Source: the format as described in glass makers' catalogues; Schott's technical note TIE-29 for Sellmeier 1.
//! Beside them 14 n = C1 + Σ C2i·λ^C2i+1 (Cauchy) and 15 n² − 1 = C1 + Σ C2i·λ²/(λ² − C2i+1²) of the built-in table. 16 is a table of
//! (λ, n): the polynomial of third degree in λ⁻² through the four entries nearest in λ⁻² (fewer, of a lower degree, in a shorter table). Left out: temperature, pressure, absorption, birefringence.

use super::absorption::Absorption;
use super::error::DesignError;
use crate::real;

/// A dispersion formula with its coefficients, λ in µm.
#[derive(Clone, Debug, PartialEq)]
pub struct Dispersion {
    formula: u8,
    c: Vec<f64>,
}

/// Number of the tables of indices.
const TABLE: u8 = 16;

/// Number of coefficients of each formula (0 is unused).
const COEFFICIENT_COUNTS: [usize; 16] = [0, 6, 6, 6, 5, 3, 8, 4, 4, 5, 8, 10, 8, 9, 17, 17];

impl Dispersion {
    /// Formula `number` (1..=15) with its coefficients in the catalogue's order; missing trailing ones are 0.
    ///
    /// # Errors
    /// A message, if there is no such formula or a coefficient is not finite.
    pub fn new(number: u8, coefficients: &[f64]) -> Result<Self, String> {
        let needed = match COEFFICIENT_COUNTS.get(usize::from(number)) {
            Some(&n) if n > 0 => n,
            _ => return Err(format!("dispersion formula {number} is not one of 1..15")),
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

    /// A table of (λ in µm, index), interpolated.
    ///
    /// # Errors
    /// A message, if a wavelength or index is not positive or a wavelength occurs twice.
    pub fn table(points: &[(f64, f64)]) -> Result<Self, String> {
        let mut points = points.to_vec();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        if points.is_empty()
            || points.iter().any(|p| !(p.0 > 0.0 && p.0.is_finite() && p.1 > 0.0 && p.1.is_finite()))
        {
            return Err("a wavelength or index of a table is not a positive number".to_owned());
        }
        if let Some(pair) = points.windows(2).find(|p| p[0].0 == p[1].0) {
            return Err(format!("{} µm occurs twice in a table of indices", pair[0].0));
        }
        Ok(Self { formula: TABLE, c: points.into_iter().flat_map(|(um, n)| [um, n]).collect() })
    }

    /// Number of the formula of the AGF format and its coefficients: 10 for a table of up to four entries, whose polynomial is squared; none for a
    /// longer table and the formulas of the built-in table.
    pub fn agf_formula(&self) -> Option<(u8, Vec<f64>)> {
        match self.formula {
            1..14 => Some((self.formula, self.c.clone())),
            TABLE if self.c.len() <= 8 => Some((10, squared_polynomial(&self.c))),
            _ => None,
        }
    }

    /// The index at `um`; NaN where the formula is not defined.
    pub fn index(&self, um: f64) -> f64 {
        let c = &self.c;
        if self.formula == TABLE {
            return interpolated(c, um);
        }
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
            13 => powers(&[1, 2, -1, -2, -3, -4, -5, -6]),
            14 => return c[0] + c[1..].chunks_exact(2).map(|p| p[0] * real::pow(um, p[1])).sum::<f64>(),
            _ => 1.0 + c[0] + c[1..].chunks_exact(2).map(|p| p[0] * w / (w - p[1] * p[1])).sum::<f64>(),
        };
        squared.sqrt()
    }
}

/// Lagrange's polynomial in λ⁻² through the four entries of `table` nearest to `um`; `table` is λ, n, λ, n, …, λ ascending.
fn interpolated(table: &[f64], um: f64) -> f64 {
    let points: Vec<(f64, f64)> = table.chunks_exact(2).map(|p| (1.0 / (p[0] * p[0]), p[1])).collect();
    let x = 1.0 / (um * um);
    let distance = |p: &(f64, f64)| (p.0 - x).abs();
    let after = points.partition_point(|p| p.0 > x);
    let (mut first, mut last) = (after, after);
    while last - first < points.len().min(4) {
        let takes_lower =
            first > 0 && (last == points.len() || distance(&points[first - 1]) <= distance(&points[last]));
        if takes_lower { first -= 1 } else { last += 1 }
    }
    let near = &points[first..last];
    let weight = |i: usize| {
        let others = near.iter().enumerate().filter(|(k, _)| *k != i);
        others.map(|(_, p)| (x - p.0) / (near[i].0 - p.0)).product::<f64>()
    };
    near.iter().enumerate().map(|(i, p)| p.1 * weight(i)).sum()
}

/// Coefficients of formula 10 for the square of the polynomial in λ⁻² through the entries of `table` (λ, n, λ, n, …), up to four.
fn squared_polynomial(table: &[f64]) -> Vec<f64> {
    let points: Vec<(f64, f64)> = table.chunks_exact(2).map(|p| (1.0 / (p[0] * p[0]), p[1])).collect();
    let mut n = [0.0; 4];
    for (i, (x, y)) in points.iter().enumerate() {
        // y Π (x − x_k) / (x_i − x_k), expanded.
        let mut term = vec![*y];
        for (_, (other, _)) in points.iter().enumerate().filter(|(k, _)| *k != i) {
            term.push(0.0);
            for j in (0..term.len()).rev() {
                let lower = if j > 0 { term[j - 1] } else { 0.0 };
                term[j] = (lower - other * term[j]) / (x - other);
            }
        }
        n.iter_mut().zip(term).for_each(|(sum, t)| *sum += t);
    }
    // n² by power of λ⁻²; the second coefficient of formula 10 is that of λ².
    let mut c = vec![0.0; 8];
    for (i, a) in n.iter().enumerate() {
        for (j, b) in n.iter().enumerate() {
            c[if i + j == 0 { 0 } else { i + j + 1 }] += a * b;
        }
    }
    c
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
    /// Absorption that its catalogue states.
    pub absorption: Option<Absorption>,
}

impl Glass {
    /// A glass of which the absorption is not known.
    pub fn new(name: String, dispersion: Dispersion, range_um: (f64, f64)) -> Self {
        Self { name, dispersion, range_um, absorption: None }
    }

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
    /// Adds a glass, which replaces one of the same name: a user's catalogue overrides the built-in table.
    pub fn add(&mut self, glass: Glass) {
        self.glasses.retain(|g| !g.name.eq_ignore_ascii_case(&glass.name));
        self.glasses.push(glass);
    }

    /// The glasses.
    pub fn glasses(&self) -> &[Glass] {
        &self.glasses
    }

    /// The glass of that name, ignoring case.
    pub fn get(&self, name: &str) -> Option<&Glass> {
        self.glasses.iter().find(|g| g.name.eq_ignore_ascii_case(name))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_table_is_an_exact_formula() {
        let entries = [(0.4047, 1.53024), (0.4861, 1.52237), (0.5876, 1.5168), (0.6563, 1.51432)];
        for count in 1..=4 {
            let table = Dispersion::table(&entries[..count]).unwrap();
            let (formula, c) = table.agf_formula().unwrap();
            let written = Dispersion::new(formula, &c).unwrap();
            for um in [0.4047, 0.45, 0.55, 0.6563] {
                let apart = written.index(um) - table.index(um);
                assert!(apart.abs() < 1e-12, "{count} entries, {um} µm: {apart:e}");
            }
        }
        let five = [entries.to_vec(), vec![(0.7, 1.51)]].concat();
        assert!(Dispersion::table(&five).unwrap().agf_formula().is_none());
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
        assert!(Dispersion::new(0, &[]).is_err() && Dispersion::new(16, &[]).is_err());
    }
}
