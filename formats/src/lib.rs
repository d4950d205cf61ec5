//! Readers and writers of lenscube; no optics.
//!
//! | module | content |
//! |---|---|
//! | [`mod@chart`] | input: Zarr stores, flat files, OpenEXR, images; writer of chart stores and their layout |
//! | [`mod@film`] | output: the Zarr store of a film, its attributes, pyramid and verification |
//! | [`mod@lens`] | lens packs and their layout |
//! | [`mod@import`] | lens data of other programs |
//! | [`mod@export`] | films as OpenEXR, TIFF or flat files |
//! | [`mod@picture`] | pictures and plots for people |
//! | [`mod@durable`] | directories and object stores with atomic, durable writes |

mod bounded;
pub mod chart;
pub mod durable;
pub mod export;
pub mod film;
mod hierarchy;
mod image;
pub mod import;
pub mod lens;
mod npy;
mod parallel;
pub mod picture;
mod sample;
mod shard;

#[cfg(test)]
#[path = "../tests/bombs/mod.rs"]
mod bombs;
