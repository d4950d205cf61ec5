//! Attributes of a pack's group.

use super::error::LensPackError;
use super::store::{MAX_METADATA_BYTES, PackStore};
use pipeline::bounds::{Bound, OutOfBounds};
use pipeline::lens::PsfSample;
use serde_json::{Map, Value};

/// Schema of a pack with one object distance.
pub const SCHEMA: &str = "lenscube/lens-pack/1";
/// Schema of a pack with depth nodes.
pub const DEPTH_SCHEMA: &str = "lenscube/lens-pack/2";
/// Schema of a pack with one object distance and pupil functions in place of PSFs.
pub const PUPIL_SCHEMA: &str = "lenscube/lens-pack/3";

/// Attribute with the names of optional groups that change pixels.
pub(super) const EXTRAS: &str = "extras";
/// The optional group of tails.
pub(super) const TAIL: &str = "tail";

/// Optional groups of a pack.
pub(super) struct Extras {
    /// Tails of the PSFs.
    pub(super) has_tail: bool,
}

/// Descriptive attributes of a pack: printed, not used in any calculation.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PackAttributes {
    /// Definition of the image plane.
    pub image_plane: Option<String>,
    /// Image plane minus paraxial focus, mm; positive away from the lens.
    pub defocus_mm: Option<f64>,
    /// Conventions of coordinates.
    pub frame: Option<String>,
    /// Error bounds of the PSFs.
    pub psf_tolerance: Option<Value>,
    /// Program, version, file, settings.
    pub source: Option<Value>,
}

/// Attributes of a group with schema [`SCHEMA`], [`DEPTH_SCHEMA`] or [`PUPIL_SCHEMA`].
pub(super) struct Attributes<'a> {
    store: &'a PackStore,
    map: Map<String, Value>,
    /// Whether the pack has depth nodes.
    pub(super) has_depth: bool,
    /// Whether the pack has pupil functions in place of PSFs.
    pub(super) has_pupils: bool,
}

impl<'a> Attributes<'a> {
    /// Reads the group's attributes and checks its schema.
    pub(super) fn of_group(store: &'a PackStore) -> Result<Self, LensPackError> {
        let not_a_pack = |problem: String| LensPackError::NotAPack { path: store.path.clone(), problem };
        let bytes = match store.read("zarr.json", MAX_METADATA_BYTES) {
            Ok(Some(bytes)) => bytes,
            Ok(None) if matches!(store.size(".zgroup"), Ok(Some(_))) => {
                return Err(not_a_pack("it is a Zarr v2 group".into()));
            }
            Ok(None) => return Err(not_a_pack("it has no zarr.json".into())),
            Err(e) => {
                return Err(store.read_error(e, |e| not_a_pack(format!("its zarr.json cannot be read: {e}"))));
            }
        };
        let mut json: Value = serde_json::from_slice(&bytes)
            .map_err(|e| not_a_pack(format!("its zarr.json is not JSON: {e}")))?;
        if json["zarr_format"] != 3 || json["node_type"] != "group" {
            return Err(not_a_pack(format!(
                "its zarr_format is {}, its node_type {}",
                json["zarr_format"], json["node_type"]
            )));
        }
        let attributes = match json["attributes"].take() {
            Value::Object(map) => map,
            _ => Map::new(),
        };
        match attributes.get("schema") {
            Some(Value::String(s)) if [SCHEMA, DEPTH_SCHEMA, PUPIL_SCHEMA].contains(&s.as_str()) => {
                let (has_depth, has_pupils) = (s == DEPTH_SCHEMA, s == PUPIL_SCHEMA);
                Ok(Self { store, map: attributes, has_depth, has_pupils })
            }
            found => Err(LensPackError::Schema {
                path: store.path.clone(),
                found: found.map_or("missing".into(), Value::to_string),
                expected: format!("\"{SCHEMA}\", \"{DEPTH_SCHEMA}\" or \"{PUPIL_SCHEMA}\""),
            }),
        }
    }

    fn invalid(&self, name: &'static str, expected: &str) -> LensPackError {
        let found = self.map.get(name).map_or("is missing".into(), |v| format!("is {v}"));
        LensPackError::Attribute {
            path: self.store.path.clone(),
            name,
            problem: format!("{found}, expected {expected}"),
        }
    }

    /// Error of a number out of its bounds.
    pub(super) fn out_of_bounds(&self, name: &'static str, e: &OutOfBounds) -> LensPackError {
        let problem = format!("is out of bounds: {e}");
        LensPackError::Attribute { path: self.store.path.clone(), name, problem }
    }

    /// The optional groups; an unknown one is an error, since it changes pixels.
    pub(super) fn extras(&self) -> Result<Extras, LensPackError> {
        let mut extras = Extras { has_tail: false };
        let expected = "a list of names of optional groups: \"tail\"";
        let names = match self.map.get(EXTRAS) {
            None | Some(Value::Null) => return Ok(extras),
            Some(Value::Array(names)) => names,
            Some(_) => return Err(self.invalid(EXTRAS, expected)),
        };
        for name in names {
            match name.as_str() {
                Some(TAIL) => extras.has_tail = true,
                _ => return Err(self.invalid(EXTRAS, expected)),
            }
        }
        Ok(extras)
    }

    /// Any JSON value.
    pub(super) fn any(&self, name: &str) -> Option<Value> {
        self.map.get(name).filter(|v| !v.is_null()).cloned()
    }

    /// A text; a value of another type counts as missing.
    pub(super) fn text(&self, name: &str) -> Option<String> {
        self.map.get(name).and_then(Value::as_str).map(str::to_owned)
    }

    /// A required positive number.
    pub(super) fn positive(&self, name: &'static str) -> Result<f64, LensPackError> {
        let value = self.map.get(name).and_then(Value::as_f64).filter(|v| v.is_finite() && *v > 0.0);
        value.ok_or_else(|| self.invalid(name, "a positive number"))
    }

    /// Missing, null and "Infinity" are `None`.
    pub(super) fn number_or_null(&self, name: &'static str) -> Result<Option<f64>, LensPackError> {
        match self.map.get(name) {
            None | Some(Value::Null) => Ok(None),
            Some(Value::String(s)) if s == "Infinity" => Ok(None),
            Some(v) => match v.as_f64() {
                Some(v) if v.is_finite() => Ok(Some(v)),
                _ => Err(self.invalid(name, "a number or null")),
            },
        }
    }

    /// A required number within `bound`; null and "Infinity" stand for infinity.
    pub(super) fn bounded(&self, name: &'static str, bound: Bound) -> Result<f64, LensPackError> {
        if !self.map.contains_key(name) {
            return Err(self.invalid(name, "a number"));
        }
        let value = self.number_or_null(name)?.unwrap_or(f64::INFINITY);
        bound.check(value).map_err(|e| self.out_of_bounds(name, &e))
    }

    /// The required `psf_sample`.
    pub(super) fn sample(&self) -> Result<PsfSample, LensPackError> {
        match self.map.get("psf_sample").and_then(Value::as_str) {
            Some("point") => Ok(PsfSample::Point),
            Some("integrated") => Ok(PsfSample::Integrated),
            _ => Err(self.invalid("psf_sample", "\"point\" or \"integrated\"")),
        }
    }
}
