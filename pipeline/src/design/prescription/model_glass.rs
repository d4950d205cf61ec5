//! Glasses of which only n_d and V_d are known: model glasses, glass codes, constant indices.
//!
//! Model glass of n_d, V_d (and ΔP_gF): Conrady's n(λ) = n₀ + A/λ + B/λ^3.5 through n_d, n_F − n_C = (n_d − 1)/V_d and
//! n_g − n_F = P_gF·(n_F − n_C), where P_gF = 0.6438 − 0.001682·V_d + ΔP_gF is the line of normal glasses (Schott, TIE-29).
//! A glass code has n_d − 1 and V_d: `517642`, `517.642`, `516800.641673`, `1.5168:64.17`.

use super::error::DesignError;
use super::glass::{Dispersion, Glass};
use crate::real;

/// Spectral lines F, d, C and g, µm.
pub const LINES_UM: [f64; 4] = [0.486_132_7, 0.587_561_8, 0.656_272_5, 0.435_834_3];

/// Wavelengths at which a model glass may be used, µm: Conrady's formula is not meant for more.
const MODEL_RANGE_UM: (f64, f64) = (0.36, 1.1);

/// P_gF of normal glasses at V_d = 0, and its slope.
const NORMAL_LINE: (f64, f64) = (0.6438, -0.001_682);

/// A glass of which only n_d, V_d and the deviation of its partial dispersion P_gF from the normal line are known.
///
/// # Errors
/// [`DesignError::Option`] unless n_d lies in 1..4 and V_d in 5..200.
pub fn model_glass(name: &str, n_d: f64, v_d: f64, delta_p_gf: f64) -> Result<Glass, DesignError> {
    if !(n_d > 1.0 && n_d < 4.0 && (5.0..=200.0).contains(&v_d) && delta_p_gf.abs() < 0.5) {
        return Err(DesignError::Option {
            option: "a model glass's n_d, V_d, ΔP_gF",
            value: format!("{n_d}, {v_d}, {delta_p_gf}"),
            expected: "1 to 4, 5 to 200, -0.5 to 0.5",
        });
    }
    let terms = |um: f64| [1.0 / um, 1.0 / real::pow(um, 3.5)];
    let [f, d, c, g] = LINES_UM.map(terms);
    let main = (n_d - 1.0) / v_d;
    let partial = (NORMAL_LINE.0 + NORMAL_LINE.1 * v_d + delta_p_gf) * main;
    // A·(f − c) + B·(f' − c') = n_F − n_C and A·(g − f) + B·(g' − f') = n_g − n_F.
    let (m, p) = ([f[0] - c[0], f[1] - c[1]], [g[0] - f[0], g[1] - f[1]]);
    let determinant = m[0] * p[1] - m[1] * p[0];
    let a = (main * p[1] - m[1] * partial) / determinant;
    let b = (m[0] * partial - main * p[0]) / determinant;
    let dispersion =
        Dispersion::new(5, &[n_d - a * d[0] - b * d[1], a, b]).expect("finite by the bounds above");
    Ok(Glass::new(name.to_owned(), dispersion, MODEL_RANGE_UM))
}

/// A medium of one index.
pub fn constant_glass(n: f64) -> Glass {
    Glass::new(format!("n={n}"), Dispersion::constant(n), (0.0, 1e9))
}

/// n_d, V_d and ΔP_gF that [`model_glass`] makes `glass` of; none for another dispersion formula.
pub fn model_values(glass: &Glass) -> Option<(f64, f64, f64)> {
    if glass.range_um != MODEL_RANGE_UM {
        return None;
    }
    let [f, d, c, g] = LINES_UM.map(|um| glass.dispersion.index(um));
    // Numbers of few digits made it, and rounding follows the tenth.
    let rounded = |v: f64, digits: f64| (v * digits).round() / digits;
    let v_d = rounded((d - 1.0) / (f - c), 1e9);
    let delta_p_gf = rounded((g - f) / (f - c) - NORMAL_LINE.0 - NORMAL_LINE.1 * v_d, 1e10);
    let d = rounded(d, 1e12);
    let again = model_glass(&glass.name, d, v_d, delta_p_gf).ok()?;
    let is_same = [0.4, 0.5, 0.6, 0.9].into_iter().all(|um| {
        let apart = again.dispersion.index(um) - glass.dispersion.index(um);
        apart.abs() < 1e-11
    });
    is_same.then_some((d, v_d, delta_p_gf))
}

/// n_d and V_d of a glass code; of a code of digits, three or more are n_d − 1, the others V_d without its decimal point.
pub fn glass_code(name: &str) -> Option<(f64, f64)> {
    let is_digits = |s: &str| !s.is_empty() && s.bytes().all(|b| b.is_ascii_digit());
    if let Some((n, v)) = name.split_once(':') {
        let number = |s: &str| s.parse().ok().filter(|x: &f64| x.is_finite() && *x > 1.0);
        return number(n).zip(number(v));
    }
    let (n, v) = match name.split_once('.') {
        Some(parts) => parts,
        None if name.len() == 6 && name.is_ascii() => name.split_at(3),
        None => return None,
    };
    if n.len() < 3 || !is_digits(n) || !is_digits(v) {
        return None;
    }
    // Zeros at the end of V_d are often left out: 784.25 is V_d = 25.0.
    let padded = format!("{v:0<3}");
    Some((format!("1.{n}").parse().ok()?, format!("{}.{}", &padded[..2], &padded[2..]).parse().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::prescription::glass_library::GlassLibrary;

    #[test]
    fn glass_codes_are_n_d_and_v_d() {
        for (code, n, v) in [
            ("517642", 1.517, 64.2),
            ("517.642", 1.517, 64.2),
            ("784.25", 1.784, 25.0),
            ("500.700", 1.5, 70.0),
            ("516800.641673", 1.5168, 64.1673),
            ("1.5168:64.17", 1.5168, 64.17),
        ] {
            assert_eq!(glass_code(code), Some((n, v)), "{code}");
        }
        for name in ["NBK7", "5176", "1.5", "51.7642", "517,642", "1.5:x", "µµµ", "0.5:60"] {
            assert_eq!(glass_code(name), None, "{name}");
        }
    }

    #[test]
    fn values_of_a_model_glass_are_recovered() {
        let glass = model_glass("m", 1.62, 36.37, 0.0021).unwrap();
        let (n, v, dp) = model_values(&glass).unwrap();
        assert!((n - 1.62).abs() < 1e-13 && (v - 36.37).abs() < 1e-9 && (dp - 0.0021).abs() < 1e-9);
        let (real, _) = GlassLibrary::new().find("F2", &["SCHOTT".to_owned()]).unwrap();
        assert!(model_values(&real).is_none() && model_values(&constant_glass(1.5)).is_none());
    }

    /// Real glasses from their own n_d and V_d: the error of the model over the visible.
    #[test]
    fn model_glass_has_its_n_d_and_v_d_and_is_near_real_glasses() {
        for (name, worst) in [("N-BK7", 1.2e-4), ("F2", 2e-4), ("N-SK16", 1.5e-4)] {
            let (real, _) = GlassLibrary::new().find(name, &["SCHOTT".to_owned()]).unwrap();
            let n = LINES_UM.map(|um| real.dispersion.index(um));
            let v = (n[1] - 1.0) / (n[0] - n[2]);
            let model = model_glass("model", n[1], v, 0.0).unwrap().dispersion;
            assert!((model.index(LINES_UM[1]) - n[1]).abs() < 1e-12);
            let again =
                (model.index(LINES_UM[1]) - 1.0) / (model.index(LINES_UM[0]) - model.index(LINES_UM[2]));
            assert!((again - v).abs() < 1e-9);
            let error = (400..=700).step_by(10).map(|nm| f64::from(nm) * 1e-3);
            let error =
                error.map(|um| (model.index(um) - real.dispersion.index(um)).abs()).fold(0.0, f64::max);
            assert!(error < worst, "{name}: {error:.2e}");
        }
        assert!(model_glass("bad", 0.9, 50.0, 0.0).is_err() && model_glass("bad", 1.5, 0.0, 0.0).is_err());
    }
}
