//! Readers and writers of lenscube: chart and film stores, lens packs and their importers, pictures. Knows no optics.

mod bounded;
pub mod chart;
pub mod durable;
pub mod export;
pub mod film;
mod hierarchy;
pub mod import;
pub mod lens;
mod npy;
pub mod picture;
mod shard;

#[cfg(test)]
#[path = "../tests/bombs/mod.rs"]
mod bombs;
