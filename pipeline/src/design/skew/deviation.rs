//! Errors of a built lens: what moves, about what, and what changes.
//!
//! Lengths in mm, angles in rad, right-handed, in the lens frame: z along the light at the first surface, also behind mirrors. A
//! motion of surfaces is a decentre and a shift, then tilts about x, y, z, about its pivot. Errors are listed from the outermost
//! group inwards ([`super::system`]).
//!
//! ```text
//! power of N fringes at λ on the semi-diameter S:    Δc = N λ/S²                     (sag N λ/2 at the edge)
//! irregularity of N fringes:                         sag = (N λ/4) ρ² cos 2(φ − φ₀),  ρ = r/S    (peak to valley N λ/2)
//! "mixed" (TIRR of OpticStudio):                     sag = (N λ/4) (ρ⁴ + ρ² cos²(φ − φ₀))
//! runout T (total indicator reading) of a wedge:     tilt T/(2 S)
//! ```
//! Source: ISO 10110-5 (fringe spacings); OpticStudio, help of the tolerance operands TFRN and TIRR.

use crate::design::prescription::freeform::XyTerm;
use crate::real;

/// An error of a built lens. Surfaces count from 0, the film is the last.
#[derive(Clone, Debug, PartialEq)]
pub enum Deviation {
    /// Surfaces that move as one body.
    Element {
        /// First and last surface.
        surfaces: [usize; 2],
        /// Decentre along x and y, mm.
        decentre_mm: [f64; 2],
        /// Tilts about x, y and z, rad.
        tilt_rad: [f64; 3],
        /// Tilts of the last surface about its vertex, about x and y, rad.
        wedge_rad: [f64; 2],
        /// Shift along z, mm.
        shift_mm: f64,
        /// What the tilts are about; `None` = the vertex of the first surface.
        pivot: Option<Pivot>,
    },
    /// One surface: about its own vertex, and its shape.
    Surface {
        /// The surface.
        surface: usize,
        /// Decentre along x and y, mm.
        decentre_mm: [f64; 2],
        /// Tilts about x and y, rad.
        tilt_rad: [f64; 2],
        /// Change of its shape.
        shape: ShapeChange,
    },
    /// The gap behind a surface: moves all surfaces behind it and the film.
    Gap {
        /// The surface before the gap.
        after: usize,
        /// Added thickness along the light, mm.
        thickness_mm: f64,
        /// The surface whose gap takes the thickness up, so that what is behind that stays in place.
        absorb: Option<usize>,
    },
    /// The glass behind a surface.
    Glass {
        /// The surface before the glass.
        after: usize,
        /// Added to its index at all wavelengths.
        index: f64,
        /// Relative change of its Abbe number: n − n_p is divided by 1 + this, n_p the index at the primary wavelength.
        abbe: f64,
    },
    /// The film, about its own centre.
    Film {
        /// Decentre along x and y of the lens frame, mm.
        decentre_mm: [f64; 2],
        /// Tilts about x and y, rad.
        tilt_rad: [f64; 2],
        /// Shift along z, mm.
        shift_mm: f64,
    },
}

/// A point that does not move when surfaces are tilted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pivot {
    /// The surface whose nominal vertex it is.
    pub surface: usize,
    /// Distance from the vertex along z, mm.
    pub offset_mm: f64,
}

/// Change of the shape of a surface; z along the light.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ShapeChange {
    /// Added curvature, 1/mm.
    pub curvature: f64,
    /// Added conic constant.
    pub conic: f64,
    /// Added sag.
    pub figure: Vec<XyTerm>,
}

impl Deviation {
    /// Surfaces `first` to `last` decentred (mm) and tilted (rad) about their first vertex.
    pub fn element(first: usize, last: usize, decentre_mm: [f64; 2], tilt_rad: [f64; 3]) -> Self {
        Self::Element {
            surfaces: [first, last],
            decentre_mm,
            tilt_rad,
            wedge_rad: [0.0; 2],
            shift_mm: 0.0,
            pivot: None,
        }
    }

    /// Whether it moves and changes nothing.
    pub fn is_none(&self) -> bool {
        let none = |numbers: &[f64]| numbers.iter().all(|v| *v == 0.0);
        match self {
            Self::Element { decentre_mm, tilt_rad, wedge_rad, shift_mm, surfaces: _, pivot: _ } => {
                none(decentre_mm) && none(tilt_rad) && none(wedge_rad) && *shift_mm == 0.0
            }
            Self::Surface { decentre_mm, tilt_rad, shape, surface: _ } => {
                let ShapeChange { curvature, conic, figure } = shape;
                let is_flat = figure.iter().all(|term| term.coefficient == 0.0);
                none(decentre_mm) && none(tilt_rad) && none(&[*curvature, *conic]) && is_flat
            }
            Self::Gap { thickness_mm, after: _, absorb: _ } => *thickness_mm == 0.0,
            Self::Glass { index, abbe, after: _ } => none(&[*index, *abbe]),
            Self::Film { decentre_mm, tilt_rad, shift_mm } => {
                none(decentre_mm) && none(tilt_rad) && *shift_mm == 0.0
            }
        }
    }
}

/// Change of curvature, 1/mm, of a surface of the radius `radius_mm` that becomes larger by `change_mm`; 0 for a plane.
pub fn curvature_of_radius(radius_mm: f64, change_mm: f64) -> f64 {
    match radius_mm.is_finite() {
        true => 1.0 / (radius_mm + change_mm) - 1.0 / radius_mm,
        false => 0.0,
    }
}

/// Change of curvature, 1/mm, of `fringes` of power at `wavelength_mm` on the semi-diameter `semi_diameter_mm`.
pub fn curvature_of_fringes(fringes: f64, wavelength_mm: f64, semi_diameter_mm: f64) -> f64 {
    fringes * wavelength_mm / (semi_diameter_mm * semi_diameter_mm)
}

/// Astigmatic irregularity of `fringes` at `wavelength_mm` on `semi_diameter_mm`, highest at the azimuth `azimuth_rad`.
pub fn irregularity(
    fringes: f64,
    wavelength_mm: f64,
    semi_diameter_mm: f64,
    azimuth_rad: f64,
) -> Vec<XyTerm> {
    let a = 0.25 * fringes * wavelength_mm / (semi_diameter_mm * semi_diameter_mm);
    let (sin, cos) = real::sin_cos(2.0 * azimuth_rad);
    vec![XyTerm::new(2, 0, a * cos), XyTerm::new(1, 1, 2.0 * a * sin), XyTerm::new(0, 2, -a * cos)]
}

/// Irregularity of `fringes` that is half spherical and half astigmatic.
pub fn mixed_irregularity(
    fringes: f64,
    wavelength_mm: f64,
    semi_diameter_mm: f64,
    azimuth_rad: f64,
) -> Vec<XyTerm> {
    let s2 = semi_diameter_mm * semi_diameter_mm;
    let [a, b] = [s2 * s2, s2].map(|v| 0.25 * fringes * wavelength_mm / v);
    let (sin, cos) = real::sin_cos(azimuth_rad);
    vec![
        XyTerm::new(4, 0, a),
        XyTerm::new(2, 2, 2.0 * a),
        XyTerm::new(0, 4, a),
        XyTerm::new(2, 0, b * cos * cos),
        XyTerm::new(1, 1, 2.0 * b * cos * sin),
        XyTerm::new(0, 2, b * sin * sin),
    ]
}

/// The Zernike polynomial of radial order `n` and azimuthal order `m` (m < 0: sine) of the `coefficient` in mm on the radius
/// `radius_mm`, exactly: standard (RMS over the circle = coefficient) if `is_normalised`, else fringe (peak = coefficient).
pub fn zernike(n: u32, m: i32, coefficient_mm: f64, radius_mm: f64, is_normalised: bool) -> Vec<XyTerm> {
    let mu = m.unsigned_abs();
    let factorial = |k: u32| (1..=k).fold(1.0, |f, i| f * f64::from(i));
    let binomial = |a: u32, b: u32| factorial(a) / (factorial(b) * factorial(a - b));
    let norm = if m == 0 { f64::from(n + 1) } else { 2.0 * f64::from(n + 1) };
    let scale = if is_normalised { coefficient_mm * norm.sqrt() } else { coefficient_mm };
    let mut terms = Vec::<XyTerm>::new();
    let mut add = |i: u32, j: u32, c: f64| match terms.iter_mut().find(|t| (t.i, t.j) == (i, j)) {
        Some(term) => term.coefficient += c,
        None => terms.push(XyTerm::new(i, j, c)),
    };
    // Re or Im of (x + iy)^mu times Σ_s (−1)^s (n−s)!/(s! (..)! (..)!) (x² + y²)^p.
    for s in 0..=(n - mu) / 2 {
        let sign = if s % 2 == 0 { 1.0 } else { -1.0 };
        let radial = sign * factorial(n - s)
            / (factorial(s) * factorial((n + mu) / 2 - s) * factorial((n - mu) / 2 - s));
        let p = (n - mu) / 2 - s;
        for q in 0..=p {
            for j in (0..=mu).filter(|j| (j % 2 == 0) == (m >= 0)) {
                let sign = if (j / 2) % 2 == 0 { 1.0 } else { -1.0 };
                let (i, j, c) = (mu - j + 2 * (p - q), j + 2 * q, sign * binomial(mu, j));
                let power = real::pow(radius_mm, f64::from(i + j));
                add(i, j, scale * radial * binomial(p, q) * c / power);
            }
        }
    }
    terms
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sag(terms: &[XyTerm], x: f64, y: f64) -> f64 {
        terms.iter().map(|t| t.coefficient * x.powi(t.i as i32) * y.powi(t.j as i32)).sum()
    }

    #[test]
    fn zernike_polynomials_in_closed_form() {
        for (x, y) in [(1.3, -0.4), (-2.0, 2.5), (0.2, 4.1)] {
            let (r, t) = (real::hypot(x, y) / 5.0, real::atan2(y, x));
            let (r2, r4) = (r * r, r * r * r * r);
            let expected = [
                ((2, 2), 6_f64.sqrt() * r2 * real::cos(2.0 * t)),
                ((2, -2), 6_f64.sqrt() * r2 * real::sin(2.0 * t)),
                ((3, -1), 8_f64.sqrt() * (3.0 * r2 * r - 2.0 * r) * real::sin(t)),
                ((4, 0), 5_f64.sqrt() * (6.0 * r4 - 6.0 * r2 + 1.0)),
                ((5, 3), 12_f64.sqrt() * (5.0 * r4 * r - 4.0 * r2 * r) * real::cos(3.0 * t)),
            ];
            for ((n, m), value) in expected {
                assert!((sag(&zernike(n, m, 1.0, 5.0, true), x, y) - value).abs() < 1e-13, "{n} {m}");
            }
            let fringe = sag(&zernike(4, 0, 0.3, 5.0, false), x, y);
            assert!((fringe - 0.3 * (6.0 * r4 - 6.0 * r2 + 1.0)).abs() < 1e-14);
        }
    }

    #[test]
    fn irregularities_in_closed_form() {
        let (n, um, s, phi) = (0.5, 546.1e-6, 12.0, 0.7);
        for (x, y) in [(1.3, -0.4), (-9.0, 2.5), (0.2, 11.0)] {
            let (rho, t) = (real::hypot(x, y) / s, real::atan2(y, x));
            let astigmatic = 0.25 * n * um * rho * rho * real::cos(2.0 * (t - phi));
            assert!((sag(&irregularity(n, um, s, phi), x, y) - astigmatic).abs() < 1e-18);
            let cos = real::cos(t - phi);
            let mixed = 0.25 * n * um * (rho * rho * rho * rho + rho * rho * cos * cos);
            assert!((sag(&mixed_irregularity(n, um, s, phi), x, y) - mixed).abs() < 1e-18);
        }
    }

    #[test]
    fn deviations_of_size_zero_are_none() {
        let surface =
            |shape| Deviation::Surface { surface: 1, decentre_mm: [0.0; 2], tilt_rad: [0.0, -0.0], shape };
        let shape = ShapeChange { figure: irregularity(0.0, 5e-4, 3.0, 0.3), ..ShapeChange::default() };
        let film = |shift_mm| Deviation::Film { decentre_mm: [0.0; 2], tilt_rad: [0.0; 2], shift_mm };
        let gap = |thickness_mm| Deviation::Gap { after: 1, thickness_mm, absorb: None };
        let glass = |abbe| Deviation::Glass { after: 1, index: 0.0, abbe };
        let element = |angle| Deviation::element(1, 2, [0.0; 2], [0.0, 0.0, angle]);
        let none = [element(0.0), surface(shape.clone()), film(0.0), gap(0.0), glass(0.0)];
        assert!(none.iter().all(Deviation::is_none));
        let figure = irregularity(1e-3, 5e-4, 3.0, 0.3);
        let some = [
            element(1e-9),
            surface(ShapeChange { figure, ..shape.clone() }),
            surface(ShapeChange { conic: 1e-9, ..shape }),
            film(1e-9),
            gap(1e-9),
            glass(1e-9),
        ];
        assert!(!some.iter().any(Deviation::is_none));
    }

    #[test]
    fn a_fringe_of_power_is_half_a_wavelength_of_sag() {
        let change = curvature_of_fringes(1.0, 546.1e-6, 10.0);
        assert!((0.5 * change * 100.0 - 0.5 * 546.1e-6).abs() < 1e-18);
        assert!((curvature_of_radius(50.0, 0.5) - (1.0 / 50.5 - 0.02)).abs() < 1e-18);
        assert_eq!(curvature_of_radius(f64::INFINITY, 0.5), 0.0);
    }
}
