//! Figures of a lens from rays alone, and what they decide: film plane, ray aiming, crossing surfaces.

mod aiming_check;
pub mod crossing;
pub mod describe;
pub mod field_figures;
pub mod image_circle;
pub mod light;
mod refocus;
pub mod spots;
