//! The light of a band's remapped image at any place, from the chart on cells.

use super::OUT_MARGIN;
use super::cells::ChartCells;
use super::curve::curves_along;
use super::levels::{self, TailKernels};
use super::light::{Light, SAMPLES};
use super::plan::TailPlan;
use crate::field::Field;
use crate::geometry::{Frame, Size};
use crate::lens::LensBand;
use crate::options::Options;
use crate::remap::map::Map;
use crate::simd::Simd;
use crate::simd::lanes::MAX_LANES;
use crate::stage::Stage;

/// Bins around those of the film in a stored layer: what its interpolation reads.
pub const TAIL_MARGIN_BINS: usize = 2;
const _: () = assert!(TAIL_MARGIN_BINS <= OUT_MARGIN);
/// Maximum of cells of a chart, 64 MiB; larger charts have cells of several samples.
const MAX_CELLS: usize = 1 << 24;

/// The remapped image, read from cells.
struct RemappedLight<'a> {
    map: Map<'a>,
    cells: &'a ChartCells,
    simd: Simd,
}

impl Light for RemappedLight<'_> {
    fn along(&self, y: f64, x: f64, step: f64, out: &mut [f32]) {
        let places = (y, x, step);
        curves_along(&self.map, places, out.len(), |first, curve| {
            let mut values = [0.0; MAX_LANES];
            self.cells.along(curve, self.simd, &mut values);
            let out = &mut out[first..];
            let count = out.len().min(MAX_LANES);
            out[..count].copy_from_slice(&values[..count]);
        });
    }
}

impl TailPlan {
    /// Sides of the cells that the chart is read into, rows and columns in chart pixels.
    pub fn cells_px(&self, frame: &Frame) -> (usize, usize) {
        Self::cells_px_of(frame, self.bin_px())
    }

    /// Sides of cells for bins of `bin_px` at level 0: the distance of samples of the light, half a bin, or a multiple of it as the memory for them requires.
    pub(super) fn cells_px_of(frame: &Frame, bin_px: usize) -> (usize, usize) {
        let mut samples = 1.0;
        loop {
            let side = |scale: f64| (samples * (bin_px / SAMPLES) as f64 / scale).round().max(1.0) as usize;
            let sides = (side(frame.scale.0), side(frame.scale.1));
            let cells = frame.chart.height.div_ceil(sides.0) * frame.chart.width.div_ceil(sides.1);
            if cells <= MAX_CELLS {
                return sides;
            }
            samples *= 2.0;
        }
    }

    /// The coefficients of the layer of the band with the tables `band`, row by row on its bins and [`TAIL_MARGIN_BINS`] around, from its chart on
    /// cells, which are dropped as soon as they are read; `gain` multiplies the remapped image. The same bits for any number of `threads` and any instructions.
    pub fn layer(
        &self,
        kernels: &TailKernels,
        frame: &Frame,
        band: &LensBand,
        options: &Options,
        (cells, gain): (ChartCells, f64),
        threads: usize,
    ) -> Vec<f32> {
        let stages = options.stages;
        let (distortion, illumination) = (stages.has(Stage::Distortion), stages.has(Stage::Ri));
        let field = Field::on_chart(band, frame, distortion, illumination, gain);
        let lights = {
            let light = RemappedLight { map: Map::new(frame, &field), cells: &cells, simd: options.simd };
            levels::lights(self, &light, threads)
        };
        drop(cells);
        levels::layer(self, kernels, frame, lights, TAIL_MARGIN_BINS, threads)
    }

    /// Bytes while the layer of a band of a chart of `chart` px is computed on `threads` threads.
    pub fn all_making_bytes(&self, frame: &Frame, chart: Size, threads: usize) -> usize {
        let (cells, reading) = ChartCells::bytes(chart, self.cells_px(frame), threads);
        (cells + reading.max(self.light_bytes())).max(self.making_bytes(threads))
    }
}

#[cfg(test)]
mod tests;
