//! Rays of a path at all heights: grids traced at some of them, interpolated between.
//!
//! Interpolation *moves* light over the film; fading between traced heights would double it. Grids are cubic in tan θ between evenly spaced heights, linear where an outer one has no ray,
//! overshoots quadratic, as they have kinks.
//! Their number is doubled until 95 % of the light of test rays, half-way between heights and between nodes of the grid, is interpolated to within half a ring of where it lands.
//! A path that needs more heights than there are rings (a branch ends, or a caustic passes) is traced at every ring.

use super::cell::nearer;
use super::grid::{LIGHT, OVERSHOOT, RayGrid, X, Y};
use super::light_tables::PathTables;
use super::path::{Crossing, GhostLens};
use super::window::Window;

/// Intervals between traced heights that are tried.
const INTERVALS: [usize; 3] = [32, 64, 128];
/// Heights of test rays.
const TESTS: usize = 8;
/// Nodes of the grid per test ray, along and across.
const SPARSE: (usize, usize) = (3, 3);
/// Share of the light that must land within half a ring.
const GOOD: f64 = 0.95;

/// A path's light at all heights.
pub(super) struct PathHeights {
    pub(super) window: Window,
    /// Tangents of the traced heights: evenly spaced from 0, or those of the rings.
    tans: Vec<f64>,
    grids: Vec<RayGrid>,
    is_interpolated: bool,
}

/// Tangents of the field angle: that of the last height, and those of the rings.
#[derive(Clone, Debug)]
pub(super) struct Fields {
    pub(super) last: f64,
    pub(super) rings: Vec<f64>,
    /// Width of a ring on the film, mm.
    pub(super) ring_mm: f64,
}

impl PathHeights {
    /// Traces `crossings` over `window`. The number of heights depends on geometry and on the light of the first wavelength of `test_tables` alone, light is kept of the `bands` wavelengths of
    /// `tables`.
    pub(super) fn trace(
        lens: &GhostLens<'_>,
        crossings: &[Crossing<'_>],
        window: Window,
        fields: &Fields,
        tables: (&PathTables<'_, '_>, usize),
        test_tables: &PathTables<'_, '_>,
    ) -> Self {
        let even = |n: usize| (0..=n).map(|i| fields.last * i as f64 / n as f64).collect::<Vec<_>>();
        let grid = |tan: &f64| RayGrid::trace(lens, crossings, &window, *tan, tables);
        let mut known: Vec<RayGrid> = Vec::new();
        for n in INTERVALS.into_iter().take_while(|n| *n < fields.rings.len()) {
            // Those of the step before lie at every other height.
            let mut known_grids = std::mem::take(&mut known).into_iter();
            let tans = even(n);
            let grids = tans.iter().enumerate().map(|(i, tan)| {
                (i % 2 == 0).then(|| known_grids.next()).flatten().unwrap_or_else(|| grid(tan))
            });
            let path = Self { window, grids: grids.collect(), tans, is_interpolated: true };
            if path.is_good(lens, crossings, fields, test_tables) {
                return path;
            }
            known = path.grids;
        }
        Self {
            grids: fields.rings.iter().map(grid).collect(),
            tans: fields.rings.clone(),
            window,
            is_interpolated: false,
        }
    }

    /// Whether enough of the light of test rays is interpolated to where it lands.
    fn is_good(
        &self,
        lens: &GhostLens<'_>,
        crossings: &[Crossing<'_>],
        fields: &Fields,
        tables: &PathTables<'_, '_>,
    ) -> bool {
        let (along, across) = self.window.cells;
        let intervals = self.tans.len() - 1;
        let mut meetings = Vec::with_capacity(crossings.len());
        let (mut good, mut all) = (0.0, 0.0);
        for test in 0..TESTS {
            let k = (2 * test + 1) * intervals / (2 * TESTS);
            let tan = 0.5 * (self.tans[k] + self.tans[k + 1]);
            let grid = self.at(tan, None);
            for i in (0..along).step_by(SPARSE.0) {
                for j in (0..across).step_by(SPARSE.1) {
                    let (u, v) = (i as f64 + 0.5, j as f64 + 0.5);
                    let (x, y) = self.window.place(u, v, tan);
                    let (start, flux) = lens.start(tan, x, y);
                    let Some(landing) = lens.follow(crossings, start, &mut meetings) else { continue };
                    if landing.overshoot > 0.0 {
                        continue;
                    }
                    let light = flux * tables.weights(&meetings)[0];
                    all += light;
                    let found = grid.between(across, (i, j), (0.5, 0.5));
                    let miss = (found[X] - landing.x).powi(2) + (found[Y] - landing.y).powi(2);
                    if miss.sqrt() <= 0.5 * fields.ring_mm {
                        good += light;
                    }
                }
            }
        }
        good >= GOOD * all
    }

    /// The grid at `tan`; `ring`: its index if it is that of a ring.
    pub(super) fn at(&self, tan: f64, ring: Option<usize>) -> RayGrid {
        if let (false, Some(ring)) = (self.is_interpolated, ring) {
            return self.grids[ring].clone();
        }
        let intervals = self.tans.len() - 1;
        let position = tan / self.tans[intervals] * intervals as f64;
        let k = (position as usize).min(intervals - 1);
        let share = (position - k as f64) as f32;
        // Four heights about it; at the ends of the range the nearest four.
        let first = k.saturating_sub(1).min(intervals - 3);
        let weights = cubic((position - first as f64) as f32);
        let outer: [&[f32]; 4] = std::array::from_fn(|i| self.grids[first + i].values.as_slice());
        let [low, high] = [k, k + 1].map(|k| self.grids[k].values.as_slice());
        let stride = self.grids[0].stride;
        let mut values = vec![f32::NAN; low.len()];
        for at in (0..values.len()).step_by(stride) {
            let node = &mut values[at..at + stride];
            match outer.iter().all(|grid| !grid[at].is_nan()) {
                true => {
                    for (i, value) in node.iter_mut().enumerate() {
                        *value = (0..4).map(|k| weights[k] * outer[k][at + i]).sum();
                    }
                }
                false => {
                    for (i, value) in node.iter_mut().enumerate() {
                        *value = low[at + i] + share * (high[at + i] - low[at + i]);
                    }
                }
            }
            node[OVERSHOOT] = self.overshoot(k, share, at + OVERSHOOT);
            // Light is never negative between heights.
            node[LIGHT..].iter_mut().for_each(|v| *v = v.max(0.0));
        }
        RayGrid { stride, values }
    }

    /// Value `at` of the grids, an overshoot, at `share` between the heights k and k + 1: bent by the second difference that is nearer to 0, as within a [`cell`](super::cell).
    fn overshoot(&self, k: usize, share: f32, at: usize) -> f32 {
        let value = |k: usize| self.grids[k].values[at];
        let second = |k: usize| value(k - 1) - 2.0 * value(k) + value(k + 1);
        let before = (k > 0).then(|| second(k));
        let after = (k + 2 < self.grids.len()).then(|| second(k + 1));
        let bend = nearer(before.map(f64::from), after.map(f64::from)) as f32;
        value(k) + share * (value(k + 1) - value(k)) - 0.5 * bend * share * (1.0 - share)
    }
}

impl RayGrid {
    /// x, y and overshoot in cell (i, j) at the shares `at` of its sides.
    pub(super) fn between(&self, across: usize, (i, j): (usize, usize), (u, v): (f64, f64)) -> [f64; 3] {
        let node = |di: usize, dj: usize| ((i + di) * (across + 1) + j + dj) * self.stride;
        let corners = [
            (node(0, 0), (1.0 - u) * (1.0 - v)),
            (node(0, 1), (1.0 - u) * v),
            (node(1, 0), u * (1.0 - v)),
            (node(1, 1), u * v),
        ];
        [X, Y, OVERSHOOT]
            .map(|k| corners.iter().map(|(at, share)| share * f64::from(self.values[at + k])).sum())
    }
}

/// Weights of the cubic through 0, 1, 2, 3 at `t`.
fn cubic(t: f32) -> [f32; 4] {
    let [a, b, c, d] = [t, t - 1.0, t - 2.0, t - 3.0];
    [-b * c * d / 6.0, a * c * d / 2.0, -a * b * d / 2.0, a * b * c / 6.0]
}
