//! Digests of the bytes of a chart's files: of all, the identity of a chart whose modification times are not trusted; of a sample, which tells charts apart that
//! have the same sizes and times, as files from an archive without times.

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

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

impl ChartStore {
    /// BLAKE3 of the files with pixels of the array, all of which are read: of their names and bytes. 64 hexadecimal digits.
    ///
    /// # Errors
    /// [`ChartError`] if a file cannot be read, changes meanwhile, or is not local.
    pub fn content_digest(&self) -> Result<String, ChartError> {
        let files = self.named_files()?;
        digest(files.iter().map(|(name, path)| (&**name, path)))
    }

    /// BLAKE3 of a sample of those bytes, of a local array.
    ///
    /// # Errors
    /// [`ChartError`] if a file cannot be read.
    pub fn content_sample(&self) -> Result<String, ChartError> {
        let files = self.named_files()?;
        sample(&files.iter().map(|(_, path)| &**path).collect::<Vec<_>>())
    }

    /// Name and path of the files with pixels, sorted.
    fn named_files(&self) -> Result<Vec<(String, PathBuf)>, ChartError> {
        let mut files = self.chunk_files()?;
        files.sort();
        let array = self.array_path();
        Ok(files
            .into_iter()
            .map(|file| {
                let path = array.join(&file.key);
                (file.key, path)
            })
            .collect())
    }
}

impl RasterChart {
    /// BLAKE3 of its data file, 64 hexadecimal digits. [`RasterChart::identity`] checks that the file is still the one that is mapped.
    ///
    /// # Errors
    /// [`ChartError`] if the file cannot be read, or changes meanwhile.
    pub fn content_digest(&self) -> Result<String, ChartError> {
        digest(data_paths(&self.files).map(|path| ("", path)))
    }

    /// BLAKE3 of a sample of it.
    ///
    /// # Errors
    /// [`ChartError`] if the file cannot be read.
    pub fn content_sample(&self) -> Result<String, ChartError> {
        sample(&data_paths(&self.files).collect::<Vec<_>>())
    }
}

impl DecodedChart {
    /// BLAKE3 of its files, in the order of the bands, 64 hexadecimal digits. [`DecodedChart::identity`] checks that they are still those
    /// that were opened.
    ///
    /// # Errors
    /// As [`RasterChart::content_digest`].
    pub fn content_digest(&self) -> Result<String, ChartError> {
        digest(data_paths(self.files()).map(|path| ("", path)))
    }

    /// BLAKE3 of a sample of them.
    ///
    /// # Errors
    /// As [`RasterChart::content_sample`].
    pub fn content_sample(&self) -> Result<String, ChartError> {
        sample(&data_paths(self.files()).collect::<Vec<_>>())
    }
}

fn data_paths(files: &[WatchedFile]) -> impl Iterator<Item = &Path> {
    files.iter().filter_map(WatchedFile::data_path)
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

/// Digest of parts of some of the files `paths`.
fn sample(paths: &[&Path]) -> Result<String, ChartError> {
    let mut digest = blake3::Hasher::new();
    digest.update(b"lenscube/chart-sample/1\n");
    let chosen = SAMPLE_FILES.min(paths.len());
    for k in 0..chosen {
        let path = paths[k * (paths.len() - 1) / (chosen - 1).max(1)];
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
