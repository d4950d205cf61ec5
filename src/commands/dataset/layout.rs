//! Digest, units and arrays of a data set.

use super::camera::Camera;
use super::sample::Maker;
use super::{optics, refused};
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
    let record = record(maker);
    // Of the number of samples drawn the first ones are independent.
    let mut determining =
        json!({"recipe": recipe, "pictures": identity(maker)?, "labels": maker.labels.digest()});
    determining["recipe"]["samples"] = json!(recipe.samples.is_some());
    determining["per_unit"] = json!(per_unit);
    determining["lenses"] = json!(files_identity(maker)?);
    determining["sensors"] = json!(maker.camera.as_ref().map(Camera::identity));
    determining["program"] = json!(env!("CARGO_PKG_VERSION"));
    Ok(DatasetSpec {
        digest: blake3::hash(determining.to_string().as_bytes()).to_hex().to_string(),
        samples: maker.draws.count(),
        per_unit,
        layout: recipe.output.layout,
        arrays: if recipe.output.layout == Layout::Zarr { arrays } else { Vec::new() },
        attributes: record.clone(),
        record,
    })
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

/// Names from the recipe's folder, lengths and times of the pictures.
fn identity(maker: &Maker<'_>) -> Result<String> {
    let mut hasher = blake3::Hasher::new();
    for path in maker.pictures {
        add_state(maker, path, &mut hasher);
    }
    Ok(hasher.finalize().to_hex().to_string())
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
            inside.iter().for_each(|path| add_state(maker, path, &mut hasher));
            all.extend(inside.into_iter().filter(|path| path.is_dir()));
        } else {
            hasher.update_reader(File::open(&path).with_context(reading)?).with_context(reading)?;
        }
    }
    Ok(hasher.finalize().to_hex().to_string())
}

fn add_state(maker: &Maker<'_>, path: &Path, hasher: &mut blake3::Hasher) {
    // A picture that is missing is reported sample by sample.
    let state = std::fs::metadata(path).ok().map(|m| (m.len(), m.mtime(), m.mtime_nsec()));
    hasher.update(format!("{} {state:?}\n", maker.shown(path)).as_bytes());
}
