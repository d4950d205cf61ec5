//! The cut of a job into units: bands x shard rows, and what each unit costs.
//!
//! Light crosses a cut: the tiles of source pixels whose tails reach both sides are computed by both units, about one row
//! of tiles a cut. So a unit is a whole band unless that makes fewer than [`ENOUGH`] units, and then no finer than lets
//! [`AGAIN`] of the tiles be computed twice; and bands that cost little are bundled, so that start-up stays small beside
//! them. Shard rows are counted through all the film's arrays, one after the other. All of this follows from the job alone.

use super::cost;
use super::file::{Shards, Totals, Unit};
use crate::job::Job;
use pipeline::overlap_add::tiles_needed;
use pipeline::plan::ShardId;
use std::collections::{BTreeMap, BTreeSet};

/// Units that keep some workers busy to the end.
const ENOUGH: usize = 24;
/// Share of the tiles that may be computed twice to get them.
const AGAIN: f64 = 0.1;
/// Units at most, unless asked: an array job's limit in many clusters is 1001.
const MOST: usize = 1000;
/// Seconds of one core below which a unit is bundled with the next band: twenty times a worker's start-up.
const MIN_CORE_S: f64 = 4.0;

/// The film's arrays and their shards.
pub fn outputs(job: &Job) -> BTreeMap<String, Shards> {
    let of = |(i, w): (usize, &pipeline::plan::Window)| {
        let (rows, columns) = w.count();
        (job.film.outputs[i].name.clone(), Shards { rows, columns })
    };
    job.windows.iter().enumerate().map(of).collect()
}

/// Cuts the job, into `unit_rows` shard rows a unit if asked.
pub fn units(job: &Job, unit_rows: Option<usize>) -> Vec<Unit> {
    let rows: Vec<(usize, usize)> = job
        .windows
        .iter()
        .enumerate()
        .flat_map(|(window, w)| (0..w.count().0).map(move |row| (window, row)))
        .collect();
    let bands: Vec<usize> = (0..job.plans.len()).collect();
    let cut = |bundle: usize, unit_rows: usize| -> Vec<Unit> {
        let mut units = Vec::new();
        for bands in bands.chunks(bundle) {
            let mut seen = BTreeSet::new();
            for rows in rows.chunks(unit_rows) {
                units.push(unit(job, units.len(), bands, rows, &mut seen));
            }
        }
        units
    };
    if let Some(unit_rows) = unit_rows {
        return cut(1, unit_rows);
    }
    let whole = cut(1, rows.len());
    let core_s = whole.iter().map(|u| u.cost.core_s).sum::<f64>();
    let dear = (core_s / MIN_CORE_S) as usize;
    let wanted = ENOUGH.min(dear).div_ceil(bands.len()).min(rows.len());
    for parts in (2..=wanted).rev() {
        let units = cut(1, rows.len().div_ceil(parts));
        let sum = |of: fn(&Totals) -> usize| units.iter().map(|u| of(&u.cost)).sum::<usize>() as f64;
        if sum(|c| c.tiles_again) <= AGAIN * sum(|c| c.tiles) {
            return units;
        }
    }
    let bundle = bands.len().div_ceil(dear.clamp(1, MOST).min(bands.len()));
    if bundle == 1 { whole } else { cut(bundle, rows.len()) }
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

/// The unit of `bands` and `rows` (window, shard row); `seen` are the tiles of units before it, and then its own as well.
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
        let cols = |window: usize| 0..job.windows[window].count().1;
        let shards = rows
            .iter()
            .flat_map(|&(window, row)| cols(window).map(move |col| ShardId { band, window, row, col }));
        let shards: BTreeSet<ShardId> = shards.collect();
        let tiles = tiles_needed(&plan.tiling, &job.windows, &shards);
        all.tiles_again += tiles.iter().filter(|t| !seen.insert((band, **t))).count();
        all.tiles += tiles.len();
        all.shards += shards.len();
        let sample = job.film.sample.bytes();
        let pixels = |s: &ShardId| job.windows[s.window].shard_rect(s.row, s.col).size().pixels();
        all.bytes_written += (shards.iter().map(pixels).sum::<usize>() * sample) as u64;
        all.bytes_read += cost::bytes_read(job, band, &tiles);
        all.core_s = cost::rounded(all.core_s + cost::core_s(plan, &tiles));
        all.gpu_bytes = all.gpu_bytes.max(cost::gpu_bytes(plan, &tiles));
    }
    let mut ranges = BTreeMap::new();
    for &(window, row) in rows {
        let range = ranges.entry(job.film.outputs[window].name.clone()).or_insert((row, row));
        range.1 = row + 1;
    }
    Unit { unit: number, bands: bands.to_vec(), rows: ranges, cost: all }
}
