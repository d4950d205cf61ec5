//! The transpose of the PSF stage: each pixel of the remapped image gathers the film under its own PSF.
//!
//! ```text
//! out[y, x] = Σ_{v, u} film[v, u] · P(r, θ)[v − y, u − x] = Σ_node w_node(y, x) · (film ⋆ P_node)[y, x]
//! ```
//! on the blocks of [`BandPsf::scatter`], with the weights, spectra and transforms of its engine. The film is 0 beyond its border, where [`BandPsf::scatter`] has light that no
//! film receives.

use super::engine::EngineScratch;
use super::polar::BlockPlace;
use super::spectra::SpectrumCache;
use super::{BandPsf, CachedSpectra};
use crate::buffer::AlignedBuf;
use crate::geometry::{Frame, Rect};
use std::cell::Cell;

/// Buffers of one worker for the blocks of one band.
#[derive(Debug, Default)]
pub(crate) struct GatherScratch {
    engine: Option<EngineScratch>,
    /// The film that a block contributes to.
    film: AlignedBuf,
    /// The block.
    out: AlignedBuf,
}

/// Columns that an engine computes together, at most.
const PANEL: usize = 16;

impl BandPsf {
    /// The blocks of the film and its margin, those of a tile after those of the tile before it.
    pub(crate) fn film_blocks(&self, frame: &Frame) -> impl Iterator<Item = Rect> + use<> {
        let blocks = self.blocks;
        let tiles = frame.film.rect().grown(self.margin()).tiles(blocks.tile, blocks.tile);
        tiles.flat_map(move |tile| tile.tiles(blocks.block, blocks.block))
    }

    /// The pixels of `block`, one of [`BandPsf::film_blocks`], of the transpose of `film` (row-major): a buffer, and the pixels from row to row.
    pub(crate) fn gather<'a>(
        &self,
        frame: &Frame,
        block: Rect,
        film: &[f32],
        cache: &SpectrumCache,
        s: &'a mut GatherScratch,
    ) -> (&'a [f32], usize) {
        let window = self.reaches(block);
        let film_stride = window.width.next_multiple_of(PANEL);
        let is_dark = copy_from_film(frame, film, window, (&mut s.film, film_stride));
        let Some(engine) = &self.engine else { return (&s.film, film_stride) };
        let stride = block.width.next_multiple_of(PANEL);
        s.out.reset(stride * block.height);
        if is_dark {
            return (&s.out, stride);
        }
        let place = BlockPlace {
            dy_px: block.y as f64 - frame.axis_px.0,
            dx_px: block.x as f64 - frame.axis_px.1,
            rows: block.height,
            cols: block.width,
        };
        let spectra = CachedSpectra { psf: self, engine, cache, forward: Cell::new(0) };
        let scratch = s.engine.get_or_insert_with(|| engine.scratch());
        engine.gather((&s.film, film_stride), &place, &self.grid, &spectra, (&mut s.out, stride), scratch);
        (&s.out, stride)
    }
}

/// Fills `to`, rows `stride` apart, with the pixels of `window` of `film`, 0 beyond the film; whether all are 0.
fn copy_from_film(frame: &Frame, film: &[f32], window: Rect, (to, stride): (&mut AlignedBuf, usize)) -> bool {
    to.reset(stride * window.height);
    let inside = frame.film.rect().intersect(window);
    let mut is_dark = true;
    for y in inside.y..inside.bottom() {
        let from = &film[y as usize * frame.film.width + inside.x as usize..][..inside.width];
        to[(y - window.y) as usize * stride + (inside.x - window.x) as usize..][..inside.width]
            .copy_from_slice(from);
        is_dark &= from.iter().all(|v| *v == 0.0);
    }
    is_dark
}
