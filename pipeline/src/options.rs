//! Options of all bands of a job.

use crate::geometry::Frame;
use crate::lens::planar::PsfPlaces;
use crate::lens::{LensBand, LensError, PsfSample};
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
    pub(crate) nodes: PsfNodes<'a>,
}

/// Places of the PSF nodes of a band on the film.
#[derive(Clone, Copy)]
pub(crate) enum PsfNodes<'a> {
    /// REAL heights, azimuths J_k, and the number A_k of PSFs of each height.
    Polar { height_mm: &'a [f64], azimuth_count: &'a [usize], azimuth_samples: &'a [usize] },
    /// Columns and rows, mm from the axis.
    Cartesian { x_mm: &'a [f64], y_mm: &'a [f64] },
}

impl<'a> PsfNodes<'a> {
    /// Those of `band`.
    pub(crate) fn of(band: &'a LensBand) -> Self {
        let (height_mm, azimuth_count) = (&band.psf_height_mm[..], &band.azimuth_count[..]);
        match band.planar.as_ref().map(|planar| &planar.psfs) {
            None => Self::symmetric(height_mm, azimuth_count),
            Some(PsfPlaces::Polar { azimuth_samples }) => {
                Self::Polar { height_mm, azimuth_count, azimuth_samples }
            }
            Some(PsfPlaces::Cartesian { x_mm, y_mm }) => Self::Cartesian { x_mm, y_mm },
        }
    }

    /// Those of a lens with rotational symmetry: one PSF a height.
    pub(crate) fn symmetric(height_mm: &'a [f64], azimuth_count: &'a [usize]) -> Self {
        Self::Polar { height_mm, azimuth_count, azimuth_samples: &[] }
    }

    /// The grid on a film of `pitch_mm`; `azimuths` in place of those of the heights.
    pub(crate) fn grid(self, pitch_mm: f64, azimuths: Option<usize>) -> NodeGrid {
        match self {
            Self::Polar { height_mm, azimuth_count, azimuth_samples } => {
                let given = |j| azimuth_count.iter().map(|&count| if count == 1 { 1 } else { j }).collect();
                let azimuths: Vec<usize> = azimuths.map_or_else(|| azimuth_count.to_vec(), given);
                match azimuth_samples {
                    [] => NodeGrid::new(height_mm, &azimuths, pitch_mm),
                    samples => NodeGrid::polar(height_mm, &azimuths, samples, pitch_mm),
                }
            }
            Self::Cartesian { x_mm, y_mm } => NodeGrid::cartesian(x_mm, y_mm, pitch_mm),
        }
    }
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
        let grid = tables.nodes.grid(frame.pitch_mm(), self.azimuths);
        let blocks = Blocks::choose(window, &grid);
        Ok((grid, blocks))
    }
}
