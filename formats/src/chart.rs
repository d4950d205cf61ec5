//! Charts: multispectral images (wavelength, y, x) on the ideal image plane, read rectangle by rectangle, and their writer.
//!
//! | source | type |
//! |---|---|
//! | Zarr v2 or v3 array, in a directory or at a URL | [`ChartStore`] |
//! | flat file: `.npy` (CF attributes in `NAME.npy.attributes.json`), ENVI, raw samples | [`RasterChart`] |
//! | HDF5, NetCDF-4, MATLAB 7.3 | module [`hdf5`] |
//! | MATLAB before 7.3, scenes of ISETCam among them | module [`matlab`] |
//! | OpenEXR with spectral channels | [`exr::open`] |
//! | grey PNG or TIFF per band; TIFF of several bands | module [`pictures`] |
//! | scene ([`crate::scene`]): weights of spectra | [`SceneChart`] |
//! | PNG, JPEG, WebP, TIFF, RGB OpenEXR | [`image::ImageFile`] |
//!
//! # Zarr stores
//! [`ChartStore::open`] takes `PATH` or `PATH//array`: a group with an array `chart` or `film`, or any array (wavelength, y, x) or
//! (y, x), in any order that its dimension names or [`ChartOptions::axes`] give, of f16, f32, f64, u8 or u16 with a regular chunk grid, sharded or not. Integers are values; attributes of the CF
//! conventions (`scale_factor`, `add_offset`, fill values, valid range) are applied. Not supported: irregular chunk grids, nested
//! shards.
//!
//! | attribute of the array or its group | meaning |
//! |---|---|
//! | `pitch_um` | pixel pitch in µm |
//! | `film_size` | [rows, columns] of the film, for a chart with overscan |
//! | `units` | unit of the values |
//! | `wavelengths_nm` | used if there is no 1-D array `wavelength` (`units`: nm, um or m) in the group |
//!
//! [`write_chart`] writes such a group, Zarr v3:
//!
//! ```text
//! zarr.json            attributes `pitch_um`, `film_size`, `units` and others of the caller, `schema` = "lenscube/chart/1"; consolidated
//!                      metadata
//! chart/               (wavelength, y, x) f32, fill NaN; shards (1, 2048, 2048) of inner chunks (1, 512, 512), smaller for a
//!                      smaller chart; encoding: see module `shard`
//! wavelength/          f64, nm, one chunk: little-endian, crc32c
//! ```
//!
//! [`write_surfaces`] adds the arrays of its surfaces ([`SurfaceArray`]): `depth`, `coverage`, `hidden/1/chart`, …
//!
//! # Reading
//! Metadata are checked on opening. [`pipeline::flow::ChartSource::read`] then decodes each chunk once as long as it stays in a bounded
//! cache, for any number of threads and overlapping requests, and checks its values ([`NanPolicy`], [`MAX_VALUE`]).

mod any;
mod array;
mod axes;
mod band_chunks;
pub mod cache;
mod content;
mod conventions;
mod coordinates;
mod decoded;
mod decoded_chart;
mod error;
pub mod exr;
mod file_change;
mod files;
mod foreign;
pub mod hdf5;
mod header;
mod identity;
pub mod image;
mod interleave;
mod layout;
pub mod matlab;
mod memory;
mod node;
mod open;
mod options;
pub mod pictures;
mod raster;
mod read;
mod read_ahead;
mod rechunk;
mod samples_key;
mod scene;
mod store;
mod temp_file;
mod values;
mod write;

pub use crate::npy::parse_dtype;
pub use crate::sample::{RasterSample, Sample};
pub use crate::shard::Codec;
pub use any::{Chart, ChartRequest, check_has_files, holds_arrays, takes_axes};
pub use array::{ArrayChart, ArrayPixels};
pub use axes::{AxisOrder, AxisOrderError};
pub use decoded_chart::DecodedChart;
pub use error::ChartError;
pub use files::files_of;
pub use header::FileArray;
pub use identity::ChartIdentity;
pub use memory::ChunkMemory;
pub use open::{lacks_array, split_array};
pub use options::{ChartOptions, NanPolicy};
pub use raster::RasterChart;
pub use raster::layout::{Interleave, RasterLayout};
pub use scene::SceneChart;
pub use store::{ChartStore, ReadStats};
pub use values::MAX_VALUE;
pub use write::{
    ChartMeta, NewChart, SurfaceArray, WriteError, WriteReport, remove_chart, write_chart, write_surfaces,
};

#[cfg(test)]
mod tests;
