//! Depth stage: a film of surfaces at several distances, in place of the stages remap and SVPSF.
//!
//! A distance per chart pixel ([`sheet`]) is converted to a vergence and divided into slabs between the lens's depth nodes ([`slabs`]). Each slab is
//! remapped (`scene`), convolved with the kernels of its two nodes and composited with the slabs in front of it (`composite`). A composite is not
//! linear, so tails cannot be added later: the stage gathers, each tile of the film reads the margin that its kernels need and writes its own pixels.
//!
//! Cost per slab of a tile: light on two nodes, its share of the pupil on two nodes, known and missing share, six convolutions, and e of each node
//! once a tile; planes that are 0 cost nothing.

mod composite;
pub mod memory;
pub mod occupancy;
pub mod plan;
mod scene;
pub mod sheet;
pub mod slabs;

use crate::buffer::TileBuffer;
use crate::clock::Clock;
use crate::flow::{ChartSource, SourceSinkError};
use crate::geometry::{Frame, Rect};
use crate::psf::BandPsf;
use crate::psf::spectra::SpectrumCache;
use composite::{Composite, CompositeScratch};
use scene::{Planes, Scene, SceneScratch};
use sheet::Sheet;
use slabs::Slabs;

/// The depth stage of one band.
#[derive(Debug)]
pub struct DepthStage {
    scene: Scene,
    slabs: Slabs,
    /// PSF stage of every depth node that the scene needs.
    psfs: Vec<Option<BandPsf>>,
    /// Half the widest window, px.
    margin: usize,
}

/// Buffers of one worker.
#[derive(Debug, Default)]
pub struct DepthScratch {
    planes: Planes,
    scene: SceneScratch,
    composite: CompositeScratch,
    film: Vec<f32>,
}

impl DepthStage {
    fn new(scene: Scene, slabs: Slabs, psfs: Vec<Option<BandPsf>>) -> Self {
        let margin = psfs.iter().flatten().map(BandPsf::margin).max().unwrap_or(0);
        Self { scene, slabs, psfs, margin }
    }

    /// Computes the film of `tile` from `sheets` and band `band` of `chart` into `out`, without a tail.
    ///
    /// # Errors
    /// Those of the sources; a distance that is not positive.
    #[allow(clippy::too_many_arguments, reason = "inputs, output, scratch and clock are independent")]
    pub fn compute(
        &self,
        frame: &Frame,
        chart: &dyn ChartSource,
        band: usize,
        sheets: &[Sheet<'_>],
        tile: Rect,
        spectra: &SpectrumCache,
        out: &mut TileBuffer,
        scratch: &mut DepthScratch,
        clock: &Clock,
    ) -> Result<(), SourceSinkError> {
        let DepthScratch { planes, scene, composite, film } = scratch;
        let grown = tile.grown(self.margin);
        clock.remap.time(|| self.scene.planes(chart, band, sheets, grown, planes, scene))?;
        clock.svpsf.time(|| {
            let stage = Composite { frame, slabs: &self.slabs, psfs: &self.psfs, spectra };
            film.resize(tile.size().pixels(), 0.0);
            stage.tile(tile, planes, film, composite);
            out.copy(film, tile.width);
        });
        Ok(())
    }
}
