//! Check of a stored shard: inner chunks complete and back to back, checksums valid, all pixels finite.

use std::borrow::Cow;

use zarrs::array::{FillValue, data_type};

use super::codec::SampleType;
use super::encode::{ShardEncoder, index_shape};

/// Defect of a shard.
#[derive(Debug, PartialEq)]
pub(crate) enum ShardDefect {
    /// Bytes that do not decode, with the reason.
    Damaged(String),
    /// NaN or infinity at (row, column) of the shard.
    NotFinite { row: usize, column: usize, value: f32 },
}

impl ShardEncoder {
    /// Checks the bytes of a shard of `rows` × `columns` inner chunks, of which `height` × `width` pixels lie in the image.
    pub(crate) fn check(
        &self,
        bytes: &[u8],
        (height, width): (usize, usize),
        (rows, columns): (usize, usize),
    ) -> Result<(), ShardDefect> {
        let c = self.chunk;
        let index_bytes = rows * columns * 16 + 4;
        let Some(data) = bytes.len().checked_sub(index_bytes) else {
            return Err(ShardDefect::Damaged(format!("{} bytes are too few to hold its index", bytes.len())));
        };
        let (shape, fill) = (index_shape(rows, columns), FillValue::from(u64::MAX));
        let index = self
            .bounded_index
            .decode(Cow::Borrowed(&bytes[data..]), &shape, &data_type::uint64(), &fill)
            .map_err(|e| ShardDefect::Damaged(format!("its index: {e}")))?;
        let index: Vec<u64> = index.as_chunks().0.iter().map(|&b| u64::from_ne_bytes(b)).collect();
        let (shape, fill) = (self.chunk_shape(), FillValue::new(self.sample.fill()));
        let mut end = 0;
        for (i, j) in (0..rows).flat_map(|i| (0..columns).map(move |j| (i, j))) {
            let entry = (i * columns + j) * 2;
            let inside = i * c < height && j * c < width;
            match (index[entry], index[entry + 1]) {
                (u64::MAX, u64::MAX) if !inside || self.left_out.is_some() => continue,
                (offset, length) if inside && offset == end && length <= data as u64 - end => end += length,
                (offset, length) => {
                    let reason =
                        format!("inner chunk {i},{j}: {length} bytes at {offset}, expected from {end} on");
                    return Err(ShardDefect::Damaged(reason));
                }
            }
            let encoded = &bytes[index[entry] as usize..end as usize];
            let pixels = self
                .bounded
                .decode(Cow::Borrowed(encoded), &shape, &self.data_type, &fill)
                .map_err(|e| ShardDefect::Damaged(format!("inner chunk {i},{j}: {e}")))?;
            let (h, w) = (c.min(height - i * c), c.min(width - j * c));
            self.check_finite(&pixels, (h, w)).map_err(|(row, column, value)| ShardDefect::NotFinite {
                row: i * c + row,
                column: j * c + column,
                value,
            })?;
        }
        match end == data as u64 {
            true => Ok(()),
            false => Err(ShardDefect::Damaged(format!(
                "{} bytes between its chunks and its index",
                data as u64 - end
            ))),
        }
    }

    /// (row, column, value) of the first NaN or infinite one of `height` × `width` pixels of a decoded chunk, as an error.
    fn check_finite(&self, chunk: &[u8], (height, width): (usize, usize)) -> Result<(), (usize, usize, f32)> {
        let sample = |row: usize, column: usize| {
            let k = row * self.chunk + column;
            match self.sample {
                SampleType::F16 => half::f16::from_ne_bytes(chunk.as_chunks().0[k]).to_f32(),
                SampleType::F32 => f32::from_ne_bytes(chunk.as_chunks().0[k]),
                SampleType::U16 => u16::from_ne_bytes(chunk.as_chunks().0[k]).into(),
            }
        };
        let pixels = (0..height).flat_map(|row| (0..width).map(move |column| (row, column)));
        let bad = pixels.map(|(r, c)| (r, c, sample(r, c))).find(|p| !p.2.is_finite());
        bad.map_or(Ok(()), Err)
    }
}
