//! `lenscube run`: chart → scene → film, and the film's life: created, resumed, finished.

mod faults;
pub mod film;
mod interrupt;
mod record;

use crate::args::RunArgs;
use crate::failure::code;
use crate::job::Job;
use crate::memory::mib;
use crate::open::Chart;
use crate::progress::{Bars, say};
use anyhow::Result;
use faults::{Failed, Follow};
use formats::durable::{is_url, parent_of};
use formats::film::{EncodedShard, FilmStore};
use formats::lens::LensPackError;
use pipeline::executor::{BandWork, Work, run};
use pipeline::flow::{DoorError, FilmSink};
use pipeline::geometry::Rect;
use pipeline::plan::{ShardId, Window};
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Mutex;

/// The film as the pipeline's sink.
struct Sink<'a>(&'a FilmStore);

impl FilmSink for Sink<'_> {
    type Encoded = EncodedShard;

    fn encode(&self, id: ShardId, _rect: Rect, pixels: &[f32]) -> Result<EncodedShard, DoorError> {
        Ok(self.0.encode_shard(id.window, id.band, (id.row, id.col), pixels)?)
    }

    fn commit(&self, encoded: EncodedShard) -> Result<u64, DoorError> {
        self.0.commit(&encoded)?;
        Ok(encoded.bytes().len() as u64)
    }

    fn writers(&self) -> usize {
        FilmStore::writers(self.0.path())
    }
}

/// A band's error: of the lens tables or of the pack.
#[derive(Debug, thiserror::Error)]
enum StageError {
    #[error(transparent)]
    Lens(#[from] pipeline::lens::LensError),
    #[error(transparent)]
    Pack(#[from] LensPackError),
}

/// The unit of work that a run without units does; its lock has this name.
pub const WHOLE: &str = "whole";

/// Runs the command; the exit code.
pub fn command(args: &RunArgs) -> Result<u8> {
    let mut job = Job::new(args)?;
    film::keep_apart(&job, &args.film)?;
    interrupt::listen();
    let store = film::open(&job, args)?;
    let all = shards(&job);
    if wanted(&job, &store)?.iter().all(BTreeSet::is_empty) {
        // Leavings of a run that was killed after its last shard; a film that nobody may write to is complete as well.
        let _ = (store.lock(WHOLE, false), store.sweep());
        say(format!("{} is complete: {all} shards, nothing to do", args.film.display()));
        return Ok(0);
    }
    let lock = store.lock(WHOLE, args.take_over)?;
    if let Some(lock) = &lock {
        interrupt::release_on_exit(lock.path());
    }
    if args.no_fsync {
        say("--no-fsync: a power cut may cost shards that were reported as written");
    }
    let swept = store.sweep()?;
    if !swept.removed.is_empty() {
        say(format!("removed {} temp files of an interrupted run", swept.removed.len()));
    }
    let wanted = wanted(&job, &store)?;
    let missing: usize = wanted.iter().map(BTreeSet::len).sum();
    if missing < all {
        say(format!("resuming {}: {missing} of {all} shards to make", args.film.display()));
    }
    rechunk(&mut job, &args.film, &wanted)?;
    tell(&job);
    let work = Work {
        frame: job.frame,
        windows: &job.windows,
        bands: std::iter::zip(wanted, std::iter::zip(&job.plans, &job.chart_bands))
            .map(|(wanted, (plan, &chart_band))| BandWork { chart_band, tiling: plan.tiling, wanted })
            .collect(),
        threads: job.threads,
        spectra_bytes: job.memory.spectra,
        cancel: interrupt::finish_tiles(),
    };
    let held = Mutex::new(vec![None; job.plans.len()]);
    let prepare = |i: usize| {
        let plan = &job.plans[i];
        let stack = |band: usize| Ok::<_, StageError>(job.lens.psf(band)?);
        let stages =
            plan.stages(i, &job.frame, &job.options, job.gains[i], stack).map_err(DoorError::from)?;
        if let Some(psf) = &stages.psf {
            let of_all =
                plan.lens.psf_energy.iter().zip(psf.kernels().energy()).map(|(pack, crop)| pack * crop);
            let mean = of_all.sum::<f64>() / plan.lens.psf_energy.len() as f64;
            held.lock().expect("no panic while held")[i] = Some(mean);
        }
        Ok(stages)
    };
    let names = job.plans.iter().map(|p| format!("{} nm", p.lens.wavelength_nm)).collect();
    let follow = Follow::new(Bars::new(names, &pixels(&work)), args.keep_going);
    let result = run(&work, job.chart.source(), &Sink(&store), &prepare, &follow);
    follow.bars.finish();
    let outcome = follow.outcome(&job, &store, missing as u64, result);
    let outcome = outcome.and_then(|summary| match film::same_chart(&job) {
        Ok(()) => Ok(summary),
        Err(error) => Err(Box::new(Failed { error, summary: Some(summary) })),
    });
    record::write(&job, &store, &follow, &outcome, &held.into_inner().expect("no panic while held"));
    let summary = outcome.map_err(|e| e.error)?;
    if summary.shards < missing as u64 {
        say(format!(
            "interrupted: {} of {missing} shards are left; the same command resumes",
            missing as u64 - summary.shards
        ));
        return Ok(code::INTERRUPTED);
    }
    Ok(0)
}

/// Shards of the whole job.
fn shards(job: &Job) -> usize {
    let of = |w: &Window| w.count().0 * w.count().1;
    job.plans.len() * job.windows.iter().map(of).sum::<usize>()
}

/// The shards still to make, per band.
fn wanted(job: &Job, store: &FilmStore) -> Result<Vec<BTreeSet<ShardId>>> {
    let mut bands = vec![BTreeSet::new(); job.plans.len()];
    let all: Vec<_> = store.every_shard().collect();
    for (&(window, band, (row, col)), there) in std::iter::zip(&all, store.shards_bytes(&all)?) {
        if there.is_none() {
            bands[band].insert(ShardId { band, window, row, col });
        }
    }
    Ok(bands)
}

/// Film pixels of the tiles to make, per band.
fn pixels(work: &Work<'_>) -> Vec<u64> {
    let film = work.frame.film.rect();
    let of = |b: &BandWork| {
        let tiles = pipeline::overlap_add::tiles_needed(&b.tiling, work.windows, &b.wanted);
        tiles.iter().map(|&t| b.tiling.rect(t).intersect(film).size().pixels() as u64).sum()
    };
    work.bands.iter().map(of).collect()
}

/// A chart whose chunks span bands is cut into bands once, beside the film, rather than decoded once per band.
fn rechunk(job: &mut Job, film: &Path, wanted: &[BTreeSet<ShardId>]) -> Result<()> {
    let open = std::iter::zip(&job.chart_bands, wanted).filter(|(_, wanted)| !wanted.is_empty());
    let bands: Vec<usize> = open.map(|(band, _)| *band).collect();
    let temp = std::env::temp_dir();
    let beside = if is_url(film) { &temp } else { parent_of(film) };
    if let Chart::Raster(raster) = &mut job.chart
        && bands.len() > 1
        && raster.must_be_laid_out()
    {
        let place = beside.display();
        say(format!("the chart's bands interleave: laying them out once in a temporary file in {place}"));
        raster.in_bands(&bands, beside, &|_, _| ())?;
    }
    if let Chart::Store(store) = &job.chart
        && store.rechunk_needed(&bands)
    {
        let place = beside.display();
        say(format!(
            "the chart's chunks span several bands: re-chunking them once into a temporary file in {place}"
        ));
        store.rechunk(&bands, beside, job.threads, &|_, _| ())?;
    }
    Ok(())
}

fn tell(job: &Job) {
    let f = &job.frame;
    say(format!(
        "{}: {} bands, film {} px of {} µm, {} shards; {} threads of {}, memory {} (chart {}, spectra {})",
        job.lens.lens().name,
        job.plans.len(),
        f.film,
        f.pitch_um,
        shards(job),
        job.threads,
        job.options.simd.isa().name(),
        mib(job.memory.limit),
        mib(job.memory.chart_cache),
        mib(job.memory.spectra),
    ));
    for note in &job.notes {
        say(format!("note: {note}"));
    }
}
