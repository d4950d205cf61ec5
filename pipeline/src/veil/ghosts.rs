//! Ghosts of a scene on the bins of a film.
//!
//! ```text
//! V(x, y) = gain · (power of ring and azimuth at (x, y)) / their area,     power on the film's rings = operator · power on the scene's rings
//! ```
//! The scene is the reduced chart on the ideal plane: each of its cells puts value × area on the rings and azimuths about it, in parts of at most half a ring, smaller near the axis. Light is in the units of
//! the film, by the gain of the image's axis ([`crate::design::ghost`]); read at the centres of the bins, beyond the last ring with its value. What the chart does not show has no ghosts.

use crate::design::ghost::rings::{RingOperator, RingPower};
use crate::geometry::Frame;
use crate::layer::BinGrid;
use crate::projection::Projection;
use crate::reduced_chart::ReducedChart;

/// Most parts of a side of a cell.
const MAX_PARTS: f64 = 64.0;

/// The ghosts of `reduced` at the bins of `grid`, row by row; `gain` is that of the image.
pub fn ghosts_on_bins(
    frame: &Frame,
    grid: &BinGrid,
    operator: &RingOperator,
    gain: f64,
    reduced: &ReducedChart,
) -> Vec<f64> {
    let film = operator.apply(&on_rings(frame, operator, reduced));
    let (size, pitch) = (grid.size(), frame.pitch_mm());
    let place = |bin: usize, axis: f64| {
        let middle = grid.first_pixel() as f64 + (bin as f64 + 0.5) * grid.bin_px as f64 - 0.5;
        (middle - axis) * pitch
    };
    let bins = (0..size.height).flat_map(|k| (0..size.width).map(move |l| (k, l)));
    bins.map(|(k, l)| {
        let at = (place(l, frame.axis_px.1), place(k, frame.axis_px.0));
        gain * film.density(&operator.sizes, at)
    })
    .collect()
}

/// Power of the reduced chart on the rings of the scene, in chart units × mm².
fn on_rings(frame: &Frame, operator: &RingOperator, reduced: &ReducedChart) -> RingPower {
    let sizes = operator.sizes;
    let mut scene = RingPower::dark(sizes.source_rings, sizes.azimuths());
    let (chart, cells, side) = (frame.chart, reduced.size(), reduced.side());
    // Chart pixels, mm.
    let pixel = (frame.pitch_mm() * frame.scale.0, frame.pitch_mm() * frame.scale.1);
    let side_mm = side as f64 * pixel.0.max(pixel.1);
    let arc = std::f64::consts::PI / sizes.orders() as f64;
    let middle = |cell: usize, pixels: usize, pixel: f64, centre: f64| {
        centre + ((cell * side) as f64 + 0.5 * side as f64 - 0.5 * pixels as f64) * pixel
    };
    for (cell, value) in reduced.values().iter().enumerate().filter(|(_, v)| **v != 0.0) {
        let (i, j) = (cell / cells.width, cell % cells.width);
        let (y, x) = (
            middle(i, chart.height, pixel.0, frame.center_mm.0),
            middle(j, chart.width, pixel.1, frame.center_mm.1),
        );
        // Half a ring, near the axis half a period of the last order.
        let r = (x * x + y * y).sqrt();
        let (across, along) = frame.projection.scale(r);
        let finest = (0.5 * sizes.ring_mm).min(arc * (r * across));
        let parts = (side_mm * across.max(along) / finest).ceil().clamp(1.0, MAX_PARTS);
        let part = |cell: usize, k: usize, pixels: usize, pixel: f64, centre: f64| {
            let width = side.min(pixels - cell * side) as f64;
            let at = (cell * side) as f64 + (k as f64 + 0.5) * width / parts - 0.5;
            (centre + (at - (pixels as f64 - 1.0) / 2.0) * pixel, width * pixel / parts)
        };
        for k in 0..parts as usize {
            let (y, height) = part(i, k, chart.height, pixel.0, frame.center_mm.0);
            for l in 0..parts as usize {
                let (x, width) = part(j, l, chart.width, pixel.1, frame.center_mm.1);
                let (at, area) = on_ideal_plane(&frame.projection, [x, y], height * width);
                scene.add(&sizes, at, f64::from(*value) * area);
            }
        }
    }
    scene
}

/// The point `[x, y]` of the chart, mm, and the area `mm2` there, on the ideal image plane.
fn on_ideal_plane(projection: &Projection, [x, y]: [f64; 2], mm2: f64) -> ((f64, f64), f64) {
    match projection {
        Projection::Planar => ((x, y), mm2),
        Projection::Film(_) => {
            let (across, along) = projection.scale((x * x + y * y).sqrt());
            ((x * across, y * across), mm2 * across * along)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::ghost::rings::RingSizes;
    use crate::geometry::Size;

    /// All light of a ring stays on it, a thousandth: the ghost is the scene.
    fn same(sizes: RingSizes) -> RingOperator {
        let mut values = vec![0.0; (sizes.orders() + 1) * sizes.rings * sizes.source_rings];
        for m in 0..=sizes.orders() {
            for ring in 0..sizes.rings {
                values[(m * sizes.rings + ring) * sizes.source_rings + ring] = 1e-3;
            }
        }
        RingOperator { sizes, values }
    }

    #[test]
    fn ghosts_of_an_even_scene_and_of_a_lamp_lie_where_they_belong() {
        let (film, chart) = (Size::new(200, 320), Size::new(230, 350));
        let mut frame = Frame::centred(film, chart, 10.0);
        frame.axis_px = (80.0, 170.0);
        frame.center_mm = (0.2, -0.1);
        let grid = BinGrid::new(film, 8, 2);
        let corner = frame.farthest_mm(crate::geometry::Rect::new(0, 0, film.height, film.width));
        let sizes = RingSizes::new(corner, 32);
        let operator = same(sizes);
        let even = ReducedChart::of_cells(chart, 8, vec![2.0; ReducedChart::cells(chart, 8).pixels()]);
        let light = ghosts_on_bins(&frame, &grid, &operator, 3.0, &even);
        let at = |k: usize, l: usize| light[(k + 2) * grid.size().width + l + 2];
        for (k, l) in [(12, 26), (3, 30), (20, 6)] {
            assert!((at(k, l) / 6e-3 - 1.0).abs() < 0.03, "{} at {k}, {l}", at(k, l));
        }
        // A lamp of 2 x 2 cells: its ghost has its place and its power.
        let cells = ReducedChart::cells(chart, 8);
        let mut values = vec![0.0; cells.pixels()];
        for (i, j) in [(8, 30), (8, 31), (9, 30), (9, 31)] {
            values[i * cells.width + j] = 5.0;
        }
        let lamp = ReducedChart::of_cells(chart, 8, values);
        let light = ghosts_on_bins(&frame, &grid, &operator, 1.0, &lamp);
        let bin_mm = 8.0 * frame.pitch_mm();
        let (mut sum, mut x, mut y) = (0.0, 0.0, 0.0);
        for (at, value) in light.iter().enumerate() {
            let place = |bin: usize, axis: f64| (bin as f64 * 8.0 - 16.0 + 3.5 - axis) * frame.pitch_mm();
            sum += value * bin_mm * bin_mm;
            x += value * bin_mm * bin_mm * place(at % grid.size().width, frame.axis_px.1);
            y += value * bin_mm * bin_mm * place(at / grid.size().width, frame.axis_px.0);
        }
        let power = 5.0 * (0.16_f64).powi(2) * 1e-3;
        let centre =
            |first: f64, n: usize, shift: f64| shift + (8.0 * first - 0.5 - (n as f64 - 1.0) / 2.0) * 0.01;
        assert!((sum / power - 1.0).abs() < 0.03, "{sum} of {power}");
        assert!((x / sum - centre(31.0, chart.width, -0.1)).abs() < 0.02, "{}", x / sum);
        assert!((y / sum - centre(9.0, chart.height, 0.2)).abs() < 0.02, "{}", y / sum);
    }
}
