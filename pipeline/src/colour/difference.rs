//! Colour differences: CIE 1976 L*a*b* and CIEDE2000.
//!
//!   f(t) = ∛t for t > (6/29)³, else t/(3·(6/29)²) + 4/29
//!   L* = 116·f(Y/Yn) − 16,   a* = 500·(f(X/Xn) − f(Y/Yn)),   b* = 200·(f(Y/Yn) − f(Z/Zn))
//! ΔE₀₀ is ISO/CIE 11664-6 with k_L = k_C = k_H = 1, after G. Sharma, W. Wu, E. N. Dalal, "The CIEDE2000 color-difference formula:
//! implementation notes, supplementary test data, and mathematical observations", Color Research and Application 30 (2005).

use crate::real;

/// L*, a*, b* of a colour XYZ under the white `white`, both of the same scale.
pub fn lab(xyz: [f64; 3], white: [f64; 3]) -> [f64; 3] {
    const LIMIT: f64 = 6.0 / 29.0;
    let f = |t: f64| if t > LIMIT.powi(3) { real::cbrt(t) } else { t / (3.0 * LIMIT * LIMIT) + 4.0 / 29.0 };
    let [x, y, z]: [f64; 3] = std::array::from_fn(|i| f(xyz[i] / white[i]));
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// CIEDE2000 difference of two colours (L*, a*, b*).
pub fn delta_e_2000(first: [f64; 3], second: [f64; 3]) -> f64 {
    let seventh = |c: f64| (c.powi(7) / (c.powi(7) + 25f64.powi(7))).sqrt();
    let chroma = |lab: [f64; 3]| real::hypot(lab[1], lab[2]);
    let g = 0.5 * (1.0 - seventh((chroma(first) + chroma(second)) / 2.0));
    let polar = |lab: [f64; 3]| {
        let a = lab[1] * (1.0 + g);
        let hue = real::atan2(lab[2], a).to_degrees().rem_euclid(360.0);
        (real::hypot(a, lab[2]), hue)
    };
    let ((c1, h1), (c2, h2)) = (polar(first), polar(second));
    let grey = c1 * c2 == 0.0;
    let turn = h2 - h1;
    let hue_step = match () {
        () if grey => 0.0,
        () if turn > 180.0 => turn - 360.0,
        () if turn < -180.0 => turn + 360.0,
        () => turn,
    };
    let sum = h1 + h2;
    let mean_hue = match () {
        () if grey => sum,
        () if turn.abs() <= 180.0 => sum / 2.0,
        () if sum < 360.0 => (sum + 360.0) / 2.0,
        () => (sum - 360.0) / 2.0,
    };
    let sin = |degrees: f64| real::sin(degrees.to_radians());
    let cos = |degrees: f64| real::cos(degrees.to_radians());
    let (lightness, mean_chroma) = ((first[0] + second[0]) / 2.0, (c1 + c2) / 2.0);
    let t = 1.0 - 0.17 * cos(mean_hue - 30.0) + 0.24 * cos(2.0 * mean_hue) + 0.32 * cos(3.0 * mean_hue + 6.0)
        - 0.20 * cos(4.0 * mean_hue - 63.0);
    let offset = (lightness - 50.0) * (lightness - 50.0);
    let (s_l, s_c) = (1.0 + 0.015 * offset / (20.0 + offset).sqrt(), 1.0 + 0.045 * mean_chroma);
    let s_h = 1.0 + 0.015 * mean_chroma * t;
    let bend = (mean_hue - 275.0) / 25.0;
    let rotation = -sin(60.0 * real::exp(-bend * bend)) * 2.0 * seventh(mean_chroma);
    let (dl, dc) = ((second[0] - first[0]) / s_l, (c2 - c1) / s_c);
    let dh = 2.0 * (c1 * c2).sqrt() * sin(hue_step / 2.0) / s_h;
    (dl * dl + dc * dc + dh * dh + rotation * dc * dh).max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All 34 pairs of table 1 of Sharma, Wu and Dalal.
    const PAIRS: [([f64; 3], [f64; 3], f64); 34] = [
        ([50.0, 2.6772, -79.7751], [50.0, 0.0, -82.7485], 2.0425),
        ([50.0, 3.1571, -77.2803], [50.0, 0.0, -82.7485], 2.8615),
        ([50.0, 2.8361, -74.0200], [50.0, 0.0, -82.7485], 3.4412),
        ([50.0, -1.3802, -84.2814], [50.0, 0.0, -82.7485], 1.0),
        ([50.0, -1.1848, -84.8006], [50.0, 0.0, -82.7485], 1.0),
        ([50.0, -0.9009, -85.5211], [50.0, 0.0, -82.7485], 1.0),
        ([50.0, 0.0, 0.0], [50.0, -1.0, 2.0], 2.3669),
        ([50.0, -1.0, 2.0], [50.0, 0.0, 0.0], 2.3669),
        ([50.0, 2.4900, -0.0010], [50.0, -2.4900, 0.0009], 7.1792),
        ([50.0, 2.4900, -0.0010], [50.0, -2.4900, 0.0010], 7.1792),
        ([50.0, 2.4900, -0.0010], [50.0, -2.4900, 0.0011], 7.2195),
        ([50.0, 2.4900, -0.0010], [50.0, -2.4900, 0.0012], 7.2195),
        ([50.0, -0.0010, 2.4900], [50.0, 0.0009, -2.4900], 4.8045),
        ([50.0, -0.0010, 2.4900], [50.0, 0.0010, -2.4900], 4.8045),
        ([50.0, -0.0010, 2.4900], [50.0, 0.0011, -2.4900], 4.7461),
        ([50.0, 2.5, 0.0], [50.0, 0.0, -2.5], 4.3065),
        ([50.0, 2.5, 0.0], [73.0, 25.0, -18.0], 27.1492),
        ([50.0, 2.5, 0.0], [61.0, -5.0, 29.0], 22.8977),
        ([50.0, 2.5, 0.0], [56.0, -27.0, -3.0], 31.9030),
        ([50.0, 2.5, 0.0], [58.0, 24.0, 15.0], 19.4535),
        ([50.0, 2.5, 0.0], [50.0, 3.1736, 0.5854], 1.0),
        ([50.0, 2.5, 0.0], [50.0, 3.2972, 0.0], 1.0),
        ([50.0, 2.5, 0.0], [50.0, 1.8634, 0.5757], 1.0),
        ([50.0, 2.5, 0.0], [50.0, 3.2592, 0.3350], 1.0),
        ([60.2574, -34.0099, 36.2677], [60.4626, -34.1751, 39.4387], 1.2644),
        ([63.0109, -31.0961, -5.8663], [62.8187, -29.7946, -4.0864], 1.2630),
        ([61.2901, 3.7196, -5.3901], [61.4292, 2.2480, -4.9620], 1.8731),
        ([35.0831, -44.1164, 3.7933], [35.0232, -40.0716, 1.5901], 1.8645),
        ([22.7233, 20.0904, -46.6940], [23.0331, 14.9730, -42.5619], 2.0373),
        ([36.4612, 47.8580, 18.3852], [36.2715, 50.5065, 21.2231], 1.4146),
        ([90.8027, -2.0831, 1.4410], [91.1528, -1.6435, 0.0447], 1.4441),
        ([90.9257, -0.5406, -0.9208], [88.6381, -0.8985, -0.7239], 1.5381),
        ([6.7747, -0.2908, -2.4247], [5.8714, -0.0985, -2.2286], 0.6377),
        ([2.0776, 0.0795, -1.1350], [0.9033, -0.0636, -0.5514], 0.9082),
    ];

    #[test]
    fn published_pairs_have_their_differences() {
        for (first, second, expected) in PAIRS {
            for found in [delta_e_2000(first, second), delta_e_2000(second, first)] {
                // Published with four decimals.
                assert!(
                    (found - expected).abs() <= 5e-5 + 1e-9,
                    "{first:?} {second:?}: {found} for {expected}"
                );
            }
        }
    }

    #[test]
    fn white_and_grey_have_no_chroma() {
        let white = [0.95, 1.0, 1.09];
        assert_eq!(lab(white, white), [100.0, 0.0, 0.0]);
        let [l, a, b] = lab(white.map(|v| 0.184_186_5 * v), white);
        assert!((l - 50.0).abs() < 1e-3 && a.abs() < 1e-12 && b.abs() < 1e-12);
        assert_eq!(delta_e_2000([50.0, 0.0, 0.0], [50.0, 0.0, 0.0]), 0.0);
    }
}
