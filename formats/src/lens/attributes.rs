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
/// Schema of a pack of a lens without rotational symmetry.
pub const PLANAR_SCHEMA: &str = "lenscube/lens-pack/4";

/// Attribute with the names of optional groups that change pixels.
pub(super) const EXTRAS: &str = "extras";
/// The optional group of tails.
pub(super) const TAIL: &str = "tail";
/// Middle parts of PSFs with tails, in the group of tails.
pub(super) const MIDDLE: &str = "middle";
/// The optional group of directions of light at the film.
pub(super) const CONES: &str = "cones";
/// The optional group of ghosts.
pub(super) const GHOST: &str = "ghost";
/// Attribute with the places of the PSFs of a lens without rotational symmetry.
pub(super) const PSF_FIELD: &str = "psf_field";
/// Attribute of a sealed pack, true.
pub(super) const SEALED: &str = "sealed";
/// Attribute with the film place of the PSFs.
pub(super) const REFERENCE_POINT: &str = "reference_point";

/// Optional groups of a pack.
pub(super) struct Extras {
    /// Tails of the PSFs.
    pub(super) has_tail: bool,
    /// Whether tails have middle parts.
    pub(super) has_middle: bool,
    /// Directions of the light at the film.
    pub(super) has_cones: bool,
    /// Ghosts.
    pub(super) has_ghosts: bool,
}

/// Places of the PSFs of a lens without rotational symmetry: attribute `psf_field`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PsfField {
    /// At heights and azimuths.
    Polar,
    /// At columns and rows of the film.
    Grid,
}

impl PsfField {
    /// The value of the attribute.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Polar => "polar",
            Self::Grid => "grid",
        }
    }
}

/// The point of the image of a field point that the map gives, and on which the PSF windows are centred.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReferencePoint {
    /// Of a traced lens: where the chief ray meets the film.
    ChiefRay,
    /// The centroid of the light.
    Centroid,
    /// Of a measured lens: as the source of map and PSFs has it.
    AsGiven,
}

impl ReferencePoint {
    const ALL: [Self; 3] = [Self::ChiefRay, Self::Centroid, Self::AsGiven];

    /// The value of the attribute.
    pub fn name(self) -> &'static str {
        match self {
            Self::ChiefRay => "chief ray",
            Self::Centroid => "centroid",
            Self::AsGiven => "as given",
        }
    }
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
    /// Of a lens without rotational symmetry: the point that its map gives.
    pub reference_point: Option<ReferencePoint>,
    /// The errors drawn of a built lens: file, digest, seed, sample and values.
    pub errors: Option<Value>,
    /// What compensates them: shift and tilt of the film, boresight.
    pub compensators: Option<Value>,
    /// Whether its maker sealed it ([`PackAttributes::sealed`]).
    pub sealed: bool,
}

impl PackAttributes {
    /// What a sealed pack has of these: conventions, accuracy and the program. Without design and coatings, the place of the film in the design, drawn errors
    /// and their compensation.
    #[must_use]
    pub fn sealed(self) -> Self {
        let program = self.source.as_ref().and_then(|source| source.get("program")).cloned();
        Self {
            frame: self.frame,
            psf_tolerance: self.psf_tolerance,
            source: program.map(|program| serde_json::json!({ "program": program })),
            reference_point: self.reference_point,
            sealed: true,
            ..Self::default()
        }
    }
}

/// Attributes of a group with schema [`SCHEMA`], [`DEPTH_SCHEMA`], [`PUPIL_SCHEMA`] or [`PLANAR_SCHEMA`].
pub(super) struct Attributes<'a> {
    store: &'a PackStore,
    map: Map<String, Value>,
    /// Whether the pack has depth nodes.
    pub(super) has_depth: bool,
    /// Whether the schema has pupil functions in place of PSFs.
    pub(super) has_pupils: bool,
    /// Places of the PSFs, if the pack is of a lens without rotational symmetry.
    pub(super) psf_field: Option<PsfField>,
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
            Some(Value::String(s))
                if [SCHEMA, DEPTH_SCHEMA, PUPIL_SCHEMA, PLANAR_SCHEMA].contains(&s.as_str()) =>
            {
                let (has_depth, has_pupils) = (s == DEPTH_SCHEMA, s == PUPIL_SCHEMA);
                let is_planar = s == PLANAR_SCHEMA;
                let mut head = Self { store, map: attributes, has_depth, has_pupils, psf_field: None };
                if is_planar {
                    head.psf_field = Some(head.psf_field()?);
                }
                Ok(head)
            }
            found => Err(LensPackError::Schema {
                path: store.path.clone(),
                found: found.map_or("missing".into(), Value::to_string),
                expected: format!(
                    "\"{SCHEMA}\", \"{DEPTH_SCHEMA}\", \"{PUPIL_SCHEMA}\" or \"{PLANAR_SCHEMA}\""
                ),
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
        let mut extras = Extras { has_tail: false, has_middle: false, has_cones: false, has_ghosts: false };
        let expected =
            "a list of names of optional groups: \"tail\", \"middle\" (with \"tail\"), \"cones\", \"ghost\"";
        let names = match self.map.get(EXTRAS) {
            None | Some(Value::Null) => return Ok(extras),
            Some(Value::Array(names)) => names,
            Some(_) => return Err(self.invalid(EXTRAS, expected)),
        };
        for name in names {
            match name.as_str() {
                Some(TAIL) if self.psf_field.is_some() => {
                    return Err(
                        self.invalid(EXTRAS, "no \"tail\": it belongs to lenses with rotational symmetry")
                    );
                }
                Some(TAIL) => extras.has_tail = true,
                Some(MIDDLE) => extras.has_middle = true,
                Some(CONES) => extras.has_cones = true,
                Some(GHOST) if self.psf_field.is_some() || self.has_depth => {
                    let expected =
                        "no \"ghost\": it belongs to lenses with rotational symmetry and one object distance";
                    return Err(self.invalid(EXTRAS, expected));
                }
                Some(GHOST) => extras.has_ghosts = true,
                _ => return Err(self.invalid(EXTRAS, expected)),
            }
        }
        if extras.has_middle && !extras.has_tail {
            return Err(self.invalid(EXTRAS, expected));
        }
        Ok(extras)
    }

    /// Any JSON value.
    pub(super) fn any(&self, name: &str) -> Option<Value> {
        self.map.get(name).filter(|v| !v.is_null()).cloned()
    }

    /// The optional mark of a sealed pack.
    pub(super) fn sealed(&self) -> Result<bool, LensPackError> {
        match self.map.get(SEALED) {
            None | Some(Value::Null) => Ok(false),
            Some(Value::Bool(sealed)) => Ok(*sealed),
            Some(_) => Err(self.invalid(SEALED, "true or false")),
        }
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

    /// The required `psf_field` of a lens without rotational symmetry.
    fn psf_field(&self) -> Result<PsfField, LensPackError> {
        let found = self.map.get(PSF_FIELD).and_then(Value::as_str);
        [PsfField::Polar, PsfField::Grid]
            .into_iter()
            .find(|field| found == Some(field.name()))
            .ok_or_else(|| self.invalid(PSF_FIELD, "\"polar\" or \"grid\""))
    }

    /// The optional `reference_point` of a lens without rotational symmetry.
    pub(super) fn reference_point(&self) -> Result<Option<ReferencePoint>, LensPackError> {
        let found = match self.map.get(REFERENCE_POINT) {
            None | Some(Value::Null) => return Ok(None),
            _ if self.psf_field.is_none() => return Ok(None),
            Some(found) => found.as_str(),
        };
        match ReferencePoint::ALL.into_iter().find(|point| found == Some(point.name())) {
            Some(point) => Ok(Some(point)),
            None => Err(self.invalid(REFERENCE_POINT, "\"chief ray\", \"centroid\" or \"as given\"")),
        }
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
