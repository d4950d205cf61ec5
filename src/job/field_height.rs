//! Height of a lens's field.

use crate::job::lens::UntracedLens;
use anyhow::Result;
use pipeline::design::describe::describe;

/// Margin for half a PSF window beyond the film's corner, mm.
const MARGIN_MM: f64 = 0.25;

/// Ideal height of the lens's outermost field point, mm; `None` for a design without field points or without rotational symmetry.
///
/// # Errors
/// The design has no first-order properties.
pub fn field_height_mm(lens: &UntracedLens) -> Result<Option<f64>> {
    Ok(match lens {
        UntracedLens::Pack(pack) => {
            pack.lens().bands.iter().map(|band| band.ideal_height_at(band.reach_mm())).reduce(f64::min)
        }
        // Known of lenses with rotational symmetry.
        UntracedLens::Design(_) if lens.asymmetric_design().is_some() => None,
        UntracedLens::Design(design) => Some(describe(&design.system)?.paraxial_image_height_mm),
    }
    .filter(|mm| *mm > 0.0))
}

/// Height of the corners of a film that fills the lens's field, mm: of a pack, less the margin of the PSFs within its tables.
///
/// # Errors
/// As [`field_height_mm`].
pub fn filled_height_mm(lens: &UntracedLens) -> Result<Option<f64>> {
    let UntracedLens::Pack(pack) = lens else { return field_height_mm(lens) };
    let heights = pack.lens().bands.iter().map(|band| {
        let real = (band.reach_mm() - MARGIN_MM).max(0.5 * band.reach_mm());
        real.min(band.ideal_height_at(real))
    });
    Ok(heights.reduce(f64::min))
}
