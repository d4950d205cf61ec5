//! Where a ray meets a triangle, and how far that place moves per chart pixel.
//!
//! A ray d = (x, y, 1) and the edge functions e_k = n_k·d, n_k = v_i × v_j over (1, 2), (2, 0), (0, 1), of the corners v give the barycentric coordinates and
//! their exact derivatives:
//!
//! ```text
//! b_k = e_k/S,   S = e_0 + e_1 + e_2,   ∂b_k/∂x = (n_k,x − b_k·S_x)/S,   S_x = n_0,x + n_1,x + n_2,x
//! ```
//! Any attribute a = Σ b_k a_k is then correct in perspective, and so is its derivative. The level of a texture is log₂ of the larger of the two lengths by
//! which the place moves, in texels, from one column and from one row of the chart to the next.

use crate::real;
use crate::scene::vector::cross;

/// The edge functions of a triangle in the camera frame.
#[derive(Clone, Copy, Debug)]
pub struct Projection {
    edges: [[f64; 3]; 3],
    sum: [f64; 3],
}

/// Barycentric coordinates of a place and their derivatives per unit of x and y.
#[derive(Clone, Copy, Debug)]
pub struct Footprint {
    /// The coordinates, each 0…1.
    pub barycentric: [f64; 3],
    dx: [f64; 3],
    dy: [f64; 3],
}

impl Projection {
    /// Of the corners in metres.
    pub fn new(v: &[[f64; 3]; 3]) -> Self {
        let edges = [cross(v[1], v[2]), cross(v[2], v[0]), cross(v[0], v[1])];
        Self { edges, sum: std::array::from_fn(|k| edges[0][k] + edges[1][k] + edges[2][k]) }
    }

    /// The place that direction (x, y, 1) meets. For a triangle seen edge-on it is the middle, and its derivatives are 0.
    pub fn at(&self, x: f64, y: f64) -> Footprint {
        let along = |n: &[f64; 3]| (n[0] * x + n[1] * y) + n[2];
        let e = [along(&self.edges[0]), along(&self.edges[1]), along(&self.edges[2])];
        let sum = e[0] + e[1] + e[2];
        if sum == 0.0 {
            return Footprint { barycentric: [1.0 / 3.0; 3], dx: [0.0; 3], dy: [0.0; 3] };
        }
        let (b, inverse) = (e.map(|e| e / sum), 1.0 / sum);
        let slope =
            |axis: usize| std::array::from_fn(|k| (self.edges[k][axis] - b[k] * self.sum[axis]) * inverse);
        Footprint { barycentric: b.map(|b| b.clamp(0.0, 1.0)), dx: slope(0), dy: slope(1) }
    }
}

impl Footprint {
    /// Of a place whose surroundings are not looked at: without derivatives, so that textures are those of level 0.
    pub fn at_point(barycentric: [f64; 3]) -> Self {
        Self { barycentric, dx: [0.0; 3], dy: [0.0; 3] }
    }

    /// The attribute of the place.
    pub fn value<const N: usize>(&self, corners: &[[f64; N]; 3]) -> [f64; N] {
        combined(&self.barycentric, corners)
    }

    /// Its derivatives per unit of x and of y.
    pub fn slopes<const N: usize>(&self, corners: &[[f64; N]; 3]) -> [[f64; N]; 2] {
        [combined(&self.dx, corners), combined(&self.dy, corners)]
    }
}

/// Level of a texture of `size` (columns, rows) whose coordinates have the derivatives `slopes` per unit of x and of y, for a chart pixel from whose column to
/// the next, and from whose row, (x, y) changes by `steps`. 0 if a texel is larger than a pixel.
pub fn level_of(slopes: [[f64; 2]; 2], size: (usize, usize), steps: [[f64; 2]; 2]) -> f64 {
    let squared = |k: usize| {
        let other = 1 - k;
        let along = |c: usize| match steps[k][other] {
            0.0 => slopes[k][c] * steps[k][k],
            across => slopes[k][c] * steps[k][k] + slopes[other][c] * across,
        };
        let (s, t) = (along(0) * size.0 as f64, along(1) * size.1 as f64);
        s * s + t * t
    };
    let largest = squared(0).max(squared(1));
    if largest > 1.0 { 0.5 * real::log2(largest) } else { 0.0 }
}

fn combined<const N: usize>(b: &[f64; 3], corners: &[[f64; N]; 3]) -> [f64; N] {
    std::array::from_fn(|c| b[0] * corners[0][c] + b[1] * corners[1][c] + b[2] * corners[2][c])
}
