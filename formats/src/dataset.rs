//! Data sets: many films, raws and pictures of one recipe, with labels, in folders, tar shards or a Zarr store.
//!
//! A [`recipe::Recipe`] (TOML, schema `lenscube/dataset/1`) says which samples there are; [`draw::Draws`] is what sample k is made of, a function of
//! the recipe and k alone. A [`store::DatasetStore`] holds units of consecutive samples:
//!
//! ```text
//! OUT/dataset.json              the recipe's digest, numbers of samples and of samples per unit
//! OUT/units/000012.jsonl        one line a sample of unit 12: all that made it, its labels, length and BLAKE3 of each of its items; written last, so a
//!                               unit with this file is complete
//! OUT/samples.jsonl             the lines of all units, once all are complete
//! OUT/000012/000001020.film.png     folders: a file an item
//! OUT/000012.tar                    tar: the same names in shards, with KEY.json, as WebDataset reads them
//! OUT/data.zarr/film                Zarr: arrays (sample, channel, y, x), a shard a unit, an inner chunk a sample
//! ```

pub mod coco;
pub mod draw;
pub mod encode;
pub mod recipe;
pub mod store;
mod tar;
mod values;
mod zarr;

pub use values::Numbers;

use std::path::PathBuf;

/// The files that match a pattern (`*`, `?`, `[…]`, `**`), sorted.
///
/// # Errors
/// What is wrong with the pattern.
pub fn matching(pattern: &str) -> Result<Vec<PathBuf>, String> {
    let found = glob::glob(pattern).map_err(|e| e.msg.to_owned())?;
    found.map(|path| path.map_err(|e| e.to_string())).collect()
}
