//! A temporary file of bands one after the other: f32 of this machine, every row whole.
//!
//! What lies otherwise in its own file (interleaved, compressed, in tiles) is written here once, in any order, and mapped then. The file
//! has no name, so it is gone when the chart is dropped, however the process ends.

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use super::mapped::Mapped;
use super::{Interleave, RasterLayout, RasterSample};
use crate::chart::{ChartError, Sample};
use crate::durable::{DurableError, free_bytes, nameless_file};

/// The file while it is written.
#[derive(Debug)]
pub(crate) struct BandFile {
    file: File,
    temp: PathBuf,
    bands: Vec<usize>,
    shape: [usize; 3],
}

impl BandFile {
    /// Makes room for `bands` of a chart of `shape` in `directory`.
    pub(crate) fn create(
        directory: &Path,
        chart: &Path,
        bands: &[usize],
        shape: [usize; 3],
    ) -> Result<Self, ChartError> {
        let mut bands: Vec<usize> = bands.iter().copied().filter(|b| *b < shape[0]).collect();
        bands.sort_unstable();
        bands.dedup();
        let needed = bands.len() as u64 * shape[1] as u64 * shape[2] as u64 * 4;
        let free = free_bytes(directory)?;
        if needed > free {
            let (path, directory) = (chart.into(), directory.into());
            return Err(ChartError::Space { path, directory, needed, free });
        }
        let (file, temp) = (nameless_file(directory)?, directory.join("(temporary file without a name)"));
        let failed = |e| DurableError::io("write", &temp, needed, e);
        file.set_len(needed).map_err(failed)?;
        Ok(Self { file, temp, bands, shape })
    }

    /// The bands that it holds.
    pub(crate) fn bands(&self) -> &[usize] {
        &self.bands
    }

    /// Writes pixels from (`row`, `column`) on: whole rows, or a part of one. A band that it does not hold is passed over.
    pub(crate) fn write(
        &self,
        band: usize,
        row: usize,
        column: usize,
        pixels: &[f32],
    ) -> Result<(), DurableError> {
        let Ok(slot) = self.bands.binary_search(&band) else { return Ok(()) };
        let bytes: Vec<u8> = pixels.iter().flat_map(|v| v.to_ne_bytes()).collect();
        let at = ((slot * self.shape[1] + row) * self.shape[2] + column) * 4;
        self.file
            .write_all_at(&bytes, at as u64)
            .map_err(|e| DurableError::io("write", &self.temp, bytes.len() as u64, e))
    }

    /// How its samples lie.
    pub(super) fn layout(&self) -> RasterLayout {
        RasterLayout {
            shape: self.shape,
            interleave: Interleave::Bsq,
            sample: RasterSample::Plain(Sample::F32),
            little_endian: cfg!(target_endian = "little"),
            offset: 0,
        }
    }

    /// The bytes, mapped, and where each band lies.
    pub(super) fn map(self) -> Result<(Mapped, Vec<Option<usize>>), DurableError> {
        let length = (self.bands.len() * self.shape[1] * self.shape[2] * 4) as u64;
        let slots = (0..self.shape[0]).map(|b| self.bands.binary_search(&b).ok()).collect();
        let map =
            Mapped::new(self.file, length).map_err(|e| DurableError::io("map", &self.temp, length, e))?;
        Ok((map, slots))
    }
}
