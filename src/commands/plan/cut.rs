//! Division of a job into units, bands × shard rows, with the cost of each.
//!
//! Tiles whose tails reach two units are computed by both, about one row of tiles per boundary. So a unit is a complete band, unless
//! that makes fewer than [`MIN_UNITS`] units; then bands are divided as long as at most [`MAX_TWICE`] of the tiles are computed twice.
//! Bands are grouped beyond [`MAX_UNITS`] alone. Shard rows are counted through all arrays of the
//! film, one after the other. The division depends on the job alone.

use super::file::{Shards, Totals, Unit};
use crate::job::Job;
use crate::job::cost;
use pipeline::tiling::ShardId;
use pipeline::tiling::tiles_needed;
use std::collections::{BTreeMap, BTreeSet};

/// Units that suffice to balance the load of some workers.
const MIN_UNITS: usize = 24;
/// Share of the tiles that may be computed twice to reach [`MIN_UNITS`].
const MAX_TWICE: f64 = 0.1;
/// Maximum number of units by default: many clusters limit array jobs to 1001.
const MAX_UNITS: usize = 1000;
/// Core seconds below which a band is not divided: twenty times a worker's start-up.
const MIN_CORE_S: f64 = 4.0;

/// The film's arrays and their shards.
pub fn outputs(job: &Job) -> BTreeMap<String, Shards> {
    let of = |(i, area): (usize, &pipeline::tiling::FilmRegion)| {
        let (rows, columns) = area.count();
        (job.film.outputs[i].name.clone(), Shards { rows, columns })
    };
    job.regions.iter().enumerate().map(of).collect()
}

/// Divides the job, into units of `unit_rows` shard rows or into at least `count` units if given.
pub fn units(job: &Job, unit_rows: Option<usize>, count: Option<usize>) -> Vec<Unit> {
    let rows: Vec<(usize, usize)> = job
        .regions
        .iter()
        .enumerate()
        .flat_map(|(region, area)| (0..area.count().0).map(move |row| (region, row)))
        .collect();
    let bands: Vec<usize> = (0..job.plans.len()).collect();
    let cut_into = |groups: &[&[usize]], parts: &[&[(usize, usize)]]| -> Vec<Unit> {
        let mut units = Vec::new();
        for bands in groups {
            let mut seen = BTreeSet::new();
            for rows in parts {
                units.push(unit(job, units.len(), bands, rows, &mut seen));
            }
        }
        units
    };
    let cut = |group: usize, unit_rows: usize| {
        let (groups, parts): (Vec<_>, Vec<_>) =
            (bands.chunks(group).collect(), rows.chunks(unit_rows).collect());
        cut_into(&groups, &parts)
    };
    if let Some(count) = count {
        return cut_into(&equal_parts(&bands, count), &equal_parts(&rows, count.div_ceil(bands.len())));
    }
    if let Some(unit_rows) = unit_rows {
        return cut(1, unit_rows);
    }
    let whole_bands = cut(1, rows.len());
    let core_s = whole_bands.iter().map(|u| u.cost.core_s).sum::<f64>();
    let affordable = (core_s / MIN_CORE_S) as usize;
    let max_parts = MIN_UNITS.min(affordable).div_ceil(bands.len()).min(rows.len());
    for parts in (2..=max_parts).rev() {
        let units = cut(1, rows.len().div_ceil(parts));
        let sum = |of: fn(&Totals) -> usize| units.iter().map(|u| of(&u.cost)).sum::<usize>() as f64;
        if sum(|c| c.tiles_again) <= MAX_TWICE * sum(|c| c.tiles) {
            return units;
        }
    }
    let group = bands.len().div_ceil(MAX_UNITS);
    if group == 1 { whole_bands } else { cut(group, rows.len()) }
}

/// At most `count` parts of `all` whose sizes differ by one at most.
fn equal_parts<T>(all: &[T], count: usize) -> Vec<&[T]> {
    let count = count.clamp(1, all.len().max(1));
    (0..count).map(|i| &all[i * all.len() / count..(i + 1) * all.len() / count]).collect()
}

/// Sums of costs.
pub fn totals(units: &[Unit]) -> Totals {
    let add = |a: Totals, u: &Unit| Totals {
        shards: a.shards + u.cost.shards,
        tiles: a.tiles + u.cost.tiles,
        tiles_again: a.tiles_again + u.cost.tiles_again,
        bytes_read: a.bytes_read + u.cost.bytes_read,
        bytes_written: a.bytes_written + u.cost.bytes_written,
        core_s: cost::rounded(a.core_s + u.cost.core_s),
        gpu_bytes: a.gpu_bytes.max(u.cost.gpu_bytes),
    };
    units.iter().fold(Totals::default(), add)
}

/// The unit of `bands` and `rows` (region, shard row); `seen`, the tiles of the units before it, is extended by its own.
fn unit(
    job: &Job,
    number: usize,
    bands: &[usize],
    rows: &[(usize, usize)],
    seen: &mut BTreeSet<(usize, (usize, usize))>,
) -> Unit {
    let mut all = Totals::default();
    for &band in bands {
        let plan = &job.plans[band];
        let cols = |region: usize| 0..job.regions[region].count().1;
        let shards = rows.iter().flat_map(|&(region, row)| {
            cols(region).map(move |col| ShardId { position: band, region, row, col })
        });
        let shards: BTreeSet<ShardId> = shards.collect();
        let tiles = tiles_needed(&plan.tiling, &job.regions, &shards);
        let whole = (band, (0, 0))..=(band, (usize::MAX, usize::MAX));
        // Layers of light are computed by the first unit of the band.
        let (layers_read, layers_s) =
            if seen.range(whole).next().is_none() { cost::layers(job) } else { (0, 0.0) };
        all.tiles_again += tiles.iter().filter(|t| !seen.insert((band, **t))).count();
        all.tiles += tiles.len();
        all.shards += shards.len();
        let sample = job.film.sample.bytes();
        let pixels = |s: &ShardId| job.regions[s.region].shard_rect(s.row, s.col).size().pixels();
        all.bytes_written += (shards.iter().map(pixels).sum::<usize>() * sample) as u64;
        all.bytes_read += cost::bytes_read(job, band, &tiles) + layers_read;
        all.core_s = cost::rounded(all.core_s + cost::core_s(plan, job.options.stages, &tiles) + layers_s);
        all.gpu_bytes = all.gpu_bytes.max(cost::gpu_bytes(plan, &tiles));
    }
    let mut ranges = BTreeMap::new();
    for &(region, row) in rows {
        let range = ranges.entry(job.film.outputs[region].name.clone()).or_insert((row, row));
        range.1 = row + 1;
    }
    Unit { unit: number, bands: bands.to_vec(), rows: ranges, cost: all }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_parts_hold_everything_in_order() {
        let all: Vec<usize> = (0..31).collect();
        for count in [1, 2, 7, 30, 31, 40] {
            let parts = equal_parts(&all, count);
            assert_eq!(parts.len(), count.min(31));
            assert_eq!(parts.concat(), all);
            let sizes = parts.iter().map(|p| p.len());
            assert!(sizes.clone().max().unwrap() - sizes.min().unwrap() <= 1, "{count}");
        }
    }
}
