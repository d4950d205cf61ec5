//! `lenscube verify` of a raw or a scene.

use super::digests::check_digests;
use super::repair::{self, Target, repair};
use super::verdict;
use crate::args::VerifyArgs;
use crate::failure::code;
use crate::film::{lock_all, reported};
use crate::machine::threads;
use crate::progress::{counting, plural, print, print_first};
use anyhow::Result;
use formats::group::{Finding, GroupError, VerifyReport};
use formats::parallel::Progress;
use formats::raw::RawStore;
use formats::scene::SceneStore;
use serde_json::{Map, Value};

/// The exit code of `verify`, if `args` name a raw or a scene.
pub fn verify(args: &VerifyArgs) -> Result<Option<u8>> {
    if let Some(raw) = reported::opened_raw(&args.film, RawStore::open_to_verify)? {
        let target = Target {
            group: raw.group(),
            remove_bad: &|key| raw.remove_bad(key),
            restore: &|key| raw.restore(key),
        };
        let check = |threads: usize, progress: Progress<'_>| raw.verify(threads, progress);
        let removed =
            "the same `lenscube sensor` makes those of the raw again, `lenscube pyramid` those of levels";
        let kind = Kind { name: "raw", command: "sensor", removed };
        return verified(args, &kind, raw.attributes(), &target, &check).map(Some);
    }
    if let Some(scene) = reported::opened_scene(&args.film, SceneStore::open_to_verify)? {
        let target = Target {
            group: scene.group(),
            remove_bad: &|key| scene.remove_bad(key),
            restore: &|key| scene.restore(key),
        };
        let check = |threads: usize, progress: Progress<'_>| scene.verify(threads, progress);
        let kind =
            Kind { name: "scene", command: "scene", removed: "the same `lenscube scene` makes them again" };
        return verified(args, &kind, scene.attributes(), &target, &check).map(Some);
    }
    Ok(None)
}

/// A kind of group, in reports.
struct Kind {
    name: &'static str,
    /// The command that makes it.
    command: &'static str,
    /// What is said of shards that were removed.
    removed: &'static str,
}

/// Reads and decodes every shard on so many threads.
type Check<'a> = &'a dyn Fn(usize, Progress<'_>) -> Result<VerifyReport, GroupError>;

/// Verifies a group with `attributes`; the exit code.
fn verified(
    args: &VerifyArgs,
    kind: &Kind,
    attributes: &Map<String, Value>,
    target: &Target<'_>,
    check: Check<'_>,
) -> Result<u8> {
    // No run may write meanwhile the files that would be removed.
    let locks = if args.repair { lock_all(&args.film, args.take_over)? } else { Vec::new() };
    target.group.check_in_place()?;
    let (bar, progress) = counting("verifying");
    let verdict = check(threads(args.threads), &progress);
    bar.finish_and_clear();
    let mut verdict = verdict?;
    let provenance = attributes.get("provenance").and_then(Value::as_object).cloned().unwrap_or_default();
    let layout = provenance.get("layout").cloned().unwrap_or_default();
    verdict.findings.extend(check_digests(&provenance, &layout));
    let repair = args.repair.then(|| repair(target, &verdict, &locks)).transpose()?;
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
            let report = verdict::json((kind.name, target.group.path()), &verdict, repair.as_ref());
            print(serde_json::to_string_pretty(&report)?);
        }
        false => {
            let VerifyReport { shards, bytes, findings, .. } = &verdict;
            print(format!(
                "{}: {}, {}, {bytes} bytes read, {}",
                target.group.path().display(),
                kind.name,
                plural(shards, "shard"),
                plural(findings.len(), "defect")
            ));
            print_first(findings.iter().map(line));
            if let Some(done) = &repair {
                repair::print_restored(done, &verdict, kind.command);
            }
            if let Some(removed) = repair.map(|done| done.shards).filter(|n| *n > 0) {
                print(format!("{removed} bad shards removed; {}", kind.removed));
            }
        }
    }
    Ok(if verdict.findings.is_empty() { 0 } else { code::WRONG })
}
