//! The part of a planned job that a process does: its units, its flags, and whether what it finds is what was planned.

use super::film;
use crate::args::{RunArgs, RunCommand};
use crate::failure::other_job;
use crate::job::{Job, NUMERIC_VERSION};
use crate::plan;
use crate::plan::file::Plan;
use crate::plan::list;
use crate::plan::words::Words;
use crate::progress::say;
use anyhow::Result;
use formats::durable::{Lock, LockError};
use formats::film::{FilmError, FilmStore};
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::PathBuf;

/// Longest list of units that is a lock's name as it stands; file names have 255 bytes.
const NAME: usize = 64;

/// Units of a plan.
pub struct Units {
    path: PathBuf,
    plan: Plan,
    /// First digits of the plan's digest.
    pub name: String,
    list: BTreeSet<usize>,
}

impl Units {
    /// The plan at `path` and its units `unit`, all if none are named.
    ///
    /// # Errors
    /// No plan; a plan of a program that gives other pixels; units that it does not have.
    pub fn read(path: PathBuf, unit: Option<&str>) -> Result<Self> {
        let (plan, name) = Plan::read(&path)?;
        let planned = plan.job.get("numeric_version").and_then(Value::as_u64);
        if planned != Some(u64::from(NUMERIC_VERSION)) {
            return Err(other_job(format!(
                "{} was made by {}, numeric version {}; this is {}, numeric version {NUMERIC_VERSION}, which gives other \
                 pixels: do all units by that program, or plan a new film by this one",
                path.display(),
                plan.program,
                planned.map_or("unknown".into(), |v| v.to_string()),
                concat!("lenscube ", env!("CARGO_PKG_VERSION")),
            )));
        }
        let count = plan.units.len();
        let list = unit.map_or_else(|| Ok((0..count).collect()), |text| list::parse(text, count))?;
        Ok(Self { path, plan, name, list })
    }

    /// The units as a list.
    pub fn listed(&self) -> String {
        list::show(&self.list)
    }

    /// The planned flags, and those of this process on top.
    ///
    /// # Errors
    /// Flags that exclude each other.
    pub fn args(&self, typed: &RunCommand) -> Result<RunArgs> {
        plan::no_pyramid(&typed.job)?;
        let args = self.plan.command.parse(&Words::typed()?)?;
        Ok(RunArgs { take_over: typed.job.take_over, ..args })
    }

    /// The job with the bands of these units.
    ///
    /// # Errors
    /// As [`Job::new`]; what is here is not what was planned (exit code 3).
    pub fn job(&self, args: &RunArgs) -> Result<Job> {
        let bands = self.plan.bands(&self.list);
        let job = Job::of(args, Some(self.plan.part(&bands)))?;
        let layout = film::layout(&job.film);
        let differ = film::not_planned((&self.plan.job, &self.plan.layout), (&job.identity, &layout), args);
        match differ {
            None => Ok(job),
            Some(words) => Err(other_job(format!(
                "what is here is not what {} planned: {words}; bring the planned thing back, or plan a new film",
                self.path.display()
            ))),
        }
    }

    /// Opens the planned film.
    ///
    /// # Errors
    /// It is not there, or another (exit code 3).
    pub fn film(&self, args: &RunArgs) -> Result<FilmStore> {
        let store = FilmStore::open(&args.film, !args.no_fsync).map_err(|e| match e {
            FilmError::NotFilm { .. } => {
                other_job(format!("{e}; `lenscube plan` creates the film of {}", self.path.display()))
            }
            e => e.into(),
        })?;
        self.plan.check_film(&self.path, &store)?;
        Ok(store)
    }

    /// The shards of these units, if all of them are in the film.
    ///
    /// # Errors
    /// The store does not answer.
    pub fn all_done(&self, film: &FilmStore) -> Result<Option<usize>> {
        let mut shards = 0;
        for unit in &self.list {
            let (done, its) = self.plan.is_done(&self.plan.units[*unit], film)?;
            shards += its;
            if !done {
                return Ok(None);
            }
        }
        Ok(Some(shards))
    }

    /// Whether a shard, by array of the film, band of the film and shard row, is of these units.
    pub fn has(&self, output: &str, band: usize, row: usize) -> bool {
        self.list.iter().any(|u| self.plan.units[*u].has(output, band, row))
    }

    /// Tells others which units are being done. Another process at the same units does no harm, both write the same bytes, so
    /// none waits for the other: one that was lost may be followed before anybody knows.
    ///
    /// # Errors
    /// The files.
    pub fn lock(&self, store: &FilmStore) -> Result<Option<Lock>> {
        let listed = match self.listed() {
            long if long.len() > NAME => blake3::hash(long.as_bytes()).to_hex()[..16].to_owned(),
            short => short,
        };
        match store.lock(&format!("units-{}-{listed}", self.name), true) {
            Ok(lock) => Ok(lock),
            Err(FilmError::Locked(held @ (LockError::Held { .. } | LockError::Elsewhere { .. }))) => {
                say(format!("note: {held}; working on all the same, both write the same bytes"));
                Ok(None)
            }
            Err(other) => Err(other.into()),
        }
    }
}
