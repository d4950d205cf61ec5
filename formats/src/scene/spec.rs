//! What a scene is: its arrays, coordinates, shards; and how the attributes hold it.

use pipeline::bounds::{self, Bound};
use pipeline::geometry::{Rect, Size};
use pipeline::projection::{FilmProjection, Projection};
use pipeline::tiling::FilmRegion;
use serde_json::{Map, Value, json};

use crate::group::{Derived, GroupKind};
use crate::hierarchy::{array, coordinate};
use crate::object;
use crate::shard::{Codec, SampleType, sharding_of};

/// Surfaces of a pixel.
const SHEETS: Bound = Bound { name: "the number of surfaces", unit: "", min: 1.0, max: 8.0 };
/// Spectra of a scene.
const BASES: Bound = Bound { name: "the number of spectra", unit: "", min: 1.0, max: 4096.0 };

/// One plane of numbers of a scene, rows and columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Plane {
    /// Weight of a basis.
    Weight(usize),
    /// Distance.
    Depth,
    /// Coverage.
    Coverage,
    /// Number of the object, of the first surface alone.
    Object,
}

/// A file of a scene: a shard of a plane of a sheet, 0 the first one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct SceneShard {
    /// Row and column in the grid of shards.
    pub place: (usize, usize),
    /// Surface, from the nearest.
    pub sheet: usize,
    /// What it holds.
    pub plane: Plane,
}

impl SceneShard {
    /// Path of the file in the scene.
    pub fn key(&self) -> String {
        let (i, j) = self.place;
        let group = group_of(self.sheet);
        match self.plane {
            Plane::Weight(basis) => format!("{group}weights/c/{basis}/{i}/{j}"),
            Plane::Depth => format!("{group}depth/c/{i}/{j}"),
            Plane::Coverage => format!("{group}coverage/c/{i}/{j}"),
            Plane::Object => format!("{group}object/c/{i}/{j}"),
        }
    }

    /// Fill value of its array.
    pub fn fill_value(&self) -> f32 {
        fill_value(self.sheet, self.plane)
    }
}

/// Prefix of the arrays of a surface.
fn group_of(sheet: usize) -> String {
    if sheet == 0 { String::new() } else { format!("hidden/{sheet}/") }
}

/// Fill value of the array of a plane.
fn fill_value(sheet: usize, plane: Plane) -> f32 {
    if sheet == 0 && plane == Plane::Coverage { 1.0 } else { 0.0 }
}

/// What a scene is.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneSpec {
    /// Size of the chart in pixels.
    pub size: Size,
    /// Surfaces of a pixel: one seen first, the others hidden.
    pub sheets: usize,
    /// Number of spectra.
    pub bases: usize,
    /// Pixel pitch in µm.
    pub pitch_um: f64,
    /// Middle of the chart (y, x) from the optical axis, mm.
    pub centre_mm: (f64, f64),
    /// Rows and columns of a shard in pixels, multiples of `chunk`; a smaller scene has smaller shards.
    pub shard: (usize, usize),
    /// Side of an inner chunk in pixels.
    pub chunk: usize,
    /// Whether weights are 16-bit floats.
    pub half: bool,
    /// Whether there are numbers of objects.
    pub ids: bool,
    /// The plane of the chart.
    pub projection: Projection,
}

/// Attribute of a projection of the film.
const FILM_PROJECTION: &str = "film_projection";

impl SceneSpec {
    /// Rows and columns of a shard, and the side of a chunk.
    pub const LAYOUT: ((usize, usize), usize) = ((512, 2048), 512);

    /// The shards of a plane.
    fn grid(&self) -> FilmRegion {
        FilmRegion { rect: self.size.rect(), shard: self.shard_shape() }
    }

    /// Shape of a shard in pixels.
    pub fn shard_shape(&self) -> Size {
        let side = |n: usize, shard: usize| shard.min(n.div_ceil(self.chunk) * self.chunk);
        Size::new(side(self.size.height, self.shard.0), side(self.size.width, self.shard.1))
    }

    /// Shards (down, across) of a plane.
    pub fn shards(&self) -> (usize, usize) {
        self.grid().count()
    }

    /// Pixels of the shards at `place`.
    pub fn shard_rect(&self, place: (usize, usize)) -> Rect {
        self.grid().shard_rect(place.0, place.1)
    }

    /// The planes of a surface.
    fn planes(&self, sheet: usize) -> impl Iterator<Item = Plane> + use<> {
        let object = (self.ids && sheet == 0).then_some(Plane::Object);
        (0..self.bases).map(Plane::Weight).chain([Plane::Depth, Plane::Coverage]).chain(object)
    }

    /// Bytes of all pixels before compression.
    pub fn bytes(&self) -> u64 {
        let of_sheet = self.bases * self.weight_sample().bytes() + 2 * size_of::<f32>();
        let of_objects = if self.ids { size_of::<u32>() } else { 0 };
        ((self.sheets * of_sheet + of_objects) * self.size.pixels()) as u64
    }

    /// Sample type of weights.
    pub(super) fn weight_sample(&self) -> SampleType {
        if self.half { SampleType::F16 } else { SampleType::F32 }
    }

    /// The shards at `place`, of all surfaces and planes.
    pub fn shards_at(&self, place: (usize, usize)) -> impl Iterator<Item = SceneShard> + '_ {
        (0..self.sheets)
            .flat_map(move |sheet| self.planes(sheet).map(move |plane| SceneShard { place, sheet, plane }))
    }

    /// Every shard, row by row.
    pub fn all_shards(&self) -> impl Iterator<Item = SceneShard> + '_ {
        let (down, across) = self.shards();
        let places = (0..down).flat_map(move |i| (0..across).map(move |j| (i, j)));
        places.flat_map(|place| self.shards_at(place))
    }

    /// The files that follow from the attributes.
    pub(super) fn derived(&self) -> Derived {
        Derived { coordinates: self.coordinates(), arrays: self.nodes() }
    }

    fn coordinates(&self) -> Vec<(String, (Value, Vec<u8>))> {
        let mm = |n: usize, centre: f64| -> Vec<f64> {
            let middle = (n as f64 - 1.0) / 2.0;
            (0..n).map(|i| (i as f64 - middle) * (self.pitch_um * 1e-3) + centre).collect()
        };
        let numbers: Vec<f64> = (0..self.bases).map(|b| b as f64).collect();
        let (down, across) = (mm(self.size.height, self.centre_mm.0), mm(self.size.width, self.centre_mm.1));
        let plane = match self.projection {
            Projection::Planar => "the ideal image plane",
            Projection::Film(_) => "the film at the primary wavelength",
        };
        let on_plane = |direction: &str| format!("distance {direction} the optical axis on {plane}");
        vec![
            (
                "basis".to_owned(),
                coordinate("basis", "1", "number of the spectrum in the attribute bases", &numbers),
            ),
            ("y".to_owned(), coordinate("y", "mm", &on_plane("below"), &down)),
            ("x".to_owned(), coordinate("x", "mm", &on_plane("right of"), &across)),
        ]
    }

    /// Name and metadata of every group and array but coordinates.
    pub(super) fn nodes(&self) -> Vec<(String, Value)> {
        let group = || json!({"zarr_format": 3, "node_type": "group", "attributes": {}});
        let mut all = Vec::new();
        if self.sheets > 1 {
            all.push(("hidden".to_owned(), group()));
        }
        for sheet in 0..self.sheets {
            if sheet > 0 {
                all.push((format!("hidden/{sheet}"), group()));
            }
            let prefix = group_of(sheet);
            let planes =
                [("weights", Plane::Weight(0)), ("depth", Plane::Depth), ("coverage", Plane::Coverage)];
            let object = (self.ids && sheet == 0).then_some(("object", Plane::Object));
            for (name, plane) in planes.into_iter().chain(object) {
                all.push((format!("{prefix}{name}"), self.array(sheet, plane)));
            }
        }
        all
    }

    /// Metadata of the array of a plane.
    fn array(&self, sheet: usize, plane: Plane) -> Value {
        let (shard, Size { height, width }) = (self.shard_shape(), self.size);
        let c = self.chunk;
        let (shape, chunk, dimensions, inner, attributes) = match plane {
            Plane::Weight(_) => (
                vec![self.bases, height, width],
                vec![1, shard.height, shard.width],
                vec!["basis", "y", "x"],
                vec![1, c, c],
                json!({"long_name": "weight of a spectrum", "units": "1"}),
            ),
            Plane::Depth | Plane::Coverage | Plane::Object => (
                vec![height, width],
                vec![shard.height, shard.width],
                vec!["y", "x"],
                vec![c, c],
                match plane {
                    Plane::Depth => {
                        json!({"long_name": "distance along the axis", "units": "m", "unit": "m", "kind": "planar"})
                    }
                    Plane::Object => {
                        json!({"long_name": "object seen first, its node + 1; 0: none", "units": "1"})
                    }
                    _ => {
                        json!({"long_name": "share of the pixel that the surface covers", "units": "1", "light": "straight"})
                    }
                },
            ),
        };
        let sample = if let Plane::Weight(_) = plane { self.weight_sample() } else { SampleType::F32 };
        let codecs = sharding_of(Codec::Zstd, sample, &inner, false);
        let name = if plane == Plane::Object { "uint32" } else { sample.name() };
        let mut metadata = array(&shape, &chunk, name, codecs, &dimensions, attributes);
        metadata["fill_value"] = match plane {
            Plane::Object => json!(0),
            _ => json!(fill_value(sheet, plane)),
        };
        metadata
    }

    pub(super) fn attributes(&self, further: &Map<String, Value>) -> Map<String, Value> {
        let mut all = object! {
            "schema": GroupKind::Scene.schema(),
            "layout": json!({
                "size": [self.size.height, self.size.width],
                "sheets": self.sheets,
                "bases": self.bases,
                "centre_mm": {"y": self.centre_mm.0, "x": self.centre_mm.1},
                "shard": [self.shard.0, self.shard.1],
                "chunk": self.chunk,
            }),
            "pitch_um": self.pitch_um,
        };
        // Absent without: the attributes are then those of programs without these options.
        for (key, is_set) in [("half", self.half), ("ids", self.ids)] {
            if is_set {
                all["layout"][key] = true.into();
            }
        }
        if let Projection::Film(film) = self.projection {
            all.insert(FILM_PROJECTION.into(), film_projection_json(&film));
        }
        all.extend(further.clone());
        all
    }

    /// Reads the attributes back: the layout, and what else there is. `None` if they are not those of a scene.
    pub(super) fn from_attributes(mut all: Map<String, Value>) -> Option<(Self, Map<String, Value>)> {
        all.shift_remove("schema")?;
        let a = all.shift_remove("layout")?;
        let (height, width) = serde_json::from_value(a["size"].clone()).ok()?;
        let count = |key: &str| usize::try_from(a[key].as_u64()?).ok();
        let is_set = |key: &str| a.get(key).map_or(Some(false), Value::as_bool);
        let projection = match all.shift_remove(FILM_PROJECTION) {
            None => Projection::Planar,
            Some(value) => Projection::Film(film_projection(&value)?),
        };
        let spec = Self {
            size: Size::new(height, width),
            sheets: count("sheets")?,
            bases: count("bases")?,
            pitch_um: all.shift_remove("pitch_um")?.as_f64()?,
            centre_mm: (a["centre_mm"]["y"].as_f64()?, a["centre_mm"]["x"].as_f64()?),
            shard: serde_json::from_value(a["shard"].clone()).ok()?,
            chunk: count("chunk")?,
            half: is_set("half")?,
            ids: is_set("ids")?,
            projection,
        };
        spec.holds().then_some((spec, all))
    }

    /// Whether all numbers are within their bounds.
    pub fn holds(&self) -> bool {
        let is_side = |n: usize| {
            bounds::SHARD_SIDE_PX.check_count(n).is_ok() && self.chunk > 0 && n.is_multiple_of(self.chunk)
        };
        let counts = SHEETS.check_count(self.sheets).is_ok()
            && BASES.check_count(self.bases).is_ok()
            && bounds::film_size(self.size).is_ok()
            && bounds::PITCH_UM.contains(self.pitch_um)
            && self.centre_mm.0.is_finite()
            && self.centre_mm.1.is_finite();
        let is_shown = match &self.projection {
            Projection::Planar => true,
            Projection::Film(film) => film.ascends(),
        };
        counts && is_shown && is_side(self.shard.0) && is_side(self.shard.1) && {
            let (down, across) = self.shards();
            bounds::SHARDS.check_product(&[self.sheets, self.bases + 3, down, across]).is_ok()
        }
    }
}

/// θ(r), radians and mm: r Σ_k coefficients_k T_k(2 (r/radius_mm)² − 1), beyond the radius with its slope there.
fn film_projection_json(film: &FilmProjection) -> Value {
    json!({ "focal_mm": film.focal_mm, "radius_mm": film.radius_mm, "coefficients": film.coefficients })
}

/// The projection that `value` describes; none if it describes none.
fn film_projection(value: &Value) -> Option<FilmProjection> {
    let coefficients: Vec<f64> = serde_json::from_value(value["coefficients"].clone()).ok()?;
    Some(FilmProjection {
        focal_mm: value["focal_mm"].as_f64()?,
        radius_mm: value["radius_mm"].as_f64()?,
        coefficients: coefficients.try_into().ok()?,
    })
}
