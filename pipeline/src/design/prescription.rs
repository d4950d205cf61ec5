//! The prescription of a lens: surfaces, glasses, aperture, fields; no rays.

mod double_gauss;
pub mod error;
pub mod glass;
pub mod glass_library;
pub mod model_glass;
pub mod shape;
pub mod system;
