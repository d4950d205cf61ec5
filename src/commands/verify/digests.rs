//! Digests of job and layout in the attributes of films and raws.

use crate::film::digest;
use formats::group::Finding;
use serde_json::{Map, Value};

/// Digests in the `provenance` of a film or raw of `layout` that differ from those of what they are the digests of.
pub fn check_digests(provenance: &Map<String, Value>, layout: &Value) -> Vec<Finding> {
    let pairs = [("job_digest", provenance.get("job").map(digest)), ("layout_digest", Some(digest(layout)))];
    let recorded = |key: &str| provenance.get(key).and_then(Value::as_str);
    let wrong = pairs
        .into_iter()
        .filter(|(key, computed)| computed.is_none() || recorded(key) != computed.as_deref());
    let finding = |(key, _)| Finding::Attributes {
        reason: format!("{key} does not match the attributes that it is the digest of"),
    };
    wrong.map(finding).collect()
}
