//! `verify --repair`, the same of films and raws.

use crate::progress::{log_line, plural, print};
use anyhow::Result;
use formats::durable::{DurableError, Lock, remove_temp};
use formats::group::{Finding, GroupError, JobGroup, VerifyReport};

/// What `--repair` did.
#[derive(Default)]
pub struct Repair {
    /// Bad shards removed.
    pub shards: usize,
    /// Temporary files removed.
    pub temp: usize,
    /// Coordinates whose values were written again.
    pub coordinates: usize,
    /// Metadata files written again.
    pub metadata: usize,
}

/// A film or raw.
pub struct Target<'a> {
    /// Its files.
    pub group: &'a JobGroup,
    /// Removes a bad shard; whether it did.
    pub remove_bad: &'a dyn Fn(&str) -> Result<bool, GroupError>,
    /// Writes a file that follows from the attributes again; whether it did.
    pub restore: &'a dyn Fn(&str) -> Result<bool, GroupError>,
}

/// Removes bad shards, writes metadata and coordinates again that follow from the attributes, and removes temporary files except those of
/// live processes of this host. Files of processes that cannot be looked up remain as long as a unit is locked that is not in `locked`: its
/// worker may be writing them.
pub fn repair(target: &Target<'_>, verdict: &VerifyReport, locked: &[Lock]) -> Result<Repair> {
    let mut done = Repair::default();
    // Wrong attributes determine nothing.
    let are_attributes_intact = !verdict.findings.iter().any(|f| matches!(f, Finding::Attributes { .. }));
    let mut differing = Vec::new();
    for finding in &verdict.findings {
        match finding {
            Finding::Bad { key, .. } => done.shards += usize::from((target.remove_bad)(key)?),
            Finding::Metadata { key, .. } if are_attributes_intact => differing.push(key.as_str()),
            _ => {}
        }
    }
    // The group's own metadata, which list all others, last.
    differing.sort_by_key(|key| *key == "zarr.json");
    differing.dedup();
    for key in differing {
        let count = if key.ends_with("zarr.json") { &mut done.metadata } else { &mut done.coordinates };
        *count += usize::from((target.restore)(key)?);
    }
    let locks = JobGroup::locks(target.group.path())?;
    let others = locks.iter().any(|(path, ..)| !locked.iter().any(|lock| lock.path() == path));
    for (path, dead) in &verdict.temp {
        if *dead == Some(true) || (dead.is_none() && !others) {
            match remove_temp(path) {
                Ok(()) => done.temp += 1,
                // A file of another user; it does not affect the film or raw.
                Err(e @ DurableError::Permission { .. }) => log_line(format!("note: {e}")),
                Err(e) => return Err(e.into()),
            }
        }
    }
    Ok(done)
}

/// Prints what was written again, and what can be done about the rest; `command` makes the film or raw.
pub fn print_restored(done: &Repair, verdict: &VerifyReport, command: &str) {
    if done.coordinates > 0 {
        log_line(format!("wrote {} again", plural(done.coordinates, "damaged coordinate")));
    }
    if done.metadata > 0 {
        log_line(format!("wrote {} again", plural(done.metadata, "damaged metadata file")));
    }
    if verdict.findings.iter().any(|f| matches!(f, Finding::Attributes { .. })) {
        print(format!(
            "the attributes in zarr.json cannot be repaired: restore that file from a copy, or `lenscube {command} … --overwrite` computes all of it anew"
        ));
    }
}
