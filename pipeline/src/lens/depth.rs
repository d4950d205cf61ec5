//! Depth nodes of a lens: its PSFs at several object distances, all on one film plane.
//!
//! ```text
//! V            vergence 1/z of the object in 1/m, z from the centre of the entrance pupil along the axis; 0 is infinity
//! vergence[d]  vergence of node d, ascending; between two nodes a PSF is linear in V
//! h(r, V) = h(r, 0)·(1 + δ(r)·V/1000)    ideal height in mm; δ = `pupil_shift_mm`, the distance from the centre of the entrance pupil
//!              to the point where the chief ray of that film point crosses the axis, towards the film
//! R(r, V) = R(r)·G(r, V)/G(r, V_f)       relative illumination; G/G_f = `etendue_ratio`, V_f the vergence in focus
//! ```
//! Each node has heights, azimuths, window and pitch of its own.

use super::{LensBand, LensError};
use crate::bounds::{self, Bound};

/// Pupil shifts up to this are rounding of a paraxially aimed trace, mm.
const SHIFT_ROUNDING_MM: f64 = 1e-9;

/// Depth nodes of all bands of a lens.
#[derive(Clone, Debug, PartialEq)]
pub struct LensDepth {
    /// Object distance in focus, m from the entrance pupil; infinity is allowed.
    pub focus_distance_m: f64,
    /// Blur radius on the film per dioptre from focus, µm·m: half the entrance pupil's diameter times the distortion focal length.
    pub blur_per_dioptre_um: f64,
    /// Entrance pupil behind the first vertex, mm.
    pub entrance_pupil_mm: f64,
    /// Diameter of the entrance pupil, mm.
    pub entrance_pupil_diameter_mm: f64,
    /// Maximum L1 error of a kernel half-way between nodes for which they were chosen.
    pub tolerance: f64,
    /// Nodes per band of the lens.
    pub bands: Vec<BandDepth>,
}

/// Depth nodes of one band.
#[derive(Clone, Debug, PartialEq)]
pub struct BandDepth {
    /// Vergences of the nodes, 1/m, ascending.
    pub vergence: Vec<f64>,
    /// The nodes.
    pub nodes: Vec<DepthNode>,
    /// δ of the band's field points, mm.
    pub pupil_shift_mm: Vec<f64>,
}

/// PSF tables of one depth node, as those of [`LensBand`].
#[derive(Clone, Debug, PartialEq)]
pub struct DepthNode {
    /// REAL image heights of the PSFs, mm, ascending from 0.
    pub psf_height_mm: Vec<f64>,
    /// Azimuths per height.
    pub azimuth_count: Vec<usize>,
    /// Share of all the light that the window held before normalisation, per height.
    pub psf_energy: Vec<f64>,
    /// Side of the PSF window in samples, odd.
    pub psf_size: usize,
    /// Sample pitch in µm.
    pub psf_pitch_um: f64,
    /// G(r, V)/G(r, V_f) of the band's field points.
    pub etendue_ratio: Vec<f64>,
}

impl LensDepth {
    /// Vergence in focus, 1/m.
    pub fn focus(&self) -> f64 {
        1.0 / self.focus_distance_m
    }
}

impl BandDepth {
    /// The node nearest to vergence `v`.
    pub fn nearest(&self, v: f64) -> usize {
        let distance = |d: &usize| (self.vergence[*d] - v).abs();
        (0..self.vergence.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(0)
    }

    /// Tables of a flat chart at node `d`.
    pub fn at_node(&self, band: &LensBand, d: usize) -> LensBand {
        self.between(band, (d, d))
    }

    /// Whether ideal heights change with the vergence: a pupil shift that is not rounding of its trace.
    pub fn has_pupil_shift(&self) -> bool {
        self.pupil_shift_mm.iter().any(|shift| shift.abs() > SHIFT_ROUNDING_MM)
    }

    /// Heights and relative illumination half-way between two nodes; the PSF tables are those of the first.
    pub fn between(&self, band: &LensBand, (low, high): (usize, usize)) -> LensBand {
        let v = (self.vergence[low] + self.vergence[high]) / 2.0;
        let (a, b) = (&self.nodes[low], &self.nodes[high]);
        let ratio = std::iter::zip(&a.etendue_ratio, &b.etendue_ratio).map(|(a, b)| (a + b) / 2.0);
        let unit = if self.has_pupil_shift() { 1e-3 * v } else { 0.0 };
        let shifted = std::iter::zip(&band.ideal_height_mm, &self.pupil_shift_mm);
        let mut tables = LensBand {
            ideal_height_mm: shifted.map(|(h, delta)| h + h * delta * unit).collect(),
            relative_illumination: std::iter::zip(&band.relative_illumination, ratio)
                .map(|(r, g)| r * g)
                .collect(),
            // Tails are those of one object distance.
            tail: None,
            cones: None,
            planar: None,
            ..band.clone()
        };
        self.set_psfs(&mut tables, low);
        tables
    }

    /// Gives `band` the PSF tables of node `d`.
    pub fn set_psfs(&self, band: &mut LensBand, d: usize) {
        let node = &self.nodes[d];
        band.psf_height_mm.clone_from(&node.psf_height_mm);
        band.azimuth_count.clone_from(&node.azimuth_count);
        band.psf_energy.clone_from(&node.psf_energy);
        (band.psf_size, band.psf_pitch_um) = (node.psf_size, node.psf_pitch_um);
        band.kernel_pitch_um = None;
    }

    /// Checks the nodes of `band`, whose own tables are valid.
    ///
    /// # Errors
    /// [`LensError::Table`] with the first table that violates its contract.
    pub fn check(&self, band: &LensBand) -> Result<(), LensError> {
        let bad = |table, problem: String| {
            Err(LensError::Table { wavelength_nm: band.wavelength_nm, table, problem })
        };
        let bounded = |table, bound: Bound, values: &[f64]| match bound.check_all(values) {
            Ok(()) => Ok(()),
            Err((i, e)) => bad(table, format!("is out of bounds at index {i}: {e}")),
        };
        let (nodes, points) = (self.nodes.len(), band.ideal_height_mm.len());
        if self.vergence.len() != nodes || !bounds::DEPTH_NODES.contains(nodes as f64) {
            return bad("vergence", format!("has {nodes} nodes, expected {}", bounds::DEPTH_NODES));
        }
        bounded("vergence", bounds::VERGENCE, &self.vergence)?;
        if let Some(d) = (1..nodes).find(|&d| self.vergence[d] <= self.vergence[d - 1]) {
            return bad("vergence", format!("does not ascend at node {d}"));
        }
        if self.pupil_shift_mm.len() != points {
            return bad("pupil_shift", format!("does not have {points} field points"));
        }
        bounded("pupil_shift", bounds::PUPIL_SHIFT_MM, &self.pupil_shift_mm)?;
        for (d, node) in self.nodes.iter().enumerate() {
            if node.etendue_ratio.len() != points {
                return bad("etendue_ratio", format!("of node {d} does not have {points} field points"));
            }
            bounded("etendue_ratio", bounds::RELATIVE_ILLUMINATION, &node.etendue_ratio)?;
            self.at_node(band, d).check()?;
        }
        Ok(())
    }
}
