//! Temporary files of f32 samples (native byte order) without a name: they vanish when closed, even if the process is killed.

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

    /// Writes `values` at byte `offset`.
    pub(super) fn write(&self, offset: u64, values: &[f32]) -> Result<(), DurableError> {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_ne_bytes()).collect();
        self.file
            .write_all_at(&bytes, offset)
            .map_err(|e| DurableError::io("write", &self.path, bytes.len() as u64, e))
    }

    /// Reads `count` values from byte `offset`.
    pub(super) fn read(&self, offset: u64, count: usize) -> Result<Vec<f32>, DurableError> {
        let mut bytes = vec![0; count * 4];
        self.file
            .read_exact_at(&mut bytes, offset)
            .map_err(|e| DurableError::io("read", &self.path, bytes.len() as u64, e))?;
        Ok(bytes.as_chunks().0.iter().map(|&b| f32::from_ne_bytes(b)).collect())
    }
}
