//! What a run will read and write, its time, memory and disk space, before it starts: `run --dry-run`, and the refusal of a film for which
//! the disk is too small.
//!
//! Bytes are those before compression; their number after it is unknown. A film is refused if its disk lacks [`MIN_WRITTEN_SHARE`] of them.

use super::shards;
use crate::args::RunArgs;
use crate::failure::{Coded, code};
use crate::film;
use crate::job::depth_forecast::DepthForecast;
use crate::job::stages::without_layers;
use crate::job::{Job, UntracedJob, cost};
use crate::machine::free_space;
use crate::progress::{data_size, mib};
use crate::progress::{duration, plural, print as print_line};
use anyhow::Result;
use formats::chart::Codec;
use formats::durable::{Store, link_target};
use formats::film::{FilmSpec, FilmStore};
use pipeline::tiling::ShardId;
use pipeline::tiling::tiles_needed;
use std::collections::BTreeSet;
use std::path::Path;

/// Share of a compressed film's bytes that it needs at least: lz4 leaves 56 % of a chart with 1 % noise.
const MIN_WRITTEN_SHARE: f64 = 0.5;

/// What a run writes, and the disk space for it.
pub struct Forecast<'a> {
    film: &'a Path,
    shards: usize,
    /// Bytes of film written.
    written: u64,
    /// Share of `written` that the disk needs at least.
    min_share: f64,
    /// Bytes of the temporary file beside the film.
    temporary: u64,
    /// Bytes free where the film is written; `None` at a URL.
    free: Option<u64>,
}

impl<'a> Forecast<'a> {
    /// For the shards `missing`, per position of the job.
    ///
    /// # Errors
    /// The free space cannot be determined.
    pub fn new(job: &Job, film: &'a Path, missing: &[BTreeSet<ShardId>]) -> Result<Self> {
        let of = |s: &ShardId| job.regions[s.region].shard_rect(s.row, s.col).size().pixels() as u64;
        let pixels: u64 = missing.iter().flatten().map(of).sum();
        let needed = std::iter::zip(&job.chart_bands, missing).filter(|(_, missing)| !missing.is_empty());
        let bands: Vec<usize> = needed.map(|(band, _)| *band).collect();
        Ok(Self {
            film,
            shards: missing.iter().map(BTreeSet::len).sum(),
            written: pixels * job.film.sample.bytes() as u64,
            min_share: min_share(&job.film),
            temporary: job.chart.temporary_bytes(&bands),
            free: free_space(film)?,
        })
    }

    /// Fails if the disk is too small, unless `force`.
    ///
    /// # Errors
    /// Exit code 75: the same command may succeed once there is space.
    pub fn check_space(&self, force: bool) -> Result<()> {
        let least = (self.written as f64 * self.min_share) as u64 + self.temporary;
        let Some(free) = self.free.filter(|free| least > *free && !force) else { return Ok(()) };
        let temporary = match self.temporary {
            0 => String::new(),
            bytes => format!(" and {} for the chart's bands in a temporary file", data_size(bytes)),
        };
        let message = format!(
            "{}: the disk is too small: the film has {} before compression{temporary}, {} are free; free some space, compute a part \
             (--bands, --roi), or start anyway with --force",
            self.film.display(),
            data_size(self.written),
            data_size(free)
        );
        Err(Coded { code: code::RETRY, message }.into())
    }
}

/// Bytes of chart that the shards `missing` need, before compression, and their core seconds.
fn work(job: &Job, missing: &[BTreeSet<ShardId>]) -> (u64, f64) {
    let with_shards = missing.iter().enumerate().filter(|(_, shards)| !shards.is_empty());
    with_shards.fold((0, 0.0), |(read, core_s), (position, shards)| {
        let plan = &job.plans[position];
        let tiles = tiles_needed(&plan.tiling, &job.regions, shards);
        (
            read + cost::bytes_read(job, position, &tiles),
            core_s + cost::core_s(plan, job.options.stages, &tiles),
        )
    })
}

/// Bytes of chart read before the tiles of bands whose layers of light are not in `store` (`None`: the film is not there yet), their core seconds, and the
/// number of those bands.
///
/// # Errors
/// The store cannot be read.
fn layers(job: &Job, store: Option<&FilmStore>, missing: &[BTreeSet<ShardId>]) -> Result<(u64, f64, usize)> {
    let without = without_layers(job, store)?;
    let bands = std::iter::zip(missing, without).filter(|(shards, without)| *without && !shards.is_empty());
    let (bands, (bytes, core_s)) = (bands.count(), cost::layers(job));
    Ok((bands as u64 * bytes, bands as f64 * core_s, bands))
}

/// Names of the layers.
fn names(job: &Job) -> String {
    job.film.layers.iter().map(|layer| layer.name.as_str()).collect::<Vec<_>>().join(", ")
}

/// Resolves the job of `args`; a film of another job and a disk that is too small for a new film are errors before its lens is traced.
///
/// # Errors
/// Those of the run before its first shard.
pub fn resolved(args: &RunArgs) -> Result<Job> {
    untraced(args)?.traced()
}

/// As [`resolved`], before the lens is traced.
fn untraced(args: &RunArgs) -> Result<UntracedJob<'_>> {
    let job = UntracedJob::new(args)?;
    film::check_before_tracing(&job, args)?;
    if !is_resumed(args)? {
        let (written, temporary) = job.bytes();
        let forecast = Forecast {
            film: &args.film,
            shards: 0,
            written,
            min_share: min_share(&job.film),
            temporary,
            free: free_space(&args.film)?,
        };
        forecast.check_space(args.process.force)?;
    }
    Ok(job)
}

/// Share of the film's bytes that it needs at least.
fn min_share(film: &FilmSpec) -> f64 {
    if film.codec == Codec::None { 1.0 } else { MIN_WRITTEN_SHARE }
}

/// Fails if the disk is too small for a film that is created, before one that it replaces is removed; unless `--force`.
///
/// # Errors
/// As [`Forecast::check_space`].
pub fn check_space_of_new_film(job: &Job, args: &RunArgs) -> Result<()> {
    match is_resumed(args)? {
        // Only the missing shards need space.
        true => Ok(()),
        false => {
            Forecast::new(job, &args.film, &shards::requested(job, None))?.check_space(args.process.force)
        }
    }
}

/// Whether a film is there and remains.
fn is_resumed(args: &RunArgs) -> Result<bool> {
    Ok(!args.process.overwrite && Store::at(&link_target(&args.film))?.exists()?)
}

/// Prints the forecast of a film of surfaces at several distances, without the trace of its lens.
fn print_untraced(job: &UntracedJob<'_>, depth: &DepthForecast, args: &RunArgs) -> Result<()> {
    let (written, temporary) = job.bytes();
    print_line(format!("lens    {}: {}", job.lens_name(), depth.trace_text()));
    print_line(format!("writes  {}: at most {} before compression", args.film.display(), data_size(written)));
    if temporary > 0 {
        print_line(format!(
            "        {} in a temporary file beside the film, sorted by band",
            data_size(temporary)
        ));
    }
    if let Some(free) = free_space(&args.film)? {
        print_line(format!("disk    {} free", data_size(free)));
    }
    print_line(format!(
        "time    about {} for the film on {} threads at the speed of a 2.2 GHz core with AVX-512",
        duration(depth.film_core_s / job.threads() as f64),
        job.threads()
    ));
    print_line(format!("memory  {}", depth.memory_text()));
    Ok(())
}

/// Prints the forecast of the run of `args`; nothing is written, except the cache of traced lenses.
///
/// # Errors
/// Those of the run before its first shard; the disk is too small.
pub fn print(args: &RunArgs) -> Result<()> {
    let untraced = untraced(args)?;
    if let Some(depth) = untraced.depth_forecast()? {
        return print_untraced(&untraced, &depth, args);
    }
    let job = untraced.traced()?;
    // Fails if a film of another job is there.
    film::expected_provenance(&job, args)?;
    let requested = shards::requested(&job, None);
    let all: usize = requested.iter().map(BTreeSet::len).sum();
    let store = if is_resumed(args)? { Some(film::open_store(args, "")?) } else { None };
    let missing = match &store {
        Some(store) => shards::missing(&job, store, &requested)?,
        None => requested,
    };
    let forecast = Forecast::new(&job, &args.film, &missing)?;
    let (read, core_s) = work(&job, &missing);
    let (read_before, layers_s, bands) = layers(&job, store.as_ref(), &missing)?;
    print_line(format!(
        "lens    {}: {}, engine {}",
        job.lens.lens().name,
        plural(job.plans.len(), "band"),
        job.engine
    ));
    print_line(format!("chart   {}", job.coverage));
    print_line(format!("reads   {} of the chart before compression", data_size(read)));
    if bands > 0 {
        print_line(format!(
            "        {} before the tiles, of {}, for light that spreads far ({})",
            data_size(read_before),
            plural(bands, "band"),
            names(&job)
        ));
    }
    if forecast.temporary > 0 {
        print_line(format!(
            "        {} in a temporary file beside the film, sorted by band",
            data_size(forecast.temporary)
        ));
    }
    print_line(format!(
        "writes  {}: {} of {all} shards, film of {} px, at most {} before compression",
        args.film.display(),
        forecast.shards,
        job.frame.film,
        data_size(forecast.written)
    ));
    if let Some(free) = forecast.free {
        print_line(format!("disk    {} free", data_size(free)));
    }
    print_line(format!(
        "time    about {} on {} threads at the speed of a 2.2 GHz core with AVX-512 (`lenscube bench` measures this machine's)",
        duration((core_s + layers_s) / job.threads as f64),
        job.threads
    ));
    print_line(format!("memory  {} of at most {}", mib(job.memory.planned), mib(job.memory.limit)));
    for note in &job.notes {
        print_line(format!("note    {note}"));
    }
    forecast.check_space(args.process.force)
}
