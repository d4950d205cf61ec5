//! The response of pixels to light from the side, and of plates in front of them.
//!
//! A ray of direction cosines p = (right, down) in air has in the layers between microlens and photodiode (index n) the slope
//!
//! ```text
//! u(p) = p / √(n² − |p|²)                          it lands h·u beside the foot of its microlens, h: height of the layers
//! v    = u(p) − u_0                                u_0: the slope of the chief ray for which the microlens is shifted: the lens's, or of a table over the height, away from the axis
//! ```
//! The response relative to perpendicular light, S_c of filter c, is a function of v alone, so h is not needed:
//!
//! ```text
//! model:     S = 2^−(|v| / v_½)^k                  v_½: slope at the angle of half response, k: 2 (Gaussian), 4, 6 or 8
//! table:     S(|v|), or H(v_right) V(v_down)       linear in the slope between measured angles, the last value beyond, divided by the value at 0
//! spectral:  S(v; λ)                               such tables at some wavelengths, linear between them, the first and the last beyond
//! ```
//! A plate of index n_p with transmittance T(λ) at normal incidence has at the sine s of the angle
//!
//! ```text
//! interference:  T(λ, s) = T(λ / √(1 − s²/n_p²))                  edges move to shorter wavelengths; n_p: effective index of the layers
//! absorbing:     T(λ, s) = T̂ (T(λ)/T̂)^(1/√(1 − s²/n_p²))         the way in the glass is longer; T̂: largest T, which surfaces leave, as at normal incidence
//! ```
//! A pixel's signal is the mean over its cone of directions ([`crate::lens::cone_field`]) of S times the response behind the plates.
//! Sources: P. B. Catrysse, X. Liu and A. El Gamal, Proc. SPIE 3965, 420 (2000), pixel vignetting; H. A. Macleod, Thin-Film Optical Filters, effective index.
//! Left out: light that lands in a neighbour, polarisation, reflections between plates.

use super::curve::Curve;
use super::quantile::{exp, ln};
use crate::lens::cone_field::PlacedCone;
use crate::real;
use std::f64::consts::{LN_2, PI, TAU};

/// The response of a sensor's pixels over the angle of incidence.
#[derive(Clone, Debug, PartialEq)]
pub struct AngularResponse {
    /// Index of the layers between microlenses and photodiodes.
    pub stack_index: f64,
    /// For which chief rays the microlenses are shifted.
    pub microlenses: Microlenses,
    /// Of each channel.
    pub channels: Vec<Acceptance>,
}

/// Shift of the microlenses towards the axis.
#[derive(Clone, Debug, PartialEq)]
pub enum Microlenses {
    /// None.
    Centred,
    /// That for the chief rays of the lens of the film.
    OfLens,
    /// That for the chief rays of a table: heights, mm, ascending from 0, and sines of their angles.
    Table(Vec<(f64, f64)>),
}

/// Response of a channel over the slope in the layers.
#[derive(Clone, Debug, PartialEq)]
pub struct Acceptance {
    /// Wavelengths of the responses, ascending, nm; none for one that is the same at all.
    pub wavelengths_nm: Vec<f64>,
    /// The responses.
    pub responses: Vec<Response>,
}

/// A response over slopes, 1 at 0.
#[derive(Clone, Debug, PartialEq)]
pub enum Response {
    /// 2^−(|v|/v_½)^k.
    Model {
        /// v_½.
        half_slope: f64,
        /// k/2.
        half_exponent: u32,
    },
    /// The same in all directions.
    Radial(SlopeTable),
    /// The product of one along columns and one along rows.
    Separable {
        /// Over slopes to the right.
        horizontal: SlopeTable,
        /// Over slopes down.
        vertical: SlopeTable,
    },
}

impl From<Response> for Acceptance {
    fn from(response: Response) -> Self {
        Self { wavelengths_nm: Vec::new(), responses: vec![response] }
    }
}

/// Values over slopes, 1 at 0.
#[derive(Clone, Debug, PartialEq)]
pub struct SlopeTable {
    slopes: Vec<f64>,
    values: Vec<f64>,
}

impl SlopeTable {
    /// From sines of angles in air, ascending, with 0 between the first and the last, and their `responses`, which are divided by the one at 0.
    pub fn new(sines: &[f64], responses: &[f64], stack_index: f64) -> Self {
        let slopes = sines.iter().map(|s| slope(*s, stack_index)).collect();
        let mut table = Self { slopes, values: responses.to_vec() };
        let at_zero = table.at(0.0);
        table.values.iter_mut().for_each(|v| *v /= at_zero);
        table
    }

    fn at(&self, slope: f64) -> f64 {
        self.at_near(slope, &mut 0)
    }

    /// The value at `slope`; `above` becomes the index of the first slope above it, and is best near it before.
    fn at_near(&self, slope: f64, above: &mut usize) -> f64 {
        let (x, y) = (&self.slopes, &self.values);
        while *above < x.len() && x[*above] <= slope {
            *above += 1;
        }
        while *above > 0 && x[*above - 1] > slope {
            *above -= 1;
        }
        match *above {
            0 => y[0],
            i if i == x.len() => y[i - 1],
            i => y[i - 1] + (y[i] - y[i - 1]) * ((slope - x[i - 1]) / (x[i] - x[i - 1])),
        }
    }
}

/// Slope in a medium of index `index` of a ray with the sine `sine` in air.
pub fn slope(sine: f64, index: f64) -> f64 {
    sine / (index * index - sine * sine).sqrt()
}

impl Acceptance {
    /// The response at a wavelength and slopes to the right and down, 1 at 0.
    pub fn at_nm(&self, nm: f64, slope: [f64; 2]) -> f64 {
        let of = |(k, response): (usize, &Response)| self.share(k, nm) * response.at(slope);
        self.responses.iter().enumerate().map(of).sum()
    }

    /// Share of response `number` at a wavelength: linear between theirs.
    pub fn share(&self, number: usize, nm: f64) -> f64 {
        let (x, last) = (&self.wavelengths_nm, self.responses.len() - 1);
        let to = |other: usize| ((nm - x[other]) / (x[number] - x[other])).max(0.0);
        match x.get(number) {
            Some(own) if nm < *own && number > 0 => to(number - 1),
            Some(own) if nm > *own && number < last => to(number + 1),
            _ => 1.0,
        }
    }

    /// Adds all numbers that determine it.
    fn add_numbers(&self, numbers: &mut Vec<f64>) {
        if !self.wavelengths_nm.is_empty() {
            numbers.extend([-3.0, self.responses.len() as f64]);
            numbers.extend(&self.wavelengths_nm);
        }
        self.responses.iter().for_each(|response| response.add_numbers(numbers));
    }
}

impl Response {
    /// At a slope (right, down).
    pub(super) fn at(&self, slope: [f64; 2]) -> f64 {
        let mut response = [0.0];
        self.at_all(&[slope], &mut response);
        response[0]
    }

    /// Fills `out` with the responses at `slopes`; fastest if slopes are near the ones before.
    pub(super) fn at_all(&self, slopes: &[[f64; 2]], out: &mut [f64]) {
        let square = |[right, down]: &[f64; 2]| right * right + down * down;
        let all = out.iter_mut().zip(slopes);
        match self {
            Self::Model { half_slope, half_exponent } => all.for_each(|(to, slope)| {
                let ratio = square(slope) / (half_slope * half_slope);
                let power = (1..*half_exponent).fold(ratio, |power, _| power * ratio);
                *to = exp(-LN_2 * power);
            }),
            Self::Radial(table) => {
                let mut above = 0;
                all.for_each(|(to, slope)| *to = table.at_near(square(slope).sqrt(), &mut above));
            }
            Self::Separable { horizontal, vertical } => {
                let (mut i, mut k) = (0, 0);
                all.for_each(|(to, [right, down])| {
                    *to = horizontal.at_near(*right, &mut i) * vertical.at_near(*down, &mut k);
                });
            }
        }
    }

    /// Adds all numbers that determine it.
    fn add_numbers(&self, numbers: &mut Vec<f64>) {
        let mut tables = |kind: f64, tables: &[&SlopeTable]| {
            numbers.push(kind);
            numbers.extend(tables.iter().flat_map(|table| table.slopes.iter().chain(&table.values)));
        };
        match self {
            Self::Model { half_slope, half_exponent } => {
                numbers.extend([*half_slope, f64::from(*half_exponent)])
            }
            Self::Radial(table) => tables(-1.0, &[table]),
            Self::Separable { horizontal, vertical } => tables(-2.0, &[horizontal, vertical]),
        }
    }
}

impl AngularResponse {
    /// All numbers that determine it, for an identity.
    pub fn numbers(&self) -> Vec<f64> {
        let mut numbers = vec![self.stack_index];
        match &self.microlenses {
            Microlenses::Centred => numbers.push(0.0),
            Microlenses::OfLens => numbers.push(1.0),
            Microlenses::Table(rows) => {
                numbers.push(2.0);
                numbers.extend(rows.iter().flat_map(|(height_mm, sine)| [*height_mm, *sine]));
            }
        }
        self.channels.iter().for_each(|channel| channel.add_numbers(&mut numbers));
        numbers
    }

    /// The slope (right, down) for which the microlens is shifted at `height_mm` from the axis in the direction `away` (right, down), where the lens has `cone`.
    pub(super) fn shift(&self, (height_mm, away): (f64, [f64; 2]), cone: &PlacedCone) -> [f64; 2] {
        let sine = match &self.microlenses {
            Microlenses::Centred => return [0.0; 2],
            Microlenses::OfLens => {
                let [l, m] = cone.chief;
                let scale = (self.stack_index * self.stack_index - (l * l + m * m)).sqrt();
                return cone.on_film([l / scale, m / scale]);
            }
            Microlenses::Table(rows) => {
                let i = rows.partition_point(|row| row.0 <= height_mm).clamp(1, rows.len() - 1);
                let ((a, from), (b, to)) = (rows[i - 1], rows[i]);
                from + (to - from) * ((height_mm - a) / (b - a)).min(1.0)
            }
        };
        away.map(|v| slope(sine, self.stack_index) * v)
    }

    /// Slope (right, down) of the ray `direction` (right, down) from `shift`.
    pub(super) fn slope_of(&self, [x, y]: [f64; 2], shift: [f64; 2]) -> [f64; 2] {
        let per_sine = 1.0 / (self.stack_index * self.stack_index - x * x - y * y).sqrt();
        [x * per_sine - shift[0], y * per_sine - shift[1]]
    }

    /// The first channel with the response of each.
    pub(super) fn first_alike(&self) -> Vec<usize> {
        let first = |c: &Acceptance| self.channels.iter().position(|own| own == c).unwrap_or_default();
        self.channels.iter().map(first).collect()
    }
}

/// How a plate's transmittance depends on the angle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlateKind {
    /// Thin layers.
    Interference,
    /// Coloured glass.
    Absorbing,
}

/// A plate in front of all pixels: cover glass or filter.
#[derive(Clone, Debug, PartialEq)]
pub struct Plate {
    /// Transmittance at normal incidence.
    pub curve: Curve,
    /// Its dependence on the angle.
    pub kind: PlateKind,
    /// Index, or effective index of the layers.
    pub index: f64,
}

impl Plate {
    /// All numbers that determine it, for an identity.
    pub fn numbers(&self) -> Vec<f64> {
        let kind = match self.kind {
            PlateKind::Interference => 0.0,
            PlateKind::Absorbing => 1.0,
        };
        let curve = self.curve.wavelengths_nm.iter().chain(&self.curve.values);
        [kind, self.index].iter().chain(curve).copied().collect()
    }

    /// cos of the angle in the plate for the square of the sine in air.
    fn cosine(&self, sine_square: f64) -> f64 {
        (1.0 - sine_square / (self.index * self.index)).sqrt()
    }

    /// Transmittance at `nm`.
    pub fn at(&self, nm: f64, sine_square: f64) -> f64 {
        if sine_square == 0.0 {
            return self.curve.at(nm);
        }
        let cosine = self.cosine(sine_square);
        match self.kind {
            PlateKind::Interference => self.curve.at(nm / cosine),
            PlateKind::Absorbing => {
                let value = self.curve.at(nm);
                let top = self.curve.values.iter().copied().fold(0.0, f64::max);
                if value > 0.0 { top * exp(ln(value / top) / cosine) } else { 0.0 }
            }
        }
    }

    /// Wavelengths between which the transmittance is smooth, nm.
    pub fn nodes_nm(&self, sine_square: f64) -> impl Iterator<Item = f64> {
        let scale = match self.kind {
            PlateKind::Interference if sine_square > 0.0 => self.cosine(sine_square),
            _ => 1.0,
        };
        self.curve.wavelengths_nm.iter().map(move |nm| nm * scale)
    }
}

/// Radii of the rule over a cone, and directions around its middle.
/// Of tables the rule blunts kinks: with angles 10 degrees apart means are wrong by up to 1e-3.
const RINGS: usize = 8;
const SPOKES: usize = 16;

/// Nodes (along, across) of the unit disc and their weights, of sum 1: exact for polynomials up to degree 15.
pub(super) fn disc() -> Vec<([f64; 2], f64)> {
    let mut nodes = Vec::with_capacity(RINGS * SPOKES);
    // Even area: Gauss's rule over the square of the radius.
    for (square, weight) in crate::design::quadrature::unit_interval(RINGS).iter() {
        let radius = square.sqrt();
        for spoke in 0..SPOKES {
            let angle = TAU * (spoke as f64 + 0.5) / SPOKES as f64;
            nodes.push(([radius * real::cos(angle), radius * real::sin(angle)], weight / SPOKES as f64));
        }
    }
    nodes
}

/// Radians of degrees.
pub fn radians(degrees: f64) -> f64 {
    degrees * (PI / 180.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::cone::Cone;

    fn mean(cone: &Cone, f: impl Fn(f64, f64) -> f64) -> f64 {
        let cone = PlacedCone::symmetric(cone, [1.0, 0.0]);
        let at_node = |(at, w): ([f64; 2], f64)| {
            let [l, m] = cone.direction(at);
            w * f(l, m)
        };
        disc().into_iter().map(at_node).sum()
    }

    #[test]
    fn means_over_a_cone_have_their_closed_forms() {
        let s: f64 = 0.4;
        let cone = Cone { chief: 0.0, centre: 0.0, tangential: s, sagittal: s };
        // cos⁴ of the angle of incidence: (1 − l² − m²)².
        let found = mean(&cone, |l, m| (1.0 - l * l - m * m).powi(2));
        assert!((found - (1.0 - s.powi(2) + s.powi(4) / 3.0)).abs() < 1e-14, "{found}");
        // A Gaussian in the direction cosines.
        let k = 9.0;
        let found = mean(&cone, |l, m| (-k * (l * l + m * m)).exp());
        let expected = (1.0 - (-k * s * s).exp()) / (k * s * s);
        assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
        // Moments of the ellipse.
        let cone = Cone { chief: 0.1, centre: 0.12, tangential: 0.2, sagittal: 0.3 };
        assert!((mean(&cone, |l, _| l) - 0.12).abs() < 1e-15);
        assert!((mean(&cone, |l, _| (l - 0.12).powi(2)) - 0.01).abs() < 1e-15);
        assert!((mean(&cone, |_, m| m * m) - 0.0225).abs() < 1e-15);
    }

    #[test]
    fn response_is_half_at_the_angle_of_half_response_and_one_along_a_matched_ray() {
        let half_slope = slope(0.4, 1.6);
        let response = AngularResponse {
            stack_index: 1.6,
            microlenses: Microlenses::OfLens,
            channels: vec![
                Response::Model { half_slope, half_exponent: 1 }.into(),
                Response::Model { half_slope, half_exponent: 3 }.into(),
            ],
        };
        let centred = AngularResponse { microlenses: Microlenses::Centred, ..response.clone() };
        let cone = |away| {
            let cone = Cone { chief: 0.3, centre: 0.3, tangential: 0.1, sagittal: 0.1 };
            PlacedCone::symmetric(&cone, away)
        };
        let ahead = [1.0, 0.0];
        let slope_of_half = centred.slope_of([0.24, 0.32], centred.shift((5.0, ahead), &cone(ahead)));
        for found in centred.channels.iter().map(|channel| channel.at_nm(550.0, slope_of_half)) {
            assert!((found - 0.5).abs() < 1e-15, "{found}");
        }
        assert_eq!(centred.first_alike(), [0, 1]);
        // The chief ray at 45 degrees to the rows.
        let away = [0.6, 0.8];
        let matched = response.slope_of([0.3 * 0.6, 0.3 * 0.8], response.shift((5.0, away), &cone(away)));
        for found in response.channels.iter().map(|channel| channel.at_nm(550.0, matched)) {
            assert!((found - 1.0).abs() < 1e-15, "{found}");
        }
        let table = Microlenses::Table(vec![(0.0, 0.0), (4.0, 0.2), (8.0, 0.3)]);
        let table = AngularResponse { microlenses: table, ..response };
        assert_eq!(table.shift((2.0, ahead), &cone(ahead)), [slope(0.1, 1.6), 0.0]);
        assert_eq!(table.shift((9.0, away), &cone(away)), away.map(|v| v * slope(0.3, 1.6)));
    }

    #[test]
    fn a_spectral_response_is_linear_between_its_wavelengths_and_constant_beyond() {
        let radial = |at_half: f64| Response::Radial(SlopeTable::new(&[0.0, 0.5], &[1.0, at_half], 1.0));
        let responses = vec![radial(0.2), radial(0.4), radial(1.0)];
        let of = Acceptance { wavelengths_nm: vec![450.0, 550.0, 600.0], responses };
        let at = slope(0.5, 1.0);
        for (nm, expected) in [(400.0, 0.2), (475.0, 0.25), (550.0, 0.4), (590.0, 0.88), (700.0, 1.0)] {
            let found = of.at_nm(nm, [0.0, at]);
            assert!((found - expected).abs() < 1e-15, "{nm} nm: {found}");
            assert!(((0..3).map(|part| of.share(part, nm)).sum::<f64>() - 1.0).abs() < 1e-15);
        }
    }

    #[test]
    fn edge_of_an_interference_filter_moves_to_shorter_wavelengths_and_absorption_grows() {
        let curve =
            Curve { wavelengths_nm: vec![400.0, 640.0, 660.0, 700.0], values: vec![0.9, 0.9, 0.0, 0.0] };
        let plate = |kind| Plate { curve: curve.clone(), kind, index: 1.8 };
        let s2: f64 = 0.25;
        let cosine = (1.0 - s2 / (1.8 * 1.8)).sqrt();
        let found = plate(PlateKind::Interference).at(650.0 * cosine, s2);
        assert!((found - 0.45).abs() < 1e-12, "{found}");
        assert_eq!(plate(PlateKind::Interference).at(650.0, 0.0), plate(PlateKind::Absorbing).at(650.0, 0.0));
        let absorbing = plate(PlateKind::Absorbing);
        assert!((absorbing.at(500.0, s2) - 0.9).abs() < 1e-15);
        assert!((absorbing.at(650.0, s2) - 0.9 * 0.5f64.powf(1.0 / cosine)).abs() < 1e-12);
    }
}
