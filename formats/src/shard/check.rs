//! Whether a shard is what [`ShardEncoder::encode`] makes: every inner chunk there, its crc32c right, every pixel a number.

use std::borrow::Cow;
use std::num::NonZeroU64;

use zarrs::array::{DataType, FillValue, data_type};

use super::{SampleType, ShardEncoder};
use crate::bounded::BoundedChain;

/// What is wrong with a shard.
#[derive(Debug, PartialEq)]
pub(crate) enum Flaw {
    /// Its bytes.
    Damaged(String),
    /// NaN or infinity at (row, column) of the shard.
    NotFinite { row: usize, column: usize, value: f32 },
}

fn decode(
    chain: &BoundedChain,
    bytes: &[u8],
    shape: &[NonZeroU64],
    t: &DataType,
    fill: &FillValue,
) -> Result<Vec<u8>, String> {
    chain.decode(Cow::Borrowed(bytes), shape, t, fill)
}

impl ShardEncoder {
    /// Checks the bytes of a shard of `rows` × `columns` inner chunks, of which `height` × `width` pixels lie in the image.
    pub(crate) fn check(
        &self,
        bytes: &[u8],
        (height, width): (usize, usize),
        (rows, columns): (usize, usize),
    ) -> Result<(), Flaw> {
        let c = self.chunk;
        let damaged = |reason: String| Flaw::Damaged(reason);
        let index_bytes = rows * columns * 16 + 4;
        let Some(data) = bytes.len().checked_sub(index_bytes) else {
            return Err(damaged(format!("{} bytes are too few to hold its index", bytes.len())));
        };
        let shape =
            [1, rows as u64, columns as u64, 2].map(|n| NonZeroU64::new(n).expect("a shard has chunks"));
        let fill = FillValue::from(u64::MAX);
        let index = decode(&self.bounded_index, &bytes[data..], &shape, &data_type::uint64(), &fill)
            .map_err(|e| damaged(format!("its index: {e}")))?;
        let index: Vec<u64> = index.as_chunks().0.iter().map(|&b| u64::from_ne_bytes(b)).collect();
        let shape = [1, c as u64, c as u64].map(|n| NonZeroU64::new(n).expect("a chunk has pixels"));
        let fill = self.fill();
        let mut end = 0;
        for (i, j) in (0..rows).flat_map(|i| (0..columns).map(move |j| (i, j))) {
            let slot = (i * columns + j) * 2;
            let inside = i * c < height && j * c < width;
            match (index[slot], index[slot + 1]) {
                (u64::MAX, u64::MAX) if !inside => continue,
                (offset, length) if inside && offset == end && length <= data as u64 - end => end += length,
                (offset, length) => {
                    let place =
                        format!("inner chunk {i},{j}: {length} bytes at {offset}, expected from {end} on");
                    return Err(damaged(place));
                }
            }
            let encoded = &bytes[index[slot] as usize..end as usize];
            let pixels = decode(&self.bounded, encoded, &shape, &self.data_type, &fill)
                .map_err(|e| damaged(format!("inner chunk {i},{j}: {e}")))?;
            let (h, w) = (c.min(height - i * c), c.min(width - j * c));
            self.finite(&pixels, (h, w)).map_err(|(row, column, value)| Flaw::NotFinite {
                row: i * c + row,
                column: j * c + column,
                value,
            })?;
        }
        match end == data as u64 {
            true => Ok(()),
            false => Err(damaged(format!("{} bytes between its chunks and its index", data as u64 - end))),
        }
    }

    fn fill(&self) -> FillValue {
        FillValue::new(match self.sample {
            SampleType::F16 => half::f16::NAN.to_ne_bytes().to_vec(),
            SampleType::F32 => f32::NAN.to_ne_bytes().to_vec(),
        })
    }

    /// The first of `height` × `width` pixels of a decoded chunk that is no number.
    fn finite(&self, chunk: &[u8], (height, width): (usize, usize)) -> Result<(), (usize, usize, f32)> {
        let sample = |row: usize, column: usize| {
            let k = row * self.chunk + column;
            match self.sample {
                SampleType::F16 => half::f16::from_ne_bytes(chunk.as_chunks().0[k]).to_f32(),
                SampleType::F32 => f32::from_ne_bytes(chunk.as_chunks().0[k]),
            }
        };
        let pixels = (0..height).flat_map(|row| (0..width).map(move |column| (row, column)));
        let bad = pixels.map(|(r, c)| (r, c, sample(r, c))).find(|p| !p.2.is_finite());
        bad.map_or(Ok(()), Err)
    }
}
