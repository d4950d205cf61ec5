//! `lenscube status`: what of a film is done, without reading a pixel.

use crate::args::StatusArgs;
use crate::failure::{Coded, code};
use crate::plan::file::Plan;
use crate::plan::list;
use crate::progress::{json_path, print};
use anyhow::{Context, Result};
use formats::durable::Owner;
use formats::film::{FilmError, FilmStore};
use serde_json::{Map, Value, json};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Missing shards named on the terminal; `--json` names all.
const NAMED: usize = 8;

/// A film to look at: nothing there is a failure, damage a finding.
pub fn open(path: &Path) -> Result<FilmStore> {
    FilmStore::open(path, true).map_err(|e| {
        let code = match &e {
            FilmError::Damaged { .. } | FilmError::Attributes { .. } => code::WRONG,
            FilmError::NotFilm { .. } => code::FAILED,
            _ => return e.into(),
        };
        Coded { code, message: e.to_string() }.into()
    })
}

/// Runs the command; the exit code.
pub fn command(args: &StatusArgs) -> Result<u8> {
    let plan = args.plan.as_deref().map(Plan::read).transpose()?.map(|(plan, _)| plan);
    let planned = || plan.as_ref().and_then(|p| p.command.film.as_ref()).map(PathBuf::from);
    let film = args.film.clone().or_else(planned).context("the plan names no film")?;
    let store = open(&film)?;
    let mut to_do = BTreeSet::new();
    if let (Some(plan), Some(path)) = (&plan, &args.plan) {
        plan.check_film(path, &store)?;
        for unit in &plan.units {
            if !plan.is_done(unit, &store)?.0 {
                to_do.insert(unit.unit);
            }
        }
        if args.missing {
            if !to_do.is_empty() {
                print(list::show(&to_do));
            }
            return Ok(if args.check && !to_do.is_empty() { code::WRONG } else { 0 });
        }
    }
    let mut status = status(&store)?;
    if let Some(plan) = &plan {
        let (all, missing) = (plan.units.len(), list::show(&to_do));
        status["units"] = json!({ "all": all, "done": all - to_do.len(), "missing": missing });
    }
    match args.json {
        true => print(serde_json::to_string_pretty(&status)?),
        false => lines(&store, &status).iter().for_each(print),
    }
    let complete = status["complete"] == true;
    Ok(if args.check && !complete { code::WRONG } else { 0 })
}

fn status(store: &FilmStore) -> Result<Value> {
    let spec = store.spec();
    let mut bands: Vec<(u64, u64)> = vec![(0, 0); spec.wavelengths_nm.len()];
    let (mut missing, mut bytes) = (Vec::new(), 0);
    let shards: Vec<_> = store.every_shard().collect();
    for (&(output, band, shard), there) in std::iter::zip(&shards, store.shards_bytes(&shards)?) {
        bands[band].1 += 1;
        match there {
            Some(size) => {
                bands[band].0 += 1;
                bytes += size;
            }
            None => missing.push(store.key(output, band, shard)),
        }
    }
    let runs = store.runs()?;
    let sum = |key: &str| runs.iter().filter_map(|r| r.get(key)?.as_u64()).sum::<u64>();
    let wall_s = runs.iter().filter_map(|r| r.get("wall_s")?.as_f64()).fold(0.0, |sum, s| sum + s);
    let outcomes = |word: &str| runs.iter().filter(|r| r.get("outcome").is_some_and(|o| o == word)).count();
    let locks: Vec<Value> = FilmStore::locks(store.path())?.into_iter().map(lock).collect();
    let provenance = store.provenance();
    let of = |key: &str| provenance.get(key).cloned().unwrap_or_default();
    let all: u64 = bands.iter().map(|b| b.1).sum();
    Ok(json!({
        "film": json_path(store.path()),
        "complete": missing.is_empty(),
        "shards": all,
        "shards_done": all - missing.len() as u64,
        "bytes": bytes,
        "film_size": [spec.film.height, spec.film.width],
        "outputs": spec.outputs.iter().map(|o| &o.name).collect::<Vec<_>>(),
        "bands": std::iter::zip(&spec.wavelengths_nm, &bands).enumerate().map(|(band, (nm, (done, all)))| {
            json!({ "band": band, "wavelength_nm": nm, "shards": all, "shards_done": done })
        }).collect::<Vec<_>>(),
        "runs": {
            "complete": outcomes("complete"),
            "interrupted": outcomes("interrupted"),
            "failed": outcomes("failed"),
            "wall_s": wall_s,
            "tiles": sum("tiles"),
            "shards": sum("shards"),
        },
        "last_run": runs.last().map(|r| pick(r, &["finished_unix_s", "outcome", "error", "wall_s"])),
        "locks": locks,
        "pyramid": store.pyramid()?.name(),
        "program": of("program"),
        "engine": store.engine(),
        "engines": store.engines()?,
        "job_digest": of("job_digest"),
        "layout_digest": of("layout_digest"),
        "job": of("job"),
        "layout": of("layout"),
        "missing": missing,
    }))
}

fn pick(run: &Map<String, Value>, keys: &[&str]) -> Map<String, Value> {
    keys.iter().filter_map(|k| Some(((*k).to_owned(), run.get(*k)?.clone()))).collect()
}

fn lock((path, owner, dead): (std::path::PathBuf, Option<Box<Owner>>, Option<bool>)) -> Value {
    let alive = dead.map(|dead| !dead);
    json!({ "path": json_path(&path), "owner": owner, "alive": alive })
}

fn store_engines(s: &Value) -> Vec<&str> {
    s["engines"].as_array().into_iter().flatten().filter_map(Value::as_str).collect()
}

fn lines(store: &FilmStore, s: &Value) -> Vec<String> {
    let n = |v: &Value| v.as_u64().unwrap_or(0);
    let words = |v: &Value| v.as_str().unwrap_or("unknown").to_owned();
    let short = |v: &Value| words(v).chars().take(12).collect::<String>();
    let job = &s["job"];
    let on = |stage: &&str| job["stages"][*stage] == true;
    let stages: Vec<&str> = ["ri", "distortion", "svpsf"].into_iter().filter(on).collect();
    let mut lines = vec![
        format!(
            "{}: {}",
            store.path().display(),
            if s["complete"] == true { "complete" } else { "incomplete; the same `lenscube run` goes on" }
        ),
        format!(
            "  job     {} through {} ({}), film {} px of {} µm, {} bands; digest {}, layout {}",
            words(&s["program"]),
            words(&job["lens_name"]),
            stages.join(", "),
            store.spec().film,
            store.spec().pitch_um,
            store.spec().wavelengths_nm.len(),
            short(&s["job_digest"]),
            short(&s["layout_digest"])
        ),
        format!(
            "  shards  {} of {} ({:.1} %), {:.3} GB",
            n(&s["shards_done"]),
            n(&s["shards"]),
            100.0 * n(&s["shards_done"]) as f64 / n(&s["shards"]).max(1) as f64,
            n(&s["bytes"]) as f64 * 1e-9
        ),
    ];
    lines.push(match store_engines(s)[..] {
        [one] => format!("  engine  {one}"),
        ref several => format!("  engines {}: mixed, up to 2e-6 of the peak apart", several.join(", ")),
    });
    let bands = s["bands"].as_array().map_or(&[][..], Vec::as_slice);
    let of = |keep: &dyn Fn(u64, u64) -> bool| -> Vec<&Value> {
        bands.iter().filter(|b| keep(n(&b["shards_done"]), n(&b["shards"]))).collect()
    };
    let part = of(&|done, all| 0 < done && done < all);
    let parts: Vec<String> = part
        .iter()
        .take(NAMED)
        .map(|b| {
            format!(
                "{} nm: {} of {}",
                b["wavelength_nm"].as_f64().unwrap_or(f64::NAN),
                n(&b["shards_done"]),
                n(&b["shards"])
            )
        })
        .collect();
    lines.push(format!(
        "  bands   {} complete, {} in part{}, {} not begun",
        of(&|done, all| done == all).len(),
        part.len(),
        if parts.is_empty() { String::new() } else { format!(" ({})", parts.join(", ")) },
        of(&|done, _| done == 0).len()
    ));
    let missing = s["missing"].as_array().map_or(&[][..], Vec::as_slice);
    if !missing.is_empty() {
        let named: Vec<&str> = missing.iter().take(NAMED).filter_map(Value::as_str).collect();
        let more = missing.len() - named.len();
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        lines.push(format!("  missing {}{more}", named.join(", ")));
    }
    if let Some(units) = s.get("units") {
        let missing = words(&units["missing"]);
        let missing = if missing.is_empty() { missing } else { format!("; missing {missing}") };
        lines.push(format!("  units   {} of {}{missing}", units["done"], units["all"]));
    }
    match words(&s["pyramid"]).as_str() {
        "none" => (),
        "complete" => lines.push("  pyramid complete".into()),
        "stale" => {
            lines.push("  pyramid of other pixels than the film has; `lenscube pyramid` makes it anew".into())
        }
        _ => lines.push("  pyramid unfinished; `lenscube pyramid` goes on".into()),
    }
    let runs = &s["runs"];
    lines.push(format!(
        "  runs    {} complete, {} interrupted, {} failed: {:.1} s, {} tiles (a killed run leaves no record)",
        n(&runs["complete"]),
        n(&runs["interrupted"]),
        n(&runs["failed"]),
        runs["wall_s"].as_f64().unwrap_or(0.0),
        runs["tiles"]
    ));
    if let Some(error) = s["last_run"]["error"].as_str() {
        lines.push(format!("  last    failed: {error}"));
    }
    for lock in s["locks"].as_array().map_or(&[][..], Vec::as_slice) {
        let alive = match lock["alive"].as_bool() {
            Some(true) => "runs",
            Some(false) => "is dead; the next run takes over",
            None => "may run; if not, --take-over",
        };
        let owner = &lock["owner"];
        lines.push(format!(
            "  lock    {}: process {} of host {} {alive}",
            words(&owner["unit"]),
            owner["pid"],
            words(&owner["host"])
        ));
    }
    lines
}
