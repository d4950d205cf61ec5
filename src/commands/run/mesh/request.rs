//! What a film of a mesh was requested with: by it a complete film is recognised without its scene, which takes long to make.
//!
//! A film's attribute `source.mesh` has a digest of the version of the program and of its arithmetic, of the flags of the run, and of name, size and modification
//! time of each file that is read beside the mesh. The mesh, its materials and its light are in the digest of the scene's job, which is part of the film's own.
//! Where one of the two differs the scene is made, and the jobs are compared in full.

use crate::args::{ProcessArgs, RunArgs};
use crate::film::digest;
use crate::job::numeric_version;
use crate::outputs::Guard;
use anyhow::Result;
use formats::durable::is_url;
use formats::film::FilmStore;
use serde_json::{Value, json};
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Key of the record in the attribute `source` of a film.
pub const MESH: &str = "mesh";

/// The request of `args`, as the film records it; `None` if a file of the lens is at a URL.
pub fn request(args: &RunArgs) -> Option<Value> {
    let files = Guard::default().reads_optics(args);
    let states = files.inputs().map(state).collect::<Option<Vec<_>>>()?;
    // Without what changes no pixel.
    let job = RunArgs {
        chart: String::new(),
        film: PathBuf::new(),
        threads: None,
        memory: None,
        no_fsync: false,
        trust_input: false,
        pyramid: false,
        keep_going: false,
        process: ProcessArgs::default(),
        ..args.clone()
    };
    let all = json!([env!("CARGO_PKG_VERSION"), numeric_version(true), format!("{job:?}"), states]);
    let path = std::path::absolute(&args.chart).unwrap_or_else(|_| args.chart.clone().into());
    Some(json!({ "path": path.display().to_string(), "request": digest(&all) }))
}

/// Name, size and modification time of a file, or of all files of a lens pack; `None` at a URL.
fn state(path: &Path) -> Option<Value> {
    if is_url(path) {
        return None;
    }
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.into());
    let name = absolute.display().to_string();
    let Ok(metadata) = fs::metadata(path) else { return Some(json!([name])) };
    if !metadata.is_dir() {
        return Some(json!([name, metadata.size(), metadata.mtime(), metadata.mtime_nsec()]));
    }
    let mut names: Vec<PathBuf> =
        fs::read_dir(path).ok()?.map(|entry| Some(entry.ok()?.path())).collect::<Option<_>>()?;
    names.sort();
    names.iter().map(|name| state(name)).collect()
}

/// Whether `film` is complete and was made with the request `asked`.
///
/// # Errors
/// The film cannot be read.
pub fn is_complete(film: &FilmStore, asked: &Value) -> Result<bool> {
    let recorded = film.provenance().get("source").and_then(|source| source.get(MESH)?.get("request"));
    if recorded.is_none() || recorded != asked.get("request") {
        return Ok(false);
    }
    let shards: Vec<_> = film.all_shards().collect();
    let bands: Vec<usize> = (0..film.spec().wavelengths_nm.len()).collect();
    Ok(film.shards_bytes(&shards)?.iter().all(Option::is_some) && film.has_layers(&bands)?)
}

/// Digest of the job of the scene that `film` was made of.
pub fn scene_digest(film: &FilmStore) -> Option<&str> {
    film.provenance().get("job")?.get("chart")?.get("job_digest")?.as_str()
}
