//! Share of the film's light that comes from invented surfaces: an array `invented` (`roi_0_invented`, …) of f16 beside each output.
//!
//! One value per band and block of pixels (attribute `block_px`), one chunk per shard, written before the shard: a shard that exists has its shares.
//! Verification reads the chunks of all shards that exist: checksum, length, NaN outside the film only.

use half::f16;
use pipeline::depth::invented::block_px;
use pipeline::geometry::Size;
use serde_json::{Value, json};

use super::shards::EncodedShard;
use super::spec::FilmSpec;
use super::store::FilmStore;
use crate::group::{Finding, GroupError};
use crate::hierarchy::{array, bytes_and_crc, with_crc};

impl FilmSpec {
    /// Name of the array beside output `output`.
    pub fn invented_name(&self, output: usize) -> String {
        match self.outputs[output].name.as_str() {
            "film" => "invented".into(),
            name => format!("{name}_invented"),
        }
    }

    /// Side of the blocks of output `output` in pixels; blocks per shard (rows, columns).
    fn blocks(&self, output: usize) -> (usize, (usize, usize)) {
        let shard = self.shard_grid(output).shard;
        let side = block_px(shard);
        (side, (shard.height / side, shard.width / side))
    }

    /// Zarr metadata of the array beside output `output`.
    pub(super) fn invented_array(&self, output: usize) -> Value {
        let (side, (rows, columns)) = self.blocks(output);
        let size = self.outputs[output].rect.size();
        let name = self.invented_name(output);
        array(
            &[self.wavelengths_nm.len(), size.height.div_ceil(side), size.width.div_ceil(side)],
            &[1, rows, columns],
            "float16",
            bytes_and_crc(),
            &["wavelength", &format!("{name}_y"), &format!("{name}_x")],
            json!({
                "block_px": side,
                "long_name": "share of the light that comes from surfaces invented behind edges in depth",
            }),
        )
    }

    /// Key of the chunk beside a shard.
    pub(super) fn invented_key(&self, output: usize, band: usize, (row, column): (usize, usize)) -> String {
        format!("{}/c/{band}/{row}/{column}", self.invented_name(output))
    }
}

impl FilmStore {
    /// Encodes the invented shares of the blocks of a shard of `size` pixels, row by row.
    ///
    /// # Panics
    /// Another number of blocks.
    pub fn encode_invented(
        &self,
        output: usize,
        band: usize,
        shard: (usize, usize),
        size: Size,
        shares: &[f32],
    ) -> EncodedShard {
        let (side, (rows, columns)) = self.spec.blocks(output);
        let (height, width) = (size.height.div_ceil(side), size.width.div_ceil(side));
        assert_eq!(shares.len(), height * width, "one share per block");
        // Chunks are complete; what lies outside the film is NaN as in its shards.
        let value =
            |y: usize, x: usize| if y < height && x < width { shares[y * width + x] } else { f32::NAN };
        let values = (0..rows).flat_map(|y| (0..columns).map(move |x| f16::from_f32(value(y, x))));
        let bytes = values.flat_map(f16::to_le_bytes).collect();
        EncodedShard { key: self.spec.invented_key(output, band, shard), bytes: with_crc(bytes).into() }
    }

    /// Checks the chunks beside the shards that exist: bytes read, and defects in the order of the shards.
    ///
    /// # Errors
    /// [`GroupError::Storage`] if the store cannot be read.
    pub(super) fn check_invented(&self) -> Result<(u64, Vec<Finding>), GroupError> {
        if !self.spec.has_invented {
            return Ok((0, Vec::new()));
        }
        let all: Vec<_> = self.spec.all_shards().collect();
        let stored = std::iter::zip(&all, self.shards_bytes(&all)?).filter(|(_, bytes)| bytes.is_some());
        let (mut bytes, mut findings) = (0, Vec::new());
        for (&(output, band, shard), _) in stored {
            let (read, finding) = self.check_shares(output, band, shard)?;
            bytes += read;
            findings.extend(finding);
        }
        Ok((bytes, findings))
    }

    /// Reads the chunk beside one shard, which exists: its size in bytes, and its defect.
    fn check_shares(
        &self,
        output: usize,
        band: usize,
        shard: (usize, usize),
    ) -> Result<(u64, Option<Finding>), GroupError> {
        let (key, (side, (rows, columns))) =
            (self.spec.invented_key(output, band, shard), self.spec.blocks(output));
        let length = 2 * rows * columns + 4;
        let bytes = match self.group.read_to_check(&key, length as u64)? {
            Ok(bytes) => bytes,
            Err(Finding::Missing { key }) => {
                let reason = "no such file beside its shard".into();
                return Ok((0, Some(Finding::Bad { key, reason })));
            }
            Err(finding) => return Ok((0, Some(finding))),
        };
        let size = self.shard_rect(output, shard).size();
        let (height, width) = (size.height.div_ceil(side), size.width.div_ceil(side));
        let values = &bytes[..bytes.len().saturating_sub(4)];
        let share = |i: usize| f16::from_le_bytes([values[2 * i], values[2 * i + 1]]);
        let is_in_film = |i: usize| i / columns < height && i % columns < width;
        let reason = if bytes.len() != length {
            format!("{} bytes, expected {length}", bytes.len())
        } else if with_crc(values.to_vec()) != bytes {
            "its checksum does not match".into()
        } else if let Some(i) = (0..rows * columns).find(|&i| share(i).is_nan() == is_in_film(i)) {
            format!("{} at block row {}, column {} of the shard", share(i), i / columns, i % columns)
        } else {
            return Ok((bytes.len() as u64, None));
        };
        Ok((bytes.len() as u64, Some(Finding::Bad { key, reason })))
    }

    /// Removes the chunk `key` and its shard, if it is one of this array and still bad; `None` for another key.
    ///
    /// # Errors
    /// [`GroupError::Storage`] if it cannot be read or removed.
    pub(super) fn remove_bad_invented(&self, key: &str) -> Result<Option<bool>, GroupError> {
        let mut all = self.spec.all_shards().filter(|_| self.spec.has_invented);
        let Some((output, band, shard)) = all.find(|&(o, b, s)| self.spec.invented_key(o, b, s) == key)
        else {
            return Ok(None);
        };
        self.group.check_in_place()?;
        let is_bad = matches!(self.check_shares(output, band, shard)?.1, Some(Finding::Bad { .. }));
        if is_bad {
            // The shard first: one that exists has its shares.
            self.group.store.remove(&self.key(output, band, shard))?;
            self.group.store.remove(key)?;
        }
        Ok(Some(is_bad))
    }
}
