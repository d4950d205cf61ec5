//! Writing a chart store from any source, in parallel; each worker holds one shard. Layout: see [`crate::chart`].
//!
//! The store becomes a chart when it is complete: until then files lie in a temp directory beside its path, and objects lack the group's
//! metadata.

use std::collections::{BTreeSet, HashSet};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use pipeline::flow::{ChartSource, SourceSinkError};
use pipeline::geometry::{Rect, Size};
use serde_json::{Map, Value, json};

use crate::durable::{DurableError, Removal, Store, is_temp_name, link_target};
use crate::hierarchy::{self, NewGroup, coordinate};
use crate::parallel::{self, Progress};
use crate::shard::{Codec, SampleType, ShardEncoder, sharding_of};

/// Side of a shard, px.
const SHARD: usize = 2048;
/// Side of an inner chunk, px.
const CHUNK: usize = 512;

/// Metadata of a chart.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ChartMeta {
    /// Wavelength of each band in nm; their number is the number of bands written.
    pub wavelengths_nm: Vec<f64>,
    /// Pixel pitch in µm.
    pub pitch_um: Option<f64>,
    /// Size of the film, for a chart with overscan.
    pub film_size: Option<Size>,
    /// Unit of the values.
    pub units: Option<String>,
    /// Further attributes of the group.
    pub attributes: Map<String, Value>,
}

/// A chart to write.
#[derive(Clone, Copy)]
pub struct NewChart<'a> {
    /// Its pixels.
    pub source: &'a dyn ChartSource,
    /// Its metadata.
    pub meta: &'a ChartMeta,
    /// Arrays of its surfaces in the same group.
    pub surfaces: &'a [SurfaceArray<'a>],
}

/// An array of a surface: distances, coverage, or what is hidden behind.
#[derive(Clone, Copy)]
pub struct SurfaceArray<'a> {
    /// Name in the chart's group: `depth`, `coverage`, `hidden/1/chart`, `hidden/1/depth`, `hidden/1/coverage`, …
    pub name: &'a str,
    /// Its pixels, finite.
    pub source: &'a dyn ChartSource,
    /// Whether it has the chart's bands; else it has one and no axis for it.
    pub has_bands: bool,
    /// Unit of the values.
    pub units: &'a str,
}

/// Amount of data written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct WriteReport {
    /// Shards.
    pub shards: u64,
    /// Their encoded bytes.
    pub bytes: u64,
}

/// A chart cannot be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WriteError {
    /// Something exists at the path.
    #[error("writing chart {path}: it already exists; remove it or choose another path")]
    Exists {
        /// The chart.
        path: PathBuf,
    },
    /// Something other than a chart exists at the path.
    #[error("replacing chart {path}: it is no Zarr group with an array `chart`; nothing was changed")]
    NotChart {
        /// The path.
        path: PathBuf,
    },
    /// The chart's directory contains files that this program did not write.
    #[error(
        "replacing chart {path}: it contains files that this program did not write: {}; nothing was removed: move them elsewhere, or \
         choose another path", .names.join(", ")
    )]
    Foreign {
        /// The chart.
        path: PathBuf,
        /// The first few of them.
        names: Vec<String>,
    },
    /// No bands or no pixels.
    #[error("writing chart {path}: {bands} bands of {size} pixels; expected at least one of each")]
    Empty {
        /// The chart.
        path: PathBuf,
        /// Bands.
        bands: usize,
        /// Pixels.
        size: Size,
    },
    /// The source failed.
    #[error("writing chart {path}: reading band {band}, {rect} of its source: {source}")]
    Source {
        /// The chart.
        path: PathBuf,
        /// Band.
        band: usize,
        /// Pixels.
        rect: Rect,
        /// Its error.
        source: SourceSinkError,
    },
    /// Pixels that cannot be encoded.
    #[error("writing chart {path}: {reason}")]
    Codec {
        /// The chart.
        path: PathBuf,
        /// The cause.
        reason: String,
    },
    /// Error of the file system or object store.
    #[error("writing the chart: {0}")]
    Storage(#[from] DurableError),
}

/// Removes the chart at `path`, if there is one.
///
/// # Errors
/// [`WriteError::NotChart`] for anything but a group with an array `chart`; [`WriteError::Foreign`] if it contains files that this
/// program did not write; [`WriteError::Storage`].
pub fn remove_chart(path: &Path) -> Result<(), WriteError> {
    match open_chart(path)? {
        Some(store) => match store.remove_all(Vec::new(), is_own)? {
            Removal::Done => Ok(()),
            Removal::Foreign(names) => Err(WriteError::Foreign { path: path.into(), names }),
            Removal::Replaced => Err(WriteError::Exists { path: path.into() }),
        },
        None => Ok(()),
    }
}

/// Opens the store of the chart at `path`; `None` if nothing exists there.
fn open_chart(path: &Path) -> Result<Option<Store>, WriteError> {
    let store = Store::at(&link_target(path))?;
    if !store.exists()? {
        return Ok(None);
    }
    let Some(store) = store.opened()? else { return Err(WriteError::NotChart { path: path.into() }) };
    if store.size_of("zarr.json")?.is_none() || store.size_of("chart/zarr.json")?.is_none() {
        return Err(WriteError::NotChart { path: path.into() });
    }
    Ok(Some(store))
}

/// As [`write_chart`], with the arrays of its surfaces; `overwrite`: replaces an existing chart once the new one is complete. Objects at a URL
/// cannot be replaced in one step: there the old chart is removed first.
///
/// # Errors
/// [`WriteError`]; in a directory the old chart is then unchanged. With `overwrite` [`WriteError::NotChart`] for anything but a chart,
/// [`WriteError::Foreign`] if it contains files that this program did not write.
pub fn write_surfaces(
    path: &Path,
    chart: &NewChart<'_>,
    codec: Codec,
    threads: usize,
    overwrite: bool,
    progress: Progress<'_>,
) -> Result<WriteReport, WriteError> {
    let replace = match if overwrite { open_chart(path)? } else { None } {
        Some(store @ Store::Directory(_)) => {
            if let Some(names) = store.foreign(is_own)? {
                return Err(WriteError::Foreign { path: path.into(), names });
            }
            true
        }
        Some(Store::Objects(_)) => {
            remove_chart(path)?;
            false
        }
        None => false,
    };
    write(path, chart, codec, threads, progress, replace)
}

/// Whether a chart written by this program may contain the file `key`.
fn is_own(key: &str) -> bool {
    let parts: Vec<&str> = key.split('/').collect();
    let numbers = |parts: &[&str]| {
        !parts.is_empty() && parts.iter().all(|p| !p.is_empty() && p.bytes().all(|b| b.is_ascii_digit()))
    };
    let inside = match parts[..] {
        ["hidden", sheet, ref inside @ ..] if numbers(&[sheet]) => inside,
        _ => &parts[..],
    };
    match *inside {
        ["zarr.json"] | ["chart" | "wavelength" | "depth" | "coverage" | "hidden", "zarr.json"] => true,
        ["chart" | "wavelength" | "depth" | "coverage", "c", ref indices @ ..] => numbers(indices),
        _ => parts.iter().any(|part| is_temp_name(part)),
    }
}

/// Writes `source` as a chart at `path` on `threads` threads that hold one shard each. `progress` receives the numbers of shards done
/// and in total.
///
/// # Errors
/// [`WriteError`]; nothing exists at `path` then.
pub fn write_chart(
    path: &Path,
    source: &dyn ChartSource,
    meta: &ChartMeta,
    codec: Codec,
    threads: usize,
    progress: Progress<'_>,
) -> Result<WriteReport, WriteError> {
    write(path, &NewChart { source, meta, surfaces: &[] }, codec, threads, progress, false)
}

fn write(
    path: &Path,
    chart: &NewChart<'_>,
    codec: Codec,
    threads: usize,
    progress: Progress<'_>,
    replace: bool,
) -> Result<WriteReport, WriteError> {
    let NewChart { source, meta, surfaces } = *chart;
    let (size, bands) = (source.size(), meta.wavelengths_nm.len());
    if size.pixels() == 0 || bands == 0 {
        return Err(WriteError::Empty { path: path.into(), bands, size });
    }
    let exists = || WriteError::Exists { path: path.into() };
    let side = |n: usize| SHARD.min(n.div_ceil(CHUNK) * CHUNK);
    let (sh, sw) = (side(size.height), side(size.width));
    let tiles: Vec<Rect> = size.rect().tiles(sh, sw).collect();
    let units = meta.units.as_deref().unwrap_or_default();
    let first = SurfaceArray { name: "chart", source, has_bands: true, units };
    let arrays: Vec<SurfaceArray<'_>> = std::iter::once(first).chain(surfaces.iter().copied()).collect();
    // A shard: array, band, and the tile that it holds.
    let mut shards = Vec::new();
    for array in &arrays {
        let bands = if array.has_bands { bands } else { 1 };
        shards.extend((0..bands).flat_map(|band| tiles.iter().map(move |rect| (array, band, *rect))));
    }
    let key = |(array, band, rect): &(&SurfaceArray<'_>, usize, Rect)| {
        let band = if array.has_bands { format!("{band}/") } else { String::new() };
        format!("{}/c/{band}{}/{}", array.name, rect.y as usize / sh, rect.x as usize / sw)
    };
    let mut own_keys: HashSet<String> = shards.iter().map(key).collect();
    own_keys.extend(["wavelength/zarr.json", "wavelength/c/0"].map(str::to_owned));
    own_keys.extend(arrays.iter().map(|array| format!("{}/zarr.json", array.name)));
    own_keys.extend(parents(&arrays).iter().map(|name| format!("{name}/zarr.json")));
    let mut group = match replace {
        true => NewGroup::replacing(path, true)?,
        false => NewGroup::begin(path, true, move |key| own_keys.contains(key))?.ok_or_else(exists)?,
    };
    let codec_error = |reason: String| WriteError::Codec { path: path.into(), reason };
    let encoder =
        ShardEncoder::new(codec, SampleType::F32, CHUNK, None).map_err(|e| codec_error(e.to_string()))?;
    let bytes = AtomicU64::new(0);
    parallel::for_each::<WriteError>(threads, shards.len(), progress, |n| {
        let (array, band, rect) = shards[n];
        let mut data = vec![0.0; rect.size().pixels()];
        array.source.read(band, rect, &mut data).map_err(|source| WriteError::Source {
            path: path.into(),
            band,
            rect,
            source,
        })?;
        let key = key(&shards[n]);
        let encoded = encoder
            .encode(&data, (rect.height, rect.width), (sh / CHUNK, sw / CHUNK))
            .map_err(|e| codec_error(format!("band {band}, shard {key}: {e}")))?;
        bytes.fetch_add(encoded.len() as u64, Relaxed);
        Ok(group.store.write(&key, encoded)?)
    })?;
    group.coordinate("wavelength", coordinate("wavelength", "nm", "wavelength", &meta.wavelengths_nm))?;
    for name in parents(&arrays) {
        group.array(&name, json!({"zarr_format": 3, "node_type": "group", "attributes": {}}))?;
    }
    for array in &arrays {
        // Of sides (bands, rows, columns).
        let along = |sides: [usize; 3]| sides[usize::from(!array.has_bands)..].to_vec();
        let metadata = hierarchy::array(
            &along([bands, size.height, size.width]),
            &along([1, sh, sw]),
            SampleType::F32.name(),
            sharding_of(codec, SampleType::F32, &along([1, CHUNK, CHUNK]), false),
            &["wavelength", "y", "x"][usize::from(!array.has_bands)..],
            if array.units.is_empty() { json!({}) } else { json!({"units": array.units}) },
        );
        group.array(array.name, metadata)?;
    }
    if !group.publish(attributes(meta))? {
        return Err(exists());
    }
    Ok(WriteReport { shards: shards.len() as u64, bytes: bytes.into_inner() })
}

/// The groups that hold `arrays`, below the chart's.
fn parents(arrays: &[SurfaceArray<'_>]) -> BTreeSet<String> {
    let of = |array: &SurfaceArray<'_>| {
        let parts: Vec<&str> = array.name.split('/').collect();
        (1..parts.len()).map(|n| parts[..n].join("/")).collect::<Vec<_>>()
    };
    arrays.iter().flat_map(of).collect()
}

fn attributes(meta: &ChartMeta) -> Value {
    let mut all = meta.attributes.clone();
    if let Some(pitch) = meta.pitch_um {
        all.insert("pitch_um".into(), pitch.into());
    }
    if let Some(size) = meta.film_size {
        all.insert("film_size".into(), json!([size.height, size.width]));
    }
    if let Some(units) = &meta.units {
        all.insert("units".into(), units.clone().into());
    }
    all.insert("schema".into(), "lenscube/chart/1".into());
    Value::Object(all)
}
