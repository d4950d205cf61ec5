//! Readers and writers of lenscube; no optics.
//!
//! | module | content |
//! |---|---|
//! | [`mod@chart`] | input: Zarr stores, flat files, OpenEXR, images; writer of chart stores and their layout |
//! | [`mod@film`] | output: the Zarr store of a film and its attributes |
//! | [`mod@lens`] | lens packs and their layout |
//! | [`mod@design`] | lens files: readers and writers of prescriptions, glass catalogues, the built-in lenses |
//! | [`mod@import`] | tables and PSFs of lenses from other programs |
//! | [`mod@camera_model`] | distortion of a lens in files of OpenCV, COLMAP, DriveWorks and lensfun, and as CSV |
//! | [`mod@isetcam`] | optics of ISETCam's ray-trace model as a MAT-file |
//! | [`mod@psf_grid`] | PSFs of a lens on a grid of places: FITS, NPY, Zarr |
//! | [`mod@export`] | films as OpenEXR, TIFF or flat files |
//! | [`mod@raw`], [`mod@sensor`] | raws of a sensor; descriptions of sensors |
//! | `mesh` | triangle meshes of glTF, OBJ and PLY files (feature `mesh`) |
//! | [`mod@mesh_name`] | names of such files |
//! | [`mod@scene`] | scenes: weights of spectra, distances and coverages of the surfaces of a mesh |
//! | [`mod@dataset`] | samples of a data set and their index |
//! | [`mod@developed`], [`mod@dng`] | developed raws as PNG, TIFF, OpenEXR; raws as DNG |
//! | [`mod@picture`] | pictures and plots for people |
//! | [`mod@group`], [`mod@pyramid`] | what films and raws have in common: creation, locks, verification; smaller levels |
//! | [`mod@parallel`] | work on numbered items on several threads |
//! | [`mod@durable`] | directories and object stores with atomic, durable writes |
//! | [`mod@escape`] | text of files and arguments as a terminal may print it |
//!
//! # Adding a chart format
//!
//! `chart/FORMAT.rs`, whose bands a `BandDecoder` decodes for a `DecodedChart` (`chart/exr.rs` is one), its `mod` line in `chart.rs` and its row in
//! `chart/any.rs`. Samples in a flat file: `chart/raster/` (`open.rs`, `layout.rs`, `samples.rs`). Its name: in the table of `chart.rs`,
//! the error of a chart that is not found (`chart/error.rs`), the help of CHART (`src/args/run.rs`), the guide's page `charts`. Tests: `tests/cli/formats.rs`, `tests/cli/invariance.rs`, a target in
//! `formats/tests/fuzz/` and its line in `main.rs`, files of other programs in `formats/tests/data` (`SOURCES.md`), the snapshots of help and errors.
//!
//! # Adding a codec of films and charts
//!
//! `shard/codec.rs` (`Codec`), `bounded.rs` (the bound of its decoded size; without one every read is an error), `Cargo.toml` (feature of `zarrs`),
//! `film/memory.rs` (memory of encoding), `src/args/choices.rs`. Tests: `shard/encode/tests.rs`, `film/tests.rs`, `chart/tests/written.rs`,
//! `formats/tests/fuzz/`, `scripts/check_interop.py`. Lens packs have their own list, in `lens/array.rs`.

// The command prints.
#![cfg_attr(not(test), warn(clippy::disallowed_methods, clippy::print_stdout, clippy::print_stderr))]

mod bounded;
pub mod camera_model;
pub mod chart;
pub mod dataset;
pub mod design;
pub mod developed;
pub mod dng;
pub mod durable;
pub mod escape;
pub mod export;
pub mod features;
pub mod film;
mod fits;
pub mod group;
mod hierarchy;
mod image;
pub mod import;
mod inflate;
pub mod isetcam;
pub mod lens;
mod mat;
#[cfg(feature = "mesh")]
pub mod mesh;
pub mod mesh_name;
mod npy;
mod object;
pub mod parallel;
pub mod picture;
pub mod psf_grid;
pub mod pyramid;
pub mod raw;
mod sample;
pub mod scene;
pub mod sensor;
mod shard;
mod toml_error;
mod toml_table;

#[cfg(test)]
#[path = "../tests/bombs/mod.rs"]
mod bombs;
