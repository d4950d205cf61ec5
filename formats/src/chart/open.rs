//! From `PATH` or `PATH//array` to a chart whose metadata holds together.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::{Arc, OnceLock};

use pipeline::bounds;
use pipeline::geometry::Size;
use serde_json::{Map, Value};
use zarrs::array::{Array, ArrayMetadata};

use super::cache::Cache;
use super::coordinates::{self, dimension_names};
use super::layout::Layout;
use super::stamps::Stamps;
use super::{ChartError, ChartOptions, ChartStore, Counters};
use crate::durable::{Store, is_url, store_error};

/// Metadata larger than this is not metadata.
const MAX_METADATA: u64 = 64 << 20;
/// Bytes of shard indexes to keep: two hundred thousand inner chunks, thousands of shards.
const INDEX_CACHE: usize = 4 << 20;

/// A node of a Zarr hierarchy, v2 or v3.
pub(super) struct Node {
    pub(super) is_array: bool,
    pub(super) attributes: Map<String, Value>,
}

impl Node {
    /// The node at `name` (empty: the root). `None` if there is none.
    pub(super) fn read(store: &Store, name: &str) -> Result<Option<Self>, ChartError> {
        let under = |file: &str| if name.is_empty() { file.to_owned() } else { format!("{name}/{file}") };
        let json = |file: &str| -> Result<Option<Map<String, Value>>, ChartError> {
            let Some(bytes) = store.read_at_most(&under(file), MAX_METADATA)? else {
                return Ok(None);
            };
            serde_json::from_slice(&bytes).map(Some).map_err(|e| ChartError::Metadata {
                path: store.root().into(),
                array: name.into(),
                what: "metadata",
                expected: format!("a JSON object in {}", under(file)),
                found: e.to_string(),
            })
        };
        let object = |v: Option<Value>| match v {
            Some(Value::Object(m)) => m,
            _ => Map::new(),
        };
        if let Some(mut m) = json("zarr.json")? {
            let is_array = m.get("node_type").and_then(Value::as_str) == Some("array");
            return Ok(Some(Self { is_array, attributes: object(m.remove("attributes")) }));
        }
        for (file, is_array) in [(".zarray", true), (".zgroup", false)] {
            if json(file)?.is_some() {
                return Ok(Some(Self { is_array, attributes: json(".zattrs")?.unwrap_or_default() }));
            }
        }
        Ok(None)
    }
}

/// Opens the array `name`; whatever zarrs makes of the metadata, it is an error of ours.
pub(super) fn open_array(store: &Arc<Store>, name: &str) -> Result<Array<Store>, ChartError> {
    let path = store.root();
    let wrong = |found: String| ChartError::Metadata {
        path: path.into(),
        array: name.into(),
        what: "metadata",
        expected: "a Zarr v2 or v3 array with known codecs".into(),
        found,
    };
    let open = || {
        Array::open(store.clone(), &format!("/{name}")).map_err(|e| {
            store_error("read", &path.join(name), &e).map_or_else(|| wrong(e.to_string()), Into::into)
        })
    };
    catch_unwind(AssertUnwindSafe(open))
        .unwrap_or_else(|_| Err(wrong("metadata that zarrs breaks on".into())))
}

/// The path or URL of a store, and the array in it (empty: none named), of `PATH` or `PATH//array`.
pub fn split_array(spec: &str) -> (&str, &str) {
    match spec.rsplit_once("//") {
        Some((scheme, _)) if scheme.ends_with(':') && is_url(Path::new(spec)) => (spec, ""),
        // A doubled slash in the path of something that is there is only that.
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
    /// [`ChartError`] if there is no chart, or its metadata says what cannot be read.
    pub fn open(spec: &str, options: ChartOptions) -> Result<Self, ChartError> {
        let (path, array) = split_array(spec);
        Self::open_at(Path::new(path), array, options)
    }

    /// Opens the array `array` (empty: `chart`, `film` or the only one) of the store at `path`, whatever the characters of the path.
    ///
    /// # Errors
    /// As [`ChartStore::open`].
    pub fn open_at(path: &Path, array: &str, options: ChartOptions) -> Result<Self, ChartError> {
        let (store, name, group) = find(path, array)?;
        let array = open_array(&store, &name)?;
        let attributes = array.attributes().clone();
        let dimensions = dimension_names(&array);
        let layout = Layout::new(store, &name, array)?;
        coordinates::check_order(&layout, dimensions.as_deref())?;
        let find = |key: &str| attributes.get(key).or_else(|| group.get(key));
        let wavelengths_nm =
            coordinates::wavelengths(&layout, dimensions.as_deref(), &find, options.wavelengths_nm.clone())?;
        let pitch_um = find("pitch_um").map(|v| pitch(&layout, v)).transpose()?;
        let film_size = find("film_size").map(|v| size(&layout, v)).transpose()?;
        let units = find("units").and_then(Value::as_str).map(str::to_owned);
        Ok(Self {
            layout,
            wavelengths_nm,
            pitch_um,
            film_size,
            units,
            cache: Cache::new(options.cache_bytes),
            indexes: Cache::new(INDEX_CACHE),
            options,
            counters: Counters::default(),
            spool: OnceLock::new(),
            stamps: Stamps::default(),
        })
    }
}

type Found = (Arc<Store>, String, Map<String, Value>);

/// The store's root, the array's name in it, and the attributes of the group around it.
fn find(path: &Path, wanted: &str) -> Result<Found, ChartError> {
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
    if wanted.is_empty() {
        let Some(root) = root else {
            return Err(match store.exists()? {
                true => not_zarr("no Zarr metadata (perhaps an unfinished copy)"),
                false => ChartError::NotFound { path: path.into() },
            });
        };
        if root.is_array {
            return Ok(around(path)?.unwrap_or((store, String::new(), Map::new())));
        }
        for name in ["chart", "film"] {
            if Node::read(&store, name)?.is_some_and(|n| n.is_array) {
                return Ok((store, name.into(), root.attributes));
            }
        }
        return Err(no_array(&store, "\"chart\" or \"film\""));
    }
    if Node::read(&store, wanted)?.is_none_or(|n| !n.is_array) {
        return Err(no_array(&store, &format!("{wanted:?}")));
    }
    let attributes = root.map(|n| n.attributes).unwrap_or_default();
    Ok((store, wanted.into(), attributes))
}

/// An array given by its own directory, in its group if it is in one: there are its coordinates.
fn around(path: &Path) -> Result<Option<Found>, ChartError> {
    let real = if is_url(path) { Some(path.to_path_buf()) } else { path.canonicalize().ok() };
    let above = real.as_deref().and_then(|p| Some((p.parent()?, p.file_name()?.to_str()?)));
    let Some((parent, name)) = above.filter(|(parent, _)| is_url(parent) == is_url(path)) else {
        return Ok(None);
    };
    let store = Arc::new(Store::at(parent)?);
    match Node::read(&store, "") {
        Ok(Some(group)) if !group.is_array => Ok(Some((store, name.to_owned(), group.attributes))),
        Err(e) if e.retryable() => Err(e),
        // What cannot be looked into is no group of this array's.
        _ => Ok(None),
    }
}

fn no_array(store: &Store, wanted: &str) -> ChartError {
    // What cannot be listed is not known; the error in hand is told.
    let mut names = store.names("").unwrap_or_default();
    names.retain(|n| Node::read(store, n).is_ok_and(|n| n.is_some_and(|n| n.is_array)));
    let found = if names.is_empty() { "none".into() } else { names.join(", ") };
    ChartError::NoArray { path: store.root().into(), wanted: wanted.into(), found }
}

fn wrong(layout: &Layout, what: &'static str, expected: &str, found: &Value) -> ChartError {
    ChartError::Metadata {
        path: layout.store.root().into(),
        array: layout.name.clone(),
        what,
        expected: expected.into(),
        found: found.to_string(),
    }
}

fn pitch(layout: &Layout, v: &Value) -> Result<f64, ChartError> {
    let number = v.as_f64().filter(|x| bounds::PITCH_UM.holds(*x));
    number.ok_or_else(|| wrong(layout, "pitch_um", &format!("a number from {}", bounds::PITCH_UM), v))
}

fn size(layout: &Layout, v: &Value) -> Result<Size, ChartError> {
    let side = |v: &Value| v.as_u64().and_then(|n| usize::try_from(n).ok());
    let size = match v.as_array().map(Vec::as_slice) {
        Some([h, w]) => side(h).zip(side(w)).and_then(|(h, w)| bounds::film_size(Size::new(h, w)).ok()),
        _ => None,
    };
    let expected = format!("[rows, columns], each {}", bounds::FILM_SIDE_PX);
    size.ok_or_else(|| wrong(layout, "film_size", &expected, v))
}

/// The metadata of `array` without its attributes, as JSON with sorted keys.
pub(super) fn canonical(array: &Array<Store>) -> Value {
    let mut v = match array.metadata() {
        ArrayMetadata::V3(m) => serde_json::to_value(m),
        ArrayMetadata::V2(m) => serde_json::to_value(m),
    }
    .unwrap_or_default();
    if let Value::Object(m) = &mut v {
        m.remove("attributes");
    }
    sorted(v)
}

/// `v` with the keys of every object sorted.
pub(super) fn sorted(v: Value) -> Value {
    match v {
        Value::Object(m) => {
            let mut pairs: Vec<_> = m.into_iter().map(|(k, v)| (k, sorted(v))).collect();
            pairs.sort_by(|a, b| a.0.cmp(&b.0));
            Value::Object(pairs.into_iter().collect())
        }
        Value::Array(a) => Value::Array(a.into_iter().map(sorted).collect()),
        other => other,
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_slashes_of_a_scheme_begin_no_array() {
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
