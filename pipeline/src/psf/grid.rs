//! The grid of PSF nodes on the film, and how much of each node a pixel takes.
//!
//! Node (k, j) lies at REAL image height r_k and azimuth θ_j = 2πj/J_k. Between nodes the PSF is linear in r and, on each
//! height, linear in θ, so a pixel (r, θ) takes from node (k, j) the share
//!     w = R_k(r) · T_kj(θ),
//!     R_k = min((r − r_{k−1})/(r_k − r_{k−1}), (r_{k+1} − r)/(r_{k+1} − r_k)), not below 0;  1 from r_K−1 outwards
//!     T_kj = max(0, 1 − |θ − θ_j|·J_k/2π), the angle taken the short way round;  1 for the axis node, which has no azimuth
//! which are not zero for at most four nodes and sum to 1. Heights are kept in film pixels. Inside a block of pixels r and
//! θ are taken relative to the block's centre, so that f32 holds the shares to about 1e-7 anywhere on a 14,141² film.

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

/// A node's share of a pixel at (r, θ), both relative to the block's centre (px, rad):
/// `max(0, min(r·rise + rise_at, r·fall + fall_at)) · max(0, 1 − d·per_rad)`, d = |θ − azimuth_rad| the short way round.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tent {
    /// Slope of the inner flank, 1/px (0 for the axis node).
    pub rise: f32,
    /// Inner flank at r = 0.
    pub rise_at: f32,
    /// Slope of the outer flank, 1/px, ≤ 0 (0 for the last height).
    pub fall: f32,
    /// Outer flank at r = 0.
    pub fall_at: f32,
    /// Node azimuth relative to the block's centre, rad.
    pub azimuth_rad: f32,
    /// J_k/2π; 0 for the axis node, which therefore takes every azimuth.
    pub per_rad: f32,
}

impl Tent {
    /// The share at (r, θ) relative to the block's centre. `around` says that azimuths wrap inside the block.
    #[inline(always)]
    pub fn share(&self, r: f32, theta: f32, around: bool) -> f32 {
        let radial = (r * self.rise + self.rise_at).min(r * self.fall + self.fall_at).max(0.0);
        let mut d = (theta - self.azimuth_rad).abs();
        if around {
            d = d.min(TAU as f32 - d);
        }
        radial * (1.0 - d * self.per_rad).max(0.0)
    }
}

/// Where a block of pixels lies: its centre in polar coordinates about the axis, and the reach of its pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reach {
    /// Radius of the block's centre, px.
    pub r_px: f64,
    /// Azimuth of the block's centre, rad.
    pub azimuth_rad: f64,
    /// Smallest and largest r of a pixel, relative to `r_px`.
    pub r: (f32, f32),
    /// Smallest and largest θ of a pixel, relative to `azimuth_rad`; not used where `around`.
    pub theta: (f32, f32),
    /// The block lies so near the axis that its azimuths may wrap.
    pub around: bool,
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

    /// Number of nodes in all.
    pub fn len(&self) -> usize {
        self.first_id[self.height_px.len()]
    }

    /// Never: a grid has at least its axis node.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// Number of a node, below [`NodeGrid::len`].
    pub fn id(&self, node: Node) -> usize {
        self.first_id[node.k] + node.j
    }

    /// Azimuth of a node in rad.
    pub fn azimuth_rad(&self, node: Node) -> f64 {
        TAU * node.j as f64 / self.azimuths[node.k] as f64
    }

    /// The nodes that may have a share in a block, with their tents, by height and azimuth: the order of the sum.
    pub fn touching(&self, reach: &Reach, out: &mut Vec<(Node, Tent)>) {
        out.clear();
        let last = self.height_px.len() - 1;
        let rel = |k: usize| self.height_px[k] - reach.r_px;
        for k in 0..=last {
            let inner = if k == 0 { f64::NEG_INFINITY } else { rel(k - 1) };
            let outer = if k == last { f64::INFINITY } else { rel(k + 1) };
            if f64::from(reach.r.1) <= inner || f64::from(reach.r.0) >= outer {
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
            let tent = |azimuth_rad: f64, per_rad: f64| Tent {
                rise: rise as f32,
                rise_at: rise_at as f32,
                fall: fall as f32,
                fall_at: fall_at as f32,
                azimuth_rad: azimuth_rad as f32,
                per_rad: per_rad as f32,
            };
            let count = self.azimuths[k] as i64;
            if count == 1 {
                out.push((Node { k, j: 0 }, tent(0.0, 0.0)));
                continue;
            }
            let per_rad = count as f64 / TAU;
            let (first, end) = match reach.around {
                true => (0, count),
                false => {
                    let index =
                        |theta: f32| ((reach.azimuth_rad + f64::from(theta)) * per_rad).floor() as i64;
                    let first = index(reach.theta.0);
                    (first, (index(reach.theta.1) + 2).min(first + count))
                }
            };
            for j in first..end {
                let mut azimuth = j as f64 / per_rad - reach.azimuth_rad;
                if reach.around {
                    azimuth -= TAU * (azimuth / TAU).round();
                }
                out.push((Node { k, j: j.rem_euclid(count) as usize }, tent(azimuth, per_rad)));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_sum_to_one_and_touch_four_nodes_at_most() {
        let grid = NodeGrid::new(&[0.0, 0.3, 0.4, 1.1], &[1, 8, 12, 36], 0.01);
        let mut nodes = Vec::new();
        for (r_px, around) in [(5.0, true), (33.0, false), (80.0, false), (140.0, false)] {
            for azimuth_rad in [0.0, 1.0, 3.1, 6.2] {
                let reach = Reach { r_px, azimuth_rad, r: (-4.0, 4.0), theta: (-0.15, 0.15), around };
                grid.touching(&reach, &mut nodes);
                for (r, t) in [(0.0, 0.0), (-4.0, 0.149), (3.3, -0.1), (1.2, 0.02)] {
                    let shares: Vec<f32> =
                        nodes.iter().map(|(_, tent)| tent.share(r, t, around)).filter(|w| *w > 0.0).collect();
                    assert!(shares.len() <= 4, "{} nodes at r {r_px}", shares.len());
                    assert!((shares.iter().sum::<f32>() - 1.0).abs() < 1e-6);
                }
            }
        }
    }
}
