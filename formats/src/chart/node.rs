//! Nodes and arrays of a Zarr store, v2 or v3.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use serde_json::{Map, Value};
use zarrs::array::Array;

use super::error::ChartError;
use crate::durable::{Store, store_error};

/// Maximum size of a metadata file.
const MAX_METADATA_BYTES: u64 = 64 << 20;

/// A group or array.
pub(super) struct Node {
    pub(super) is_array: bool,
    pub(super) attributes: Map<String, Value>,
}

impl Node {
    /// Reads the node `name` (empty: the root); `None` if there is none.
    pub(super) fn read(store: &Store, name: &str) -> Result<Option<Self>, ChartError> {
        let key = |file: &str| if name.is_empty() { file.to_owned() } else { format!("{name}/{file}") };
        let json = |file: &str| -> Result<Option<Map<String, Value>>, ChartError> {
            let Some(bytes) = store.read_at_most(&key(file), MAX_METADATA_BYTES)? else {
                return Ok(None);
            };
            serde_json::from_slice(&bytes).map(Some).map_err(|e| ChartError::Metadata {
                path: store.root().into(),
                array: name.into(),
                what: "metadata",
                expected: format!("a JSON object in {}", key(file)),
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

/// Opens the array `name`; an error or panic of zarrs becomes an error of the metadata.
pub(super) fn open_array(store: &Arc<Store>, name: &str) -> Result<Array<Store>, ChartError> {
    let path = store.root();
    let invalid = |found: String| ChartError::Metadata {
        path: path.into(),
        array: name.into(),
        what: "metadata",
        expected: "a Zarr v2 or v3 array with known codecs".into(),
        found,
    };
    let open = || {
        Array::open(store.clone(), &format!("/{name}")).map_err(|e| {
            store_error("read", &path.join(name), &e).map_or_else(|| invalid(e.to_string()), Into::into)
        })
    };
    catch_unwind(AssertUnwindSafe(open))
        .unwrap_or_else(|_| Err(invalid("metadata on which zarrs failed".into())))
}
