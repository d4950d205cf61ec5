//! Fixed directions in which the sky is sampled.

use crate::real;
use crate::scene::vector::{cross, unit};
use std::f64::consts::PI;

/// Numbers of directions, and the factors that give each of them one in every row and column of the square.
const GENERATORS: [(usize, usize); 4] = [(1, 1), (4, 2), (16, 4), (64, 18)];

/// `count` (1, 4, 16 or 64) directions about +z with density cos/π: points of the unit square, their first coordinate the squared radius on the disc and the
/// second its angle, raised to the hemisphere. `None` for another count.
pub fn cosine_directions(count: usize) -> Option<Vec<[f64; 3]>> {
    let (n, generator) = GENERATORS.into_iter().find(|(n, _)| *n == count)?;
    let direction = |i: usize| {
        let squared = (i as f64 + 0.5) / n as f64;
        let revolution = ((generator * (i + 1) % (n + 1)) as f64 - 0.5) / n as f64;
        let (sin, cos) = real::sin_cos(2.0 * PI * revolution);
        let radius = squared.sqrt();
        [radius * cos, radius * sin, (1.0 - squared).sqrt()]
    };
    Some((0..n).map(direction).collect())
}

/// Two unit vectors perpendicular to the unit vector `n` and to each other.
pub(super) fn tangents(n: [f64; 3]) -> [[f64; 3]; 2] {
    let other = if n[0].abs() < 0.7 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    // The two are at an angle of 44° or more.
    let t = unit(cross(n, other)).unwrap_or(other);
    [t, cross(n, t)]
}
