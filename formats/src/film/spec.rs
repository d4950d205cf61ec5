//! Layout of a film: arrays, coordinates, sample type, shards; and its group attributes.

use std::path::Path;

use pipeline::bounds::{self, OutOfBounds};
use pipeline::geometry::{Rect, Size};
use pipeline::tiling::FilmRegion;
use serde_json::{Map, Value, json};

use super::layers::FilmLayer;
use crate::group::{Derived, GroupError, GroupKind, LAYER_NAMES, Output};
use crate::hierarchy::{array, coordinate};
use crate::shard::{Codec, SampleType, shard_grid, sharding_metadata};

/// Layout of a film.
#[derive(Clone, Debug, PartialEq)]
pub struct FilmSpec {
    /// The arrays.
    pub outputs: Vec<Output>,
    /// Size of the complete film in pixels.
    pub film: Size,
    /// Wavelength of each band in nm.
    pub wavelengths_nm: Vec<f64>,
    /// Pixel pitch in µm.
    pub pitch_um: f64,
    /// Optical axis (row, column) in film pixels.
    pub axis_px: (f64, f64),
    /// Unit of the values: "relative", "W m-2 nm-1", …
    pub units: String,
    /// Sample type.
    pub sample: SampleType,
    /// Side of a shard in pixels, a multiple of `chunk`; smaller arrays have smaller shards.
    pub shard: usize,
    /// Side of an inner chunk in pixels.
    pub chunk: usize,
    /// Compression.
    pub codec: Codec,
    /// Bits of the mantissa that samples are rounded to, fewer than those of `sample`; `None`: all.
    pub keep_bits: Option<u32>,
    /// Whether the share of invented light is stored ([`super::FilmStore::encode_invented`]).
    pub has_invented: bool,
    /// Layers of light that are stored and added to its shards, in the order in which they are added.
    pub layers: Vec<FilmLayer>,
}

impl FilmSpec {
    /// Default side of a shard in pixels.
    pub const SHARD: usize = 2048;
    /// Default side of a chunk in pixels.
    pub const CHUNK: usize = 512;

    /// A complete film with the default layout: f32, shards of 2048 and chunks of 512 pixels, axis in the middle, relative units.
    pub fn full_film(film: Size, wavelengths_nm: Vec<f64>, pitch_um: f64) -> Self {
        Self {
            outputs: vec![Output { name: "film".into(), rect: film.rect() }],
            film,
            wavelengths_nm,
            pitch_um,
            axis_px: ((film.height as f64 - 1.0) / 2.0, (film.width as f64 - 1.0) / 2.0),
            units: "relative".into(),
            sample: SampleType::F32,
            shard: Self::SHARD,
            chunk: Self::CHUNK,
            codec: Codec::default(),
            keep_bits: None,
            has_invented: false,
            layers: Vec::new(),
        }
    }

    /// The shards of an output.
    pub fn shard_grid(&self, output: usize) -> FilmRegion {
        self.grid_of(self.outputs[output].rect)
    }

    /// The shards of an array with the pixels `rect`.
    pub(super) fn grid_of(&self, rect: Rect) -> FilmRegion {
        shard_grid(rect, self.shard, self.chunk)
    }

    /// (rows, columns) of a shard of output `output`.
    pub fn shard_shape(&self, output: usize) -> (usize, usize) {
        let shard = self.shard_grid(output).shard;
        (shard.height, shard.width)
    }

    /// All shards of the film: output, band, (row, column).
    pub fn all_shards(&self) -> impl Iterator<Item = (usize, usize, (usize, usize))> + '_ {
        let of_output = |output: usize| {
            let (down, across) = self.shard_grid(output).count();
            (0..self.wavelengths_nm.len()).flat_map(move |band| {
                (0..down).flat_map(move |i| (0..across).map(move |j| (output, band, (i, j))))
            })
        };
        (0..self.outputs.len()).flat_map(of_output)
    }

    /// Key of a shard.
    pub fn key(&self, output: usize, band: usize, (row, column): (usize, usize)) -> String {
        format!("{}/c/{band}/{row}/{column}", self.outputs[output].name)
    }

    /// Bytes of the pixels of all outputs, not compressed.
    pub(super) fn bytes(&self) -> u64 {
        let pixels: usize = self.outputs.iter().map(|o| o.rect.size().pixels()).sum();
        (pixels * self.wavelengths_nm.len() * self.sample.bytes()) as u64
    }

    /// Checks that every number is within [`bounds`] and every output inside the film.
    ///
    /// # Errors
    /// [`GroupError::Spec`] or [`GroupError::Bounds`].
    pub fn check(&self) -> Result<(), GroupError> {
        let invalid = |what, expected, found: String| Err(GroupError::Spec { what, expected, found });
        if self.chunk == 0 || self.shard == 0 || !self.shard.is_multiple_of(self.chunk) {
            let found = format!("shards of {}, chunks of {}", self.shard, self.chunk);
            return invalid("sides", "a shard that is a multiple of the chunk", found);
        }
        if let Some(bits) = self.keep_bits
            && !(1..self.sample.mantissa_bits()).contains(&bits)
        {
            return invalid("keep_bits", "1 or more, and fewer than the sample type has", bits.to_string());
        }
        self.check_bounds()?;
        self.check_layers()?;
        for (k, o) in self.outputs.iter().enumerate() {
            let is_placed = |at: i64| (0..=bounds::FILM_SIDE_PX.max as i64).contains(&at);
            if !is_placed(o.rect.y) || !is_placed(o.rect.x) || !self.film.rect().contains(o.rect) {
                return invalid(
                    "output",
                    "a region of the film that is not empty",
                    format!("{} = {}", o.name, o.rect),
                );
            }
            let valid = o.name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
            let reserved = ["wavelength", "x", "y"].contains(&o.name.as_str())
                || LAYER_NAMES.contains(&o.name.as_str())
                || o.name.ends_with("invented");
            if o.name.is_empty() || !valid || reserved || self.outputs[..k].iter().any(|p| p.name == o.name) {
                return invalid(
                    "output name",
                    "letters, digits and _, each name once",
                    format!("{:?}", o.name),
                );
            }
        }
        Ok(())
    }

    /// Checks all numbers and their products before memory is allocated for them.
    fn check_bounds(&self) -> Result<(), OutOfBounds> {
        let bands = self.wavelengths_nm.len();
        bounds::BANDS.check_count(bands)?;
        bounds::OUTPUTS.check_count(self.outputs.len())?;
        bounds::film_size(self.film)?;
        self.wavelengths_nm.iter().try_for_each(|&nm| bounds::WAVELENGTH_NM.check(nm).map(drop))?;
        bounds::PITCH_UM.check(self.pitch_um)?;
        bounds::AXIS_PX.check(self.axis_px.0)?;
        bounds::AXIS_PX.check(self.axis_px.1)?;
        bounds::SHARD_SIDE_PX.check_count(self.shard)?;
        bounds::CHUNKS_PER_SHARD.check_product(&[self.shard / self.chunk, self.shard / self.chunk])?;
        let mut shards = 0;
        for output in &self.outputs {
            let (height, width) = (output.rect.height, output.rect.width);
            bounds::film_size(output.rect.size())?;
            bounds::SAMPLES.check_product(&[bands, height, width])?;
            let (rows, columns) = (height.div_ceil(self.shard), width.div_ceil(self.shard));
            shards += bounds::SHARDS.check_product(&[bands, rows, columns])?;
        }
        bounds::SHARDS.check_product(&[shards as usize]).map(drop)
    }

    /// The files that follow from the attributes.
    pub(super) fn derived(&self) -> Derived {
        Derived { coordinates: self.coordinates(), arrays: self.arrays() }
    }

    /// The coordinate arrays of all outputs: name, metadata, chunk.
    pub(super) fn coordinates(&self) -> Vec<(String, (Value, Vec<u8>))> {
        let mm = |first: i64, n: usize, axis: f64| -> Vec<f64> {
            (0..n).map(|i| ((first + i as i64) as f64 - axis) * (self.pitch_um * 1e-3)).collect()
        };
        let nm = coordinate("wavelength", "nm", "wavelength", &self.wavelengths_nm);
        let mut all = vec![("wavelength".to_owned(), nm)];
        for o in &self.outputs {
            let down = mm(o.rect.y, o.rect.height, self.axis_px.0);
            all.extend(o.coordinates(&down, &mm(o.rect.x, o.rect.width, self.axis_px.1)));
        }
        all
    }

    /// Name and Zarr metadata of the outputs, of their shares of invented light, and of the layers.
    pub(super) fn arrays(&self) -> Vec<(String, Value)> {
        let outputs = self.outputs.iter().map(|o| (o.name.clone(), self.array(o, o.rect.size())));
        let invented = (0..self.outputs.len()).filter(|_| self.has_invented);
        outputs
            .chain(invented.map(|output| (self.invented_name(output), self.invented_array(output))))
            .chain(
                (0..self.layers.len())
                    .map(|layer| (self.layers[layer].name.clone(), self.layer_array(layer))),
            )
            .collect()
    }

    /// Zarr metadata of an array of `size` with the field of view of `output`.
    pub(super) fn array(&self, output: &Output, size: Size) -> Value {
        let shard = self.grid_of(size.rect()).shard;
        let (y, x) = output.axes();
        array(
            &[self.wavelengths_nm.len(), size.height, size.width],
            &[1, shard.height, shard.width],
            self.sample.name(),
            sharding_metadata(self.codec, self.sample, self.chunk, self.keep_bits.is_some()),
            &["wavelength", &y, &x],
            json!({"units": self.units}),
        )
    }

    /// Group attributes.
    pub(super) fn attributes(&self, provenance: &Map<String, Value>) -> Value {
        let outputs: Vec<Value> = self.outputs.iter().map(Output::to_json).collect();
        let mut attributes = json!({
            "schema": GroupKind::Film.schema(),
            "film_size": [self.film.height, self.film.width],
            "pitch_um": self.pitch_um,
            "axis_px": [self.axis_px.0, self.axis_px.1],
            "wavelengths_nm": self.wavelengths_nm,
            "units": self.units,
            "outputs": outputs,
            "sample": self.sample,
            "shard": self.shard,
            "chunk": self.chunk,
            "codec": self.codec,
            "provenance": provenance,
        });
        if let Some(bits) = self.keep_bits {
            attributes["keep_bits"] = bits.into();
        }
        if self.has_invented {
            attributes["has_invented"] = true.into();
        }
        if !self.layers.is_empty() {
            attributes["layers"] = self.layers.iter().map(FilmLayer::to_json).collect();
        }
        attributes
    }

    /// Parses and checks group attributes; also returns the attribute `provenance`.
    pub(super) fn from_attributes(
        path: &Path,
        mut a: Map<String, Value>,
    ) -> Result<(Self, Map<String, Value>), GroupError> {
        let damaged = || GroupError::Damaged {
            kind: GroupKind::Film,
            path: path.join("zarr.json"),
            expected: "the attributes of a film",
        };
        let provenance = match a.remove("provenance") {
            Some(Value::Object(m)) => m,
            _ => return Err(damaged()),
        };
        let parse = || -> Option<Self> {
            fn get<T: serde::de::DeserializeOwned>(a: &Map<String, Value>, key: &str) -> Option<T> {
                serde_json::from_value(a.get(key)?.clone()).ok()
            }
            let (height, width) = get(&a, "film_size")?;
            let outputs = a.get("outputs")?.as_array()?.iter().map(Output::from_json);
            Some(Self {
                outputs: outputs.collect::<Option<_>>()?,
                film: Size::new(height, width),
                wavelengths_nm: get(&a, "wavelengths_nm")?,
                pitch_um: get(&a, "pitch_um")?,
                axis_px: get(&a, "axis_px")?,
                units: get(&a, "units")?,
                sample: get(&a, "sample")?,
                shard: get(&a, "shard")?,
                chunk: get(&a, "chunk")?,
                codec: get(&a, "codec")?,
                keep_bits: match a.get("keep_bits") {
                    None => None,
                    Some(_) => Some(get(&a, "keep_bits")?),
                },
                has_invented: match a.get("has_invented") {
                    None => false,
                    Some(_) => get(&a, "has_invented")?,
                },
                layers: match a.get("layers") {
                    None => Vec::new(),
                    Some(layers) => {
                        layers.as_array()?.iter().map(FilmLayer::from_json).collect::<Option<_>>()?
                    }
                },
            })
        };
        let spec = parse().ok_or_else(damaged)?;
        spec.check().map_err(|e| GroupError::Attributes { path: path.into(), reason: e.to_string() })?;
        Ok((spec, provenance))
    }
}
