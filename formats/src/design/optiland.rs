//! Lenses as JSON of the open-source design program Optiland.
//!
//! The file lists an aperture (EPD, imageFNO, objectNA, float_by_stop_size), fields, wavelengths, and surfaces with their positions along the axis, so that
//! a thickness is the difference of two of them; with tilts and decentres (module `place`) the lens has no rotational symmetry, unless its surfaces are on
//! one axis nevertheless. Shapes and apertures: module `geometry`.
//! Materials: Material (a name, and a maker as its `reference` or the folder of its data file), IdealMaterial (a constant index) and
//! AbbeMaterial (n_d and V_d). What Optiland has no data for is written in an object `lenscube` (semi-diameters, an AGF catalogue of
//! glasses that are not built in) and keys `lenscube_glass` and `dP_gF` of an AbbeMaterial, which Optiland does not read.
//! The inner radius of a RadialAperture is a central obscuration.
//! Field type, telecentric object space and ray aiming have other keys since version 0.6: both are read, and both are written.
//! Its paraxial image heights are those of the chief ray on the film; here they are heights in the paraxial image plane, and are converted.
//! Not supported, with a specific error: other geometries, apertures and materials.

mod geometry;
mod json;
mod place;
mod read;
mod values;
mod write;

use super::error::LensFileError;
use pipeline::design::paraxial::Paraxial;
use pipeline::design::system::{FieldKind, System};

/// Name of the catalogue of glasses in the file.
const OWN: &str = "LENSCUBE";

pub use read::parse;
pub use write::write;

/// Field values of Optiland over those of the system: paraxial heights on the film over those in the paraxial image plane, 1 for other kinds.
fn film_height_scale(system: &System) -> Result<f64, LensFileError> {
    if system.field_kind != FieldKind::ParaxialImageHeight {
        return Ok(1.0);
    }
    let p = Paraxial::new(system, system.primary_um())?;
    Ok(p.distortion_focal_length_mm.abs() / p.image_scale_mm(system.object_distance_mm))
}
