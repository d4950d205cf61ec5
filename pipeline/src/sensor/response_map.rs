//! The response of each filter over a sensor whose response depends on the angle of incidence, relative to perpendicular light: what a development undoes.
//!
//! ```text
//! A_c(x, y) = Σ_b W_cb(x, y) / Σ_b w_cb          light of the same irradiance in all bands of the film; W, w: [`super::field_weights`]
//! ```
//! at the nodes of a grid over the whole sensor, linear between them (as gain maps of DNG are): of a smooth response within 1e-3.

use super::Sensor;
use super::field_weights::FieldWeights;
use crate::geometry::Size;

/// Cells along the longer side of a sensor, and along the other one at least.
const CELLS: (usize, usize) = (32, 1);

/// The response of each filter at the nodes of a grid.
#[derive(Clone, Debug, PartialEq)]
pub struct ResponseMap {
    /// Cells along rows and columns of the sensor.
    pub cells: (usize, usize),
    /// The sensor's pixels.
    pub size: Size,
    /// By filter, row by row of nodes.
    pub filters: Vec<Vec<f32>>,
}

impl ResponseMap {
    /// Of `sensor` of `size` px with the weights `field` of bands at `bands_nm`, of which a value of 1 is the irradiance `scales`.
    pub fn new(
        sensor: &Sensor,
        size: Size,
        field: &FieldWeights,
        (bands_nm, scales): (&[f64], &[f64]),
    ) -> Self {
        let longer = size.height.max(size.width);
        let along = |n: usize| (CELLS.0 * n).div_ceil(longer).max(CELLS.1);
        let cells = (along(size.height), along(size.width));
        let of_filter = |filter: usize| {
            let weights = sensor.band_weights(filter, bands_nm);
            let all: f64 = weights.iter().sum();
            let at = |row: usize, column: usize| {
                let place = |node: usize, cells: usize, n: usize| (node * n) as f64 / cells as f64;
                let (y, x) = (place(row, cells.0, size.height), place(column, cells.1, size.width));
                // `field` has the scales of the bands.
                let of = |band: usize| field.difference_at((filter, band), y, x) / scales[band];
                let more: f64 = (0..bands_nm.len()).map(of).sum();
                // A filter that sees no band of the film has nothing to undo.
                if all > 0.0 { (1.0 + more / (all * sensor.area_m2())) as f32 } else { 1.0 }
            };
            (0..=cells.0)
                .flat_map(|row| (0..=cells.1).map(move |column| (row, column)))
                .map(|(y, x)| at(y, x))
                .collect()
        };
        Self { cells, size, filters: (0..sensor.channels.len()).map(of_filter).collect() }
    }

    /// The response of `filter` at the middle of pixel (row, column) of the sensor, which may lie between pixels.
    #[inline]
    pub fn at(&self, filter: usize, (row, column): (f32, f32)) -> f32 {
        let place = |at: f32, n: usize, cells: usize| {
            let u = ((at + 0.5) * (cells as f32 / n as f32)).clamp(0.0, cells as f32);
            let cell = (u as usize).min(cells - 1);
            (cell, u - cell as f32)
        };
        let (y, down) = place(row, self.size.height, self.cells.0);
        let (x, across) = place(column, self.size.width, self.cells.1);
        let line = |y: usize| {
            let nodes = &self.filters[filter][y * (self.cells.1 + 1) + x..][..2];
            nodes[0] + (nodes[1] - nodes[0]) * across
        };
        let above = line(y);
        above + (line(y + 1) - above) * down
    }
}
