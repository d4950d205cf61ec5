//! The PSF of a height at the azimuth of a node, from PSFs at A azimuths: band-limited interpolation.
//!
//! The errors of a lens whose design is rotationally symmetric make the PSF of a height depend on the azimuth φ. Seen in the frame that is
//! rotated by φ about the film's centre it changes by low harmonics of φ, so A samples Q_a at φ_a = 2πa/A hold it:
//! ```text
//! Q(θ) = Σ_a D(θ − φ_a)·Q_a,   D(x) = sin(Ax/2)/(A tan(x/2)) for even A,  sin(Ax/2)/(A sin(x/2)) for odd A
//! ```
//! exact for harmonics below A/2; Σ_a D = 1. At the node azimuths θ_j = 2πj/J the angle is x = 2πm/(AJ) with the integer m = jA − aJ: where a
//! node has the azimuth of a sample, Q is the sample itself.
//! Q(θ_j) is then rotated by θ_j, as the PSF of a symmetric lens is.
//! Reading the PSFs takes longer than their products where they do not fit a cache: kernels of neighbouring nodes are computed together.

use crate::psf::grid::{Node, NodeGrid};
use crate::real;
use std::f64::consts::PI;

/// Nodes whose base kernels are computed together: some of a height, a row of a Cartesian grid, or one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::psf) struct BaseGroup {
    /// The first; the others have the azimuths after its own, or the columns.
    pub(in crate::psf) first: Node,
    pub(in crate::psf) count: usize,
}

impl BaseGroup {
    /// Nodes of a height with several PSFs. Measured with AVX2 and 16 PSFs, one node and eight at a time: a kernel of 41 px from 123² samples takes
    /// 0.094 and 0.079 ms (from one PSF 0.066), one of 147 px from 587² samples 3.1 and 2.2 ms (1.8); 16 at a time gain 3 % more.
    pub(in crate::psf) const MAX_COUNT: usize = 8;

    /// That of the base kernel of `base`.
    pub(in crate::psf) fn of(grid: &NodeGrid, base: Node) -> Self {
        if grid.psf_rows(grid.psf_set(base)).len() == 1 {
            return Self::single(base);
        }
        let first = base.j / Self::MAX_COUNT * Self::MAX_COUNT;
        let count = Self::MAX_COUNT.min(grid.azimuths()[base.k] - first);
        Self { first: Node { j: first, ..base }, count }
    }

    /// The nodes whose PSFs are read together with that of `base`: those of its height, of a Cartesian grid those of its row.
    pub(in crate::psf) fn read_together(grid: &NodeGrid, base: Node) -> Self {
        match grid {
            NodeGrid::Polar(nodes) => Self { first: Node { j: 0, ..base }, count: nodes.azimuths()[base.k] },
            NodeGrid::Cartesian(nodes) => Self { first: Node { k: 0, ..base }, count: nodes.x().count() },
        }
    }

    /// Parts of nodes of a height that are computed together, in order.
    pub(in crate::psf) fn parts(self, grid: &NodeGrid) -> impl Iterator<Item = Self> {
        let starts = (0..self.count).step_by(Self::MAX_COUNT);
        starts.map(move |j| Self::of(grid, Node { j, ..self.first }))
    }

    /// `base` alone.
    pub(super) fn single(base: Node) -> Self {
        Self { first: base, count: 1 }
    }

    /// The nodes.
    pub(super) fn nodes(self) -> impl Iterator<Item = Node> {
        (0..self.count).map(move |i| Node { j: self.first.j + i, ..self.first })
    }
}

/// The PSF of a node before it is rotated.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum AzimuthPsf {
    /// One of the PSFs of its set.
    Sample(usize),
    /// The sum of all, by weight.
    Sum(Vec<f64>),
}

impl AzimuthPsf {
    /// Of `node`.
    pub(super) fn new(grid: &NodeGrid, node: Node) -> Self {
        match grid.psf_rows(grid.psf_set(node)).len() {
            1 => Self::Sample(0),
            samples => Self::between(samples as i64, node.j as i64, grid.azimuths()[node.k] as i64),
        }
    }

    /// The weights of the sum.
    pub(super) fn weights(&self) -> Option<&[f64]> {
        match self {
            Self::Sample(_) => None,
            Self::Sum(weights) => Some(weights),
        }
    }

    /// At the azimuth 2π·`j`/`count`, of `samples` PSFs.
    fn between(samples: i64, j: i64, count: i64) -> Self {
        if (j * samples) % count == 0 {
            return Self::Sample((j * samples / count % samples) as usize);
        }
        let weight = |a: i64| {
            let m = j * samples - a * count;
            let half_angle = PI * m as f64 / (samples * count) as f64;
            let numerator = real::sin(PI * (m % (2 * count)) as f64 / count as f64);
            let denominator = match samples % 2 {
                0 => real::tan(half_angle),
                _ => real::sin(half_angle),
            };
            numerator / (samples as f64 * denominator)
        };
        Self::Sum((0..samples).map(weight).collect())
    }
}

/// For each of `weights` Σ weight · term, one after another in `to`: plain f64 sums, the reference for SIMD.
pub(super) fn weighted_sums(weights: &[&[f64]], terms: &[&[f32]], to: &mut [f32]) {
    let length = to.len() / weights.len();
    for (weights, to) in weights.iter().zip(to.chunks_exact_mut(length)) {
        for (i, to) in to.iter_mut().enumerate() {
            let products = weights.iter().zip(terms).map(|(w, term)| w * f64::from(term[i]));
            *to = products.sum::<f64>() as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    fn weights(samples: i64, j: i64, count: i64) -> Vec<f64> {
        match AzimuthPsf::between(samples, j, count) {
            AzimuthPsf::Sum(weights) => weights,
            AzimuthPsf::Sample(a) => (0..samples as usize).map(|i| f64::from(u8::from(i == a))).collect(),
        }
    }

    #[test]
    fn harmonics_below_half_the_samples_are_exact() {
        for (samples, count) in [(4, 12), (5, 8), (8, 36), (9, 4), (16, 144), (48, 720)] {
            for j in 0..count {
                let w = weights(samples, j, count);
                let theta = TAU * j as f64 / count as f64;
                for harmonic in 0..(samples + 1) / 2 {
                    let h = harmonic as f64;
                    let at = |a: usize| TAU * a as f64 / samples as f64;
                    let sum = |f: fn(f64) -> f64| {
                        w.iter().enumerate().map(|(a, w)| w * f(h * at(a))).sum::<f64>() - f(h * theta)
                    };
                    let (cos, sin) = (sum(f64::cos), sum(f64::sin));
                    assert!(cos.abs() < 1e-12 && sin.abs() < 1e-12, "{samples}, {j}/{count}, harmonic {h}");
                }
            }
        }
    }

    #[test]
    fn nodes_at_the_azimuth_of_a_sample_take_it() {
        assert_eq!(AzimuthPsf::between(8, 27, 36), AzimuthPsf::Sample(6));
        assert_eq!(AzimuthPsf::between(36, 7, 36), AzimuthPsf::Sample(7));
        assert!(matches!(AzimuthPsf::between(8, 1, 36), AzimuthPsf::Sum(_)));
    }

    /// `dirichlet(2 * pi * 5 / 36 - 2 * pi * arange(A) / A, A)` of the NumPy reference (`fields_reference.py`).
    #[test]
    fn weights_are_those_of_the_reference() {
        let of_8 = [
            -0.09168307053944584,
            0.9791936469464939,
            0.11746157759823844,
            -0.04665618624352909,
            0.019935826509503696,
            -0.0018666152439128928,
            -0.015560643961250443,
            0.039175464933902115,
        ];
        let of_5 = [
            0.38765577280784375,
            0.8586094619621754,
            -0.22400981699427835,
            0.16506074663317225,
            -0.18731616440891308,
        ];
        for (samples, expected) in [(8, &of_8[..]), (5, &of_5)] {
            let found = weights(samples, 5, 36);
            for (found, expected) in found.iter().zip(expected) {
                assert!((found - expected).abs() < 1e-14, "{found}, expected {expected}");
            }
        }
    }
}
