//! `lenscube status`: progress of a film, without reading pixels.

mod report;
mod text;

use crate::args::StatusArgs;
use crate::failure::{Coded, code};
use crate::plan::{Plan, unit_list};
use crate::progress::print;
use anyhow::{Context, Result};
use formats::film::FilmStore;
use formats::group::GroupError;
use report::{Status, UnitStatus};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Opens a film to report on it: a missing film is a failure (exit code 1), a damaged one a finding (4).
///
/// # Errors
/// As described; the store cannot be read.
pub fn open(path: &Path) -> Result<FilmStore> {
    opened(FilmStore::open(path, true))
}

/// As [`open`], of a film that was opened otherwise.
///
/// # Errors
/// As [`open`].
pub fn opened(film: Result<FilmStore, GroupError>) -> Result<FilmStore> {
    film.map_err(|e| {
        let code = match &e {
            GroupError::Damaged { .. } | GroupError::ArrayMetadata { .. } | GroupError::Attributes { .. } => {
                code::WRONG
            }
            GroupError::NotOfKind { .. } => code::FAILED,
            _ => return e.into(),
        };
        Coded { code, message: e.to_string() }.into()
    })
}

/// Runs the command; the exit code.
pub fn command(args: &StatusArgs) -> Result<u8> {
    if let Some(code) = crate::sensor::check::status(args)? {
        return Ok(code);
    }
    let plan = args.plan.as_deref().map(Plan::read).transpose()?.map(|(plan, _)| plan);
    let planned_film = || plan.as_ref().and_then(|p| p.command.film.as_ref()).map(PathBuf::from);
    let film = args.film.clone().or_else(planned_film).context("the plan contains no film")?;
    let store = open(&film)?;
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
