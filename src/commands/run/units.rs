//! Units of a plan that a process computes: its arguments, and checks that chart, lens and film are those of the plan.

use crate::args::RunArgs;
use crate::commands::plan::{self, CommandLine, Plan, unit_list};
use crate::failure::other_job;
use crate::film;
use crate::job::{Job, numeric_version};
use crate::progress::log_line;
use anyhow::Result;
use formats::durable::{Lock, LockError};
use formats::film::FilmStore;
use formats::group::GroupError;
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::PathBuf;

/// Longest list of units in the name of a lock, bytes; a longer one is hashed, since file names have 255 bytes.
const MAX_LIST_BYTES: usize = 64;

/// Units of a plan.
pub struct Units {
    /// The plan's file.
    pub path: PathBuf,
    plan: Plan,
    /// First digits of the plan's digest.
    pub name: String,
    list: BTreeSet<usize>,
}

impl Units {
    /// Reads the plan at `path`; `unit` lists the units, all if `None`.
    ///
    /// # Errors
    /// Not a plan; a plan of a program with other numerics; units that it does not have.
    pub fn read(path: PathBuf, unit: Option<&str>) -> Result<Self> {
        let (plan, name) = Plan::read(&path)?;
        let planned = plan.job.get("numeric_version").and_then(Value::as_u64);
        let computed = numeric_version(plan.job.contains_key("depth"));
        if planned != Some(u64::from(computed)) {
            return Err(other_job(format!(
                "{} was made by {}, numeric version {}; this is {}, numeric version {computed}, which computes \
                 other pixels: compute all units with that program, or plan a new film with this one",
                path.display(),
                plan.program,
                planned.map_or("unknown".into(), |v| v.to_string()),
                concat!("lenscube ", env!("CARGO_PKG_VERSION")),
            )));
        }
        let count = plan.units.len();
        let list = unit.map_or_else(|| Ok((0..count).collect()), |text| unit_list::parse(text, count))?;
        Ok(Self { path, plan, name, list })
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// The units as a list.
    pub fn listed(&self) -> String {
        unit_list::format(&self.list)
    }

    /// The planned arguments; those given to this process (`given`, as parsed in `own`) take precedence.
    ///
    /// # Errors
    /// Flags that exclude each other.
    pub fn args(&self, own: &RunArgs, given: &CommandLine) -> Result<RunArgs> {
        plan::reject_pyramid(own)?;
        Ok(RunArgs { process: own.process, ..self.plan.command.parse(given)? })
    }

    /// The job with the bands of these units.
    ///
    /// # Errors
    /// As [`Job::for_planned_bands`]; chart, lens or arguments differ from the plan (exit code 3).
    pub fn job(&self, args: &RunArgs) -> Result<Job> {
        let bands = self.plan.bands(&self.list);
        let job = Job::for_planned_bands(args, self.plan.planned_bands(&bands))?;
        let layout = film::layout(&job.film);
        let differences =
            film::differences_from_plan((&self.plan.job, &self.plan.layout), (&job.identity, &layout), args);
        match differences {
            None => Ok(job),
            Some(differences) => Err(other_job(format!(
                "the job differs from the plan {}: {differences}; restore what was planned, or plan a new film",
                self.path.display()
            ))),
        }
    }

    /// Opens the planned film.
    ///
    /// # Errors
    /// Missing, or another film (exit code 3).
    pub fn film(&self, args: &RunArgs) -> Result<FilmStore> {
        let hint = format!("; `lenscube plan` creates the film of {}", self.path.display());
        let store = film::open_store(args, &hint)?;
        self.plan.check_film(&self.path, &store)?;
        Ok(store)
    }

    /// Number of shards of these units if all of them are in the film.
    ///
    /// # Errors
    /// The store cannot be read.
    pub fn completed_shards(&self, film: &FilmStore) -> Result<Option<usize>> {
        let mut shards = 0;
        for unit in &self.list {
            let (done, count) = self.plan.is_done(&self.plan.units[*unit], film)?;
            shards += count;
            if !done {
                return Ok(None);
            }
        }
        Ok(Some(shards))
    }

    /// Whether one of the units contains shard row `row` of array `output` in band `band` of the film.
    pub fn contains(&self, output: &str, band: usize, row: usize) -> bool {
        self.list.iter().any(|u| self.plan.units[*u].contains(output, band, row))
    }

    /// Locks the units, for `lenscube status`. `None` if another process holds the lock: both compute the units and write the same
    /// bytes, so that a lost process blocks no other.
    ///
    /// # Errors
    /// The lock file cannot be written.
    pub fn lock(&self, store: &FilmStore) -> Result<Option<Lock>> {
        let listed = match self.listed() {
            long if long.len() > MAX_LIST_BYTES => blake3::hash(long.as_bytes()).to_hex()[..16].to_owned(),
            short => short,
        };
        match store.group().lock(&format!("units-{}-{listed}", self.name), true) {
            Ok(lock) => Ok(lock),
            Err(GroupError::Locked(held @ (LockError::Held { .. } | LockError::Elsewhere { .. }))) => {
                log_line(format!("note: {held}; computing these units as well, both write the same bytes"));
                Ok(None)
            }
            Err(other) => Err(other.into()),
        }
    }
}
