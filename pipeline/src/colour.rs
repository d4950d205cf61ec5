//! Colour: what an eye would see of a stack of bands, and the spectra that colour charts are made of.
//!
//!   X = K_m ∫ L(λ)·x̄(λ) dλ   (Y with ȳ, Z with z̄),   K_m = 683 lm/W,   λ in nm
//! for spectral radiance L [W m⁻² sr⁻¹ nm⁻¹]; Y is then luminance in cd m⁻². Between bands L is taken as linear, so a
//! band's weight is ∫ x̄·hat_b dλ with hat_b the triangle between its neighbours; before the first and after the last
//! band L stays constant for half a spacing. A lone band stands for 10 nm.
//! Colour-matching functions, illuminants and ColorChecker reflectances are tables of 5 nm, linear between nodes.
//! XYZ becomes linear sRGB (IEC 61966-2-1,
//! D65 white) after Bradford adaptation (ICC.1:2010, annex E) from the remap's white.
//! Left out: observers other than the CIE 1931 2° one, fluorescence. Sources: `data/SOURCES.md`.

use crate::real;
use std::sync::OnceLock;

/// Luminous efficacy of radiation at 555 nm, lm/W.
pub const LUMINOUS_EFFICACY: f64 = 683.0;
/// First wavelength of the tables, nm.
pub const FIRST_NM: f64 = 380.0;
/// Last wavelength of the tables, nm.
pub const LAST_NM: f64 = 780.0;
/// Patches of a ColorChecker, row by row from "dark skin".
pub const CHECKER_PATCHES: usize = 24;
const STEP_NM: f64 = 5.0;

/// A light with a CIE table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum Illuminant {
    /// Average daylight, 6504 K.
    #[default]
    D65,
    /// Tungsten filament, 2856 K.
    A,
    /// Equal energy at every wavelength.
    E,
}

impl Illuminant {
    /// Every illuminant.
    pub const ALL: [Self; 3] = [Self::D65, Self::A, Self::E];

    /// Its CIE name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::D65 => "D65",
            Self::A => "A",
            Self::E => "E",
        }
    }

    /// Relative spectral power, 100 at 560 nm; 0 outside the tables.
    pub fn relative_power(self, wavelength_nm: f64) -> f64 {
        let column = match self {
            Self::A => 3,
            Self::D65 => 4,
            Self::E => 5,
        };
        observer_table().at(wavelength_nm)[column]
    }

    /// XYZ of a white that reflects all of this light, Y = 1.
    pub fn white(self) -> [f64; 3] {
        let xyz = integrate(|nm| self.relative_power(nm));
        xyz.map(|v| v / xyz[1])
    }

    /// Factor that turns [`relative_power`](Self::relative_power) into spectral irradiance [W m⁻² nm⁻¹] of
    /// `illuminance_lx` lux.
    pub fn irradiance_scale(self, illuminance_lx: f64) -> f64 {
        illuminance_lx / (LUMINOUS_EFFICACY * integrate(|nm| self.relative_power(nm))[1])
    }
}

impl std::str::FromStr for Illuminant {
    type Err = String;

    fn from_str(word: &str) -> Result<Self, String> {
        Self::ALL
            .into_iter()
            .find(|i| i.name().eq_ignore_ascii_case(word.trim()))
            .ok_or_else(|| format!("'{word}' is no illuminant known here; take D65, A or E"))
    }
}

/// The CIE 1931 2° colour-matching functions (x̄, ȳ, z̄) at a wavelength; 0 outside the tables.
pub fn observer(wavelength_nm: f64) -> [f64; 3] {
    let row = observer_table().at(wavelength_nm);
    [row[0], row[1], row[2]]
}

/// Reflectance of ColorChecker patch `patch` (0 to 23); beyond the tables it stays at the end's value.
///
/// # Panics
/// If `patch` is not below [`CHECKER_PATCHES`].
pub fn checker_reflectance(patch: usize, wavelength_nm: f64) -> f64 {
    assert!(patch < CHECKER_PATCHES, "a ColorChecker has {CHECKER_PATCHES} patches, not a number {patch}");
    checker_table().at(wavelength_nm.clamp(FIRST_NM, LAST_NM))[patch]
}

/// Names of the ColorChecker patches, in order.
pub fn checker_names() -> &'static [String] {
    &checker_table().names
}

/// Weights w with XYZ = Σ_b L_b·w_b for bands at `wavelengths_nm`, in any order and at any spacing (nm, and
/// [`LUMINOUS_EFFICACY`] in it: radiance in W m⁻² sr⁻¹ nm⁻¹ gives Y in cd m⁻²). Bands of one wavelength share its weight.
pub fn xyz_weights(wavelengths_nm: &[f64]) -> Vec<[f64; 3]> {
    let mut nm = wavelengths_nm.to_vec();
    nm.sort_by(f64::total_cmp);
    nm.dedup();
    let weight = |i: usize| {
        // Beyond its outermost neighbour a band stands for as much as it does on the inner side, at its own value.
        let below = i.checked_sub(1).map(|j| nm[i] - nm[j]);
        let above = nm.get(i + 1).map(|next| next - nm[i]);
        add(
            hat_side(nm[i], -below.or(above).unwrap_or(10.0), below.is_none()),
            hat_side(nm[i], above.or(below).unwrap_or(10.0), above.is_none()),
        )
    };
    let weights: Vec<[f64; 3]> = (0..nm.len()).map(weight).collect();
    let share = |own: &f64| {
        let bands = wavelengths_nm.iter().filter(|other| *other == own).count();
        weights[nm.partition_point(|v| v < own)].map(|v| v / bands as f64)
    };
    wavelengths_nm.iter().map(share).collect()
}

/// One side of a hat: ∫ cmf·(1 − |λ−c|/|reach|) over `reach` (signed), or ∫ cmf over half of it where `flat`.
fn hat_side(centre_nm: f64, reach: f64, flat: bool) -> [f64; 3] {
    let length = if flat { reach / 2.0 } else { reach };
    // Midpoint rule at ≤ 1 nm: a fifth of the tables' step. Beyond the tables nothing is left to add.
    let steps = length.abs().ceil().clamp(1.0, 2000.0);
    let step = length / steps;
    (0..steps as usize).fold([0.0; 3], |sum, k| {
        let offset = (k as f64 + 0.5) * step;
        let hat = if flat { 1.0 } else { 1.0 - offset / reach };
        add(sum, observer(centre_nm + offset).map(|v| v * hat * step.abs() * LUMINOUS_EFFICACY))
    })
}

/// Weights w with linear sRGB = Σ_b L_b·w_b, such that a white of spectral radiance `white(λ)` shows as (1, 1, 1).
///
/// The white is what the bands themselves make of it, so that greys stay grey, unless they see it so incompletely (a
/// few bands, or one) that its chromaticity is off by more than a tenth: then the full white's, at equal luminance, so
/// that a narrow band keeps its own hue. All weights are 0 where the bands see nothing of the white.
pub fn srgb_weights(wavelengths_nm: &[f64], white: impl Fn(f64) -> f64) -> Vec<[f64; 3]> {
    let weights = xyz_weights(wavelengths_nm);
    let sampled =
        weights.iter().zip(wavelengths_nm).fold([0.0; 3], |sum, (w, &nm)| add(sum, w.map(|v| v * white(nm))));
    let full = integrate(&white);
    if !(sampled[1] > 0.0 && full[1] > 0.0) {
        return vec![[0.0; 3]; weights.len()];
    }
    let full = full.map(|v| v / full[1]);
    let seen = sampled.map(|v| v / sampled[1]);
    let near = seen.iter().zip(full).all(|(s, f)| (s - f).abs() <= 0.1 * f);
    let to_d65 = adaptation(if near { seen } else { full }, Illuminant::D65.white());
    weights.iter().map(|&w| xyz_to_linear_srgb(times(&to_d65, w.map(|v| v / sampled[1])))).collect()
}

/// The Bradford matrix that takes XYZ seen under white `from` to XYZ seen under white `to`.
pub fn adaptation(from: [f64; 3], to: [f64; 3]) -> [[f64; 3]; 3] {
    const TO_CONES: [[f64; 3]; 3] =
        [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]];
    let back = inverse(&TO_CONES);
    let (a, b) = (times(&TO_CONES, from), times(&TO_CONES, to));
    let gains = [b[0] / a[0], b[1] / a[1], b[2] / a[2]];
    std::array::from_fn(|i| {
        std::array::from_fn(|j| (0..3).map(|k| back[i][k] * gains[k] * TO_CONES[k][j]).sum())
    })
}

/// XYZ (D65 white, Y = 1) to linear sRGB; out-of-gamut colours leave 0..1.
pub fn xyz_to_linear_srgb(xyz: [f64; 3]) -> [f64; 3] {
    static MATRIX: OnceLock<[[f64; 3]; 3]> = OnceLock::new();
    times(MATRIX.get_or_init(srgb_matrix), xyz)
}

/// From the primaries of ITU-R BT.709 and this module's own D65, so that white is (1, 1, 1) to the last digits.
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
pub fn srgb_decode(shown: f64) -> f64 {
    let v = shown.clamp(0.0, 1.0);
    if v <= 0.040_45 { v / 12.92 } else { real::pow((v + 0.055) / 1.055, 2.4) }
}

/// ∫ spectrum·cmf dλ over the tables, trapezoids between their nodes (at both ends the functions are below 1e-3 of their peak).
fn integrate(spectrum: impl Fn(f64) -> f64) -> [f64; 3] {
    let table = observer_table();
    table.rows.iter().enumerate().fold([0.0; 3], |sum, (i, row)| {
        let s = spectrum(FIRST_NM + i as f64 * STEP_NM) * STEP_NM;
        add(sum, [row[0] * s, row[1] * s, row[2] * s])
    })
}

struct Table {
    names: Vec<String>,
    rows: Vec<Vec<f64>>,
}

impl Table {
    /// Reads a table of the program's own; its shape is checked by the tests below.
    fn parse(csv: &str) -> Self {
        let mut lines = csv.lines();
        let names = lines.next().unwrap_or_default().split(',').skip(1).map(str::to_owned).collect();
        let numbers = |line: &str| line.split(',').skip(1).map(|v| v.parse().unwrap_or(f64::NAN)).collect();
        Self { names, rows: lines.map(numbers).collect() }
    }

    fn at(&self, wavelength_nm: f64) -> Vec<f64> {
        let position = (wavelength_nm - FIRST_NM) / STEP_NM;
        let last = self.rows.len() - 1;
        if !(0.0..=last as f64).contains(&position) {
            return vec![0.0; self.names.len()];
        }
        let i = (position as usize).min(last - 1);
        let t = position - i as f64;
        self.rows[i].iter().zip(&self.rows[i + 1]).map(|(a, b)| a + (b - a) * t).collect()
    }
}

fn observer_table() -> &'static Table {
    static TABLE: OnceLock<Table> = OnceLock::new();
    TABLE.get_or_init(|| Table::parse(include_str!("../data/cie1931-cmf-illuminants.csv")))
}

fn checker_table() -> &'static Table {
    static TABLE: OnceLock<Table> = OnceLock::new();
    TABLE.get_or_init(|| Table::parse(include_str!("../data/colorchecker24.csv")))
}

fn add(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

fn times(m: &[[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    m.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

fn inverse(m: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    // Cyclic indices give the cofactors their signs.
    let cofactor = |i: usize, j: usize| {
        let (a, b, c, d) = ((i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3);
        m[a][c] * m[b][d] - m[a][d] * m[b][c]
    };
    let determinant: f64 = (0..3).map(|j| m[0][j] * cofactor(0, j)).sum();
    std::array::from_fn(|i| std::array::from_fn(|j| cofactor(j, i) / determinant))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 8-bit sRGB of the patches as their maker published them.
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

    fn bands() -> Vec<f64> {
        (0..31).map(|i| 400.0 + 10.0 * f64::from(i)).collect()
    }

    fn see(nm: &[f64], weights: &[[f64; 3]], spectrum: impl Fn(f64) -> f64) -> [f64; 3] {
        nm.iter().zip(weights).fold([0.0; 3], |sum, (&nm, w)| add(sum, w.map(|v| v * spectrum(nm))))
    }

    #[test]
    fn tables_are_whole() {
        for (table, columns) in [(observer_table(), 6), (checker_table(), 24)] {
            assert_eq!((table.rows.len(), table.names.len()), (81, columns));
            assert!(table.rows.iter().all(|r| r.len() == columns && r.iter().all(|v| v.is_finite())));
        }
        assert_eq!(checker_names()[23], "black 2 (1.5 D)");
    }

    #[test]
    fn whites_lie_where_the_cie_puts_them() {
        for (light, x, y) in [
            (Illuminant::D65, 0.3127, 0.3290),
            (Illuminant::A, 0.4476, 0.4074),
            (Illuminant::E, 1.0 / 3.0, 1.0 / 3.0),
        ] {
            let w = light.white();
            let sum: f64 = w.iter().sum();
            assert!((w[0] / sum - x).abs() < 2e-4 && (w[1] / sum - y).abs() < 2e-4, "{light:?} {w:?}");
        }
    }

    #[test]
    fn white_is_white_in_any_light() {
        for light in Illuminant::ALL {
            let weights = srgb_weights(&bands(), |nm| light.relative_power(nm));
            for v in see(&bands(), &weights, |nm| light.relative_power(nm)) {
                assert!((v - 1.0).abs() < 1e-12, "{light:?} {v}");
            }
        }
        for v in xyz_to_linear_srgb(Illuminant::D65.white()) {
            assert!((v - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn colorchecker_looks_as_published() {
        let weights = srgb_weights(&bands(), |nm| Illuminant::D65.relative_power(nm));
        let mut total = 0.0;
        for (patch, want) in PUBLISHED.iter().enumerate() {
            let light = |nm| Illuminant::D65.relative_power(nm) * checker_reflectance(patch, nm);
            let rgb = see(&bands(), &weights, light).map(|v| 255.0 * srgb_encode(v));
            let worst = rgb.iter().zip(want).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            // The published values were made for D50 and adapted, from another average of charts.
            assert!(worst < 12.0, "{}: {rgb:?} for {want:?}", checker_names()[patch]);
            total += worst;
        }
        assert!(total / 24.0 < 5.0, "mean of the worst channels {}", total / 24.0);
    }

    #[test]
    fn luminance_does_not_depend_on_the_sampling() {
        let light = |nm| Illuminant::D65.relative_power(nm) * checker_reflectance(1, nm);
        let whole = integrate(light).map(|v| v * LUMINOUS_EFFICACY);
        let uneven: Vec<f64> =
            [700.0, 380.0].into_iter().chain((0..37).map(|i| 402.0 + 8.0 * f64::from(i))).collect();
        for (nm, tolerance) in [(bands(), 2e-3), (uneven, 5e-3)] {
            let y = see(&nm, &xyz_weights(&nm), light)[1];
            assert!((y / whole[1] - 1.0).abs() < tolerance, "{y} for {}", whole[1]);
        }
    }

    #[test]
    fn a_lone_band_keeps_its_hue() {
        let weights = srgb_weights(&[650.0], |nm| Illuminant::D65.relative_power(nm));
        assert!(weights[0][0] > 0.0 && weights[0][0] > 10.0 * weights[0][1].abs());
        assert_eq!(srgb_weights(&[900.0], |_| 1.0), [[0.0; 3]]);
        assert!(xyz_weights(&[]).is_empty());
    }

    #[test]
    fn a_kilolux_is_a_thousand_lux() {
        for light in Illuminant::ALL {
            let scale = light.irradiance_scale(1000.0);
            let lux = LUMINOUS_EFFICACY * integrate(|nm| scale * light.relative_power(nm))[1];
            assert!((lux - 1000.0).abs() < 1e-9);
        }
    }

    #[test]
    fn transfer_function_meets_the_standard() {
        assert!((srgb_encode(0.5) - 0.735_356_9).abs() < 1e-6);
        for i in 0..=1000 {
            let v = f64::from(i) / 1000.0;
            assert!((srgb_encode(srgb_decode(v)) - v).abs() < 1e-6);
        }
        assert_eq!((srgb_encode(-1.0), srgb_encode(f64::NAN)), (0.0, 0.0));
        assert!((srgb_encode(2.0) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn bands_of_one_wavelength_share_its_weight() {
        let [one, two] = [&[450.0, 550.0, 650.0][..], &[450.0, 550.0, 550.0, 650.0]].map(xyz_weights);
        assert_eq!((two[0], two[3]), (one[0], one[2]));
        for c in 0..3 {
            assert_eq!((two[1][c], two[2][c]), (one[1][c] / 2.0, one[1][c] / 2.0));
        }
        assert!(xyz_weights(&[550.0, 550.0]).iter().flatten().all(|v| v.is_finite() && *v > 0.0));
    }
}
