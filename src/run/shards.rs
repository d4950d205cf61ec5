//! Which shards and tiles a run makes.

use super::units::Units;
use crate::job::Job;
use anyhow::Result;
use formats::film::FilmStore;
use pipeline::executor::{BandWork, Work};
use pipeline::overlap_add::tiles_needed;
use pipeline::plan::ShardId;
use std::collections::BTreeSet;

/// All shards to make or made, per position of the job.
pub fn asked(job: &Job, units: Option<&Units>) -> Vec<BTreeSet<ShardId>> {
    let of = |(band, &film_band): (usize, &usize)| {
        let mut asked = BTreeSet::new();
        for (window, w) in job.windows.iter().enumerate() {
            let (rows, cols) = w.count();
            let own =
                |row: &usize| units.is_none_or(|u| u.has(&job.film.outputs[window].name, film_band, *row));
            for row in (0..rows).filter(own) {
                asked.extend((0..cols).map(|col| ShardId { band, window, row, col }));
            }
        }
        asked
    };
    job.film_bands.iter().enumerate().map(of).collect()
}

/// Those of them that are not there.
pub fn missing(job: &Job, store: &FilmStore, asked: &[BTreeSet<ShardId>]) -> Result<Vec<BTreeSet<ShardId>>> {
    let place = |id: &ShardId| (id.window, job.film_bands[id.band], (id.row, id.col));
    let all: Vec<_> = asked.iter().flatten().map(place).collect();
    let mut there = store.shards_bytes(&all)?.into_iter();
    let missing = |asked: &BTreeSet<ShardId>| {
        asked.iter().filter(|_| there.next().flatten().is_none()).copied().collect()
    };
    Ok(asked.iter().map(missing).collect())
}

/// The tiles to make and their film pixels, per position of the job.
pub fn tiles(work: &Work<'_>) -> Vec<(u64, u64)> {
    let film = work.film.rect();
    let of = |b: &BandWork| {
        let tiles = tiles_needed(&b.tiling, work.windows, &b.wanted);
        let pixels = tiles.iter().map(|&t| b.tiling.rect(t).intersect(film).size().pixels() as u64);
        (tiles.len() as u64, pixels.sum())
    };
    work.bands.iter().map(of).collect()
}
