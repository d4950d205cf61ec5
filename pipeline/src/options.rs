//! Options of all bands of a job.

use crate::geometry::Frame;
use crate::lens::{LensError, PsfSample};
use crate::psf::blocks::Blocks;
use crate::psf::grid::NodeGrid;
use crate::psf::kernel::film_window;
use crate::remap::ChartInterpolation;
use crate::simd::Simd;
use crate::stage::Stages;

/// Treatment of PSFs between two wavelengths of the lens.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PsfBetween {
    /// An error.
    Error,
    /// Interpolate linearly in λ.
    Interpolate,
}

/// Options of all bands of a job.
///
/// ```
/// use lenscube_pipeline::band::{Options, PsfBetween};
/// use lenscube_pipeline::field::Outside;
/// use lenscube_pipeline::remap::ChartInterpolation;
/// use lenscube_pipeline::resample::{Interp, Surround};
/// use lenscube_pipeline::simd::Simd;
///
/// // Those of `lenscube run` without flags.
/// let options = Options {
///     stages: lenscube_pipeline::stages::default_stages(),
///     interpolation: ChartInterpolation { interp: Interp::Bicubic, surround: Surround::Edge, outside: Outside::Error },
///     azimuths: None,
///     psf_window: None,
///     between: PsfBetween::Error,
///     simd: Simd::detect(),
/// };
/// assert!(options.simd.isa().is_available());
/// ```
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

/// PSF tables of a band, or of one of its depth nodes.
pub(crate) struct PsfTables<'a> {
    pub(crate) wavelength_nm: f64,
    /// What its window is called in errors.
    pub(crate) window: &'a str,
    /// Samples of a side, and their pitch, µm.
    pub(crate) size: usize,
    pub(crate) pitch_um: f64,
    pub(crate) sample: PsfSample,
    pub(crate) height_mm: &'a [f64],
    pub(crate) azimuth_count: &'a [usize],
}

impl Options {
    /// Node grid and FFT blocks of the PSFs of `tables` on the film of `frame`.
    ///
    /// # Errors
    /// A window larger than the largest FFT admits.
    pub(crate) fn partition(
        &self,
        frame: &Frame,
        tables: &PsfTables<'_>,
    ) -> Result<(NodeGrid, Blocks), LensError> {
        let full = film_window(tables.size, tables.pitch_um, frame.pitch_um, tables.sample);
        let window = self.psf_window.map_or(full, |w| w.min(full));
        if window > Blocks::widest_window() {
            return Err(LensError::Table {
                wavelength_nm: tables.wavelength_nm,
                table: "psf",
                problem: format!(
                    "{} covers {window} film pixels, at most {} can be convolved; crop it with `--psf-window`",
                    tables.window,
                    Blocks::widest_window()
                ),
            });
        }
        let azimuths: Vec<usize> = match self.azimuths {
            Some(j) => tables.azimuth_count.iter().map(|&count| if count == 1 { 1 } else { j }).collect(),
            None => tables.azimuth_count.to_vec(),
        };
        let grid = NodeGrid::new(tables.height_mm, &azimuths, frame.pitch_mm());
        let blocks = Blocks::choose(window, &grid);
        Ok((grid, blocks))
    }
}
