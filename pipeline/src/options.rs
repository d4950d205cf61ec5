//! Options of all bands of a job.

use crate::remap::{ChartInterpolation, Stages};
use crate::simd::Simd;

/// Treatment of PSFs between two wavelengths of the lens.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PsfBetween {
    /// An error.
    Error,
    /// Interpolate linearly in λ.
    Interpolate,
}

/// Options of all bands of a job.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Enabled stages.
    pub stages: Stages,
    /// Interpolation and surround of the chart.
    pub interpolation: ChartInterpolation,
    /// Azimuths per height in place of the lens's, a multiple of 4.
    pub azimuths: Option<usize>,
    /// Crop of the PSF window in film pixels, odd.
    pub psf_window: Option<usize>,
    /// PSFs between wavelengths of the lens.
    pub between: PsfBetween,
    /// Instruction set; affects the rounding only.
    pub simd: Simd,
}
