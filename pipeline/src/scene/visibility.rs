//! Visibility: all hits of the samples of a tile, and which of them are surfaces.
//!
//! A ray d = (x, y, 1) meets the triangle (v0, v1, v2) if three edge functions have one sign (`triangle`):
//! ```text
//! e_ij = (n_x x + n_y y) + n_z,   n = v_i × v_j   over (1,2), (2,0), (0,1)
//! V = (N·d)/(N·v0),   N = (v1 − v0) × (v2 − v0);   a hit has 0 < V < ∞
//! b_k = e_k/Σe, limited to 0…1                                   barycentric coordinates
//! ```
//! e = 0 has the sign of the first of n_x, n_y, n_z that is not 0. Products of f32 are exact and v_j × v_i = −(v_i × v_j), so e has opposite
//! signs in two triangles that share an edge: no gap and no double hit. Corners behind the camera are allowed, nothing is clipped. Hits are
//! ordered by V, the nearest first, then by the number of the triangle.
//!
//! Not by rays: `bins` lists the triangles of each tile, `spans` the columns of each in a row of pixels, `raster` evaluates the edge functions at the samples
//! of the row, 4 at a time, and keeps the sorted hits of each sample; `surfaces` finds those that are surfaces. Method: J. Pineda, SIGGRAPH 1988, 17 (edge
//! functions).

pub(crate) mod bins;
mod engine;
mod lanes;
pub(crate) mod raster;
mod spans;
pub(crate) mod surfaces;
pub(crate) mod tile;
pub(crate) mod triangle;

pub use bins::TileGrid;
pub use engine::Engine;

/// Rows and columns of a tile in px.
pub const TILE_PX: usize = 64;

/// Most hits of a sample; the farthest beyond are dropped and counted.
pub const MAX_HITS: usize = 256;
