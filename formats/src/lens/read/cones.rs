//! Directions of the light at the film: the group `cones`.

use super::{Arrays, PackArray};
use crate::lens::error::LensPackError;
use pipeline::bounds;
use pipeline::lens::cone::ConeTable;

/// Numbers of a cone.
const NUMBERS: usize = 4;

/// Reads the cones of each band.
pub(super) fn read(tables: &Arrays<'_>) -> Result<Vec<Option<ConeTable>>, LensPackError> {
    let steps = PackArray::open(tables.store, "cones/height_step")?;
    steps.expect_shape(&[tables.bands], "bands")?;
    let steps = steps.read()?;
    let array = PackArray::open(tables.store, "cones/direction")?;
    array.expect_at_most(&bounds::TABLE_NUMBERS)?;
    let values = array.read()?;
    let row = NUMBERS * tables.bands.max(1);
    let heights = values.len() / row;
    array.expect_shape(&[tables.bands, heights, NUMBERS], "bands, heights, numbers of a cone")?;
    let band = |b: usize| {
        let directions = &values[b * heights * NUMBERS..][..heights * NUMBERS];
        let bad = |problem: String| LensPackError::Attribute {
            path: tables.store.path.clone(),
            name: "cones",
            problem: format!("of band {b}: {problem}"),
        };
        bounds::HEIGHT_MM.check(steps[b]).map_err(|e| bad(e.to_string()))?;
        let directions = directions.as_chunks::<NUMBERS>().0;
        ConeTable::from_directions(steps[b], directions).map(Some).map_err(bad)
    };
    (0..tables.bands).map(band).collect()
}
