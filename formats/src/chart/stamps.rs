//! The state of a chart's files when its identity was determined, compared after each read: a run that is killed leaves no shard
//! made from a file that changed after that, so the film can be resumed once the chart is restored.
//!
//! Only stores in directories; an object is replaced whole, and its ETag is compared at the end of a run.

use std::collections::HashMap;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::Path;
use std::sync::OnceLock;
use std::time::UNIX_EPOCH;

use super::ChartError;
use crate::durable::DurableError;

/// Size and time of last change of each file; of files that are not there, nothing.
#[derive(Debug, Default)]
pub(super) struct Stamps(OnceLock<HashMap<u64, Stamp>>);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Stamp {
    bytes: u64,
    modified: u64,
}

fn hash(value: impl Hash) -> u64 {
    let mut hasher = DefaultHasher::new();
    value.hash(&mut hasher);
    hasher.finish()
}

/// Time of last change in ns since 1970, as the chart's identity states it.
pub(super) fn modified_ns(meta: &std::fs::Metadata) -> String {
    let time = meta.modified().ok().and_then(|t| t.duration_since(UNIX_EPOCH).ok());
    time.map_or(0, |t| t.as_nanos()).to_string()
}

impl Stamps {
    /// Keeps the states of `files`: key, size in bytes, time of last change. Later calls change nothing.
    pub(super) fn keep(&self, files: &[(String, u64, String)]) {
        let stamp = |(key, bytes, time): &(String, u64, String)| {
            (hash(key), Stamp { bytes: *bytes, modified: hash(time) })
        };
        self.0.get_or_init(|| files.iter().map(stamp).collect());
    }

    /// Whether the file of `key`, at `path`, is still in the state that was kept; always, if none was.
    ///
    /// # Errors
    /// [`ChartError::Changed`] if it is not; [`ChartError::Io`] if that cannot be determined.
    pub(super) fn unchanged(&self, key: &str, path: &Path) -> Result<(), ChartError> {
        let Some(kept) = self.0.get() else { return Ok(()) };
        let now = match std::fs::metadata(path) {
            Ok(meta) => Some(Stamp { bytes: meta.len(), modified: hash(modified_ns(&meta)) }),
            Err(e) if crate::durable::absent(&e) => None,
            Err(e) => return Err(DurableError::io("look up", path, 0, e).into()),
        };
        let what = match (kept.get(&hash(key)), now) {
            (Some(then), Some(now)) if *then == now => return Ok(()),
            (None, None) => return Ok(()),
            (Some(_), None) => "it was removed",
            (None, Some(_)) => "it was added",
            (Some(then), Some(now)) if then.bytes != now.bytes => "it has another size",
            _ => "it was written to",
        };
        Err(ChartError::Changed { path: path.into(), what })
    }
}
