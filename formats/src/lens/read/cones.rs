//! Directions of the light at the film: the group `cones`.

use super::{Arrays, MAP_NUMBERS, PackArray};
use crate::lens::error::LensPackError;
use pipeline::bounds;
use pipeline::lens::cone::ConeTable;
use pipeline::lens::cone_field::{ConeField, ConeGrid};

/// Numbers of a cone of a lens with rotational symmetry.
const NUMBERS: usize = 4;

/// Reads the cones of each band: over the height, or over the film of a lens without rotational symmetry.
pub(super) fn read(tables: &Arrays<'_>, is_symmetric: bool) -> Result<Vec<Option<ConeField>>, LensPackError> {
    if is_symmetric { tables_of(tables) } else { grids_of(tables) }
}

fn bad(tables: &Arrays<'_>, b: usize, problem: impl std::fmt::Display) -> LensPackError {
    LensPackError::Attribute {
        path: tables.store.path.clone(),
        name: "cones",
        problem: format!("of band {b}: {problem}"),
    }
}

fn tables_of(tables: &Arrays<'_>) -> Result<Vec<Option<ConeField>>, LensPackError> {
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
        bounds::HEIGHT_MM.check(steps[b]).map_err(|e| bad(tables, b, e))?;
        let directions = directions.as_chunks::<NUMBERS>().0;
        let table = ConeTable::from_directions(steps[b], directions).map_err(|e| bad(tables, b, e))?;
        Ok(Some(ConeField::Symmetric(table)))
    };
    (0..tables.bands).map(band).collect()
}

fn grids_of(tables: &Arrays<'_>) -> Result<Vec<Option<ConeField>>, LensPackError> {
    let nodes = |name| {
        let array = PackArray::open(tables.store, name)?;
        match array.shape[..] {
            [n] if bounds::MAP_NODES.contains(n as f64) => array.read(),
            _ => Err(array.shape_error(format!("[places], {}", bounds::MAP_NODES))),
        }
    };
    let (x_mm, y_mm) = (nodes("cones/x")?, nodes("cones/y")?);
    let array = PackArray::open(tables.store, "cones/direction")?;
    array.expect_at_most(&MAP_NUMBERS)?;
    let size = x_mm.len() * y_mm.len();
    let shape = [tables.bands, size, ConeGrid::NUMBERS];
    array.expect_shape(&shape, "bands, places of cones/y and cones/x, numbers of a cone")?;
    let values = array.read()?;
    let band = |b: usize| {
        let cones = values.as_chunks::<{ ConeGrid::NUMBERS }>().0[b * size..][..size].to_vec();
        let grid = ConeGrid::new(x_mm.clone(), y_mm.clone(), cones).map_err(|e| bad(tables, b, e))?;
        Ok(Some(ConeField::Planar(grid)))
    };
    (0..tables.bands).map(band).collect()
}
