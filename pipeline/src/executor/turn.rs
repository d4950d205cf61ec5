//! Light in the order of tiles: whoever holds the turn adds all that is next.

use super::feed::{Running, Shared};
use crate::cuda::pool::Downloaded;
use crate::flow::FilmSink;
use crate::plan::{ShardId, Window};
use crate::psf::Scattered;
use std::sync::Arc;

/// What a tile throws on the film, on its way to be added.
pub(crate) struct Light {
    pub(crate) band: Arc<Running>,
    pub(crate) tile: (usize, usize),
    pub(crate) light: Thrown,
}

/// Where a tile's light lies.
pub(crate) enum Thrown {
    /// A worker made it.
    Here(Scattered),
    /// A device made it.
    Down(Downloaded),
    /// The chart could not be read: the shards it reaches cannot be made.
    Lost,
}

impl<S: FilmSink> Shared<'_, S> {
    /// The wanted shards that the light of `tile` reaches.
    pub(super) fn shards(&self, band: &Running, tile: (usize, usize)) -> Vec<ShardId> {
        let work = &self.work.bands[band.position];
        let reach = work.tiling.reach(tile);
        let of = |(window, w): (usize, &Window)| {
            let id = move |(row, col)| ShardId { band: band.position, window, row, col };
            w.touched(reach).map(id).filter(|id| work.wanted.contains(id)).collect::<Vec<_>>()
        };
        self.work.windows.iter().enumerate().flat_map(of).collect()
    }

    /// Hands in a tile's light; if it is this worker's turn, adds all that are next in order.
    pub(crate) fn add(&self, sequence: usize, light: Light) {
        let mut state = self.lock();
        state.waiting.insert(sequence, light);
        if state.adding {
            return;
        }
        state.adding = true;
        loop {
            let turn = state.added;
            let Some(Light { band, tile, light }) = state.waiting.remove(&turn) else { break };
            drop(state);
            let work = &self.work.bands[band.position];
            let reach = work.tiling.reach(tile);
            let finished = self.clock.add.time(|| {
                let mut overlap = self.overlap.lock().expect("workers do not panic");
                let (data, stride) = match &light {
                    Thrown::Here(light) => (&light.data[..], light.stride),
                    Thrown::Down(light) => (light.data(), light.stride),
                    Thrown::Lost => {
                        overlap.lose(&self.shards(&band, tile));
                        return Vec::new();
                    }
                };
                overlap.add(band.position, &work.tiling, &work.wanted, reach, data, stride)
            });
            let pixels = work.tiling.rect(tile).intersect(self.work.frame.film.rect()).size().pixels();
            self.progress.tile(band.position, pixels);
            state = self.lock();
            state.added += 1;
            state.tiles += 1;
            state.pixels += pixels as u64;
            if let Thrown::Here(light) = light {
                state.spare.push(light);
            }
            state.finished.extend(finished);
            self.changed.notify_all();
        }
        state.adding = false;
        self.changed.notify_all();
    }
}
