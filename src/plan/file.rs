//! The plan on disk: JSON that a person can read, one line a unit, with the digest of all its other lines.

use super::words::Words;
use crate::failure::{other_job, usage};
use anyhow::{Context, Result};
use formats::durable::{Directory, check_writable, link_target, parent_of};
use formats::film::FilmStore;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// What marks a file as a plan of ours.
const SCHEMA: &str = "lenscube/plan/1";
/// Digits of the digest that name a plan.
const NAMED: usize = 12;
/// A plan of a million units would have 400 MB.
const LARGEST: u64 = 1 << 30;

/// What is to be done, and by which units.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// [`SCHEMA`].
    pub schema: String,
    /// Who made it.
    pub program: String,
    /// The command that it cuts.
    pub command: Words,
    /// Digest of `job`.
    pub job_digest: String,
    /// Digest of `layout`.
    pub layout_digest: String,
    /// The engine of the film, which its workers use; empty in plans of earlier programs.
    #[serde(default)]
    pub engine: String,
    /// All that changes pixels, as the film tells it.
    pub job: Map<String, Value>,
    /// What changes the film's files only, as the film tells it.
    pub layout: Value,
    /// The digest of each band's lens, whatever the other bands.
    pub lens_bands: Vec<String>,
    /// Wavelength of each band.
    pub wavelengths_nm: Vec<f64>,
    /// The film's arrays and their shards.
    pub outputs: BTreeMap<String, Shards>,
    /// Sums over the units; the largest of `gpu_bytes`.
    pub totals: Totals,
    /// The units, by number.
    pub units: Vec<Unit>,
}

/// Shards of an array.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Shards {
    /// Down.
    pub rows: usize,
    /// Across.
    pub columns: usize,
}

/// What some work costs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Totals {
    /// Shards to write.
    pub shards: usize,
    /// Tiles of source pixels to compute.
    pub tiles: usize,
    /// Of them, those that an earlier unit computes as well.
    pub tiles_again: usize,
    /// Bytes of chart to read, before compression.
    pub bytes_read: u64,
    /// Bytes of film to write, before compression.
    pub bytes_written: u64,
    /// Estimated seconds of one core.
    pub core_s: f64,
    /// Estimated memory on a GPU.
    pub gpu_bytes: u64,
}

/// A part that one worker does.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Unit {
    /// Its number.
    pub unit: usize,
    /// Bands of the film.
    pub bands: Vec<usize>,
    /// Shard rows, first and end, by array of the film.
    pub rows: BTreeMap<String, (usize, usize)>,
    /// What it costs.
    #[serde(flatten)]
    pub cost: Totals,
}

impl Plan {
    /// The plan as it is written, and its digest.
    pub fn text(&self) -> (String, String) {
        let mut whole = serde_json::to_value(self).expect("a plan is JSON");
        let map = whole.as_object_mut().expect("a struct is an object");
        let units = map.remove("units").expect("a field of it");
        let lines: Vec<String> =
            units.as_array().into_iter().flatten().map(|unit| format!("    {unit}")).collect();
        let head = serde_json::to_string_pretty(&whole).expect("JSON is text");
        let head = head.strip_suffix("\n}").expect("it ends with its brace");
        let text = format!("{head},\n  \"units\": [\n{}\n  ]\n}}\n", lines.join(",\n"));
        let digest = blake3::hash(text.as_bytes()).to_hex().to_string();
        // The second line, after the brace.
        (text.replacen("{\n", &format!("{{\n{}", digest_line(&digest)), 1), digest)
    }

    /// Where it goes: `output`, or a file named by its digest in that directory.
    fn place(&self, output: &Path) -> PathBuf {
        match output.is_dir() {
            true => output.join(format!("plan-{}.json", &self.text().1[..NAMED])),
            false => link_target(output),
        }
    }

    /// Whether this very plan is at `output` already.
    ///
    /// # Errors
    /// Another file is there (exit code 3).
    pub fn check_output(&self, output: &Path) -> Result<bool> {
        let path = self.place(output);
        let name = path.file_name().and_then(|n| n.to_str()).context("the plan's name is no UTF-8")?;
        match Directory::new(parent_of(&path)).read_at_most(name, LARGEST)? {
            Some(there) if there == self.text().0.as_bytes() => Ok(true),
            None if path.symlink_metadata().is_err() => Ok(false),
            _ => Err(not_this(&path)),
        }
    }

    /// Writes it to `output`, or into that directory under its digest; the same plan there already is left as it is.
    ///
    /// # Errors
    /// Another file is there (exit code 3); the disk.
    pub fn write(&self, output: &Path) -> Result<PathBuf> {
        let path = self.place(output);
        if !self.check_output(output)? {
            let name = path.file_name().and_then(|n| n.to_str()).context("the plan's name is no UTF-8")?;
            Directory::new(parent_of(&path)).write(name, self.text().0.as_bytes())?;
        }
        Ok(path)
    }

    /// Reads a plan, and its name: the first digits of its digest.
    ///
    /// # Errors
    /// Nothing there; no plan; a plan that was edited (exit code 3).
    pub fn read(path: &Path) -> Result<(Self, String)> {
        let shown = path.display();
        let text = std::fs::read_to_string(path).with_context(|| format!("reading the plan {shown}"))?;
        let no = |what: &str| {
            other_job(format!("{shown} is no plan as `lenscube plan` writes it ({what}); make it again"))
        };
        let line = text.lines().nth(1).unwrap_or_default();
        let told = line.trim().strip_prefix("\"digest\": \"").and_then(|l| l.strip_suffix("\","));
        let told = told.ok_or_else(|| no("its second line is no digest"))?;
        let rest = text.replacen(&digest_line(told), "", 1);
        let own = blake3::hash(rest.as_bytes()).to_hex().to_string();
        if own != told {
            return Err(no("its digest does not fit: it was edited, or cut short"));
        }
        let plan: Self = serde_json::from_str(&rest).map_err(|e| no(&e.to_string()))?;
        if plan.schema != SCHEMA {
            return Err(no(&format!("schema {:?}, expected {SCHEMA:?}", plan.schema)));
        }
        Ok((plan, own[..NAMED].to_owned()))
    }

    /// The schema of the plans that this program writes.
    pub fn schema() -> String {
        SCHEMA.to_owned()
    }

    /// Whether all shards of a unit are in its film, and how many it has.
    ///
    /// # Errors
    /// The store does not answer; arrays that the film lacks.
    pub fn is_done(&self, unit: &Unit, film: &FilmStore) -> Result<(bool, usize)> {
        let mut asked = Vec::new();
        for (output, (first, end)) in &unit.rows {
            let known = film.spec().outputs.iter().position(|o| o.name == *output);
            let index = known.with_context(|| format!("{} has no array {output}", film.path().display()))?;
            let columns = film.shards(index).1;
            let places = (*first..*end).flat_map(|row| (0..columns).map(move |col| (row, col)));
            asked.extend(places.flat_map(|place| unit.bands.iter().map(move |&band| (index, band, place))));
        }
        // All at once: a store far away answers many questions together.
        Ok((film.shards_bytes(&asked)?.iter().all(Option::is_some), asked.len()))
    }

    /// Fails (exit code 3) unless the film is this plan's; `path` is where the plan lies.
    pub fn check_film(&self, path: &Path, film: &FilmStore) -> Result<()> {
        let told = |key: &str| film.provenance().get(key).and_then(Value::as_str).unwrap_or_default();
        let planned = [
            ("job_digest", &self.job_digest),
            ("layout_digest", &self.layout_digest),
            ("engine", &self.engine),
        ];
        for (key, planned) in planned {
            if told(key) != planned {
                return Err(other_job(format!(
                    "{} is not the film of {}: {key} there {:.12}, planned {planned:.12}",
                    film.path().display(),
                    path.display(),
                    told(key)
                )));
            }
        }
        Ok(())
    }

    /// Bands of these units, ascending.
    pub fn bands(&self, units: &BTreeSet<usize>) -> Vec<usize> {
        let bands: BTreeSet<usize> =
            units.iter().flat_map(|u| self.units[*u].bands.iter().copied()).collect();
        bands.into_iter().collect()
    }
}

impl Unit {
    /// Whether shard row `row` of array `output` of `band` is its own.
    pub fn has(&self, output: &str, band: usize, row: usize) -> bool {
        self.bands.contains(&band)
            && self.rows.get(output).is_some_and(|(first, end)| (*first..*end).contains(&row))
    }
}

/// Fails if no plan can be written to `output`, as far as that is known before the plan is made.
///
/// # Errors
/// Usage: its directory is not there or must not be written; a file that is no plan is there (exit code 3).
pub fn check_place(output: &Path) -> Result<()> {
    let output = &link_target(output);
    let directory = if output.is_dir() { output } else { parent_of(output) };
    if !directory.is_dir() {
        return Err(usage(format!(
            "--output {}: there is no directory {}",
            output.display(),
            directory.display()
        )));
    }
    check_writable(directory)?;
    if !output.is_dir() && output.symlink_metadata().is_ok() {
        Plan::read(output).map_err(|_| not_this(output))?;
    }
    Ok(())
}

fn not_this(path: &Path) -> anyhow::Error {
    other_job(format!(
        "{} exists and is not this plan; a plan does not change once written: choose another name",
        path.display()
    ))
}

fn digest_line(digest: &str) -> String {
    format!("  \"digest\": \"{digest}\",\n")
}
