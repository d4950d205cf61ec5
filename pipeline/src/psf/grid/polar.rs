//! Nodes at heights and azimuths about the axis.
//!
//! Node (k, j) lies at REAL image height r_k and azimuth θ_j = 2πj/J_k. Between nodes the PSF is linear in r and, on each height,
//! linear in θ: the PSF at (r, θ) is Σ_kj w_kj(r, θ)·P_kj with
//! ```text
//! w_kj = A_k(r) · B_kj(θ),
//! A_k = max(0, min((r − r_{k−1})/(r_k − r_{k−1}), (r_{k+1} − r)/(r_{k+1} − r_k)));  1 beyond the last height
//! B_kj = max(0, 1 − |θ − θ_j|·J_k/2π), |θ − θ_j| ≤ π;  1 for the axis node, which has no azimuth
//! ```
//! Heights are stored in film pixels.

use super::{Node, NodeWeight, flanks};
use crate::psf::polar::PolarExtent;
use std::f64::consts::TAU;
use std::ops::Range;

/// Heights and azimuths of one band's nodes, heights in film pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct PolarNodes {
    height_px: Vec<f64>,
    azimuths: Vec<usize>,
    first_id: Vec<usize>,
    first_row: Vec<usize>,
}

/// 0 and the sums of the first counts.
fn firsts(counts: &[usize]) -> Vec<usize> {
    let sums = counts.iter().scan(0, |sum, count| {
        *sum += count;
        Some(*sum)
    });
    std::iter::once(0).chain(sums).collect()
}

impl PolarNodes {
    pub(super) fn new(
        height_mm: &[f64],
        azimuths: &[usize],
        azimuth_samples: &[usize],
        pitch_mm: f64,
    ) -> Self {
        assert!(height_mm.len() >= 2 && height_mm.len() == azimuths.len() && azimuths[0] == 1);
        assert!(azimuth_samples.len() == azimuths.len() && azimuth_samples[0] == 1);
        Self {
            height_px: height_mm.iter().map(|h| h / pitch_mm).collect(),
            azimuths: azimuths.to_vec(),
            first_id: firsts(azimuths),
            first_row: firsts(azimuth_samples),
        }
    }

    /// Heights in film pixels.
    pub fn heights_px(&self) -> &[f64] {
        &self.height_px
    }

    /// Azimuths J_k per height.
    pub fn azimuths(&self) -> &[usize] {
        &self.azimuths
    }

    /// PSFs of height `k` in the stack of the band: A_k rows.
    pub fn psf_rows(&self, k: usize) -> Range<usize> {
        self.first_row[k]..self.first_row[k + 1]
    }

    pub(super) fn len(&self) -> usize {
        self.first_id[self.height_px.len()]
    }

    pub(super) fn id(&self, node: Node) -> usize {
        self.first_id[node.k] + node.j
    }

    pub(super) fn azimuth_rad(&self, node: Node) -> f64 {
        TAU * node.j as f64 / self.azimuths[node.k] as f64
    }

    pub(super) fn touching(&self, block: &PolarExtent, out: &mut Vec<(Node, NodeWeight)>) {
        let last = self.height_px.len() - 1;
        let rel = |k: usize| self.height_px[k] - block.r_px;
        for k in 0..=last {
            let inner = (k > 0).then(|| rel(k - 1));
            let outer = (k < last).then(|| rel(k + 1));
            let is_beyond = inner.is_some_and(|inner| f64::from(block.r.1) <= inner);
            if is_beyond || outer.is_some_and(|outer| f64::from(block.r.0) >= outer) {
                continue;
            }
            let [(rise, rise_at), (fall, fall_at)] = flanks(inner, rel(k), outer);
            let weight = |azimuth_rad: f64, per_rad: f64| NodeWeight {
                rise: rise as f32,
                rise_at: rise_at as f32,
                fall: fall as f32,
                fall_at: fall_at as f32,
                azimuth_rad: azimuth_rad as f32,
                per_rad: per_rad as f32,
            };
            let count = self.azimuths[k] as i64;
            if count == 1 {
                out.push((Node { k, j: 0 }, weight(0.0, 0.0)));
                continue;
            }
            let per_rad = count as f64 / TAU;
            let (first, end) = match block.wraps {
                true => (0, count),
                false => {
                    let index =
                        |theta: f32| ((block.azimuth_rad + f64::from(theta)) * per_rad).floor() as i64;
                    let first = index(block.theta.0);
                    (first, (index(block.theta.1) + 2).min(first + count))
                }
            };
            for j in first..end {
                let mut azimuth = j as f64 / per_rad - block.azimuth_rad;
                if block.wraps {
                    azimuth -= TAU * (azimuth / TAU).round();
                }
                out.push((Node { k, j: j.rem_euclid(count) as usize }, weight(azimuth, per_rad)));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::psf::grid::NodeGrid;
    use crate::psf::polar::PolarExtent;

    #[test]
    fn weights_sum_to_one_over_at_most_four_nodes() {
        let grid = NodeGrid::new(&[0.0, 0.3, 0.4, 1.1], &[1, 8, 12, 36], 0.01);
        let mut nodes = Vec::new();
        for (r_px, wraps) in [(5.0, true), (33.0, false), (80.0, false), (140.0, false)] {
            for azimuth_rad in [0.0, 1.0, 3.1, 6.2] {
                let block = PolarExtent { r_px, azimuth_rad, r: (-4.0, 4.0), theta: (-0.15, 0.15), wraps };
                grid.touching(&block, &mut nodes);
                for (r, t) in [(0.0, 0.0), (-4.0, 0.149), (3.3, -0.1), (1.2, 0.02)] {
                    let weights = nodes.iter().map(|(_, weight)| weight.at(r, t, wraps));
                    let weights: Vec<f32> = weights.filter(|w| *w > 0.0).collect();
                    assert!(weights.len() <= 4, "{} nodes at r {r_px}", weights.len());
                    assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-6);
                }
            }
        }
    }

    #[test]
    fn rows_of_a_stack_are_ordered_by_height() {
        let grid = NodeGrid::polar(&[0.0, 0.3, 0.4], &[1, 16, 24], &[1, 8, 12], 0.01);
        assert_eq!([0, 1, 2].map(|k| grid.psf_rows(k)), [0..1, 1..9, 9..21]);
        assert_eq!(grid.psf_sets(), 3);
    }
}
