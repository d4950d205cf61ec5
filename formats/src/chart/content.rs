//! Digest of the bytes of a chart's files: the identity of a chart whose modification times are not trusted.

use std::path::Path;

use super::decoded_chart::DecodedChart;
use super::error::ChartError;
use super::file_change::WatchedFile;
use super::raster::RasterChart;
use super::store::ChartStore;
use crate::durable::{DurableError, HashedFile};

impl ChartStore {
    /// BLAKE3 of the files with pixels of the array, all of which are read: of their names and bytes. 64 hexadecimal digits.
    ///
    /// # Errors
    /// [`ChartError`] if a file cannot be read, changes meanwhile, or is not local.
    pub fn content_digest(&self) -> Result<String, ChartError> {
        let mut files = self.chunk_files()?;
        files.sort();
        let array = self.array_path();
        digest(files.iter().map(|file| (&*file.key, array.join(&file.key))))
    }
}

impl RasterChart {
    /// BLAKE3 of its data file, 64 hexadecimal digits. [`RasterChart::identity`] checks that the file is still the one that is mapped.
    ///
    /// # Errors
    /// [`ChartError`] if the file cannot be read, or changes meanwhile.
    pub fn content_digest(&self) -> Result<String, ChartError> {
        digest(self.files.iter().filter_map(WatchedFile::data_path).map(|path| ("", path)))
    }
}

impl DecodedChart {
    /// BLAKE3 of its files, in the order of the bands, 64 hexadecimal digits. [`DecodedChart::identity`] checks that they are still those
    /// that were opened.
    ///
    /// # Errors
    /// As [`RasterChart::content_digest`].
    pub fn content_digest(&self) -> Result<String, ChartError> {
        digest(self.files().iter().filter_map(WatchedFile::data_path).map(|path| ("", path)))
    }
}

/// Digest of `files`, (name, path) of each.
fn digest<'a>(files: impl Iterator<Item = (&'a str, impl AsRef<Path>)>) -> Result<String, ChartError> {
    let mut digest = blake3::Hasher::new();
    digest.update(b"lenscube/chart-digest/1\n");
    for (name, path) in files {
        let path = path.as_ref();
        let file = HashedFile::open(path).map_err(|e| DurableError::io("read", path, 0, e))?;
        digest.update(format!("{name}\t{}\n", file.digest()).as_bytes());
    }
    Ok(digest.finalize().to_hex().to_string())
}
