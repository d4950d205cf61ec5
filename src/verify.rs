//! `lenscube verify`: reads a complete film, checks its shards and attributes, and lists what is wrong.

pub mod verdict;

use crate::args::VerifyArgs;
use crate::failure::code;
use crate::job;
use crate::progress::{counting, log_line, plural, print};
use crate::run::film::{digest, layout, lock_all};
use crate::status;
use anyhow::Result;
use formats::durable::{DurableError, Lock, fault_point, remove_temp};
use formats::film::FilmStore;
use formats::group::{Finding, JobGroup, VerifyReport};
use serde_json::{Value, json};
use verdict::Repair;

/// Runs the command; the exit code.
pub fn command(args: &VerifyArgs) -> Result<u8> {
    if let Some(code) = crate::sensor::check::verify(args)? {
        return Ok(code);
    }
    let store = status::open(&args.film)?;
    // No run may write meanwhile the files that would be removed.
    let locks = if args.repair { lock_all(&args.film, args.take_over)? } else { Vec::new() };
    store.group().check_in_place()?;
    fault_point("locked");
    let (bar, progress) = counting("verifying");
    let verdict = store.verify(job::threads(args.threads), &progress);
    bar.finish_and_clear();
    let mut verdict = verdict?;
    fault_point("verified");
    verdict.findings.extend(check_digests(&store));
    let repair = if args.repair { Some(repair(&store, &verdict, &locks)?) } else { None };
    drop(locks);
    let engines = store.engines()?;
    match args.json {
        true => {
            print(serde_json::to_string_pretty(&json_report(&store, &engines, &verdict, repair.as_ref()))?)
        }
        false => print_report(&store, &engines, &verdict, repair.as_ref()),
    }
    Ok(if verdict.findings.is_empty() { 0 } else { code::WRONG })
}

/// Digests in the attributes that differ from those of the attributes' contents.
fn check_digests(store: &FilmStore) -> Vec<Finding> {
    let attributes = store.provenance();
    let computed = |key: &str| attributes.get(key).map(digest);
    let pairs = [("job_digest", computed("job")), ("layout_digest", Some(digest(&layout(store.spec()))))];
    let recorded = |key: &str| attributes.get(key).and_then(Value::as_str);
    let planned_bits = attributes.get("job").and_then(|job| job.get("keep_bits")).and_then(Value::as_u64);
    let bits_differ = planned_bits != store.spec().keep_bits.map(u64::from);
    let keep_bits = bits_differ.then(|| Finding::Metadata {
        key: "zarr.json".into(),
        reason: "keep_bits differs from that of its job".into(),
    });
    let wrong = pairs
        .into_iter()
        .filter(|(key, computed)| computed.is_none() || recorded(key) != computed.as_deref());
    wrong
        .map(|(key, _)| Finding::Metadata {
            key: "zarr.json".into(),
            reason: format!("{key} does not match the attributes that it is the digest of"),
        })
        .chain(keep_bits)
        .collect()
}

/// Removes bad shards, and temporary files except those of live processes of this host. Files of processes that cannot be looked up
/// remain as long as a unit is locked that was not when the check began: its worker may be writing them.
fn repair(store: &FilmStore, verdict: &VerifyReport, locked: &[Lock]) -> Result<Repair> {
    let mut done = Repair::default();
    // The group's metadata determine the coordinates.
    let of_group = |f: &Finding| matches!(f, Finding::Metadata { key, .. } if key == "zarr.json");
    let is_layout_known = !verdict.findings.iter().any(of_group);
    for finding in &verdict.findings {
        match finding {
            Finding::Bad { key, .. } => done.shards += usize::from(store.remove_bad(key)?),
            Finding::Metadata { key, .. } if is_layout_known => {
                done.coordinates += usize::from(store.restore_coordinate(key)?)
            }
            _ => {}
        }
    }
    let locks = JobGroup::locks(store.path())?;
    let others = locks.iter().any(|(path, ..)| !locked.iter().any(|lock| lock.path() == path));
    for (path, dead) in &verdict.temp {
        if *dead == Some(true) || (dead.is_none() && !others) {
            match remove_temp(path) {
                Ok(()) => done.temp += 1,
                // A file of another user; it does not affect the film.
                Err(e @ DurableError::Permission { .. }) => log_line(format!("note: {e}")),
                Err(e) => return Err(e.into()),
            }
        }
    }
    Ok(done)
}

fn json_report(
    store: &FilmStore,
    engines: &[String],
    verdict: &VerifyReport,
    repair: Option<&Repair>,
) -> Value {
    let mut report = verdict::json(("film", store.path()), verdict, repair);
    report.insert("engines".into(), json!(engines));
    report.insert("keep_bits".into(), json!(store.spec().keep_bits));
    report.into()
}

fn print_report(store: &FilmStore, engines: &[String], verdict: &VerifyReport, repair: Option<&Repair>) {
    for finding in &verdict.findings {
        let (kind, key, reason) = finding.fields();
        print(format!("{kind}: {key}: {reason}"));
    }
    let path = store.path().display();
    let gb = verdict.bytes as f64 * 1e-9;
    let shards = plural(verdict.shards, "shard");
    match verdict.findings.len() {
        0 => print(format!("{path} is correct: no defect in {shards}, {gb:.3} GB")),
        n => print(format!("{path}: {} in {shards}, {gb:.3} GB", plural(n, "defect"))),
    }
    if let Some(bits) = store.spec().keep_bits {
        log_line(format!("note: samples are rounded to {bits} bits of mantissa (--keep-bits)"));
    }
    if engines.len() > 1 {
        log_line(format!(
            "note: shards are of several engines, {}, whose values differ by up to 2e-6 of the peak (--mixed-engines)",
            engines.join(", ")
        ));
    }
    if !verdict.temp.is_empty() && repair.is_none() {
        log_line(format!(
            "note: {} temporary files; the next run or --repair removes those of ended processes",
            verdict.temp.len()
        ));
    }
    if let Some(done) = repair {
        log_line(format!(
            "removed {} damaged shards and {} temporary files; the same `lenscube run` computes the missing shards",
            done.shards, done.temp
        ));
        if done.coordinates > 0 {
            log_line(format!("wrote {} again", plural(done.coordinates, "damaged coordinate")));
        }
        let is_metadata = |finding: &&Finding| matches!(finding, Finding::Metadata { .. });
        if verdict.findings.iter().filter(is_metadata).count() > done.coordinates {
            log_line("metadata cannot be repaired: `lenscube run … --overwrite` computes the film anew");
        }
    }
}
