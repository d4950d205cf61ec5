//! The film of a job: created, or opened to be resumed if it belongs to the same job; its provenance attributes; its locks.

pub mod group;
pub mod plane;
pub mod record;
pub mod reported;

use crate::args::RunArgs;
use crate::failure::other_job;
use crate::job::{Contents, DIGEST, GHOSTS, Job, MTIMES, SAMPLE, UntracedJob, argument, contents};
use crate::progress::log_line;
use anyhow::{Result, bail};
use formats::durable::{Lock, Store, fault_point, link_target, parent_of, sweep_entries};
use formats::film::{FilmSpec, FilmStore};
use formats::group::{GroupError, JobGroup};
use formats::object;
use pipeline::stages::DESCRIPTIONS;
use serde_json::{Map, Value, json};
use std::collections::BTreeSet;
use std::path::Path;

/// Key of the stages in the identity of a job.
const STAGES: &str = "stages";

/// A value of the identity that is longer is shown by its digest.
const MAX_SHOWN_BYTES: usize = 240;

/// BLAKE3 of a JSON value as it is written, 64 hexadecimal digits.
pub fn digest(value: &Value) -> String {
    blake3::hash(value.to_string().as_bytes()).to_hex().to_string()
}

/// What changes the film's files and not its pixels, for the layout digest.
pub fn layout(spec: &FilmSpec) -> Value {
    json!({ "dtype": spec.sample, "shard": spec.shard, "chunk": spec.chunk, "codec": spec.codec })
}

/// Creates the film, or opens it to be resumed.
///
/// # Errors
/// It belongs to another job (exit code 3); the store.
pub fn open(job: &Job, args: &RunArgs) -> Result<FilmStore> {
    let (path, fsync) = (args.film.as_path(), !args.no_fsync);
    if args.process.overwrite {
        remove(path, args.process.take_over)?;
        fault_point("film-removed");
    }
    match FilmStore::create(path, job.film.clone(), provenance(job), fsync) {
        Err(GroupError::Exists { .. }) => (),
        created => return Ok(created?),
    }
    // Temporary entries of a creation or removal that was killed.
    sweep_entries(parent_of(&link_target(path)))?;
    let store = open_store(args, "")?;
    let same = check_same_job(&store, &job.identity, &job.film, args);
    if same.is_err() && has_only_failed_runs(&store)? {
        log_line(format!(
            "note: {} was begun for another job and has no shard yet: it begins again",
            path.display()
        ));
        remove(path, args.process.take_over)?;
        return Ok(FilmStore::create(path, job.film.clone(), provenance(job), fsync)?);
    }
    same.map(|()| store)
}

/// Whether runs began the film, not units of a plan, and none of its shards is there: then nothing is lost if another job replaces it.
fn has_only_failed_runs(store: &FilmStore) -> Result<bool> {
    let runs = store.group().runs()?;
    let is_run = |run: &Map<String, Value>| run.get("units").is_none_or(Value::is_null);
    if runs.is_empty() || !runs.iter().all(is_run) {
        return Ok(false);
    }
    let all: Vec<_> = store.all_shards().collect();
    Ok(store.shards_bytes(&all)?.iter().all(Option::is_none))
}

/// Provenance of the film of a job, or what it will be once the film is created; nothing is changed.
///
/// # Errors
/// As [`open`] of an existing film.
pub fn expected_provenance(job: &Job, args: &RunArgs) -> Result<Map<String, Value>> {
    if args.process.overwrite || !Store::at(&link_target(&args.film))?.exists()? {
        return Ok(provenance(job));
    }
    let store = open_store(args, "")?;
    match check_same_job(&store, &job.identity, &job.film, args) {
        Err(_) if has_only_failed_runs(&store)? => Ok(provenance(job)),
        same => same.map(|()| store.provenance().clone()),
    }
}

/// Opens the film of `args`; `hint` is added to the error if there is none.
///
/// # Errors
/// Not a film (exit code 3); the store.
pub fn open_store(args: &RunArgs, hint: &str) -> Result<FilmStore> {
    FilmStore::open(&args.film, !args.no_fsync).map_err(|e| match e {
        GroupError::NotOfKind { .. } => other_job(format!("{e}{hint}")),
        e => e.into(),
    })
}

/// Fails if the film cannot lie there, or a film of another job is there, before the lens of `job` is traced: then all is compared but the lens, and the content of a chart that is
/// identified by it.
///
/// # Errors
/// As [`open`] of an existing film.
pub fn check_before_tracing(job: &UntracedJob<'_>, args: &RunArgs) -> Result<()> {
    if !job.is_design() || args.process.overwrite || !Store::at(&link_target(&args.film))?.exists()? {
        return Ok(());
    }
    let store = open_store(args, "")?;
    let identity = job.identity_with_lens_of(&recorded_job(&store))?;
    let same_lens = || match store.provenance().get("source").and_then(|source| job.lens_difference(source)) {
        None => Ok(()),
        Some(difference) => Err(other_job(format!(
            "{} exists and belongs to another job, with another lens: {difference}; choose another path, or start again with --overwrite",
            store.path().display()
        ))),
    };
    match check_same_job(&store, &identity, &job.film, args).and_then(|()| same_lens()) {
        Err(_) if has_only_failed_runs(&store)? => Ok(()),
        same => same,
    }
}

/// The identity that a film records.
fn recorded_job(store: &FilmStore) -> Map<String, Value> {
    store.provenance().get("job").and_then(Value::as_object).cloned().unwrap_or_default()
}

/// Fails if the film belongs to another job than that of `identity` with the layout `film`.
fn check_same_job(
    store: &FilmStore,
    identity: &Map<String, Value>,
    film: &FilmSpec,
    args: &RunArgs,
) -> Result<()> {
    let recorded = recorded_job(store);
    let mut differing = differences(&recorded, identity);
    // A stage with flags of its own is named by these.
    differing.retain(|(key, ..)| key != STAGES || switches(&recorded) != switches(identity));
    // Bands that are integrated have no tails.
    if differing.iter().any(|(key, ..)| key == "band_samples") {
        differing.retain(|(key, ..)| key != "tails");
    }
    differing.extend(layout_differences(store.spec(), film));
    retain_files(&mut differing, identity);
    let is_trustable = trustable(&differing, &recorded);
    let trusted = |key: &&str| args.trust_input && is_trustable(key);
    let keys: Vec<&str> = differing.iter().map(|d| d.0.as_str()).filter(|k| !trusted(k)).collect();
    if keys.is_empty() {
        return Ok(());
    }
    let remedy = match keys[..] {
        _ if args.process.overwrite => group::MADE_MEANWHILE,
        _ if keys.iter().all(|k| is_trustable(k)) && keys.contains(&DIGEST) => {
            "the film was created without --check-input, so the content of its chart is not recorded; if its pixels are the same, \
             continue with --trust-input, else start again with --overwrite"
        }
        [MTIMES] => {
            "files of the chart have the same names and sizes but new modification times; if their pixels are the same, continue \
             with --trust-input, else start again with --overwrite"
        }
        [MTIMES, SAMPLE] | [SAMPLE, MTIMES] => {
            "files of the chart have the same names and sizes but other bytes and new modification times; if they were repaired, continue \
             with --trust-input, else start again with --overwrite"
        }
        _ => "choose another path, or start again with --overwrite",
    };
    let list: Vec<String> = differing
        .iter()
        .map(|(key, film, requested)| format!("{} (film {film}, requested {requested})", argument(key)))
        .collect();
    Err(other_job(format!(
        "{} exists and belongs to another job: {}; {remedy}",
        store.path().display(),
        list.join(", ")
    )))
}

/// The stages of an identity that `--stages` switches.
fn switches(identity: &Map<String, Value>) -> Map<String, Value> {
    let mut stages = identity.get(STAGES).and_then(Value::as_object).cloned().unwrap_or_default();
    stages.retain(|name, _| DESCRIPTIONS.iter().all(|d| d.name != name || d.flags.is_empty()));
    stages
}

/// Leaves out the sample of the chart's bytes where all of them are requested.
fn retain_files(differing: &mut Vec<Difference>, requested: &Map<String, Value>) {
    if requested.contains_key(DIGEST) {
        differing.retain(|(key, ..)| key != SAMPLE);
    }
}

/// Whether `--trust-input` accepts that a key differs, of those of `differing`: modification times; with them a sample of the bytes, of files that were repaired; a
/// content that the film, created without `--check-input`, does not record.
fn trustable(differing: &[Difference], recorded: &Map<String, Value>) -> impl Fn(&str) -> bool + use<> {
    let has_other_times = differing.iter().any(|(key, ..)| key == MTIMES);
    let has_digest = recorded.contains_key(DIGEST);
    move |key| key == MTIMES || (key == SAMPLE && has_other_times) || (key == DIGEST && !has_digest)
}

/// Differences between the planned identity and layout and those found; `None` if there are none.
pub fn differences_from_plan(
    (planned, planned_layout): (&Map<String, Value>, &Value),
    (found, found_layout): (&Map<String, Value>, &Value),
    args: &RunArgs,
) -> Option<String> {
    let mut differing = differences(planned, found);
    if let (Some(planned), Some(found)) = (planned_layout.as_object(), found_layout.as_object()) {
        differing.extend(differences(planned, found));
    }
    retain_files(&mut differing, found);
    let is_trustable = trustable(&differing, planned);
    differing.retain(|d| !(args.trust_input && is_trustable(&d.0)));
    let hint = |key: &str| match is_trustable(key) {
        true => ": if its pixels are the same, --trust-input",
        false => "",
    };
    let list = differing
        .iter()
        .map(|(key, planned, found)| format!("{key} (planned {planned}, found {found}){}", hint(key)));
    Some(list.collect::<Vec<_>>().join(", ")).filter(|list| !list.is_empty())
}

/// Removes the film, unless a run holds a lock on it.
pub fn remove(path: &Path, take_over: bool) -> Result<()> {
    let _locks = match JobGroup::locks(path)?.is_empty() {
        true => Vec::new(),
        false => lock_all(path, take_over)?,
    };
    Ok(FilmStore::remove(path)?)
}

/// Locks every unit that any run has locked, and the complete film.
pub fn lock_all(path: &Path, take_over: bool) -> Result<Vec<Lock>> {
    let mut units: BTreeSet<String> = [JobGroup::WHOLE.to_owned()].into();
    for (lock, _, _) in JobGroup::locks(path)? {
        units.extend(lock.file_stem().map(|s| s.to_string_lossy().into_owned()));
    }
    let store = Store::at(path)?;
    let locks = units.iter().filter_map(|unit| store.lock("runs", unit, take_over).transpose());
    Ok(locks.collect::<Result<_, _>>()?)
}

/// Key, recorded value, requested value.
pub type Difference = (String, String, String);

/// Keys that differ.
pub fn differences(recorded: &Map<String, Value>, requested: &Map<String, Value>) -> Vec<Difference> {
    let show = |map: &Map<String, Value>, key: &String| match map.get(key) {
        None => "nothing".to_owned(),
        // Digests are shortened; the length alone is not enough, a lens's name may be as long.
        Some(Value::String(s)) if s.len() == 64 && s.bytes().all(|b| b.is_ascii_hexdigit()) => {
            format!("{}…", &s[..12])
        }
        Some(v) => {
            let text = v.to_string();
            // Of a scene: all spectra, and the states of many files.
            if text.len() > MAX_SHOWN_BYTES { format!("of digest {}…", &digest(v)[..12]) } else { text }
        }
    };
    let keys: BTreeSet<&String> = requested.keys().chain(recorded.keys()).collect();
    let differing = keys.into_iter().filter(|k| requested.get(*k) != recorded.get(*k));
    let of_key = |k: &String| match (k.as_str(), recorded.get(k), requested.get(k)) {
        // Ghosts have flags of their own.
        (GHOSTS, Some(Value::Object(a)), Some(Value::Object(b))) => {
            differences(a, b).into_iter().map(|(part, a, b)| (format!("{GHOSTS}.{part}"), a, b)).collect()
        }
        _ => vec![(k.clone(), show(recorded, k), show(requested, k))],
    };
    differing.flat_map(of_key).collect()
}

/// `recorded` with what is part of the identity from `requested`.
fn recorded_with_identity(recorded: &FilmSpec, requested: &FilmSpec) -> FilmSpec {
    let FilmSpec { keep_bits, has_invented, .. } = *requested;
    FilmSpec { keep_bits, has_invented, layers: requested.layers.clone(), ..recorded.clone() }
}

/// As [`differences`], of layout, units and wavelengths.
fn layout_differences(recorded: &FilmSpec, requested: &FilmSpec) -> Vec<Difference> {
    if *requested == recorded_with_identity(recorded, requested) {
        return Vec::new();
    }
    // As on the command line: lz4, f32.
    let name = |variant: String| variant.to_lowercase();
    let all = [
        ("shard", recorded.shard.to_string(), requested.shard.to_string()),
        ("chunk", recorded.chunk.to_string(), requested.chunk.to_string()),
        ("codec", name(format!("{:?}", recorded.codec)), name(format!("{:?}", requested.codec))),
        ("dtype", name(format!("{:?}", recorded.sample)), name(format!("{:?}", requested.sample))),
        ("units", recorded.units.clone(), requested.units.clone()),
        ("wavelengths", format!("{:?}", recorded.wavelengths_nm), format!("{:?}", requested.wavelengths_nm)),
    ];
    let differing = all.into_iter().filter(|d| d.1 != d.2);
    let mut differing: Vec<Difference> = differing.map(|(key, a, b)| (key.into(), a, b)).collect();
    if differing.is_empty() {
        let outputs = |spec: &FilmSpec| {
            spec.outputs.iter().map(|o| format!("{} of {}", o.name, o.rect)).collect::<Vec<_>>().join("; ")
        };
        // Size, pitch and axis of the film belong to the identity, which names them.
        if outputs(recorded) != outputs(requested) {
            differing.push(("outputs".into(), outputs(recorded), outputs(requested)));
        }
    }
    differing
}

/// Fails if the chart changed since the job was resolved: shards may then be of different charts.
pub fn check_chart_unchanged(job: &Job) -> Result<()> {
    let by_content = job.identity.contains_key(DIGEST);
    let Contents { content, files, surfaces } = contents(&job.chart, job.depth.as_ref(), by_content)?;
    let found = [("chart", Some(content)), (files.0, Some(files.1)), ("depth", surfaces)];
    if found.iter().any(|(key, value)| job.identity.get(*key) != value.as_ref()) {
        bail!(
            "the chart changed during the run, so the film may be of both versions; leave the chart unchanged and start again with \
             --overwrite"
        );
    }
    Ok(())
}

/// Provenance attributes of the film: nothing that differs from run to run.
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
                "transmission": p.lens.transmission,
                "solid_angle_sr": p.lens.solid_angle_sr,
                "psf_window_px": p.blocks.map(|b| b.window),
                "fft": p.blocks.map(|b| b.fft),
                "tile_px": p.tiling.tile(),
            })
        })
        .collect();
    let mut map = object! {
        "program": concat!("lenscube ", env!("CARGO_PKG_VERSION")),
        "job_digest": digest(&identity),
        "job": identity,
        "source": job.source,
        "layout_digest": digest(&layout),
        "layout": layout,
        "engine": job.engine.to_string(),
        "lens": json!({
            "name": lens.name,
            "f_number": lens.f_number,
            "effective_focal_length_mm": lens.effective_focal_length_mm,
            "distortion_focal_length_mm": lens.distortion_focal_length_mm,
        }),
        "bands": bands,
    };
    if let Some(light) = job.chart.light() {
        map.insert("light".into(), light.into());
    }
    map
}
