//! Relative illumination: irradiance of the film under a uniform object, relative to the axis.
//!
//! ```text
//! R(h) = G(h) / G(0),     G = E / L₀ [sr]     E irradiance of the film, L₀ radiance of the object
//! object at infinity:  G = ∫∫ dx dy (beam in the entrance pupil plane) · |d(L, M)_object / d(X, Y)_film|
//! finite distance:     G = ∫∫ dL dM (bundle at the object point) · |d(x, y)_object / d(X, Y)_film|
//! ```
//! The light of a field element enters the lens through its beam and lands on the film element that the CHIEF RAYS of the field element
//! surround: with t = tan θ and the chief-ray height h(t),
//! ```text
//! |d(L, M)/d(X, Y)| = t / (h · dh/dt · (1 + t²)²),     |d(x, y)/d(X, Y)| = z² · t / (h · dh/dt),     z object to entrance pupil.
//! ```
//! Light is conserved: ∫ G dX dY over the film is the power that passes the entrance pupil. The PSF, measured from the chief ray, spreads
//! it further. The *solid angle* of the bundle at the film,
//! ```text
//! Ω = ∫∫ |d(L, M)_film / d(p, q)| dp dq,
//! ```
//! equals G where the bundle is in perfect focus (radiance is conserved along rays); defocus and aberrations separate the two: at the edge
//! of the field of a Double Gauss 0.915 against 0.920, of a biconvex singlet 0.75 against 1.09. A lone stop gives cos⁴ for both.
//! Includes vignetting and pupil aberration, and what each ray loses at coatings and in glass (`rays/losses.rs`).
//! Other programs: the tables of `double-gauss-28-npz` have Ω. A listing of OpticStudio's predecessor for an f = 2 mm asphere (five
//! wavelengths, 27.4 degrees; without prescription) is R within 0.001: 0.8035 at the edge, where G computed from the heights listed with it
//! and a beam of constant size is 0.8028 and cos⁴ 0.622. The lens is in focus there, so the listing does not separate G from Ω; according to
//! its manual the program integrates the exit pupil in direction cosines, which is Ω.
//! Source: Rimmer, Relative illumination calculations, Proc. SPIE 655 (1986); Welford, chapter 5 (étendue).

use std::f64::consts::PI;

use rayon::prelude::*;

use super::bundle::Bundle;
use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::System;
use crate::design::rays::aim::lagrange;
use crate::design::rays::ray::{ImageRay, Tracer};

/// Light of one field point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldLight {
    /// Irradiance of the film over radiance of the object: G, sr.
    pub irradiance_sr: f64,
    /// Projected solid angle of the bundle at the film: Ω, sr.
    pub solid_angle_sr: f64,
}

/// Light of the field point at tan(field angle) `tan`.
///
/// # Errors
/// A ray of the pupil that does not reach the image.
pub fn field_light(tracer: &Tracer<'_>, tan: f64) -> Result<FieldLight, DesignError> {
    // The Jacobians are smooth: 7 × 9 nodes are accurate to 1e-9 even at F/1.8.
    Bundle::trace(tracer, tan, 7, 9)?.light(tracer)
}

impl Bundle {
    /// Irradiance and solid angle of the field point.
    ///
    /// # Errors
    /// The chief ray does not reach the image.
    pub fn light(&self, tracer: &Tracer<'_>) -> Result<FieldLight, DesignError> {
        light_of(tracer, self.tan, self.rays.iter().map(|(w, r)| (*w, r)))
    }
}

/// Light of the field point at tan(field angle) `tan` from rays over half its pupil with their quadrature weights.
pub(super) fn light_of<'r>(
    tracer: &Tracer<'_>,
    tan: f64,
    rays: impl Iterator<Item = (f64, &'r ImageRay)>,
) -> Result<FieldLight, DesignError> {
    let (mut flux, mut omega) = (0.0, 0.0);
    for (weight, ray) in rays {
        flux += 2.0 * weight * ray.flux;
        omega += 2.0 * weight * ray.solid_angle();
    }
    let (height, slope) = tracer.chief_height_and_slope(tan)?;
    let per_tan = if tan == 0.0 { slope.powi(-2) } else { tan / (height * slope) };
    let object = match tracer.object_distance_mm() {
        None => (1.0 + tan * tan).powi(-2),
        Some(distance) => (distance + tracer.primary.entrance_pupil_mm).powi(2),
    };
    Ok(FieldLight { irradiance_sr: flux * per_tan.abs() * object, solid_angle_sr: omega })
}

/// G of the field point at tan(field angle) `tan`, sr.
///
/// # Errors
/// As [`field_light`].
pub fn irradiance_sr(tracer: &Tracer<'_>, tan: f64) -> Result<f64, DesignError> {
    Ok(field_light(tracer, tan)?.irradiance_sr)
}

/// Transmission of `system` on the axis at `um`: flux-weighted mean over the open pupil; 1 without coatings.
///
/// # Errors
/// As [`Tracer::new`] and [`field_light`].
pub fn axial_transmission(system: &System, um: f64) -> Result<f64, DesignError> {
    let tracer = Tracer::new(system, um)?;
    match tracer.has_losses() {
        true => Ok(irradiance_sr(&tracer, 0.0)? / irradiance_sr(&tracer.without_losses(), 0.0)?),
        false => Ok(1.0),
    }
}

/// Projected solid angle of the pupil from the image of the field point at tan(field angle) `tan`, sr.
///
/// # Errors
/// As [`field_light`].
pub fn solid_angle_sr(tracer: &Tracer<'_>, tan: f64) -> Result<f64, DesignError> {
    Ok(field_light(tracer, tan)?.solid_angle_sr)
}

/// Numerical aperture on the axis: the sine of the marginal ray's angle, a central obscuration left out of account.
///
/// # Errors
/// A ray of the pupil that does not reach the image.
pub fn numerical_aperture(tracer: &Tracer<'_>) -> Result<f64, DesignError> {
    let bundle = Bundle::trace(tracer, 0.0, 7, 9)?;
    let open = bundle.rays.iter().filter(|(weight, _)| *weight > 0.0);
    let omega: f64 = open.map(|(weight, ray)| 2.0 * weight * ray.solid_angle()).sum();
    Ok((omega / PI).sqrt())
}

/// Maximum error of interpolated values of the table, relative to the axis.
const TABLE_TOLERANCE: f64 = 1e-5;
/// Spacing of the values computed first.
const STRIDE: usize = 32;

/// G at `tans`, which are evenly spaced from 0. G is even in t and smooth except where an aperture begins to clip: it is computed
/// at every 32nd point, then half-way between as long as the value there differs from a cubic interpolation, else interpolated.
///
/// # Errors
/// As [`field_light`].
pub(crate) fn irradiance_table(tracer: &Tracer<'_>, tans: &[f64]) -> Result<Vec<f64>, DesignError> {
    let last = tans.len() - 1;
    let mut table: Vec<Option<f64>> = vec![None; tans.len()];
    let compute = |table: &mut Vec<Option<f64>>, at: &[usize]| -> Result<(), DesignError> {
        let found: Result<Vec<f64>, DesignError> =
            at.par_iter().map(|i| irradiance_sr(tracer, tans[*i])).collect();
        at.iter().zip(found?).for_each(|(i, v)| table[*i] = Some(v));
        Ok(())
    };
    let first: Vec<usize> = (0..last).step_by(STRIDE).chain([last]).collect();
    compute(&mut table, &first)?;
    let axis = table[0].unwrap_or(1.0);
    let mut open: Vec<(usize, usize)> = first.windows(2).map(|w| (w[0], w[1])).collect();
    while !open.is_empty() {
        let middles: Vec<usize> =
            open.iter().filter(|(a, b)| b - a > 1).map(|(a, b)| usize::midpoint(*a, *b)).collect();
        let expected: Vec<f64> = middles.iter().map(|i| cubic(&table, *i)).collect();
        compute(&mut table, &middles)?;
        let fails: Vec<bool> = middles
            .iter()
            .zip(&expected)
            .map(|(i, e)| (table[*i].unwrap_or(*e) - e).abs() > TABLE_TOLERANCE * axis)
            .collect();
        let halves = open.iter().filter(|(a, b)| b - a > 1).enumerate().filter(|(k, _)| {
            // An interval beside a failing one may hold the end of a kink.
            fails[k.saturating_sub(1)..(k + 2).min(fails.len())].contains(&true)
        });
        open = halves.flat_map(|(k, (a, b))| [(*a, middles[k]), (middles[k], *b)]).collect();
    }
    Ok((0..=last).map(|i| table[i].unwrap_or_else(|| cubic(&table, i))).collect())
}

/// Value at `i` of the cubic through the two nearest known values on each side; those below 0 are mirrored, above the last one
/// more is taken below.
fn cubic(table: &[Option<f64>], i: usize) -> f64 {
    let below = (0..i).rev().filter_map(|k| Some((k as f64, table[k]?)));
    let mirrored = (1..table.len()).filter_map(|k| Some((-(k as f64), table[k]?)));
    let above: Vec<(f64, f64)> =
        (i + 1..table.len()).filter_map(|k| Some((k as f64, table[k]?))).take(2).collect();
    let points: Vec<(f64, f64)> = below.chain(mirrored).take(4 - above.len()).chain(above).collect();
    lagrange(&points, i as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::prescription::system::RayAiming;

    #[test]
    fn interpolated_table_equals_values_computed_at_every_point() {
        let lens = System::double_gauss_28();
        let mut clipped = System { aiming: RayAiming::Real, ..lens.clone() };
        clipped.surfaces[0].aperture_mm = Some(26.0);
        for system in [&lens, &clipped] {
            let tracer = Tracer::new(system, 0.55).unwrap();
            let tans: Vec<f64> = (0..301).map(|i| 0.22 * f64::from(i) / 300.0).collect();
            let table = irradiance_table(&tracer, &tans).unwrap();
            for i in [0, 1, 17, 48, 99, 133, 150, 177, 201, 222, 250, 299, 300] {
                let error = (table[i] - irradiance_sr(&tracer, tans[i]).unwrap()) / table[0];
                assert!(error.abs() < 2e-6, "{i}: {error:e}");
            }
        }
    }
}
