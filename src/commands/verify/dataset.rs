//! `lenscube verify` of a data set: every item is read and has the digest of its line.

use crate::args::VerifyArgs;
use crate::failure::code;
use crate::progress::{counting, data_size, log_line, plural, print};
use anyhow::{Context, Result};
use formats::dataset::store::{DatasetStore, is_one};
use formats::durable::is_url;
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::path::Path;

/// The exit code of `verify`, if `args` name a data set.
pub fn verify(args: &VerifyArgs) -> Result<Option<u8>> {
    let path = Path::new(&args.film);
    if is_url(path) || !is_one(path).unwrap_or(false) {
        return Ok(None);
    }
    let store = DatasetStore::open(path)?;
    let (mut findings, mut bytes) = (Vec::new(), 0);
    let (bar, progress) = counting("verifying");
    let units = store.spec().units();
    for unit in 0..units {
        let (found, read) = store.verify_unit(unit).with_context(|| path.display().to_string())?;
        findings.extend(found);
        bytes += read;
        progress(unit + 1, units);
    }
    bar.finish_and_clear();
    if findings.is_empty() {
        findings = store.verify_common().with_context(|| path.display().to_string())?;
    }
    let damaged: BTreeSet<u64> = findings.iter().filter_map(|finding| finding.unit).collect();
    if args.repair && !findings.is_empty() {
        store.forget_all_lines()?;
        for unit in &damaged {
            store.forget(*unit)?;
        }
    }
    if args.json {
        let list: Vec<Value> =
            findings.iter().map(|f| json!({"kind": f.kind, "key": f.key, "unit": f.unit})).collect();
        print(serde_json::to_string_pretty(&json!({
            "dataset": path.to_string_lossy(), "correct": findings.is_empty(), "samples": store.spec().samples, "bytes": bytes,
            "findings": list, "repaired_units": if args.repair { damaged.len() } else { 0 },
        }))?);
    } else {
        findings.iter().for_each(|f| print(format!("{}: {}", f.kind, f.key)));
        let samples = plural(store.spec().samples, "sample");
        let size = data_size(bytes);
        match findings.len() {
            0 => print(format!("{} is correct: no defect in {samples}, {size}", path.display())),
            n => print(format!("{}: {} in {samples}, {size}", path.display(), plural(n, "defect"))),
        }
        if args.repair && !findings.is_empty() {
            let what = match damaged.len() {
                0 => "what all samples have in common".to_owned(),
                n => plural(n, "unit"),
            };
            log_line(format!("{what} will be made again by the same `lenscube dataset`"));
        }
    }
    Ok(Some(if findings.is_empty() { 0 } else { code::WRONG }))
}
