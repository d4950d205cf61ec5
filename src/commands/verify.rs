//! `lenscube verify`: reads a complete film, checks its shards and attributes, and lists what is wrong.

mod dataset;
mod digests;
mod other;
mod repair;
mod verdict;

use crate::args::VerifyArgs;
use crate::failure::code;
use crate::film::{layout, lock_all, reported};
use crate::machine::threads;
use crate::progress::{counting, data_size, log_line, plural, print};
use anyhow::Result;
use digests::check_digests;
use formats::durable::fault_point;
use formats::film::FilmStore;
use formats::group::{Finding, VerifyReport};
use repair::{Repair, Target};
use serde_json::{Value, json};

/// Runs the command; the exit code.
pub fn command(args: &VerifyArgs) -> Result<u8> {
    if let Some(code) = dataset::verify(args)? {
        return Ok(code);
    }
    if let Some(code) = other::verify(args)? {
        return Ok(code);
    }
    let film = FilmStore::open_to_verify(&args.film, true);
    let store = reported::opened_of_kinds("a film, raw, scene or data set", film)?;
    // No run may write meanwhile the files that would be removed.
    let locks = if args.repair { lock_all(&args.film, args.take_over)? } else { Vec::new() };
    store.group().check_in_place()?;
    fault_point("locked");
    let (bar, progress) = counting("verifying");
    let verdict = store.verify(threads(args.threads), &progress);
    bar.finish_and_clear();
    let mut verdict = verdict?;
    fault_point("verified");
    verdict.findings.extend(check_digests(store.provenance(), &layout(store.spec())));
    verdict.findings.extend(check_keep_bits(&store));
    let target = Target {
        group: store.group(),
        remove_bad: &|key| store.remove_bad(key),
        restore: &|key| store.restore(key),
    };
    let repair = args.repair.then(|| repair::repair(&target, &verdict, &locks)).transpose()?;
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

/// The rounding of a film that differs from that of its job.
fn check_keep_bits(store: &FilmStore) -> Option<Finding> {
    let job = store.provenance().get("job");
    let planned = job.and_then(|job| job.get("keep_bits")).and_then(Value::as_u64);
    (planned != store.spec().keep_bits.map(u64::from))
        .then(|| Finding::Attributes { reason: "keep_bits differs from that of its job".into() })
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
    let size = data_size(verdict.bytes);
    let shards = plural(verdict.shards, "shard");
    match verdict.findings.len() {
        0 => print(format!("{path} is correct: no defect in {shards}, {size}")),
        n => print(format!("{path}: {} in {shards}, {size}", plural(n, "defect"))),
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
        repair::print_restored(done, verdict, "run");
    }
}
