//! Reads a data set back: every item has the length and the digest of its line.

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufRead, BufReader, ErrorKind, Read};
use std::path::Path;

use serde_json::{Map, Value};

use super::{ALL, DatasetError, DatasetSpec, DatasetStore, UNIT_DIGITS, ZARR, key, recorded};
use crate::dataset::recipe::Layout;
use crate::dataset::tar::entries;
use crate::dataset::zarr::samples;
use crate::durable::DurableError;

/// A missing or damaged part.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// missing or damaged.
    pub kind: &'static str,
    /// The unit's file or the item.
    pub key: String,
    /// Its unit; none of what all have in common.
    pub unit: Option<u64>,
}

/// Largest shard and item that are read, bytes.
const MAX_BYTES: u64 = 1 << 34;

impl DatasetStore {
    /// Opens the data set at `path`.
    ///
    /// # Errors
    /// [`DatasetError`]: there is none, or its record is damaged.
    pub fn open(path: &Path) -> Result<Self, DatasetError> {
        let fail = |problem: &str| DatasetError::Foreign { path: path.into(), problem: problem.into() };
        let record = recorded(path)?.ok_or_else(|| fail("expected a data set, found none"))?;
        let number = |name: &str| record[name].as_u64().filter(|n| *n > 0);
        let (Some(samples), Some(per_unit)) = (number("samples"), number("samples_per_unit")) else {
            return Err(fail("its record has no samples and samples_per_unit above 0"));
        };
        let layout = serde_json::from_value(record["as"].clone());
        let layout = layout.map_err(|_| fail("its record has `as` other than folders, tar and zarr"))?;
        let text = |name: &str| record[name].as_str().unwrap_or_default().to_owned();
        let spec = DatasetSpec {
            digest: text("digest"),
            samples,
            per_unit,
            layout,
            arrays: Vec::new(),
            attributes: Map::new(),
            record: record["record"].as_object().cloned().unwrap_or_default(),
        };
        Ok(Self { path: path.into(), files: super::opened(path)?, spec })
    }

    /// Checks `unit`; what is missing or damaged, and the bytes of its items.
    ///
    /// # Errors
    /// [`DatasetError::Storage`].
    pub fn verify_unit(&self, unit: u64) -> Result<(Vec<Finding>, u64), DatasetError> {
        let lines_key = super::lines_key(unit);
        if !self.has(unit)? {
            return Ok((vec![Finding { kind: "missing", key: lines_key, unit: Some(unit) }], 0));
        }
        let text = self.lines(unit)?;
        let parsed: Option<Vec<Value>> = text.lines().map(|line| serde_json::from_str(line).ok()).collect();
        let numbers = self.spec.of_unit(unit);
        let lines =
            parsed.filter(|lines| lines.iter().map(|line| line["sample"].as_u64()).eq(numbers.map(Some)));
        let Some(lines) = lines else {
            return Ok((vec![Finding { kind: "damaged", key: lines_key, unit: Some(unit) }], 0));
        };
        let (mut findings, mut bytes) = (Vec::new(), 0);
        let mut content = self.content(unit, &lines)?;
        for line in &lines {
            for (name, expected) in line["items"].as_object().into_iter().flatten() {
                let name = format!("{}.{name}", key(line["sample"].as_u64().unwrap_or_default()));
                let found = match self.spec.layout {
                    Layout::Folders => {
                        self.files.read_at_most(&format!("{unit:0UNIT_DIGITS$}/{name}"), MAX_BYTES)?
                    }
                    _ => content.remove(&name),
                };
                match found {
                    None => findings.push(Finding { kind: "missing", key: name, unit: Some(unit) }),
                    Some(found) => {
                        let digest = blake3::hash(&found).to_hex();
                        if Some(digest.as_str()) != expected["blake3"].as_str() {
                            findings.push(Finding { kind: "damaged", key: name, unit: Some(unit) });
                        }
                        bytes += found.len() as u64;
                    }
                }
            }
        }
        Ok((findings, bytes))
    }

    /// Removes the lines of `unit`, so that the same command makes it again.
    ///
    /// # Errors
    /// [`DatasetError::Storage`].
    pub fn forget(&self, unit: u64) -> Result<(), DatasetError> {
        self.files.remove(ALL)?;
        Ok(self.files.remove(&super::lines_key(unit))?)
    }

    /// Items of a unit that are in one file, by name; none of a damaged file.
    fn content(&self, unit: u64, lines: &[Value]) -> Result<HashMap<String, Vec<u8>>, DatasetError> {
        let mut found = HashMap::new();
        match self.spec.layout {
            Layout::Folders => {}
            Layout::Tar => {
                let file = self.files.read_at_most(&format!("{unit:0UNIT_DIGITS$}.tar"), MAX_BYTES)?;
                let file = file.unwrap_or_default();
                let all = entries(&file).unwrap_or_default();
                found.extend(all.into_iter().map(|(name, bytes)| (name.to_owned(), bytes.to_vec())));
            }
            Layout::Zarr => {
                // Name and length of an array's samples, which all samples share.
                let arrays: HashMap<&str, usize> = lines
                    .iter()
                    .flat_map(|line| line["items"].as_object().into_iter().flatten())
                    .filter_map(|(name, item)| {
                        Some((name.split('.').next()?, item["bytes"].as_u64()? as usize))
                    })
                    .collect();
                for (array, length) in arrays {
                    let key_of = format!("{ZARR}/{array}");
                    let axes = self.axes(&key_of)?;
                    let shard = self
                        .files
                        .read_at_most(&format!("{key_of}/c/{unit}{}", "/0".repeat(axes)), MAX_BYTES)?;
                    let all = shard.and_then(|shard| samples(&shard, self.spec.per_unit, length));
                    for (number, sample) in self.spec.of_unit(unit).zip(all.unwrap_or_default()) {
                        found.insert(format!("{}.{array}.array", key(number)), sample);
                    }
                }
            }
        }
        Ok(found)
    }

    /// Axes of a sample of the array at `array`, from its metadata.
    fn axes(&self, array: &str) -> Result<usize, DatasetError> {
        let metadata = self.files.read_at_most(&format!("{array}/zarr.json"), super::MAX_RECORD)?;
        let metadata: Option<Value> = metadata.and_then(|bytes| serde_json::from_slice(&bytes).ok());
        let shape = metadata.as_ref().and_then(|m| m["shape"].as_array().map(Vec::len));
        Ok(shape.unwrap_or(1).saturating_sub(1).min(8))
    }

    /// Checks what the units of a data set have in common, of one whose units are intact: the metadata of its Zarr store and the lines of all samples.
    ///
    /// # Errors
    /// [`DatasetError::Storage`].
    pub fn verify_common(&self) -> Result<Vec<Finding>, DatasetError> {
        let mut findings = Vec::new();
        let mut add = |kind, key: &str| findings.push(Finding { kind, key: key.into(), unit: None });
        let record = recorded(&self.path)?.unwrap_or_default();
        for (key, expected) in record["metadata"].as_object().into_iter().flatten() {
            match self.files.read_at_most(key, super::MAX_RECORD)? {
                None => add("missing", key),
                Some(found) if Some(blake3::hash(&found).to_hex().as_str()) != expected.as_str() => {
                    add("damaged", key);
                }
                Some(_) => (),
            }
        }
        match self.has_all_lines()? {
            None => add("missing", ALL),
            Some(false) => add("damaged", ALL),
            Some(true) => (),
        }
        Ok(findings)
    }

    /// Whether the joined lines are those of all units; none if they are missing.
    fn has_all_lines(&self) -> Result<Option<bool>, DatasetError> {
        let path = self.path.join(ALL);
        let io = |e| DurableError::io("read", &path, 0, e);
        let mut file = match File::open(&path) {
            Err(e) if e.kind() == ErrorKind::NotFound => return Ok(None),
            opened => BufReader::new(opened.map_err(io)?),
        };
        for unit in 0..self.spec.units() {
            let expected = self.lines(unit)?;
            let mut found = Vec::new();
            file.by_ref().take(expected.len() as u64).read_to_end(&mut found).map_err(io)?;
            if found != expected.as_bytes() {
                return Ok(Some(false));
            }
        }
        Ok(Some(file.fill_buf().map_err(io)?.is_empty()))
    }

    /// Removes the joined lines, so that the same command writes them again.
    ///
    /// # Errors
    /// [`DatasetError::Storage`].
    pub fn forget_all_lines(&self) -> Result<(), DatasetError> {
        self.files.remove(ALL).map_err(DatasetError::from)
    }
}
