//! The prescription of a lens: surfaces, glasses, coatings, aperture, fields; no rays.

pub mod absorption;
pub mod asymmetry;
pub mod coating;
pub mod coatings;
mod double_gauss;
pub mod error;
pub mod freeform;
pub mod glass;
pub mod glass_library;
pub mod model_glass;
pub mod pose;
pub mod shape;
pub mod system;
