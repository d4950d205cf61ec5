//! The film of a job: created, or opened to go on if it is this job's own; what it tells of how it came to be.

use crate::args::RunArgs;
use crate::failure::{other_job, usage};
use crate::job::Job;
use crate::open::Chart;
use anyhow::{Result, bail};
use formats::durable::{Lock, Store, fault_point, is_url, link_target, parent_of, sweep_entries};
use formats::film::{FilmError, FilmSpec, FilmStore};
use serde_json::{Map, Value, json};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// BLAKE3 of a JSON value as it is written, in 64 hexadecimal digits.
pub fn digest(value: &Value) -> String {
    blake3::hash(value.to_string().as_bytes()).to_hex().to_string()
}

/// What changes the film's files and not its pixels.
pub fn layout(spec: &FilmSpec) -> Value {
    json!({ "dtype": spec.sample, "shard": spec.shard, "chunk": spec.chunk, "codec": spec.codec })
}

/// A film may be the chart of the next one, never of itself: `--overwrite` would remove what is to be read. Nor does it lie inside
/// its chart or its lens pack, whose files it would change.
pub fn keep_apart(job: &Job, film: &Path) -> Result<()> {
    if let Chart::Store(chart) = &job.chart {
        apart_from_chart(film, chart.path())?;
    }
    match job.lens.pack() {
        // One that lies inside the film is read, and refuses `--overwrite` as any file does that the film did not make.
        Some(pack) if !is_url(film) && real(parent_of(film)).starts_with(real(pack.path())) => {
            Err(apart("lies inside", film, "lens pack", pack.path()))
        }
        _ => Ok(()),
    }
}

fn apart_from_chart(film: &Path, chart: &Path) -> Result<()> {
    let error = |words: &str| Err(apart(words, film, "chart", chart));
    if is_url(film) {
        // A URL has no other name.
        return match (chart.starts_with(film), film.starts_with(chart)) {
            (true, _) => error("holds"),
            (_, true) => error("lies inside"),
            _ => Ok(()),
        };
    }
    let Ok(there) = chart.canonicalize() else { return Ok(()) };
    match film.canonicalize() {
        Ok(real) if there.starts_with(&real) => error("holds"),
        _ if real(film).starts_with(&there) => error("lies inside"),
        _ => Ok(()),
    }
}

fn apart(words: &str, film: &Path, what: &str, input: &Path) -> anyhow::Error {
    let (film, input) = (film.display(), input.display());
    usage(format!("{film} {words} its own {what}, {input}; choose another path"))
}

/// The path with all links of its existing part resolved.
pub fn real(path: &Path) -> PathBuf {
    let parent = parent_of(path);
    match (path.canonicalize(), path.file_name()) {
        (Ok(real), _) => real,
        (Err(_), Some(name)) if parent != path => real(parent).join(name),
        _ => path.into(),
    }
}

/// Creates the film, or opens it to resume if it is this job's own.
pub fn open(job: &Job, args: &RunArgs) -> Result<FilmStore> {
    let (path, fsync) = (args.film.as_path(), !args.no_fsync);
    if args.overwrite {
        remove(path, args.take_over)?;
        fault_point("film-removed");
    }
    match FilmStore::create(path, job.film.clone(), provenance(job), fsync) {
        Err(FilmError::Exists { .. }) => (),
        created => return Ok(created?),
    }
    // What a killed creation or removal left beside it.
    sweep_entries(parent_of(&link_target(path)))?;
    resumed(job, args)
}

/// What the film of a job says of itself, or will say once it is created; nothing is changed.
///
/// # Errors
/// As [`open`] of a film that is there.
pub fn provenance_of(job: &Job, args: &RunArgs) -> Result<Map<String, Value>> {
    if args.overwrite || !Store::at(&link_target(&args.film))?.exists()? {
        return Ok(provenance(job));
    }
    Ok(resumed(job, args)?.provenance().clone())
}

/// Opens the film if it is this job's own.
fn resumed(job: &Job, args: &RunArgs) -> Result<FilmStore> {
    let store = FilmStore::open(&args.film, !args.no_fsync).map_err(|e| match e {
        FilmError::NotFilm { .. } => other_job(e.to_string()),
        e => e.into(),
    })?;
    same_job(&store, job, args)?;
    Ok(store)
}

/// Fails if the film is another job's.
fn same_job(store: &FilmStore, job: &Job, args: &RunArgs) -> Result<()> {
    let theirs = store.provenance().get("job").and_then(Value::as_object).cloned().unwrap_or_default();
    let differ = [differences(&theirs, &job.identity), layout_differences(store.spec(), &job.film)].concat();
    let trusted = |key: &&str| args.trust_input && *key == "chart_mtimes";
    let keys: Vec<&str> = differ.iter().map(|d| d.0.as_str()).filter(|k| !trusted(k)).collect();
    if keys.is_empty() {
        return Ok(());
    }
    let way_out = match keys[..] {
        ["chart_mtimes"] => {
            "files of the chart have the names and sizes they had, but were touched since; if their pixels are the same, go \
             on with --trust-input, else start it anew with --overwrite"
        }
        _ => "choose another path, or start it anew with --overwrite",
    };
    let words: Vec<String> =
        differ.iter().map(|(key, there, asked)| format!("{key} (there {there}, asked {asked})")).collect();
    Err(other_job(format!(
        "{} exists and belongs to another job: {}; {way_out}",
        store.path().display(),
        words.join(", ")
    )))
}

/// What differs between a planned job and layout and those at hand; nothing if they are the same.
pub fn not_planned(
    (job, layout): (&Map<String, Value>, &Value),
    (own_job, own_layout): (&Map<String, Value>, &Value),
    args: &RunArgs,
) -> Option<String> {
    let mut differ = differences(job, own_job);
    if let (Some(theirs), Some(own)) = (layout.as_object(), own_layout.as_object()) {
        differ.extend(differences(theirs, own));
    }
    differ.retain(|d| !(args.trust_input && d.0 == "chart_mtimes"));
    let hint =
        |key: &str| if key == "chart_mtimes" { ": if its pixels are the same, --trust-input" } else { "" };
    let words = differ
        .iter()
        .map(|(key, planned, here)| format!("{key} (planned {planned}, here {here}){}", hint(key)));
    Some(words.collect::<Vec<_>>().join(", ")).filter(|words| !words.is_empty())
}

/// Removes the film, unless a run is at work on it.
fn remove(path: &Path, take_over: bool) -> Result<()> {
    let _held = match FilmStore::locks(path)?.is_empty() {
        true => Vec::new(),
        false => lock_all(path, take_over)?,
    };
    Ok(FilmStore::remove_film(path)?)
}

/// Takes the lock of every unit that any run has locked, and that of the whole film.
pub fn lock_all(path: &Path, take_over: bool) -> Result<Vec<Lock>> {
    let mut units: BTreeSet<String> = [super::WHOLE.to_owned()].into();
    for (lock, _, _) in FilmStore::locks(path)? {
        units.extend(lock.file_stem().map(|s| s.to_string_lossy().into_owned()));
    }
    let store = Store::at(path)?;
    let locks = units.iter().filter_map(|unit| store.lock("runs", unit, take_over).transpose());
    Ok(locks.collect::<Result<_, _>>()?)
}

type Difference = (String, String, String);

/// Words of the job that differ: key, there, asked.
fn differences(theirs: &Map<String, Value>, own: &Map<String, Value>) -> Vec<Difference> {
    let show = |map: &Map<String, Value>, key: &String| match map.get(key) {
        None => "nothing".to_owned(),
        // Enough of a digest to tell it from another; a lens's name may be as long.
        Some(Value::String(s)) if s.len() == 64 && s.bytes().all(|b| b.is_ascii_hexdigit()) => {
            format!("{}…", &s[..12])
        }
        Some(v) => v.to_string(),
    };
    let keys: BTreeSet<&String> = own.keys().chain(theirs.keys()).collect();
    let differ = keys.into_iter().filter(|k| own.get(*k) != theirs.get(*k));
    differ.map(|k| (k.clone(), show(theirs, k), show(own, k))).collect()
}

/// As [`differences`], of the layout and what else describes the film.
fn layout_differences(other: &FilmSpec, own: &FilmSpec) -> Vec<Difference> {
    if own == other {
        return Vec::new();
    }
    let all = [
        ("shard", other.shard.to_string(), own.shard.to_string()),
        ("chunk", other.chunk.to_string(), own.chunk.to_string()),
        ("codec", format!("{:?}", other.codec), format!("{:?}", own.codec)),
        ("dtype", format!("{:?}", other.sample), format!("{:?}", own.sample)),
        ("units", other.units.clone(), own.units.clone()),
        ("wavelengths", format!("{:?}", other.wavelengths_nm), format!("{:?}", own.wavelengths_nm)),
    ];
    let mut differ: Vec<Difference> =
        all.into_iter().filter(|d| d.1 != d.2).map(|(k, there, asked)| (k.into(), there, asked)).collect();
    if differ.is_empty() {
        differ.push(("outputs".into(), format!("{:?}", other.outputs), format!("{:?}", own.outputs)));
    }
    differ
}

/// Fails if the chart is not what it was when the job began: some shards may be of one chart, some of another.
pub fn same_chart(job: &Job) -> Result<()> {
    let (content, mtimes) = job.chart.identity()?;
    if job.identity.get("chart") != Some(&content) || job.identity.get("chart_mtimes") != Some(&mtimes) {
        bail!(
            "the chart changed while it was read, so the film may be of both; let the chart rest, then start anew with \
             --overwrite"
        );
    }
    Ok(())
}

/// What the film tells of how it came to be; nothing that differs from run to run.
fn provenance(job: &Job) -> Map<String, Value> {
    let identity = Value::Object(job.identity.clone());
    let layout = layout(&job.film);
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
        "job_digest": digest(&identity),
        "job": identity,
        "layout_digest": digest(&layout),
        "layout": layout,
        "engine": job.engine.to_string(),
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
