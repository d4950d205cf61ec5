//! CIE 1931 observer, illuminants and ColorChecker reflectances, and XYZ weights of bands.

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

/// An illuminant with a CIE table.
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

    /// XYZ of the perfect reflecting diffuser under this illuminant, Y = 1.
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

    fn from_str(name: &str) -> Result<Self, String> {
        Self::ALL
            .into_iter()
            .find(|i| i.name().eq_ignore_ascii_case(name.trim()))
            .ok_or_else(|| format!("'{name}' is not a known illuminant; use D65, A or E"))
    }
}

/// XYZ of light of `light` after a factor of each wavelength; Y = 1 for the factor 1.
pub fn reflected_xyz(light: Illuminant, factor: impl Fn(f64) -> f64) -> [f64; 3] {
    let white = integrate(|nm| light.relative_power(nm));
    integrate(|nm| light.relative_power(nm) * factor(nm)).map(|v| v / white[1])
}

/// The CIE 1931 2° colour-matching functions (x̄, ȳ, z̄) at a wavelength; 0 outside the tables.
pub fn observer(wavelength_nm: f64) -> [f64; 3] {
    let row = observer_table().at(wavelength_nm);
    [row[0], row[1], row[2]]
}

/// Reflectance of ColorChecker patch `patch` (0 to 23); beyond the tables that of their end.
///
/// # Panics
/// If `patch` is not below [`CHECKER_PATCHES`].
pub fn checker_reflectance(patch: usize, wavelength_nm: f64) -> f64 {
    assert!(patch < CHECKER_PATCHES, "patch {patch} of a ColorChecker of {CHECKER_PATCHES}");
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
        // An outermost band is extended outwards, at its own value, by as much as inwards.
        let below = i.checked_sub(1).map(|j| nm[i] - nm[j]);
        let above = nm.get(i + 1).map(|next| next - nm[i]);
        add(
            hat_side(nm[i], -below.or(above).unwrap_or(10.0), below.is_none()),
            hat_side(nm[i], above.or(below).unwrap_or(10.0), above.is_none()),
        )
    };
    let weights: Vec<[f64; 3]> = (0..nm.len()).map(weight).collect();
    let share = |wavelength: &f64| {
        let bands = wavelengths_nm.iter().filter(|other| *other == wavelength).count();
        weights[nm.partition_point(|v| v < wavelength)].map(|v| v / bands as f64)
    };
    wavelengths_nm.iter().map(share).collect()
}

/// One side of a hat: ∫ cmf·(1 − |λ−c|/|reach|) over `reach` (signed), or ∫ cmf over half of it where `flat`.
fn hat_side(centre_nm: f64, reach: f64, flat: bool) -> [f64; 3] {
    let length = if flat { reach / 2.0 } else { reach };
    // Midpoint rule at ≤ 1 nm, a fifth of the tables' step. Beyond the tables the functions are 0.
    let steps = length.abs().ceil().clamp(1.0, 2000.0);
    let step = length / steps;
    (0..steps as usize).fold([0.0; 3], |sum, k| {
        let offset = (k as f64 + 0.5) * step;
        let hat = if flat { 1.0 } else { 1.0 - offset / reach };
        add(sum, observer(centre_nm + offset).map(|v| v * hat * step.abs() * LUMINOUS_EFFICACY))
    })
}

/// ∫ spectrum·cmf dλ over the tables, trapezoids between their nodes (at both ends the functions are below 1e-3 of their peak).
pub(super) fn integrate(spectrum: impl Fn(f64) -> f64) -> [f64; 3] {
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
    /// Parses a built-in table; its shape is checked by the tests.
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
    TABLE.get_or_init(|| Table::parse(include_str!("../../data/cie1931-cmf-illuminants.csv")))
}

fn checker_table() -> &'static Table {
    static TABLE: OnceLock<Table> = OnceLock::new();
    TABLE.get_or_init(|| Table::parse(include_str!("../../data/colorchecker24.csv")))
}

pub(super) fn add(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in crate::colour) fn bands() -> Vec<f64> {
        (0..31).map(|i| 400.0 + 10.0 * f64::from(i)).collect()
    }

    pub(in crate::colour) fn weighted_sum(
        nm: &[f64],
        weights: &[[f64; 3]],
        spectrum: impl Fn(f64) -> f64,
    ) -> [f64; 3] {
        nm.iter().zip(weights).fold([0.0; 3], |sum, (&nm, w)| add(sum, w.map(|v| v * spectrum(nm))))
    }

    #[test]
    fn tables_are_complete() {
        for (table, columns) in [(observer_table(), 6), (checker_table(), 24)] {
            assert_eq!((table.rows.len(), table.names.len()), (81, columns));
            assert!(table.rows.iter().all(|r| r.len() == columns && r.iter().all(|v| v.is_finite())));
        }
        assert_eq!(checker_names()[23], "black 2 (1.5 D)");
    }

    #[test]
    fn chromaticities_of_illuminants_match_cie() {
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
    fn luminance_is_independent_of_sampling() {
        let light = |nm| Illuminant::D65.relative_power(nm) * checker_reflectance(1, nm);
        let integral = integrate(light).map(|v| v * LUMINOUS_EFFICACY);
        let uneven: Vec<f64> =
            [700.0, 380.0].into_iter().chain((0..37).map(|i| 402.0 + 8.0 * f64::from(i))).collect();
        for (nm, tolerance) in [(bands(), 2e-3), (uneven, 5e-3)] {
            let y = weighted_sum(&nm, &xyz_weights(&nm), light)[1];
            assert!((y / integral[1] - 1.0).abs() < tolerance, "{y} for {}", integral[1]);
        }
    }

    #[test]
    fn irradiance_scale_has_the_requested_illuminance() {
        for light in Illuminant::ALL {
            let scale = light.irradiance_scale(1000.0);
            let lux = LUMINOUS_EFFICACY * integrate(|nm| scale * light.relative_power(nm))[1];
            assert!((lux - 1000.0).abs() < 1e-9);
        }
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
