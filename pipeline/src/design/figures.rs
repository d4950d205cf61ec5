//! Figures of a lens from rays alone, and what they decide: film plane, ray aiming, crossing surfaces.

mod aiming_check;
pub mod cardinal;
pub mod crossing;
pub mod describe;
pub mod field_curvature;
pub mod field_figures;
pub mod image_circle;
pub mod image_cone;
pub mod light;
pub mod paraxial_rays;
pub mod pattern_spot;
pub mod pinhole;
mod refocus;
pub mod roughness;
pub mod seidel;
pub mod spots;
#[cfg(test)]
pub(super) mod tests;
pub mod wavefront;
pub mod zernike;
