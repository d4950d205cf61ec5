//! Colour of a camera's raw by the matrices of its DNG.
//!
//! ```text
//! X = AB · CC · CM          XYZ to the camera, at the temperature T of the white
//! n = X · w                 neutral n of the camera, white w (Y = 1)
//! r = (AB · CC)⁻¹ · c       reference values of camera values c
//! XYZ (D65) = A(w → D65) · X⁻¹ · c,   or with a forward matrix A(D50 → D65) · FM · (r / r of n)
//! ```
//! CM (ColorMatrix), CC (CameraCalibration) and FM (ForwardMatrix) of two illuminants are interpolated linearly in 1/T. T follows from the white's
//! chromaticity, and the white from n by iteration, since X depends on T. A is Bradford's. The matrix of [`super::Recipe`] acts on balanced planes c/n and has rows of sum 1.
//! T = 449 m³ + 3525 m² + 6823.3 m + 5520.33 of m = (x − 0.3320)/(0.1858 − y) (McCamy, Color Res. Appl. 17, 142, 1992), within 2 K of blackbodies from 2856 to 6500 K.
//! Source: Adobe, Digital Negative Specification 1.4.0.0 (2012), chapter 6. Not included: hue and saturation tables, tone curves.

use crate::colour::{self, Illuminant, adaptation, inverse};

/// Rounds of the iteration, at most.
const ROUNDS: usize = 60;
/// XYZ of D50 (ICC).
const D50: [f64; 3] = [0.9642, 1.0, 0.8249];

/// Matrix of three rows.
type Matrix = [[f64; 3]; 3];

/// Matrices of a camera under a light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// Correlated colour temperature of the light, K, if it is known.
    pub temperature_k: Option<f64>,
    /// ColorMatrix.
    pub xyz_to_camera: Matrix,
    /// CameraCalibration.
    pub camera: Matrix,
    /// ForwardMatrix.
    pub forward: Option<Matrix>,
}

/// Colour of a camera in the light of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraProfile {
    /// Camera values of a white, the largest 1.
    pub neutral: [f64; 3],
    /// Chromaticity of the white.
    pub white_xy: [f64; 2],
    /// Rows from balanced planes to linear sRGB, of sum 1.
    pub rows: Matrix,
}

impl CameraProfile {
    /// The profile of one or two calibrations, an analog balance, and the neutral or the chromaticity of the white; `None` without a matrix or a white,
    /// or if they have no inverse.
    pub fn new(
        calibrations: Vec<Calibration>,
        balance: [f64; 3],
        neutral: Option<[f64; 3]>,
        white_xy: Option<[f64; 2]>,
    ) -> Option<Self> {
        calibrations.first()?;
        let at = |xy: [f64; 2]| matrices(&calibrations, balance, xy);
        let (neutral, xy) = match (neutral, white_xy) {
            (Some(n), _) => (n, white_of(n, &at)?),
            (None, Some(xy)) => (times(&at(xy).0, xyz_of(xy)), xy),
            (None, None) => return None,
        };
        let most = neutral.into_iter().fold(0.0, f64::max);
        let neutral = neutral.map(|v| v / most);
        let (to_camera, own, forward) = at(xy);
        let d65 = Illuminant::D65.white();
        // Columns: linear sRGB of a plane of balanced value 1.
        let plane = |k: usize| -> [f64; 3] {
            let mut balanced = [0.0; 3];
            balanced[k] = 1.0;
            let xyz = match forward {
                Some(forward) => {
                    // Reference camera values over those of the white.
                    let to_reference = inverse(&own);
                    let white = times(&to_reference, neutral);
                    let camera = std::array::from_fn(|i| balanced[i] * neutral[i]);
                    let reference = times(&to_reference, camera);
                    let ratio = std::array::from_fn(|i| reference[i] / white[i]);
                    times(&adaptation(D50, d65), times(&forward, ratio))
                }
                None => {
                    let camera = std::array::from_fn(|i| balanced[i] * neutral[i]);
                    times(&adaptation(xyz_of(xy), d65), times(&inverse(&to_camera), camera))
                }
            };
            colour::xyz_to_linear_srgb(xyz)
        };
        let columns = [plane(0), plane(1), plane(2)];
        let rows: Matrix = std::array::from_fn(|i| {
            let row = [columns[0][i], columns[1][i], columns[2][i]];
            let sum: f64 = row.iter().sum();
            row.map(|v| v / sum)
        });
        let is_finite = rows.iter().flatten().chain(&neutral).all(|v| v.is_finite()) && most > 0.0;
        let is_positive = neutral.iter().all(|v| *v > 0.0);
        (is_finite && is_positive).then_some(Self { neutral, white_xy: xy, rows })
    }
}

/// XYZ to the camera, its calibration part, and the forward matrix under a white.
fn matrices(
    calibrations: &[Calibration],
    balance: [f64; 3],
    xy: [f64; 2],
) -> (Matrix, Matrix, Option<Matrix>) {
    let (first, last) = (&calibrations[0], &calibrations[calibrations.len() - 1]);
    let share = match (first.temperature_k, last.temperature_k) {
        (Some(a), Some(b)) if a != b => {
            let t = temperature_k(xy).clamp(a.min(b), a.max(b));
            (1.0 / t - 1.0 / b) / (1.0 / a - 1.0 / b)
        }
        _ => 1.0,
    };
    let mix = |of: &dyn Fn(&Calibration) -> Matrix| -> Matrix {
        let (a, b) = (of(first), of(last));
        std::array::from_fn(|i| std::array::from_fn(|j| share * a[i][j] + (1.0 - share) * b[i][j]))
    };
    let camera = mix(&|c| c.camera);
    let own: Matrix = std::array::from_fn(|i| camera[i].map(|v| v * balance[i]));
    let colour = mix(&|c| c.xyz_to_camera);
    let product =
        std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| own[i][k] * colour[k][j]).sum()));
    let forward = first.forward.zip(last.forward).map(|_| mix(&|c| c.forward.unwrap_or_default()));
    (product, own, forward)
}

/// Chromaticity of the white that the camera sees as `neutral`.
fn white_of(
    neutral: [f64; 3],
    at: &dyn Fn([f64; 2]) -> (Matrix, Matrix, Option<Matrix>),
) -> Option<[f64; 2]> {
    let mut xy = xy_of(D50);
    for _ in 0..ROUNDS {
        let next = xy_of(times(&inverse(&at(xy).0), neutral));
        if next.iter().any(|v| !v.is_finite() || *v <= 0.0) {
            return None;
        }
        let moved = (next[0] - xy[0]).abs() + (next[1] - xy[1]).abs();
        xy = next;
        if moved < 1e-9 {
            break;
        }
    }
    Some(xy)
}

/// Correlated colour temperature of a chromaticity, K.
pub fn temperature_k([x, y]: [f64; 2]) -> f64 {
    let m = (x - 0.3320) / (0.1858 - y);
    let t = ((449.0 * m + 3525.0) * m + 6823.3) * m + 5520.33;
    if t.is_finite() { t.clamp(1000.0, 100_000.0) } else { 5003.0 }
}

fn xyz_of([x, y]: [f64; 2]) -> [f64; 3] {
    [x / y, 1.0, (1.0 - x - y) / y]
}

fn xy_of([x, y, z]: [f64; 3]) -> [f64; 2] {
    let sum = x + y + z;
    [x / sum, y / sum]
}

fn times(m: &Matrix, v: [f64; 3]) -> [f64; 3] {
    m.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

#[cfg(test)]
mod tests {
    use super::*;

    const ONE: Matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    /// XYZ to linear sRGB, roughly.
    const SRGB: Matrix = [[3.24, -1.54, -0.5], [-0.97, 1.88, 0.04], [0.06, -0.2, 1.06]];
    const WARM: Matrix = [[2.9, -1.2, -0.4], [-0.9, 1.8, 0.1], [0.0, -0.3, 1.4]];

    fn calibration(temperature_k: f64, xyz_to_camera: Matrix) -> Calibration {
        Calibration { temperature_k: Some(temperature_k), xyz_to_camera, camera: ONE, forward: None }
    }

    #[test]
    fn temperatures_of_illuminants_are_met() {
        assert!((temperature_k(xy_of(Illuminant::D65.white())) - 6504.0).abs() < 5.0);
        assert!((temperature_k(xy_of(Illuminant::A.white())) - 2856.0).abs() < 5.0);
    }

    #[test]
    fn camera_of_known_matrix_gives_back_colours() {
        let d65 = Illuminant::D65.white();
        let two = vec![calibration(2856.0, WARM), calibration(6504.0, SRGB)];
        let profile = CameraProfile::new(two, [1.0; 3], Some(times(&SRGB, d65)), None).unwrap();
        assert!(std::iter::zip(profile.white_xy, xy_of(d65)).all(|(a, b)| (a - b).abs() < 1e-4));
        for rgb in [[0.2, 0.5, 0.1], [0.9, 0.1, 0.3], [1.0, 1.0, 1.0]] {
            let camera = times(&SRGB, colour::linear_srgb_to_xyz(rgb));
            let white = times(&SRGB, d65);
            let balanced = std::array::from_fn(|i| camera[i] / white[i]);
            let found = times(&profile.rows, balanced);
            assert!(std::iter::zip(found, rgb).all(|(f, e)| (f - e).abs() < 2e-3), "{found:?} {rgb:?}");
        }
    }

    #[test]
    fn neutral_of_a_white_between_two_lights_is_found_again() {
        let two = || vec![calibration(2856.0, WARM), calibration(6504.0, SRGB)];
        let xy = [0.38, 0.377];
        let from_xy = CameraProfile::new(two(), [1.0, 0.9, 1.1], None, Some(xy)).unwrap();
        let again = CameraProfile::new(two(), [1.0, 0.9, 1.1], Some(from_xy.neutral), None).unwrap();
        assert!(std::iter::zip(again.white_xy, xy).all(|(a, b)| (a - b).abs() < 1e-7), "{again:?}");
        for (a, b) in std::iter::zip(again.rows.as_flattened(), from_xy.rows.as_flattened()) {
            assert!((a - b).abs() < 1e-6);
        }
    }

    #[test]
    fn forward_matrix_maps_the_neutral_to_white() {
        let forward = Some([[0.6, 0.2, 0.1642], [0.3, 0.6, 0.1], [0.0, 0.1, 0.7249]]);
        let one = Calibration { forward, camera: WARM, ..calibration(5003.0, SRGB) };
        let found = CameraProfile::new(vec![one], [1.0; 3], Some([0.5, 1.0, 0.7]), None).unwrap();
        let sums = found.rows.map(|row| row.iter().sum::<f64>());
        assert!(sums.iter().all(|s| (s - 1.0).abs() < 1e-12));
    }

    #[test]
    fn missing_or_singular_matrices_have_no_profile() {
        assert!(CameraProfile::new(Vec::new(), [1.0; 3], Some([1.0; 3]), None).is_none());
        assert!(CameraProfile::new(vec![calibration(5000.0, ONE)], [1.0; 3], None, None).is_none());
        let singular = calibration(5000.0, [[1.0; 3]; 3]);
        assert!(CameraProfile::new(vec![singular], [1.0; 3], Some([1.0; 3]), None).is_none());
    }
}
