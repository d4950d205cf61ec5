//! Opening a chart by `PATH` or `PATH//array`, with checks of its metadata.

use std::path::Path;
use std::sync::{Arc, OnceLock};

use pipeline::bounds;
use pipeline::geometry::Size;
use serde_json::{Map, Value};

use super::cache::Cache;
use super::coordinates::{self, dimension_names};
use super::error::ChartError;
use super::file_change::ChunkFileStates;
use super::layout::Layout;
use super::node::{Node, open_array};
use super::options::ChartOptions;
use super::store::{ChartStore, Counters};
use crate::durable::{Store, is_url};
use crate::group::GroupKind;

/// Size of the cache of shard indexes: two hundred thousand inner chunks, thousands of shards.
const INDEX_CACHE_BYTES: usize = 4 << 20;

/// Splits `PATH//array` into the path or URL of a store and the array in it (empty if none is named).
pub fn split_array(spec: &str) -> (&str, &str) {
    match spec.rsplit_once("//") {
        Some((scheme, _)) if scheme.ends_with(':') && is_url(Path::new(spec)) => (spec, ""),
        // An existing path with a doubled slash names no array.
        Some((path, array)) if !path.is_empty() && !Path::new(spec).exists() => {
            (path, array.trim_matches('/'))
        }
        _ => (spec, ""),
    }
}

impl ChartStore {
    /// Opens the chart `spec`: `PATH`, a group with an array `chart` or `film` or a bare array, or `PATH//array`.
    ///
    /// # Errors
    /// [`ChartError`] if there is no chart, or its metadata are invalid or not supported.
    pub fn open(spec: &str, options: ChartOptions) -> Result<Self, ChartError> {
        let (path, array) = split_array(spec);
        Self::open_at(Path::new(path), array, options)
    }

    /// Opens the array `array` (empty: `chart`, `film`, or the store's root) of the store at `path`, which may contain `//`.
    ///
    /// # Errors
    /// As [`ChartStore::open`].
    pub fn open_at(path: &Path, array: &str, options: ChartOptions) -> Result<Self, ChartError> {
        let (store, name, group) = find(path, array)?;
        let array = open_array(&store, &name)?;
        let attributes = array.attributes().clone();
        let dimensions = dimension_names(&array);
        let sides: Vec<usize> = array.shape().iter().map(|&n| n as usize).collect();
        let order = coordinates::axis_order(&sides, dimensions.as_deref(), options.axes.as_ref()).map_err(
            |(expected, found)| ChartError::Metadata {
                path: store.root().into(),
                array: name.clone(),
                what: "order of dimensions",
                expected,
                found,
            },
        )?;
        let mut layout = Layout::new(store, &name, array, order)?;
        layout.values.multiply(options.scale);
        let find = |key: &str| attributes.get(key).or_else(|| group.get(key));
        let wavelengths_nm =
            coordinates::wavelengths(&layout, dimensions.as_deref(), &find, options.wavelengths_nm.clone())?;
        let pitch_um = find("pitch_um").map(|v| pitch(&layout, v)).transpose()?;
        let film_size = find("film_size").map(|v| size(&layout, v)).transpose()?;
        let units = find("units").and_then(Value::as_str).map(str::to_owned);
        let drawn = || {
            let spec = find("chart")?.as_str()?.parse::<pipeline::chart::ChartSpec>().ok()?;
            Some(spec.light().name().to_owned())
        };
        let light = find("illuminant").and_then(Value::as_str).map(str::to_owned).or_else(drawn);
        Ok(Self {
            layout,
            attributes,
            wavelengths_nm,
            pitch_um,
            film_size,
            units,
            light,
            leaves_out_chunks: group.get("schema").and_then(Value::as_str) == Some(GroupKind::Scene.schema()),
            cache: Cache::new(options.cache_bytes),
            indexes: Cache::new(INDEX_CACHE_BYTES),
            options,
            counters: Counters::default(),
            band_chunks: OnceLock::new(),
            read_ahead: None,
            file_states: ChunkFileStates::default(),
        })
    }
}

/// Whether `spec` (`PATH//NAME`) names an array that a Zarr store lacks; `false` for files of other formats.
///
/// # Errors
/// [`ChartError`] if the store cannot be read.
pub fn lacks_array(spec: &str) -> Result<bool, ChartError> {
    let (path, name) = split_array(spec);
    let path = Path::new(path);
    if !is_url(path) && !path.is_dir() {
        return Ok(false);
    }
    Ok(Node::read(&Store::at(path)?, name)?.is_none_or(|n| !n.is_array))
}

type Found = (Arc<Store>, String, Map<String, Value>);

/// The store, the array's name in it, and the attributes of its group.
fn find(path: &Path, requested: &str) -> Result<Found, ChartError> {
    let not_zarr = |found: &str| ChartError::NotZarr { path: path.into(), found: found.into() };
    let store = Arc::new(Store::at(path)?);
    match std::fs::metadata(path) {
        _ if is_url(path) => {}
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
            return Err(ChartError::NotFound { path: path.into() });
        }
        Err(e) => return Err(not_zarr(&e.to_string())),
        Ok(m) if !m.is_dir() => return Err(not_zarr("a file")),
        Ok(_) => {}
    }
    let root = Node::read(&store, "")?;
    if requested.is_empty() {
        let Some(root) = root else {
            return Err(match store.exists()? {
                true => not_zarr("no Zarr metadata (perhaps an unfinished copy)"),
                false => ChartError::NotFound { path: path.into() },
            });
        };
        if root.is_array {
            return Ok(with_parent_group(path)?.unwrap_or((store, String::new(), Map::new())));
        }
        for name in ["chart", "film"] {
            if Node::read(&store, name)?.is_some_and(|n| n.is_array) {
                return Ok((store, name.into(), root.attributes));
            }
        }
        return Err(no_array(&store, "\"chart\" or \"film\""));
    }
    if Node::read(&store, requested)?.is_none_or(|n| !n.is_array) {
        return Err(no_array(&store, &format!("{requested:?}")));
    }
    let attributes = root.map(|n| n.attributes).unwrap_or_default();
    Ok((store, requested.into(), attributes))
}

/// An array opened by its directory, as a member of its parent group, which holds its coordinates; `None` without a group.
fn with_parent_group(path: &Path) -> Result<Option<Found>, ChartError> {
    let real = if is_url(path) { Some(path.to_path_buf()) } else { path.canonicalize().ok() };
    let above = real.as_deref().and_then(|p| Some((p.parent()?, p.file_name()?.to_str()?)));
    let Some((parent, name)) = above.filter(|(parent, _)| is_url(parent) == is_url(path)) else {
        return Ok(None);
    };
    let store = Arc::new(Store::at(parent)?);
    match Node::read(&store, "") {
        Ok(Some(group)) if !group.is_array => Ok(Some((store, name.to_owned(), group.attributes))),
        Err(e) if e.retryable() => Err(e),
        // An unreadable parent is not the group of this array.
        _ => Ok(None),
    }
}

fn no_array(store: &Store, requested: &str) -> ChartError {
    // If the store cannot be listed, the missing array is the error to report.
    let mut names = store.names("").unwrap_or_default();
    names.retain(|n| Node::read(store, n).is_ok_and(|n| n.is_some_and(|n| n.is_array)));
    let found = if names.is_empty() { "none".into() } else { names.join(", ") };
    ChartError::NoArray { path: store.root().into(), requested: requested.into(), found }
}

fn invalid(layout: &Layout, what: &'static str, expected: &str, found: &Value) -> ChartError {
    ChartError::Metadata {
        path: layout.store.root().into(),
        array: layout.name.clone(),
        what,
        expected: expected.into(),
        found: found.to_string(),
    }
}

fn pitch(layout: &Layout, v: &Value) -> Result<f64, ChartError> {
    let number = v.as_f64().filter(|x| bounds::PITCH_UM.contains(*x));
    number.ok_or_else(|| invalid(layout, "pitch_um", &format!("a number from {}", bounds::PITCH_UM), v))
}

fn size(layout: &Layout, v: &Value) -> Result<Size, ChartError> {
    let side = |v: &Value| v.as_u64().and_then(|n| usize::try_from(n).ok());
    let size = match v.as_array().map(Vec::as_slice) {
        Some([h, w]) => side(h).zip(side(w)).and_then(|(h, w)| bounds::film_size(Size::new(h, w)).ok()),
        _ => None,
    };
    let expected = format!("[rows, columns], each {}", bounds::FILM_SIDE_PX);
    size.ok_or_else(|| invalid(layout, "film_size", &expected, v))
}

#[cfg(test)]
mod tests {
    #[test]
    fn split_array_ignores_the_slashes_of_a_url_scheme() {
        for (spec, expected) in [
            ("s3://bucket/film.zarr", ("s3://bucket/film.zarr", "")),
            ("s3://bucket/film.zarr//film", ("s3://bucket/film.zarr", "film")),
            ("http://host:80/a/film.zarr", ("http://host:80/a/film.zarr", "")),
            ("nowhere/film.zarr//film", ("nowhere/film.zarr", "film")),
            ("nowhere/film.zarr", ("nowhere/film.zarr", "")),
        ] {
            assert_eq!(super::split_array(spec), expected);
        }
    }
}
