//! The nodes that have a share in a block, found without computing the place of every pixel.

use crate::psf::grid::{Node, NodeGrid, NodeWeight};
use crate::psf::polar::BlockPlace;
use crate::psf::polar::PolarExtent;
use crate::real;
use std::f64::consts::{PI, TAU};

/// Margins of a block's reach, px and rad: far more than the error of f32, far less than what changes a node's share.
const SLACK_PX: f64 = 1e-3;
const SLACK_RAD: f64 = 1e-6;

/// The nodes that may have a share in a block, in the order of the sum. Near the axis azimuths may wrap inside the block: a node
/// is then listed once for each multiple of 2π at which it overlaps the block's azimuths, which are within −π to π; the shares
/// do not overlap.
pub(super) fn touching(place: &BlockPlace, grid: &NodeGrid) -> Vec<(Node, NodeWeight)> {
    let reach = reach(place);
    let mut nodes = Vec::new();
    grid.touching(&reach, &mut nodes);
    if !reach.wraps {
        return nodes;
    }
    let (low, high) = (f64::from(reach.theta.0), f64::from(reach.theta.1));
    let mut wrapped = Vec::new();
    for (node, weight) in nodes {
        let spacing = 1.0 / f64::from(weight.per_rad);
        if spacing.is_infinite() {
            wrapped.push((node, weight)); // the axis node covers every azimuth
            continue;
        }
        let azimuths = [0.0, -TAU, TAU].map(|angle| f64::from(weight.azimuth_rad) + angle);
        let overlapping = azimuths.into_iter().filter(|a| a - spacing < high && a + spacing > low);
        wrapped.extend(overlapping.map(|a| (node, NodeWeight { azimuth_rad: a as f32, ..weight })));
    }
    wrapped
}

/// Bounds of the polar coordinates of a block's pixels, with a margin.
fn reach(place: &BlockPlace) -> PolarExtent {
    let (_, _, r_px, azimuth_rad, around) = place.centre();
    let (top, left) = (place.dy_px, place.dx_px);
    let (bottom, right) = (top + (place.rows - 1) as f64, left + (place.cols - 1) as f64);
    let nearest = real::hypot(0f64.clamp(top, bottom), 0f64.clamp(left, right));
    let farthest = real::hypot(top.abs().max(bottom.abs()), left.abs().max(right.abs()));
    // The extreme azimuths of a block that does not contain the axis are at its corners.
    let (mut low, mut high) = (0f64, 0f64);
    for (y, x) in [(top, left), (top, right), (bottom, left), (bottom, right)] {
        let angle = real::atan2(y, x) - azimuth_rad;
        let angle = angle - TAU * (angle / TAU).round();
        (low, high) = (low.min(angle), high.max(angle));
    }
    if top < 1.0 && bottom > -1.0 && left < 1.0 && right > -1.0 {
        (low, high) = (-PI, PI);
    }
    PolarExtent {
        r_px,
        azimuth_rad,
        r: ((nearest - r_px - SLACK_PX) as f32, (farthest - r_px + SLACK_PX) as f32),
        theta: ((low - SLACK_RAD) as f32, (high + SLACK_RAD) as f32),
        wraps: around,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shares(place: &BlockPlace, grid: &NodeGrid, y: usize, x: usize) -> Vec<(Node, f32)> {
        let (mut r, mut theta) = (vec![0.0; place.rows * place.cols], vec![0.0; place.rows * place.cols]);
        place.polar(place.cols, &mut r, &mut theta);
        let i = y * place.cols + x;
        let nodes = touching(place, grid);
        nodes.iter().map(|(n, t)| (*n, t.at(r[i], theta[i], false))).filter(|(_, w)| *w > 0.0).collect()
    }

    #[test]
    fn nodes_of_a_block_are_those_of_the_cpu_anywhere() {
        let grid = NodeGrid::new(&[0.0, 0.3, 0.4, 1.1, 3.0], &[1, 4, 12, 36, 72], 0.01);
        let rc: [(f64, f64); 8] = [
            (-40.0, -35.5),
            (-80.0, -20.0),
            (3.0, 4.0),
            (-90.0, -0.5),
            (0.0, 100.0),
            (-31.0, -150.0),
            (0.0, 0.0),
            (60.0, -300.0),
        ];
        for (dy_px, dx_px) in rc {
            let place = BlockPlace { dy_px, dx_px, rows: 71, cols: 78 };
            let mut all = Vec::new();
            let (mut r, mut theta) = (vec![0.0; 71 * 78], vec![0.0; 71 * 78]);
            let reach = place.polar(78, &mut r, &mut theta);
            grid.touching(&reach, &mut all);
            for (y, x) in [(0, 0), (70, 77), (0, 77), (70, 0), (35, 40), (40, 35), (41, 36)] {
                let i = y * 78 + x;
                let cpu = all.iter().map(|(n, t)| (*n, t.at(r[i], theta[i], reach.wraps)));
                let mut cpu: Vec<_> = cpu.filter(|(_, w)| *w > 1e-6).collect();
                let mut gpu = shares(&place, &grid, y, x);
                gpu.retain(|(_, w)| *w > 1e-6);
                cpu.sort_by_key(|(n, _)| *n);
                gpu.sort_by_key(|(n, _)| *n);
                assert_eq!(cpu.len(), gpu.len(), "{place:?} at {y}, {x}: {cpu:?}, {gpu:?}");
                for ((n, a), (m, b)) in cpu.iter().zip(&gpu) {
                    assert!(n == m && (a - b).abs() < 1e-5, "{n:?} {a}, {m:?} {b}");
                }
            }
        }
    }

    #[test]
    fn blocks_near_but_beside_the_axis_exclude_nodes_behind_it() {
        let grid = NodeGrid::new(&[0.0, 0.5, 1.0, 1.5, 2.0], &[1, 72, 72, 72, 72], 0.01);
        let count = |dx_px| touching(&BlockPlace { dy_px: -35.0, dx_px, rows: 71, cols: 71 }, &grid).len();
        // The axis node and all of the first ring; the nodes of two rings within 74° of +x.
        assert!(count(-35.0) >= 73 && count(10.0) < 73, "{} {}", count(-35.0), count(10.0));
    }
}
