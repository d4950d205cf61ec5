//! Order of the samples in a flat file.

use crate::chart::axes::AxisOrder;
use crate::sample::RasterSample;
use serde_json::{Value, json};

pub use crate::chart::interleave::Interleave;

impl Interleave {
    /// Whether a row of pixels is spread over the file, column by column.
    pub(super) fn is_transposed(self) -> bool {
        matches!(self, Self::BandColumnRow | Self::ColumnBandRow | Self::ColumnRowBand)
    }
}

/// Layout of a flat file.
#[derive(Clone, Debug, PartialEq)]
pub struct RasterLayout {
    /// (bands, rows, columns).
    pub shape: [usize; 3],
    /// Order of the samples.
    pub interleave: Interleave,
    /// Sample type.
    pub sample: RasterSample,
    /// Byte order.
    pub little_endian: bool,
    /// Bytes before the first sample.
    pub offset: u64,
}

impl RasterLayout {
    /// Layout of raw samples, of `sides` along `axes` (slowest first).
    ///
    /// # Errors
    /// The expected number of axes, if `axes` has another.
    pub fn raw(
        sides: &[usize],
        axes: &AxisOrder,
        sample: RasterSample,
        little_endian: bool,
    ) -> Result<Self, usize> {
        match axes.rank() == sides.len() {
            false => Err(axes.rank()),
            true => Ok(Self {
                shape: axes.to_chart(sides, 1),
                interleave: axes.interleave(),
                sample,
                little_endian,
                offset: 0,
            }),
        }
    }

    /// The layout as part of the chart's identity.
    pub(super) fn identity(&self) -> Value {
        json!({
            "shape": self.shape,
            "order": self.interleave.name(),
            "sample": self.sample.code(),
            "little_endian": self.little_endian,
            "offset": self.offset,
        })
    }

    /// Bytes up to the end of the last sample; `None` on overflow.
    pub(super) fn end(&self) -> Option<u64> {
        let count = self.shape.iter().try_fold(1u64, |n, &d| n.checked_mul(d as u64))?;
        count.checked_mul(self.sample.bytes() as u64)?.checked_add(self.offset)
    }

    /// Byte offset of a sample, and bytes from one column to the next; `entry` is the position of the band in the file.
    pub(super) fn position(&self, entry: usize, row: usize, column: usize) -> (usize, usize) {
        let [bands, rows, columns] = self.shape;
        let (sample, step) = match self.interleave {
            Interleave::Bsq => ((entry * rows + row) * columns + column, 1),
            Interleave::Bil => ((row * bands + entry) * columns + column, 1),
            Interleave::Bip => ((row * columns + column) * bands + entry, bands),
            Interleave::BandColumnRow => ((entry * columns + column) * rows + row, rows),
            Interleave::ColumnBandRow => ((column * bands + entry) * rows + row, bands * rows),
            Interleave::ColumnRowBand => ((column * rows + row) * bands + entry, rows * bands),
        };
        let bytes = self.sample.bytes();
        (self.offset as usize + sample * bytes, step * bytes)
    }
}
