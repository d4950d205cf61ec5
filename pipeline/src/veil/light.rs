//! The light of the image on bins of the film, from the reduced chart.
//!
//! I(k, l) = mean over 4 × 4 places of gain · R(r) · chart((X, Y) h(r)/r): the centres of the parts into which each side of the bin is divided.
//! As the remap has it, but with the reduced chart in place of the chart and beyond the film. In f64, places row by row.

use crate::field::Field;
use crate::geometry::{Frame, Size};
use crate::reduced_chart::ReducedChart;
use crate::remap::map::Map;
use crate::resample::Surround;

/// Places along each side of a bin.
const PLACES: usize = 4;

/// The light of bins of `bin_px` film pixels, from `margin` bins before film pixel (0, 0) to `margin` behind the last of the film: `size` bins, row by
/// row. `field` has the heights, and the gain of the band times the relative illumination.
pub fn light_of_bins(
    frame: &Frame,
    field: &Field,
    reduced: &ReducedChart,
    surround: Surround,
    (bin_px, margin): (usize, usize),
    size: Size,
) -> Vec<f64> {
    let map = Map::new(frame, field);
    let place = |bin: usize, part: usize| {
        let first = (bin as f64 - margin as f64) * bin_px as f64;
        first + (part as f64 + 0.5) * bin_px as f64 / PLACES as f64 - 0.5
    };
    let of_bin = |k: usize, l: usize| {
        let mut sum = 0.0;
        for (i, j) in (0..PLACES).flat_map(|i| (0..PLACES).map(move |j| (i, j))) {
            let (row, column, gain) = map.at_place(place(k, i), place(l, j));
            sum += gain * reduced.at(row, column, surround);
        }
        sum / (PLACES * PLACES) as f64
    };
    (0..size.height).flat_map(|k| (0..size.width).map(move |l| (k, l))).map(|(k, l)| of_bin(k, l)).collect()
}
