//! `lenscube status`: progress of a film, raw or scene, without reading pixels.

mod other;
mod report;
mod text;

use crate::args::StatusArgs;
use crate::commands::plan::{Plan, unit_list};
use crate::failure::code;
use crate::film::reported;
use crate::progress::print;
use anyhow::{Context, Result};
use formats::film::FilmStore;
use report::{Status, UnitStatus};
use std::collections::BTreeSet;
use std::path::PathBuf;

/// Runs the command; the exit code.
pub fn command(args: &StatusArgs) -> Result<u8> {
    if let Some(code) = other::status(args)? {
        return Ok(code);
    }
    let plan = args.plan.as_deref().map(Plan::read).transpose()?.map(|(plan, _)| plan);
    let planned_film = || plan.as_ref().and_then(|p| p.command.film.as_ref()).map(PathBuf::from);
    let film = args.film.clone().or_else(planned_film).context("the plan contains no film")?;
    let store = reported::opened_of_kinds("a film, raw or scene", FilmStore::open(&film, true))?;
    let mut units = None;
    if let (Some(plan), Some(path)) = (&plan, &args.plan) {
        plan.check_film(path, &store)?;
        let missing = missing_units(plan, &store)?;
        if args.missing {
            if !missing.is_empty() {
                print(unit_list::format(&missing));
            }
            return Ok(if args.check && !missing.is_empty() { code::WRONG } else { 0 });
        }
        units = Some(UnitStatus::new(plan.units.len(), &missing));
    }
    let mut status = Status::new(&store)?;
    status.units = units;
    match args.json {
        true => print(serde_json::to_string_pretty(&status)?),
        false => text::lines(&store, &status).iter().for_each(print),
    }
    Ok(if args.check && !status.complete { code::WRONG } else { 0 })
}

fn missing_units(plan: &Plan, store: &FilmStore) -> Result<BTreeSet<usize>> {
    let mut missing = BTreeSet::new();
    for unit in &plan.units {
        if !plan.is_done(unit, store)?.0 {
            missing.insert(unit.unit);
        }
    }
    Ok(missing)
}
