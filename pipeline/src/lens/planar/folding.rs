//! Whether a map folds: J = det ∂(ideal)/∂(film), in mm per mm, is positive at the nodes and on a grid three times as fine.

use super::PlanarMap;
use crate::spline::tensor::{TensorSpline, cell_of, slope_weights};
use crate::spline::weights;

/// Places per cell and direction.
const PLACES: usize = 3;

/// The place (X, Y) in mm where J is least, and J there.
pub(super) fn least_area(map: &PlanarMap) -> ((f64, f64), f64) {
    let ideal = [&map.ideal_x_mm, &map.ideal_y_mm].map(|table| TensorSpline::new(table, map.x_mm.len()));
    let (step_x, step_y) = map.steps_mm();
    let across = places(map.x_mm.len() - 1);
    let mut least = ((0.0, 0.0), f64::INFINITY);
    for (v, (cell, fraction)) in places(map.y_mm.len() - 1) {
        // The coefficients of X and Y along the row and of their slopes down.
        let (value, slope) = (weights(fraction), slope_weights(fraction));
        let [x, y, x_down, y_down] = [(0, value), (1, value), (0, slope), (1, slope)]
            .map(|(axis, weights): (usize, [f64; 4])| reduced(&ideal[axis], cell, weights));
        for (u, (cell, fraction)) in &across {
            let (value, slope) = (weights(*fraction), slope_weights(*fraction));
            let sum = |line: &[f64], w: &[f64; 4]| -> f64 {
                w.iter().zip(&line[*cell..]).map(|(w, c)| w * c).sum()
            };
            let area = sum(&x, &slope) * sum(&y_down, &value) - sum(&x_down, &value) * sum(&y, &slope);
            let area = area / (step_x * step_y);
            if area < least.1 {
                least = ((map.x_mm[0] + u * step_x, map.y_mm[0] + v * step_y), area);
            }
        }
    }
    least
}

/// The places of a line of `cells` cells, in nodes from the first, with their cells and fractions.
fn places(cells: usize) -> Vec<(f64, (usize, f64))> {
    let at = |k: usize| k as f64 / PLACES as f64;
    (0..=cells * PLACES).map(|k| (at(k), cell_of(at(k), cells))).collect()
}

/// Coefficients along a row of the film in cell row `cell`.
fn reduced(spline: &TensorSpline, cell: usize, weights: [f64; 4]) -> Vec<f64> {
    let width = spline.columns + 2;
    let mut line = vec![0.0; width];
    for (w, from) in weights.iter().zip(spline.coefficients[cell * width..].chunks_exact(width)) {
        line.iter_mut().zip(from).for_each(|(to, c)| *to += w * c);
    }
    line
}
