//! The attributes of a pack's group.

use super::SCHEMA;
use super::array::METADATA_LIMIT;
use super::error::LensPackError;
use super::store::Store;
use pipeline::bounds::OutOfBounds;
use pipeline::lens::PsfSample;
use serde_json::{Map, Value};

/// Attributes of a group whose schema is this program's.
pub(super) struct Attributes<'a> {
    store: &'a Store,
    map: Map<String, Value>,
}

impl<'a> Attributes<'a> {
    /// The group's attributes, its schema checked.
    pub(super) fn of_group(store: &'a Store) -> Result<Self, LensPackError> {
        let not = |problem: String| LensPackError::NotAPack { path: store.path.clone(), problem };
        let bytes = match store.read("zarr.json", METADATA_LIMIT) {
            Ok(Some(bytes)) => bytes,
            Ok(None) if matches!(store.size(".zgroup"), Ok(Some(_))) => {
                return Err(not("it is a Zarr v2 group".into()));
            }
            Ok(None) => return Err(not("it has no zarr.json".into())),
            Err(e) => return Err(store.unread(e, |e| not(format!("its zarr.json cannot be read: {e}")))),
        };
        let mut json: Value =
            serde_json::from_slice(&bytes).map_err(|e| not(format!("its zarr.json is not JSON: {e}")))?;
        if json["zarr_format"] != 3 || json["node_type"] != "group" {
            return Err(not(format!(
                "its zarr_format is {}, its node_type {}",
                json["zarr_format"], json["node_type"]
            )));
        }
        let attributes = match json["attributes"].take() {
            Value::Object(map) => map,
            _ => Map::new(),
        };
        match attributes.get("schema") {
            Some(Value::String(s)) if s == SCHEMA => Ok(Self { store, map: attributes }),
            found => Err(LensPackError::Schema {
                path: store.path.clone(),
                found: found.map_or("missing".into(), Value::to_string),
                expected: SCHEMA,
            }),
        }
    }

    fn unfit(&self, name: &'static str, expected: &str) -> LensPackError {
        let found = self.map.get(name).map_or("is missing".into(), |v| format!("is {v}"));
        LensPackError::Attribute {
            path: self.store.path.clone(),
            name,
            problem: format!("{found}, expected {expected}"),
        }
    }

    /// The error for a number beyond its bound.
    pub(super) fn beyond(&self, name: &'static str, e: &OutOfBounds) -> LensPackError {
        let problem = format!("is out of bounds: {e}");
        LensPackError::Attribute { path: self.store.path.clone(), name, problem }
    }

    /// Any JSON value.
    pub(super) fn any(&self, name: &str) -> Option<Value> {
        self.map.get(name).filter(|v| !v.is_null()).cloned()
    }

    /// A text; anything else is taken as missing.
    pub(super) fn text(&self, name: &str) -> Option<String> {
        self.map.get(name).and_then(Value::as_str).map(str::to_owned)
    }

    /// A required positive number.
    pub(super) fn positive(&self, name: &'static str) -> Result<f64, LensPackError> {
        let value = self.map.get(name).and_then(Value::as_f64).filter(|v| v.is_finite() && *v > 0.0);
        value.ok_or_else(|| self.unfit(name, "a positive number"))
    }

    /// Missing, null and "Infinity" are `None`.
    pub(super) fn number_or_null(&self, name: &'static str) -> Result<Option<f64>, LensPackError> {
        match self.map.get(name) {
            None | Some(Value::Null) => Ok(None),
            Some(Value::String(s)) if s == "Infinity" => Ok(None),
            Some(v) => match v.as_f64() {
                Some(v) if v.is_finite() => Ok(Some(v)),
                _ => Err(self.unfit(name, "a number or null")),
            },
        }
    }

    /// The required `psf_sample`.
    pub(super) fn sample(&self) -> Result<PsfSample, LensPackError> {
        match self.map.get("psf_sample").and_then(Value::as_str) {
            Some("point") => Ok(PsfSample::Point),
            Some("integrated") => Ok(PsfSample::Integrated),
            _ => Err(self.unfit("psf_sample", "\"point\" or \"integrated\"")),
        }
    }
}
