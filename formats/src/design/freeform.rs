//! Shapes without rotational symmetry in the conventions of design programs. Lengths in mm.
//!
//! ```text
//! extended polynomial   Σ A_k (x/R)^i (y/R)^j      k = 1, 2, …: x, y, x², xy, y², x³, x²y, …      A_k in mm, R the norm radius
//! Zernike polynomials   Σ A_k Z_k(r/R, φ)          φ from +x towards +y                           A_k in mm
//! ```
//!
//! | numbering of Z_k | k | order | normalised |
//! |---|---|---|---|
//! | [`Zernike::Noll`] (OpticStudio: standard) | from 1 | 1, ρ cos φ, ρ sin φ, 2ρ² − 1, ρ² sin 2φ, ρ² cos 2φ, … | RMS 1 over the circle |
//! | [`Zernike::Fringe`] | 1 to 37 | 1, ρ cos φ, ρ sin φ, 2ρ² − 1, ρ² cos 2φ, ρ² sin 2φ, (3ρ² − 2)ρ cos φ, …; the 37th is that of ρ¹² | peak 1 |
//! | [`Zernike::FringeOnwards`] (Optiland: fringe) | from 1 | as those before the 37th, without end | peak 1 |
//! | [`Zernike::Osa`] (Optiland: standard) | from 0 | k = (n(n + 2) + m)/2, sine for m < 0 | RMS 1 |
//! | [`Zernike::CodeV`] | from 1 | 1, ρ cos φ, ρ sin φ, ρ² cos 2φ, 2ρ² − 1, ρ² sin 2φ, ρ³ cos 3φ, … | peak 1 |
//!
//! Source: OpticStudio, help of the surface types Extended Polynomial, Zernike Standard Sag and Zernike Fringe Sag; R. J. Noll, J. Opt.
//! Soc. Am. 66, 207 (1976); OSA/ANSI Z80.28; CODE V, surface types XYP and ZRN.

use super::draft::DraftSurface;
use pipeline::design::prescription::freeform::{AlongY, SkewShape, XyTerm};
use pipeline::design::shape::Shape;
use pipeline::design::skew::deviation;
use pipeline::design::zernike;

/// Highest number of a Zernike polynomial: radial order 20.
pub(super) const MAX_ZERNIKE: usize = 231;

/// Highest number of a term of an extended polynomial: order 20.
pub(super) const MAX_XY: usize = 230;

/// A shape without rotational symmetry as a reader collects it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct FreeShape {
    /// What it is, for notes: `a toroid`.
    pub(super) what: &'static str,
    /// z as in the file.
    pub(super) shape: SkewShape,
    /// Whether the shape's x axis is the surface's y axis and its y axis −x.
    pub(super) is_rotated: bool,
}

impl FreeShape {
    /// Changes the curvature that the design program's column of curvatures has: that along y.
    pub(super) fn set_curvature(&mut self, curvature: f64) {
        match &mut self.shape.along_y {
            Some(y) => y.curvature = curvature,
            None => self.shape.base.curvature = curvature,
        }
    }

    /// Changes the conic constant of that curvature.
    pub(super) fn set_conic(&mut self, conic: f64) {
        match &mut self.shape.along_y {
            Some(y) => y.conic = conic,
            None => self.shape.base.conic = conic,
        }
    }
}

/// Gives `surface` the shape, or its base if that is all of it.
pub(super) fn give(surface: &mut DraftSurface, what: &'static str, mut shape: SkewShape, is_rotated: bool) {
    shape.xy.retain(|t| t.coefficient != 0.0);
    if shape.along_y.as_ref().is_some_and(|y| is_of_base(y, &shape.base)) {
        shape.along_y = None;
    }
    surface.shape = match is_rotated {
        false => profile_along_y(&shape),
        true => profile_along_x(&shape),
    };
    surface.free = (!shape.is_symmetric()).then_some(FreeShape { what, shape, is_rotated });
}

/// Whether the profile along y is that of the base, or a plane of a plane base.
fn is_of_base(y: &AlongY, base: &Shape) -> bool {
    match y.swept_mm {
        None => (y.curvature, y.conic) == (base.curvature, base.conic),
        Some(radius) => {
            let is_flat = y.curvature == 0.0 && y.aspheric.iter().all(|a| *a == 0.0);
            is_flat && radius.is_infinite() && base.curvature == 0.0
        }
    }
}

/// The rotationally symmetric surface of the profile along y; of XY terms the curvature at the vertex.
fn profile_along_y(shape: &SkewShape) -> Shape {
    let mut profile = shape.base.clone();
    if let Some(y) = &shape.along_y {
        (profile.curvature, profile.conic) = (y.curvature, y.conic);
        add(&mut profile.aspheric, &y.aspheric);
    }
    add(&mut profile.aspheric, &[sum_of(shape, 0, 2)]);
    profile
}

/// The same of the profile along x.
fn profile_along_x(shape: &SkewShape) -> Shape {
    let mut profile = shape.base.clone();
    if let Some(radius) = shape.along_y.as_ref().and_then(|y| y.swept_mm) {
        (profile.curvature, profile.conic) = (1.0 / radius, 0.0);
    }
    add(&mut profile.aspheric, &[sum_of(shape, 2, 0)]);
    profile
}

fn sum_of(shape: &SkewShape, i: u32, j: u32) -> f64 {
    shape.xy.iter().filter(|t| (t.i, t.j) == (i, j)).map(|t| t.coefficient).sum()
}

/// Adds coefficients; none where all are 0.
fn add(sum: &mut Vec<f64>, terms: &[f64]) {
    let used = terms.iter().rposition(|a| *a != 0.0).map_or(0, |i| i + 1);
    sum.resize(sum.len().max(used), 0.0);
    for (s, t) in sum.iter_mut().zip(&terms[..used]) {
        *s += t;
    }
}

/// Adds `term` to the sum of `terms`.
fn collect(terms: &mut Vec<XyTerm>, term: XyTerm) {
    match terms.iter_mut().find(|t| (t.i, t.j) == (term.i, term.j)) {
        Some(t) => t.coefficient += term.coefficient,
        None => terms.push(term),
    }
}

/// Powers of x and y of term `k` of an extended polynomial, from 1.
fn xy_powers(k: usize) -> (u32, u32) {
    let mut order = 1;
    let mut first = 1;
    while k > first + order {
        first += order + 1;
        order += 1;
    }
    let j = k - first;
    ((order - j) as u32, j as u32)
}

/// The terms A_1, A_2, … of an extended polynomial of norm radius `radius_mm`.
pub(super) fn xy_series(coefficients_mm: &[f64], radius_mm: f64) -> Vec<XyTerm> {
    let term = |(k, a): (usize, &f64)| {
        let (i, j) = xy_powers(k + 1);
        XyTerm::new(i, j, a / radius_mm.powi((i + j) as i32))
    };
    coefficients_mm.iter().enumerate().filter(|(_, a)| **a != 0.0).map(term).collect()
}

/// A numbering of Zernike polynomials.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Zernike {
    Noll,
    Fringe,
    FringeOnwards,
    Osa,
    CodeV,
}

impl Zernike {
    /// Radial and azimuthal order (m < 0: sine) of the `i`-th polynomial, from 0.
    fn orders(self, i: usize) -> (u32, i32) {
        let k = i + 1;
        // Of triangular numberings: the radial order, and the place within it, from 0.
        let n = (0..).find(|n| (n + 1) * (n + 2) / 2 >= k).unwrap_or(0);
        let place = k - n * (n + 1) / 2 - 1;
        let orders = |z: zernike::Zernike| (z.n, z.m);
        match self {
            Self::Noll => orders(zernike::noll(k)),
            Self::Osa => (n as u32, 2 * place as i32 - n as i32),
            Self::CodeV => (n as u32, n as i32 - 2 * place as i32),
            Self::Fringe => orders(zernike::fringe(k)),
            Self::FringeOnwards => orders(zernike::by_rising_orders(k)),
        }
    }

    /// Number of polynomials that it has at most.
    pub(super) fn count(self) -> usize {
        match self {
            Self::Fringe => 37,
            // Radial order 20.
            Self::FringeOnwards => 121,
            _ => MAX_ZERNIKE,
        }
    }

    /// The sum of the polynomials of the norm radius `radius_mm` as XY terms; `is_normalised`: to the RMS over the circle.
    pub(super) fn series(self, coefficients_mm: &[f64], radius_mm: f64, is_normalised: bool) -> Vec<XyTerm> {
        let mut terms = Vec::new();
        for (i, a) in coefficients_mm.iter().enumerate().filter(|(_, a)| **a != 0.0) {
            let (n, m) = self.orders(i);
            for term in deviation::zernike(n, m, *a, radius_mm, is_normalised) {
                collect(&mut terms, term);
            }
        }
        terms
    }
}

/// A_n ((1 − B) x² + (1 + B) y²)^n as XY terms: a term of an anamorphic asphere of CODE V.
pub(super) fn anamorphic_term(n: u32, a: f64, b: f64) -> Vec<XyTerm> {
    let binomial = |j: u32| (0..j).fold(1.0, |c, i| c * f64::from(n - i) / f64::from(i + 1));
    let term = |j: u32| {
        let factor = (1.0 - b).powi((n - j) as i32) * (1.0 + b).powi(j as i32);
        XyTerm::new(2 * (n - j), 2 * j, a * binomial(j) * factor)
    };
    (0..=n).map(term).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sag(terms: &[XyTerm], x: f64, y: f64) -> f64 {
        terms.iter().map(|t| t.coefficient * x.powi(t.i as i32) * y.powi(t.j as i32)).sum()
    }

    #[test]
    fn numberings_of_zernike_polynomials() {
        let orders = |of: Zernike, count: usize| (0..count).map(|i| of.orders(i)).collect::<Vec<_>>();
        let noll = [
            (0, 0),
            (1, 1),
            (1, -1),
            (2, 0),
            (2, -2),
            (2, 2),
            (3, -1),
            (3, 1),
            (3, -3),
            (3, 3),
            (4, 0),
            (4, 2),
        ];
        assert_eq!(orders(Zernike::Noll, 12), noll);
        let fringe = [
            (0, 0),
            (1, 1),
            (1, -1),
            (2, 0),
            (2, 2),
            (2, -2),
            (3, 1),
            (3, -1),
            (4, 0),
            (3, 3),
            (3, -3),
            (4, 2),
        ];
        assert_eq!(orders(Zernike::Fringe, 12), fringe);
        assert_eq!(
            [Zernike::Fringe.orders(15), Zernike::Fringe.orders(35), Zernike::Fringe.orders(36)],
            [(6, 0), (10, 0), (12, 0)]
        );
        let osa = [(0, 0), (1, -1), (1, 1), (2, -2), (2, 0), (2, 2), (3, -3), (3, -1), (3, 1), (3, 3)];
        assert_eq!(orders(Zernike::Osa, 10), osa);
        let code_v = [(0, 0), (1, 1), (1, -1), (2, 2), (2, 0), (2, -2), (3, 3), (3, 1), (3, -1), (3, -3)];
        assert_eq!(orders(Zernike::CodeV, 10), code_v);
        assert_eq!(Zernike::Noll.orders(MAX_ZERNIKE - 1).0, 20);
    }

    #[test]
    fn series_have_the_sag_of_their_formulas() {
        let (x, y, radius) = (1.2_f64, -0.7_f64, 5.0_f64);
        let (u, v) = (x / radius, y / radius);
        let mut a = [0.0; 14];
        (a[0], a[3], a[11], a[13]) = (0.1, -0.2, 0.03, 0.4);
        let expected = 0.1 * u - 0.2 * u * v + 0.03 * u * u * v * v + 0.4 * v.powi(4);
        assert!((sag(&xy_series(&a, radius), x, y) - expected).abs() < 1e-16);
        assert_eq!((xy_powers(3), xy_powers(12), xy_powers(MAX_XY)), ((2, 0), (2, 2), (0, 20)));

        let (r2, astigmatic) = (u * u + v * v, u * u - v * v);
        let standard = Zernike::Noll.series(&[0.0, 0.0, 0.0, 0.3, 0.0, 0.2], radius, true);
        let expected = 0.3 * 3_f64.sqrt() * (2.0 * r2 - 1.0) + 0.2 * 6_f64.sqrt() * astigmatic;
        assert!((sag(&standard, x, y) - expected).abs() < 1e-15);
        let fringe = Zernike::Fringe.series(&[0.0, 0.0, 0.0, 0.3, 0.2], radius, false);
        assert!((sag(&fringe, x, y) - 0.3 * (2.0 * r2 - 1.0) - 0.2 * astigmatic).abs() < 1e-16);

        let anamorphic = anamorphic_term(3, 1e-4, 0.25);
        let expected = 1e-4 * (0.75 * x * x + 1.25 * y * y).powi(3);
        assert!((sag(&anamorphic, x, y) - expected).abs() < 1e-18);
    }

    #[test]
    fn surfaces_have_the_profile_along_y_and_no_shape_of_their_own_without_terms() {
        let mut surface = DraftSurface::default();
        let toroid = |c: f64, swept: f64| SkewShape {
            along_y: Some(AlongY {
                curvature: c,
                conic: -1.0,
                aspheric: vec![0.0, 2e-5],
                swept_mm: Some(swept),
            }),
            xy: vec![XyTerm::new(0, 2, 1e-3), XyTerm::new(3, 0, 0.0)],
            ..SkewShape::default()
        };
        give(&mut surface, "a toroid", toroid(0.02, 80.0), false);
        let profile = Shape { curvature: 0.02, conic: -1.0, aspheric: vec![1e-3, 2e-5], ..Shape::default() };
        assert_eq!((&surface.shape, surface.free.as_ref().unwrap().shape.xy.len()), (&profile, 1));
        give(&mut surface, "a toroid", toroid(0.02, 80.0), true);
        assert_eq!((surface.shape.curvature, surface.shape.conic), (1.0 / 80.0, 0.0));
        surface.free.as_mut().unwrap().set_curvature(0.05);
        assert_eq!(surface.free.as_ref().unwrap().shape.along_y.as_ref().unwrap().curvature, 0.05);

        let base = Shape { curvature: 0.01, conic: 0.5, ..Shape::default() };
        let along_y = Some(AlongY { curvature: 0.01, conic: 0.5, ..AlongY::default() });
        give(
            &mut surface,
            "biconic",
            SkewShape { base: base.clone(), along_y, xy: vec![XyTerm::new(1, 1, 0.0)] },
            false,
        );
        assert_eq!((&surface.shape, &surface.free), (&base, &None));
        let flat = Some(AlongY { swept_mm: Some(f64::INFINITY), ..AlongY::default() });
        give(&mut surface, "a cylinder", SkewShape { along_y: flat, ..SkewShape::default() }, false);
        assert_eq!((surface.shape.is_flat(), &surface.free), (true, &None));
    }
}
