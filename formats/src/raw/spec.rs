//! What a raw is: its arrays, coordinates, shards; and how the attributes hold it.

use pipeline::bounds;
use pipeline::geometry::{Rect, Size};
use pipeline::tiling::FilmRegion;
use serde_json::{Map, Value, json};

use crate::group::{Derived, GroupKind, Output};
use crate::hierarchy::{array, coordinate};
use crate::object;
use crate::shard::{Codec, SampleType, shard_grid, sharding_of};

/// The array of the kept signal.
pub const SIGNAL: &str = "signal";

/// A file of a raw: a shard of an array, by frame, or of its signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct RawShard {
    /// Output of the spec; the signal is of output 0.
    pub output: usize,
    /// Frame; none: the signal.
    pub frame: Option<usize>,
    /// Row and column in the grid of shards.
    pub place: (usize, usize),
}

/// What a raw is.
#[derive(Clone, Debug, PartialEq)]
pub struct RawSpec {
    /// The arrays.
    pub outputs: Vec<Output>,
    /// Size of the whole sensor in pixels.
    pub sensor: Size,
    /// Pixel pitch in µm.
    pub pitch_um: f64,
    /// Middle of the sensor (y, x) from the optical axis, mm.
    pub centre_mm: (f64, f64),
    /// Exposure time of each frame, s.
    pub exposure_s: Vec<f64>,
    /// Whether the signal is kept.
    pub signal: bool,
    /// Side of a shard in pixels, a multiple of `chunk`; a smaller raw has smaller shards.
    pub shard: usize,
    /// Side of an inner chunk in pixels.
    pub chunk: usize,
}

impl RawSpec {
    /// Sides of shards and chunks.
    pub const LAYOUT: (usize, usize) = (2048, 512);

    /// (rows, columns) of an inner chunk of the usual layout.
    pub const fn chunk_shape() -> (usize, usize) {
        (Self::LAYOUT.1, Self::LAYOUT.1)
    }

    /// The shards of an output.
    pub fn shard_grid(&self, output: usize) -> FilmRegion {
        self.grid_of(self.outputs[output].rect)
    }

    /// The shards of an array with the pixels `rect`.
    pub(super) fn grid_of(&self, rect: Rect) -> FilmRegion {
        shard_grid(rect, self.shard, self.chunk)
    }

    /// (rows, columns) of a shard of an output.
    pub fn shard_shape(&self, output: usize) -> (usize, usize) {
        let shard = self.shard_grid(output).shard;
        (shard.height, shard.width)
    }

    /// Shards (down, across) of an output.
    pub fn shards(&self, output: usize) -> (usize, usize) {
        self.shard_grid(output).count()
    }

    /// Pixels of a shard, in sensor coordinates.
    pub fn shard_rect(&self, shard: RawShard) -> Rect {
        self.shard_grid(shard.output).shard_rect(shard.place.0, shard.place.1)
    }

    /// Every shard: the signal's first.
    pub fn all_shards(&self) -> Vec<RawShard> {
        let mut all = Vec::new();
        for output in 0..self.outputs.len() {
            let (down, across) = self.shards(output);
            let signal = [None].into_iter().filter(|_| self.signal);
            for frame in signal.chain((0..self.exposure_s.len()).map(Some)) {
                let places = (0..down).flat_map(|i| (0..across).map(move |j| (i, j)));
                all.extend(places.map(|place| RawShard { output, frame, place }));
            }
        }
        all
    }

    /// Path of a shard in the raw.
    pub fn key(&self, shard: RawShard) -> String {
        let (i, j) = shard.place;
        match shard.frame {
            Some(frame) => format!("{}/c/{frame}/{i}/{j}", self.outputs[shard.output].name),
            None => format!("{SIGNAL}/c/{i}/{j}"),
        }
    }

    /// The files that follow from the attributes.
    pub(super) fn derived(&self) -> Derived {
        Derived { coordinates: self.coordinates(), arrays: self.arrays() }
    }

    pub(super) fn coordinates(&self) -> Vec<(String, (Value, Vec<u8>))> {
        let mm = |first: i64, n: usize, side: usize, centre: f64| -> Vec<f64> {
            let middle = (side as f64 - 1.0) / 2.0;
            (0..n).map(|i| ((first + i as i64) as f64 - middle) * (self.pitch_um * 1e-3) + centre).collect()
        };
        let frames: Vec<f64> = (0..self.exposure_s.len()).map(|f| f as f64).collect();
        let mut all = vec![
            ("frame".to_owned(), coordinate("frame", "1", "number of the frame", &frames)),
            ("exposure_s".to_owned(), coordinate("frame", "s", "exposure time", &self.exposure_s)),
        ];
        for o in &self.outputs {
            let down = mm(o.rect.y, o.rect.height, self.sensor.height, self.centre_mm.0);
            let across = mm(o.rect.x, o.rect.width, self.sensor.width, self.centre_mm.1);
            all.extend(o.coordinates(&down, &across));
        }
        all
    }

    /// Metadata of an array of digital numbers of `size` with the field of view of `output`.
    pub(super) fn counts_array(&self, output: &Output, size: Size) -> Value {
        let (shard, (y, x)) = (self.grid_of(size.rect()).shard, output.axes());
        let codecs = sharding_of(Codec::Zstd, SampleType::U16, &[1, self.chunk, self.chunk], false);
        let shape = [self.exposure_s.len(), size.height, size.width];
        let (dimensions, units) = (["frame", &y, &x], json!({"units": "DN"}));
        let mut metadata =
            array(&shape, &[1, shard.height, shard.width], "uint16", codecs, &dimensions, units);
        metadata["fill_value"] = json!(0);
        metadata
    }

    /// Name and metadata of every array but coordinates.
    pub(super) fn arrays(&self) -> Vec<(String, Value)> {
        let counts = |o: &Output| (o.name.clone(), self.counts_array(o, o.rect.size()));
        let mut all: Vec<_> = self.outputs.iter().map(counts).collect();
        if self.signal {
            let (rows, columns) = self.shard_shape(0);
            let codecs = sharding_of(Codec::Zstd, SampleType::F32, &[self.chunk, self.chunk], false);
            let rect = self.outputs[0].rect;
            let (y, x) = self.outputs[0].axes();
            let attributes = json!({"units": "s-1", "long_name": "electrons per second"});
            let metadata =
                array(&[rect.height, rect.width], &[rows, columns], "float32", codecs, &[&y, &x], attributes);
            all.push((SIGNAL.into(), metadata));
        }
        all
    }

    pub(super) fn attributes(&self, further: &Map<String, Value>) -> Map<String, Value> {
        let outputs: Vec<Value> = self.outputs.iter().map(Output::to_json).collect();
        let mut all = object! {
            "schema": GroupKind::Raw.schema(),
            "layout": json!({
                "sensor_size": [self.sensor.height, self.sensor.width],
                "pitch_um": self.pitch_um,
                "centre_mm": {"y": self.centre_mm.0, "x": self.centre_mm.1},
                "outputs": outputs,
                "exposure_s": self.exposure_s,
                "signal": self.signal,
                "shard": self.shard,
                "chunk": self.chunk,
            }),
        };
        all.extend(further.clone());
        all
    }

    /// Reads the attributes back: the layout, and what else there is. `None` if they are not those of a raw.
    pub(super) fn from_attributes(mut all: Map<String, Value>) -> Option<(Self, Map<String, Value>)> {
        all.shift_remove("schema")?;
        let a = all.shift_remove("layout")?;
        let outputs = a["outputs"].as_array()?.iter().map(Output::from_json);
        let (height, width) = serde_json::from_value(a["sensor_size"].clone()).ok()?;
        let side = |key: &str| usize::try_from(a[key].as_u64()?).ok();
        let spec = Self {
            outputs: outputs.collect::<Option<_>>()?,
            sensor: Size::new(height, width),
            pitch_um: a["pitch_um"].as_f64()?,
            centre_mm: (a["centre_mm"]["y"].as_f64()?, a["centre_mm"]["x"].as_f64()?),
            exposure_s: serde_json::from_value(a["exposure_s"].clone()).ok()?,
            signal: a["signal"].as_bool()?,
            shard: side("shard")?,
            chunk: side("chunk")?,
        };
        spec.holds().then_some((spec, all))
    }

    /// Whether all numbers are within their bounds and every output is on the sensor.
    pub fn holds(&self) -> bool {
        let sides = bounds::SHARD_SIDE_PX.check_count(self.shard).is_ok()
            && self.chunk > 0
            && self.shard.is_multiple_of(self.chunk)
            && bounds::film_size(self.sensor).is_ok();
        let frames = bounds::BANDS.check_count(self.exposure_s.len()).is_ok();
        let outputs = bounds::OUTPUTS.check_count(self.outputs.len()).is_ok();
        let placed = |o: &Output| {
            let known =
                o.name == "raw" || o.name.strip_prefix("roi_").is_some_and(|n| n.parse::<u32>().is_ok());
            let corner = |v: i64| (0..=1_000_000).contains(&v);
            let inside = corner(o.rect.y) && corner(o.rect.x) && bounds::film_size(o.rect.size()).is_ok();
            known && inside && self.sensor.rect().contains(o.rect)
        };
        let all = sides && frames && outputs && self.outputs.iter().all(placed);
        let shards = |k: usize| {
            let (down, across) = self.shards(k);
            bounds::SHARDS.check_product(&[self.exposure_s.len() + 1, down, across]).is_ok()
        };
        all && (0..self.outputs.len()).all(shards) && (!self.signal || self.outputs.len() == 1)
    }
}
