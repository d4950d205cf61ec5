//! Plan of the depth stage of one band: the nodes that its scene needs, their grids and FFT blocks.

use super::DepthStage;
use super::scene::Scene;
use super::slabs::Slabs;
use crate::field::Field;
use crate::geometry::Frame;
use crate::lens::PsfSample;
use crate::lens::depth::{BandDepth, LensDepth};
use crate::lens::{LensBand, LensError, PsfStack};
use crate::options::Options;
use crate::psf::BandPsf;
use crate::psf::blocks::Blocks;
use crate::psf::grid::NodeGrid;
use crate::psf::kernel::{NodeKernels, film_window};

/// Range of vergences of a scene, 1/m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VergenceRange {
    /// Farthest.
    pub first: f64,
    /// Nearest.
    pub last: f64,
    /// Whether it is that of one surface without holes.
    pub is_opaque: bool,
}

/// Vergences outside a lens's nodes by less than this share are rounding of distances in f32.
const ROUNDING: f64 = 1e-6;

impl VergenceRange {
    /// The node whose vergence all of one opaque surface have, if there is one.
    pub fn single_node(&self, nodes: &BandDepth) -> Option<usize> {
        let d = nodes.nearest(self.first);
        let at = |v: f64| (nodes.vergence[d] - v).abs() <= ROUNDING * nodes.vergence[d].max(1e-6);
        (self.is_opaque && at(self.first) && at(self.last)).then_some(d)
    }

    /// Whether `nodes` reach over it.
    pub fn lies_within(&self, nodes: &BandDepth) -> bool {
        let last = nodes.vergence[nodes.vergence.len() - 1];
        self.first >= nodes.vergence[0] * (1.0 - ROUNDING) && self.last <= last * (1.0 + ROUNDING)
    }
}

/// Plan of the depth stage of one band.
#[derive(Clone, Debug)]
pub struct DepthPlan {
    /// Slabs between the nodes.
    pub slabs: Slabs,
    /// Depth node of the lens of the first one of [`DepthPlan::nodes`].
    pub first_node: usize,
    /// The nodes, the farthest first.
    pub nodes: Vec<NodePlan>,
}

/// One depth node.
#[derive(Clone, Debug)]
pub struct NodePlan {
    /// Node grid.
    pub grid: NodeGrid,
    /// FFT blocks.
    pub blocks: Blocks,
    /// Heights and samples of a window side of its PSFs.
    pub heights: usize,
    /// See [`NodePlan::heights`].
    pub samples: usize,
    /// Last REAL height of its PSFs, mm.
    pub last_height_mm: f64,
}

impl DepthPlan {
    /// The nodes of `nodes` that a scene of `range` needs, on the film of `frame`.
    ///
    /// # Errors
    /// A PSF window larger than the largest FFT admits.
    pub(crate) fn new(
        frame: &Frame,
        lens: &LensDepth,
        nodes: &BandDepth,
        wavelength_nm: f64,
        sample: PsfSample,
        range: VergenceRange,
        options: &Options,
    ) -> Result<Self, LensError> {
        let blur_px = lens.blur_per_dioptre_um / frame.pitch_um;
        let all = Slabs::new(&nodes.vergence, lens.focus(), blur_px);
        let (first, last) = (all.of(range.first), all.nodes(all.of(range.last)).1);
        let plan = |d: usize| {
            let node = &nodes.nodes[d];
            let full = film_window(node.psf_size, node.psf_pitch_um, frame.pitch_um, sample);
            let window = options.psf_window.map_or(full, |w| w.min(full));
            if window > Blocks::widest_window() {
                return Err(LensError::Table {
                    wavelength_nm,
                    table: "psf",
                    problem: format!(
                        "window of depth node {d} covers {window} film pixels, at most {} can be convolved; crop it with `--psf-window`",
                        Blocks::widest_window()
                    ),
                });
            }
            let azimuths: Vec<usize> = match options.azimuths {
                Some(j) => node.azimuth_count.iter().map(|&count| if count == 1 { 1 } else { j }).collect(),
                None => node.azimuth_count.clone(),
            };
            let grid = NodeGrid::new(&node.psf_height_mm, &azimuths, frame.pitch_mm());
            let blocks = Blocks::choose(window, &grid);
            let last_height_mm = node.psf_height_mm[node.psf_height_mm.len() - 1];
            let (heights, samples) = (node.psf_height_mm.len(), node.psf_size);
            Ok(NodePlan { grid, blocks, heights, samples, last_height_mm })
        };
        Ok(Self {
            slabs: Slabs::new(&nodes.vergence[first..=last], lens.focus(), blur_px),
            first_node: first,
            nodes: (first..=last).map(plan).collect::<Result<_, _>>()?,
        })
    }

    /// Half the widest window, px.
    pub fn margin(&self) -> usize {
        self.nodes.iter().map(|node| node.blocks.window / 2).max().unwrap_or(0)
    }

    /// The stage at `position` of the job with the lens tables `band` and `nodes`; `stack` reads the PSFs of a depth node of the lens.
    ///
    /// # Errors
    /// Errors of `stack`.
    #[allow(clippy::too_many_arguments, reason = "plan, lens, geometry and gain are independent")]
    pub(crate) fn stage<E>(
        &self,
        position: usize,
        frame: &Frame,
        (band, nodes): (&LensBand, &BandDepth),
        options: &Options,
        gain: f64,
        mut stack: impl FnMut(usize) -> Result<PsfStack, E>,
    ) -> Result<DepthStage, E> {
        let fields = (0..self.slabs.count()).map(|s| {
            let (low, high) = self.slabs.nodes(s);
            let tables = nodes.between(band, (self.first_node + low, self.first_node + high));
            Field::new(&tables, frame.pitch_mm(), options.stages.distortion, options.stages.ri, gain)
        });
        let same_map = !options.stages.distortion || nodes.pupil_shift_mm.iter().all(|shift| *shift == 0.0);
        let scene = Scene::new(frame, &self.slabs, fields.collect(), same_map, options.interpolation);
        let mut psfs = Vec::with_capacity(self.nodes.len());
        let mut first_id = 0;
        for (d, node) in self.nodes.iter().enumerate() {
            let samples = stack(self.first_node + d)?;
            let kernels = NodeKernels::new(&samples, frame.pitch_um, options.psf_window, options.simd);
            psfs.push(
                BandPsf::new(position, node.grid.clone(), kernels, options.simd).with_first_id(first_id),
            );
            first_id += node.grid.len();
        }
        Ok(DepthStage::new(scene, self.slabs.clone(), psfs))
    }
}
