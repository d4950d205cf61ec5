//! Rays of a path from one height on a grid over its window: landings, light, and whether anything blocks them.
//!
//! Values between the nodes are bilinear. A node without a ray (it misses a surface or is totally reflected) beside two nodes with one has values that continue theirs, and an overshoot as
//! far above 0 as its neighbour's is below it: the rim of the light then lies between the two.

use super::light_tables::{LANES, PathTables};
use super::path::{Crossing, GhostLens};
use super::window::Window;

/// Values of a node: x, y, overshoot, then the light of each wavelength.
pub(super) const X: usize = 0;
pub(super) const Y: usize = 1;
pub(super) const OVERSHOOT: usize = 2;
pub(super) const LIGHT: usize = 3;

/// A grid of rays. Nodes across the meridian are the fast index; NaN without a ray.
#[derive(Clone, Debug)]
pub(super) struct RayGrid {
    /// Values per node: [`LIGHT`] and the wavelengths.
    pub(super) stride: usize,
    pub(super) values: Vec<f32>,
}

impl RayGrid {
    /// Traces the rays of `crossings` at `tan` for `bands` wavelengths of `tables`.
    pub(super) fn trace(
        lens: &GhostLens<'_>,
        crossings: &[Crossing<'_>],
        window: &Window,
        tan: f64,
        (tables, bands): (&PathTables<'_, '_>, usize),
    ) -> Self {
        debug_assert!(bands <= LANES);
        let stride = LIGHT + bands;
        let (along, across) = window.cells;
        let mut grid = Self { stride, values: vec![f32::NAN; (along + 1) * (across + 1) * stride] };
        let mut meetings = Vec::with_capacity(crossings.len());
        for (index, node) in grid.values.chunks_exact_mut(stride).enumerate() {
            let (i, j) = (index / (across + 1), index % (across + 1));
            let (x, y) = window.place(i as f64, j as f64, tan);
            let (start, flux) = lens.start(tan, x, y);
            let Some(landing) = lens.follow(crossings, start, &mut meetings) else { continue };
            node[X] = landing.x as f32;
            node[Y] = landing.y as f32;
            node[OVERSHOOT] = landing.overshoot.min(1e6) as f32;
            for (value, weight) in node[LIGHT..].iter_mut().zip(tables.weights(&meetings)) {
                *value = (flux * weight) as f32;
            }
        }
        grid.continue_beyond(window);
        grid
    }

    /// Values at nodes without a ray beside nodes with one.
    fn continue_beyond(&mut self, window: &Window) {
        let (along, across, stride) = (window.cells.0 as isize, window.cells.1 as isize, self.stride);
        let index = |i: isize, j: isize| {
            let is_inside = (0..=along).contains(&i) && (0..=across).contains(&j);
            is_inside.then(|| (i * (across + 1) + j) as usize * stride)
        };
        let mut found: Vec<(usize, Vec<f32>)> = Vec::new();
        for i in 0..=along {
            for j in 0..=across {
                let Some(at) = index(i, j).filter(|at| self.values[*at].is_nan()) else { continue };
                let (mut sum, mut count) = (vec![0.0_f32; self.stride], 0.0_f32);
                for (di, dj) in [(1, 0), (-1, 0), (0, 1), (0, -1)] {
                    let pair = index(i + di, j + dj).zip(index(i + 2 * di, j + 2 * dj));
                    let Some((a, b)) = pair else { continue };
                    let (a, b) = (&self.values[a..a + self.stride], &self.values[b..b + self.stride]);
                    if a[X].is_nan() || b[X].is_nan() {
                        continue;
                    }
                    count += 1.0;
                    for (k, sum) in sum.iter_mut().enumerate() {
                        *sum += match k {
                            OVERSHOOT => a[k].abs(),
                            X | Y => 2.0 * a[k] - b[k],
                            _ => (2.0 * a[k] - b[k]).max(0.0),
                        };
                    }
                }
                if count > 0.0 {
                    found.push((at, sum.iter().map(|v| v / count).collect()));
                }
            }
        }
        for (at, values) in found {
            self.values[at..at + values.len()].copy_from_slice(&values);
        }
    }
}

impl Window {
    /// The point of cell coordinates (i, j) at `tan`, mm.
    pub(super) fn place(&self, i: f64, j: f64, tan: f64) -> (f64, f64) {
        let x = self.x_mm.0 + (self.x_mm.1 - self.x_mm.0) * i / self.cells.0 as f64;
        (x + self.shift_mm * tan, self.y_mm * j / self.cells.1 as f64)
    }

    /// Area of a cell, mm².
    pub(super) fn cell_area_mm2(&self) -> f64 {
        (self.x_mm.1 - self.x_mm.0) * self.y_mm / (self.cells.0 * self.cells.1) as f64
    }
}
