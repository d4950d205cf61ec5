//! Attribution of the difference between a measured and an expected edge spread function to the steps of the simulation.
//!
//! The expected curve is computed again with one step after another replaced by the data of the run:
//! ```text
//! sampling  PSF and apertures integrated over the plane instead of summed over entire pixels as chart and film are: a limit
//!           of the pixel pitch, reported but not counted as an error;
//! heights   PSFs of the run, linear between their heights, instead of the PSF at the field point;
//! kernels   weighted mean of the neighbouring node kernels of the run (linear between heights, rotated to the azimuths of
//!           the nodes, integrated over the film pixel) instead of the PSF at the field point;
//! rest      remaining difference to the film: the remap, and the change of the PSF within its window.
//! ```
//! Each figure is the largest change of the curve by that step.

use super::reference::{Psf, shares};
use super::setup::Setup;
use anyhow::Result;
use pipeline::lens::PsfStack;
use pipeline::measure::expected::{ExpectedEsf, StepEdge};
use pipeline::psf::grid::{Node, NodeGrid, NodeWeight};
use pipeline::psf::kernel::{KernelScratch, NodeKernels};
use pipeline::psf::polar::PolarExtent;
use pipeline::simd::Simd;

/// Largest change of the edge spread function by each step, as a share of the step height.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorBudget {
    /// Sums over entire pixels instead of integrals over the plane.
    pub sampling: f64,
    /// Linear interpolation between heights.
    pub heights: f64,
    /// Kernels: heights, azimuths, rotation, integration over the pixel.
    pub kernels: f64,
    /// Remap, and change of the PSF within its window.
    pub rest: f64,
}

/// PSFs and node kernels of one band of the run.
pub struct RunPsfs {
    stack: PsfStack,
    kernels: NodeKernels,
    grid: NodeGrid,
    band: usize,
}

/// Measured edge.
pub struct MeasuredEdge<'a> {
    /// Reference PSF at the edge.
    pub psf: &'a Psf,
    /// REAL height, mm, and azimuth, rad.
    pub field_point: (f64, f64),
    /// Apertures and weights that the step is averaged over, without the film pixel.
    pub step: &'a StepEdge,
    /// Distance from the edge in px, film value, reference value.
    pub samples: &'a [(f64, f64, f64)],
    /// Half the PSF window, px.
    pub half_px: f64,
    /// Of a distance from the edge, px, and the value there by the light in the window: the value by all light, on the scale of the samples.
    pub whole: &'a dyn Fn(f64, f64) -> f64,
}

impl RunPsfs {
    /// PSFs of band `band` of the setup.
    pub fn new(setup: &Setup, band: usize) -> Result<Self> {
        let nm = setup.wavelengths_nm[band];
        let bands = &setup.source.lens().bands;
        let index = bands.iter().position(|b| (b.wavelength_nm - nm).abs() < 1e-6).unwrap_or(band);
        let stack = setup.source.psf(index)?;
        let kernels = NodeKernels::new(&stack, setup.pitch_um, None, Simd::detect());
        let tables = &bands[index];
        let grid = NodeGrid::new(&tables.psf_height_mm, &tables.azimuth_count, setup.pitch_um * 1e-3);
        Ok(Self { stack, kernels, grid, band: index })
    }

    /// Kernel at a field point: weighted mean of the neighbouring node kernels.
    fn kernel(&self, r_px: f64, azimuth_rad: f64) -> Vec<f64> {
        let reach = PolarExtent { r_px, azimuth_rad, r: (0.0, 0.0), theta: (0.0, 0.0), wraps: r_px < 1.0 };
        let mut nodes: Vec<(Node, NodeWeight)> = Vec::new();
        self.grid.touching(&reach, &mut nodes);
        let n = self.kernels.size();
        let (mut sum, mut one, mut scratch) = (vec![0.0; n * n], vec![0f32; n * n], KernelScratch::default());
        for (node, weight) in nodes {
            let share = f64::from(weight.at(0.0, 0.0, reach.wraps));
            if share > 0.0 {
                self.kernels.kernel(&self.grid, node, &mut scratch, &mut one);
                sum.iter_mut().zip(&one).for_each(|(s, v)| *s += share * f64::from(*v));
            }
        }
        sum
    }

    /// Change of the edge spread function by each step.
    pub fn error_budget(&self, setup: &Setup, edge: &MeasuredEdge<'_>) -> ErrorBudget {
        let (height_mm, azimuth_rad) = edge.field_point;
        let n = self.kernels.size();
        let interpolated = setup.source.lens().bands[self.band].psf_at(&self.stack, height_mm);
        let interpolated = Psf::from_window(&interpolated, setup.pitch_um);
        let integrated_over_plane = |psf: &Psf| {
            let mut step = edge.step.clone();
            step.squares_px.extend(psf.remaining_aperture_px());
            let psf = psf.clone().cropped(n, azimuth_rad);
            ExpectedEsf::new(psf.shares.iter().copied(), azimuth_rad, &step)
        };
        let (plane, heights) = (integrated_over_plane(edge.psf), integrated_over_plane(&interpolated));
        let kernel = self.kernel(height_mm * 1e3 / setup.pitch_um, azimuth_rad);
        let kernel = ExpectedEsf::new(shares(&kernel, n, 1.0).into_iter(), 0.0, edge.step);
        let whole = |esf: &ExpectedEsf, distance_px: f64| (edge.whole)(distance_px, esf.at(distance_px));
        let max_abs = |difference: &dyn Fn(&(f64, f64, f64)) -> f64| {
            let inside = edge.samples.iter().filter(|s| s.0.abs() <= edge.half_px);
            inside.map(|s| difference(s).abs()).fold(0.0, f64::max)
        };
        ErrorBudget {
            sampling: max_abs(&|s| whole(&plane, s.0) - s.2),
            heights: max_abs(&|s| whole(&heights, s.0) - whole(&plane, s.0)),
            kernels: max_abs(&|s| whole(&kernel, s.0) - s.2),
            rest: max_abs(&|s| s.1 - whole(&kernel, s.0)),
        }
    }
}
