//! `lenscube run`: chart → scene → film, and the film's life: created, resumed, finished.

use crate::args::RunArgs;
use crate::failure::{code, other_job, usage};
use crate::job::Job;
use crate::memory::{mib, peak_resident};
use crate::open::Chart;
use crate::progress::{Bars, say, summary_lines};
use anyhow::{Context, Result};
use formats::film::{EncodedShard, FilmError, FilmStore};
use formats::lens::LensPackError;
use pipeline::clock::StageTimes;
use pipeline::executor::{BandWork, Summary, Work, run};
use pipeline::flow::{DoorError, FilmSink};
use pipeline::geometry::Rect;
use pipeline::plan::{ShardId, Window};
use serde_json::{Map, Value, json};
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::SystemTime;

/// Set by the first Ctrl-C or SIGTERM.
static CANCEL: AtomicBool = AtomicBool::new(false);

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
}

/// A band's error: of the lens tables or of the pack.
#[derive(Debug, thiserror::Error)]
enum StageError {
    #[error(transparent)]
    Lens(#[from] pipeline::lens::LensError),
    #[error(transparent)]
    Pack(#[from] LensPackError),
}

/// Runs the command; the exit code.
pub fn command(args: &RunArgs) -> Result<u8> {
    let job = Job::new(args)?;
    keep_chart(&job, &args.film)?;
    let store = open_film(&job, &args.film, args.overwrite, !args.no_fsync)?;
    if args.no_fsync {
        say("--no-fsync: a power cut may cost shards that were reported as written");
    }
    let swept = store.sweep()?;
    if !swept.removed.is_empty() {
        say(format!("removed {} temp files of an interrupted run", swept.removed.len()));
    }
    let wanted = wanted(&job, &store)?;
    let missing: usize = wanted.iter().map(BTreeSet::len).sum();
    let all = shards(&job);
    if missing == 0 {
        say(format!("{} is complete: {all} shards, nothing to do", args.film.display()));
        return Ok(0);
    }
    if missing < all {
        say(format!("resuming {}: {missing} of {all} shards to make", args.film.display()));
    }
    rechunk(&job, &args.film)?;
    tell(&job);
    let _ = ctrlc::set_handler(interrupt);
    let work = Work {
        frame: job.frame,
        windows: &job.windows,
        bands: std::iter::zip(wanted, std::iter::zip(&job.plans, &job.chart_bands))
            .map(|(wanted, (plan, &chart_band))| BandWork { chart_band, tiling: plan.tiling, wanted })
            .collect(),
        threads: job.threads,
        spectra_bytes: job.memory.spectra,
        cancel: &CANCEL,
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
    let bars = Bars::new(names, &pixels(&work));
    let result = run(&work, job.chart.source(), &Sink(&store), &prepare, &bars);
    bars.finish();
    let summary = result.with_context(|| {
        format!(
            "the film {} is incomplete; once the cause is gone, the same command resumes",
            args.film.display()
        )
    })?;
    report(&job, &store, &summary, &held.into_inner().expect("no panic while held"));
    if summary.shards < missing as u64 {
        say(format!(
            "interrupted: {} of {missing} shards are left; the same command resumes",
            missing as u64 - summary.shards
        ));
        return Ok(code::INTERRUPTED);
    }
    Ok(0)
}

/// First signal: let the tiles in flight end. Second: stop at once; shards are whole or absent either way.
fn interrupt() {
    if CANCEL.swap(true, Ordering::SeqCst) {
        std::process::exit(i32::from(code::INTERRUPTED));
    }
    say("stopping: finishing the tiles in flight (again to stop at once)");
}

/// A film may be the chart of the next one, never of itself: `--overwrite` would remove what is to be read.
fn keep_chart(job: &Job, film: &Path) -> Result<()> {
    let Chart::Store(chart) = &job.chart else { return Ok(()) };
    match (chart.path().canonicalize(), film.canonicalize()) {
        (Ok(chart), Ok(there)) if chart.starts_with(&there) => Err(usage(format!(
            "{} holds its own chart, {}; choose another path",
            film.display(),
            chart.display()
        ))),
        _ => Ok(()),
    }
}

/// Creates the film, or opens it to resume if it is this job's own.
fn open_film(job: &Job, path: &Path, overwrite: bool, fsync: bool) -> Result<FilmStore> {
    if overwrite {
        FilmStore::remove_film(path)?;
    }
    match FilmStore::create(path, job.film.clone(), provenance(job), fsync) {
        Err(FilmError::Exists { .. }) => (),
        created => return Ok(created?),
    }
    let store = FilmStore::open(path, fsync).map_err(|e| match e {
        FilmError::NotFilm { .. } => other_job(e.to_string()),
        e => e.into(),
    })?;
    let mut differ = Vec::new();
    let theirs = store.provenance().get("job").and_then(Value::as_object).cloned().unwrap_or_default();
    for key in job.identity.keys().chain(theirs.keys()).collect::<BTreeSet<_>>() {
        let show = |map: &Map<String, Value>| map.get(key).map_or("nothing".into(), Value::to_string);
        let (own, other) = (show(&job.identity), show(&theirs));
        if own != other {
            differ.push(format!("{key} (there {other}, asked {own})"));
        }
    }
    let (own, other) = (&job.film, store.spec());
    if own != other {
        let layout = [
            ("shard", own.shard.to_string(), other.shard.to_string()),
            ("chunk", own.chunk.to_string(), other.chunk.to_string()),
            ("codec", format!("{:?}", own.codec), format!("{:?}", other.codec)),
            ("dtype", format!("{:?}", own.sample), format!("{:?}", other.sample)),
            ("units", own.units.clone(), other.units.clone()),
            ("wavelengths", format!("{:?}", own.wavelengths_nm), format!("{:?}", other.wavelengths_nm)),
        ];
        let changed = layout.into_iter().filter(|(_, own, other)| own != other);
        differ.extend(changed.map(|(key, own, other)| format!("{key} (there {other}, asked {own})")));
        if differ.is_empty() {
            differ.push("its layout".into());
        }
    }
    match differ.is_empty() {
        true => Ok(store),
        false => Err(other_job(format!(
            "{} exists and belongs to another job: {}; choose another path, or start it anew with --overwrite",
            path.display(),
            differ.join(", ")
        ))),
    }
}

/// What the film tells of how it came to be; nothing that differs from run to run.
fn provenance(job: &Job) -> Map<String, Value> {
    let digest = blake3::hash(serde_json::to_string(&job.identity).unwrap_or_default().as_bytes());
    let lens = job.lens.lens();
    let bands: Vec<Value> = job
        .plans
        .iter()
        .map(|p| {
            json!({
                "wavelength_nm": p.lens.wavelength_nm,
                "psf_window_px": p.blocks.map(|b| b.window),
                "fft": p.blocks.map(|b| b.fft),
                "tile_px": p.tiling.tile(),
            })
        })
        .collect();
    let value = json!({
        "program": concat!("lenscube ", env!("CARGO_PKG_VERSION")),
        "job_digest": digest.to_hex().as_str(),
        "job": job.identity,
        "lens": {
            "name": lens.name,
            "f_number": lens.f_number,
            "effective_focal_length_mm": lens.effective_focal_length_mm,
            "distortion_focal_length_mm": lens.distortion_focal_length_mm,
        },
        "bands": bands,
    });
    match value {
        Value::Object(map) => map,
        _ => unreachable!("an object is written above"),
    }
}

/// Shards of the whole job.
fn shards(job: &Job) -> usize {
    let of = |w: &Window| w.count().0 * w.count().1;
    job.plans.len() * job.windows.iter().map(of).sum::<usize>()
}

/// The shards still to make, per band.
fn wanted(job: &Job, store: &FilmStore) -> Result<Vec<BTreeSet<ShardId>>> {
    let mut bands = Vec::new();
    for band in 0..job.plans.len() {
        let mut wanted = BTreeSet::new();
        for (window, w) in job.windows.iter().enumerate() {
            let (rows, cols) = w.count();
            for (row, col) in (0..rows).flat_map(|r| (0..cols).map(move |c| (r, c))) {
                if !store.shard_present(window, band, (row, col))? {
                    wanted.insert(ShardId { band, window, row, col });
                }
            }
        }
        bands.push(wanted);
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
fn rechunk(job: &Job, film: &Path) -> Result<()> {
    if let Chart::Store(store) = &job.chart
        && store.rechunk_needed(&job.chart_bands)
    {
        say(
            "the chart's chunks span several bands: re-chunking them once into a temporary file beside the film",
        );
        let beside = film.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        store.rechunk(&job.chart_bands, beside, job.threads, &|_, _| ())?;
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

/// The summary, on the terminal and in the film's `runs/`.
fn report(job: &Job, store: &FilmStore, summary: &Summary, light_held: &[Option<f64>]) {
    let stats = match &job.chart {
        Chart::Store(s) => Some(s.stats()),
        Chart::Drawn(_) => None,
    };
    let outside = light_held.iter().flatten().map(|held| 1.0 - held);
    let range = outside.fold((1.0f64, 0.0f64), |(a, b), e| (a.min(e), b.max(e)));
    let peak = peak_resident();
    for line in summary_lines(summary, stats.map_or(0, |s| s.bytes_read), peak, range) {
        say(line);
    }
    if let Some(s) = stats {
        if s.missing_pieces > 0 {
            say(format!(
                "note: {} chunks are missing from the chart and were read as its fill value",
                s.missing_pieces
            ));
        }
        if s.nan_replaced > 0 {
            say(format!("note: {} NaN or infinite pixels of the chart were read as 0", s.nan_replaced));
        }
    }
    let seconds = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).map_or(0, |d| d.as_secs());
    let record = json!({
        "finished_unix_s": seconds,
        "program": concat!("lenscube ", env!("CARGO_PKG_VERSION")),
        "threads": job.threads,
        "simd": job.options.simd.isa().name(),
        "memory_limit_bytes": job.memory.limit,
        "peak_resident_bytes": peak,
        "wall_s": summary.wall_s,
        "tiles": summary.tiles,
        "pixels": summary.pixels,
        "shards": summary.shards,
        "bytes_written": summary.bytes_written,
        "bytes_read": stats.map(|s| s.bytes_read),
        "chart_pieces_decoded": stats.map(|s| s.pieces_decoded),
        "spectra_built": summary.spectra,
        "light_in_psf_window": light_held,
        "interrupted": summary.interrupted,
        "thread_s": stage_times(&summary.times),
        "core_s": stage_times(&summary.core),
    });
    let name = format!("runs/{seconds}-{}.json", std::process::id());
    if let Err(e) = store.write_beside(&name, record.to_string().as_bytes()) {
        say(format!("note: the run's record {name} could not be written: {e}"));
    }
}

fn stage_times(t: &StageTimes) -> Value {
    json!({
        "read": t.read_s, "scene": t.scene_s, "svpsf": t.svpsf_s, "add": t.add_s,
        "encode": t.encode_s, "write": t.write_s, "prepare": t.prepare_s,
    })
}
