//! The status of a film, as `--json` prints it.

use crate::commands::plan::unit_list;
use crate::film::record::{Outcome, RunRecord};
use crate::progress::json_path;
use anyhow::Result;
use formats::durable::LockOwner;
use formats::film::{FilmLayer, FilmStore};
use formats::group::JobGroup;
use formats::pyramid::PyramidState;
use serde::{Serialize, Serializer};
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::PathBuf;

/// Status of a film.
#[derive(Debug, Serialize)]
pub struct Status {
    film: Value,
    /// Whether all shards are present.
    pub complete: bool,
    pub shards: usize,
    pub shards_done: usize,
    pub bytes: u64,
    film_size: [usize; 2],
    outputs: Vec<String>,
    pub bands: Vec<BandStatus>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub layers: Vec<LayerStatus>,
    pub runs: RunTotals,
    pub last_run: Option<LastRun>,
    pub locks: Vec<LockStatus>,
    #[serde(serialize_with = "pyramid_name")]
    pub pyramid: PyramidState,
    /// Program that created the film.
    pub program: Value,
    /// Paths of chart and lens, size and unit of the chart.
    pub source: Value,
    engine: Option<String>,
    /// Engines that computed shards.
    pub engines: Vec<String>,
    pub job_digest: Value,
    pub layout_digest: Value,
    pub job: Value,
    layout: Value,
    pub missing: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub units: Option<UnitStatus>,
}

/// Shards of a band.
#[derive(Debug, Serialize)]
pub struct BandStatus {
    band: usize,
    pub wavelength_nm: f64,
    pub shards: usize,
    pub shards_done: usize,
}

/// A layer of light.
#[derive(Debug, Serialize)]
pub struct LayerStatus {
    pub name: String,
    pub bands: usize,
    pub bands_done: usize,
}

/// Sums over the recorded runs.
#[derive(Debug, Default, Serialize)]
pub struct RunTotals {
    pub complete: usize,
    pub interrupted: usize,
    pub failed: usize,
    pub wall_s: f64,
    pub tiles: u64,
    shards: u64,
}

/// The last run.
#[derive(Debug, Serialize)]
pub struct LastRun {
    finished_unix_s: Option<u64>,
    outcome: Outcome,
    error: Option<String>,
    wall_s: f64,
}

/// A lock of a run.
#[derive(Debug, Serialize)]
pub struct LockStatus {
    path: Value,
    pub owner: Option<Box<LockOwner>>,
    /// Whether that process is alive; `None`: of another host.
    pub alive: Option<bool>,
}

/// Units of a plan.
#[derive(Debug, Serialize)]
pub struct UnitStatus {
    pub all: usize,
    pub done: usize,
    /// The others, as a list.
    pub missing: String,
}

impl Status {
    /// Status of `store`, without units.
    ///
    /// # Errors
    /// The store cannot be read.
    pub fn new(store: &FilmStore) -> Result<Self> {
        let spec = store.spec();
        let band = |(band, &wavelength_nm)| BandStatus { band, wavelength_nm, shards: 0, shards_done: 0 };
        let mut bands: Vec<BandStatus> = spec.wavelengths_nm.iter().enumerate().map(band).collect();
        let (mut missing, mut bytes) = (Vec::new(), 0);
        let shards: Vec<_> = store.all_shards().collect();
        for (&(output, band, shard), size) in std::iter::zip(&shards, store.shards_bytes(&shards)?) {
            bands[band].shards += 1;
            match size {
                Some(size) => {
                    bands[band].shards_done += 1;
                    bytes += size;
                }
                None => missing.push(store.key(output, band, shard)),
            }
        }
        let parse = |run| serde_json::from_value(Value::Object(run)).ok();
        let runs: Vec<RunRecord> = store.group().runs()?.into_iter().filter_map(parse).collect();
        let lock = |(path, owner, dead): (PathBuf, _, Option<bool>)| LockStatus {
            path: json_path(&path),
            owner,
            alive: dead.map(|dead| !dead),
        };
        let layers = layers(store)?;
        let attribute = |key: &str| store.provenance().get(key).cloned().unwrap_or_default();
        Ok(Self {
            film: json_path(store.path()),
            complete: missing.is_empty() && layers.iter().all(|layer| layer.bands_done == layer.bands),
            shards: shards.len(),
            shards_done: shards.len() - missing.len(),
            bytes,
            film_size: [spec.film.height, spec.film.width],
            outputs: spec.outputs.iter().map(|o| o.name.clone()).collect(),
            bands,
            layers,
            runs: RunTotals::new(&runs),
            last_run: runs.last().map(LastRun::new),
            locks: JobGroup::locks(store.path())?.into_iter().map(lock).collect(),
            pyramid: store.pyramid().state()?,
            program: attribute("program"),
            source: attribute("source"),
            engine: store.engine().map(str::to_owned),
            engines: store.engines()?,
            job_digest: attribute("job_digest"),
            layout_digest: attribute("layout_digest"),
            job: attribute("job"),
            layout: attribute("layout"),
            missing,
            units: None,
        })
    }
}

/// The layers of light of `store`.
fn layers(store: &FilmStore) -> Result<Vec<LayerStatus>> {
    let bands = store.spec().wavelengths_nm.len();
    let layer = |(index, layer): (usize, &FilmLayer)| {
        let bands_done = store.layer_bands(index)?;
        Ok(LayerStatus { name: layer.name.clone(), bands, bands_done })
    };
    store.spec().layers.iter().enumerate().map(layer).collect()
}

impl RunTotals {
    fn new(runs: &[RunRecord]) -> Self {
        let count = |outcome| runs.iter().filter(|r| r.outcome == outcome).count();
        Self {
            complete: count(Outcome::Complete),
            interrupted: count(Outcome::Interrupted),
            failed: count(Outcome::Failed),
            wall_s: runs.iter().fold(0.0, |sum, r| sum + r.wall_s),
            tiles: runs.iter().map(|r| r.tiles).sum(),
            shards: runs.iter().map(|r| r.shards).sum(),
        }
    }
}

impl LastRun {
    fn new(run: &RunRecord) -> Self {
        let RunRecord { finished_unix_s, outcome, wall_s, .. } = *run;
        Self { finished_unix_s, outcome, error: run.error.clone(), wall_s }
    }

    /// Why it failed.
    pub fn error(&self) -> Option<&str> {
        self.error.as_deref()
    }
}

impl UnitStatus {
    /// Of `all` units those of `missing` are not complete.
    pub fn new(all: usize, missing: &BTreeSet<usize>) -> Self {
        Self { all, done: all - missing.len(), missing: unit_list::format(missing) }
    }
}

fn pyramid_name<S: Serializer>(state: &PyramidState, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(state.name())
}
