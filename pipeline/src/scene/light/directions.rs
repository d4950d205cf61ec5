//! Fixed directions in which the sky is sampled.

use crate::real;
use crate::scene::frame::pattern;
use crate::scene::vector::{cross, unit};
use std::f64::consts::PI;

/// `count` (1, 4, 16 or 64) directions about +z with density cos/π: the places of the samples of a pixel ([`pattern`]) on the unit square, their first coordinate
/// the squared radius on the disc and the second its angle, raised to the hemisphere. `None` for another count.
pub fn cosine_directions(count: usize) -> Option<Vec<[f64; 3]>> {
    let direction = |[x, y]: [f64; 2]| {
        let (squared, revolution) = (x + 0.5, y + 0.5);
        let (sin, cos) = real::sin_cos(2.0 * PI * revolution);
        let radius = squared.sqrt();
        [radius * cos, radius * sin, (1.0 - squared).sqrt()]
    };
    Some(pattern(count)?.into_iter().map(direction).collect())
}

/// Two unit vectors perpendicular to the unit vector `n` and to each other.
pub(super) fn tangents(n: [f64; 3]) -> [[f64; 3]; 2] {
    let other = if n[0].abs() < 0.7 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    // The two are at an angle of 44° or more.
    let t = unit(cross(n, other)).unwrap_or(other);
    [t, cross(n, t)]
}
