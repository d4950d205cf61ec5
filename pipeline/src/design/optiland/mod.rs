//! Lenses as JSON of the open-source design program Optiland.
//!
//! The file lists an aperture (EPD, imageFNO, objectNA, float_by_stop_size), fields, wavelengths, and surfaces with their positions along the axis, so that
//! a thickness is the difference of two of them. Surfaces: Plane, StandardGeometry, EvenAsphere (coefficients of r², r⁴, …) and OddAsphere (r, r², …).
//! Materials: Material (a name, and a maker as its `reference` or the folder of its data file), IdealMaterial (a constant index) and
//! AbbeMaterial (n_d and V_d). RadialAperture clips. The file has no semi-diameters, no weights of wavelengths and no name.
//! The inner radius of a RadialAperture is a central obscuration.
//! Not supported, with a specific error: tilts and decentres, other geometries and materials.

mod json;
mod read;
mod write;

pub use read::parse;
pub use write::write;
