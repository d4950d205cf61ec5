//! `lenscube status`, `verify` and `pyramid` of raws: which raw is meant, and the first two.

use crate::args::{StatusArgs, VerifyArgs};
use crate::failure::{Coded, code};
use crate::job::threads;
use crate::progress::{counting, json_path, plural, print};
use crate::run::film::lock_all;
use crate::verify::digests::check_digests;
use crate::verify::repair::{self, Target, repair};
use crate::verify::verdict;
use anyhow::Result;
use formats::group::{Finding, GroupError, VerifyReport};
use formats::pyramid::PyramidState;
use formats::raw::RawStore;
use serde_json::{Value, json};
use std::path::Path;

/// Defects that are named on the terminal; `--json` names all.
const NAMED: usize = 8;

/// The raw at `path`; `None` if it is none.
///
/// # Errors
/// A damaged one (4); the store cannot be read.
pub fn open(path: &Path) -> Result<Option<RawStore>> {
    opened(path, RawStore::open)
}

fn opened(
    path: &Path,
    open: impl Fn(&Path, bool) -> Result<RawStore, GroupError>,
) -> Result<Option<RawStore>> {
    if !RawStore::is_one(path).unwrap_or(false) {
        return Ok(None);
    }
    open(path, true).map(Some).map_err(|e| match e {
        GroupError::Damaged { .. } | GroupError::ArrayMetadata { .. } => {
            Coded { code: code::WRONG, message: e.to_string() }.into()
        }
        e => e.into(),
    })
}

/// The exit code of `status`, if `args` name a raw.
pub fn status(args: &StatusArgs) -> Result<Option<u8>> {
    let Some(raw) = args.film.as_deref().filter(|_| args.plan.is_none()).map(open).transpose()?.flatten()
    else {
        return Ok(None);
    };
    let all = raw.spec().all_shards();
    let missing: Vec<String> = raw.missing(&all)?.into_iter().map(|s| raw.spec().key(s)).collect();
    let (done, complete) = (all.len() - missing.len(), missing.is_empty());
    let pyramid = raw.pyramid().state()?;
    match args.json {
        true => print(serde_json::to_string_pretty(&json!({
            "raw": json_path(raw.path()),
            "complete": complete,
            "frames": raw.spec().exposure_s.len(),
            "shards": all.len(),
            "shards_done": done,
            "pyramid": pyramid.name(),
            "missing": missing,
        }))?),
        false => {
            let state = if complete { "complete" } else { "incomplete" };
            let (frames, size) = (raw.spec().exposure_s.len(), raw.spec().sensor);
            print(format!(
                "{}: raw, {state}: {done} of {} shards; {} of {size} px",
                raw.path().display(),
                all.len(),
                plural(frames, "frame")
            ));
            if pyramid != PyramidState::None {
                print(format!("pyramid {}", pyramid.name()));
            }
            name(missing.iter().map(|key| format!("missing {key}")));
        }
    }
    Ok(Some(if args.check && !complete { code::WRONG } else { 0 }))
}

/// The exit code of `verify`, if `args` name a raw.
pub fn verify(args: &VerifyArgs) -> Result<Option<u8>> {
    let Some(raw) = opened(&args.film, RawStore::open_to_verify)? else { return Ok(None) };
    // No run may write meanwhile the files that would be removed.
    let locks = if args.repair { lock_all(&args.film, args.take_over)? } else { Vec::new() };
    raw.group().check_in_place()?;
    let (bar, progress) = counting("verifying");
    let verified = raw.verify(threads(args.threads), &progress);
    bar.finish_and_clear();
    let mut verdict = verified?;
    let provenance =
        raw.attributes().get("provenance").and_then(Value::as_object).cloned().unwrap_or_default();
    let layout = provenance.get("layout").cloned().unwrap_or_default();
    verdict.findings.extend(check_digests(&provenance, &layout));
    let target = Target {
        group: raw.group(),
        remove_bad: &|key| raw.remove_bad(key),
        restore: &|key| raw.restore(key),
    };
    let repair = args.repair.then(|| repair(&target, &verdict, &locks)).transpose()?;
    drop(locks);
    let line = |f: &Finding| match f {
        Finding::Missing { key } => format!("missing {key}"),
        f => {
            let (kind, key, reason) = f.fields();
            format!("{kind} {key}: {reason}")
        }
    };
    match args.json {
        true => {
            let report = verdict::json(("raw", raw.path()), &verdict, repair.as_ref());
            print(serde_json::to_string_pretty(&report)?);
        }
        false => {
            let VerifyReport { shards, bytes, findings, .. } = &verdict;
            print(format!(
                "{}: raw, {}, {bytes} bytes read, {}",
                raw.path().display(),
                plural(shards, "shard"),
                plural(findings.len(), "defect")
            ));
            name(findings.iter().map(line));
            if let Some(done) = &repair {
                repair::print_restored(done, &verdict, "sensor");
            }
            if let Some(removed) = repair.map(|done| done.shards).filter(|n| *n > 0) {
                print(format!(
                    "{removed} bad shards removed; the same `lenscube sensor` makes those of the raw again, `lenscube pyramid` those of levels"
                ));
            }
        }
    }
    Ok(Some(if verdict.findings.is_empty() { 0 } else { code::WRONG }))
}

/// Prints the first few lines, and how many there are.
fn name(lines: impl Iterator<Item = String>) {
    let lines: Vec<String> = lines.collect();
    lines.iter().take(NAMED).for_each(print);
    if lines.len() > NAMED {
        print(format!("and {} more; --json names all", lines.len() - NAMED));
    }
}
