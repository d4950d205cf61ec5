//! Share of the film's light that comes from invented surfaces: an array `invented` (`roi_0_invented`, …) of f16 beside each output.
//!
//! One value per band and block of pixels (attribute `block_px`), one chunk per shard, written before the shard: a shard that exists has its shares.

use half::f16;
use pipeline::depth::invented::block_px;
use pipeline::geometry::Size;
use serde_json::{Value, json};

use super::shards::EncodedShard;
use super::spec::FilmSpec;
use super::store::FilmStore;
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
}
