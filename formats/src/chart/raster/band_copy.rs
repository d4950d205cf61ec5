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
use crate::sample::{RasterSample, Sample};

/// Rows of a band shorter than this share too many pages with other bands to be read in place.
const MIN_BIL_ROW_BYTES: u64 = 16 << 10;

/// Bytes of a file in transposed order whose pages are in memory at a time.
const MAX_BLOCK_BYTES: usize = 16 << 20;

impl RasterChart {
    /// Whether reading band after band would fetch the same pages once per band.
    pub fn needs_band_copy(&self) -> bool {
        let row = (self.layout.shape[2] * self.layout.sample.bytes()) as u64;
        match self.layout.interleave {
            Interleave::Bsq => false,
            Interleave::Bil => self.bands() > 1 && row < MIN_BIL_ROW_BYTES,
            Interleave::Bip => self.bands() > 1,
            Interleave::BandColumnRow | Interleave::ColumnBandRow | Interleave::ColumnRowBand => true,
        }
    }

    /// Rows and columns that are copied at a time: long runs of both files, and few pages of this one.
    fn copy_block(&self) -> (usize, usize) {
        let [bands, rows, columns] = self.layout.shape;
        if !self.layout.interleave.is_transposed() {
            // 4 MiB of every band.
            return (((4 << 20) / (columns * 4)).clamp(1, rows), columns);
        }
        let bands_in_page = if self.layout.interleave == Interleave::BandColumnRow { 1 } else { bands };
        let block_rows = rows.min(2048);
        let pixels = MAX_BLOCK_BYTES / (self.layout.sample.bytes() * bands_in_page);
        (block_rows, (pixels / block_rows).clamp(1, columns.min(1024)))
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
        let file = BandFile::create(
            directory,
            &self.path,
            bands,
            self.layout.shape,
            RasterSample::Plain(Sample::F32),
        )?;
        let (block_rows, block_columns) = self.copy_block();
        let mut buffer = vec![0.0f32; block_rows * block_columns];
        let mut done = 0;
        for x in (0..columns).step_by(block_columns) {
            let width = block_columns.min(columns - x);
            for y in (0..rows).step_by(block_rows) {
                let height = block_rows.min(rows - y);
                let rect = Rect::new(y as i64, x as i64, height, width);
                for &band in file.bands() {
                    let pixels = &mut buffer[..height * width];
                    self.read_rect(band, rect, pixels)?;
                    match width == columns {
                        true => file.write(band, y, 0, pixels)?,
                        false => (y..)
                            .zip(pixels.chunks(width))
                            .try_for_each(|(y, p)| file.write(band, y, x, p))?,
                    }
                }
                done += height * width;
                progress(done as u64, (rows * columns) as u64);
                self.map.release(0, self.map.expected_bytes() as usize);
            }
        }
        self.layout = file.layout();
        (self.map, self.entries) = file.map()?;
        // The copy holds values, not raw samples.
        self.values = Values { max_magnitude: self.values.max_magnitude, ..Values::default() };
        Ok(())
    }

    /// A chart of the samples in `file`, which were decoded from `path`, and their `values`.
    pub(in crate::chart) fn from_band_file(
        path: &Path,
        file: BandFile,
        nan: NanPolicy,
        wavelengths_nm: Option<Vec<f64>>,
        values: Values,
    ) -> Result<Self, ChartError> {
        let layout = file.layout();
        let (map, entries) = file.map()?;
        Ok(Self {
            path: path.into(),
            map,
            entries,
            sample: layout.sample,
            nan,
            wavelengths_nm,
            values,
            units: None,
            array: None,
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
