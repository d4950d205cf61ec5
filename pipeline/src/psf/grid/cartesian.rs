//! Nodes in columns and rows of the film.
//!
//! Node (k, j) lies at (x_k, y_j), x right and y down from the axis, both uniform with steps h_x, h_y. The PSF is bilinear between nodes and
//! that of the nearest edge beyond the outermost ones: the PSF at (x, y) is Σ_kj w_kj(x, y)·P_kj, not rotated, with
//! ```text
//! w_kj = max(0, min((x − x_{k−1})/h_x, (x_{k+1} − x)/h_x)) · max(0, 1 − |y − y_j|/h_y)
//! ```
//! of which the flanks towards missing columns are 1, and rows beyond either end have the PSFs of the end.
//! The rows of a stack are the nodes, row j after row j − 1, as [`NodeGrid::id`](super::NodeGrid::id) numbers them.

use super::{Node, NodeWeight, flanks};
use crate::psf::polar::PolarExtent;
use std::ops::Range;

/// Columns and rows of one band's nodes.
#[derive(Clone, Debug, PartialEq)]
pub struct CartesianNodes {
    x: Positions,
    y: Positions,
}

/// Uniform positions along one direction, px from the axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Positions {
    first_px: f64,
    /// Infinite for one position.
    step_px: f64,
    count: usize,
}

impl Positions {
    fn new(at_mm: &[f64], pitch_mm: f64) -> Self {
        let (first_mm, last_mm) = (at_mm[0], at_mm[at_mm.len() - 1]);
        let step_px = match at_mm.len() {
            1 => f64::INFINITY,
            n => (last_mm - first_mm) / (n - 1) as f64 / pitch_mm,
        };
        Self { first_px: first_mm / pitch_mm, step_px, count: at_mm.len() }
    }

    /// Number of positions.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Distance of two positions, px; infinite for one.
    pub fn step_px(&self) -> f64 {
        self.step_px
    }

    /// Position `i`, which may lie beyond either end, px.
    pub fn at_px(&self, i: i64) -> f64 {
        if self.count == 1 { self.first_px } else { self.first_px + i as f64 * self.step_px }
    }

    /// The last position that is not above `at_px`, beyond either end too; 0 for one position.
    fn below(&self, at_px: f64) -> i64 {
        ((at_px - self.first_px) / self.step_px).floor() as i64
    }

    /// The position whose PSF stands at position `i`.
    fn clamped(&self, i: i64) -> usize {
        i.clamp(0, self.count as i64 - 1) as usize
    }
}

impl CartesianNodes {
    pub(super) fn new(x_mm: &[f64], y_mm: &[f64], pitch_mm: f64) -> Self {
        Self { x: Positions::new(x_mm, pitch_mm), y: Positions::new(y_mm, pitch_mm) }
    }

    /// Columns.
    pub fn x(&self) -> &Positions {
        &self.x
    }

    /// Rows.
    pub fn y(&self) -> &Positions {
        &self.y
    }

    pub(super) fn len(&self) -> usize {
        self.x.count * self.y.count
    }

    pub(super) fn id(&self, node: Node) -> usize {
        node.j * self.x.count + node.k
    }

    pub(super) fn touching(&self, block: &PolarExtent, out: &mut Vec<(Node, NodeWeight)>) {
        let last = self.x.count - 1;
        let rel = |k: usize| self.x.at_px(k as i64) - block.r_px;
        let (rows, is_beyond_rows) = self.rows(block);
        for k in 0..=last {
            let inner = (k > 0).then(|| rel(k - 1));
            let outer = (k < last).then(|| rel(k + 1));
            let is_beyond = inner.is_some_and(|inner| f64::from(block.r.1) <= inner);
            if is_beyond || outer.is_some_and(|outer| f64::from(block.r.0) >= outer) {
                continue;
            }
            let [(rise, rise_at), (fall, fall_at)] = flanks(inner, rel(k), outer);
            for j in rows.clone() {
                let (y, per_px) = match is_beyond_rows {
                    true => (0.0, 0.0),
                    false => (self.y.at_px(j) - block.azimuth_rad, 1.0 / self.y.step_px),
                };
                let weight = NodeWeight {
                    rise: rise as f32,
                    rise_at: rise_at as f32,
                    fall: fall as f32,
                    fall_at: fall_at as f32,
                    azimuth_rad: y as f32,
                    per_rad: per_px as f32,
                };
                out.push((Node { k, j: self.y.clamped(j) }, weight));
            }
        }
    }

    /// The rows whose weight may be above 0 in `block`, and whether it lies entirely beyond the rows: it then has the row of that end alone,
    /// of weight 1.
    fn rows(&self, block: &PolarExtent) -> (Range<i64>, bool) {
        let below = |edge: f32| self.y.below(block.azimuth_rad + f64::from(edge));
        let (first, last, end) = (below(block.theta.0), below(block.theta.1), self.y.count as i64 - 1);
        match last < 0 || first >= end {
            true => {
                let row = first.clamp(0, end);
                (row..row + 1, true)
            }
            false => (first..last + 2, false),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::NodeGrid;
    use super::*;

    /// Sums over the nodes, of what bilinear interpolation keeps: 1, and the place of a node clamped to the grid.
    #[test]
    fn weights_are_bilinear_and_beyond_the_nodes_those_of_the_edge() {
        let (x_mm, y_mm) = ([-0.4, -0.1, 0.2, 0.5], [-0.3, 0.0, 0.3]);
        let grid = NodeGrid::cartesian(&x_mm, &y_mm, 0.01);
        let mut nodes = Vec::new();
        for (x, y) in [(0.0, 0.0), (-25.0, 21.0), (37.0, -29.0), (48.0, 28.0), (-300.0, 33.0), (10.0, -500.0)]
        {
            let block =
                PolarExtent { r_px: x, azimuth_rad: y, r: (-9.5, 9.5), theta: (-7.0, 7.0), wraps: false };
            grid.touching(&block, &mut nodes);
            for (dx, dy) in [(0.0, 0.0), (-9.5, 7.0), (3.5, -7.0), (9.5, 1.0)] {
                let mut sums = [0.0; 3];
                let mut positive = 0;
                for (node, weight) in &nodes {
                    let w = f64::from(weight.at(dx, dy, false));
                    positive += usize::from(w > 0.0);
                    for (sum, v) in sums.iter_mut().zip([1.0, 100.0 * x_mm[node.k], 100.0 * y_mm[node.j]]) {
                        *sum += w * v;
                    }
                }
                let expected =
                    [1.0, (x + f64::from(dx)).clamp(-40.0, 50.0), (y + f64::from(dy)).clamp(-30.0, 30.0)];
                assert!(positive <= 4, "{positive} nodes at ({x}, {y})");
                for (sum, expected) in sums.iter().zip(expected) {
                    assert!((sum - expected).abs() < 1e-5, "({x}, {y}): {sums:?}, expected {expected}");
                }
            }
        }
    }

    #[test]
    fn one_node_has_weight_1_everywhere() {
        let grid = NodeGrid::cartesian(&[0.1], &[-0.2], 0.01);
        let block =
            PolarExtent { r_px: -70.0, azimuth_rad: 90.0, r: (-9.5, 9.5), theta: (-7.0, 7.0), wraps: false };
        let mut nodes = Vec::new();
        grid.touching(&block, &mut nodes);
        assert_eq!(nodes.len(), 1);
        assert_eq!(nodes[0].1.at(3.0, -4.0, false), 1.0);
    }
}
