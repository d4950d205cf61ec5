//! The grid of PSF nodes on the film, polar or Cartesian, and the weight of each node at a pixel.
//!
//! The PSF at a place of the film is Σ_node w_node·P_node, with weights ≥ 0 of sum 1, at most four of them above 0.
//! *Polar* ([`PolarNodes`]): nodes (k, j) at heights and azimuths about the axis, for lenses that are symmetric about it, or would be
//! without their errors. *Cartesian* ([`CartesianNodes`]): nodes (k, j) in columns and rows of the film, for all others.
//! Within a block of pixels, coordinates are relative to the block's centre, so that f32 weights are exact to about 1e-7 anywhere on a
//! 14,141² film. Engines know one form of weight, a function of two coordinates: (r, θ), or (x, y).

mod cartesian;
mod polar;

pub use cartesian::{CartesianNodes, Positions};
pub use polar::PolarNodes;

use crate::psf::polar::{BlockPlace, PolarExtent};
use std::f64::consts::TAU;
use std::ops::Range;

/// The nodes of one band.
#[derive(Clone, Debug, PartialEq)]
pub enum NodeGrid {
    /// At heights and azimuths about the axis.
    Polar(PolarNodes),
    /// In columns and rows of the film.
    Cartesian(CartesianNodes),
}

/// One node.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Node {
    /// Height index; of a Cartesian grid the column.
    pub k: usize,
    /// Azimuth index, below J_k; of a Cartesian grid the row.
    pub j: usize,
}

/// The weight of one node as a function of (r, θ), both relative to the block's centre (px, rad):
/// `max(0, min(r·rise + rise_at, r·fall + fall_at)) · max(0, 1 − d·per_rad)`, d = |θ − azimuth_rad| ≤ π.
/// Of a Cartesian grid, x stands for r and y for θ, in px.
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

/// Flanks of a node between its neighbours at `inner` and `outer`, all relative to the block's centre, px: (slope, value at the centre) of the
/// rising and of the falling flank. Without a neighbour the flank is 1.
fn flanks(inner: Option<f64>, at: f64, outer: Option<f64>) -> [(f64, f64); 2] {
    let rise = inner.map_or((0.0, 1.0), |inner| (1.0 / (at - inner), -inner / (at - inner)));
    let fall = outer.map_or((0.0, 1.0), |outer| (-1.0 / (outer - at), outer / (outer - at)));
    [rise, fall]
}

impl NodeGrid {
    /// The polar grid of heights `height_mm` (REAL, ascending from 0) with `azimuths` per height on a film of `pitch_mm`; one PSF a height.
    pub fn new(height_mm: &[f64], azimuths: &[usize], pitch_mm: f64) -> Self {
        Self::polar(height_mm, azimuths, &vec![1; azimuths.len()], pitch_mm)
    }

    /// As [`NodeGrid::new`], with PSFs at `azimuth_samples` azimuths A_k per height: 1 for a height that is rotationally symmetric.
    pub fn polar(height_mm: &[f64], azimuths: &[usize], azimuth_samples: &[usize], pitch_mm: f64) -> Self {
        Self::Polar(PolarNodes::new(height_mm, azimuths, azimuth_samples, pitch_mm))
    }

    /// The Cartesian grid of nodes at `x_mm` and `y_mm` from the axis, uniform and ascending, on a film of `pitch_mm`.
    pub fn cartesian(x_mm: &[f64], y_mm: &[f64], pitch_mm: f64) -> Self {
        Self::Cartesian(CartesianNodes::new(x_mm, y_mm, pitch_mm))
    }

    /// Heights of the nodes in film pixels; none of a Cartesian grid.
    pub fn heights_px(&self) -> &[f64] {
        match self {
            Self::Polar(nodes) => nodes.heights_px(),
            Self::Cartesian(_) => &[],
        }
    }

    /// Azimuths J_k per height; none of a Cartesian grid.
    pub fn azimuths(&self) -> &[usize] {
        match self {
            Self::Polar(nodes) => nodes.azimuths(),
            Self::Cartesian(_) => &[],
        }
    }

    /// Number of nodes.
    pub fn len(&self) -> usize {
        match self {
            Self::Polar(nodes) => nodes.len(),
            Self::Cartesian(nodes) => nodes.len(),
        }
    }

    /// Always false: a grid has at least one node.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// Index of a node, below [`NodeGrid::len`].
    pub fn id(&self, node: Node) -> usize {
        match self {
            Self::Polar(nodes) => nodes.id(node),
            Self::Cartesian(nodes) => nodes.id(node),
        }
    }

    /// Azimuth of a node in rad, by which its PSF is rotated: 0 for all nodes of a Cartesian grid.
    pub fn azimuth_rad(&self, node: Node) -> f64 {
        match self {
            Self::Polar(nodes) => nodes.azimuth_rad(node),
            Self::Cartesian(_) => 0.0,
        }
    }

    /// Number of sets of PSFs: one set is all PSFs of a height, or the PSF of a node of a Cartesian grid.
    pub fn psf_sets(&self) -> usize {
        match self {
            Self::Polar(nodes) => nodes.heights_px().len(),
            Self::Cartesian(nodes) => nodes.len(),
        }
    }

    /// The set that the PSF of `node` is computed from, below [`NodeGrid::psf_sets`].
    pub fn psf_set(&self, node: Node) -> usize {
        match self {
            Self::Polar(_) => node.k,
            Self::Cartesian(nodes) => nodes.id(node),
        }
    }

    /// PSFs of the set `set` in the stack of the band: A_k rows, or one.
    pub fn psf_rows(&self, set: usize) -> Range<usize> {
        match self {
            Self::Polar(nodes) => nodes.psf_rows(set),
            Self::Cartesian(_) => set..set + 1,
        }
    }

    /// Whether kernels of `node` follow from each other by symmetry: those of a height with one PSF do.
    pub fn is_symmetric_at(&self, node: Node) -> bool {
        matches!(self, Self::Polar(nodes) if nodes.psf_rows(node.k).len() == 1)
    }

    /// Whether kernels of all nodes follow from others by symmetry.
    pub fn is_symmetric(&self) -> bool {
        matches!(self, Self::Polar(_)) && (0..self.psf_sets()).all(|set| self.psf_rows(set).len() == 1)
    }

    /// Fills `r` and `theta` with the coordinates of the pixels of `place` (row stride `stride`) and returns the extent of the block.
    pub fn coordinates(
        &self,
        place: &BlockPlace,
        stride: usize,
        r: &mut [f32],
        theta: &mut [f32],
    ) -> PolarExtent {
        match self {
            Self::Polar(_) => place.polar(stride, r, theta),
            Self::Cartesian(_) => place.cartesian(stride, r, theta),
        }
    }

    /// The nodes whose weight may be above 0 in `block`, by height and azimuth, or column and row: the order of summation.
    pub fn touching(&self, block: &PolarExtent, out: &mut Vec<(Node, NodeWeight)>) {
        out.clear();
        match self {
            Self::Polar(nodes) => nodes.touching(block, out),
            Self::Cartesian(nodes) => nodes.touching(block, out),
        }
    }
}
