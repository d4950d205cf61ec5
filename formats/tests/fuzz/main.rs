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

use fuzz_support::{Random, damage};
use std::cell::Cell;
use std::path::{Path, PathBuf};

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)
}

/// A temporary directory, in memory if possible.
fn directory() -> tempfile::TempDir {
    tempfile::tempdir_in(fuzz_support::memory_directory()).unwrap()
}

/// Files with arrays that are damaged: their bytes, and the name of an array of each (empty: the only one).
struct ArrayFiles<const N: usize> {
    seeds: [(Vec<u8>, &'static str); N],
    /// The array to open of the last damaged file.
    array: Cell<&'static str>,
}

impl<const N: usize> ArrayFiles<N> {
    /// Those of `tests/data/FOLDER`.
    fn new(folder: &str, names: [(&'static str, &'static str); N]) -> Self {
        let seeds = names.map(|(name, array)| (std::fs::read(data(folder).join(name)).unwrap(), array));
        Self { seeds, array: Cell::new("") }
    }

    /// One of them, damaged.
    fn damaged(&self, r: &mut Random) -> Vec<u8> {
        let (seed, name) = &self.seeds[r.below(self.seeds.len())];
        self.array.set(if r.below(4) == 0 { "" } else { name });
        let mut bytes = seed.clone();
        damage(&mut bytes, r);
        bytes
    }
}
