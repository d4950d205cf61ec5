//! Films: the simulated sensor-plane images, shard by shard, in a Zarr v3 group that other programs can open.
//!
//! ```text
//! zarr.json                    group attributes (below), consolidated metadata
//! film/                        (wavelength, y, x), f32 or f16, fill NaN; or roi_0/, roi_1/, … for regions of the film
//! film/c/BAND/ROW/COLUMN       a shard: see module `shard`
//! invented/                    (wavelength, y, x), f16: share of invented light per block of pixels; or roi_0_invented/, …: see module `invented`
//! veil/                        (wavelength, y, x), f32: light beside the image on bins of pixels; also veil_tail/: see module `layers`
//! wavelength/                  f64, nm
//! y/, x/                       f64, mm from the optical axis, y down; or roi_0_y/, roi_0_x/, …
//! pyramid/                     smaller levels, on request: see module `pyramid`
//! runs/                        records (`*.json`) and locks (`*.lock`) of runs, engines (`*.engine`)
//! ```
//!
//! Shards are (1, `shard`, `shard`) pixels of inner chunks (1, `chunk`, `chunk`); an array smaller than a shard has shards of its size,
//! rounded up to inner chunks. Regions are cut into shards from their own first pixel.
//!
//! | group attribute | content |
//! |---|---|
//! | `schema` | "lenscube/film/1" |
//! | `film_size` | [rows, columns] of the complete film |
//! | `pitch_um`, `axis_px` | pixel pitch; optical axis [row, column] in film pixels |
//! | `wavelengths_nm`, `units` | of the bands; of the values |
//! | `outputs` | `name`, `row`, `column`, `size` of each array, in film pixels |
//! | `sample`, `shard`, `chunk`, `codec` | "float32" or "float16"; sides in pixels; "none", "lz4" or "zstd" |
//! | `keep_bits` | bits of the mantissa that samples are rounded to; absent: all |
//! | `has_invented` | true: the share of invented light is stored; absent: nothing was invented |
//! | `layers` | `name`, `bin_px`, `margin_bins`, `share_taken`, `parts` of each layer of light; absent: none |
//! | `provenance` | of the caller; `job_digest` and `layout_digest` identify the job |
//! | `attributes_digest` | BLAKE3 digest of the attributes above |
//! | `ome` | OME-Zarr metadata, if there is a pyramid |
//!
//! The bytes of a shard depend on its pixels and the layout only, so films can be compared file by file. Creation, locks, replacement:
//! [`crate::group`].

mod engines;
mod invented;
mod layers;
mod levels;
mod memory;
mod ome;
mod shards;
mod spec;
mod store;
mod verify;
mod writer;

pub use crate::shard::{Codec, SampleType};
pub use layers::FilmLayer;
pub use shards::EncodedShard;
pub use spec::FilmSpec;
pub use store::FilmStore;
pub use writer::FilmWriter;

#[cfg(test)]
mod tests;
