//! The shards and tiles that a run computes.

use super::units::Units;
use crate::job::Job;
use anyhow::Result;
use formats::film::FilmStore;
use pipeline::executor::{BandWork, Work};
use pipeline::tiling::ShardId;
use pipeline::tiling::tiles_needed;
use std::collections::BTreeSet;

/// Shards requested, present or not, per position of the job.
pub fn requested(job: &Job, units: Option<&Units>) -> Vec<BTreeSet<ShardId>> {
    let of = |(position, &film_band): (usize, &usize)| {
        let mut shards = BTreeSet::new();
        for (region, area) in job.regions.iter().enumerate() {
            let (rows, cols) = area.count();
            let in_units = |row: &usize| {
                units.is_none_or(|u| u.contains(&job.film.outputs[region].name, film_band, *row))
            };
            for row in (0..rows).filter(in_units) {
                shards.extend((0..cols).map(|col| ShardId { position, region, row, col }));
            }
        }
        shards
    };
    job.film_bands.iter().enumerate().map(of).collect()
}

/// The requested shards that are not in the film.
///
/// # Errors
/// The store cannot be read.
pub fn missing(
    job: &Job,
    store: &FilmStore,
    requested: &[BTreeSet<ShardId>],
) -> Result<Vec<BTreeSet<ShardId>>> {
    let key = |id: &ShardId| (id.region, job.film_bands[id.position], (id.row, id.col));
    let all: Vec<_> = requested.iter().flatten().map(key).collect();
    let mut present = store.shards_bytes(&all)?.into_iter();
    let missing = |requested: &BTreeSet<ShardId>| {
        requested.iter().filter(|_| present.next().flatten().is_none()).copied().collect()
    };
    Ok(requested.iter().map(missing).collect())
}

/// Number of tiles to compute and of their film pixels, per position of the job.
pub fn tiles(work: &Work<'_>) -> Vec<(u64, u64)> {
    let film = work.film.rect();
    let of = |b: &BandWork| {
        let tiles = tiles_needed(&b.tiling, work.regions, &b.shards);
        let pixels = tiles.iter().map(|&t| b.tiling.rect(t).intersect(film).size().pixels() as u64);
        (tiles.len() as u64, pixels.sum())
    };
    work.bands.iter().map(of).collect()
}
