//! A cell of a grid of rays: values between its four nodes, and the part of it that lets light through.
//!
//! ```text
//! f(u, v) = bilinear − ½ u (1 − u) D_u − ½ v (1 − v) D_v          landing and overshoot;   the light is bilinear
//! ```
//! D: second differences over the nodes about the cell. Without them landings lie too far outside, and an overshoot, which is convex, is too large: 0.3 to 0.7 % of the light
//! would be lost at the rims. An overshoot is the largest of r/a − 1 at the crossings of a ray, smooth but for the lines where another crossing takes over: of the second
//! differences on either side of the cell the one nearer to 0 is taken, so that such a line beside the cell changes nothing within.

use super::grid::{LIGHT, OVERSHOOT, RayGrid, X, Y};

/// A cell that lets light through.
pub(super) struct Cell<'g> {
    /// Its indices along and across the meridian.
    pub(super) at: (usize, usize),
    /// Values at its nodes: (0, 0), (0, 1), (1, 0), (1, 1).
    corners: [&'g [f32]; 4],
    /// Half of D_u and D_v of x, y and overshoot.
    bends: [(f64, f64); LIGHT],
    /// Whether a part of it may be blocked.
    pub(super) has_rim: bool,
}

impl Cell<'_> {
    fn bilinear(&self, k: usize, (u, v): (f64, f64)) -> f64 {
        let [a, b, c, d] = self.corners.map(|corner| f64::from(corner[k]));
        let (low, high) = (a + v * (b - a), c + v * (d - c));
        low + u * (high - low)
    }

    fn bent(&self, k: usize, (u, v): (f64, f64)) -> f64 {
        let (along, across) = self.bends[k];
        self.bilinear(k, (u, v)) - along * u * (1.0 - u) - across * v * (1.0 - v)
    }

    /// Where the ray at (u, v) lands, mm.
    pub(super) fn landing(&self, at: (f64, f64)) -> (f64, f64) {
        (self.bent(X, at), self.bent(Y, at))
    }

    /// The light of wavelength `band` at (u, v).
    pub(super) fn light(&self, band: usize, at: (f64, f64)) -> f64 {
        self.bilinear(LIGHT + band, at)
    }

    /// Whether the ray at (u, v) reaches the film.
    pub(super) fn is_open(&self, at: (f64, f64)) -> bool {
        !self.has_rim || self.bent(OVERSHOOT, at) <= 0.0
    }
}

impl RayGrid {
    /// Cell (i, j) of `cells` along and across; none if it is blocked.
    pub(super) fn cell(&self, cells: (usize, usize), (i, j): (usize, usize)) -> Option<Cell<'_>> {
        let node = |i: usize, j: usize| &self.values[(i * (cells.1 + 1) + j) * self.stride..][..self.stride];
        let corners = [node(i, j), node(i, j + 1), node(i + 1, j), node(i + 1, j + 1)];
        let overshoots = corners.map(|corner| f64::from(corner[OVERSHOOT]));
        if overshoots.iter().any(|v| v.is_nan()) {
            return None;
        }
        // Quarters: half of the mean of two rows.
        let bends = [X, Y, OVERSHOOT].map(|k| {
            let value = |i: usize, j: usize| f64::from(node(i, j)[k]);
            let along = |j: usize| {
                let second = |i: usize| value(i - 1, j) - 2.0 * value(i, j) + value(i + 1, j);
                nearer((i > 0).then(|| second(i)), (i + 2 <= cells.0).then(|| second(i + 1)))
            };
            // The meridian is a plane of symmetry: y changes its sign.
            let mirrored = |i: usize| if k == Y { -value(i, 1) } else { value(i, 1) };
            let across = |i: usize| {
                let before = if j > 0 { value(i, j - 1) } else { mirrored(i) };
                let second = |before: f64, j: usize| before - 2.0 * value(i, j) + value(i, j + 1);
                nearer(Some(second(before, j)), (j + 2 <= cells.1).then(|| second(value(i, j), j + 1)))
            };
            (0.25 * (along(j) + along(j + 1)), 0.25 * (across(i) + across(i + 1)))
        });
        let least = overshoots.into_iter().fold(f64::INFINITY, f64::min);
        let most = overshoots.into_iter().fold(f64::NEG_INFINITY, f64::max);
        // The largest changes that the bends make.
        let (along, across) = bends[OVERSHOOT];
        let below = 0.25 * (along.max(0.0) + across.max(0.0));
        let above = -0.25 * (along.min(0.0) + across.min(0.0));
        (least - below <= 0.0).then_some(Cell { at: (i, j), corners, bends, has_rim: most + above > 0.0 })
    }
}

/// The one of two second differences that is nearer to 0: 0 if their signs differ, the other one if one of them is not known.
pub(super) fn nearer(a: Option<f64>, b: Option<f64>) -> f64 {
    let known = |v: Option<f64>| v.filter(|v| !v.is_nan());
    match (known(a), known(b)) {
        (Some(a), Some(b)) if a * b <= 0.0 => 0.0,
        (Some(a), Some(b)) => {
            if a.abs() < b.abs() {
                a
            } else {
                b
            }
        }
        (a, b) => a.or(b).unwrap_or(0.0),
    }
}
