//! Ghosts of the bands of a pack: the group `ghost`.

use super::{Arrays, PackArray};
use crate::lens::error::LensPackError;
use crate::lens::store::PackStore;
use pipeline::bounds;
use pipeline::design::ghost::report::PathFigures;
use pipeline::design::ghost::rings::{RingOperator, RingSizes};

/// Ghosts of a pack but their operators, which [`LensPack::ghosts`](crate::lens::LensPack::ghosts) reads.
#[derive(Clone, Debug, PartialEq)]
pub struct PackGhosts {
    /// Rings of all bands.
    pub sizes: RingSizes,
    /// Reflectance of the film, which the operators contain, by band.
    pub film_reflectance: Vec<f64>,
}

/// Reads the rings and the reflectances.
pub(super) fn read(tables: &Arrays<'_>) -> Result<PackGhosts, LensPackError> {
    const RING: &str = "ghost/ring";
    const REFLECTANCE: &str = "ghost/sensor_reflectance";
    let ring_mm = tables.per_band(RING)?;
    for (band, mm) in ring_mm.iter().enumerate() {
        if !bounds::HEIGHT_MM.contains(*mm) || *mm <= 0.0 || *mm != ring_mm[0] {
            return Err(tables.value(RING, band, 0, *mm, "the same width above 0 in all bands"));
        }
    }
    let film_reflectance = tables.per_band(REFLECTANCE)?;
    for (band, reflectance) in film_reflectance.iter().enumerate() {
        if !(0.0..1.0).contains(reflectance) {
            return Err(tables.value(REFLECTANCE, band, 0, *reflectance, "a share from 0 to below 1"));
        }
    }
    let first = PackArray::open(tables.store, &operator_name(0))?;
    let rings = match first.shape[..] {
        [_, rings, _] if bounds::GHOST_RINGS.contains(rings as f64) => rings as usize,
        _ => {
            return Err(
                first.shape_error(format!("[orders, rings, rings of the scene], {}", bounds::GHOST_RINGS))
            );
        }
    };
    let sizes = RingSizes { ring_mm: ring_mm[0], ..RingSizes::new(1.0, rings) };
    for band in 0..tables.bands {
        operator_array(tables.store, band, sizes)?;
    }
    Ok(PackGhosts { sizes, film_reflectance })
}

fn operator_name(band: usize) -> String {
    format!("ghost/operator/{band}")
}

fn operator_array(store: &PackStore, band: usize, sizes: RingSizes) -> Result<PackArray<'_>, LensPackError> {
    let array = PackArray::open(store, &operator_name(band))?;
    array.expect_shape(&sizes.shape(), "orders, rings of the film, rings of the scene")?;
    array.expect_at_most(&bounds::GHOST_NUMBERS)?;
    Ok(array)
}

/// Reads the paths of the ghosts of band `band`; none of a pack that does not list them.
pub(in crate::lens) fn paths(
    store: &PackStore,
    band: usize,
) -> Result<Option<Vec<PathFigures>>, LensPackError> {
    let name = format!("ghost/paths/{band}");
    let Some(array) = PackArray::open_optional(store, &name)? else { return Ok(None) };
    match array.shape[..] {
        [_, columns] if columns == PathFigures::NUMBERS as u64 => {}
        _ => return Err(array.shape_error(format!("[paths, {}]", PathFigures::NUMBERS))),
    }
    array.expect_at_most(&bounds::TABLE_NUMBERS)?;
    let values = array.read()?;
    let rows = values.as_chunks::<{ PathFigures::NUMBERS }>().0;
    let invalid = |row: usize| LensPackError::Ghosts {
        path: store.path.clone(),
        array: name.clone(),
        problem: format!("path {row} has the numbers {:?}, which no path has", rows[row]),
    };
    let path = |(row, numbers): (usize, &[f64; PathFigures::NUMBERS])| {
        PathFigures::of_numbers(*numbers).ok_or_else(|| invalid(row))
    };
    rows.iter().enumerate().map(path).collect::<Result<_, _>>().map(Some)
}

/// Reads the operator of band `band`, of rings of `sizes`.
pub(in crate::lens) fn operator(
    store: &PackStore,
    band: usize,
    sizes: RingSizes,
) -> Result<RingOperator, LensPackError> {
    let array = operator_array(store, band, sizes)?;
    let samples = array.read_as(|v| v as f32)?;
    if let Some(chunk) = samples.missing {
        return Err(array.missing_chunk(chunk));
    }
    let operator = RingOperator { sizes, values: samples.values };
    let invalid =
        |problem| LensPackError::Ghosts { path: store.path.clone(), array: operator_name(band), problem };
    operator.check().map_err(invalid)?;
    Ok(operator)
}
