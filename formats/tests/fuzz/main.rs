//! Fuzz targets of this crate: charts (metadata, chunks, flat files, OpenEXR, MATLAB), lens packs, lens files, tolerances, importers, pictures, meshes, scenes. Harness: `tests/fuzz_support`.

#[path = "../../../tests/fuzz_support/mod.rs"]
mod fuzz_support;

mod chart;
mod chunks;
mod codecs;
mod designs;
mod hdf5;
mod importers;
mod json;
mod matlab;
#[cfg(feature = "mesh")]
mod meshes;
mod pack;
mod pictures;
mod raster;
mod scenes;
mod tolerances;

use std::path::{Path, PathBuf};

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)
}

/// A temporary directory, in memory if possible.
fn directory() -> tempfile::TempDir {
    tempfile::tempdir_in(fuzz_support::memory_directory()).unwrap()
}
