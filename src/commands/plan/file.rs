//! The plan file: readable JSON, one line per unit, and the digest of all other lines.

use super::command_line::CommandLine;
use crate::failure::{code, exit_code, other_job, usage};
use crate::outputs::Guard;
use anyhow::{Context, Result};
use formats::durable::{Directory, check_writable, link_target, parent_of, read_file_at_most};
use formats::film::FilmStore;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Schema of a plan file.
const SCHEMA: &str = "lenscube/plan/1";
/// Digits of the digest in the name of a plan.
const NAME_DIGITS: usize = 12;
/// Maximum size of a plan file: a million units have 400 MB.
const MAX_BYTES: u64 = 1 << 30;

/// A job and its units.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// [`SCHEMA`].
    pub schema: String,
    /// Program and version that wrote it.
    pub program: String,
    /// The command line of the job.
    pub command: CommandLine,
    /// Digest of `job`.
    pub job_digest: String,
    /// Digest of `layout`.
    pub layout_digest: String,
    /// The engine of the film, used by all workers; empty in plans of earlier versions.
    #[serde(default)]
    pub engine: String,
    /// Everything that changes pixels, as in the film's attributes.
    pub job: Map<String, Value>,
    /// What changes only the film's files, as in the film's attributes.
    pub layout: Value,
    /// Digest of the lens in each band, independent of the other bands.
    pub lens_bands: Vec<String>,
    /// Bins of the layer of tails by band, film pixels; empty without one.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tail_bins_px: Vec<usize>,
    /// Wavelength of each band, nm.
    pub wavelengths_nm: Vec<f64>,
    /// The film's arrays and their shards.
    pub outputs: BTreeMap<String, Shards>,
    /// Sums over the units; the largest of `gpu_bytes`.
    pub totals: Totals,
    /// The units, in order of their numbers.
    pub units: Vec<Unit>,
}

/// Shards of an array.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Shards {
    /// Shard rows.
    pub rows: usize,
    /// Shard columns.
    pub columns: usize,
}

/// Cost of a unit, or of all.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Totals {
    /// Shards to write.
    pub shards: usize,
    /// Tiles of source pixels to compute.
    pub tiles: usize,
    /// Of them, tiles that an earlier unit computes as well.
    pub tiles_again: usize,
    /// Bytes of chart to read, before compression.
    pub bytes_read: u64,
    /// Bytes of film to write, before compression.
    pub bytes_written: u64,
    /// Estimated core seconds.
    pub core_s: f64,
    /// Estimated memory on a GPU, bytes.
    pub gpu_bytes: u64,
}

/// A part of the job for one process.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Unit {
    /// Number of the unit.
    pub unit: usize,
    /// Bands of the film.
    pub bands: Vec<usize>,
    /// Shard rows (first, end) by array of the film.
    pub rows: BTreeMap<String, (usize, usize)>,
    /// Its cost.
    #[serde(flatten)]
    pub cost: Totals,
}

impl Plan {
    /// The text of the file, and its digest.
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
        // As the second line, after the brace.
        (text.replacen("{\n", &format!("{{\n{}", digest_line(&digest)), 1), digest)
    }

    /// Path of the file: `output`, or a name from the digest if that is a directory.
    fn path(&self, output: &Path) -> PathBuf {
        match output.is_dir() {
            true => output.join(format!("plan-{}.json", &self.text().1[..NAME_DIGITS])),
            false => link_target(output),
        }
    }

    /// Whether this plan exists at `output`.
    ///
    /// # Errors
    /// Another file exists there (exit code 3).
    pub fn check_output(&self, output: &Path) -> Result<bool> {
        let path = self.path(output);
        let name = path.file_name().and_then(|n| n.to_str()).context("the plan's file name is not UTF-8")?;
        match Directory::new(parent_of(&path)).read_at_most(name, MAX_BYTES)? {
            Some(existing) if existing == self.text().0.as_bytes() => Ok(true),
            None if path.symlink_metadata().is_err() => Ok(false),
            _ => Err(other_file(&path)),
        }
    }

    /// Writes the file, unless it exists; its path.
    ///
    /// # Errors
    /// Another file exists there (exit code 3); the disk.
    pub fn write(&self, output: &Path) -> Result<PathBuf> {
        let path = self.path(output);
        if !self.check_output(output)? {
            let name =
                path.file_name().and_then(|n| n.to_str()).context("the plan's file name is not UTF-8")?;
            Directory::new(parent_of(&path)).write(name, self.text().0.as_bytes())?;
        }
        Ok(path)
    }

    /// Reads a plan; its name is the first digits of its digest.
    ///
    /// # Errors
    /// Missing; not a plan, or an edited one (exit code 3); a FIFO or device (2).
    pub fn read(path: &Path) -> Result<(Self, String)> {
        Guard::default().reads("plan", path).check()?;
        let shown = path.display();
        let not_plan = |what: &str| {
            other_job(format!(
                "{shown} is not a plan file written by `lenscube plan` ({what}); make it again"
            ))
        };
        let bytes = read_file_at_most(path, MAX_BYTES)
            .with_context(|| format!("reading the plan {shown}"))?
            .ok_or_else(|| not_plan(&format!("it is larger than {MAX_BYTES} bytes")))?;
        let text = String::from_utf8(bytes).map_err(|_| not_plan("it is not UTF-8"))?;
        let line = text.lines().nth(1).unwrap_or_default();
        let recorded = line.trim().strip_prefix("\"digest\": \"").and_then(|l| l.strip_suffix("\","));
        let recorded = recorded.ok_or_else(|| not_plan("its second line is not a digest"))?;
        let rest = text.replacen(&digest_line(recorded), "", 1);
        let computed = blake3::hash(rest.as_bytes()).to_hex().to_string();
        if computed != recorded {
            return Err(not_plan("its digest does not match: the file was edited or truncated"));
        }
        let plan: Self = serde_json::from_str(&rest).map_err(|e| not_plan(&e.to_string()))?;
        if plan.schema != SCHEMA {
            return Err(not_plan(&format!("schema {:?}, expected {SCHEMA:?}", plan.schema)));
        }
        Ok((plan, computed[..NAME_DIGITS].to_owned()))
    }

    /// Schema of the plans that this version writes.
    pub fn schema() -> String {
        SCHEMA.to_owned()
    }

    /// Whether all shards of a unit and the layers of light of its bands are present in the film, and the number of its shards.
    ///
    /// # Errors
    /// The store cannot be read; an array of the plan is missing in the film.
    pub fn is_done(&self, unit: &Unit, film: &FilmStore) -> Result<(bool, usize)> {
        let mut shards = Vec::new();
        for (output, (first, end)) in &unit.rows {
            let index = film.spec().outputs.iter().position(|o| o.name == *output);
            let index = index.with_context(|| format!("{} has no array {output}", film.path().display()))?;
            let columns = film.shards(index).1;
            let places = (*first..*end).flat_map(|row| (0..columns).map(move |col| (row, col)));
            shards.extend(places.flat_map(|place| unit.bands.iter().map(move |&band| (index, band, place))));
        }
        // Shards in one call: remote stores are queried concurrently.
        let done = film.shards_bytes(&shards)?.iter().all(Option::is_some) && film.has_layers(&unit.bands)?;
        Ok((done, shards.len()))
    }

    /// Fails (exit code 3) unless `film` is the film of this plan; `path` is that of the plan.
    pub fn check_film(&self, path: &Path, film: &FilmStore) -> Result<()> {
        let recorded = |key: &str| film.provenance().get(key).and_then(Value::as_str).unwrap_or_default();
        let planned = [
            ("job_digest", &self.job_digest),
            ("layout_digest", &self.layout_digest),
            ("engine", &self.engine),
        ];
        for (key, planned) in planned {
            if recorded(key) != planned {
                return Err(other_job(format!(
                    "{} is not the film of {}: {key} in the film {:.12}, planned {planned:.12}",
                    film.path().display(),
                    path.display(),
                    recorded(key)
                )));
            }
        }
        Ok(())
    }

    /// Bands of `units`, ascending.
    pub fn bands(&self, units: &BTreeSet<usize>) -> Vec<usize> {
        let bands: BTreeSet<usize> =
            units.iter().flat_map(|u| self.units[*u].bands.iter().copied()).collect();
        bands.into_iter().collect()
    }
}

impl Unit {
    /// Whether the unit contains shard row `row` of array `output` in `band`.
    pub fn contains(&self, output: &str, band: usize, row: usize) -> bool {
        self.bands.contains(&band)
            && self.rows.get(output).is_some_and(|(first, end)| (*first..*end).contains(&row))
    }
}

/// Fails if a plan cannot be written to `output`; called before the plan is made.
///
/// # Errors
/// Usage: directory missing or not writable; a file that is not a plan exists there (exit code 3).
pub fn check_place(output: &Path) -> Result<()> {
    let output = &link_target(output);
    let directory = if output.is_dir() { output } else { parent_of(output) };
    if !directory.is_dir() {
        return Err(usage(format!(
            "--output {}: directory {} does not exist",
            output.display(),
            directory.display()
        )));
    }
    check_writable(directory)?;
    if !output.is_dir() && output.symlink_metadata().is_ok() {
        Plan::read(output).map_err(|e| match exit_code(&e) {
            code::OTHER_JOB => other_file(output),
            _ => e,
        })?;
    }
    Ok(())
}

fn other_file(path: &Path) -> anyhow::Error {
    other_job(format!(
        "another file exists at {}; a plan is not changed once written: choose another name",
        path.display()
    ))
}

fn digest_line(digest: &str) -> String {
    format!("  \"digest\": \"{digest}\",\n")
}
