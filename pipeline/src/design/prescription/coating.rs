//! Coatings: how much of the light a surface reflects and transmits, for each polarisation.
//!
//! Light of wavelength λ meets a surface between the indices n₁ and n₂ at the cosine c₁ of its angle of incidence; thin films of index N = n + ik
//! (k ≥ 0) and thickness t lie between them, in the order in which the light meets them:
//! ```text
//! cos θ = √(1 − (n₁ sin θ₁ / N)²),   δ = 2π N t cos θ / λ,   η_s = N cos θ,   η_p = N / cos θ
//! M = Π [[cos δ, −i sin δ/η], [−i η sin δ, cos δ]],   [B, C] = M [1, η₂]
//! r = (η₁B − C)/(η₁B + C),   t = 2 √(Re η₁ Re η₂)/(η₁B + C),   R = |r|²,   T = |t|²,   1 − R − T is absorbed
//! ```
//! r is that of the tangential field, t is scaled so that |t|² is the share of the power. Without films these are Fresnel's equations. Films are listed from
//! the side of the lower index: light from the other side meets them in reverse; T is the same from both sides.
//! Where the light is totally reflected no ray is traced. cos δ and sin δ of an absorbing film grow as e^|Im δ|: they are computed without this factor, of which 1/t
//! has the product.
//! Source: Macleod, Thin-Film Optical Filters, 4th ed., chapter 2 (Abelès's characteristic matrices).
//! Left out: interference between surfaces, scatter in the films, birefringence, the phase that a coating adds to a wavefront.

use super::error::{DesignError, tidy};
use crate::real;
use num_complex::Complex64;
use std::f64::consts::PI;

/// A coating of a surface.
#[derive(Clone, Debug, PartialEq)]
pub enum Coating {
    /// None: Fresnel's reflections.
    Bare,
    /// Thin films, from the side of the lower index.
    Films(Vec<Film>),
    /// A reflectance of the same size at all angles; the rest is transmitted.
    Reflectance(Spectrum),
    /// Measured reflectances and transmittances over wavelength and angle.
    Table(CoatingTable),
}

/// A thin film.
#[derive(Clone, Debug, PartialEq)]
pub struct Film {
    /// Its index.
    pub index: FilmIndex,
    /// Thickness, µm.
    pub thickness_um: f64,
}

/// The index n + ik of a film, linear in the wavelength between entries; one entry holds at all wavelengths.
#[derive(Clone, Debug, PartialEq)]
pub struct FilmIndex {
    /// Name of the material.
    pub name: String,
    /// Wavelength in µm, ascending; n; k.
    pub entries: Vec<(f64, f64, f64)>,
}

/// Values over the wavelength, linear between entries; one entry holds at all wavelengths.
#[derive(Clone, Debug, PartialEq)]
pub struct Spectrum {
    /// Name for messages.
    pub name: String,
    /// Wavelength in µm, ascending; value.
    pub entries: Vec<(f64, f64)>,
}

/// Reflectances and transmittances on a grid of wavelengths and angles.
#[derive(Clone, Debug, PartialEq)]
pub struct CoatingTable {
    /// Name for messages.
    pub name: String,
    /// Wavelengths, µm, ascending.
    pub wavelengths_um: Vec<f64>,
    /// Angles in the medium of the lower index, degrees, ascending from 0.
    pub angles_deg: Vec<f64>,
    /// R_s, R_p, T_s, T_p, the angle as the fast index.
    pub values: Vec<[f64; 4]>,
}

/// Amplitudes of the fields s and p that a surface reflects and transmits; |t|² is the share of the power.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Amplitudes {
    /// Reflected, of the tangential field: s, p.
    pub r: [Complex64; 2],
    /// Transmitted: s, p.
    pub t: [Complex64; 2],
}

impl Amplitudes {
    fn of_powers([rs, rp, ts, tp]: [f64; 4], sign: f64) -> Self {
        let r = [rs, rp].map(|v| Complex64::new(sign * v.max(0.0).sqrt(), 0.0));
        Self { r, t: [ts, tp].map(|v| Complex64::new(v.max(0.0).sqrt(), 0.0)) }
    }

    /// Reflectance and transmittance for unpolarised light.
    pub fn powers(&self) -> (f64, f64) {
        let mean = |a: [Complex64; 2]| 0.5 * (a[0].norm_sqr() + a[1].norm_sqr());
        (mean(self.r), mean(self.t))
    }
}

/// A coating at one wavelength.
#[derive(Clone, Debug, PartialEq)]
pub enum CoatingAt {
    /// Films: N, and thickness over wavelength.
    Films(Vec<(Complex64, f64)>),
    /// A reflectance.
    Reflectance(f64),
    /// R_s, R_p, T_s, T_p at angles in degrees.
    Angles(Vec<(f64, [f64; 4])>),
}

impl FilmIndex {
    /// n + ik at `um`.
    ///
    /// # Errors
    /// [`DesignError::Coating`] beyond its entries.
    pub fn at(&self, um: f64) -> Result<Complex64, DesignError> {
        let wavelengths: Vec<f64> = self.entries.iter().map(|e| e.0).collect();
        let (i, share) = place(&self.name, &wavelengths, um)?;
        let mix = |pick: fn(&(f64, f64, f64)) -> f64| mixed(&self.entries, i, share, pick);
        Ok(Complex64::new(mix(|e| e.1), mix(|e| e.2)))
    }
}

impl Coating {
    /// One film of index `index`, a quarter wave thick at `um`: 1.38 is that of magnesium fluoride.
    pub fn quarter_wave(name: &str, index: f64, um: f64) -> Self {
        let entries = vec![(um, index, 0.0)];
        Self::Films(vec![Film {
            index: FilmIndex { name: name.to_owned(), entries },
            thickness_um: um / (4.0 * index),
        }])
    }

    /// The coating at `um`.
    ///
    /// # Errors
    /// [`DesignError::Coating`] beyond the wavelengths of its tables.
    pub fn at(&self, um: f64) -> Result<CoatingAt, DesignError> {
        Ok(match self {
            Self::Bare => CoatingAt::Films(Vec::new()),
            Self::Films(films) => {
                let film = |f: &Film| Ok((f.index.at(um)?, f.thickness_um / um));
                CoatingAt::Films(films.iter().map(film).collect::<Result<_, _>>()?)
            }
            Self::Reflectance(spectrum) => {
                let wavelengths: Vec<f64> = spectrum.entries.iter().map(|e| e.0).collect();
                let (i, share) = place(&spectrum.name, &wavelengths, um)?;
                CoatingAt::Reflectance(mixed(&spectrum.entries, i, share, |e| e.1))
            }
            Self::Table(table) => {
                let (i, share) = place(&table.name, &table.wavelengths_um, um)?;
                let count = table.angles_deg.len();
                let row = |a: usize| {
                    let [low, high] =
                        [i, (i + 1).min(table.wavelengths_um.len() - 1)].map(|w| table.values[w * count + a]);
                    std::array::from_fn(|k| low[k] + share * (high[k] - low[k]))
                };
                CoatingAt::Angles((0..count).map(|a| (table.angles_deg[a], row(a))).collect())
            }
        })
    }
}

/// Index of the entry at or below `um` and the share of the next one.
fn place(name: &str, wavelengths_um: &[f64], um: f64) -> Result<(usize, f64), DesignError> {
    let (Some(first), Some(last)) = (wavelengths_um.first(), wavelengths_um.last()) else {
        return Err(DesignError::Coating { name: name.to_owned(), wavelength_um: um, range_um: None });
    };
    if wavelengths_um.len() == 1 {
        return Ok((0, 0.0));
    }
    // Tables in nm divided by 1000 differ by rounding.
    if um < first - 1e-9 || um > last + 1e-9 {
        let range_um = Some((tidy(first), tidy(last)));
        return Err(DesignError::Coating { name: name.to_owned(), wavelength_um: um, range_um });
    }
    let i = wavelengths_um.partition_point(|w| *w <= um).clamp(1, wavelengths_um.len() - 1) - 1;
    let share = (um - wavelengths_um[i]) / (wavelengths_um[i + 1] - wavelengths_um[i]);
    Ok((i, share.clamp(0.0, 1.0)))
}

fn mixed<T>(entries: &[T], i: usize, share: f64, pick: fn(&T) -> f64) -> f64 {
    let (low, high) = (pick(&entries[i]), pick(&entries[(i + 1).min(entries.len() - 1)]));
    low + share * (high - low)
}

impl CoatingAt {
    /// Amplitudes of light that meets the surface in index `n1` at the cosine `cos1` of its angle and is refracted into `n2`.
    pub fn amplitudes(&self, n1: f64, n2: f64, cos1: f64) -> Amplitudes {
        let sign = if n1 > n2 { 1.0 } else { -1.0 };
        match self {
            Self::Films(films) => stack(n1, n2, cos1, films, n1 <= n2),
            Self::Reflectance(r) => Amplitudes::of_powers([*r, *r, 1.0 - r, 1.0 - r], sign),
            Self::Angles(rows) => {
                let sine1 = (1.0 - cos1 * cos1).max(0.0).sqrt();
                let sine = if n1 <= n2 { sine1 } else { sine1 * n1 / n2 };
                let degrees = real::asin(sine.min(1.0)).to_degrees();
                let angles: Vec<f64> = rows.iter().map(|r| r.0).collect();
                let i = angles.partition_point(|a| *a <= degrees).clamp(1, rows.len().max(2) - 1) - 1;
                let (low, high) = (&rows[i], &rows[(i + 1).min(rows.len() - 1)]);
                let width = high.0 - low.0;
                // Beyond the last angle its values hold.
                let share = if width > 0.0 { ((degrees - low.0) / width).clamp(0.0, 1.0) } else { 0.0 };
                Amplitudes::of_powers(
                    std::array::from_fn(|k| low.1[k] + share * (high.1[k] - low.1[k])),
                    sign,
                )
            }
        }
    }
}

/// Largest size of B and C, above which both are scaled.
const LARGE: f64 = 1e100;

/// Amplitudes of films between `n1` and `n2`, listed in the order in which the light meets them if `is_forward`, else in reverse.
fn stack(n1: f64, n2: f64, cos1: f64, films: &[(Complex64, f64)], is_forward: bool) -> Amplitudes {
    let sine2 = n1 * n1 * (1.0 - cos1 * cos1);
    let cosine = |n: Complex64| square_root(Complex64::new(1.0, 0.0) - sine2 / (n * n));
    let (substrate, i) = (Complex64::new(n2, 0.0), Complex64::new(0.0, 1.0));
    let cos2 = cosine(substrate);
    // N, cos θ, and cosine and sine of the phase of each film, from the substrate outwards; what was left out of these.
    let mut growth = 0.0;
    let film = |(n, thickness): &(Complex64, f64)| {
        let cos = cosine(*n);
        let phase = *n * cos * (2.0 * PI * thickness);
        growth += phase.im.abs();
        let (cos_phase, sin_phase) = cos_sin(phase);
        (*n, cos, cos_phase, sin_phase)
    };
    let films: Vec<_> = match is_forward {
        true => films.iter().rev().map(film).collect(),
        false => films.iter().map(film).collect(),
    };
    let polarised = |eta: fn(Complex64, Complex64) -> Complex64| {
        let (eta1, eta2) = (eta(Complex64::new(n1, 0.0), Complex64::new(cos1, 0.0)), eta(substrate, cos2));
        let (mut b, mut c, mut left) = (Complex64::new(1.0, 0.0), eta2, real::exp(-growth));
        for (n, cos, cos_phase, sin_phase) in &films {
            let e = eta(*n, *cos);
            (b, c) = (cos_phase * b - i * sin_phase / e * c, -i * e * sin_phase * b + cos_phase * c);
            if b.re.abs().max(b.im.abs()).max(c.re.abs()).max(c.im.abs()) > LARGE {
                (b, c, left) = (b / LARGE, c / LARGE, left / LARGE);
            }
        }
        let sum = eta1 * b + c;
        ((eta1 * b - c) / sum, Complex64::new(2.0 * left * (eta1.re * eta2.re.max(0.0)).sqrt(), 0.0) / sum)
    };
    let (s, p) = (polarised(|n, cos| n * cos), polarised(|n, cos| n / cos));
    Amplitudes { r: [s.0, p.0], t: [s.1, p.1] }
}

/// The square root with a real part of at least 0.
fn square_root(z: Complex64) -> Complex64 {
    if z.im == 0.0 {
        return match z.re >= 0.0 {
            true => Complex64::new(z.re.sqrt(), 0.0),
            false => Complex64::new(0.0, (-z.re).sqrt()),
        };
    }
    let size = real::hypot(z.re, z.im);
    let (re, im) = ((0.5 * (size + z.re)).max(0.0).sqrt(), (0.5 * (size - z.re)).max(0.0).sqrt());
    Complex64::new(re, im.copysign(z.im))
}

/// cos z and sin z, both times e^−|Im z|, which keeps them finite.
fn cos_sin(z: Complex64) -> (Complex64, Complex64) {
    let (sin, cos) = real::sin_cos(z.re);
    if z.im == 0.0 {
        return (Complex64::new(cos, 0.0), Complex64::new(sin, 0.0));
    }
    let small = real::exp(-2.0 * z.im.abs());
    let (cosh, sinh) = (0.5 * (1.0 + small), (0.5 * (1.0 - small)).copysign(z.im));
    (Complex64::new(cos * cosh, -sin * sinh), Complex64::new(sin * cosh, cos * sinh))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn powers(coating: &Coating, n1: f64, n2: f64, um: f64, degrees: f64) -> [f64; 4] {
        let a = coating.at(um).unwrap().amplitudes(n1, n2, real::cos(degrees.to_radians()));
        [a.r[0], a.r[1], a.t[0], a.t[1]].map(|v| v.norm_sqr())
    }

    fn film(n: f64, k: f64, thickness_um: f64) -> Film {
        let index = FilmIndex { name: "film".to_owned(), entries: vec![(0.5, n, k)] };
        Film { index, thickness_um }
    }

    #[test]
    fn bare_glass_reflects_as_fresnel_says() {
        let [rs, rp, ts, tp] = powers(&Coating::Bare, 1.0, 1.5, 0.55, 0.0);
        for (value, expected) in [(rs, 0.04), (rp, 0.04), (ts, 0.96), (tp, 0.96)] {
            assert!((value - expected).abs() < 1e-12, "{value}");
        }
        // Brewster's angle: no p, and s as (n² − 1)²/(n² + 1)².
        let [rs, rp, ..] = powers(&Coating::Bare, 1.0, 1.5, 0.55, real::atan(1.5).to_degrees());
        assert!(rp < 1e-30 && (rs - 0.147_928_994_082_840_2).abs() < 1e-12, "{rs} {rp}");
    }

    #[test]
    fn quarter_and_half_waves_have_their_closed_forms() {
        let quarter = Coating::quarter_wave("MgF2", 1.38, 0.55);
        let [rs, ..] = powers(&quarter, 1.0, 1.5168, 0.55, 0.0);
        let expected = ((1.5168 - 1.38 * 1.38) / (1.5168 + 1.38 * 1.38_f64)).powi(2);
        assert!((rs - expected).abs() < 1e-12 && (rs - 0.012_836).abs() < 1e-6, "{rs}");
        let ideal = Coating::quarter_wave("ideal", f64::sqrt(1.5168), 0.55);
        assert!(powers(&ideal, 1.0, 1.5168, 0.55, 0.0)[0] < 1e-30);
        let half = Coating::Films(vec![film(1.38, 0.0, 0.55 / (2.0 * 1.38))]);
        let bare = powers(&Coating::Bare, 1.0, 1.5168, 0.55, 0.0);
        assert!((powers(&half, 1.0, 1.5168, 0.55, 0.0)[0] - bare[0]).abs() < 1e-12);
    }

    #[test]
    fn power_is_conserved_without_absorption_and_lost_with_it() {
        let clear = Coating::Films(vec![film(1.38, 0.0, 0.1), film(2.1, 0.0, 0.06)]);
        let metal = Coating::Films(vec![film(1.38, 0.0, 0.1), film(1.5, 3.0, 0.01)]);
        for degrees in [0.0, 20.0, 45.0, 70.0] {
            for (n1, n2) in [(1.0, 1.52), (1.52, 1.0)] {
                if n1 * real::sin(f64::to_radians(degrees)) >= n2 {
                    continue;
                }
                let [rs, rp, ts, tp] = powers(&clear, n1, n2, 0.5, degrees);
                assert!((rs + ts - 1.0).abs() < 1e-12 && (rp + tp - 1.0).abs() < 1e-12);
                let [rs, rp, ts, tp] = powers(&metal, n1, n2, 0.5, degrees);
                assert!(rs + ts < 0.99 && rp + tp < 0.99);
            }
        }
    }

    /// A metal so thick that its cosine of the phase exceeds the range of numbers reflects as its bulk: R = |(1 − N)/(1 + N)|².
    #[test]
    fn thick_metal_is_opaque_and_reflects_as_its_bulk() {
        for layers in [1, 200] {
            let coating = Coating::Films(vec![film(0.8, 6.0, 100.0); layers]);
            for (n1, n2) in [(1.0, 1.5), (1.5, 1.0)] {
                let [rs, rp, ts, tp] = powers(&coating, n1, n2, 0.5, 0.0);
                let bulk = ((n1 - 0.8) * (n1 - 0.8) + 36.0) / ((n1 + 0.8) * (n1 + 0.8) + 36.0);
                assert!((rs - bulk).abs() < 1e-12 && (rp - bulk).abs() < 1e-12, "{rs} {rp} {bulk}");
                assert_eq!((ts, tp), (0.0, 0.0));
            }
        }
        // Extremes of the bounds: dense and thin films in turn.
        let pairs = (0..200).map(|i| film(if i % 2 == 0 { 10.0 } else { 0.01 }, 100.0, 1.0));
        let extreme = Coating::Films(pairs.collect());
        assert!(powers(&extreme, 1.0, 1.5, 0.5, 60.0).iter().all(|v| (0.0..=1.0).contains(v)));
    }

    /// From both sides a coating transmits the same, an absorbing one reflects differently.
    #[test]
    fn transmittance_is_the_same_from_both_sides() {
        let metal = Coating::Films(vec![film(1.38, 0.0, 0.1), film(1.5, 3.0, 0.01)]);
        let outer = real::asin(1.52 * real::sin(f64::to_radians(20.0))).to_degrees();
        let (into, out) = (powers(&metal, 1.0, 1.52, 0.5, outer), powers(&metal, 1.52, 1.0, 0.5, 20.0));
        assert!((into[2] - out[2]).abs() < 1e-12 && (into[3] - out[3]).abs() < 1e-12);
        assert!((into[0] - out[0]).abs() > 1e-3);
    }

    #[test]
    fn tables_are_linear_and_end_with_an_error() {
        let spectrum = Spectrum { name: "bbar".to_owned(), entries: vec![(0.4, 0.006), (0.5, 0.002)] };
        let coating = Coating::Reflectance(spectrum);
        let [rs, .., tp] = powers(&coating, 1.0, 1.5, 0.45, 30.0);
        assert!((rs - 0.004).abs() < 1e-15 && (tp - 0.996).abs() < 1e-15);
        let error = coating.at(0.55).unwrap_err().to_string();
        assert!(error.contains("bbar") && error.contains("0.4") && error.contains("0.55"), "{error}");
        let table = Coating::Table(CoatingTable {
            name: "measured".to_owned(),
            wavelengths_um: vec![0.4, 0.6],
            angles_deg: vec![0.0, 40.0],
            values: vec![
                [0.0, 0.0, 1.0, 1.0],
                [0.4, 0.2, 0.6, 0.8],
                [0.2, 0.2, 0.8, 0.8],
                [0.4, 0.2, 0.6, 0.8],
            ],
        });
        let at = powers(&table, 1.0, 1.5, 0.5, 20.0);
        for (value, expected) in std::iter::zip(at, [0.25, 0.15, 0.75, 0.85]) {
            assert!((value - expected).abs() < 1e-12, "{at:?}");
        }
        // In the denser medium the angle of the table is that of the ray outside.
        let inner = real::asin(real::sin(f64::to_radians(20.0)) / 1.5).to_degrees();
        let from_glass = powers(&table, 1.5, 1.0, 0.5, inner);
        assert!(std::iter::zip(at, from_glass).all(|(a, b)| (a - b).abs() < 1e-12));
    }
}
