//! Conversion of bands and XYZ to sRGB.

use super::cie::{Illuminant, add, integrate, xyz_weights};
use crate::real;
use std::sync::OnceLock;

/// Weights w with linear sRGB = Σ_b L_b·w_b, such that a white of spectral radiance `white(λ)` maps to (1, 1, 1).
///
/// The white point is that of the white sampled by the bands, so that greys are neutral, unless its XYZ differs from that of the full
/// spectrum by more than a tenth (few bands, or one): then that of the full spectrum at equal luminance, so that a narrow band keeps
/// its hue. All weights are 0 if the bands contain none of the white.
pub fn srgb_weights(wavelengths_nm: &[f64], white: impl Fn(f64) -> f64) -> Vec<[f64; 3]> {
    let weights = xyz_weights(wavelengths_nm);
    let sampled =
        weights.iter().zip(wavelengths_nm).fold([0.0; 3], |sum, (w, &nm)| add(sum, w.map(|v| v * white(nm))));
    let full = integrate(&white);
    if !(sampled[1] > 0.0 && full[1] > 0.0) {
        return vec![[0.0; 3]; weights.len()];
    }
    let full = full.map(|v| v / full[1]);
    let sampled_white = sampled.map(|v| v / sampled[1]);
    let near = sampled_white.iter().zip(full).all(|(s, f)| (s - f).abs() <= 0.1 * f);
    let to_d65 = adaptation(if near { sampled_white } else { full }, Illuminant::D65.white());
    weights.iter().map(|&w| xyz_to_linear_srgb(times(&to_d65, w.map(|v| v / sampled[1])))).collect()
}

/// Bradford matrix from XYZ under white `from` to XYZ under white `to`.
pub fn adaptation(from: [f64; 3], to: [f64; 3]) -> [[f64; 3]; 3] {
    const TO_CONES: [[f64; 3]; 3] =
        [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]];
    let from_cones = inverse(&TO_CONES);
    let (a, b) = (times(&TO_CONES, from), times(&TO_CONES, to));
    let gains = [b[0] / a[0], b[1] / a[1], b[2] / a[2]];
    std::array::from_fn(|i| {
        std::array::from_fn(|j| (0..3).map(|k| from_cones[i][k] * gains[k] * TO_CONES[k][j]).sum())
    })
}

/// XYZ (D65 white, Y = 1) to linear sRGB; out-of-gamut colours leave 0..1.
pub fn xyz_to_linear_srgb(xyz: [f64; 3]) -> [f64; 3] {
    static MATRIX: OnceLock<[[f64; 3]; 3]> = OnceLock::new();
    times(MATRIX.get_or_init(srgb_matrix), xyz)
}

/// Linear sRGB to XYZ (D65 white, Y = 1).
pub fn linear_srgb_to_xyz(rgb: [f64; 3]) -> [f64; 3] {
    static MATRIX: OnceLock<[[f64; 3]; 3]> = OnceLock::new();
    times(MATRIX.get_or_init(|| inverse(&srgb_matrix())), rgb)
}

/// From the primaries of ITU-R BT.709 and the D65 of this module, so that white is (1, 1, 1) up to rounding.
fn srgb_matrix() -> [[f64; 3]; 3] {
    const PRIMARIES: [[f64; 2]; 3] = [[0.64, 0.33], [0.30, 0.60], [0.15, 0.06]];
    let columns = PRIMARIES.map(|[x, y]| [x / y, 1.0, (1.0 - x - y) / y]);
    let unscaled: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| columns[j][i]));
    let amounts = times(&inverse(&unscaled), Illuminant::D65.white());
    inverse(&std::array::from_fn(|i| std::array::from_fn(|j| unscaled[i][j] * amounts[j])))
}

/// The sRGB transfer function: linear 0..1 to display value 0..1, clipped.
pub fn srgb_encode(linear: f64) -> f64 {
    let v = if linear.is_nan() { 0.0 } else { linear.clamp(0.0, 1.0) };
    if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * real::pow(v, 1.0 / 2.4) - 0.055 }
}

/// The inverse of [`srgb_encode`]: display value 0..1 to linear 0..1.
pub fn srgb_decode(encoded: f64) -> f64 {
    let v = encoded.clamp(0.0, 1.0);
    if v <= 0.040_45 { v / 12.92 } else { real::pow((v + 0.055) / 1.055, 2.4) }
}

fn times(m: &[[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    m.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

/// The inverse matrix; infinite or NaN where there is none.
pub fn inverse(m: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    // Cyclic indices include the signs of the cofactors.
    let cofactor = |i: usize, j: usize| {
        let (a, b, c, d) = ((i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3);
        m[a][c] * m[b][d] - m[a][d] * m[b][c]
    };
    let determinant: f64 = (0..3).map(|j| m[0][j] * cofactor(0, j)).sum();
    std::array::from_fn(|i| std::array::from_fn(|j| cofactor(j, i) / determinant))
}

#[cfg(test)]
mod tests {
    use super::super::cie::tests::{bands, weighted_sum};
    use super::super::cie::{checker_names, checker_reflectance};
    use super::*;

    /// 8-bit sRGB of the patches as published by their manufacturer.
    const PUBLISHED: [[f64; 3]; 24] = [
        [115.0, 82.0, 68.0],
        [194.0, 150.0, 130.0],
        [98.0, 122.0, 157.0],
        [87.0, 108.0, 67.0],
        [133.0, 128.0, 177.0],
        [103.0, 189.0, 170.0],
        [214.0, 126.0, 44.0],
        [80.0, 91.0, 166.0],
        [193.0, 90.0, 99.0],
        [94.0, 60.0, 108.0],
        [157.0, 188.0, 64.0],
        [224.0, 163.0, 46.0],
        [56.0, 61.0, 150.0],
        [70.0, 148.0, 73.0],
        [175.0, 54.0, 60.0],
        [231.0, 199.0, 31.0],
        [187.0, 86.0, 149.0],
        [8.0, 133.0, 161.0],
        [243.0, 243.0, 242.0],
        [200.0, 200.0, 200.0],
        [160.0, 160.0, 160.0],
        [122.0, 122.0, 121.0],
        [85.0, 85.0, 85.0],
        [52.0, 52.0, 52.0],
    ];

    #[test]
    fn white_maps_to_one_under_every_illuminant() {
        for light in Illuminant::ALL {
            let weights = srgb_weights(&bands(), |nm| light.relative_power(nm));
            for v in weighted_sum(&bands(), &weights, |nm| light.relative_power(nm)) {
                assert!((v - 1.0).abs() < 1e-12, "{light:?} {v}");
            }
        }
        for v in xyz_to_linear_srgb(Illuminant::D65.white()) {
            assert!((v - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn colorchecker_srgb_matches_published_values() {
        let weights = srgb_weights(&bands(), |nm| Illuminant::D65.relative_power(nm));
        let mut total = 0.0;
        for (patch, expected) in PUBLISHED.iter().enumerate() {
            let light = |nm| Illuminant::D65.relative_power(nm) * checker_reflectance(patch, nm);
            let rgb = weighted_sum(&bands(), &weights, light).map(|v| 255.0 * srgb_encode(v));
            let worst = rgb.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            // The published values were made for D50 and adapted, from another average of charts.
            assert!(worst < 12.0, "{}: {rgb:?}, expected {expected:?}", checker_names()[patch]);
            total += worst;
        }
        assert!(total / 24.0 < 5.0, "mean of the worst channels {}", total / 24.0);
    }

    #[test]
    fn single_band_keeps_its_hue() {
        let weights = srgb_weights(&[650.0], |nm| Illuminant::D65.relative_power(nm));
        assert!(weights[0][0] > 0.0 && weights[0][0] > 10.0 * weights[0][1].abs());
        assert_eq!(srgb_weights(&[900.0], |_| 1.0), [[0.0; 3]]);
        assert!(xyz_weights(&[]).is_empty());
    }

    #[test]
    fn srgb_transfer_function_matches_the_standard() {
        assert!((srgb_encode(0.5) - 0.735_356_9).abs() < 1e-6);
        for i in 0..=1000 {
            let v = f64::from(i) / 1000.0;
            assert!((srgb_encode(srgb_decode(v)) - v).abs() < 1e-6);
        }
        assert_eq!((srgb_encode(-1.0), srgb_encode(f64::NAN)), (0.0, 0.0));
        assert!((srgb_encode(2.0) - 1.0).abs() < 1e-12);
    }
}
