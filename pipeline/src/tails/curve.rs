//! Places along a row of the film, on the chart: polynomials of the place.

use crate::remap::map::Map;
use crate::simd::lanes::MAX_LANES;

/// Chart coordinates and gain as polynomials of a place: coefficients of row, column and gain.
pub(super) type Curve = [[f64; 3]; 3];

/// Row, column and gain at place `i` of `curve`.
#[inline(always)]
pub(super) fn place_on(curve: &Curve, i: usize) -> [f64; 3] {
    let i = i as f64;
    std::array::from_fn(|k| curve[0][k] + i * (curve[1][k] + i * curve[2][k]))
}

/// Passes the curves of `count` places of row `y`, `step` film pixels apart from `x` on, to `each`: the first place of each, of [`MAX_LANES`].
#[inline]
pub(super) fn curves_along(
    map: &Map<'_>,
    (y, x, step): (f64, f64, f64),
    count: usize,
    mut each: impl FnMut(usize, Curve),
) {
    let at = |i: usize| {
        let (row, column, gain) = map.at_place(y, x + i as f64 * step);
        [row, column, gain]
    };
    const HALF: usize = MAX_LANES / 2;
    let mut start = at(0);
    for first in (0..count).step_by(MAX_LANES) {
        let (middle, end) = (at(first + HALF), at(first + MAX_LANES));
        // Parabolas through three places.
        let half = HALF as f64;
        let curvature: [f64; 3] =
            std::array::from_fn(|c| (start[c] - 2.0 * middle[c] + end[c]) / (2.0 * half * half));
        let slope = std::array::from_fn(|c| (middle[c] - start[c]) / half - half * curvature[c]);
        each(first, [start, slope, curvature]);
        start = end;
    }
}
