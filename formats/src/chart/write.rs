//! Writing a chart store from any source, in parallel; each worker holds one shard. Layout: see [`crate::chart`].
//!
//! The store becomes a chart when it is complete: until then files lie in a temp directory beside its path, and objects lack the group's
//! metadata.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use pipeline::flow::{ChartSource, SourceSinkError};
use pipeline::geometry::{Rect, Size};
use serde_json::{Map, Value, json};

use crate::durable::{DurableError, Removal, Store, is_temp_name, link_target};
use crate::hierarchy::{NewGroup, array, coordinate};
use crate::parallel::{self, Progress};
use crate::shard::{Codec, SampleType, ShardEncoder, sharding_metadata};

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

/// As [`write_chart`], but replaces an existing chart once the new one is complete. Objects at a URL cannot be replaced in one step:
/// there the old chart is removed first.
///
/// # Errors
/// [`WriteError`]; in a directory the old chart is then unchanged. [`WriteError::NotChart`] for anything but a chart,
/// [`WriteError::Foreign`] if it contains files that this program did not write.
pub fn replace_chart(
    path: &Path,
    source: &dyn ChartSource,
    meta: &ChartMeta,
    codec: Codec,
    threads: usize,
    progress: Progress<'_>,
) -> Result<WriteReport, WriteError> {
    let replace = match open_chart(path)? {
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
    write(path, source, meta, codec, threads, progress, replace)
}

/// Whether a chart written by this program may contain the file `key`.
fn is_own(key: &str) -> bool {
    let parts: Vec<&str> = key.split('/').collect();
    let numbers = |parts: &[&str]| {
        !parts.is_empty() && parts.iter().all(|p| !p.is_empty() && p.bytes().all(|b| b.is_ascii_digit()))
    };
    match parts[..] {
        ["zarr.json"] | ["chart" | "wavelength", "zarr.json"] => true,
        ["chart" | "wavelength", "c", ref indices @ ..] => numbers(indices),
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
    write(path, source, meta, codec, threads, progress, false)
}

fn write(
    path: &Path,
    source: &dyn ChartSource,
    meta: &ChartMeta,
    codec: Codec,
    threads: usize,
    progress: Progress<'_>,
    replace: bool,
) -> Result<WriteReport, WriteError> {
    let (size, bands) = (source.size(), meta.wavelengths_nm.len());
    if size.pixels() == 0 || bands == 0 {
        return Err(WriteError::Empty { path: path.into(), bands, size });
    }
    let exists = || WriteError::Exists { path: path.into() };
    let side = |n: usize| SHARD.min(n.div_ceil(CHUNK) * CHUNK);
    let (sh, sw) = (side(size.height), side(size.width));
    let tiles: Vec<Rect> = size.rect().tiles(sh, sw).collect();
    let shard = move |band: usize, rect: &Rect| {
        format!("chart/c/{band}/{}/{}", rect.y as usize / sh, rect.x as usize / sw)
    };
    let mut own_keys: HashSet<String> =
        (0..bands).flat_map(|band| tiles.iter().map(move |rect| shard(band, rect))).collect();
    own_keys.extend(["chart/zarr.json", "wavelength/zarr.json", "wavelength/c/0"].map(str::to_owned));
    let mut group = match replace {
        true => NewGroup::replacing(path, true)?,
        false => NewGroup::begin(path, true, move |key| own_keys.contains(key))?.ok_or_else(exists)?,
    };
    let codec_error = |reason: String| WriteError::Codec { path: path.into(), reason };
    let encoder =
        ShardEncoder::new(codec, SampleType::F32, CHUNK, None).map_err(|e| codec_error(e.to_string()))?;
    let total = bands * tiles.len();
    let bytes = AtomicU64::new(0);
    parallel::for_each::<WriteError>(threads, total, progress, |n| {
        let (band, rect) = (n / tiles.len(), tiles[n % tiles.len()]);
        let mut data = vec![0.0; rect.size().pixels()];
        source.read(band, rect, &mut data).map_err(|source| WriteError::Source {
            path: path.into(),
            band,
            rect,
            source,
        })?;
        let encoded = encoder
            .encode(&data, (rect.height, rect.width), (sh / CHUNK, sw / CHUNK))
            .map_err(|e| codec_error(format!("band {band}, shard {}: {e}", shard(band, &rect))))?;
        bytes.fetch_add(encoded.len() as u64, Relaxed);
        Ok(group.store.write(&shard(band, &rect), encoded)?)
    })?;
    group.coordinate("wavelength", coordinate("wavelength", "nm", "wavelength", &meta.wavelengths_nm))?;
    let chart = array(
        &[bands, size.height, size.width],
        &[1, sh, sw],
        SampleType::F32.name(),
        sharding_metadata(codec, SampleType::F32, CHUNK, false),
        &["wavelength", "y", "x"],
        meta.units.as_ref().map_or(json!({}), |u| json!({"units": u})),
    );
    group.array("chart", chart)?;
    if !group.publish(attributes(meta))? {
        return Err(exists());
    }
    Ok(WriteReport { shards: total as u64, bytes: bytes.into_inner() })
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
