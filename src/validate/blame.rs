//! Which step an edge's difference comes from, by number.
//!
//! The curve is worked out again with one thing after another taken from the lens as the run holds it:
//!     sampling  PSF and apertures integrated over the plane, instead of summed over whole pixels as chart and film are: what no
//!               program can do better on pixels of this pitch, so it is told and not counted as an error;
//!     heights   the run's PSFs, linear between their heights, instead of the PSF at the place;
//!     kernels   the mean of the run's node kernels around the place (linear between heights, turned to the nodes' azimuths,
//!               integrated over the film pixel) instead of the PSF at the place and azimuth;
//!     rest      what then is left of the film: the remap, and the PSF's change within its own window.
//! Each is the largest change it makes to the curve.

use super::Setup;
use super::truth::Psf;
use anyhow::Result;
use pipeline::lens::PsfStack;
use pipeline::measure::expected::{ExpectedEsf, Share, Step};
use pipeline::psf::grid::{Node, NodeGrid, Reach, Tent};
use pipeline::psf::kernel::{KernelScratch, NodeKernels};
use pipeline::simd::Simd;

/// Largest change of the expected ESF by each step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blame {
    /// Whole pixels instead of the plane.
    pub sampling: f64,
    /// Linear between heights.
    pub heights: f64,
    /// All that makes kernels: heights, azimuths, turning, integration.
    pub kernels: f64,
    /// The film's own.
    pub rest: f64,
}

/// The run's own PSFs of one band.
pub struct RunPsfs {
    stack: PsfStack,
    kernels: NodeKernels,
    grid: NodeGrid,
    band: usize,
}

/// An edge and what was found there.
pub struct Found<'a> {
    /// The lens's PSF there.
    pub psf: &'a Psf,
    /// REAL height, mm, and azimuth, rad.
    pub at: (f64, f64),
    /// What the step goes through but for the film's pixel.
    pub step: &'a Step,
    /// Distance, film, lens.
    pub samples: &'a [(f64, f64, f64)],
    /// Half the window, px.
    pub half_px: f64,
}

impl RunPsfs {
    /// Of band `band` of the setup.
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

    /// The run's kernel at a place, as it mixes it.
    fn kernel(&self, r_px: f64, azimuth_rad: f64) -> Vec<f64> {
        let reach = Reach { r_px, azimuth_rad, r: (0.0, 0.0), theta: (0.0, 0.0), around: r_px < 1.0 };
        let mut nodes: Vec<(Node, Tent)> = Vec::new();
        self.grid.touching(&reach, &mut nodes);
        let n = self.kernels.size();
        let (mut sum, mut one, mut scratch) = (vec![0.0; n * n], vec![0f32; n * n], KernelScratch::default());
        for (node, tent) in nodes {
            let share = f64::from(tent.share(0.0, 0.0, reach.around));
            if share > 0.0 {
                self.kernels.kernel(&self.grid, node, &mut scratch, &mut one);
                sum.iter_mut().zip(&one).for_each(|(s, v)| *s += share * f64::from(*v));
            }
        }
        sum
    }

    /// Blames the difference found at an edge on the steps.
    pub fn blame(&self, setup: &Setup, found: &Found<'_>) -> Blame {
        let (height_mm, azimuth_rad) = found.at;
        let n = self.kernels.size();
        let laid = |values: &mut dyn Iterator<Item = f64>, n: usize, p: f64| -> Vec<Share> {
            let place = |i: usize| (i as f64 - (n / 2) as f64) * p;
            values.enumerate().map(|(i, v)| ((place(i / n), place(i % n)), v)).collect()
        };
        let mixed = setup.source.lens().bands[self.band].psf_of(&self.stack, height_mm);
        let step_px = mixed.pitch_um / setup.pitch_um;
        let mixed = Psf {
            shares: laid(&mut mixed.samples.iter().map(|&v| f64::from(v)), mixed.size, step_px),
            step_px,
            integrated: mixed.sample == pipeline::lens::PsfSample::Integrated,
        };
        let on_the_plane = |psf: &Psf| {
            let mut step = found.step.clone();
            step.squares_px.extend(psf.film_square());
            let psf = psf.clone().windowed(n, azimuth_rad);
            ExpectedEsf::new(psf.shares.iter().copied(), azimuth_rad, &step)
        };
        let (plane, heights) = (on_the_plane(found.psf), on_the_plane(&mixed));
        let kernel = self.kernel(height_mm * 1e3 / setup.pitch_um, azimuth_rad);
        let kernel = ExpectedEsf::new(laid(&mut kernel.into_iter(), n, 1.0).into_iter(), 0.0, found.step);
        let most = |of: &dyn Fn(&(f64, f64, f64)) -> f64| {
            let inside = found.samples.iter().filter(|s| s.0.abs() <= found.half_px);
            inside.map(|s| of(s).abs()).fold(0.0, f64::max)
        };
        Blame {
            sampling: most(&|s| plane.at(s.0) - s.2),
            heights: most(&|s| heights.at(s.0) - plane.at(s.0)),
            kernels: most(&|s| kernel.at(s.0) - s.2),
            rest: most(&|s| s.1 - kernel.at(s.0)),
        }
    }
}
