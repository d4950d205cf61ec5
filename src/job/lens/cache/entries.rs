//! Files of the cache: traced bands, the depth nodes and ghosts of bands, and reduced charts.

use super::{EXTENSION, failures, operators, placements, reduced};
use crate::progress::plural;
use anyhow::{Context, Result};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// What an entry holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A traced band.
    Band,
    /// Where the depth nodes of a band lie.
    Nodes,
    /// The ghosts of a band.
    Ghosts,
    /// A band of a chart, reduced.
    Reduced,
    /// Why a band could not be traced.
    Failure,
}

/// A file of the cache.
pub struct Entry {
    /// Its path.
    pub path: PathBuf,
    /// What it holds.
    pub kind: Kind,
    /// Its size.
    pub bytes: u64,
    /// Last use: the later of the times of last access and last modification.
    pub used: SystemTime,
}

/// The entries of the cache; none if there is no directory.
///
/// # Errors
/// The directory cannot be listed.
pub fn entries(directory: &Path) -> Result<Vec<Entry>> {
    let listed = match std::fs::read_dir(directory) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        listed => listed.with_context(|| format!("listing {}", directory.display()))?,
    };
    let mut all = Vec::new();
    for entry in listed.flatten() {
        let name = entry.file_name();
        let ends = |extension: &str| name.to_string_lossy().ends_with(extension);
        let kinds = [
            (EXTENSION, Kind::Band),
            (placements::EXTENSION, Kind::Nodes),
            (operators::EXTENSION, Kind::Ghosts),
            (reduced::EXTENSION, Kind::Reduced),
            (failures::EXTENSION, Kind::Failure),
        ];
        let Some((_, kind)) = kinds.into_iter().find(|(extension, _)| ends(extension)) else { continue };
        // Another process may have removed it.
        let Ok(meta) = entry.metadata() else { continue };
        let modified = meta.modified().unwrap_or(SystemTime::UNIX_EPOCH);
        let used = meta.accessed().map_or(modified, |accessed| accessed.max(modified));
        all.push(Entry { path: entry.path(), kind, bytes: meta.len(), used });
    }
    Ok(all)
}

/// Numbers and bytes for people, e.g. `2 traced bands, depth nodes of 1 band, 12.3 MB`.
pub fn described(entries: &[Entry]) -> String {
    let count = |kind| entries.iter().filter(|e| e.kind == kind).count();
    let also = |kind, what: &str, of: &str| match count(kind) {
        0 => String::new(),
        n => format!(", {what}{}", plural(n, of)),
    };
    let nodes = also(Kind::Nodes, "depth nodes of ", "band");
    let ghosts = also(Kind::Ghosts, "ghosts of ", "band");
    let charts = also(Kind::Reduced, "", "reduced chart band");
    format!(
        "{}{nodes}{ghosts}{charts}, {:.1} MB",
        plural(count(Kind::Band), "traced band"),
        sum(entries) as f64 * 1e-6
    )
}

/// Bytes of all.
pub fn sum(entries: &[Entry]) -> u64 {
    entries.iter().map(|e| e.bytes).sum()
}
