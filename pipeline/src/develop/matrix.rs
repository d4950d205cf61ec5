//! Colour matrices of a sensor, from its own curves.
//!
//! Of the 24 patches of a ColorChecker under a light, at the 5 nm of the illuminant's table:
//!
//!   camera_p = Σ_λ ρ·S·Q_p / Σ_λ S·Q_p      balanced response of plane p, the mean over its filters; 1 for a white
//!   target   = linear sRGB of the patch, its XYZ adapted from the light's white to D65 (Bradford)
//!   M = argmin Σ_patches ‖target − M·camera‖²  subject to  M·(1, …, 1) = (1, 1, 1)
//! so that neutral stays neutral. Planes of no colour (infrared filters, [`Sensor::sees_colour`]) are left out of the fit and have columns of 0. The constraint removes the last column: least squares of target − base over camera − base by QR.
//! ΔE2000 of M·camera against the target is the error of the matrix alone, without noise, lens and mosaic.
//! ColorMatrix of DNG: from XYZ under the light to the camera's unbalanced planes, (A·S·M·G)⁻¹ with G the white gains of the planes, S the
//! matrix from linear sRGB to XYZ and A the Bradford adaptation from D65 to the light.

use super::error::DevelopError;
use crate::colour::{self, CHECKER_PATCHES, FIRST_NM, Illuminant, LAST_NM};
use crate::least_squares::{Qr, dot};
use crate::sensor::Sensor;
use std::ops::Range;

/// Grey patches of a ColorChecker that determine its brightness: all but the darkest two; colours are before them.
pub const GREYS: Range<usize> = 18..22;

/// A colour matrix and its errors.
#[derive(Clone, Debug, PartialEq)]
pub struct ColourMatrix {
    /// Three rows, one column per plane.
    pub rows: Vec<Vec<f64>>,
    /// CIEDE2000 of each ColorChecker patch.
    pub delta_e: Vec<f64>,
}

impl ColourMatrix {
    /// The matrix of a sensor under a light.
    ///
    /// # Errors
    /// [`DevelopError::Matrix`] if the planes do not determine one.
    pub fn fitted(sensor: &Sensor, light: Illuminant) -> Result<Self, DevelopError> {
        let seen = seen_planes(sensor, light);
        let camera: Vec<Vec<f64>> = patch_responses(sensor, light)
            .iter()
            .map(|patch| seen.iter().map(|p| patch[*p]).collect())
            .collect();
        let target = patch_targets(light);
        let planes = seen.len();
        let undetermined = || DevelopError::Matrix {
            sensor: sensor.name.clone(),
            problem: format!(
                "{CHECKER_PATCHES} patches under {} do not determine {planes} planes",
                light.name()
            ),
        };
        if camera.iter().flatten().any(|v| !v.is_finite()) {
            let problem = format!("a plane has no response to {}", light.name());
            return Err(DevelopError::Matrix { sensor: sensor.name.clone(), problem });
        }
        let rows = Self::rows_to(&camera, &target).ok_or_else(undetermined)?;
        let delta_e = std::iter::zip(&camera, &target)
            .map(|(c, t)| difference(std::array::from_fn(|i| dot(&rows[i], c)), *t))
            .collect();
        let all = |row: &Vec<f64>| {
            let mut of_planes = vec![0.0; sensor.planes().len()];
            std::iter::zip(&seen, row).for_each(|(p, v)| of_planes[*p] = *v);
            of_planes
        };
        Ok(Self { rows: rows.iter().map(all).collect(), delta_e })
    }

    /// The matrix M from the values `camera` of patches to their linear sRGB; `None` if they do not determine one.
    pub fn rows_to(camera: &[Vec<f64>], target: &[[f64; 3]]) -> Option<Vec<Vec<f64>>> {
        let base = camera.first()?.len().checked_sub(1)?;
        let columns: Vec<Vec<f64>> =
            (0..base).map(|p| camera.iter().map(|c| c[p] - c[base]).collect()).collect();
        let qr = Qr::new(columns)?;
        let row = |c: usize| {
            let right: Vec<f64> = std::iter::zip(target, camera).map(|(t, v)| t[c] - v[base]).collect();
            let mut row = qr.solve(&right);
            row.push(1.0 - row.iter().sum::<f64>());
            row
        };
        Some((0..3).map(row).collect())
    }

    /// Mean ΔE2000 of the patches.
    pub fn mean_delta_e(&self) -> f64 {
        self.delta_e.iter().sum::<f64>() / self.delta_e.len() as f64
    }

    /// Largest ΔE2000 of the patches.
    pub fn max_delta_e(&self) -> f64 {
        self.delta_e.iter().copied().fold(0.0, f64::max)
    }

    /// ColorMatrix of DNG for a sensor of three planes: XYZ under `light` to the planes, their `gains` (least 1) not applied.
    pub fn xyz_to_planes(&self, light: Illuminant, gains: [f64; 3]) -> [[f64; 3]; 3] {
        let adapt = colour::adaptation(Illuminant::D65.white(), light.white());
        let unit = |k: usize| std::array::from_fn(|i| if i == k { gains[k] } else { 0.0 });
        let columns: [[f64; 3]; 3] = std::array::from_fn(|k| {
            let balanced: [f64; 3] = unit(k);
            let rgb = std::array::from_fn(|i| dot(&self.rows[i], &balanced));
            let xyz = colour::linear_srgb_to_xyz(rgb);
            std::array::from_fn(|i| dot(&adapt[i], &xyz))
        });
        colour::inverse(&std::array::from_fn(|i| std::array::from_fn(|k| columns[k][i])))
    }
}

/// CIEDE2000 of two linear sRGB colours.
pub fn difference(first: [f64; 3], second: [f64; 3]) -> f64 {
    let lab = |rgb| colour::lab(colour::linear_srgb_to_xyz(rgb), Illuminant::D65.white());
    colour::delta_e_2000(lab(first), lab(second))
}

/// Linear sRGB of the ColorChecker patches under a light, adapted to D65.
pub fn patch_targets(light: Illuminant) -> Vec<[f64; 3]> {
    let adapt = colour::adaptation(light.white(), Illuminant::D65.white());
    let patch = |k: usize| {
        let xyz = colour::reflected_xyz(light, |nm| colour::checker_reflectance(k, nm));
        colour::xyz_to_linear_srgb(std::array::from_fn(|i| dot(&adapt[i], &xyz)))
    };
    (0..CHECKER_PATCHES).map(patch).collect()
}

/// Linear sRGB of ColorChecker patches, as bright as the greys of `targets`; `None` if they are dark.
pub fn scaled_to_greys(found: &[[f64; 3]], targets: &[[f64; 3]]) -> Option<Vec<[f64; 3]>> {
    let greys = |all: &[[f64; 3]]| all[GREYS].iter().map(|v| v[1]).sum::<f64>();
    let scale = greys(targets) / greys(found);
    (scale.is_finite() && scale > 0.0).then(|| found.iter().map(|f| f.map(|v| v * scale)).collect())
}

/// Planes that a channel of a colour belongs to.
fn seen_planes(sensor: &Sensor, light: Illuminant) -> Vec<usize> {
    let sees = std::iter::zip(sensor.plane_of_channels(), sensor.sees_colour(light));
    let mut planes: Vec<usize> = sees.filter(|(_, sees)| *sees).map(|(plane, _)| plane).collect();
    planes.sort_unstable();
    planes.dedup();
    planes
}

/// Balanced response of each plane to each patch; 1 for a white, 0 of a plane without response.
pub fn patch_responses(sensor: &Sensor, light: Illuminant) -> Vec<Vec<f64>> {
    let sensor = &*sensor.in_uniform_light();
    let grid: Vec<f64> =
        (0..=((LAST_NM - FIRST_NM) / 5.0) as u32).map(|i| FIRST_NM + 5.0 * f64::from(i)).collect();
    let filter = |c: usize| -> Vec<f64> {
        let power = |nm: &f64| sensor.response_e_per_j(c, *nm) * light.relative_power(*nm);
        let response: Vec<f64> = grid.iter().map(power).collect();
        let all: f64 = response.iter().sum();
        response.into_iter().map(|v| if v > 0.0 { v / all } else { 0.0 }).collect()
    };
    let filters: Vec<Vec<f64>> = (0..sensor.channels.len()).map(filter).collect();
    let (planes, of) = (sensor.planes().len(), sensor.plane_of_channels());
    let plane = |p: usize| -> Vec<f64> {
        let own: Vec<&Vec<f64>> = (0..of.len()).filter(|c| of[*c] == p).map(|c| &filters[c]).collect();
        (0..grid.len()).map(|i| own.iter().map(|f| f[i]).sum::<f64>() / own.len() as f64).collect()
    };
    let curves: Vec<Vec<f64>> = (0..planes).map(plane).collect();
    let patch = |k: usize| -> Vec<f64> {
        let reflectance: Vec<f64> = grid.iter().map(|nm| colour::checker_reflectance(k, *nm)).collect();
        curves.iter().map(|c| dot(c, &reflectance)).collect()
    };
    (0..CHECKER_PATCHES).map(patch).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_of_greys_are_neutral() {
        for light in [Illuminant::D65, Illuminant::A] {
            let white = patch_targets(light)[18];
            let spread = white.iter().fold(0.0, |m, v| f64::max(m, (v - white[1]).abs()));
            assert!(spread < 0.02 && white[1] > 0.8, "{light:?} {white:?}");
        }
    }
}
