//! Temporary files of samples (native byte order) without a name: they vanish when closed, even if the process is killed.

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use super::error::ChartError;
use crate::durable::{DurableError, free_bytes, unnamed_temp_file};

#[derive(Debug)]
pub(super) struct TempFile {
    pub(super) file: File,
    /// For error messages.
    pub(super) path: PathBuf,
}

impl TempFile {
    /// Creates the file in `directory`, where `bytes` must be free; `chart` is named in errors.
    pub(super) fn create(directory: &Path, chart: &Path, bytes: u64) -> Result<Self, ChartError> {
        let free = free_bytes(directory)?;
        if bytes > free {
            let (path, directory) = (chart.into(), directory.into());
            return Err(ChartError::Space { path, directory, needed: bytes, free });
        }
        Ok(Self {
            file: unnamed_temp_file(directory)?,
            path: directory.join("(temporary file without a name)"),
        })
    }

    /// Writes `bytes` at byte `offset`.
    pub(super) fn write(&self, offset: u64, bytes: &[u8]) -> Result<(), DurableError> {
        self.file
            .write_all_at(bytes, offset)
            .map_err(|e| DurableError::io("write", &self.path, bytes.len() as u64, e))
    }

    /// Reads `count` f32 values from byte `offset`.
    pub(super) fn read(&self, offset: u64, count: usize) -> Result<Vec<f32>, DurableError> {
        let mut values = vec![0.0f32; count];
        self.file
            .read_exact_at(bytemuck::cast_slice_mut(&mut values), offset)
            .map_err(|e| DurableError::io("read", &self.path, 4 * count as u64, e))?;
        Ok(values)
    }
}
