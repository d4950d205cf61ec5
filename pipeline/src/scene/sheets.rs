//! Sheets: per chart pixel, up to K surfaces one behind the other, each with a coverage, a distance and the weights of its light.
//!
//! [`pixel`] has the rule for one pixel, [`Renderer`] applies it to tiles, [`EdgeMap`] finds the tiles that can show hidden sheets.
//!
//! Two passes. [`Renderer::front`] makes sheet 0 of a tile and finds whether the tile has an edge: two neighbouring pixels, or two surfaces in
//! a pixel, more than the gap apart, or a pixel that is covered beside one, or a part of one, that is not. [`Renderer::hidden`] makes sheets 1 … K−1 of
//! a tile that [`EdgeMap::in_reach`] names; elsewhere nothing of them can be seen, as no blur is wider than the reach. [`Renderer::all`] makes all
//! sheets of a tile at once.

mod edges;
pub mod pixel;
mod renderer;
mod settings;
mod tile;
mod uniform;

pub use edges::{Border, EdgeMap};
pub use renderer::{Renderer, Worker};
pub use settings::{Background, Settings, SettingsError};
pub use tile::{Counts, Front, Sheet};

#[cfg(test)]
mod tests;
