//! What bands of all lenses without rotational symmetry have in common: sample pitch, windows, PSFs with their energies, tables.

use rayon::prelude::*;

use super::error::SkewError;
use super::trace_map::TracedMap;
use crate::bounds::PSF_ENERGY;
use crate::design::prescription::error::DesignError;
use crate::design::psf::pupil_stack::{PupilStack, normalise};
use crate::design::psf::{PsfGrid, PsfScratch, PupilFunction};
use crate::design::tables::refine::NodeError;
use crate::design::tables::sampled::pitch_below;
use crate::design::tables::trace::{BandReport, TraceOptions, TracedBand};
use crate::design::tables::window::{Windows, search};
use crate::lens::planar::{PlanarBand, PsfPlaces};
use crate::lens::{LensBand, PsfSample, PsfStack};

/// Accuracy of ideal points of the map, film pixels.
pub(super) const MAP_TOLERANCE_PX: f64 = 1e-4;

/// Windows and sample pitch of a band.
pub(super) struct Sampling {
    pub(super) windows: Windows,
    pub(super) pitch_um: f64,
}

impl Sampling {
    /// Those of the pupil functions `found` at their heights (mm), with samples not coarser than `coarsest_um` where their pitch is not given; windows of
    /// `first_px` film pixels are examined first.
    ///
    /// # Errors
    /// A given pitch above Nyquist; a window that does not hold enough light.
    pub(super) fn new(
        options: &TraceOptions,
        found: &[(f64, &PupilFunction)],
        coarsest_um: f64,
        first_px: usize,
    ) -> Result<Self, DesignError> {
        let nyquist = found.iter().map(|(_, f)| f.nyquist_um()).fold(f64::INFINITY, f64::min);
        let pitch_um = match options.psf_pitch_um {
            Some(pitch) if pitch > nyquist => {
                return Err(DesignError::Option {
                    option: "psf pitch",
                    value: format!("{pitch} µm"),
                    expected: "one finer than Nyquist, λN/2 of the widest cone",
                });
            }
            Some(pitch) => pitch,
            None => coarsest_um.min(pitch_below(options, nyquist)),
        };
        let windows = match options.window_px {
            Some(px) => Windows { px, core_px: px },
            None => search(options, found, pitch_um, first_px)?.windows,
        };
        Ok(Self { windows, pitch_um })
    }
}

/// The PSFs of `functions`, each of sum 1, and their shares of energy in the window.
pub(super) fn stack(functions: &[PupilFunction], grid: &PsfGrid) -> (PsfStack, Vec<f64>) {
    let n = grid.size();
    let mut samples = vec![0.0; n * n * functions.len()];
    let energy = samples
        .par_chunks_exact_mut(n * n)
        .zip(functions)
        .map_init(<(PsfScratch, Vec<f32>)>::default, |(scratch, psf), (out, function)| {
            grid.psf_into(function, 0.0, scratch, psf);
            normalise(psf, out)
        })
        .collect();
    (PsfStack { size: n, pitch_um: grid.pitch_um(), sample: PsfSample::Point, samples }, energy)
}

/// A band, but for its PSFs.
pub(super) struct Band {
    pub(super) wavelength_nm: f64,
    pub(super) map: TracedMap,
    /// Heights (mm) and azimuth counts of nodes; empty where PSFs lie on columns and rows.
    pub(super) nodes: (Vec<f64>, Vec<usize>),
    pub(super) places: PsfPlaces,
    pub(super) error: Option<NodeError>,
    pub(super) window_px: usize,
    /// Number of PSFs that were computed.
    pub(super) psfs: usize,
}

impl Band {
    /// With the PSFs on `grid` of `functions` at `heights_mm`, and their energies.
    ///
    /// # Errors
    /// A PSF with more light than its field point has: its pupil is not resolved.
    pub(super) fn with_psfs(
        self,
        (psf, psf_energy): (PsfStack, Vec<f64>),
        grid: &PsfGrid,
        functions: Vec<PupilFunction>,
        heights_mm: impl Iterator<Item = f64>,
    ) -> Result<TracedBand, SkewError> {
        let wavelength_nm = self.wavelength_nm;
        let mut shares = heights_mm.zip(&psf_energy);
        if let Some((height_mm, &share)) = shares.find(|(_, s)| **s > PSF_ENERGY.max || s.is_nan()) {
            let wavelength_um = wavelength_nm / 1e3;
            return Err(DesignError::Unresolved { height_mm, wavelength_um, share }.into());
        }
        let report = BandReport {
            wavelength_nm,
            psf_error: self.error,
            window_px: self.window_px,
            min_energy: psf_energy.iter().copied().fold(1.0, f64::min),
            psfs: self.psfs,
            no_tail: None,
        };
        let (psf_height_mm, azimuth_count) = self.nodes;
        let tables = LensBand {
            wavelength_nm,
            ideal_height_mm: Vec::new(),
            image_height_mm: Vec::new(),
            relative_illumination: Vec::new(),
            psf_height_mm,
            azimuth_count,
            psf_size: grid.size(),
            psf_pitch_um: grid.pitch_um(),
            kernel_pitch_um: None,
            psf_energy,
            solid_angle_sr: self.map.solid_angle_sr,
            transmission: 1.0,
            tail: None,
            cones: None,
            planar: Some(PlanarBand { map: self.map.planar(), psfs: self.places }),
        };
        Ok(TracedBand { tables, psf, pupils: PupilStack::new(grid, functions), report })
    }
}
