//! Plan of the depth stage of one band: the nodes that its scene needs, their grids and FFT blocks.

use super::DepthStage;
use super::hidden::Hidden;
use super::occupancy::Occupancy;
use super::pieces::correction::{LEAST_WIDE_PX, may_have_edges};
use super::pieces::shape::Shape;
use super::scene::Scene;
use super::slabs::Slabs;
use crate::field::Field;
use crate::geometry::{Frame, Rect, Size};
use crate::lens::depth::BandDepth;
use crate::lens::{Lens, LensBand, LensError, PsfSample};
use crate::options::{Options, PsfNodes, PsfTables};
use crate::psf::blocks::Blocks;
use crate::psf::grid::NodeGrid;
use crate::psf::kernel::on_demand::{KernelsOnDemand, PsfReader, PsfSource};
use crate::psf::{BandPsf, Builders};
use crate::simd::Simd;
use crate::stage::Stage;
use crate::tiling::Tiling;
use std::sync::Arc;

/// Vergences of the surfaces of a scene, 1/m.
#[derive(Clone, Debug, PartialEq)]
pub struct Surfaces {
    /// Farthest.
    pub first: f64,
    /// Nearest.
    pub last: f64,
    /// Whether they are those of one surface without holes.
    pub is_opaque: bool,
    /// Where they occur.
    pub occupancy: Arc<Occupancy>,
    /// Whether surfaces hidden behind edges are invented.
    pub is_invented: bool,
}

/// Vergences outside a lens's nodes by less than this share are rounding of distances in f32.
const ROUNDING: f64 = 1e-6;

impl Surfaces {
    /// The node whose vergence all of one opaque surface have, if there is one.
    pub fn single_node(&self, nodes: &BandDepth) -> Option<usize> {
        let d = nodes.nearest(self.first);
        let at = |v: f64| (nodes.vergence[d] - v).abs() <= ROUNDING * nodes.vergence[d].max(1e-6);
        (self.is_opaque && at(self.first) && at(self.last)).then_some(d)
    }

    /// Which of the depth nodes at `vergence` (1/m, ascending) of a lens focused at `focus` bound a slab that has surfaces on a chart of `size`.
    pub fn nodes_in_use(&self, vergence: &[f64], focus: f64, size: Size) -> Vec<bool> {
        // The blur is not used.
        let slabs = Slabs::new(vergence, focus, 1.0);
        let occupied = self.occupancy.slabs(&self.occupancy.within(size.rect()), &slabs);
        let mut in_use = vec![false; vergence.len()];
        for s in (0..slabs.count()).filter(|s| occupied[*s]) {
            let (low, high) = slabs.nodes(s);
            (in_use[low], in_use[high]) = (true, true);
        }
        in_use
    }

    /// Whether `nodes` reach over all of them.
    pub fn lies_within(&self, nodes: &BandDepth) -> bool {
        let last = nodes.vergence[nodes.vergence.len() - 1];
        self.first >= nodes.vergence[0] * (1.0 - ROUNDING) && self.last <= last * (1.0 + ROUNDING)
    }
}

/// Film rows over those of the chart, for distortion, and further ones, for interpolation.
const ROWS: (f64, usize) = (1.2, 16);

/// The largest number of slabs nearer than a slab and not apart from it.
fn max_near(slabs: &Slabs) -> usize {
    let of = |far: usize| (far + 1..slabs.count()).take_while(|&near| !slabs.apart(far, near)).count();
    (0..slabs.count()).map(of).max().unwrap_or(0)
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
    /// Slabs that have surfaces.
    pub occupied: Vec<bool>,
    /// Work of each tile, row by row.
    pub tile_work: Vec<TileWork>,
    /// Slabs in reach of a tile, at most.
    pub max_slabs: usize,
    /// How hidden surfaces are invented, and where the scene has surfaces; `None`: they are not.
    pub hidden: Option<(Hidden, Arc<Occupancy>)>,
    /// Film rows of the slabs in reach of a tile, their sum, at most.
    pub max_slab_rows: usize,
    /// Slabs that are not apart from another one, at most.
    pub max_near: usize,
    /// Film pixels beyond a tile that it reads, at most.
    pub reach: usize,
}

/// Side of the blocks for which work is estimated, px, at least.
const MIN_ESTIMATE_PX: usize = 128;

/// Work of a tile, an estimate: from vergences that occur in blocks of the chart, without slabs that only invented surfaces lie in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TileWork {
    /// Slabs with surfaces in reach.
    pub slabs: usize,
    /// Slabs with surfaces in an FFT block of the tile with its margin, the mean.
    pub own: f64,
    /// Slabs with surfaces whose light reaches a pixel that the block reaches, the mean.
    pub reached: f64,
    /// Slabs with surfaces that a pixel of the block sees, the mean, 0 where no edge of surfaces out of focus is expected.
    pub corrected: f64,
    /// Whether surfaces may be invented.
    pub may_invent: bool,
}

/// One depth node.
#[derive(Clone, Debug)]
pub struct NodePlan {
    /// Whether it bounds an occupied slab.
    pub is_used: bool,
    /// Node grid.
    pub grid: NodeGrid,
    /// FFT blocks.
    pub blocks: Blocks,
    /// Number of heights of its PSFs.
    pub heights: usize,
    /// Samples of a side of their windows.
    pub samples: usize,
    /// Their pitch, µm.
    pub pitch_um: f64,
    /// Last REAL height of its PSFs, mm.
    pub last_height_mm: f64,
}

impl DepthPlan {
    /// The depth nodes of band `index` of `lens` that `surfaces` need, on the film of `frame`; `chart_rect` gives the chart under a film
    /// rectangle.
    ///
    /// # Errors
    /// A lens without depth nodes; a PSF window larger than the largest FFT admits.
    pub(crate) fn new(
        frame: &Frame,
        lens: &Lens,
        index: usize,
        surfaces: &Surfaces,
        options: &Options,
        chart_rect: impl Fn(Rect) -> Rect,
    ) -> Result<Self, LensError> {
        let (wavelength_nm, sample) = (lens.bands[index].wavelength_nm, lens.psf_sample);
        let lens = lens.depth.as_ref().ok_or(LensError::NoDepth)?;
        let nodes = &lens.bands[index];
        let blur_px = lens.blur_per_dioptre_um / frame.pitch_um;
        let all = Slabs::new(&nodes.vergence, lens.focus(), blur_px);
        let (first, last) = (all.of(surfaces.first), all.nodes(all.of(surfaces.last)).1);
        let slabs = Slabs::new(&nodes.vergence[first..=last], lens.focus(), blur_px);
        let occupancy = &surfaces.occupancy;
        let occupied = occupancy.slabs(&occupancy.within(frame.chart.rect()), &slabs);
        let is_used = |d: usize| {
            (0..slabs.count()).any(|s| occupied[s] && (slabs.nodes(s).0 == d || slabs.nodes(s).1 == d))
        };
        let plan = |d: usize| {
            let node = &nodes.nodes[d];
            let is_used = is_used(d - first);
            // The PSFs of a node that is not used are not read.
            let psf_window = if is_used { options.psf_window } else { Some(1) };
            let psfs = PsfTables {
                wavelength_nm,
                window: &format!("window of depth node {d}"),
                size: node.psf_size,
                pitch_um: node.psf_pitch_um,
                sample,
                nodes: PsfNodes::symmetric(&node.psf_height_mm, &node.azimuth_count),
            };
            let (grid, blocks) = Options { psf_window, ..*options }.partition(frame, &psfs)?;
            let last_height_mm = node.psf_height_mm[node.psf_height_mm.len() - 1];
            let (heights, samples) = (node.psf_height_mm.len(), node.psf_size);
            let pitch_um = node.psf_pitch_um;
            Ok(NodePlan { is_used, grid, blocks, heights, samples, pitch_um, last_height_mm })
        };
        let nodes = (first..=last).map(plan).collect::<Result<Vec<NodePlan>, LensError>>()?;
        let hidden = surfaces.is_invented.then(|| {
            let windows: Vec<usize> =
                nodes.iter().map(|n| if n.is_used { n.blocks.window } else { 0 }).collect();
            (Hidden::new(&slabs, &occupied, &windows), Arc::clone(occupancy))
        });
        let max_near = max_near(&slabs);
        let mut plan = Self {
            slabs,
            first_node: first,
            nodes,
            occupied,
            tile_work: Vec::new(),
            max_slabs: 1,
            hidden,
            max_slab_rows: 0,
            max_near,
            reach: 0,
        };
        plan.reach = plan.margin();
        let tiling = Tiling::new(frame.film, None);
        let (rows, columns) = tiling.count();
        for tile in (0..rows).flat_map(|i| (0..columns).map(move |j| (i, j))) {
            let may_invent = plan.reach_of_tile(frame, tiling.rect(tile), occupancy, &chart_rect);
            plan.tile_work.push(plan.work(tiling.rect(tile), occupancy, may_invent, &chart_rect));
        }
        Ok(plan)
    }

    /// Estimates the work of a tile.
    fn work(
        &self,
        tile: Rect,
        occupancy: &Occupancy,
        may_invent: bool,
        chart_rect: impl Fn(Rect) -> Rect,
    ) -> TileWork {
        let slabs = |rect: Rect| occupancy.slabs(&occupancy.inside(chart_rect(rect)), &self.slabs);
        let count = |rect: Rect| slabs(rect).into_iter().filter(|is| *is).count();
        let mean =
            |of: fn(&NodePlan) -> usize| self.used().map(of).sum::<usize>() / self.used().count().max(1);
        let (side, margin) = (mean(|n| n.blocks.block).max(MIN_ESTIMATE_PX), mean(|n| n.blocks.window / 2));
        let grown = tile.grown(margin);
        let blur_px = self.used_blur_px();
        let (mut own, mut reached, mut corrected, mut blocks) = (0, 0, 0, 0);
        for y in (grown.y..grown.bottom()).step_by(side) {
            for x in (grown.x..grown.right()).step_by(side) {
                let block = Rect::new(y, x, side, side);
                own += count(block);
                reached += count(block.grown(2 * margin));
                let seen = slabs(block.grown(margin));
                if blur_px >= LEAST_WIDE_PX && may_have_edges(&self.slabs, &seen, side + 2 * margin) {
                    corrected += seen.into_iter().filter(|is| *is).count();
                }
                blocks += 1;
            }
        }
        let per_block = |n: usize| n as f64 / f64::from(blocks.max(1));
        TileWork {
            slabs: count(grown),
            own: per_block(own),
            reached: per_block(reached),
            corrected: per_block(corrected),
            may_invent,
        }
    }

    /// Raises `max_slabs`, `max_slab_rows` and `reach` to those of a tile; whether surfaces may be invented there.
    fn reach_of_tile(
        &mut self,
        frame: &Frame,
        tile: Rect,
        occupancy: &Occupancy,
        chart_rect: impl Fn(Rect) -> Rect,
    ) -> bool {
        let within = |rect: Rect| occupancy.slabs(&occupancy.within(chart_rect(rect)), &self.slabs);
        let mut read = tile.grown(self.margin());
        let mut in_reach = within(tile.grown(self.margin()));
        let possible = self
            .hidden
            .as_ref()
            .filter(|(hidden, _)| hidden.may_be_in(chart_rect(hidden.edges(tile)), occupancy));
        let may_invent = possible.is_some();
        if let Some((hidden, _)) = possible {
            let rect = hidden.sources(tile);
            read = rect;
            let beyond = [
                tile.y - rect.y,
                tile.x - rect.x,
                rect.bottom() - tile.bottom(),
                rect.right() - tile.right(),
            ];
            self.reach = self.reach.max(beyond.into_iter().max().unwrap_or(0).max(0) as usize);
            // An invented surface may lie in any slab between the others.
            in_reach = within(rect);
            let (first, last) = (in_reach.iter().position(|is| *is), in_reach.iter().rposition(|is| *is));
            let between = first.unwrap_or(0)..=last.unwrap_or(0);
            in_reach = self.occupied[between].to_vec();
        }
        self.max_slabs = self.max_slabs.max(in_reach.iter().filter(|is| **is).count());
        let rect = chart_rect(read);
        let is_inside = frame.chart.rect().contains(rect);
        let rows = |of_chart: usize| match (of_chart, is_inside) {
            (0, _) => 0,
            // Beyond the chart its edge, or its mirror image, continues.
            (_, false) => read.height,
            (rows, true) => ((ROWS.0 * frame.scale.0 * rows as f64) as usize + ROWS.1).min(read.height),
        };
        let all = occupancy.rows_of_slabs(rect, &self.slabs).into_iter().map(rows).sum();
        self.max_slab_rows = self.max_slab_rows.max(all);
        may_invent
    }

    /// The nodes whose PSFs are needed.
    pub fn used(&self) -> impl Iterator<Item = &NodePlan> {
        self.nodes.iter().filter(|node| node.is_used)
    }

    /// The largest blur radius of the nodes whose PSFs are needed, px.
    fn used_blur_px(&self) -> f64 {
        let used = std::iter::zip(self.slabs.vergence(), &self.nodes).filter(|(_, node)| node.is_used);
        used.map(|(v, _)| self.slabs.blur_at(*v).abs()).fold(0.0, f64::max)
    }

    /// Half the widest window, px.
    pub fn margin(&self) -> usize {
        self.used().map(|node| node.blocks.window / 2).max().unwrap_or(0)
    }

    /// The stage at `position` of the job with the lens tables `band` and `nodes`; `reader` reads a PSF of a depth node of the lens, of `sample`.
    pub(crate) fn stage(
        &self,
        position: usize,
        frame: &Frame,
        (band, nodes, sample): (&LensBand, &BandDepth, PsfSample),
        options: &Options,
        gain: f64,
        reader: PsfReader,
    ) -> DepthStage {
        let (source, builders) = (PsfSource::new(reader, 1), Builders::default());
        let fields = (0..self.slabs.count()).map(|s| {
            let (low, high) = self.slabs.nodes(s);
            let tables = nodes.between(band, (self.first_node + low, self.first_node + high));
            Field::on_chart(
                &tables,
                frame,
                options.stages.has(Stage::Distortion),
                options.stages.has(Stage::Ri),
                gain,
            )
        });
        let same_map = !options.stages.has(Stage::Distortion) || !nodes.has_pupil_shift();
        let scene = Scene::new(
            frame,
            (&self.slabs, &self.occupied),
            fields.collect(),
            same_map,
            options.interpolation,
        );
        let mut psfs = Vec::with_capacity(self.nodes.len());
        let mut first_id = 0;
        for (d, node) in self.nodes.iter().enumerate() {
            if !node.is_used {
                psfs.push(None);
                continue;
            }
            let kernels = KernelsOnDemand::new(
                (&source, self.first_node + d),
                node.heights,
                (node.samples, node.pitch_um, sample),
                frame.pitch_um,
                options.psf_window,
                options.simd,
            );
            let id = (position, first_id);
            let stage = BandPsf::of_depth_node(id, node.grid.clone(), kernels, options.simd, &builders);
            psfs.push(Some(stage));
            first_id += node.grid.len();
        }
        let shape = self.shape(frame, &source, options.simd);
        DepthStage::new(position, scene, self.slabs.clone(), (psfs, source), self.hidden.clone(), shape)
    }

    /// Shape of the pupil, of the used node that is farthest from focus, if two surfaces may be out of focus.
    fn shape(&self, frame: &Frame, source: &PsfSource, simd: Simd) -> Option<Shape> {
        let blur = |d: usize| self.slabs.blur_at(self.slabs.vergence()[d]);
        let used = (0..self.nodes.len()).filter(|&d| self.nodes[d].is_used);
        let wide = used.max_by(|&a, &b| blur(a).abs().total_cmp(&blur(b).abs()))?;
        let node = &self.nodes[wide];
        let samples = (node.samples, node.pitch_um / frame.pitch_um);
        (blur(wide).abs() >= LEAST_WIDE_PX).then(|| {
            let of = (self.first_node + wide, blur(wide));
            Shape::new(source, of, node.grid.heights_px(), samples, (node.blocks.window, simd))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_of_empty_slabs_are_not_in_use() {
        let size = Size::new(64, 64);
        let mut occupancy = Occupancy::new(size);
        for v in [0.3, 0.31, 1.7] {
            occupancy.add(5, 5, v);
        }
        let surfaces = Surfaces {
            first: 0.3,
            last: 1.7,
            is_opaque: true,
            occupancy: Arc::new(occupancy),
            is_invented: true,
        };
        let vergence = [0.0, 0.25, 0.5, 1.0, 1.5, 1.75, 2.0];
        let in_use = surfaces.nodes_in_use(&vergence, 0.5, size);
        assert_eq!(in_use, [false, true, true, false, true, true, false]);
    }
}
