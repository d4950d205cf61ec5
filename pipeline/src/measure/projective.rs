//! Plane projective map: what a camera without distortion makes of positions on a flat chart.
//!
//! ```text
//! (r', c', 1)ᵀ·w = M·(r, c, 1)ᵀ,   M a 3 × 3 matrix, determined but for a factor: 8 parameters
//! ```
//! Positions are (row, column), in any unit. Four pairs of positions determine M: with λ, μ, ν such that λ·p₁ + μ·p₂ + ν·p₃ = p₄ for
//! homogeneous positions, A = (λ·p₁, μ·p₂, ν·p₃) maps the unit vectors and their sum to the four positions, so that M = A'·A⁻¹ (Heckbert,
//! "Fundamentals of texture mapping and image warping", 1989, section 2.2.3). Both quadrilaterals are first moved to their mean and scaled
//! to a size of about 1, so that areas of three positions are shares of the quadrilateral. The inverse is the adjugate.
//! Not modelled: distortion, which bends straight lines.

/// Four positions, (row, column).
pub type Quad = [(f64, f64); 4];

/// Smallest area of three of four positions, over the square of the largest distance from their mean: rounding of 1e-16 in positions then
/// changes the map by less than 1e-9 of the size.
const MIN_AREA: f64 = 1e-7;

/// Four pairs of positions that determine no map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ProjectiveError {
    /// Three of four positions are on a line, or two are the same, or one is not finite.
    #[error("the four positions of a projective map need no three on a line")]
    Collinear,
    /// The straight line that the map sends to infinity crosses the quadrilateral: not the picture of a chart in front of a camera.
    #[error(
        "the four positions are not in the order of the quadrilateral that they are mapped to, or one of the two is not convex"
    )]
    Folded,
}

/// A map of positions (row, column) to positions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projective {
    m: [[f64; 3]; 3],
}

impl Projective {
    /// The map of each position of `from` to the same of `to`.
    ///
    /// # Errors
    /// [`ProjectiveError`] if three positions of either are on a line, or if only part of the quadrilateral would have an image.
    pub fn through(from: &Quad, to: &Quad) -> Result<Self, ProjectiveError> {
        let (a, to_size) = frame(to)?;
        let (b, from_size) = frame(from)?;
        let m = product(&product(&to_size, &a), &adjugate(&product(&from_size, &b)));
        let map = Self { m };
        let weight = |p: &(f64, f64)| m[2][0] * p.0 + m[2][1] * p.1 + m[2][2];
        let positive = from.iter().filter(|p| weight(p) > 0.0).count();
        if positive == 0 || positive == 4 { Ok(map.normalised(from)) } else { Err(ProjectiveError::Folded) }
    }

    /// The image of a position; not finite on the line that the map sends to infinity.
    pub fn apply(&self, (row, column): (f64, f64)) -> (f64, f64) {
        let [r, c, w] = self.m.map(|m| m[0] * row + m[1] * column + m[2]);
        (r / w, c / w)
    }

    /// The map of images to positions.
    pub fn inverse(&self) -> Self {
        Self { m: adjugate(&self.m) }
    }

    /// Area of the image over that of a small figure at a position; negative if the map reverses the orientation.
    pub fn area_scale(&self, (row, column): (f64, f64)) -> f64 {
        let w = self.m[2][0] * row + self.m[2][1] * column + self.m[2][2];
        determinant(&self.m) / (w * w * w)
    }

    /// Weight 1 at the mean of `from`: entries of ordinary size.
    fn normalised(mut self, from: &Quad) -> Self {
        let mean = |f: fn(&(f64, f64)) -> f64| from.iter().map(f).sum::<f64>() / 4.0;
        let w = self.m[2][0] * mean(|p| p.0) + self.m[2][1] * mean(|p| p.1) + self.m[2][2];
        self.m.iter_mut().flatten().for_each(|v| *v /= w);
        self
    }
}

type Matrix = [[f64; 3]; 3];

/// The matrix of columns λ·p₁, μ·p₂, ν·p₃ of positions of size 1, and the map of these to positions.
fn frame(quad: &Quad) -> Result<(Matrix, Matrix), ProjectiveError> {
    let mean = |f: fn(&(f64, f64)) -> f64| quad.iter().map(f).sum::<f64>() / 4.0;
    let (row, column) = (mean(|p| p.0), mean(|p| p.1));
    let size = quad.iter().map(|p| (p.0 - row).abs().max((p.1 - column).abs())).fold(0.0, f64::max);
    if !(size > 0.0 && size.is_finite()) {
        return Err(ProjectiveError::Collinear);
    }
    let p = quad.map(|p| [(p.0 - row) / size, (p.1 - column) / size]);
    // Twice the signed area of three positions; det(a, b, c) of homogeneous ones.
    let area = |i: usize, j: usize, k: usize| {
        (p[j][0] - p[i][0]) * (p[k][1] - p[i][1]) - (p[k][0] - p[i][0]) * (p[j][1] - p[i][1])
    };
    // Cramer's rule for λ, μ, ν, times det(p₁, p₂, p₃).
    let shares = [area(3, 1, 2), area(0, 3, 2), area(0, 1, 3)];
    if shares.iter().chain([&area(0, 1, 2)]).any(|a| a.is_nan() || a.abs() < MIN_AREA) {
        return Err(ProjectiveError::Collinear);
    }
    let columns: Matrix =
        [0, 1, 2].map(|axis| [0, 1, 2].map(|i| shares[i] * if axis < 2 { p[i][axis] } else { 1.0 }));
    Ok((columns, [[size, 0.0, row], [0.0, size, column], [0.0, 0.0, 1.0]]))
}

fn product(a: &Matrix, b: &Matrix) -> Matrix {
    [0, 1, 2].map(|i| [0, 1, 2].map(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}

/// The inverse times the determinant.
fn adjugate(m: &Matrix) -> Matrix {
    [0, 1, 2].map(|i: usize| {
        [0, 1, 2].map(|j: usize| {
            // Cofactor of (j, i).
            let (a, b, c, d) = ((j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3);
            m[a][c] * m[b][d] - m[a][d] * m[b][c]
        })
    })
}

fn determinant(m: &Matrix) -> f64 {
    let inverse = adjugate(m);
    (0..3).map(|k| m[0][k] * inverse[k][0]).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARE: Quad = [(0.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, 0.0)];

    fn near(a: (f64, f64), b: (f64, f64), tolerance: f64) -> bool {
        (a.0 - b.0).abs() <= tolerance && (a.1 - b.1).abs() <= tolerance
    }

    #[test]
    fn four_pairs_are_met_and_the_inverse_returns() {
        let quads: [Quad; 3] = [
            [(100.0, 120.0), (80.0, 900.0), (700.0, 860.0), (650.0, 90.0)],
            [(9000.5, 12000.25), (9000.5, 100.0), (50.0, 100.0), (50.0, 12000.25)],
            [(-1.0, 0.0), (0.0, 3.0), (2.0, 4.0), (2.0, -1.0)],
        ];
        for to in quads {
            let map = Projective::through(&SQUARE, &to).unwrap();
            let size = 12_000.0;
            for (from, to) in SQUARE.iter().zip(&to) {
                assert!(near(map.apply(*from), *to, 1e-12 * size), "{from:?} {to:?}");
                assert!(near(map.inverse().apply(*to), *from, 1e-12), "{from:?} {to:?}");
            }
            let within = (0.3, 0.8);
            assert!(near(map.inverse().apply(map.apply(within)), within, 1e-13));
        }
    }

    /// A camera at distance d of a plane rotated about its column axis: row' = r·cos φ/(1 + r·sin φ/d), column' = c/(1 + r·sin φ/d).
    #[test]
    fn inclined_plane_has_its_closed_form() {
        let (sin, cos, d) = (0.6, 0.8, 3.0);
        let camera = |(r, c): (f64, f64)| (r * cos / (1.0 + r * sin / d), c / (1.0 + r * sin / d));
        let from: Quad = [(-1.0, -1.5), (-1.0, 1.5), (1.0, 1.5), (1.0, -1.5)];
        let map = Projective::through(&from, &from.map(camera)).unwrap();
        for p in [(0.0, 0.0), (0.5, -0.7), (-0.9, 1.1), (2.0, 0.1)] {
            assert!(near(map.apply(p), camera(p), 1e-14), "{p:?}");
            let scale = cos / (1.0 + p.0 * sin / d).powi(3);
            assert!((map.area_scale(p) / scale - 1.0).abs() < 1e-12, "{p:?}");
        }
    }

    #[test]
    fn a_parallelogram_is_an_affine_map() {
        let to: Quad = [(10.0, 20.0), (12.0, 50.0), (32.0, 55.0), (30.0, 25.0)];
        let map = Projective::through(&SQUARE, &to).unwrap();
        for (r, c) in [(0.5, 0.5), (0.25, 0.75), (3.0, -2.0)] {
            let expected = (10.0 + 20.0 * r + 2.0 * c, 20.0 + 5.0 * r + 30.0 * c);
            assert!(near(map.apply((r, c)), expected, 1e-11), "{r} {c}");
        }
        assert!((map.area_scale((0.2, 0.1)) - (20.0 * 30.0 - 2.0 * 5.0)).abs() < 1e-9);
    }

    #[test]
    fn degenerate_quadrilaterals_are_errors() {
        let line: Quad = [(0.0, 0.0), (1.0, 1.0), (2.0, 2.0), (3.0, 0.0)];
        let twice: Quad = [(0.0, 0.0), (0.0, 0.0), (2.0, 2.0), (3.0, 0.0)];
        let nan: Quad = [(f64::NAN, 0.0), (0.0, 1.0), (2.0, 2.0), (3.0, 0.0)];
        for quad in [line, twice, nan, [(5.0, 5.0); 4]] {
            assert_eq!(Projective::through(&SQUARE, &quad), Err(ProjectiveError::Collinear));
            assert_eq!(Projective::through(&quad, &SQUARE), Err(ProjectiveError::Collinear));
        }
        let crossed: Quad = [(0.0, 0.0), (1.0, 1.0), (0.0, 1.0), (1.0, 0.0)];
        let concave: Quad = [(0.0, 0.0), (0.0, 1.0), (0.2, 0.2), (1.0, 0.0)];
        for quad in [crossed, concave] {
            assert_eq!(Projective::through(&SQUARE, &quad), Err(ProjectiveError::Folded));
        }
    }
}
