//! Layers of light that are added to a film's shards (`pipeline::layer`): an array of f32 beside the film for each, of its name (`LAYER_NAMES` in `group/kind.rs`).
//!
//! One chunk per band: the coefficients on the band's bins, margin included, and NaN behind them where another band has more bins. Attributes:
//! `bin_px` and `first_pixel` [row, column] (of the first bin, in film pixels; lists where they differ between bands), `margin_bins`,
//! `share_taken` (per band, the share of the light of the image that the layer spreads), `parts` (its names and shares).
//!
//! A band's chunk is written before the first shard of the band, and what it holds depends on the job alone: of processes that need it at once each
//! makes the same bytes. Verification reads the chunks of all bands that have shards: checksum, length, finite on the bins.

use std::collections::BTreeSet;

use pipeline::bounds::{self, Bound};
use pipeline::geometry::Size;
use pipeline::layer::BinGrid;
use serde_json::{Map, Value, json};

use super::shards::EncodedShard;
use super::spec::FilmSpec;
use super::store::FilmStore;
use crate::group::{Finding, GroupError, LAYER_NAMES};
use crate::hierarchy::{array, bytes_and_crc, with_crc};

/// Bins around those of the film.
const MARGIN_BINS: Bound = Bound { name: "the margin of a layer in bins", unit: "", min: 2.0, max: 4096.0 };
/// Share of the light that a layer takes from the image.
const SHARE: Bound = Bound { name: "the share of a layer", unit: "", min: 0.0, max: 1.0 };

/// A layer of light that is stored with a film.
#[derive(Clone, Debug, PartialEq)]
pub struct FilmLayer {
    /// Name of its array, one of `LAYER_NAMES`.
    pub name: String,
    /// Side of its bins per band, film pixels.
    pub bin_px: Vec<usize>,
    /// Stored bins around those of the film.
    pub margin_bins: usize,
    /// Share of the light of the image that it spreads, per band.
    pub share_taken: Vec<f64>,
    /// What it consists of, for people: names and shares.
    pub parts: Map<String, Value>,
}

impl FilmLayer {
    /// As the attributes of a film have it.
    pub(super) fn to_json(&self) -> Value {
        json!({
            "name": self.name,
            "bin_px": self.bin_px,
            "margin_bins": self.margin_bins,
            "share_taken": self.share_taken,
            "parts": self.parts,
        })
    }

    /// From the attributes of a film.
    pub(super) fn from_json(value: &Value) -> Option<Self> {
        fn get<T: serde::de::DeserializeOwned>(value: &Value, key: &str) -> Option<T> {
            serde_json::from_value(value.get(key)?.clone()).ok()
        }
        Some(Self {
            name: get(value, "name")?,
            bin_px: get(value, "bin_px")?,
            margin_bins: get(value, "margin_bins")?,
            share_taken: get(value, "share_taken")?,
            parts: get(value, "parts")?,
        })
    }
}

impl FilmSpec {
    /// The bins of layer `layer` in `band`.
    pub fn layer_grid(&self, layer: usize, band: usize) -> BinGrid {
        let layer = &self.layers[layer];
        BinGrid::new(self.film, layer.bin_px[band], layer.margin_bins)
    }

    /// Largest sizes of the bands' grids: the shape of a chunk.
    fn layer_chunk(&self, layer: usize) -> Size {
        let sizes = (0..self.wavelengths_nm.len()).map(|band| self.layer_grid(layer, band).size());
        sizes.fold(Size::new(0, 0), |a, b| Size::new(a.height.max(b.height), a.width.max(b.width)))
    }

    /// Checks the layers: known names, bins and shares for every band.
    pub(super) fn check_layers(&self) -> Result<(), GroupError> {
        let invalid = |expected, found: String| Err(GroupError::Spec { what: "layers", expected, found });
        let bands = self.wavelengths_nm.len();
        for (k, layer) in self.layers.iter().enumerate() {
            let is_twice = self.layers[..k].iter().any(|other| other.name == layer.name);
            if !LAYER_NAMES.contains(&&*layer.name) || is_twice {
                return invalid("known layers, each once", layer.name.clone());
            }
            if layer.bin_px.len() != bands || layer.share_taken.len() != bands {
                return invalid("bins and a share for every band", layer.name.clone());
            }
            if let Some(bin_px) = layer.bin_px.iter().find(|bin_px| !BinGrid::is_bin(**bin_px)) {
                return invalid("bins of 2, 4, 8, 16, 32 or 64 px", bin_px.to_string());
            }
            MARGIN_BINS.check_count(layer.margin_bins)?;
            layer.share_taken.iter().try_for_each(|share| SHARE.check(*share).map(drop))?;
            let chunk = self.layer_chunk(k);
            bounds::SAMPLES.check_product(&[bands, chunk.height, chunk.width])?;
        }
        Ok(())
    }

    /// Zarr metadata of the array of layer `layer`.
    pub(super) fn layer_array(&self, layer: usize) -> Value {
        let (chunk, bands) = (self.layer_chunk(layer), self.wavelengths_nm.len());
        let FilmLayer { name, bin_px, margin_bins, share_taken, parts } = &self.layers[layer];
        let first = |band: usize| {
            let first = self.layer_grid(layer, band).first_pixel();
            [first, first]
        };
        let is_same = bin_px.iter().all(|b| *b == bin_px[0]);
        let (bins, firsts) = match is_same {
            true => (json!(bin_px[0]), json!(first(0))),
            false => (json!(bin_px), json!((0..bands).map(first).collect::<Vec<_>>())),
        };
        array(
            &[bands, chunk.height, chunk.width],
            &[1, chunk.height, chunk.width],
            "float32",
            bytes_and_crc(),
            &["wavelength", &format!("{name}_y"), &format!("{name}_x")],
            json!({
                "bin_px": bins,
                "margin_bins": margin_bins,
                "first_pixel": firsts,
                "share_taken": share_taken,
                "parts": parts,
                "units": self.units,
                "long_name": "light beside the image, on bins of film pixels",
            }),
        )
    }

    /// Key of the chunk of layer `layer` of a band.
    pub fn layer_key(&self, layer: usize, band: usize) -> String {
        format!("{}/c/{band}/0/0", self.layers[layer].name)
    }

    /// Keys of all chunks of all layers.
    pub(super) fn layer_keys(&self) -> impl Iterator<Item = String> + '_ {
        let bands = self.wavelengths_nm.len();
        (0..self.layers.len()).flat_map(move |layer| (0..bands).map(move |band| self.layer_key(layer, band)))
    }
}

impl FilmStore {
    /// Bytes of a chunk of layer `layer`.
    fn layer_bytes(&self, layer: usize) -> usize {
        4 * self.spec.layer_chunk(layer).pixels() + 4
    }

    /// The coefficients of layer `layer` in `band`, if they are stored.
    ///
    /// # Errors
    /// [`GroupError::Layer`] if the chunk is damaged; [`GroupError::Storage`] if it cannot be read.
    pub fn read_layer(&self, layer: usize, band: usize) -> Result<Option<Vec<f32>>, GroupError> {
        let damaged =
            |key: String, reason: String| GroupError::Layer { film: self.path().into(), key, reason };
        match self.read_layer_chunk(layer, band)? {
            Ok((values, _)) => Ok(Some(values)),
            Err(Finding::Missing { .. }) => Ok(None),
            Err(finding) => {
                let (_, key, reason) = finding.fields();
                Err(damaged(key.into(), reason.into()))
            }
        }
    }

    /// Whether all layers of all `bands` are stored, asked for in one call: remote stores are queried concurrently.
    ///
    /// # Errors
    /// [`GroupError::Storage`] if the store cannot be read.
    pub fn has_layers(&self, bands: &[usize]) -> Result<bool, GroupError> {
        let layers = 0..self.spec.layers.len();
        let keys: Vec<String> =
            layers.flat_map(|k| bands.iter().map(move |band| self.spec.layer_key(k, *band))).collect();
        Ok(self.group.store.sizes_of(&keys)?.iter().all(Option::is_some))
    }

    /// Number of bands of which layer `layer` is stored.
    ///
    /// # Errors
    /// [`GroupError::Storage`] if the store cannot be read.
    pub fn layer_bands(&self, layer: usize) -> Result<usize, GroupError> {
        let bands = 0..self.spec.wavelengths_nm.len();
        let keys: Vec<String> = bands.map(|band| self.spec.layer_key(layer, band)).collect();
        Ok(self.group.store.sizes_of(&keys)?.iter().flatten().count())
    }

    /// Encodes the coefficients of layer `layer` in `band`.
    ///
    /// # Panics
    /// Another number of coefficients than the band has bins.
    pub fn encode_layer(&self, layer: usize, band: usize, coefficients: &[f32]) -> EncodedShard {
        let (size, chunk) = (self.spec.layer_grid(layer, band).size(), self.spec.layer_chunk(layer));
        assert_eq!(coefficients.len(), size.pixels(), "one coefficient per bin");
        let mut bytes = Vec::with_capacity(self.layer_bytes(layer));
        for y in 0..chunk.height {
            let row = coefficients.chunks_exact(size.width).nth(y).unwrap_or_default();
            let beyond = std::iter::repeat_n(&f32::NAN, chunk.width - row.len());
            row.iter().chain(beyond).for_each(|value| bytes.extend(value.to_le_bytes()));
        }
        EncodedShard { key: self.spec.layer_key(layer, band), bytes: with_crc(bytes).into() }
    }

    /// The coefficients of layer `layer` in `band` and the bytes read; or why there are none.
    fn read_layer_chunk(
        &self,
        layer: usize,
        band: usize,
    ) -> Result<Result<(Vec<f32>, u64), Finding>, GroupError> {
        let (key, length) = (self.spec.layer_key(layer, band), self.layer_bytes(layer));
        let bytes = match self.group.read_to_check(&key, length as u64)? {
            Ok(bytes) => bytes,
            Err(finding) => return Ok(Err(finding)),
        };
        if bytes.len() != length {
            let reason = format!("{} bytes, expected {length}", bytes.len());
            return Ok(Err(Finding::Bad { key, reason }));
        }
        let values = &bytes[..length - 4];
        if crc32c::crc32c(values).to_le_bytes() != bytes[length - 4..] {
            return Ok(Err(Finding::Bad { key, reason: "its checksum does not match".into() }));
        }
        let (size, chunk) = (self.spec.layer_grid(layer, band).size(), self.spec.layer_chunk(layer));
        let mut coefficients = Vec::with_capacity(size.pixels());
        for (y, row) in values.chunks_exact(4 * chunk.width).take(size.height).enumerate() {
            for (x, value) in row.as_chunks::<4>().0.iter().take(size.width).enumerate() {
                let value = f32::from_le_bytes(*value);
                if !value.is_finite() {
                    let reason = format!("{value} at bin row {y}, column {x}");
                    return Ok(Err(Finding::Bad { key, reason }));
                }
                coefficients.push(value);
            }
        }
        Ok(Ok((coefficients, length as u64)))
    }

    /// Checks the chunks of the bands that have shards: bytes read, and defects.
    ///
    /// # Errors
    /// [`GroupError::Storage`] if the store cannot be read.
    pub(super) fn check_layers(&self) -> Result<(u64, Vec<Finding>), GroupError> {
        let (mut bytes, mut findings) = (0, Vec::new());
        if self.spec.layers.is_empty() {
            return Ok((bytes, findings));
        }
        let all: Vec<_> = self.spec.all_shards().collect();
        let stored = std::iter::zip(&all, self.shards_bytes(&all)?).filter(|(_, bytes)| bytes.is_some());
        let begun: BTreeSet<usize> = stored.map(|((_, band, _), _)| *band).collect();
        for (layer, band) in
            (0..self.spec.layers.len()).flat_map(|l| (0..self.spec.wavelengths_nm.len()).map(move |b| (l, b)))
        {
            match self.read_layer_chunk(layer, band)? {
                Ok((_, read)) => bytes += read,
                Err(Finding::Missing { .. }) if !begun.contains(&band) => {}
                Err(Finding::Missing { key }) => {
                    let reason = "no such file beside the shards of its band".into();
                    findings.push(Finding::Bad { key, reason });
                }
                Err(finding) => findings.push(finding),
            }
        }
        Ok((bytes, findings))
    }

    /// Removes the chunk `key` and all shards of its band, if it is one of a layer and still bad; `None` for another key.
    ///
    /// # Errors
    /// [`GroupError::Storage`] if it cannot be read or removed.
    pub(super) fn remove_bad_layer(&self, key: &str) -> Result<Option<bool>, GroupError> {
        let bands = self.spec.wavelengths_nm.len();
        let mut all = (0..self.spec.layers.len()).flat_map(|layer| (0..bands).map(move |band| (layer, band)));
        let Some((layer, band)) = all.find(|&(l, b)| self.spec.layer_key(l, b) == key) else {
            return Ok(None);
        };
        self.group.check_in_place()?;
        let is_bad =
            matches!(self.read_layer_chunk(layer, band)?, Err(Finding::Bad { .. } | Finding::Missing { .. }));
        if is_bad {
            // The shards first: those that exist have their layer.
            for (output, of_band, shard) in self.spec.all_shards().filter(|(_, b, _)| *b == band) {
                self.group.store.remove(&self.key(output, of_band, shard))?;
            }
            self.group.store.remove(key)?;
        }
        Ok(Some(is_bad))
    }
}
