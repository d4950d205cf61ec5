//! Tails of the bands of a pack: the group `tail`.

use super::{Arrays, PackArray};
use crate::lens::error::LensPackError;
use pipeline::bounds;
use pipeline::lens::tail::{BandTail, ORDERS, TERMS};

/// Reads the tail of each band; none where its `inner_radius` is NaN.
pub(super) fn read(tables: &Arrays<'_>) -> Result<Vec<Option<BandTail>>, LensPackError> {
    let radius = PackArray::open(tables.store, "tail/inner_radius")?;
    radius.expect_shape(&[tables.bands], "bands")?;
    let radius = radius.read()?;
    let heights = tables.rows("tail/height", None)?;
    let array = PackArray::open(tables.store, "tail/coefficient")?;
    array.expect_shape(
        &[tables.bands, heights.width, ORDERS * TERMS],
        "bands, heights of tail/height, terms of all harmonics",
    )?;
    array.expect_at_most(&bounds::TABLE_NUMBERS)?;
    let values = array.read()?;
    let row = |b: usize, k: usize| {
        let at = |m: usize, j: usize| values[((b * heights.width + k) * ORDERS + m) * TERMS + j];
        std::array::from_fn(|m| std::array::from_fn(|j| at(m, j)))
    };
    let band = |b: usize| {
        if radius[b].is_nan() {
            return Ok(None);
        }
        let height_mm = heights.numbers(b)?;
        let coefficients = (0..height_mm.len()).map(|k| row(b, k)).collect();
        // Checked with the other tables of the band.
        Ok(Some(BandTail { inner_mm: radius[b], height_mm, coefficients }))
    };
    (0..tables.bands).map(band).collect()
}
