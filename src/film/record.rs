//! A file `runs/*.json` of a film: how a run ended, and its figures.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// How a run ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Outcome {
    /// All its shards are in the film.
    Complete,
    /// Stopped by a signal.
    Interrupted,
    /// Stopped by an error, or with shards left out.
    Failed,
    /// Of a later version.
    #[default]
    #[serde(other)]
    Unknown,
}

/// A file `runs/*.json` of a film: what one run did; it may differ between runs of the same film.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct RunRecord {
    /// End of the run, seconds since 1970.
    pub finished_unix_s: Option<u64>,
    /// How it ended.
    pub outcome: Outcome,
    /// Why it failed.
    pub error: Option<String>,
    /// Wall time of the computation.
    pub wall_s: f64,
    /// Tiles added.
    pub tiles: u64,
    /// Shards committed.
    pub shards: u64,
    /// Machine, settings, and figures per stage and per GPU.
    #[serde(flatten)]
    pub details: Map<String, Value>,
}
