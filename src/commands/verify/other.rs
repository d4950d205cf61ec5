//! `lenscube verify` of a raw.

use super::digests::check_digests;
use super::repair::{self, Target, repair};
use super::verdict;
use crate::args::VerifyArgs;
use crate::failure::code;
use crate::film::{lock_all, reported};
use crate::machine::threads;
use crate::progress::{counting, plural, print, print_first};
use anyhow::Result;
use formats::group::{Finding, VerifyReport};
use formats::raw::RawStore;
use serde_json::Value;

/// The exit code of `verify`, if `args` name a raw.
pub fn verify(args: &VerifyArgs) -> Result<Option<u8>> {
    let Some(raw) = reported::opened_raw(&args.film, RawStore::open_to_verify)? else { return Ok(None) };
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
            print_first(findings.iter().map(line));
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
