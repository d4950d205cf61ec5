//! The shape of a surface without rotational symmetry: biconic, toroid, cylinder, XY polynomial.
//!
//! ```text
//! sag(x, y) = u / (1 + √(1 − (1 + κx) cx² x² − (1 + κy) cy² y²)) + Σ α_i r^(2i) + Σ β_i r^(2i−1) + Σ c_ij x^i y^j
//! u = cx x² + cy y²
//! toroid: conic part = R − sgn(R) √((R − g)² − x²),   g(y) = cy y² / (1 + √(1 − (1 + κy) cy² y²)) + Σ γ_i y^(2i)
//! ```
//! with cy = cx, κy = κx unless the surface is biconic or a toroid: the curve g swept about an axis along y at z = R (∞: a
//! cylinder). Coordinates in mm, origin at the vertex, +z along the light. Zernike polynomials are XY polynomials
//! ([`crate::design::skew::deviation::zernike`]).
//! Source: OpticStudio, help of the surface types Biconic, Toroidal and Extended Polynomial; Welford, Aberrations of Optical
//! Systems, chapter 4. Left out: gratings, freeform grids.

use super::shape::Shape;

/// A term c x^i y^j of a sag.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct XyTerm {
    /// Power of x.
    pub i: u32,
    /// Power of y.
    pub j: u32,
    /// Coefficient, mm^(1−i−j).
    pub coefficient: f64,
}

impl XyTerm {
    /// c x^i y^j.
    pub fn new(i: u32, j: u32, coefficient: f64) -> Self {
        Self { i, j, coefficient }
    }
}

/// The profile of a surface along y, if it is not that of its base.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AlongY {
    /// Curvature, 1/mm.
    pub curvature: f64,
    /// Conic constant.
    pub conic: f64,
    /// Coefficients of y², y⁴, … of a toroid; a biconic surface has none.
    pub aspheric: Vec<f64>,
    /// Radius of the circle along x, mm, of a toroid (∞: a cylinder); `None` = a biconic surface, with the curvature and conic
    /// constant of its base along x.
    pub swept_mm: Option<f64>,
}

/// The shape of a surface without rotational symmetry.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SkewShape {
    /// Conic, even and odd terms.
    pub base: Shape,
    /// The profile of a biconic surface or of a toroid along y.
    pub along_y: Option<AlongY>,
    /// XY terms.
    pub xy: Vec<XyTerm>,
}

impl From<Shape> for SkewShape {
    fn from(base: Shape) -> Self {
        Self { base, ..Self::default() }
    }
}

impl SkewShape {
    /// Whether it is its base alone.
    pub fn is_symmetric(&self) -> bool {
        self.along_y.is_none() && self.xy.is_empty()
    }

    /// The same surface seen from behind: z counts the other way.
    pub fn reversed(&self) -> Self {
        let negate = |c: &[f64]| c.iter().map(|a| -a).collect();
        let along_y = self.along_y.as_ref().map(|y| AlongY {
            curvature: -y.curvature,
            aspheric: negate(&y.aspheric),
            swept_mm: y.swept_mm.map(|radius| -radius),
            ..y.clone()
        });
        let xy = self.xy.iter().map(|t| XyTerm { coefficient: -t.coefficient, ..*t }).collect();
        Self { base: self.base.reversed(), along_y, xy }
    }

    /// Every number that it has.
    pub fn numbers(&self) -> impl Iterator<Item = f64> {
        let base = [self.base.curvature, self.base.conic].into_iter();
        let terms = self.base.aspheric.iter().chain(&self.base.odd).copied();
        let along = self
            .along_y
            .iter()
            .flat_map(|y| [y.curvature, y.conic].into_iter().chain(y.aspheric.iter().copied()));
        base.chain(terms).chain(along).chain(self.xy.iter().map(|t| t.coefficient))
    }
}
