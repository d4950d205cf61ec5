//! `lenscube verify`: reads all of a film and names what is wrong with it.

use crate::args::VerifyArgs;
use crate::failure::code;
use crate::job;
use crate::progress::{counting, json_path, print, say};
use crate::run::film::{digest, layout, lock_all};
use crate::status;
use anyhow::Result;
use formats::durable::{DurableError, Lock, fault_point, remove_temp};
use formats::film::{FilmStore, Finding, Verdict};
use serde_json::{Value, json};

/// What `--repair` has done.
#[derive(Default)]
struct Repair {
    shards: usize,
    temp: usize,
}

/// Runs the command; the exit code.
pub fn command(args: &VerifyArgs) -> Result<u8> {
    let store = status::open(&args.film)?;
    // Held so that no run writes meanwhile what would be removed.
    let held = if args.repair { lock_all(&args.film, args.take_over)? } else { Vec::new() };
    store.check_in_place()?;
    fault_point("locked");
    let (bar, progress) = counting("verifying");
    let verdict = store.verify(job::threads(args.threads), &progress);
    bar.finish_and_clear();
    let mut verdict = verdict?;
    fault_point("verified");
    verdict.findings.extend(digests(&store));
    let repair = if args.repair { Some(repair(&store, &verdict, &held)?) } else { None };
    drop(held);
    let engines = store.engines()?;
    match args.json {
        true => print(serde_json::to_string_pretty(&report(&store, &engines, &verdict, repair.as_ref()))?),
        false => tell(&store, &engines, &verdict, repair.as_ref()),
    }
    Ok(if verdict.findings.is_empty() { 0 } else { code::WRONG })
}

/// The digests that the attributes tell, made again from the words beside them.
fn digests(store: &FilmStore) -> Vec<Finding> {
    let told = store.provenance();
    let own = |key: &str| told.get(key).map(digest);
    let pairs = [("job_digest", own("job")), ("layout_digest", Some(digest(&layout(store.spec()))))];
    let wrong = pairs
        .into_iter()
        .filter(|(key, own)| own.is_none() || told.get(*key).and_then(Value::as_str) != own.as_deref());
    wrong
        .map(|(key, _)| Finding::Metadata {
            key: "zarr.json".into(),
            reason: format!("{key} does not fit the words beside it"),
        })
        .collect()
}

/// Removes bad shards, and temp files of all but live processes of this host. Files of processes that this one cannot look up
/// stay as well while a unit is locked that was not locked when the check began: its worker may be writing them.
fn repair(store: &FilmStore, verdict: &Verdict, held: &[Lock]) -> Result<Repair> {
    let mut done = Repair::default();
    for finding in &verdict.findings {
        if let Finding::Bad { key, .. } = finding
            && store.remove_bad(key)?
        {
            done.shards += 1;
        }
    }
    let locks = FilmStore::locks(store.path())?;
    let others = locks.iter().any(|(path, ..)| !held.iter().any(|own| own.path() == path));
    for (path, dead) in &verdict.temp {
        if *dead == Some(true) || (dead.is_none() && !others) {
            match remove_temp(path) {
                Ok(()) => done.temp += 1,
                // Another user's, which harms no film.
                Err(e @ DurableError::Permission { .. }) => say(format!("note: {e}")),
                Err(e) => return Err(e.into()),
            }
        }
    }
    Ok(done)
}

/// One finding: its kind, where, why.
fn words(finding: &Finding) -> (&'static str, &str, &str) {
    match finding {
        Finding::Missing { key } => ("missing", key, "no such file"),
        Finding::Bad { key, reason } => ("bad", key, reason),
        Finding::Unreadable { key, reason } => ("unreadable", key, reason),
        Finding::Metadata { key, reason } => ("metadata", key, reason),
    }
}

fn report(store: &FilmStore, engines: &[String], verdict: &Verdict, repair: Option<&Repair>) -> Value {
    let finding = |f: &Finding| {
        let (kind, key, reason) = words(f);
        json!({ "kind": kind, "key": key, "reason": reason })
    };
    let temp: Vec<Value> = verdict.temp.iter().map(|t| json_path(&t.0)).collect();
    json!({
        "film": json_path(store.path()),
        "sound": verdict.findings.is_empty(),
        "engines": engines,
        "shards": verdict.shards,
        "bytes": verdict.bytes,
        "findings": verdict.findings.iter().map(finding).collect::<Vec<_>>(),
        "temp_files": temp,
        "repaired": repair.map(|r| json!({ "shards_removed": r.shards, "temp_files_removed": r.temp })),
    })
}

fn tell(store: &FilmStore, engines: &[String], verdict: &Verdict, repair: Option<&Repair>) {
    for finding in &verdict.findings {
        let (kind, key, reason) = words(finding);
        print(format!("{kind}: {key}: {reason}"));
    }
    let path = store.path().display();
    let gb = verdict.bytes as f64 * 1e-9;
    match verdict.findings.len() {
        0 => print(format!("{path} is sound: {} shards, {gb:.3} GB", verdict.shards)),
        n => print(format!("{path}: {n} findings in {} shards, {gb:.3} GB", verdict.shards)),
    }
    if engines.len() > 1 {
        say(format!(
            "note: shards are of several engines, {}, up to 2e-6 of the peak apart (--mixed-engines)",
            engines.join(", ")
        ));
    }
    if !verdict.temp.is_empty() && repair.is_none() {
        say(format!(
            "note: {} temp files; the next run or --repair removes those of dead processes",
            verdict.temp.len()
        ));
    }
    if let Some(done) = repair {
        say(format!(
            "removed {} bad shards and {} temp files; the same `lenscube run` makes what is missing",
            done.shards, done.temp
        ));
    }
}
