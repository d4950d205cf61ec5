//! Options of a trace.

use crate::design::prescription::error::DesignError;

/// Heights of the PSFs.
#[derive(Clone, Debug, PartialEq)]
pub enum PsfHeights {
    /// Chosen for `psf_tolerance`.
    ByError,
    /// These real image heights, mm, ascending from 0.
    Given(Vec<f64>),
}

/// Number of azimuths of a height.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Azimuths {
    /// Chosen for `psf_tolerance`.
    ByError,
    /// This many (a multiple of 4) at every height but the axis.
    Given(usize),
}

/// Default maximum of nodes of a band.
pub const MAX_NODES: usize = 48_000;
/// Nodes of a band, at that default, up to which errors are those of the tolerance: twice as many as a Double Gauss needs.
pub(super) const BASE_NODES: usize = MAX_NODES / 6;
/// Default of [`TraceOptions::excess`].
const EXCESS: f64 = 2.0;

/// Range and accuracy of a trace. Image plane, object distance and ray aiming are part of the [`System`](crate::design::prescription::system::System).
#[derive(Clone, Debug, PartialEq)]
pub struct TraceOptions {
    /// Wavelengths, nm, ascending.
    pub wavelengths_nm: Vec<f64>,
    /// Maximum real image height of the tables, mm.
    pub max_height_mm: f64,
    /// Field points of the dense tables: with 1001, linear interpolation is within 1e-4 px up to 25 mm.
    pub field_points: usize,
    /// Film pitch, µm.
    pub film_pitch_um: f64,
    /// Minimum share of energy in the window.
    pub energy: f64,
    /// Maximum window, film pixels (odd).
    pub max_window_px: usize,
    /// A window of this many film pixels (odd) instead of one chosen by `energy`.
    pub window_px: Option<usize>,
    /// Sample pitch, µm, instead of one chosen by Nyquist.
    pub psf_pitch_um: Option<f64>,
    /// Maximum L1 error of a kernel between nodes, integrated over the film pixel; that of an edge in a film, of white, is a fifth of it.
    pub psf_tolerance: f64,
    /// Maximum number of nodes of a band (heights × azimuths), if they are chosen by error.
    pub max_nodes: usize,
    /// L1 error in units of `psf_tolerance`, at least 1, from which on a band may have more than a sixth of `max_nodes`: films of many nodes take more
    /// time.
    pub excess: f64,
    /// Heights of the PSFs.
    pub heights: PsfHeights,
    /// Number of azimuths of a height.
    pub azimuths: Azimuths,
}

impl TraceOptions {
    /// Default of `max_window_px`.
    pub const MAX_WINDOW_PX: usize = 401;
    /// Largest `max_window_px`.
    pub const WIDEST_PX: usize = 2001;

    /// The defaults for wavelengths and maximum height.
    pub fn new(wavelengths_nm: Vec<f64>, max_height_mm: f64) -> Self {
        Self {
            wavelengths_nm,
            max_height_mm,
            field_points: 1001,
            film_pitch_um: 2.0,
            energy: 0.99,
            max_window_px: Self::MAX_WINDOW_PX,
            window_px: None,
            psf_pitch_um: None,
            psf_tolerance: 0.01,
            max_nodes: MAX_NODES,
            excess: EXCESS,
            heights: PsfHeights::ByError,
            azimuths: Azimuths::ByError,
        }
    }

    /// Nodes of a band up to which its errors are those of the tolerance; more only where errors would exceed that `excess` times.
    pub fn base_nodes(&self) -> usize {
        self.max_nodes.min(BASE_NODES.max(self.max_nodes / 6))
    }

    pub(super) fn check(&self) -> Result<(), DesignError> {
        let bad = |option, value: String, expected| Err(DesignError::Option { option, value, expected });
        let waves = &self.wavelengths_nm;
        if waves.is_empty() || waves.iter().any(|w| !w.is_finite()) || waves.windows(2).any(|w| w[1] <= w[0])
        {
            return bad("wavelengths", format!("{waves:?}"), "one or more ascending numbers of nm");
        }
        for (option, v) in [
            ("max height", self.max_height_mm),
            ("film pitch", self.film_pitch_um),
            ("psf pitch", self.psf_pitch_um.unwrap_or(1.0)),
            ("psf tolerance", self.psf_tolerance),
        ] {
            if !(v.is_finite() && v > 0.0) {
                return bad(option, v.to_string(), "a positive number");
            }
        }
        if !(self.energy > 0.0 && self.energy < 1.0) {
            return bad("energy", self.energy.to_string(), "a share between 0 and 1");
        }
        if !(self.excess.is_finite() && self.excess >= 1.0) {
            return bad("excess", self.excess.to_string(), "a number from 1 on");
        }
        if self.max_nodes < 16 {
            return bad("max nodes", self.max_nodes.to_string(), "at least 16");
        }
        if self.field_points < 2 {
            return bad("field points", self.field_points.to_string(), "at least 2");
        }
        for px in [self.max_window_px, self.window_px.unwrap_or(3)] {
            if px.is_multiple_of(2) || !(3..=Self::WIDEST_PX).contains(&px) {
                return bad("window", px.to_string(), "an odd number of film pixels, 3..2001");
            }
        }
        if let PsfHeights::Given(h) = &self.heights {
            let ascend = h.windows(2).all(|w| w[1] > w[0]) && h.iter().all(|v| v.is_finite());
            if h.len() < 2 || h[0] != 0.0 || !ascend {
                return bad("heights", format!("{h:?}"), "two or more heights ascending from 0");
            }
        }
        if let Azimuths::Given(j) = self.azimuths
            && (j == 0 || !j.is_multiple_of(4))
        {
            return bad("azimuths", j.to_string(), "a multiple of 4");
        }
        Ok(())
    }
}
