//! Digests of the bytes of a chart's files: of all, the identity of a chart whose modification times are not trusted; of a sample, which tells charts apart that
//! have the same sizes and times, as files from an archive without times.

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::PathBuf;

use super::decoded_chart::DecodedChart;
use super::error::ChartError;
use super::file_change::WatchedFile;
use super::raster::RasterChart;
use super::store::ChartStore;
use crate::durable::{DurableError, HashedFile};

/// Files of a sample, evenly among those of a chart.
const SAMPLE_FILES: usize = 16;
/// Parts of a file of a sample, evenly from its first byte to its last, and their bytes.
const SAMPLE_PARTS: u64 = 4;
const SAMPLE_BYTES: u64 = 4096;

/// Name, in the array of a store, and path of a file with pixels.
pub(super) type DataFile = (String, PathBuf);

impl ChartStore {
    /// The files with pixels of the array, sorted.
    ///
    /// # Errors
    /// [`ChartError`] if they cannot be listed, or are not local.
    pub(super) fn data_files(&self) -> Result<Vec<DataFile>, ChartError> {
        let mut files = self.chunk_files()?;
        files.sort();
        let array = self.array_path();
        Ok(files.iter().map(|file| (file.key.clone(), array.join(&file.key))).collect())
    }
}

impl RasterChart {
    /// Its data file. [`RasterChart::identity`] checks that the file is still the one that is mapped.
    pub(super) fn data_files(&self) -> Vec<DataFile> {
        data_files(&self.files)
    }
}

impl DecodedChart {
    /// Its files, in the order of the bands. [`DecodedChart::identity`] checks that they are still those that were opened.
    pub(super) fn data_files(&self) -> Vec<DataFile> {
        data_files(self.files())
    }
}

fn data_files(files: &[WatchedFile]) -> Vec<DataFile> {
    files.iter().filter_map(WatchedFile::data_path).map(|path| (String::new(), path.into())).collect()
}

/// BLAKE3 of `files`, all of which are read: of their names and bytes. 64 hexadecimal digits.
///
/// # Errors
/// [`ChartError`] if a file cannot be read, or changes meanwhile.
pub(super) fn digest(files: &[DataFile]) -> Result<String, ChartError> {
    let mut digest = blake3::Hasher::new();
    digest.update(b"lenscube/chart-digest/1\n");
    for (name, path) in files {
        let file = HashedFile::open(path).map_err(|e| DurableError::io("read", path, 0, e))?;
        digest.update(format!("{name}\t{}\n", file.digest()).as_bytes());
    }
    Ok(digest.finalize().to_hex().to_string())
}

/// BLAKE3 of parts of some of `files`. 64 hexadecimal digits.
///
/// # Errors
/// [`ChartError`] if a file cannot be read.
pub(super) fn sample(files: &[DataFile]) -> Result<String, ChartError> {
    let mut digest = blake3::Hasher::new();
    digest.update(b"lenscube/chart-sample/1\n");
    let chosen = SAMPLE_FILES.min(files.len());
    for k in 0..chosen {
        let (_, path) = &files[k * (files.len() - 1) / (chosen - 1).max(1)];
        let failed = |e| DurableError::io("read", path, 0, e);
        let file = File::open(path).map_err(failed)?;
        let length = file.metadata().map_err(failed)?.len();
        let part = SAMPLE_BYTES.min(length);
        let mut bytes = vec![0; part as usize];
        for i in 0..SAMPLE_PARTS {
            file.read_exact_at(&mut bytes, i * (length - part) / (SAMPLE_PARTS - 1)).map_err(failed)?;
            digest.update(&bytes);
        }
    }
    Ok(digest.finalize().to_hex().to_string())
}
