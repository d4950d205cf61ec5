//! Winding number of closed components about the camera: their signed solid angle over 4π.
//!
//! ```text
//! w = Σ_triangles arg(q)/2π,   q = |a||b||c| + (a·b)|c| + (b·c)|a| + (c·a)|b| + i a·(b × c)
//! ```
//! Source: A. Van Oosterom and J. Strackee, IEEE Trans. Biomed. Eng. BME-30, 125 (1983), eq. 8. The sum of the angles is the angle of the product
//! of all q and the number of times that the product crossed the negative real axis: no function of a library is needed. The camera is in
//! the component if |w| > ½, that is if the number of crossings is not 0.

use super::{Mesh, NOT_SOLID};
use crate::scene::vector::{cross, dot, length};

/// Sum of angles in ±π each: 2π times the number of turns, and the angle of a unit vector.
#[derive(Clone, Copy)]
struct Turns {
    turns: i64,
    re: f64,
    im: f64,
}

impl Turns {
    const ZERO: Self = Self { turns: 0, re: 1.0, im: 0.0 };

    /// Adds the angle of (re, im); nothing if both are 0.
    fn add(&mut self, re: f64, im: f64) {
        let l = (re * re + im * im).sqrt();
        if !(l > 0.0 && l.is_finite()) {
            return;
        }
        let (re, im) = (re / l, im / l);
        let product = (self.re * re - self.im * im, self.re * im + self.im * re);
        if self.im >= 0.0 && im >= 0.0 && product.1 < 0.0 {
            self.turns += 1;
        } else if self.im < 0.0 && im < 0.0 && product.1 >= 0.0 {
            self.turns -= 1;
        }
        // Rounding must not change the length over millions of products.
        let l = (product.0 * product.0 + product.1 * product.1).sqrt();
        (self.re, self.im) = (product.0 / l, product.1 / l);
    }
}

/// Whether each solid of `mesh` contains the camera.
pub(super) fn around_camera(mesh: &Mesh) -> Vec<bool> {
    let mut sums = vec![Turns::ZERO; mesh.facts.solids];
    for t in 0..mesh.triangles() {
        let solid = mesh.solid(t);
        if solid == NOT_SOLID {
            continue;
        }
        let [a, b, c] = mesh.corners(t);
        let (la, lb, lc) = (length(a), length(b), length(c));
        let re = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb;
        sums[solid as usize].add(re, dot(a, cross(b, c)));
    }
    sums.iter().map(|s| s.turns != 0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The angle of (3 + 4i)/5 is 0.927295 rad, 0.147584 turns.
    #[test]
    fn turns_are_counted() {
        for (steps, expected) in [(3, 0), (4, 1), (10, 1), (11, 2), (100, 15)] {
            for sign in [1.0, -1.0] {
                let mut sum = Turns::ZERO;
                (0..steps).for_each(|_| sum.add(3.0, sign * 4.0));
                assert_eq!(sum.turns, sign as i64 * expected, "{steps}");
            }
        }
        let mut sum = Turns::ZERO;
        sum.add(0.0, 0.0);
        assert_eq!((sum.turns, sum.re, sum.im), (0, 1.0, 0.0));
    }
}
