//! The verdict of `verify --json`, the same of films and raws.

use super::repair::Repair;
use crate::progress::json_path;
use formats::group::{Finding, VerifyReport};
use serde_json::{Map, Value, json};

/// Verdict and repair of the film or raw (`kind`) at `path`.
pub fn json(
    (kind, path): (&str, &std::path::Path),
    verdict: &VerifyReport,
    repair: Option<&Repair>,
) -> Map<String, Value> {
    let finding = |f: &Finding| {
        let (kind, key, reason) = f.fields();
        json!({ "kind": kind, "key": key, "reason": reason })
    };
    let temp: Vec<Value> = verdict.temp.iter().map(|t| json_path(&t.0)).collect();
    let findings: Vec<Value> = verdict.findings.iter().map(finding).collect();
    let repaired = repair.map(|r| {
        json!({
            "shards_removed": r.shards,
            "temp_files_removed": r.temp,
            "coordinates_restored": r.coordinates,
            "metadata_restored": r.metadata,
        })
    });
    [
        (kind, json_path(path)),
        ("sound", verdict.findings.is_empty().into()),
        ("shards", verdict.shards.into()),
        ("bytes", verdict.bytes.into()),
        ("findings", findings.into()),
        ("temp_files", temp.into()),
        ("repaired", repaired.into()),
    ]
    .map(|(key, value)| (key.to_owned(), value))
    .into_iter()
    .collect()
}
