//! Writing a chart: any source into a store, in parallel, whole or not at all.
//!
//! Shards (1, 2048, 2048) of inner chunks (1, 512, 512); less where the chart is smaller. Each worker holds one shard.
//! It is a chart when all is written, not before: files lie in a temp directory beside the place until then, objects lack
//! the group's metadata.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering::Relaxed};

use pipeline::flow::{ChartSource, SourceSinkError};
use pipeline::geometry::{Rect, Size};
use serde_json::{Map, Value, json};

use crate::durable::{DurableError, Removal, Store, is_temp_name, link_target};
use crate::hierarchy::{NewGroup, array, coordinate};
use crate::shard::{Codec, SampleType, ShardEncoder, sharding_metadata};

const SHARD: usize = 2048;
const CHUNK: usize = 512;

/// What a chart is, beside its pixels.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ChartMeta {
    /// Wavelength of each band in nm; as many bands are written.
    pub wavelengths_nm: Vec<f64>,
    /// Pixel pitch in µm.
    pub pitch_um: Option<f64>,
    /// Size of the film that it is meant for, if the chart has overscan.
    pub film_size: Option<Size>,
    /// What the values are.
    pub units: Option<String>,
    /// More attributes of the group.
    pub attributes: Map<String, Value>,
}

/// What was written.
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
    /// Something is there.
    #[error("writing chart {path}: it exists already; remove it or choose another path")]
    Exists {
        /// The chart.
        path: PathBuf,
    },
    /// Something else than a chart is there.
    #[error("replacing chart {path}: it is no Zarr group with an array `chart`; nothing was changed")]
    NotChart {
        /// What lies there.
        path: PathBuf,
    },
    /// The chart's directory holds what this program did not write.
    #[error(
        "replacing chart {path}: it holds what this program did not write: {}; nothing was removed: move that away, or choose \
         another path", .names.join(", ")
    )]
    Foreign {
        /// The chart.
        path: PathBuf,
        /// Paths in it, the first few.
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
    /// The source fails.
    #[error("writing chart {path}: reading band {band}, {rect} of its source: {source}")]
    Source {
        /// The chart.
        path: PathBuf,
        /// Band.
        band: usize,
        /// Pixels.
        rect: Rect,
        /// In its words.
        source: SourceSinkError,
    },
    /// The codec refuses.
    #[error("writing chart {path}: {reason}")]
    Codec {
        /// The chart.
        path: PathBuf,
        /// In its words.
        reason: String,
    },
    /// The files.
    #[error("writing the chart: {0}")]
    Storage(#[from] DurableError),
}

/// Removes the chart at `path`; nothing there is fine.
///
/// # Errors
/// [`WriteError::NotChart`] for anything but a group with an array `chart`; [`WriteError::Foreign`] if it holds what this
/// program did not write; [`WriteError::Storage`].
pub fn remove_chart(path: &Path) -> Result<(), WriteError> {
    match chart_at(path)? {
        Some(store) => match store.remove_all(Vec::new(), is_own)? {
            Removal::Done => Ok(()),
            Removal::Foreign(names) => Err(WriteError::Foreign { path: path.into(), names }),
            Removal::Replaced => Err(WriteError::Exists { path: path.into() }),
        },
        None => Ok(()),
    }
}

/// The open store of the chart at `path`; `None` if nothing is there.
fn chart_at(path: &Path) -> Result<Option<Store>, WriteError> {
    let place = link_target(path);
    let store = Store::at(&place)?;
    if !store.exists()? {
        return Ok(None);
    }
    let Some(store) = store.opened()? else { return Err(WriteError::NotChart { path: path.into() }) };
    if store.size_of("zarr.json")?.is_none() || store.size_of("chart/zarr.json")?.is_none() {
        return Err(WriteError::NotChart { path: path.into() });
    }
    Ok(Some(store))
}

/// As [`write_chart`], in place of the chart that is there, which stays as it is until the new one is complete. Objects at a URL
/// cannot be exchanged: there the old chart is removed first.
///
/// # Errors
/// [`WriteError`]; in a directory the old chart is there then. [`WriteError::NotChart`] for anything but a chart,
/// [`WriteError::Foreign`] if it holds what this program did not write.
pub fn replace_chart(
    path: &Path,
    source: &dyn ChartSource,
    meta: &ChartMeta,
    codec: Codec,
    threads: usize,
    progress: &(dyn Fn(u64, u64) + Sync),
) -> Result<WriteReport, WriteError> {
    let replace = match chart_at(path)? {
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

/// Whether a chart that this program wrote has the file `key`.
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

/// Writes `source` as a chart at `path` on `threads` threads that hold one shard each. `progress` is told shards done
/// and shards in all.
///
/// # Errors
/// [`WriteError`]; there is nothing at `path` then.
pub fn write_chart(
    path: &Path,
    source: &dyn ChartSource,
    meta: &ChartMeta,
    codec: Codec,
    threads: usize,
    progress: &(dyn Fn(u64, u64) + Sync),
) -> Result<WriteReport, WriteError> {
    write(path, source, meta, codec, threads, progress, false)
}

fn write(
    path: &Path,
    source: &dyn ChartSource,
    meta: &ChartMeta,
    codec: Codec,
    threads: usize,
    progress: &(dyn Fn(u64, u64) + Sync),
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
    let mut ours: HashSet<String> =
        (0..bands).flat_map(|band| tiles.iter().map(move |rect| shard(band, rect))).collect();
    ours.extend(["chart/zarr.json", "wavelength/zarr.json", "wavelength/c/0"].map(str::to_owned));
    let mut group = match replace {
        true => NewGroup::replacing(path, true)?,
        false => NewGroup::begin(path, true, move |key| ours.contains(key))?.ok_or_else(exists)?,
    };
    let refused = |reason: String| WriteError::Codec { path: path.into(), reason };
    let encoder = ShardEncoder::new(codec, SampleType::F32, CHUNK).map_err(|e| refused(e.to_string()))?;
    let total = bands * tiles.len();
    let (next, done, bytes) = (AtomicUsize::new(0), AtomicU64::new(0), AtomicU64::new(0));
    let write = |n: usize, data: &mut Vec<f32>| -> Result<(), WriteError> {
        let (band, rect) = (n / tiles.len(), tiles[n % tiles.len()]);
        data.resize(rect.size().pixels(), 0.0);
        source.read(band, rect, data).map_err(|source| WriteError::Source {
            path: path.into(),
            band,
            rect,
            source,
        })?;
        let encoded = encoder
            .encode(data, (rect.height, rect.width), (sh / CHUNK, sw / CHUNK))
            .map_err(|e| refused(format!("band {band}, shard {}: {e}", shard(band, &rect))))?;
        bytes.fetch_add(encoded.len() as u64, Relaxed);
        group.store.write(&shard(band, &rect), encoded)?;
        progress(done.fetch_add(1, Relaxed) + 1, total as u64);
        Ok(())
    };
    let work = || -> Result<(), WriteError> {
        let mut data = Vec::new();
        loop {
            let n = next.fetch_add(1, Relaxed);
            if n >= total {
                return Ok(());
            }
            write(n, &mut data).inspect_err(|_| next.store(total, Relaxed))?;
        }
    };
    std::thread::scope(|s| {
        let workers: Vec<_> = (0..threads.max(1)).map(|_| s.spawn(work)).collect();
        workers.into_iter().try_for_each(|w| w.join().expect("workers return their errors"))
    })?;
    group.coordinate("wavelength", coordinate("wavelength", "nm", "wavelength", &meta.wavelengths_nm))?;
    let chart = array(
        &[bands, size.height, size.width],
        &[1, sh, sw],
        SampleType::F32.name(),
        sharding_metadata(codec, SampleType::F32, CHUNK),
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
