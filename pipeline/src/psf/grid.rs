//! The polar grid of PSF nodes on the film, and the weight of each node at a pixel.
//!
//! Node (k, j) lies at REAL image height r_k and azimuth θ_j = 2πj/J_k. Between nodes the PSF is linear in r and, on each height,
//! linear in θ: the PSF at (r, θ) is Σ_kj w_kj(r, θ)·P_kj with
//! ```text
//! w_kj = A_k(r) · B_kj(θ),
//! A_k = max(0, min((r − r_{k−1})/(r_k − r_{k−1}), (r_{k+1} − r)/(r_{k+1} − r_k)));  1 beyond the last height
//! B_kj = max(0, 1 − |θ − θ_j|·J_k/2π), |θ − θ_j| ≤ π;  1 for the axis node, which has no azimuth
//! ```
//! At most four weights of a pixel are above 0; they sum to 1. Heights are stored in film pixels. Within a block of pixels r and θ
//! are relative to the block's centre, so that f32 weights are exact to about 1e-7 anywhere on a 14,141² film.

use std::f64::consts::TAU;

/// Heights and azimuths of one band's nodes, heights in film pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct NodeGrid {
    height_px: Vec<f64>,
    azimuths: Vec<usize>,
    first_id: Vec<usize>,
}

/// One node: height index k, azimuth index j.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Node {
    /// Height index.
    pub k: usize,
    /// Azimuth index, below J_k.
    pub j: usize,
}

/// The weight of one node as a function of (r, θ), both relative to the block's centre (px, rad):
/// `max(0, min(r·rise + rise_at, r·fall + fall_at)) · max(0, 1 − d·per_rad)`, d = |θ − azimuth_rad| ≤ π.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NodeWeight {
    /// Slope of the inner flank, 1/px (0 for the axis node).
    pub rise: f32,
    /// Inner flank at the block's centre.
    pub rise_at: f32,
    /// Slope of the outer flank, 1/px, ≤ 0 (0 for the last height).
    pub fall: f32,
    /// Outer flank at the block's centre.
    pub fall_at: f32,
    /// Node azimuth relative to the block's centre, rad.
    pub azimuth_rad: f32,
    /// J_k/2π, 1/rad; 0 for the axis node.
    pub per_rad: f32,
}

impl NodeWeight {
    /// The weight at (r, θ); `wraps` if azimuths may wrap inside the block.
    #[inline(always)]
    pub fn at(&self, r: f32, theta: f32, wraps: bool) -> f32 {
        let radial = (r * self.rise + self.rise_at).min(r * self.fall + self.fall_at).max(0.0);
        let mut d = (theta - self.azimuth_rad).abs();
        if wraps {
            d = d.min(TAU as f32 - d);
        }
        radial * (1.0 - d * self.per_rad).max(0.0)
    }
}

/// Extent of a block of pixels in polar coordinates about the axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PolarExtent {
    /// Radius of the block's centre, px.
    pub r_px: f64,
    /// Azimuth of the block's centre, rad.
    pub azimuth_rad: f64,
    /// Smallest and largest r of a pixel, relative to `r_px`.
    pub r: (f32, f32),
    /// Smallest and largest θ of a pixel, relative to `azimuth_rad`; not used if `wraps`.
    pub theta: (f32, f32),
    /// Whether the block is so near the axis that azimuths may wrap inside it.
    pub wraps: bool,
}

impl NodeGrid {
    /// The grid of heights `height_mm` (REAL, ascending from 0) with `azimuths` per height on a film of `pitch_mm`.
    pub fn new(height_mm: &[f64], azimuths: &[usize], pitch_mm: f64) -> Self {
        assert!(height_mm.len() >= 2 && height_mm.len() == azimuths.len() && azimuths[0] == 1);
        let mut first_id = vec![0];
        for &j in azimuths {
            first_id.push(first_id[first_id.len() - 1] + j);
        }
        Self {
            height_px: height_mm.iter().map(|h| h / pitch_mm).collect(),
            azimuths: azimuths.to_vec(),
            first_id,
        }
    }

    /// Heights of the nodes in film pixels.
    pub fn heights_px(&self) -> &[f64] {
        &self.height_px
    }

    /// Azimuths J_k per height.
    pub fn azimuths(&self) -> &[usize] {
        &self.azimuths
    }

    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.first_id[self.height_px.len()]
    }

    /// Always false: a grid has at least its axis node.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// Index of a node, below [`NodeGrid::len`].
    pub fn id(&self, node: Node) -> usize {
        self.first_id[node.k] + node.j
    }

    /// Azimuth of a node in rad.
    pub fn azimuth_rad(&self, node: Node) -> f64 {
        TAU * node.j as f64 / self.azimuths[node.k] as f64
    }

    /// The nodes whose weight may be above 0 in `block`, by height and azimuth: the order of summation.
    pub fn touching(&self, block: &PolarExtent, out: &mut Vec<(Node, NodeWeight)>) {
        out.clear();
        let last = self.height_px.len() - 1;
        let rel = |k: usize| self.height_px[k] - block.r_px;
        for k in 0..=last {
            let inner = if k == 0 { f64::NEG_INFINITY } else { rel(k - 1) };
            let outer = if k == last { f64::INFINITY } else { rel(k + 1) };
            if f64::from(block.r.1) <= inner || f64::from(block.r.0) >= outer {
                continue;
            }
            let (rise, rise_at) = match k {
                0 => (0.0, 1.0),
                _ => (1.0 / (rel(k) - inner), -inner / (rel(k) - inner)),
            };
            let (fall, fall_at) = match k == last {
                true => (0.0, 1.0),
                false => (-1.0 / (outer - rel(k)), outer / (outer - rel(k))),
            };
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
    use super::*;

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
}
