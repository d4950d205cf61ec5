//! The light of a band's remapped image at any place, from the chart on cells.

use super::cells::ChartCells;
use super::light::{Light, SAMPLES};
use super::plan::TailPlan;
use super::{OUT_MARGIN, levels};
use crate::field::Field;
use crate::geometry::{Frame, Size};
use crate::lens::LensBand;
use crate::options::Options;
use crate::remap::map::Map;
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
}

impl Light for RemappedLight<'_> {
    fn at(&self, y: f64, x: f64) -> f64 {
        let (row, column, gain) = self.map.at_place(y, x);
        gain * self.cells.at(row, column)
    }
}

impl TailPlan {
    /// Sides of the cells that the chart is read into, rows and columns in chart pixels: the distance of samples of the light, half a bin of level 0, or a
    /// multiple of it as the memory for them requires.
    pub fn cells_px(&self, frame: &Frame) -> (usize, usize) {
        let mut samples = 1.0;
        loop {
            let side =
                |scale: f64| (samples * (self.bin_px() / SAMPLES) as f64 / scale).round().max(1.0) as usize;
            let sides = (side(frame.scale.0), side(frame.scale.1));
            let cells = frame.chart.height.div_ceil(sides.0) * frame.chart.width.div_ceil(sides.1);
            if cells <= MAX_CELLS {
                return sides;
            }
            samples *= 2.0;
        }
    }

    /// The coefficients of the layer of the band with the tables `band`, row by row on its bins and [`TAIL_MARGIN_BINS`] around, from its chart on
    /// cells; `gain` multiplies the remapped image. The same bits for any number of `threads`.
    pub fn layer(
        &self,
        frame: &Frame,
        band: &LensBand,
        options: &Options,
        gain: f64,
        cells: &ChartCells,
        threads: usize,
    ) -> Vec<f32> {
        let stages = options.stages;
        let (distortion, illumination) = (stages.has(Stage::Distortion), stages.has(Stage::Ri));
        let field = Field::new(band, frame.pitch_mm(), distortion, illumination, gain);
        let light = RemappedLight { map: Map::new(frame, &field), cells };
        levels::layer(self, frame, &light, TAIL_MARGIN_BINS, threads)
    }

    /// Bytes while the layer of a band of a chart of `chart` px is computed on `threads` threads.
    pub fn all_making_bytes(&self, frame: &Frame, chart: Size, threads: usize) -> usize {
        let (cells, reading) = ChartCells::bytes(chart, self.cells_px(frame), threads);
        cells + reading.max(self.making_bytes())
    }
}
