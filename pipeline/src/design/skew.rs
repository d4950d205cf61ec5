//! Lenses without rotational symmetry: a design with errors of its parts, traced for any field point.
//!
//! Places of surfaces: [`crate::design::prescription::pose`]. [`deviation`]: errors of a lens; [`system`]: the lens as built. [`surface`],
//! [`trace`], [`aim`]: rays; [`chief`]: chief rays and the field of a film place. [`opening`], [`illumination`]: the open pupil and its
//! light; [`image_cone`]: the directions of the light at the film; [`pupil`]: pupil functions, for the PSFs. [`map`], [`mod@trace_map`]: the map from film to ideal plane, with relative illumination.
//! [`tables`]: the tables and PSFs of a band of a built lens; [`grid`]: those of a design that is asymmetric, on columns and rows. `ideal_plane`: where both would be imaged without distortion.
//!
//! *Film frame*: X right, Y DOWN; *lens frame*: x right, y up, z along the light (heads of [`trace`] and [`system`]).

pub mod aim;
mod band;
pub mod chief;
pub mod deviation;
pub mod error;
pub mod grid;
mod ideal_plane;
pub mod illumination;
pub mod image_cone;
pub mod map;
pub mod opening;
pub mod pupil;
mod relative_light;
pub mod surface;
pub mod system;
pub mod tables;
#[cfg(test)]
mod tests;
pub mod trace;
pub mod trace_map;
