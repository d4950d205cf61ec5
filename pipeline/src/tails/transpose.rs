//! The transpose of the tails of a band, from the film to the chart.

mod cells;
mod convolution;
mod levels;
mod light;

use super::curve::{curves_along, place_on};
use super::levels::TailKernels;
use super::plan::TailPlan;
use super::remapped::TAIL_MARGIN_BINS;
use crate::geometry::Frame;
use crate::layer::{BinGrid, Taps, coefficients_of_film};
use crate::remap::Remap;
use crate::remap::map::Map;
use crate::simd::lanes::MAX_LANES;
use cells::CellSums;
use light::LightSum;

/// The transpose of the remapped image, read from cells.
struct RemappedSum<'a> {
    map: Map<'a>,
    cells: CellSums,
}

impl LightSum for RemappedSum<'_> {
    fn add_along(&mut self, y: f64, x: f64, step: f64, values: &[f32]) {
        let Self { map, cells } = self;
        curves_along(map, (y, x, step), values.len(), |first, curve| {
            for (i, v) in values[first..].iter().take(MAX_LANES).enumerate().filter(|(_, v)| **v != 0.0) {
                let [row, column, gain] = place_on(&curve, i);
                cells.add_at(row, column, gain * f64::from(*v));
            }
        });
    }
}

impl TailPlan {
    /// The transpose of the layer of the tails on the film: adds the light of `film` (row-major) to the pixels of `chart`, by the map, the gain and the surroundings of `remap`. The same
    /// bits for any number of `threads`.
    ///
    /// # Panics
    /// `remap` is that of a lens without rotational symmetry.
    pub(crate) fn add_transposed(
        &self,
        kernels: &TailKernels,
        frame: &Frame,
        remap: &Remap,
        film: &[f32],
        chart: &mut [f32],
        threads: usize,
    ) {
        let field = remap.field().expect("lenses with tails are symmetric");
        let grid = BinGrid::new(frame.film, self.bin_px(), TAIL_MARGIN_BINS);
        let layer = coefficients_of_film(&grid, Taps::Lagrange, film, threads);
        let lights = levels::lights_of_layer(self, kernels, frame, &layer, TAIL_MARGIN_BINS, threads);
        let cells = CellSums::new(frame.chart, self.cells_px(frame), remap.surround());
        let mut sum = RemappedSum { map: Map::new(frame, field), cells };
        levels::add_lights(self, &mut sum, lights);
        sum.cells.add_to_chart(chart, threads);
    }
}
