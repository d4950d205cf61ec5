//! Copies of bands in a temporary file in BSQ order.

use std::path::Path;
use std::sync::atomic::{AtomicU64, AtomicUsize};

use pipeline::geometry::Rect;
use serde_json::Value;

use super::RasterChart;
use super::bands::BandFile;
use super::layout::Interleave;
use crate::chart::error::ChartError;
use crate::chart::options::NanPolicy;
use crate::chart::values::Values;

/// Rows of a band shorter than this share too many pages with other bands to be read in place.
const MIN_BIL_ROW_BYTES: u64 = 16 << 10;

impl RasterChart {
    /// Whether reading band after band would fetch the same pages once per band.
    pub fn needs_band_copy(&self) -> bool {
        let row = (self.layout.shape[2] * self.layout.sample.bytes()) as u64;
        self.bands() > 1
            && match self.layout.interleave {
                Interleave::Bsq => false,
                Interleave::Bil => row < MIN_BIL_ROW_BYTES,
                Interleave::Bip => true,
            }
    }

    /// Copies `bands` to a temporary file in `directory`, which vanishes with the chart, and reads from it from then on. Band
    /// numbers stay the same; other bands can no longer be read. `progress` receives the numbers of rows done and in total.
    ///
    /// # Errors
    /// [`ChartError::Space`] before anything is written; [`ChartError`] if samples cannot be read or the file cannot be written.
    pub fn copy_bands(
        &mut self,
        bands: &[usize],
        directory: &Path,
        progress: &dyn Fn(u64, u64),
    ) -> Result<(), ChartError> {
        let [_, rows, columns] = self.layout.shape;
        let file = BandFile::create(directory, &self.path, bands, self.layout.shape)?;
        // 4 MiB of every band at a time, so that both files are accessed in long runs.
        let rows_at_once = ((4 << 20) / (columns * 4)).clamp(1, rows);
        let mut buffer = vec![0.0f32; rows_at_once * columns];
        for first in (0..rows).step_by(rows_at_once) {
            let height = rows_at_once.min(rows - first);
            let rect = Rect::new(first as i64, 0, height, columns);
            for &band in file.bands() {
                let pixels = &mut buffer[..height * columns];
                self.read_rect(band, rect, pixels)?;
                file.write(band, first, 0, pixels)?;
            }
            progress((first + height) as u64, rows as u64);
        }
        self.layout = file.layout();
        (self.map, self.entries) = file.map()?;
        // The copy holds values, not raw samples.
        self.values = Values { max_magnitude: self.values.max_magnitude, ..Values::default() };
        Ok(())
    }

    /// A chart of the values in `file`, which were decoded from `path`.
    pub(in crate::chart) fn from_band_file(
        path: &Path,
        file: BandFile,
        nan: NanPolicy,
        wavelengths_nm: Option<Vec<f64>>,
        max_magnitude: f32,
    ) -> Result<Self, ChartError> {
        let layout = file.layout();
        let (map, entries) = file.map()?;
        Ok(Self {
            path: path.into(),
            map,
            entries,
            nan,
            wavelengths_nm,
            values: Values { max_magnitude, ..Values::default() },
            notes: Vec::new(),
            replaced: AtomicU64::new(0),
            bytes_read: AtomicU64::new(0),
            released_rows: (0..layout.shape[0]).map(|_| AtomicUsize::new(0)).collect(),
            layout,
            identity: (Value::Null, Value::Null),
            files: Vec::new(),
        })
    }
}
