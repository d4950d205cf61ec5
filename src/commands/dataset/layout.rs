//! Digest, units and arrays of a data set.

use super::camera::Camera;
use super::sample::Maker;
use super::{optics, refused};
use crate::film;
use crate::machine::MemoryLimit;
use anyhow::{Context, Result};
use formats::dataset::recipe::{Format, Layout};
use formats::dataset::store::{ArraySpec, DatasetSpec};
use formats::film::SampleType;
use pipeline::geometry::Size;
use serde_json::{Map, Value, json};
use std::fs::File;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Bytes of the items of a unit, and samples of it, at most.
const UNIT_BYTES: usize = 32 << 20;
const MAX_UNIT: u64 = 256;
/// Samples of a unit of pictures of unknown sizes.
const UNSIZED_UNIT: u64 = 16;
/// Memory of a thread per film pixel and band, bytes: chart, film, remapped image, tiles and their buffers.
const THREAD_PIXEL_BYTES: usize = 40;
const THREAD_BYTES: usize = 24 << 20;
/// Key of what determines the samples beside the recipe, in the record, and its parts with what a difference is called.
const DETERMINING: &str = "determining";
const PARTS: [(&str, &str); 6] = [
    ("pictures", "other pictures: their names or lengths differ"),
    ("labels", "other labels: the content of pictures.labels differs"),
    ("lenses", "other files of the lenses: their content differs, or modification times of a lens pack"),
    ("sensors", "other sensors: a description or a table of them differs"),
    ("per_unit", "units of another number of samples"),
    (
        "picture_times",
        "the same pictures with other modification times: only these differ, names and lengths are the same",
    ),
];

/// What the data set of `maker` is.
///
/// # Errors
/// Usage: a layout that the recipe cannot have; the files cannot be read.
pub fn spec(maker: &Maker<'_>, limit: MemoryLimit) -> Result<DatasetSpec> {
    let recipe = maker.recipe;
    let size = recipe.pictures.size.map(|[width, height]| Size::new(height, width));
    let arrays = match size {
        Some(size) => arrays(maker, size)?,
        None if recipe.output.layout == Layout::Zarr => {
            return Err(refused(
                "pictures.size: arrays of a Zarr store have one size; give [width, height]".into(),
            ));
        }
        None => Vec::new(),
    };
    let bytes: usize = arrays.iter().map(ArraySpec::bytes).sum();
    let fitting =
        UNIT_BYTES.checked_div(bytes).map_or(UNSIZED_UNIT, |n| n.clamp(1, MAX_UNIT as usize) as u64);
    let per_unit = recipe.output.unit.unwrap_or(fitting);
    if bytes as u64 * per_unit * 3 > limit.bytes {
        return Err(limit.too_small(format!(
            "a unit of {per_unit} samples has {bytes} bytes each; give a smaller output.unit, or raise the limit"
        )));
    }
    let attributes = record(maker);
    let [pictures, picture_times] = identity(maker);
    // Of the number of samples drawn the first ones are independent.
    let mut determining =
        json!({"recipe": recipe, "pictures": picture_times, "labels": maker.labels.digest()});
    determining["recipe"]["samples"] = json!(recipe.samples.is_some());
    determining["per_unit"] = json!(per_unit);
    determining["lenses"] = json!(files_identity(maker)?);
    determining["sensors"] = json!(maker.camera.as_ref().map(Camera::identity));
    determining["program"] = json!(env!("CARGO_PKG_VERSION"));
    let mut record = attributes.clone();
    record.insert(
        DETERMINING.into(),
        json!({
            "pictures": pictures,
            "picture_times": picture_times,
            "labels": determining["labels"],
            "lenses": determining["lenses"],
            "sensors": determining["sensors"],
            "per_unit": per_unit,
        }),
    );
    Ok(DatasetSpec {
        digest: blake3::hash(determining.to_string().as_bytes()).to_hex().to_string(),
        samples: maker.draws.count(),
        per_unit,
        layout: recipe.output.layout,
        arrays: if recipe.output.layout == Layout::Zarr { arrays } else { Vec::new() },
        attributes,
        record,
    })
}

/// What a data set is of that is not `requested`, by their records: the first that differs; none if the records do not have it.
pub fn difference(recorded: &Map<String, Value>, requested: &Map<String, Value>) -> Option<String> {
    let text = |of: &Map<String, Value>, key: &str| of.get(key).and_then(Value::as_str).map(str::to_owned);
    let (old, new) = (text(recorded, "program")?, text(requested, "program")?);
    if old != new {
        return Some(format!("another version of the program: {old} there, this is {new}"));
    }
    let fields = |of: &Map<String, Value>| {
        let mut fields = Map::new();
        add_fields("", of.get("recipe").unwrap_or(&Value::Null), &mut fields);
        fields
    };
    let (mut old, mut new) = (fields(recorded), fields(requested));
    // A data set of samples that are drawn may have any number of them.
    if old.contains_key("samples") && new.contains_key("samples") {
        old.remove("samples");
        new.remove("samples");
    }
    if let Some((field, old, new)) = film::differences(&old, &new).into_iter().next() {
        return Some(format!("another recipe: {field} ({old} there, {new} in this recipe)"));
    }
    let (old, new) = (recorded.get(DETERMINING)?, requested.get(DETERMINING)?);
    PARTS.iter().find(|(key, _)| old.get(*key) != new.get(*key)).map(|(_, what)| (*what).to_owned())
}

/// Adds the fields of `value` that are given, by their names with those of their tables: film.pitch_um.
fn add_fields(name: &str, value: &Value, fields: &mut Map<String, Value>) {
    match value {
        Value::Null => {}
        Value::Object(table) => {
            for (key, value) in table {
                let name = if name.is_empty() { key.clone() } else { format!("{name}.{key}") };
                add_fields(&name, value, fields);
            }
        }
        value => {
            fields.insert(name.into(), value.clone());
        }
    }
}

/// Threads that the limit of memory allows.
pub fn max_threads(spec: &DatasetSpec, limit: MemoryLimit) -> usize {
    let pixels: usize = spec.record.get("film_pixels").and_then(Value::as_u64).unwrap_or(0) as usize;
    let each = THREAD_BYTES + pixels * THREAD_PIXEL_BYTES;
    ((limit.bytes / 4) as usize / each).max(1)
}

/// Items of a sample as arrays.
fn arrays(maker: &Maker<'_>, size: Size) -> Result<Vec<ArraySpec>> {
    let Size { height, width } = size;
    let bands = maker.bands.wavelengths_nm().len();
    let mut arrays = Vec::new();
    for (name, format) in maker.recipe.items() {
        let raw = || maker.camera.as_ref().context("a sensor").and_then(|camera| camera.size(0, size));
        let image = |channels: usize, axis, size: Size| ArraySpec {
            name,
            axes: vec![axis, "y", "x"],
            shape: vec![channels, size.height, size.width],
            sample: SampleType::F32,
        };
        arrays.push(match name {
            "raw" => {
                let Size { height, width } = raw()?;
                ArraySpec { name, axes: vec!["y", "x"], shape: vec![height, width], sample: SampleType::U16 }
            }
            "picture" => image(3, "channel", raw()?),
            _ if format == Format::Npy => image(bands, "wavelength", size),
            _ => image(3, "channel", size),
        });
    }
    if maker.labels.has_masks() {
        arrays.push(ArraySpec {
            name: "mask",
            axes: vec!["y", "x"],
            shape: vec![height, width],
            sample: SampleType::U16,
        });
    }
    let sensors = maker.recipe.sensor.as_ref().map_or(0, |s| s.name.0.len());
    if let Some(camera) = &maker.camera {
        for sensor in 0..sensors {
            let is_other = camera.size(sensor, size)? != camera.size(0, size)?;
            if is_other && maker.recipe.output.layout == Layout::Zarr {
                return Err(refused(
                    "sensor.name: arrays of a Zarr store have one size; the sensors' pixels differ".into(),
                ));
            }
        }
    }
    Ok(arrays)
}

/// The recipe and what it was made with, for people.
fn record(maker: &Maker<'_>) -> Map<String, Value> {
    let mut record = Map::new();
    record.insert("program".into(), concat!("lenscube ", env!("CARGO_PKG_VERSION")).into());
    record.insert("recipe".into(), json!(maker.recipe));
    record.insert("wavelengths_nm".into(), json!(maker.bands.wavelengths_nm()));
    let side = maker.recipe.pictures.size.map_or(0, |[width, height]| width * height);
    record.insert("film_pixels".into(), json!(side * maker.bands.wavelengths_nm().len()));
    if let Some(categories) = maker.labels.categories() {
        record.insert("categories".into(), categories.clone());
    }
    record
}

/// Names from the recipe's folder and lengths of the pictures; the same with their times.
fn identity(maker: &Maker<'_>) -> [String; 2] {
    let (mut lengths, mut times) = (blake3::Hasher::new(), blake3::Hasher::new());
    for path in maker.pictures {
        let length = add_state(maker, path, &mut times);
        lengths.update(format!("{} {length:?}\n", maker.shown(path)).as_bytes());
    }
    [lengths, times].map(|hasher| hasher.finalize().to_hex().to_string())
}

/// Content of the files of the lenses; of packs that are folders names, lengths and times of what is in them.
fn files_identity(maker: &Maker<'_>) -> Result<String> {
    let mut hasher = blake3::Hasher::new();
    let mut all = optics::files(maker.recipe, maker.folder);
    while let Some(path) = all.pop() {
        let reading = || format!("reading {}", path.display());
        if path.is_dir() {
            let entries = std::fs::read_dir(&path).with_context(reading)?;
            let mut inside: Vec<PathBuf> =
                entries.map(|e| Ok(e?.path())).collect::<std::io::Result<_>>().with_context(reading)?;
            inside.sort();
            for path in &inside {
                add_state(maker, path, &mut hasher);
            }
            all.extend(inside.into_iter().filter(|path| path.is_dir()));
        } else {
            hasher.update_reader(File::open(&path).with_context(reading)?).with_context(reading)?;
        }
    }
    Ok(hasher.finalize().to_hex().to_string())
}

/// Adds name, length and time of a file to `hasher`; its length.
fn add_state(maker: &Maker<'_>, path: &Path, hasher: &mut blake3::Hasher) -> Option<u64> {
    // A picture that is missing is reported sample by sample.
    let state = std::fs::metadata(path).ok().map(|m| (m.len(), m.mtime(), m.mtime_nsec()));
    hasher.update(format!("{} {state:?}\n", maker.shown(path)).as_bytes());
    state.map(|(length, ..)| length)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(recipe: Value, pictures: &str, picture_times: &str) -> Map<String, Value> {
        let determining = json!({"pictures": pictures, "picture_times": picture_times});
        formats::object! { "program": "lenscube 1", "recipe": recipe, DETERMINING: determining }
    }

    #[test]
    fn the_first_difference_of_records_is_named() {
        let of = |samples: Value, pitch_um: f64| json!({"samples": samples, "film": {"pitch_um": pitch_um}});
        let recorded = record(of(json!(3), 2.0), "a", "b");
        let found = |recipe, pictures, times| difference(&recorded, &record(recipe, pictures, times));
        let text = |of: Option<String>| of.unwrap_or_default();
        assert_eq!(found(of(json!(9), 2.0), "a", "b"), None);
        let pitch = "another recipe: film.pitch_um (2.0 there, 3.0 in this recipe)";
        assert_eq!(text(found(of(json!(3), 3.0), "c", "d")), pitch);
        let every = "another recipe: samples (3 there, nothing in this recipe)";
        assert_eq!(text(found(of(Value::Null, 2.0), "a", "b")), every);
        assert!(text(found(of(json!(3), 2.0), "c", "d")).starts_with("other pictures"));
        assert!(text(found(of(json!(3), 2.0), "a", "d")).contains("other modification times: only these"));
        let mut other = recorded.clone();
        other.insert("program".into(), "lenscube 2".into());
        let version = "another version of the program: lenscube 1 there, this is lenscube 2";
        assert_eq!(text(difference(&recorded, &other)), version);
        // A record without parts, of earlier versions.
        other = recorded.clone();
        other.remove(DETERMINING);
        assert_eq!(difference(&other, &recorded), None);
    }
}
