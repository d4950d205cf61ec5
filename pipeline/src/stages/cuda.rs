//! The stages of one band on a GPU, the counterpart of [`super::StageCompute`]: batches of tiles, film rows on the device, benchmarks.
#![allow(unsafe_code)]

pub mod band;
pub mod batches;
pub mod bench;
pub mod film_rows;

pub use band::band_needs;
