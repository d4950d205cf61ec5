//! Depth stage: a film of surfaces at several distances, in place of the stages remap and SVPSF.
//!
//! A distance per chart pixel ([`sheet`]) is converted to a vergence and divided into slabs between the lens's depth nodes ([`slabs`]). Each slab is
//! remapped (`scene`), what is hidden behind edges and not given is invented ([`hidden`]), and the slabs are convolved with the kernels of its two nodes and composited with the slabs in front of it (`composite`). A composite is not
//! linear, so tails cannot be added later: the stage gathers, each tile of the film reads the margin that its kernels need and writes its own pixels.
//!
//! Cost per slab of a tile: light on two nodes, its share of the pupil on two nodes, known and missing share, six convolutions, and e of each node
//! once a tile ([`counts`]). FFT blocks that are 0, or that reach no pixel where the slab is needed, cost nothing.
//!
//! # Words
//!
//! - **vergence**: 1/distance from the entrance pupil, in 1/m (dioptres). **depth node**: a vergence for which the lens has PSFs. **slab**: what lies
//!   between two depth nodes. **sheet**: a surface with a chart, a distance and a coverage per chart pixel.

mod composite;
pub mod counts;
mod extrapolate;
pub mod hidden;
pub mod invented;
pub mod memory;
pub mod occupancy;
mod pieces;
pub mod plan;
mod planes;
mod scene;
pub mod seen;
pub mod sheet;
pub mod slabs;
mod surface;
mod wanted;

use crate::buffer::TileBuffer;
use crate::clock::{Clock, Phase};
use crate::flow::{ChartSource, SourceSinkError};
use crate::geometry::{Frame, Rect};
use crate::psf::BandPsf;
use crate::psf::kernel::on_demand::PsfSource;
use crate::psf::spectra::SpectrumCache;
use composite::{Composite, CompositeScratch};
use counts::SharedCounts;
use hidden::{Hidden, HiddenScratch};
use invented::InventedLight;
use occupancy::Occupancy;
use pieces::shape::Shape;
use planes::Planes;
use scene::{Scene, SceneScratch};
use sheet::Sheet;
use slabs::Slabs;
use std::sync::Arc;

/// The depth stage of one band.
#[derive(Debug)]
pub struct DepthStage {
    /// Position of the band in the job.
    position: usize,
    scene: Scene,
    slabs: Slabs,
    /// PSF stage of every depth node that the scene needs.
    psfs: Vec<Option<BandPsf>>,
    /// Where their PSFs are read from.
    source: PsfSource,
    /// Half the widest window, px.
    margin: usize,
    /// How hidden surfaces are invented, and where the scene has surfaces; `None`: they are not.
    hidden: Option<(Hidden, Arc<Occupancy>)>,
    /// Shape of the pupil, for the correction of surfaces that are both out of focus; `None`: no correction.
    shape: Option<Shape>,
}

/// Surfaces of a job.
#[derive(Clone, Copy, Default)]
pub struct SceneInputs<'a> {
    /// Nearest first; the first one has the chart of the job.
    pub sheets: &'a [Sheet<'a>],
    /// Receives the invented light.
    pub invented: Option<&'a InventedLight>,
    /// Receives counts.
    pub counts: Option<&'a SharedCounts>,
}

/// Buffers of one worker.
#[derive(Debug, Default)]
pub struct DepthScratch {
    planes: Planes,
    scene: SceneScratch,
    hidden: HiddenScratch,
    composite: CompositeScratch,
    film: Vec<f32>,
    invented: Vec<f32>,
}

impl DepthStage {
    fn new(
        position: usize,
        scene: Scene,
        slabs: Slabs,
        (psfs, source): (Vec<Option<BandPsf>>, PsfSource),
        hidden: Option<(Hidden, Arc<Occupancy>)>,
        shape: Option<Shape>,
    ) -> Self {
        let margin = psfs.iter().flatten().map(BandPsf::margin).max().unwrap_or(0);
        Self { position, scene, slabs, psfs, source, margin, hidden, shape }
    }

    /// Computes the film of `tile` from `surfaces` and band `band` of `chart` into `out`, without a tail.
    ///
    /// # Errors
    /// Those of the sources; a distance that is not positive; a PSF that cannot be read.
    #[allow(clippy::too_many_arguments, reason = "inputs, output, scratch and clock are independent")]
    pub fn compute(
        &self,
        frame: &Frame,
        chart: &dyn ChartSource,
        band: usize,
        surfaces: SceneInputs<'_>,
        tile: Rect,
        spectra: &SpectrumCache,
        out: &mut TileBuffer,
        scratch: &mut DepthScratch,
        clock: &Clock,
    ) -> Result<(), SourceSinkError> {
        let DepthScratch { planes, scene, hidden, composite, film, invented } = scratch;
        let grown = tile.grown(self.margin);
        clock.of(Phase::Remap).time(|| -> Result<(), SourceSinkError> {
            let inventing = self
                .hidden
                .as_ref()
                .filter(|(hidden, occupancy)| self.scene.may_hide(hidden.edges(tile), hidden, occupancy));
            let rect = inventing.map_or(grown, |(hidden, _)| hidden.sources(tile));
            self.scene.planes(chart, band, surfaces.sheets, rect, planes, scene)?;
            if let Some((stage, _)) = inventing {
                stage.add(tile, planes, hidden);
            }
            Ok(())
        })?;
        clock.of(Phase::Svpsf).time(|| {
            let stage = Composite {
                frame,
                slabs: &self.slabs,
                psfs: &self.psfs,
                spectra,
                shape: self.shape.as_ref(),
                margin: self.margin,
            };
            film.resize(tile.size().pixels(), 0.0);
            stage.tile(tile, planes, film, invented, composite);
            out.copy(film, tile.width);
        });
        self.source.check()?;
        surfaces.counts.iter().for_each(|counts| counts.add(composite.counts()));
        if let Some(light) = surfaces.invented.filter(|_| !invented.is_empty()) {
            light.add(self.position, tile, invented);
        }
        Ok(())
    }
}
